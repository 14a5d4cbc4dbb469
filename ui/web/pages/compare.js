// Ortho and scan side by side: same place, same scale, same north; linked pan, zoom and crosshair.
import { all, byId, number, numbers, shortName, start, turn, word } from "./words.js";
import { drawLikeness } from "./likeness.js";
import { drawEdges } from "./edges.js";
import { flicker } from "./flicker.js";
import {
  cleared, crosshair, draftedMark, expectedMark, halo, line, measuredMark, scaleBar, surveyedMark,
  text,
} from "./overlay.js";
import {
  drawLayer, fetchAhead, groundFromLayer, layerFromGround, onTile, orthoLayer, rawLayer, scanLayer,
} from "./tiles.js";
import { Pane, View, afterPause, inverse, mapped, oncePerFrame, scaleOf } from "./view.js";
import {
  drawEllipse, drawPatch, drawReadings, ellipseRadius, framed, inBoth, isPlaceable, rawFromGround,
} from "./expected.js";
import { drawPhotoPoints } from "./photo_points.js";
import { beside, drawTogether, showTools, worksTogether } from "./together.js";
import { ofOne } from "./queue.js";
import { finishBefore, send } from "./wire.js";

/** @typedef {"ortho" | "scan" | "swipe" | "blend"} Content */
/** @typedef {import("./expected.js").Place} Place */
/** @typedef {import("./expected.js").Nudged} Nudged */
/**
 * @typedef {"wallis" | "raw" | "likeness" | "marks" | "edges" | "flicker" | "together"
 *   | "adding"} Switch
 */

/** @type {("mode" | "share" | "contrast" | "wallis" | "raw" | "marks" | "edges")[]} */
const KEPT = ["mode", "share", "contrast", "wallis", "raw", "marks", "edges"];
const NEAR_PX = 40; // design: other peaks are shown where the pointer is, and hide nothing
const LEAST_ELLIPSE_PX = 10; // design: as large as the mark of a predicted place
const WIPE_PX = 8; // design: wide enough for a hand, narrow beside what is looked at
const state = {
  look: {
    // The line of the swipe lies beside the point.
    mode: "side", share: 0.4, contrast: 1, wallis: false, raw: false, marks: true, likeness: false,
    adding: false, blink: false, scale: 0, edges: false, flicker: false, together: false,
  },
  point: /** @type {Point | null} */ (null),
  view: new View(),
  panes: /** @type {Pane[]} */ ([]),
  pointer: /** @type {[Pane, Pair] | null} */ (null),
  /** Where the pointer was on the ground when the panes were drawn. */
  cursor: /** @type {Place | null} */ (null),
  /** True while the line between two pictures is dragged. */
  wiping: false,
  dragged: /** @type {Place | null} */ (null),
  /** Where the hand put the mark, until the desk is done with it. */
  nudged: /** @type {Nudged | null} */ (null),
  drawn: { key: /** @type {string | null} */ (null), whole: false, at: 0 },
};

export function setUpCompare() {
  // design: from the whole block at once to 400 pixels of the screen for one of the ortho.
  state.view = new View(0.01, 400 / Math.max(start.ortho_pixel, 0.01));
  state.panes = all(".pane", byId("panes")).map((room) => new Pane(room, state.view, HAND));
  const [swipe, contrast] = [byId("swipe"), byId("contrast")];
  const { look } = state;
  const follow = () => {
    [look.share, look.contrast] = [swipe.valueAsNumber / 100, contrast.valueAsNumber / 100];
    redraw();
  };
  swipe.addEventListener("input", follow);
  contrast.addEventListener("input", follow);
  contrast.addEventListener("dblclick", () => {
    contrast.value = "100";
    follow();
  });
  for (const button of all("button", byId("modes"))) {
    const mode = button.dataset.mode ?? "";
    button.textContent = word(`mode.${mode}`);
    button.title = word("mode.tip");
    button.addEventListener("click", () => setMode(mode));
  }
  swipe.title = word("swipe.tip");
  byId("contrast-label").title = word("contrast.tip");
  for (const type of ["pointerover", "pointerout", "focusin", "focusout"]) {
    byId("peaks").addEventListener(type, redraw);
  }
  byId("rate").title = word("rate.tip");
  onTile(redraw);
  remember();
  swipe.value = `${100 * look.share}`;
  contrast.value = `${100 * look.contrast}`;
  setMode(look.mode);
}

// How one likes to look stays through a reload.
function remember() {
  const { look, view } = state;
  try {
    Object.assign(look, JSON.parse(sessionStorage.getItem("gruber.look") ?? "{}"));
  } catch { /* Looks as at first. */ }
  window.addEventListener("pagehide", () => {
    const kept = Object.fromEntries(KEPT.map((name) => [name, look[name]]));
    sessionStorage.setItem("gruber.look", JSON.stringify({ ...kept, scale: view.scale }));
  });
}

/** @param {Point | null} fresh */
export function comparePoint(fresh) {
  const isOther = state.point?.key.join("|") !== fresh?.key.join("|");
  state.point = fresh;
  if (isOther) state.nudged = null;
  if (fresh && isOther) {
    const scale = state.view.scale || state.look.scale || defaultScale();
    showPoint(fresh, Math.min(scale, wholeEllipse(fresh)));
    lookAhead();
  }
  if (!fresh) for (const pane of state.panes) pane.await(true, "");
  redraw();
}

/** @param {Point} point @param {number} scale */
const showPoint = (point, scale) =>
  state.view.show(layerFromGround(point.marks.surveyed), scale);

// The current pictures come first.
const lookAhead = afterPause(() => {
  const { look, view, panes } = state;
  for (const [photo, version, east, north] of state.point?.ahead ?? []) {
    const there = new View().show(layerFromGround([east, north]), view.scale);
    for (const { size } of panes.filter((pane) => pane.size[0])) {
      fetchAhead(orthoLayer(look.wallis), there.frame(size), size);
      fetchAhead(scanLayer(photo, version, look.wallis), there.frame(size), size);
    }
  }
}, 200);

/** @param {number} factor */
export function zoomCompare(factor) {
  state.view.zoom(factor);
  redraw();
}

export function fitCompare() {
  if (!state.point) return;
  showPoint(state.point, Math.min(defaultScale(), wholeEllipse(state.point)));
  redraw();
}

/** @param {Switch} what */
export function switchCompare(what) {
  if (isTogether() && !worksTogether(what)) return;
  if (what === "raw") sendNudge.now();
  state.look[what] = !state.look[what];
  if (what === "together") state.look.adding = false;
  redraw();
}

const isTogether = () => state.look.together && state.point !== null;

/** @param {boolean} on */
export function blink(on) {
  if (state.look.blink === on || (on && isTogether())) return;
  state.look.blink = on;
  redraw();
}

export function compareState() {
  const { look, view, point, drawn } = state;
  const [east, north] = start.lattice ? groundFromLayer([view.x, view.y]) : [0, 0];
  return { ...look, view: { east, north, scale: view.scale }, point, drawn };
}

/**
 * A step is given in scan pixels, right and down on the picture that is shown.
 * @param {number} right @param {number} down
 */
export function nudge(right, down) {
  const { point, look, nudged } = state;
  if (!point || !isPlaceable(point)) return;
  const [isRaw, hand] = [look.raw && (look.mode === "side" || look.blink), inBoth(nudged, point)];
  const from = isRaw ? hand?.raw ?? point.draft?.raw ?? point.raw.measured
    : hand?.ground ?? point.draft?.place ?? point.marks.measured;
  const [unit, up] = isRaw ? [1, -1] : [point.scan.pixel, 1];
  const at = [from[0] + right * unit, from[1] - up * down * unit];
  state.nudged = { at, frame: isRaw ? "scan" : "ground" };
  sendNudge(point.key, state.nudged);
  redraw();
}

/** @param {Key} key @param {Nudged} nudged */
function sendNudged(key, nudged) {
  send({ kind: "place", key, frame: nudged.frame, place: nudged.at }, () => {
    if (state.nudged === nudged) state.nudged = null;
    redraw();
  });
}
const sendNudge = afterPause(sendNudged);

// A verdict is about the place the hand has nudged to, though it has not paused yet.
finishBefore(sendNudge.now);

/** @param {string} mode */
function setMode(mode) {
  sendNudge.now();
  state.look.mode = mode;
  byId("panes").dataset.mode = mode;
  byId("swipe").hidden = mode === "side";
  for (const button of all("button", byId("modes"))) {
    turn(button, button.dataset.mode === mode);
  }
  redraw();
}

// design: a pixel of the coarser picture is 2.2 of the screen.
const defaultScale = () => 2.2 / Math.max(start.ortho_pixel, state.point?.scan.pixel ?? 0);

/** What is to be measured is sought in the whole of its ellipse. @param {Point} point */
const wholeEllipse = (point) => (isPlaced(point) || !point.ellipse ? Infinity
  : (0.45 * Math.min(...state.panes.flatMap(({ size }) => size).filter(Boolean)))
    / ellipseRadius(point.ellipse) / point.scan.pixel);

/** A tiny ellipse would be a blot: there the usual mark stands. @param {Point} point */
const seesEllipse = ({ ellipse, scan }) => ellipse !== null
  && ellipseRadius(ellipse) * scan.pixel * state.view.scale > LEAST_ELLIPSE_PX;

/** True once there is a place to move or keep. @param {Point} point */
const isPlaced = ({ state: known, draft }) => known !== "predicted" || draft !== null;

const redraw = oncePerFrame(drawAll);

/** What a pane holds now: blinking exchanges the two. @param {Pane} pane @returns {Content} */
function contentOf(pane) {
  const { mode, blink: blinks } = state.look;
  if (mode === "side") return (pane.name === "left") !== blinks ? "ortho" : "scan";
  return blinks ? "scan" : /** @type {Content} */ (mode);
}

/** @param {Pane} pane */
const showsRaw = (pane) => state.look.raw && contentOf(pane) === "scan";

function drawAll() {
  const { look, point, panes } = state;
  const together = isTogether();
  showTools(look, together);
  flicker(look.flicker && !together, blink);
  byId("together").hidden = !together;
  byId("adding").hidden = !look.adding;
  byId("panes").classList.toggle("adding", look.adding);
  if (!point) return clear();
  state.cursor = state.pointer && placeAt(...state.pointer);
  let whole = true;
  for (const pane of panes) {
    if (pane.room.offsetParent === null) continue;
    whole = pane.await(drawPicture(pane, point), point.key.join("|")) && whole;
    drawMarks(pane, point);
  }
  if (look.together) whole = drawTogether(point, state.view.scale, look.wallis) && whole;
  const measured = (state.nudged?.at ?? point.draft?.place ?? point.marks.measured).join();
  const drawn = { key: point.key.join("|"), state: point.state, measured, whole };
  state.drawn = { ...drawn, at: performance.now() };
}

// No point, no pictures: what was there would be taken for the current one.
function clear() {
  for (const pane of state.panes) {
    cleared(pane.picture);
    cleared(pane.marks);
    pane.label.textContent = pane.where.textContent = "";
  }
  state.drawn = { key: null, whole: false, at: performance.now() };
}

/**
 * True when every tile was there, none stood in for by a coarser one.
 * @param {Pane} pane @param {Point} point
 */
function drawPicture(pane, point) {
  const { look, view } = state;
  const [context, width, height] = cleared(pane.picture);
  const size = [width, height];
  const [kind, photo, { version }] = [contentOf(pane), point.key[1], point.scan];
  const back = beside(point, view, look.wallis);
  const names = { ortho: back.name, scan: word("pane.scan", { scan: shortName(photo) }) };
  pane.picture.style.filter = look.contrast === 1 ? "" : `contrast(${look.contrast})`;
  let whole = true;
  if (showsRaw(pane)) {
    const layer = rawLayer(photo, version, point.scan.size, look.wallis);
    whole = drawLayer(context, layer, rawView(point).frame(size), size);
    pane.label.textContent = word("pane.raw", { scan: shortName(photo) });
    drawAlike(context, pane, point);
    return whole;
  }
  if (kind !== "scan") {
    whole = drawLayer(context, back.layer, back.view.frame(size), size);
  }
  if (kind !== "ortho") {
    context.save();
    if (kind === "swipe") {
      context.beginPath();
      context.rect(width * look.share, 0, width, height);
      context.clip();
    } else if (kind === "blend") context.globalAlpha = look.share;
    const layer = scanLayer(photo, version, look.wallis);
    whole = drawLayer(context, layer, view.frame(size), size) && whole;
    context.restore();
    drawAlike(context, pane, point);
  }
  pane.label.textContent = kind === "swipe" || kind === "blend" ? `${names.ortho} | ${names.scan}`
    : names[kind];
  return whole;
}

/** @param {Context} context @param {Pane} pane @param {Point} point */
function drawAlike(context, pane, point) {
  if (!state.look.likeness) return;
  const back = inverse(rawFromGround(point));
  drawLikeness(context, point, (raw) => onScreen(pane, point, mapped(back, raw), raw), redraw);
}

/** The raw scan is drawn with its own axes, about the same middle. @param {Point} point */
function rawView(point) {
  const { view } = state;
  const matrix = rawFromGround(point);
  const middle = mapped(matrix, groundFromLayer([view.x, view.y]));
  return new View().show(middle, view.scale / scaleOf(matrix));
}

/**
 * @param {Pane} pane @param {Point} point @param {Pair} ground
 * @param {Pair | null} raw where it is known better than through the map about the point
 */
function onScreen(pane, point, ground, raw = null) {
  if (!showsRaw(pane)) return pane.screenFromLayer(layerFromGround(ground));
  return rawView(point).screenFromLayer(raw ?? mapped(rawFromGround(point), ground), pane.size);
}

/** @param {Pane} pane @param {Pair} screen @returns {Place} */
function placeAt(pane, screen) {
  const { point } = state;
  const raw = point && showsRaw(pane) ? rawView(point).layerFromScreen(screen, pane.size) : null;
  return { ground: groundFromLayer(pane.layerFromScreen(screen)), raw };
}

/** @param {Pane} pane @param {Point} point */
const measuredOn = (pane, point) =>
  onScreen(pane, point, point.marks.measured, point.raw.measured);

/**
 * Where a draft is on the screen, the hand ahead of the desk's answer; null without one.
 * @param {Pane} pane @param {Point} point
 */
function draftOn(pane, point) {
  const hand = state.dragged ?? inBoth(state.nudged, point);
  if (hand) return onScreen(pane, point, hand.ground, hand.raw);
  return point.draft && onScreen(pane, point, point.draft.place, point.draft.raw);
}

/** @param {Pane} pane @param {Point} point */
function drawMarks(pane, point) {
  const { look, cursor } = state;
  const kind = contentOf(pane);
  const [context, width, height] = cleared(pane.marks);
  const edge = width * look.share;
  if (kind === "swipe") {
    line(context, [edge, 0], [edge, height], "#ffffffa0", 1);
    halo(context, "#ffffff", 2, () => context.roundRect(edge - 3, height / 2 - 14, 6, 28, 3));
  }
  if (look.edges && kind !== "ortho") {
    const { x, y, scale } = state.view;
    const metres = [width / scale, height / scale].map((length) => (look.raw ? 1.5 : 1) * length);
    drawEdges(context, groundFromLayer([x, y]), metres, point.scan.pixel,
      (at) => onScreen(pane, point, at));
  }
  const place = (/** @type {Pair} */ at, /** @type {Pair | null} */ raw) =>
    onScreen(pane, point, at, raw);
  if (kind !== "ortho") drawPhotoPoints(context, pane.room, point, { place, cursor, redraw });
  if (look.marks) {
    if (isPlaced(point)) drawPatch(context, point, kind === "scan", place);
    if (kind !== "ortho") {
      if (seesEllipse(point)) drawEllipse(context, point, place);
      drawReadings(context, point, place);
    }
    if (kind !== "scan") surveyedMark(context, onScreen(pane, point, point.marks.surveyed), point);
    if (kind !== "ortho") scanMarks(context, pane, point);
  }
  if (cursor) crosshair(context, onScreen(pane, point, cursor.ground), width, height);
  const pixel = kind === "ortho" ? start.ortho_pixel : point.scan.pixel;
  scaleBar(context, [width, height], state.view.scale, pixel);
  pane.where.textContent = cursor ? describe(pane, point, cursor) : "";
}

/** @param {Context} context @param {Pane} pane @param {Point} point */
function scanMarks(context, pane, point) {
  const [{ marks, raw, peaks }, { palette }] = [point, start];
  marks.peaks.forEach((place, index) => {
    if (peaks[index].away < 0.05) return;
    const [x, y] = onScreen(pane, point, place, raw.peaks[index]);
    if (!meant(pane, point, [x, y])) return;
    halo(context, palette.peak, 1.3, () => context.rect(x - 5, y - 5, 10, 10));
    text(context, `${index + 1}`, [x + 8, y - 7], palette.peak);
  });
  const draft = draftOn(pane, point);
  const from = draft ?? measuredOn(pane, point);
  const to = onScreen(pane, point, marks.predicted, raw.predicted);
  const far = Math.hypot(to[0] - from[0], to[1] - from[1]) > 10;
  if (far) line(context, from, to, palette.predicted, 1.2);
  expectedMark(context, to, palette.predicted, seesEllipse(point) ? 2 : 9);
  if (point.state !== "predicted") {
    measuredMark(context, measuredOn(pane, point), palette.states[point.state].colour);
  }
  if (draft) draftedMark(context, draft);
}

/**
 * True where the pointer is near, or in the list of peaks.
 * @param {Pane} pane @param {Point} point @param {Pair} place on the screen
 */
function meant(pane, point, [x, y]) {
  if (byId("peaks").matches(":hover, :focus-within")) return true;
  const at = state.cursor && onScreen(pane, point, state.cursor.ground, state.cursor.raw);
  return at !== null && Math.hypot(at[0] - x, at[1] - y) < NEAR_PX;
}

/** @param {Pane} pane @param {Point} point @param {Place} cursor */
function describe(pane, point, { ground, raw }) {
  if (!showsRaw(pane)) return ground.map((value) => number(value, 2)).join("  ");
  const pixel = raw ?? mapped(rawFromGround(point), ground);
  return `${numbers(pixel, 1)} px`;
}

/** @param {Place} place */
const putMark = (place) => ofOne(() => {
  if (!state.point || !isPlaceable(state.point)) return;
  // The draft stands there at once; the desk's answer puts it where it is kept.
  state.nudged = framed(place);
  redraw();
  sendNudged(state.point.key, state.nudged);
})();

/** In the ortho, in a blend too; or a detail of a scan. @param {Pane} pane @param {Pair} screen */
function addPoint(pane, screen) {
  const place = placeAt(pane, screen);
  switchCompare("adding");
  const inOrtho = !takesPlace(pane, screen) || contentOf(pane) === "blend";
  if (inOrtho) send({ kind: "add", place: place.ground });
  else if (state.point) sendNudged(["", state.point.key[1]], framed(place));
}

/** @param {Pane} pane @param {Pair} screen */
function takesPlace(pane, [x]) {
  const kind = contentOf(pane);
  return kind === "scan" || kind === "blend"
    || (kind === "swipe" && x > pane.size[0] * state.look.share);
}

/** @type {import("./view.js").Hand} */
const HAND = {
  redraw,
  ready: () => state.point !== null,
  layerFromScreen: (pane, screen) => {
    const { point, view } = state;
    if (!point || !showsRaw(pane)) return view.layerFromScreen(screen, pane.size);
    const raw = rawView(point).layerFromScreen(screen, pane.size);
    return layerFromGround(mapped(inverse(rawFromGround(point)), raw));
  },
  grips: (pane, [x, y]) => {
    const { look, point } = state;
    state.wiping = onWipe(pane, x);
    if (state.wiping) return true;
    if (!point || !look.marks || look.adding || !takesPlace(pane, [x, y])) return false;
    if (!isPlaced(point)) return false;
    const mark = draftOn(pane, point) ?? measuredOn(pane, point);
    return Math.hypot(mark[0] - x, mark[1] - y) < 8;
  },
  drag: (pane, screen) => {
    if (state.wiping && screen) return wipe(screen[0] / pane.size[0]);
    state.wiping = false;
    state.dragged = screen && placeAt(pane, screen);
  },
  drop: () => state.dragged && putMark(state.dragged),
  click: (pane, screen) => {
    if (state.look.adding) addPoint(pane, screen);
    else if (takesPlace(pane, screen)) putMark(placeAt(pane, screen));
  },
  // A mark is often wrong by less than it can be gripped at.
  tap: (pane, screen) => state.wiping || putMark(placeAt(pane, screen)),
  point: (pane, screen) => {
    state.pointer = screen && [pane, screen];
    const wipes = state.wiping || (screen !== null && onWipe(pane, screen[0]));
    pane.room.classList.toggle("wipes", wipes);
    redraw();
  },
};

/** True on the line between the two pictures. @param {Pane} pane @param {number} x */
const onWipe = (pane, x) => contentOf(pane) === "swipe"
  && Math.abs(x - pane.size[0] * state.look.share) < WIPE_PX;

/** @param {number} share */
function wipe(share) {
  state.look.share = Math.min(Math.max(share, 0), 1);
  byId("swipe").value = `${100 * state.look.share}`;
  redraw();
}

