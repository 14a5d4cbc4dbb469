// Ortho and scan side by side: same place, same scale, same north; linked pan, zoom and crosshair.
import { byId, number, shortName, start, word } from "/pages/words.js";
import { drawVeil, onVeil } from "/pages/veil.js";
import { canvas, crosshair, halo, line, measuredMark, text } from "/pages/marks.js";
import { drawLayer, fetchAhead, onTile, orthoLayer, rawLayer, scanLayer } from "/pages/tiles.js";
import { listen } from "/pages/pointing.js";

const KEPT = ["mode", "share", "contrast", "wallis", "raw", "marks"];
const state = { mode: "side", share: 0.5, contrast: 1, wallis: false, raw: false, marks: true, likeness: false, adding: false, blink: false, scale: 0 };
let point = null;
let view = null; // {east, north: middle; scale: css pixels per metre}
let cursor = null; // {east, north, raw}
let send = () => {};
let nudged = null;
let dragged = null;
let asked = false;
let drawn = { key: null, whole: false, at: 0 };
const panes = {};

export function setUpCompare(sender) {
  send = sender;
  for (const name of ["left", "right"]) {
    const room = document.querySelector(`.pane[data-pane=${name}]`);
    panes[name] = { name, room, picture: room.querySelector(".picture"), marks: room.querySelector(".marks"), label: room.querySelector(".label"), where: room.querySelector(".where") };
    listen(panes[name], HAND);
    new ResizeObserver(redraw).observe(room);
  }
  byId("swipe").addEventListener("input", (event) => { state.share = event.target.value / 100; redraw(); });
  byId("contrast").addEventListener("input", (event) => { state.contrast = event.target.value / 100; redraw(); });
  byId("contrast").addEventListener("dblclick", (event) => { event.target.value = 100; state.contrast = 1; redraw(); });
  for (const button of byId("modes").children) {
    button.textContent = word(`mode.${button.dataset.mode}`);
    button.title = word("mode.tip");
    button.addEventListener("click", () => setMode(button.dataset.mode));
  }
  byId("swipe").title = word("swipe.tip");
  byId("contrast-label").title = word("contrast.tip");
  onTile(redraw);
  onVeil(redraw);
  remember();
  byId("swipe").value = 100 * state.share;
  byId("contrast").value = 100 * state.contrast;
  setMode(state.mode);
}

// How one likes to look stays through a reload.
function remember() {
  try { Object.assign(state, JSON.parse(sessionStorage.getItem("gruber.look"))); } catch { /* Looks as at first. */ }
  window.addEventListener("pagehide", () => {
    const kept = Object.fromEntries(KEPT.map((name) => [name, state[name]]));
    sessionStorage.setItem("gruber.look", JSON.stringify({ ...kept, scale: view?.scale ?? 0 }));
  });
}

export function comparePoint(fresh) {
  const before = point?.key.join("|");
  point = fresh;
  nudged = null;
  if (!point) return redraw();
  if (before !== point.key.join("|")) {
    const scale = view?.scale ?? (state.scale || defaultScale());
    view = { east: point.marks.surveyed[0], north: point.marks.surveyed[1], scale };
    clearTimeout(comparePoint.later);
    comparePoint.later = setTimeout(lookAhead, 200);
  }
  redraw();
}

function lookAhead() {
  for (const [photo, version, east, north] of point?.ahead ?? []) {
    for (const { room } of Object.values(panes)) {
      const [width, height] = [room.clientWidth, room.clientHeight];
      if (!width) continue;
      const frame = groundFrame(width, height, { east, north });
      for (const layer of [orthoLayer(state.wallis), scanLayer(photo, version, state.wallis)]) fetchAhead(layer, frame, width, height);
    }
  }
}

export function zoomCompare(factor) {
  if (!view) return;
  view.scale = bounded(view.scale * factor);
  redraw();
}

export function fitCompare() {
  if (!point) return;
  view = { east: point.marks.surveyed[0], north: point.marks.surveyed[1], scale: defaultScale() };
  redraw();
}

export function switchCompare(what) {
  state[what] = !state[what];
  redraw();
}

export function blink(on) {
  if (state.blink !== on) { state.blink = on; redraw(); }
}

export const compareState = () => ({ ...state, view, point, drawn });

// A step is given in scan pixels, right and down on the picture that is shown.
export function nudge(right, down) {
  if (!point) return;
  if (state.raw) {
    const from = nudged ?? point.raw.measured;
    nudged = [from[0] + right, from[1] + down];
  } else {
    const from = nudged ?? point.marks.measured;
    nudged = [from[0] + right * point.scan.pixel, from[1] - down * point.scan.pixel];
  }
  clearTimeout(nudge.later);
  const target = { key: point.key, place: nudged, frame: state.raw ? "scan" : "ground" };
  nudge.later = setTimeout(() => send({ kind: "place", ...target }), 400);
  redraw();
}

function setMode(mode) {
  state.mode = mode;
  byId("panes").dataset.mode = mode;
  byId("swipe").hidden = mode === "side";
  for (const button of byId("modes").children) button.classList.toggle("on", button.dataset.mode === mode);
  redraw();
}

const bounded = (scale) => Math.min(Math.max(scale, 0.01), 400 / Math.max(start.ortho_pixel, 0.01));
const defaultScale = () => 2.2 / Math.max(start.ortho_pixel, point?.scan.pixel ?? 0);

function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; drawAll(); });
}

// What each pane holds now: blinking exchanges the two.
function content(name) {
  if (state.mode === "side") return (name === "left") !== state.blink ? "ortho" : "scan";
  if (state.blink) return "scan";
  return state.mode;
}

const showsRaw = (kind) => state.raw && kind === "scan";

function drawAll() {
  for (const button of document.querySelectorAll("[data-act=wallis],[data-act=raw],[data-act=likeness],[data-act=marks],[data-act=add]")) {
    const name = button.dataset.act === "add" ? "adding" : button.dataset.act;
    button.classList.toggle("on", state[name]);
  }
  byId("adding").hidden = !state.adding;
  byId("panes").classList.toggle("adding", state.adding);
  if (!point || !view) return clear();
  let whole = true;
  for (const pane of Object.values(panes)) {
    if (pane.room.offsetParent === null) continue;
    pane.kind = content(pane.name);
    whole = drawPicture(pane) && whole;
    drawMarks(pane);
  }
  drawn = { key: point.key.join("|"), state: point.state, measured: (nudged ?? point.marks.measured).join(), whole, at: performance.now() };
}

// No point, no pictures: what was there would be taken for the current one.
function clear() {
  for (const pane of Object.values(panes)) {
    canvas(pane.picture);
    canvas(pane.marks);
    pane.label.textContent = pane.where.textContent = "";
  }
  drawn = { key: null, whole: false, at: performance.now() };
}

// True when every tile was there, none stood in for by a coarser one.
function drawPicture(pane) {
  const [context, width, height] = canvas(pane.picture);
  let whole = true;
  pane.picture.style.filter = state.contrast === 1 ? "" : `contrast(${state.contrast})`;
  const [name, photo] = [pane.kind, point.key[1]];
  if (showsRaw(name)) {
    const frame = rawFrame(width, height);
    whole = drawLayer(context, rawLayer(photo, point.scan.version, point.scan.size, state.wallis), frame, width, height);
    pane.label.textContent = word("pane.raw", { scan: shortName(photo) });
    if (state.likeness) drawVeil(context, point, (raw) => toScreen(pane, groundFromRaw(...raw), raw));
    return whole;
  }
  const frame = groundFrame(width, height);
  if (name !== "scan") whole = drawLayer(context, orthoLayer(state.wallis), frame, width, height);
  if (name !== "ortho") {
    context.save();
    if (name === "swipe") {
      context.beginPath();
      context.rect(width * state.share, 0, width, height);
      context.clip();
    } else if (name === "blend") context.globalAlpha = state.share;
    whole = drawLayer(context, scanLayer(photo, point.scan.version, state.wallis), frame, width, height) && whole;
    context.restore();
    if (state.likeness) drawVeil(context, point, (raw) => toScreen(pane, groundFromRaw(...raw), raw));
  }
  const both = name === "swipe" || name === "blend";
  pane.label.textContent = both ? `${word("pane.ortho")} | ${word("pane.scan", { scan: shortName(photo) })}` : name === "ortho" ? word("pane.ortho") : word("pane.scan", { scan: shortName(photo) });
  return whole;
}

// Layer coordinates of ground tiles: metres east and south of the lattice's corner.
function groundFrame(width, height, { east, north } = view) {
  return { x: east - start.lattice.west - width / 2 / view.scale, y: start.lattice.north - north - height / 2 / view.scale, scale: view.scale };
}

// The raw scan about the point: an affine map of the ground, drawn with the scan's own axes.
function rawFrame(width, height) {
  const [column, row] = rawFromGround(view.east, view.north);
  const scale = view.scale / rawPerMetre();
  return { x: column - width / 2 / scale, y: row - height / 2 / scale, scale };
}

function rawPerMetre() {
  const [[a, b], [c, d]] = point.raw.matrix;
  return Math.sqrt(Math.abs(a * d - b * c)) || 1;
}

function rawFromGround(east, north) {
  const [[a, b], [c, d]] = point.raw.matrix;
  const [de, dn] = [east - point.marks.predicted[0], north - point.marks.predicted[1]];
  return [point.raw.predicted[0] + a * de + b * dn, point.raw.predicted[1] + c * de + d * dn];
}

function groundFromRaw(column, row) {
  const [[a, b], [c, d]] = point.raw.matrix;
  const whole = a * d - b * c || 1;
  const [dc, dr] = [column - point.raw.predicted[0], row - point.raw.predicted[1]];
  return [point.marks.predicted[0] + (d * dc - b * dr) / whole, point.marks.predicted[1] + (a * dr - c * dc) / whole];
}

// Places on the screen of a pane, both ways.
function toScreen(pane, ground, raw) {
  const [width, height] = [pane.marks.clientWidth, pane.marks.clientHeight];
  if (showsRaw(pane.kind)) {
    const frame = rawFrame(width, height);
    const [column, row] = raw ?? rawFromGround(...ground);
    return [(column - frame.x) * frame.scale, (row - frame.y) * frame.scale];
  }
  return [(ground[0] - view.east) * view.scale + width / 2, (view.north - ground[1]) * view.scale + height / 2];
}

function fromScreen(pane, x, y) {
  const [width, height] = [pane.marks.clientWidth, pane.marks.clientHeight];
  if (showsRaw(pane.kind)) {
    const frame = rawFrame(width, height);
    const raw = [x / frame.scale + frame.x, y / frame.scale + frame.y];
    const [east, north] = groundFromRaw(...raw);
    return { east, north, raw };
  }
  return { east: view.east + (x - width / 2) / view.scale, north: view.north - (y - height / 2) / view.scale };
}

function measuredNow(pane) {
  if (dragged) return toScreen(pane, [dragged.east, dragged.north], dragged.raw);
  if (nudged) return state.raw ? toScreen(pane, groundFromRaw(...nudged), nudged) : toScreen(pane, nudged);
  return toScreen(pane, point.marks.measured, point.raw.measured);
}

function drawMarks(pane) {
  const [context, width, height] = canvas(pane.marks);
  if (pane.kind === "swipe") line(context, width * state.share, 0, width * state.share, height, "#ffffffa0", 1);
  if (state.marks) {
    template(context, pane);
    if (pane.kind !== "scan") surveyedMark(context, toScreen(pane, point.marks.surveyed));
    if (pane.kind !== "ortho") scanMarks(context, pane);
  }
  if (cursor) crosshair(context, toScreen(pane, [cursor.east, cursor.north]), width, height);
  scaleBar(context, width, height, pane);
  pane.where.textContent = cursor ? describe(pane) : "";
}

function scanMarks(context, pane) {
  const palette = start.palette;
  point.marks.peaks.forEach((place, index) => {
    if (point.peaks[index].away < 0.05) return;
    const [x, y] = toScreen(pane, place, point.raw.peaks[index]);
    halo(context, palette.peak, 1.3, () => context.rect(x - 5, y - 5, 10, 10));
    text(context, `${index + 1}`, x + 8, y - 7, palette.peak);
  });
  const from = measuredNow(pane);
  const to = toScreen(pane, point.marks.predicted, point.raw.predicted);
  if (Math.hypot(to[0] - from[0], to[1] - from[1]) > 10) line(context, ...from, ...to, palette.predicted, 1.2);
  context.setLineDash([4, 3]);
  halo(context, palette.predicted, 1.6, () => context.arc(to[0], to[1], 9, 0, 7));
  context.setLineDash([]);
  measuredMark(context, from, palette.states[point.state].colour);
}

// Corners of the patch the engine compared: along the scan's axes, about the point.
function template(context, pane) {
  if (!start.template) return;
  const raw = showsRaw(pane.kind);
  const half = start.template * rawPerMetre();
  const middle = pane.kind === "scan" ? point.raw.measured : point.raw.predicted;
  const shift = pane.kind === "scan" ? [0, 0] : [point.marks.surveyed[0] - point.marks.predicted[0], point.marks.surveyed[1] - point.marks.predicted[1]];
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => {
    const place = [middle[0] + x * half, middle[1] + y * half];
    const ground = groundFromRaw(...place);
    return toScreen(pane, [ground[0] + shift[0], ground[1] + shift[1]], raw ? place : null);
  });
  context.globalAlpha = 0.75;
  halo(context, "#ffffff", 1, () => corners.forEach((corner, index) => {
    for (const other of [corners[(index + 1) % 4], corners[(index + 3) % 4]]) {
      context.moveTo(...corner);
      context.lineTo(corner[0] + 0.12 * (other[0] - corner[0]), corner[1] + 0.12 * (other[1] - corner[1]));
    }
  }));
  context.globalAlpha = 1;
}

function surveyedMark(context, [x, y]) {
  const colour = point.role === "check" ? start.palette.check : start.palette.current;
  halo(context, colour, 1.6, () => {
    if (point.role === "check") context.rect(x - 8, y - 8, 16, 16);
    else { context.moveTo(x, y - 10); context.lineTo(x + 9, y + 6); context.lineTo(x - 9, y + 6); context.closePath(); }
  });
  context.fillStyle = colour;
  context.fillRect(x - 1, y - 1, 2, 2);
}

function scaleBar(context, width, height, pane) {
  const wanted = 80 / view.scale;
  const power = 10 ** Math.floor(Math.log10(wanted));
  const metres = [5, 2, 1].map((step) => step * power).find((step) => step <= wanted) ?? power;
  const [right, bottom] = [width - 10.5, height - 10.5];
  const left = right - metres * view.scale;
  halo(context, "#ffffff", 1.2, () => {
    context.moveTo(left, bottom - 4);
    context.lineTo(left, bottom);
    context.lineTo(right, bottom);
    context.lineTo(right, bottom - 4);
  });
  const zoom = pane.kind === "ortho" ? start.ortho_pixel : point.scan.pixel;
  const words = `${metres} m  \u00b7  ${number(view.scale * zoom, 1)}\u00d7`;
  context.font = "11px sans-serif";
  text(context, words, Math.min(left, right - context.measureText(words).width), bottom - 8, "#ffffff");
}

function describe(pane) {
  if (showsRaw(pane.kind)) {
    const [column, row] = cursor.raw ?? rawFromGround(cursor.east, cursor.north);
    return `${number(column, 1)}, ${number(row, 1)} px`;
  }
  return `${number(cursor.east, 2)}  ${number(cursor.north, 2)}`;
}

function place(pane, at) {
  const raw = showsRaw(pane.kind);
  // The mark stands there at once; the desk's answer puts it where it is recorded.
  nudged = raw ? at.raw : [at.east, at.north];
  redraw();
  send({ kind: "place", key: point.key, frame: raw ? "scan" : "ground", place: raw ? at.raw : [at.east, at.north] });
}

// A new point is chosen where the ortho shows it, for there its coordinates are known.
function addPoint(pane, x, y) {
  if (takesPlace(pane, x) && pane.kind !== "blend") return;
  const at = fromScreen(pane, x, y);
  send({ kind: "add", place: [at.east, at.north] });
  switchCompare("adding");
}

const takesPlace = (pane, x) => pane.kind === "scan" || pane.kind === "blend" || (pane.kind === "swipe" && x > pane.room.clientWidth * state.share);

// What a pointer on a pane may do; `pointing.js` says when.
const HAND = {
  ready: () => point && view,
  grips: (pane, x, y) => {
    const mark = measuredNow(pane);
    return state.marks && !state.adding && takesPlace(pane, x) && Math.hypot(mark[0] - x, mark[1] - y) < 8;
  },
  at: fromScreen,
  drag: (place) => { dragged = place; },
  drop: (pane) => { if (dragged) place(pane, dragged); },
  click: (pane, x, y) => {
    if (state.adding) addPoint(pane, x, y);
    else if (takesPlace(pane, x)) place(pane, fromScreen(pane, x, y));
  },
  pan: (from, to) => { view.east += from.east - to.east; view.north += from.north - to.north; },
  point: (place) => { cursor = place; redraw(); },
  zoom: (pane, x, y, factor) => {
    const fixed = fromScreen(pane, x, y);
    view.scale = bounded(view.scale * factor);
    HAND.pan(fixed, fromScreen(pane, x, y));
    redraw();
  },
};
