// Placement on the map: footprints by the given georeference and as placed, over the ortho.
import {
  again, byId, element, first, number, renew, shortName, start, tip, word,
} from "./words.js";
import { cleared, halo, scaleBar, text } from "./overlay.js";
import { drawLayer, groundFromLayer, layerFromGround, onTile, orthoLayer } from "./tiles.js";
import { ARROWS, Pane, View, ZOOMS, oncePerFrame, paneElement } from "./view.js";
import { openPlaced } from "./placed.js";
import { areaShown, sieveArea } from "./queue.js";
import { send } from "./wire.js";

const BEFORE = "#f3b13c";
const AFTER = "#56b4e9";
const AREA = "#ffffff";
const state = {
  found: /** @type {Placement | null} */ (null),
  current: "",
  mode: "both",
  /** True while the next drag draws an area of the queue, from `corner` to `other`. */
  drawing: false,
  corner: /** @type {Pair | null} */ (null),
  other: /** @type {Pair | null} */ (null),
  view: new View(),
  pane: /** @type {Pane | null} */ (null),
};
const redraw = oncePerFrame(draw);

/** @type {import("./view.js").Hand} */
const HAND = {
  redraw,
  point: (pane, screen) => {
    const ground = screen && groundFromLayer(pane.layerFromScreen(screen));
    pane.where.textContent = ground ? ground.map((value) => number(value, 0)).join("  ") : "";
  },
  click: pick,
  grips: (pane, screen) => {
    if (state.drawing) state.corner = pane.layerFromScreen(screen);
    return state.drawing;
  },
  drag: (pane, screen) => {
    state.other = screen && pane.layerFromScreen(screen);
    redraw();
  },
  drop: takeBox,
};

/** What was drawn is the area of the queue. */
function takeBox() {
  sieveArea(boxDrawn().map((place) => /** @type {Pair} */ (groundFromLayer(place))));
  drawArea(false);
}

/** All that the map shows is; false where no area is to be drawn. */
function takeAll() {
  const { drawing, pane } = state;
  if (!drawing || !pane) return false;
  state.corner = pane.layerFromScreen([0, 0]);
  state.other = pane.layerFromScreen(/** @type {Pair} */ (pane.size));
  takeBox();
  return true;
}

/** Corners of what is being drawn, on the layer. @returns {Pair[]} */
function boxDrawn() {
  const { corner, other } = state;
  if (!corner || !other) return [];
  return [corner, [other[0], corner[1]], other, [corner[0], other[1]]];
}

/** The next drag draws an area, or moves the map again. @param {boolean} on */
function drawArea(on) {
  Object.assign(state, { drawing: on, corner: null, other: null });
  if (state.found) showPlacement(state.found);
}

export function setUpPlacement() {
  // design: from any block at once to 20 pixels of the screen for one of the ortho.
  state.view = new View(0.001, 20 / start.ortho_pixel);
  onTile(redraw);
  byId("placement").addEventListener("close", () => {
    Object.assign(state, { pane: null, drawing: false });
    send({ kind: "sheet", sheet: "placement", shown: false });
  });
}

/** @param {Placement} [known] */
export function openPlacement(known) {
  const sheet = byId("placement");
  if (sheet.open) return sheet.close();
  const waiting = element("p", { class: "muted" }, word("wait"));
  first(".view-body", sheet).replaceChildren(waiting);
  sheet.showModal();
  state.found = null;
  if (known) showPlacement(known);
  send({ kind: "sheet", sheet: "placement", shown: true });
}

/** @param {Placement} found */
export function showPlacement(found) {
  const sheet = byId("placement");
  if (!sheet.open) return;
  const fresh = !state.found;
  state.found = found;
  const kept = sheet.querySelector(".shifts")?.scrollTop ?? 0;
  if (!found.photos.some((one) => one.photo === state.current)) {
    state.current = found.photos[0]?.photo ?? "";
  }
  state.pane ??= new Pane(paneElement("map-room"), state.view, HAND);
  const { pane } = state;
  renew(first(".view-body", sheet), () =>
    [head(found), element("div", { class: "two-rooms placement" }, pane.room, side(found))]);
  first(".shifts", sheet).scrollTop = kept;
  if (fresh) fit();
  redraw();
}

function fit() {
  const { found, pane, view } = state;
  const points = found?.photos.flatMap((one) => [...(one.before ?? []), ...(one.after ?? [])]);
  if (!points?.length || !pane) return;
  const [from, to] = [Math.min, Math.max].map((most) =>
    layerFromGround([0, 1].map((axis) => most(...points.map((place) => place[axis])))));
  const [width, height] = pane.size;
  view.fit(from, to, [width || 900, height || 700], 0.92);
  redraw();
}

/** @param {Pair[]} ring */
const middleOf = (ring) =>
  [0, 1].map((axis) => ring.reduce((sum, corner) => sum + corner[axis], 0) / ring.length);

/** @param {Placement} found */
function head(found) {
  const { mode } = state;
  const button = (/** @type {string} */ name) => element("button", {
    class: mode === name ? "on" : "", "aria-pressed": `${mode === name}`, "data-mode": name,
    onclick: () => setMode(name),
  }, word(`placement.${name}`));
  const { median, worst, photos } = found;
  const none = photos.some((one) => one.oriented) ? "placement.none-given" : "placement.nothing";
  const words = median === null ? word(none)
    : word("placement.summary", { median: number(median, 0), worst: number(worst, 0) });
  const close = () => byId("placement").close();
  return element("header", {}, element("h2", {}, word("placement")),
    element("span", { class: "segments" }, ...["both", "before", "after"].map(button)),
    element("span", { class: "muted" }, words), element("span", { class: "stretch" }),
    element("span", { class: "legend-line before" }, word("placement.given")),
    element("span", { class: "legend-line after" }, word("placement.placed")),
    ...areaButtons(),
    element("button", { onclick: fit }, word("act.fit"), element("kbd", {}, "F")),
    element("button", { id: "placement-close", onclick: close }, word("act.close")));
}

/** Draws an area, and takes it away. */
function areaButtons() {
  const { drawing } = state;
  const draws = element("button", { id: "map-area", class: drawing ? "on" : "",
    "aria-pressed": `${drawing}`, title: word("act.area.tip"),
    onclick: () => drawArea(!state.drawing) }, word("act.area"),
  element("kbd", {}, "Shift+F"));
  if (!areaShown().area.length) return [draws];
  const clear = () => {
    sieveArea([]);
    drawArea(false);
  };
  return [draws, element("button", { class: "small", title: word("queue.area.tip"),
    "aria-label": word("queue.area.tip"), onclick: clear }, "\u00d7")];
}

/** @param {string} mode */
function setMode(mode) {
  state.mode = mode;
  if (state.found) showPlacement(state.found);
}

/** @param {Placement} found */
function side({ photos, set_aside }) {
  const heads = ["photo", "east", "north", "turn", "scale", "rms"].map((name) => element("th",
    { title: tip(`placement.${name}`) }, word(`placement.${name}`)));
  const one = photos.find((photo) => photo.photo === state.current);
  const source = one?.source ? word(`placement.source.${one.source}`) : "";
  const about = one ? [
    element("h3", {}, shortName(one.photo)),
    element("p", {}, source && word("placement.source", { source })),
    ...one.why.map((why) => element("p", { class: "doubted" }, again(why))),
    anew(one.photo),
  ] : [];
  const aside = set_aside.map(([name, why]) =>
    element("p", { class: "doubted" }, element("b", {}, shortName(name)), ` ${again(why)}`,
      anew(name)));
  if (aside.length) aside.unshift(element("h3", {}, word("placement.aside")));
  const table = element("table", {}, element("tr", {}, ...heads), ...photos.map(line));
  return element("aside", {}, element("div", { class: "shifts" }, table), ...about, ...aside,
    element("p", { class: "muted" }, word("placement.hint")));
}

/** A photo placed by clicks instead. @param {string} photo */
const anew = (photo) => element("button", {
  class: "small", "data-placed": photo, title: word("placing.tip"), disabled: !start.placeable,
  onclick: () => {
    byId("placement").close();
    openPlaced(photo);
  },
}, word("placing"));

/** @param {PlacedPhoto} one */
function line(one) {
  const kind = one.photo === state.current ? "on" : one.oriented ? "" : "loose";
  const figures = [
    number(one.shift?.[0], 1), number(one.shift?.[1], 1), number(one.turn, 1),
    number(one.scale, 3),
  ].map((figure) => element("td", {}, figure));
  const cells = one.oriented ? [...figures, element("td", { class: "rms" }, number(one.rms, 1))]
    : [element("td", { colspan: 5, class: "none" }, word("placement.none"))];
  const name = element("td", { class: "name", title: one.photo }, shortName(one.photo));
  return element("tr",
    { class: kind, "data-photo": one.photo, onclick: () => choose(one.photo) }, name, ...cells);
}

/** @param {string} name */
function choose(name) {
  state.current = name;
  if (state.found) showPlacement(state.found);
  byId("placement").querySelector("tr.on")?.scrollIntoView({ block: "nearest" });
}

/** The photo whose middle is nearest. @param {Pane} pane @param {Pair} screen */
function pick(pane, [x, y]) {
  const away = (/** @type {PlacedPhoto} */ one) => {
    const middle = middleOf(one.after ?? one.before ?? [[1e9, 1e9]]);
    const [px, py] = pane.screenFromLayer(layerFromGround(middle));
    return Math.hypot(px - x, py - y);
  };
  const nearest = [...state.found?.photos ?? []].sort((a, b) => away(a) - away(b))[0];
  if (nearest) choose(nearest.photo);
}

function draw() {
  const { found, mode, pane, view } = state;
  if (!found || !pane || !view.scale) return;
  const [context, width, height] = cleared(pane.picture);
  drawLayer(context, orthoLayer(false), view.frame([width, height]), [width, height]);
  context.fillStyle = "#0b0d1058";
  context.fillRect(0, 0, width, height);
  const [over] = cleared(pane.marks);
  const onScreen = (/** @type {Pair} */ ground) => pane.screenFromLayer(layerFromGround(ground));
  const last = (/** @type {PlacedPhoto} */ one) => Number(one.photo === state.current);
  for (const one of [...found.photos].sort((a, b) => last(a) - last(b))) {
    const strong = one.photo === state.current;
    const [before, after] = [one.before, one.after].map((ring) => ring?.map(onScreen));
    if (before && (mode !== "after" || !after)) outline(over, before, BEFORE, strong, true);
    if (after && mode !== "before") outline(over, after, AFTER, strong, false);
    if (before && after && mode === "both") arrow(over, middleOf(before), middleOf(after), strong);
    const at = middleOf((mode === "before" ? before : after ?? before) ?? [onScreen([0, 0])]);
    const colour = strong ? "#ffffff" : one.oriented ? AFTER : BEFORE;
    text(over, shortName(one.photo), [at[0] + 7, at[1] - 7], colour);
  }
  drawQueue(over, onScreen);
  scaleBar(over, [width, height], view.scale, start.ortho_pixel);
}

/** The points of the queue, and the area they lie in or that is being drawn.
 * @param {Context} context @param {(ground: Pair) => Pair} onScreen */
function drawQueue(context, onScreen) {
  const { area, places } = areaShown();
  if (!state.drawing && !area.length) return;
  for (const [x, y] of places.map(onScreen)) {
    halo(context, AREA, 2, () => context.rect(x - 1, y - 1, 2, 2));
  }
  const drawn = boxDrawn();
  const ring = drawn.length ? drawn.map(groundFromLayer) : state.drawing ? [] : area;
  if (ring.length) outline(context, ring.map(onScreen), AREA, false, true);
}

/**
 * @param {Context} context @param {Pair[]} ring on the screen @param {string} colour
 * @param {boolean} strong @param {boolean} given dashed; as placed it is drawn through, and filled
 */
function outline(context, ring, colour, strong, given) {
  context.setLineDash(given ? [7, 5] : []);
  const trace = () => {
    ring.forEach(([x, y]) => context.lineTo(x, y));
    context.closePath();
  };
  halo(context, colour, given ? (strong ? 2.4 : 1.1) : (strong ? 2.6 : 1.2), trace);
  context.setLineDash([]);
  if (given || !strong) return;
  context.fillStyle = `${colour}2c`;
  context.beginPath();
  trace();
  context.fill();
}

/** @param {Context} context @param {Pair} from @param {Pair} to @param {boolean} strong */
function arrow(context, [x1, y1], [x2, y2], strong) {
  const length = Math.hypot(x2 - x1, y2 - y1);
  if (length < 3) return;
  const [ux, uy] = [(x2 - x1) / length, (y2 - y1) / length];
  const barb = Math.min(9, length / 2);
  halo(context, strong ? "#ffffff" : "#d9dee6", strong ? 2.2 : 1.3, () => {
    context.moveTo(x1, y1);
    context.lineTo(x2, y2);
    context.moveTo(x2 - barb * (ux + 0.5 * uy), y2 - barb * (uy - 0.5 * ux));
    context.lineTo(x2, y2);
    context.lineTo(x2 - barb * (ux - 0.5 * uy), y2 - barb * (uy + 0.5 * ux));
  });
}

/**
 * Keys while the map is open; true when the key is ours.
 * @param {KeyboardEvent} event @param {string} letter
 */
export function placementKey(event, letter) {
  const down = event.type === "keydown";
  if (event.key === "Escape" || letter === "KeyG") {
    if (down && event.key === "Escape" && state.drawing) drawArea(false);
    else if (down) byId("placement").close();
    return true;
  }
  if (!state.found || !down) return event.key.length === 1;
  if (event.key === " ") {
    setMode(state.mode === "before" ? "after" : "before");
    return true;
  }
  if (event.key === "Enter") return takeAll();
  if (event.shiftKey && ARROWS[event.key]) return move(ARROWS[event.key]);
  const act = letter === "KeyF" && event.shiftKey ? () => drawArea(!state.drawing)
    : ACTS[letter] ?? ACTS[event.key];
  if (act) act();
  else if (ZOOMS[event.key]) zoom(ZOOMS[event.key]);
  return Boolean(act) || event.key.length === 1;
}

/** @type {Record<string, () => void>} */
const ACTS = {
  KeyJ: () => step(1), KeyK: () => step(-1), ArrowDown: () => step(1), ArrowUp: () => step(-1),
  KeyF: fit,
};

/** @param {number} by */
function step(by) {
  const photos = state.found?.photos ?? [];
  const at = photos.findIndex((one) => one.photo === state.current) + by;
  choose(photos[Math.min(Math.max(at, 0), photos.length - 1)]?.photo ?? "");
}

/** The map by a tenth of what it shows. @param {Pair} step right and down */
function move([right, down]) {
  const { view, pane } = state;
  const [width, height] = (pane?.size ?? [0, 0]).map((length) => length / 10 / view.scale);
  view.pan([right * width, down * height], [0, 0]);
  redraw();
  return true;
}

/** @param {number} factor */
function zoom(factor) {
  state.view.zoom(factor);
  redraw();
}

export function placementState() {
  const { found, current, mode, view } = state;
  return { found, current, mode, view };
}
