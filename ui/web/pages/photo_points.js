// Nadir, isocentre, principal point and fiducial centre in the scan, and corrections at the cursor.
import { halo, text } from "./overlay.js";
import { byId, element, number, start, word } from "./words.js";

const NEAR_PX = 15; // design: as wide as a letter: nearer ones share a label
const BESIDE_PX = 18; // design: the table leaves free what the cursor points at
const RADIUS_PX = 4;

/** @typedef {import("./expected.js").Place} Place */
/** @typedef {(ground: Pair, raw: Pair | null) => Pair} OnScreen */
/** @typedef {[effect: string, um: number, px: number, m: number]} Correction */

/** @typedef {{ letters: string, at: Pair }} Lettered */

const state = {
  shown: false,
  /** Draws the panes anew. */
  redraw: () => {},
  /** Whether a place is asked about, and the newest that is to be. */
  asking: false,
  wanted: "",
  /** What is told, and of which place. */
  told: { address: "", rows: /** @type {Correction[]} */ ([]) },
};

/** As the layers are. @param {boolean} shown */
export function showPhotoPoints(shown) {
  if (shown === state.shown) return;
  state.shown = shown;
  byId("corrections").hidden = true;
  state.redraw();
}

/**
 * The photo's points, and beside the cursor what moved the image point there.
 * @param {Context} context @param {HTMLElement} room of the pane @param {Point} point
 * @param {{ place: OnScreen, cursor: Place | null, redraw: () => void }} how
 */
export function drawPhotoPoints(context, room, point, { place: onScreen, cursor, redraw }) {
  state.redraw = redraw;
  if (!state.shown) return;
  const places = point.specials.map(([letter, raw, ground]) =>
    ({ letters: letter, at: onScreen(ground, raw) }));
  const colour = start.palette.chosen.dark;
  for (const { at: [x, y] } of places) {
    halo(context, colour, 1.8, () => context.arc(x, y, RADIUS_PX, 0, 7));
  }
  for (const { letters, at: [x, y] } of apart(places)) {
    text(context, letters, [x + 8, y - 7], colour);
  }
  showCorrections(room, point, cursor, cursor && onScreen(cursor.ground, cursor.raw));
}

/** Letters that would lie over each other stand in a row. @param {Lettered[]} places */
function apart(places) {
  const groups = /** @type {Lettered[]} */ ([]);
  for (const { letters, at } of places) {
    const near = groups.find(({ at: [x, y] }) => Math.hypot(x - at[0], y - at[1]) < NEAR_PX);
    if (near) near.letters += ` ${letters}`;
    else groups.push({ letters, at });
  }
  return groups;
}

/**
 * @param {HTMLElement} room @param {Point} point @param {Place | null} cursor
 * @param {Pair | null} at of the cursor, in the pane
 */
function showCorrections(room, { key, scan: { version } }, cursor, at) {
  const table = byId("corrections");
  if (!cursor || !at) {
    table.hidden = true;
    return;
  }
  const [frame, place] = cursor.raw ? ["scan", cursor.raw] : ["ground", cursor.ground];
  const digits = place.map((value) => value.toFixed(2)).join("/");
  ask(`/tiles/corrections/${encodeURIComponent(key[1])}/${version}/${frame}/${digits}`);
  table.hidden = !state.told.rows.length;
  // Where there is no room right of the cursor it stands left of it, and the same above.
  const { offsetLeft: left, clientWidth: width, clientHeight: height } = room;
  const { offsetWidth: wide, offsetHeight: high } = table;
  const x = at[0] + BESIDE_PX + wide > width ? at[0] - BESIDE_PX - wide : at[0] + BESIDE_PX;
  const y = at[1] + BESIDE_PX + high > height ? at[1] - BESIDE_PX - high : at[1] + BESIDE_PX;
  const [across, down] = [Math.max(x, 2), Math.max(y, 2)].map(Math.round);
  table.style.transform = `translate(${left + across}px, ${down}px)`;
}

/**
 * One question at a time; while it is answered only the newest place waits.
 * @param {string} address
 */
async function ask(address) {
  state.wanted = address;
  if (state.asking) return;
  state.asking = true;
  try {
    while (state.told.address !== state.wanted) {
      const next = state.wanted;
      const answer = await fetch(next);
      const rows = answer.ok ? await answer.json() : [];
      state.told = { address: next, rows };
      fill(rows);
    }
  } catch {
    // The desk is away, which the page tells elsewhere.
    state.told = { address: state.wanted, rows: [] };
  } finally {
    state.asking = false;
  }
  state.redraw();
}

/** @param {Correction[]} rows */
function fill(rows) {
  const signed = (/** @type {number} */ value, /** @type {number} */ digits) =>
    `${value > 0 ? "+" : ""}${number(value, digits)}`;
  const head = ["", "\u00b5m", "px", "m"].map((name) => element("th", {}, name));
  byId("corrections").replaceChildren(element("tr", {}, ...head),
    ...rows.map(([effect, um, px, metres]) => element("tr", { "data-effect": effect },
      element("td", {}, word(`correction.${effect}`)), element("td", {}, signed(um, 1)),
      element("td", {}, signed(px, 2)), element("td", {}, number(metres, 2)))));
}
