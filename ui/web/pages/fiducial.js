// One fiducial large: windows of the raw scan in their own contrast; click places, drag moves.
import { focused, numbers, start } from "./words.js";
import { cleared, crosshair, draftedMark, expectedMark, measuredMark } from "./overlay.js";
import { Pane, View, oncePerFrame } from "./view.js";
import { image, levelFor, onTile } from "./tiles.js";

/** @typedef {{ left: number, top: number, side: number, address: string }} ScanWindow */

const SIDE = 640; // design: pixels of one window, more than the pane shows of it
const state = {
  pane: /** @type {Pane | null} */ (null),
  // design: from a whole scan at once to 60 pixels of the screen for one of the scan.
  view: new View(0.02, 60),
  place: /** @type {(place: Pair, photo: string, name: string) => void} */ (() => {}),
  row: /** @type {ScanRow | null} */ (null),
  cell: /** @type {Fiducial | null} */ (null),
  colour: "#ffffff",
  cursor: /** @type {Pair | null} */ (null),
  /** Where the hand has put it, and nobody has decided yet. */
  draft: /** @type {Pair | null} */ (null),
  shownKey: "",
  /** Windows that were wanted last, drawn below until the next one is there. */
  kept: /** @type {(ScanWindow & { photo: string })[]} */ ([]),
};
const redraw = oncePerFrame(draw);

/** @type {import("./view.js").Hand} */
const HAND = {
  redraw,
  point: (pane, screen) => {
    state.cursor = screen && pane.layerFromScreen(screen);
    redraw();
  },
  click: (pane, screen) => {
    const { row, cell } = state;
    if (row && cell) state.place(pane.layerFromScreen(screen), row.photo, cell.name);
  },
};

/** @param {HTMLElement} room @param {typeof state.place} place */
export function openFiducial(room, place) {
  state.place = place;
  if (state.pane?.room === room) return;
  state.pane = new Pane(room, state.view, HAND);
  // Arrows are the fiducial's again, not the table's.
  room.addEventListener("pointerdown", () => focused()?.blur());
  onTile(redraw);
}

export function closeFiducial() {
  Object.assign(state, { pane: null, shownKey: "", draft: null });
}

/** @param {ScanRow} row @param {Fiducial} cell @param {string} colour @param {Pair | null} draft */
export function showFiducial(row, cell, colour, draft) {
  const key = `${row.photo}|${cell.name}`;
  const fresh = key !== state.shownKey;
  Object.assign(state, { row, cell, colour, draft, shownKey: key });
  if (fresh) {
    const room = state.pane?.size ?? [380, 380];
    const middle = draft ?? cell.place ?? cell.expected;
    const whole = Math.min(...row.size.map((value, side) => room[side] / value));
    if (middle) state.view.show(middle, (room[0] || 380) / (1.6 * row.window));
    else state.view.show(row.size.map((value) => value / 2), whole);
  }
  redraw();
}

export function fitFiducial() {
  const { row, cell, colour, draft } = state;
  state.shownKey = "";
  if (row && cell) showFiducial(row, cell, colour, draft);
}

/** @param {number} factor */
export function zoomFiducial(factor) {
  state.view.zoom(factor);
  redraw();
}

/** @param {number} right @param {number} down scan pixels */
export function nudgeFiducial(right, down) {
  const { row, cell, draft } = state;
  const from = draft ?? cell?.place ?? cell?.expected;
  if (row && cell && from) state.place([from[0] + right, from[1] + down], row.photo, cell.name);
}

/**
 * Integer corner and power of two, so that the page knows where every pixel of the picture lies.
 * @param {ScanRow} row @param {Pair} middle @param {number} side scan pixels
 * @param {number} pixels of the picture @returns {ScanWindow}
 */
export function windowOf(row, middle, side, pixels) {
  const reduction = 2 ** Math.max(0, Math.floor(Math.log2(side / pixels)));
  const across = Math.max(1, Math.round(side / reduction));
  const [left, top] = middle.map((value) => Math.round(value - (across * reduction) / 2));
  const place = `${encodeURIComponent(row.photo)}/${row.version}/${left}/${top}`;
  const address = `/tiles/near/${place}/${across}/${reduction}?e=${start.edition}`;
  return { left, top, side: across * reduction, address };
}

// Windows lie on a lattice of a quarter of their side, so that panning asks for few of them.
function wanted(/** @type {ScanRow} */ row) {
  const { view } = state;
  const reduction = 2 ** levelFor(view.scale, 7);
  const step = (SIDE * reduction) / 4;
  const middle = [view.x, view.y].map((value) => Math.round(value / step) * step);
  return windowOf(row, middle, SIDE * reduction, SIDE);
}

function draw() {
  const { pane, view, row, cell, cursor } = state;
  if (!pane || !row || !cell) return;
  const [context, width, height] = cleared(pane.picture);
  context.imageSmoothingEnabled = view.scale < 3;
  const best = { ...wanted(row), photo: row.photo };
  const before = state.kept.filter((one) => one.photo === row.photo).slice(-3);
  state.kept = [...before.filter((one) => one.address !== best.address), best];
  for (const one of state.kept) {
    const picture = image(one.address);
    if (!picture.ready) continue;
    const [x, y] = pane.screenFromLayer([one.left, one.top]);
    context.drawImage(picture, x, y, one.side * view.scale, one.side * view.scale);
  }
  const [over] = cleared(pane.marks);
  const { expected } = cell;
  if (expected) expectedMark(over, pane.screenFromLayer(expected), start.palette.predicted, 11);
  if (cell.place) measuredMark(over, pane.screenFromLayer(cell.place), state.colour);
  if (state.draft) draftedMark(over, pane.screenFromLayer(state.draft));
  if (cursor) crosshair(over, pane.screenFromLayer(cursor), width, height);
  pane.where.textContent = cursor ? `${numbers(cursor, 1)} px` : "";
}
