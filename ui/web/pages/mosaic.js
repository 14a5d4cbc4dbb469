// The mosaic beside and over the ortho of today: linked, swiped, blended, blinked or subtracted.
import { undoOrRedo } from "./asked.js";
import {
  drawEdit, dragCorner, dropCorner, editKey, editState, gripCorner, isEditing, putCorner, setUpEdit,
  tapCorner,
} from "./mosaic_edit.js";
import { chooseFault, drawFaults, showThread } from "./faults.js";
import {
  CHOSEN, drawBorders, drawHoles, drawMisfits, drawSeams, photoAt,
} from "./mosaic_marks.js";
import { drawSheets, sheetKey, sheetState, wantedBounds } from "./mosaic_sheets.js";
import { mosaicSide } from "./mosaic_side.js";
import { comparedYear, yearSlider } from "./mosaic_years.js";
import { cleared, crosshair, halo, line, scaleBar } from "./overlay.js";
import {
  drawLayer, groundFromLayer, layerFromGround, mosaicLayer, onTile, orthoLayer,
} from "./tiles.js";
import { ARROWS, Pane, View, ZOOMS, oncePerFrame } from "./view.js";
import { all, byId, element, first, number, renew, shortName, start, turn, word } from "./words.js";
import { send } from "./wire.js";

/** @typedef {"ortho" | "mosaic" | "swipe" | "blend" | "difference"} Content */
/** @typedef {"seams" | "borders" | "wallis"} Switch */

const MODES = ["side", "swipe", "blend", "difference"];
const SWITCHES = /** @type {[Switch, string][]} */ (
  [["seams", "S"], ["borders", "B"], ["wallis", "W"]]);
const WIPE_PX = 8; // design: wide enough for a hand, narrow beside what is looked at
const STEP_PX = 12; // design: an arrow moves the crosshair by this, with Shift by one
const state = {
  found: /** @type {Mosaic | null} */ (null),
  picked: /** @type {PickedPlace | null} */ (null),
  status: /** @type {Status | null} */ (null),
  /** The mosaic before the one that is shown: seen while the new one is drawn. */
  before: /** @type {Mosaic | null} */ (null),
  /** A place to go to once the mosaic is told. */
  wanted: /** @type {Pair | null} */ (null),
  /** True from opening the sheet until its picture took the keys. */
  opened: false,
  /** Questions are numbered, also those of a page that was loaded anew. */
  number: Date.now(),
  look: { mode: "side", share: 0.5, seams: true, borders: false, wallis: false, blink: false },
  view: new View(),
  panes: /** @type {Pane[]} */ ([]),
  cursor: /** @type {Pair | null} */ (null),
  wiping: false,
  over: /** @type {HTMLCanvasElement | null} */ (null),
  drawn: { whole: false },
};
const redraw = oncePerFrame(draw);

/** @type {import("./view.js").Hand} */
const HAND = {
  redraw,
  ready: () => Boolean(state.found?.version),
  point: (pane, screen) => {
    state.cursor = screen && pane.layerFromScreen(screen);
    const wipes = state.wiping || (screen !== null && onWipe(pane, screen[0]));
    pane.room.classList.toggle("wipes", wipes);
    redraw();
  },
  grips: (pane, [x, y]) => {
    state.wiping = onWipe(pane, x);
    return state.wiping || gripCorner([x, y], (ground) => onPane(pane, ground));
  },
  drag: (pane, screen) => {
    if (!screen) {
      state.wiping = false;
      dropCorner();
    } else if (state.wiping) setShare(screen[0] / pane.size[0]);
    else dragCorner(groundFromLayer(pane.layerFromScreen(screen)));
  },
  tap: () => state.wiping || tapCorner(),
  click: (pane, screen) => {
    const place = pane.layerFromScreen(screen);
    const onScreen = (/** @type {Pair} */ ground) => onPane(pane, ground);
    if (isEditing()) return putCorner(groundFromLayer(place), onScreen);
    const fault = state.found
      && chooseFault(state.found, onScreen, screen);
    if (!fault) return pick(place);
    pick(layerFromGround(fault.place));
    refresh();
    showThread();
  },
};

/** @param {Pane} pane @param {Pair} ground */
const onPane = (pane, ground) => pane.screenFromLayer(layerFromGround(ground));

/** The pane that shows the mosaic. */
const shownPane = () => state.panes[state.panes[1].room.offsetParent ? 1 : 0];

const placeName = () => `gruber.mosaic.${start.name}`;

export function setUpMosaic() {
  // design: from any block at once to 20 pixels of the screen for one of the ortho.
  state.view = new View(0.001, 20 / Math.max(start.ortho_pixel, 0.01));
  try {
    const { look, view } = JSON.parse(sessionStorage.getItem(placeName()) ?? "{}");
    Object.assign(state.look, look);
    if (view) state.view.show(layerFromGround(view.slice(0, 2)), view[2]);
  } catch { /* Looks as at first. */ }
  window.addEventListener("pagehide", () => {
    const { look, view: { x, y, scale, filled } } = state;
    // The whole block is looked at whole in another window, too.
    const view = scale && !filled ? [...groundFromLayer([x, y]), scale] : null;
    const kept = { look: { ...look, blink: false }, view };
    sessionStorage.setItem(placeName(), JSON.stringify(kept));
  });
  onTile(redraw);
  setUpEdit(refresh);
  byId("mosaic").addEventListener("close", () => {
    blink(false);
    send({ kind: "sheet", sheet: "mosaic", shown: false });
  });
}

/** @param {Pair} [place] on the ground that is asked about */
export function openMosaic(place) {
  const sheet = byId("mosaic");
  if (sheet.open) return sheet.close();
  if (!sheet.querySelector("#mosaic-panes")) build();
  sheet.showModal();
  Object.assign(state, { wanted: place ?? null, opened: true });
  send({ kind: "sheet", sheet: "mosaic", shown: true });
  if (state.found) showMosaic(state.found);
  return undefined;
}

/** A sheet gives way to the mosaic. @param {"results" | "quality"} sheet */
export const mosaicButton = (sheet) => element("button", {
  "data-open": "mosaic", title: word("mosaic.tip"),
  onclick: () => {
    byId(sheet).close();
    openMosaic();
  },
}, word("mosaic"));

/** @param {string} name */
const room = (name) => element("div", { class: "pane", "data-pane": name, tabindex: "0",
  role: "application", "aria-label": word(`mosaic.pane.${name}`) },
element("canvas", { class: "picture" }), element("canvas", { class: "marks" }),
element("span", { class: "label" }), element("span", { class: "where" }));

function build() {
  const rooms = ["left", "right"].map(room);
  const panes = element("div", { id: "mosaic-panes" }, ...rooms);
  const none = element("p", { id: "mosaic-none", hidden: true }, word("mosaic.none"), " ",
    element("button", { onclick: remake, disabled: start.guest }, word("mosaic.make")));
  const side = element("aside", { tabindex: "0", "aria-label": word("mosaic.about"),
    "aria-busy": "true" });
  first(".view-body", byId("mosaic")).replaceChildren(head(), none,
    element("div", { class: "two-rooms" }, panes, side));
  state.panes = rooms.map((one) => new Pane(one, state.view, HAND));
  setMode(state.look.mode);
}

function head() {
  const modes = MODES.map((mode, index) => element("button", {
    "data-mode": mode, title: word(`mosaic.${mode}.tip`), onclick: () => setMode(mode),
  }, word(mode === "difference" ? "mosaic.difference" : `mode.${mode}`),
  element("kbd", {}, `${index + 1}`)));
  const share = element("input", { type: "range", id: "mosaic-share", min: 0, max: 100, step: 1,
    "aria-label": word("mosaic.share"), title: word("mosaic.share") });
  share.addEventListener("input", () => setShare(byId("mosaic-share").valueAsNumber / 100));
  const switches = SWITCHES.map(([name, key]) => element("button", {
    "data-look": name, title: word(`mosaic.${name}.tip`), onclick: () => toggle(name),
  }, word(`mosaic.${name}`), element("kbd", {}, key)));
  const swap = element("button", { id: "mosaic-blink", title: word("blink.tip"),
    onclick: (/** @type {MouseEvent} */ { detail }) => {
      // A key cannot hold a button down: it turns the pictures over, and back.
      if (!detail) blink(!state.look.blink);
    } }, word("blink"));
  swap.addEventListener("pointerdown", () => blink(true));
  for (const type of ["pointerup", "pointerleave"]) swap.addEventListener(type, () => blink(false));
  return element("header", {}, element("h2", {}, word("mosaic")),
    element("span", { class: "segments", role: "group", "aria-label": word("mode.tip") }, ...modes),
    ...yearSlider(redraw), share, element("span", { class: "segments" }, ...switches), swap,
    element("span", { class: "stretch" }),
    element("button", { onclick: () => fit() }, word("act.fit"), element("kbd", {}, "F")),
    element("button", { id: "mosaic-close", onclick: () => byId("mosaic").close() },
      word("act.close")));
}

/** @param {string} mode */
function setMode(mode) {
  state.look.mode = MODES.includes(mode) ? mode : "side";
  const sheet = byId("mosaic");
  byId("mosaic-panes").dataset.mode = state.look.mode;
  for (const button of all("[data-mode]", first("header", sheet))) {
    turn(button, button.dataset.mode === state.look.mode);
  }
  byId("mosaic-share").hidden = mode !== "swipe" && mode !== "blend";
  setShare(state.look.share);
  showSwitches();
}

function showSwitches() {
  for (const [name] of SWITCHES) {
    turn(first(`[data-look=${name}]`, byId("mosaic")), state.look[name]);
  }
  redraw();
}

/** @param {Switch} name */
function toggle(name) {
  state.look[name] = !state.look[name];
  showSwitches();
}

/** @param {number} share */
function setShare(share) {
  state.look.share = Math.min(Math.max(share, 0), 1);
  byId("mosaic-share").value = `${100 * state.look.share}`;
  redraw();
}

/** @param {boolean} on */
function blink(on) {
  state.look.blink = on;
  redraw();
}

const remake = () => send({ kind: "remake" });

/** @param {Mosaic} found */
export function showMosaic(found) {
  const fresh = state.found?.version !== found.version;
  const { found: known } = state;
  if (known?.version && (fresh || known.edition !== found.edition)) state.before = known;
  state.found = found;
  if (!byId("mosaic").open) return;
  first("aside", byId("mosaic")).removeAttribute("aria-busy");
  byId("mosaic-none").hidden = found.version > 0;
  first(".two-rooms", byId("mosaic")).hidden = !found.version;
  if (found.version && !state.view.scale) fit();
  const { opened, wanted } = state;
  // The picture takes the keys, so that Space blinks and no button is pressed.
  if (found.version && opened) state.panes[1].room.focus({ preventScroll: true });
  if (found.version && wanted) ask(wanted);
  const bounds = wantedBounds(found);
  if (found.version && bounds) fit(bounds);
  Object.assign(state, { wanted: null, opened: opened && !found.version });
  refresh();
}

/** What the making of orthos comes to is told beside the mosaic, too. @param {Status} status */
export function tellMosaic(status) {
  state.status = status;
  if (byId("mosaic").open) refresh();
}

/** @param {PickedPlace} told */
export function showPicked(told) {
  if (told.number !== state.number) return;
  state.picked = told;
  refresh();
}

function refresh() {
  const { found, picked, status } = state;
  if (!found?.version) return;
  const acts = { goTo, remake, leave, ask, refresh, frame: fit };
  renew(first("aside", byId("mosaic")), ...mosaicSide(found, picked, status, acts));
  redraw();
}

/** The desk behind, with what one goes there for in sight. @param {string} part */
function leave(part) {
  byId("mosaic").close();
  const { grown } = byId("desk").dataset;
  if (grown && grown !== part) first(`[data-grow=${grown}]`).click();
}

/** @param {Pair} ground */
function goTo(ground) {
  state.view.show(layerFromGround(ground), Math.max(state.view.scale, 1));
  redraw();
}

/** @param {Pair} ground @param {string} photo that which is shown there when empty */
function ask(ground, photo = "") {
  goTo(ground);
  pick(layerFromGround(ground), photo);
}

/** @param {number[]} bounds west, south, east, north; the whole mosaic where left out */
function fit(bounds = state.found?.bounds ?? []) {
  const [west, south, east, north] = bounds;
  const pane = state.panes.find(({ room: { offsetParent } }) => offsetParent) ?? state.panes[0];
  const [width, height] = pane.size;
  state.view.fit(layerFromGround([west, north]), layerFromGround([east, south]),
    [width || 700, height || 700], 0.94);
  redraw();
}

/** @param {Pair} place on the layer @param {string} photo */
function pick(place, photo = "") {
  const ground = groundFromLayer(place);
  state.number += 1;
  state.cursor = place;
  send({ kind: "pick", number: state.number, place: ground, photo });
}

/** @param {Pane} pane @returns {Content} */
function contentOf(pane) {
  const { mode, blink: blinks } = state.look;
  if (mode === "side") return (pane.name === "left") !== blinks ? "ortho" : "mosaic";
  return blinks ? "ortho" : /** @type {Content} */ (mode);
}

/** True on the line between the two pictures. @param {Pane} pane @param {number} x */
const onWipe = (pane, x) => contentOf(pane) === "swipe"
  && Math.abs(x - pane.size[0] * state.look.share) < WIPE_PX;

function draw() {
  const { found, view } = state;
  if (!found?.version || !byId("mosaic").open || !view.scale) return;
  state.drawn = { whole: true };
  for (const pane of state.panes) {
    if (pane.room.offsetParent === null) continue;
    const whole = drawPicture(pane, found);
    state.drawn.whole &&= whole;
    drawMarks(pane, found);
  }
}

/**
 * True when every tile was there.
 * @param {Pane} pane @param {Mosaic} found
 */
function drawPicture(pane, found) {
  const { look, view, before } = state;
  const [context, width, height] = cleared(pane.picture);
  const size = [width, height];
  const kind = contentOf(pane);
  const [year, ortho] = comparedYear();
  pane.label.textContent = kind === "ortho" ? ortho : kind === "mosaic" ? word("mosaic")
    : `${ortho} | ${word("mosaic")}`;
  // Grays of two times are not comparable before they are evened out.
  const even = look.wallis || kind === "difference";
  const [below, above] = [orthoLayer(even, year), mosaicLayer(found, even, before)];
  const frame = view.frame(size);
  if (kind === "difference") return drawDifference(context, [below, above], frame, size);
  const whole = kind === "mosaic" || drawLayer(context, below, frame, size);
  if (kind === "ortho") return whole;
  context.save();
  if (kind === "swipe") {
    context.beginPath();
    context.rect(width * look.share, 0, width, height);
    context.clip();
    // Where the mosaic shows nothing, its side of the line does not either.
    context.clearRect(0, 0, width, height);
  } else if (kind === "blend") context.globalAlpha = look.share;
  const both = drawLayer(context, above, frame, size) && whole;
  context.restore();
  return both;
}

/**
 * Gray of one less gray of the other, where the mosaic shows anything.
 * @param {Context} context @param {import("./tiles.js").Layer[]} layers
 * @param {{ x: number, y: number, scale: number }} frame @param {Pair} size
 */
function drawDifference(context, [below, above], frame, size) {
  const { width, height } = context.canvas;
  state.over ??= document.createElement("canvas");
  Object.assign(state.over, { width, height });
  const inner = /** @type {Context} */ (state.over.getContext("2d"));
  inner.setTransform(context.getTransform());
  const whole = drawLayer(inner, above, frame, size);
  const both = drawLayer(context, below, frame, size) && whole;
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalCompositeOperation = "saturation";
  context.fillStyle = "#808080";
  context.fillRect(0, 0, width, height);
  for (const how of /** @type {const} */ (["difference", "destination-in"])) {
    context.globalCompositeOperation = how;
    context.drawImage(state.over, 0, 0);
  }
  context.restore();
  return both;
}

/** @param {Pane} pane @param {Mosaic} found */
function drawMarks(pane, found) {
  const { look, cursor, picked, view } = state;
  const [context, width, height] = cleared(pane.marks);
  if (contentOf(pane) === "swipe") {
    const edge = width * look.share;
    line(context, [edge, 0], [edge, height], "#ffffffa0", 1);
    halo(context, "#ffffff", 2, () => context.roundRect(edge - 3, height / 2 - 14, 6, 28, 3));
  }
  const onScreen = (/** @type {Pair} */ ground) => onPane(pane, ground);
  const chosen = picked?.photo ?? "";
  if (look.borders) drawBorders(context, found, onScreen, chosen);
  const named = look.seams ? drawSeams(context, found, onScreen, chosen) : [];
  drawSheets(context, found, onScreen);
  drawHoles(context, found, onScreen, view.scale);
  drawMisfits(context, found, onScreen, named, picked);
  drawFaults(context, found, onScreen);
  if (picked) {
    const [east, north] = picked.place;
    const [x, y] = onScreen([east, north]);
    halo(context, CHOSEN, 1.6, () => context.arc(x, y, 8, 0, 7));
  }
  drawEdit(context, onScreen, cursor && groundFromLayer(cursor));
  if (cursor) crosshair(context, pane.screenFromLayer(cursor), width, height);
  scaleBar(context, [width, height], view.scale, found.pixel ?? 1);
  pane.where.textContent = cursor ? describe(found, groundFromLayer(cursor)) : "";
}

/** Place, and whose part it is. @param {Mosaic} found @param {Pair} ground */
function describe({ seams = [] }, ground) {
  const photo = photoAt(seams, ground);
  const place = ground.map((value) => number(value, 1)).join("  ");
  return photo ? `${place}  \u00b7  ${shortName(photo)}` : place;
}

/**
 * The crosshair by arrows; at the edge the picture follows.
 * @param {Pair} way @param {number} px of the screen
 */
function move([right, down], px) {
  const { view, cursor } = state;
  const [x, y] = cursor ?? [view.x, view.y];
  state.cursor = [x + (right * px) / view.scale, y + (down * px) / view.scale];
  const [width, height] = shownPane().size;
  const [left, top] = view.screenFromLayer(state.cursor, [width, height]);
  const out = left < 0 || top < 0 || left > width || top > height;
  if (out) view.show([view.x + (right * px) / view.scale, view.y + (down * px) / view.scale],
    view.scale);
  redraw();
}

/** @type {Record<string, () => void>} */
const ACTS = {
  KeyF: () => fit(), Enter: () => pick(state.cursor ?? [state.view.x, state.view.y]),
  ...Object.fromEntries(MODES.map((mode, index) => [`Digit${index + 1}`, () => setMode(mode)])),
  ...Object.fromEntries(SWITCHES.map(([name, key]) => [`Key${key}`, () => toggle(name)])),
};

/**
 * Keys while the mosaic is open; true when the key is ours.
 * @param {KeyboardEvent} event @param {string} letter
 */
export function mosaicKey(event, letter) {
  const down = event.type === "keydown";
  const plain = ["Escape", "Backspace", "Delete"].includes(event.key);
  const name = event.key === " " ? "Space" : plain ? event.key : letter;
  const { cursor, view } = state;
  const onScreen = (/** @type {Pair} */ ground) => onPane(shownPane(), ground);
  if (down && !event.repeat && state.found?.version
    && editKey(name, groundFromLayer(cursor ?? [view.x, view.y]), onScreen)) return true;
  if (event.key === "Escape" || (letter === "KeyO" && event.shiftKey)) {
    if (down) byId("mosaic").close();
    return true;
  }
  if (!state.found?.version) return event.key.length === 1;
  if (event.key === " ") {
    if (!isEditing()) blink(down);
    return true;
  }
  const arrow = ARROWS[event.key];
  // A slider that has the keys moves by them.
  if (arrow && byId("mosaic-year") === document.activeElement) return false;
  if (arrow) {
    if (down) move(arrow, event.shiftKey ? 1 : STEP_PX);
    return true;
  }
  if (!down) return event.key.length === 1;
  if (ZOOMS[event.key]) {
    state.view.zoom(ZOOMS[event.key], state.cursor ?? undefined);
    redraw();
    return true;
  }
  if (!event.repeat && sheetKey(letter)) return true;
  const acts = ACTS[letter];
  if (acts && !event.repeat) acts();
  if (letter === "KeyU" && !event.repeat) undoOrRedo(event);
  return Boolean(acts) || event.key.length === 1;
}

export const mosaicState = () => {
  const { found, picked, look, view, cursor, drawn, panes } = state;
  const [pane] = panes.slice(look.mode === "side" ? 1 : 0);
  const toScreen = (/** @type {Pair} */ ground) => pane.screenFromLayer(layerFromGround(ground));
  const told = { edit: editState(), sheet: sheetState() };
  return { found, picked, look, view, cursor, drawn, toScreen, ...told };
};
