// Masks by hand: outlines and strokes of a brush on the raw scan, and an eraser.
import { undoOrRedo } from "./asked.js";
import {
  byId, element, first, number, renew, shortName, start, word,
} from "./words.js";
import { cleared, crosshair, halo } from "./overlay.js";
import { drawLayer, image, onTile, rawLayer } from "./tiles.js";
import { ARROWS, Pane, View, ZOOMS, oncePerFrame, paneElement } from "./view.js";
import { send } from "./wire.js";

/** @typedef {"polygon" | "brush"} Tool */

const HIDDEN = "#ff5d5d";
const FREED = "#58d68d";
const NEAR_PX = 9; // design: as near as a hand clicks on a corner
const STEP_PX = 12; // design: an arrow moves the crosshair by this, with Shift by one
const WIDTHS_MM = [0.3, 0.6, 1, 2, 4, 8]; // design: from a pen stroke to a whole label
const state = {
  found: /** @type {Masks | null} */ (null),
  current: "",
  tool: /** @type {Tool} */ ("polygon"),
  hides: true,
  camera: false,
  width: 2,
  outline: /** @type {Pair[]} */ ([]),
  /** Why a gesture came to nothing. */
  said: "",
  cursor: /** @type {Pair | null} */ (null),
  pane: /** @type {Pane | null} */ (null),
  // design: from a whole scan at once to 40 pixels of the screen for one of the scan.
  view: new View(0.005, 40),
  fitted: "",
};
const redraw = oncePerFrame(draw);

/** A click sets a corner; with the brush a drag paints. @type {import("./view.js").Hand} */
const HAND = {
  redraw,
  point: (pane, screen) => {
    state.cursor = screen && pane.layerFromScreen(screen);
    redraw();
  },
  grips: () => !start.guest && state.tool === "brush",
  drag: (pane, screen) => {
    if (screen) state.outline.push(pane.layerFromScreen(screen));
    redraw();
  },
  drop: () => finish(),
  click: (pane, screen) => {
    if (!start.guest) put(pane.layerFromScreen(screen));
  },
};

export function setUpMask() {
  onTile(redraw);
  byId("mask").addEventListener("close", () => {
    state.pane = null;
    state.found = null;
    send({ kind: "sheet", sheet: "mask", shown: false });
  });
}

/** @param {Masks | undefined} known @param {string} [photo] */
export function openMask(known, photo) {
  const sheet = byId("mask");
  if (sheet.open) return sheet.close();
  renew(first(".view-body", sheet), element("p", { class: "muted" }, word("wait")));
  sheet.showModal();
  Object.assign(state, { outline: [], said: "", fitted: "", current: photo ?? state.current });
  if (known) showMask(known);
  send({ kind: "sheet", sheet: "mask", shown: true });
}

const now = () => state.found?.photos.find(({ photo }) => photo === state.current);

/** @param {Masks} found */
export function showMask(found) {
  const sheet = byId("mask");
  if (!sheet.open) return;
  state.found = found;
  if (!now()) state.current = found.photos[0]?.photo ?? "";
  state.pane ??= new Pane(paneElement("mask-room"), state.view, HAND);
  const { pane } = state;
  renew(first(".view-body", sheet), () =>
    [head(), element("div", { class: "two-rooms" }, pane.room, side(found))]);
  const one = now();
  if (one && state.fitted !== one.photo) fit();
  redraw();
}

function fit() {
  const one = now();
  if (!one || !state.pane) return;
  const [width, height] = state.pane.size;
  state.view.fit([0, 0], one.size, [width || 900, height || 700], 0.96);
  state.fitted = one.photo;
  redraw();
}

function refresh() {
  if (state.found) showMask(state.found);
}

/** @param {string} name @param {string} key @param {boolean} on @param {() => void} does */
const toggle = (name, key, on, does) => element("button", {
  "data-mask": name, class: on ? "on" : "", "aria-pressed": `${on}`, disabled: start.guest,
  title: word(`mask.${name}.tip`), onclick: does,
}, word(`mask.${name}`), element("kbd", {}, key));

function head() {
  const { tool, hides, camera, width } = state;
  const close = () => byId("mask").close();
  const reach = element("select", { "aria-label": word("mask.width"), disabled: start.guest,
    onchange: (/** @type {Event} */ event) => {
      state.width = Number(/** @type {HTMLSelectElement} */ (event.target).value);
      redraw();
    } }, ...WIDTHS_MM.map((mm) =>
    element("option", { value: mm, selected: mm === width }, number(mm, 1, "mm"))));
  return element("header", {}, element("h2", {}, word("mask")),
    element("span", { class: "segments" },
      toggle("polygon", "P", tool === "polygon", () => use("polygon")),
      toggle("brush", "B", tool === "brush", () => use("brush"))), reach,
    element("span", { class: "segments" }, toggle("eraser", "E", !hides, () => {
      state.hides = !state.hides;
      refresh();
    })),
    element("span", { class: "segments" }, toggle("camera", "C", camera, () => {
      state.camera = !state.camera;
      refresh();
    })),
    element("span", { class: "stretch" }),
    element("button", { onclick: fit }, word("act.fit"), element("kbd", {}, "F")),
    element("button", { id: "mask-close", onclick: close }, word("act.close")));
}

/** @param {Tool} tool */
function use(tool) {
  if (state.outline.length) return tell("mask.unfinished");
  state.tool = tool;
  refresh();
}

/** @param {Masks} found */
function side({ photos, strokes, ties }) {
  const one = now();
  const scans = photos.map((each) => element("button", {
    class: `scan${each === one ? " on" : ""}`, "data-scan": each.photo, title: each.photo,
    onclick: () => choose(each.photo),
  }, element("span", {}, shortName(each.photo)),
  each.hidden.length ? element("span", { class: "muted" }, word("mask.has")) : null));
  const said = one ? covered(one) : [];
  if (ties) said.push(element("p", { id: "mask-ties" }, word("mask.ties", { count: ties })));
  const stale = photos.some((each) => each.hidden.length || each.freed.length)
    ? [element("p", { class: "doubted" }, word("mask.again"))] : [];
  const lines = strokes.map((drawn) => element("p", { class: "decided" },
    word(`mask.did.${drawn.hides ? "hidden" : "freed"}`, {
      what: drawn.camera ? word("mask.all-of", { camera: drawn.subject })
        : shortName(drawn.subject),
      who: drawn.who, when: drawn.when,
    }),
    element("button", { class: "small", disabled: start.guest,
      onclick: () => send({ kind: "back", decision: drawn.id }) }, word("history.back"))));
  const held = state.said
    ? [element("p", { id: "mask-said", class: "next", role: "status" }, word(state.said))] : [];
  return element("aside", {}, ...held, element("h3", {}, word("placing.scans")),
    element("div", { class: "scans" }, ...scans), ...said, ...stale,
    element("h3", {}, word("mask.drawn")),
    ...(lines.length ? lines : [element("p", { class: "muted" }, word("mask.none"))]),
    element("p", { class: "muted" }, word("mask.hint")));
}

/** What a mask took out of use, and what stays. @param {MaskedScan} one */
function covered({ out, held }) {
  const said = [];
  if (out.length) {
    said.push(element("p", { id: "mask-out" },
      word("mask.out", { count: out.length, names: out.join(", ") })));
  }
  if (held.length) {
    said.push(element("p", { id: "mask-held", class: "doubted" },
      word("mask.held", { names: held.join(", ") })));
  }
  return said;
}

/** @param {string} photo */
function choose(photo) {
  if (state.outline.length) return tell("mask.unfinished");
  state.current = photo;
  return refresh();
}

/** What holds a gesture back; nothing once it no longer does. @param {string} said */
function tell(said) {
  if (said === state.said) return;
  state.said = said;
  refresh();
}

/** @param {number} by */
function step(by) {
  const photos = state.found?.photos ?? [];
  const at = photos.findIndex(({ photo }) => photo === state.current) + by;
  choose(photos[Math.min(Math.max(at, 0), photos.length - 1)]?.photo ?? "");
}

/** A corner; on the first one again, the outline is whole. @param {Pair} place */
function put(place) {
  const [begin] = state.outline;
  const near = begin && state.outline.length > 2
    && Math.hypot(place[0] - begin[0], place[1] - begin[1]) * state.view.scale < NEAR_PX;
  if (near) return finish();
  state.outline.push(place);
  tell("");
  if (state.tool === "brush" && state.outline.length === 1) finish();
  redraw();
}

/** Width of the brush, pixels of the scan. */
const reachPx = () => (state.tool === "brush" ? (1000 * state.width) / (now()?.pixel_um ?? 20) : 0);

function finish() {
  const { outline, hides, camera, current } = state;
  const width = reachPx();
  if (outline.length && outline.length < 3 && !width) return tell("mask.few");
  tell("");
  if (!outline.length || send({ kind: "draw", photo: current, outline: thinned(outline), width,
    hides, camera })) state.outline = [];
  redraw();
}

/** Without places nearer to each other than a pixel of the screen. @param {Pair[]} places */
function thinned(places) {
  const least = 1 / state.view.scale;
  const kept = [places[0]];
  for (const [x, y] of places) {
    const [a, b] = kept[kept.length - 1];
    if (Math.hypot(x - a, y - b) >= least) kept.push([x, y]);
  }
  return kept.map(([x, y]) => [Math.round(x * 10) / 10, Math.round(y * 10) / 10]);
}

/** @param {Context} context @param {number[][][][]} polygons @param {string} colour */
function shade(context, polygons, colour) {
  const { pane } = state;
  if (!pane) return;
  context.beginPath();
  for (const ring of polygons.flat()) {
    ring.map((place) => pane.screenFromLayer(place))
      .forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
  }
  context.fillStyle = `${colour}59`;
  context.fill("evenodd");
  context.strokeStyle = colour;
  context.stroke();
}

function draw() {
  const { pane, view, outline, cursor } = state;
  const one = now();
  if (!pane || !one) return;
  const [context, width, height] = cleared(pane.picture);
  const size = /** @type {Pair} */ ([width, height]);
  drawLayer(context, rawLayer(one.photo, one.version, one.size, false), view.frame(size), size);
  const [over] = cleared(pane.marks);
  const veil = image(`/mask/${encodeURIComponent(one.photo)}?e=${start.edition}`);
  const [left, top] = pane.screenFromLayer([0, 0]);
  if (veil.ready) {
    over.imageSmoothingEnabled = false;
    over.drawImage(veil, left, top, one.size[0] * view.scale, one.size[1] * view.scale);
  }
  shade(over, one.hidden, HIDDEN);
  shade(over, one.freed, FREED);
  stroke(over, [...outline, ...(cursor && state.tool === "polygon" ? [cursor] : [])]);
  if (cursor) crosshair(over, pane.screenFromLayer(cursor), width, height);
  if (cursor && state.tool === "brush") {
    const [x, y] = pane.screenFromLayer(cursor);
    halo(over, colour(), 1.2, () => over.arc(x, y, (reachPx() * view.scale) / 2, 0, 7));
  }
  pane.where.textContent = cursor ? `${cursor.map((value) => number(value, 0)).join(", ")} px` : "";
}

const colour = () => (state.hides ? HIDDEN : FREED);

/** What is being drawn. @param {Context} context @param {Pair[]} places */
function stroke(context, places) {
  const { pane, tool, view } = state;
  if (!pane || !state.outline.length) return;
  const path = () => places.map((place) => pane.screenFromLayer(place))
    .forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
  if (tool === "brush") {
    context.beginPath();
    path();
    Object.assign(context, { strokeStyle: `${colour()}80`, lineCap: "round", lineJoin: "round",
      lineWidth: reachPx() * view.scale });
    context.stroke();
    return;
  }
  halo(context, colour(), 1.6, path);
  for (const place of state.outline) {
    const [x, y] = pane.screenFromLayer(place);
    context.fillStyle = colour();
    context.fillRect(x - 3, y - 3, 6, 6);
  }
}

/**
 * The crosshair by arrows, from the middle of what is shown.
 * @param {Pair} way @param {number} px of the screen
 */
function move([right, down], px) {
  const { view, cursor } = state;
  const [x, y] = cursor ?? [view.x, view.y];
  state.cursor = [x + (right * px) / view.scale, y + (down * px) / view.scale];
  redraw();
}

/** @type {Record<string, (event: KeyboardEvent) => void>} */
const ACTS = {
  KeyP: () => use("polygon"), KeyB: () => use("brush"), KeyJ: () => step(1), KeyK: () => step(-1),
  KeyF: fit, KeyU: undoOrRedo,
  KeyE: () => {
    state.hides = !state.hides;
    refresh();
  },
  KeyC: () => {
    state.camera = !state.camera;
    refresh();
  },
  Enter: () => finish(),
  Backspace: () => {
    state.outline.pop();
    tell("");
    redraw();
  },
  Space: () => {
    const { cursor, view } = state;
    state.cursor = cursor ?? [view.x, view.y];
    put(state.cursor);
  },
};

/** True when the key is ours. @param {KeyboardEvent} event @param {string} letter */
export function maskKey(event, letter) {
  const down = event.type === "keydown";
  if (event.key === "Escape") {
    if (down && state.outline.length) {
      state.outline = [];
      tell("");
      redraw();
    } else if (down) byId("mask").close();
    return true;
  }
  const arrow = ARROWS[event.key];
  if (arrow) {
    if (down) move(arrow, event.shiftKey ? 1 : STEP_PX);
    return true;
  }
  if (ZOOMS[event.key]) {
    if (down) {
      state.view.zoom(ZOOMS[event.key], state.cursor ?? undefined);
      redraw();
    }
    return true;
  }
  const name = event.key === " " ? "Space" : event.key === "Backspace" ? "Backspace" : letter;
  const acts = ACTS[name];
  const guest = start.guest && !["KeyJ", "KeyK", "KeyF"].includes(name);
  if (acts && down && !guest && !event.repeat) acts(event);
  return Boolean(acts) || event.key.length === 1;
}

export const maskState = () => {
  const { found, current, tool, hides, camera, outline, cursor, view, pane } = state;
  const toScreen = (/** @type {Pair} */ place) => pane?.screenFromLayer(place);
  return { found, current, tool, hides, camera, outline, cursor, view, toScreen };
};
