// One fiducial large: windows of the raw scan in their own contrast; click places, drag moves, wheel zooms.
import { number, start } from "/pages/words.js";
import { canvas, crosshair, halo, measuredMark } from "/pages/marks.js";
import { listen } from "/pages/pointing.js";
import { windowOf } from "/pages/board.js";

const SIDE = 640;
let room = null;
let place = () => {};
let row = null;
let cell = null;
let colour = "#ffffff";
let view = null; // {x, y: middle, scan pixels; scale: css pixels per scan pixel}
let cursor = null;
let nudged = null;
let shownKey = "";
let asked = false;
const images = new Map();

export function openMark(fresh, onPlace) {
  place = onPlace;
  if (room === fresh) return;
  room = fresh;
  const hand = {
    ready: () => view !== null, grips: () => false, drag: () => {}, drop: () => {},
    at: (_, x, y) => fromScreen(x, y),
    pan: (from, to) => { view.x += from[0] - to[0]; view.y += from[1] - to[1]; redraw(); },
    point: (at) => { cursor = at; redraw(); },
    click: (_, x, y) => { if (start.guest) return; const at = fromScreen(x, y); nudged = at; redraw(); place(at); },
    zoom: (_, x, y, factor) => zoomAbout(fromScreen(x, y), factor),
  };
  listen({ room }, hand);
  room.addEventListener("pointerdown", () => document.activeElement?.blur());
  new ResizeObserver(redraw).observe(room);
}

export function closeMark() { room = null; view = null; shownKey = ""; nudged = null; }

export function lookAt(freshRow, freshCell, ink) {
  [row, cell, colour] = [freshRow, freshCell, ink];
  const key = `${row.photo}|${cell.name}`;
  nudged = null;
  if (key !== shownKey) {
    shownKey = key;
    const middle = cell.place ?? cell.expected ?? row.size.map((value) => value / 2);
    view = { x: middle[0], y: middle[1], scale: (room.clientWidth || 380) / (1.6 * row.window) };
  }
  redraw();
}

export function fitMark() { shownKey = ""; lookAt(row, cell, colour); }
export function zoomMark(factor) { if (view) zoomAbout([view.x, view.y], factor); }

export function nudgeMark(right, down) {
  const from = nudged ?? cell?.place ?? cell?.expected;
  if (!from || start.guest) return;
  nudged = [from[0] + right, from[1] + down];
  clearTimeout(nudgeMark.later);
  const target = nudged;
  nudgeMark.later = setTimeout(() => place(target), 400);
  redraw();
}

function zoomAbout([x, y], factor) {
  const scale = Math.min(Math.max(view.scale * factor, 0.02), 60);
  const share = view.scale / scale;
  view = { x: x + (view.x - x) * share, y: y + (view.y - y) * share, scale };
  redraw();
}

const fromScreen = (x, y) => [view.x + (x - room.clientWidth / 2) / view.scale, view.y + (y - room.clientHeight / 2) / view.scale];
const toScreen = ([column, line]) => [(column - view.x) * view.scale + room.clientWidth / 2, (line - view.y) * view.scale + room.clientHeight / 2];

function redraw() {
  if (asked || !room) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; if (room && view && row) draw(); });
}

// Windows lie on a lattice of a quarter of their side, so that panning asks for few of them.
function wanted() {
  const perPixel = view.scale * (window.devicePixelRatio || 1);
  const reduction = 2 ** Math.min(6, Math.max(0, Math.floor(Math.log2(1 / perPixel) + 0.35)));
  const step = (SIDE * reduction) / 4;
  return windowOf(row, [view.x, view.y].map((value) => Math.round(value / step) * step), SIDE * reduction, SIDE);
}

function image(address) {
  if (!images.has(address)) {
    const made = new Image();
    made.addEventListener("load", redraw);
    made.src = address;
    images.set(address, made);
    if (images.size > 80) images.delete(images.keys().next().value);
  }
  return images.get(address);
}

function draw() {
  const [context, width, height] = canvas(room.querySelector(".picture"));
  context.imageSmoothingEnabled = view.scale < 3;
  const best = wanted();
  draw.kept = (draw.kept ?? []).filter((one) => one.photo === row.photo).slice(-3);
  if (!draw.kept.some((one) => one.address === best.address)) draw.kept.push({ ...best, photo: row.photo });
  for (const one of [...draw.kept.filter((other) => other.address !== best.address), best]) {
    const picture = image(one.address);
    if (!picture.complete || !picture.naturalWidth) continue;
    const [x, y] = toScreen([one.left, one.top]);
    context.drawImage(picture, x, y, one.side * view.scale, one.side * view.scale);
  }
  const [over] = canvas(room.querySelector(".marks"));
  if (cell.expected) {
    const [x, y] = toScreen(cell.expected);
    over.setLineDash([4, 3]);
    halo(over, start.palette.predicted, 1.6, () => over.arc(x, y, 11, 0, 7));
    over.setLineDash([]);
  }
  const measured = nudged ?? cell.place;
  if (measured) measuredMark(over, toScreen(measured), colour);
  if (cursor) crosshair(over, toScreen(cursor), width, height);
  room.querySelector(".where").textContent = cursor ? `${number(cursor[0], 1)}, ${number(cursor[1], 1)} px` : "";
}

export const markState = () => ({ view, cell, row });
