// Seams drawn by hand: a line that a seam follows, or the outline of what one photo shows.
import { photoAt } from "./mosaic_marks.js";
import { halo, text } from "./overlay.js";
import { element, shortName, start, undivided, word } from "./words.js";
import { send } from "./wire.js";

/** @typedef {"" | "line" | "area"} Tool */

const INK = "#7dffb2";
const NEAR_PX = 9; // design: as near as a hand comes to a corner
const TOOLS = /** @type {[Tool, string][]} */ ([["line", "L"], ["area", "P"]]);
const FEW = { area: "mask.few", line: "mosaic.edit.line.few" };
const state = {
  tool: /** @type {Tool} */ (""),
  /** Corners, metres east and north. */
  places: /** @type {Pair[]} */ ([]),
  photo: "",
  /** True once a hand chose the photo: places choose none then. */
  chosen: false,
  seams: /** @type {SeamOf[]} */ ([]),
  edits: /** @type {SeamEdited[]} */ ([]),
  /** The edit whose corners are in hand; null for a new one. */
  of: /** @type {SeamEdited | null} */ (null),
  /** True from the press that takes an edit in hand until its release. */
  taking: false,
  /** Why a gesture came to nothing. */
  said: "",
  gripped: -1,
  changed: /** @type {() => void} */ (() => {}),
};

/** @param {() => void} changed called whenever something of it is to be shown anew */
export function setUpEdit(changed) {
  state.changed = changed;
}

export const isEditing = () => state.tool !== "";

/** @param {Tool} tool on, or off again @param {Pair} [place] where it is meant */
function use(tool, place) {
  Object.assign(state, { tool: state.tool === tool ? "" : tool, places: [], chosen: false,
    said: "", of: null });
  if (place) propose(place);
  state.changed();
}

/** An edit that stands is in hand, as if it had just been drawn. @param {SeamEdited} edit */
function takeUp(edit) {
  Object.assign(state, { tool: toolOf(edit), places: [...edit.places], of: edit, said: "",
    photo: edit.area ? edit.what : state.photo, chosen: edit.area });
  state.changed();
}

/** Bounds with as much room round them as they are large. @param {Pair[]} places */
function aroundAll(places) {
  const [west, south] = [0, 1].map((axis) => Math.min(...places.map((place) => place[axis])));
  const [east, north] = [0, 1].map((axis) => Math.max(...places.map((place) => place[axis])));
  const room = Math.max(east - west, north - south);
  return [west - room, south - room, east + room, north + room];
}

/** @param {SeamDecided} edit @returns {"line" | "area"} */
const toolOf = ({ area }) => (area ? "area" : "line");

/** The photo that shows a place, unless a hand chose one. @param {Pair} place */
function propose(place) {
  if (!state.chosen) state.photo = photoAt(state.seams, place) || state.photo;
}

/**
 * What draws, in sight however long the lists below are.
 * @param {Mosaic} found @param {PickedPlace | null} picked
 */
export function editTools(found, picked) {
  Object.assign(state, { seams: found.seams ?? [], edits: found.edits ?? [] });
  // Taken back or laid anew meanwhile, here or by somebody else: what is in hand is a new one.
  if (state.of && !state.edits.some(({ id }) => id === state.of?.id)) {
    Object.assign(state, { of: null, said: "mosaic.edit.changed" });
  }
  const { tool, of } = state;
  const photos = state.seams.map(({ photo }) => photo);
  if (!photos.includes(state.photo)) state.photo = picked?.photo ?? photos[0] ?? "";
  const buttons = TOOLS.map(([name, key]) => element("button", {
    "data-tool": name, class: tool === name ? "on" : "", "aria-pressed": `${tool === name}`,
    disabled: start.guest, title: word(`mosaic.edit.${name}.tip`), onclick: () => use(name),
  }, word(`mosaic.edit.${name}`), element("kbd", {}, key)));
  const choice = element("select", { id: "mosaic-photo-of", "aria-label": word("mosaic.photo"),
    disabled: start.guest, onchange: (/** @type {Event} */ { target }) => {
      Object.assign(state, { photo: /** @type {HTMLSelectElement} */ (target).value,
        chosen: true });
    } }, ...photos.map((photo) =>
    element("option", { value: photo, selected: photo === state.photo }, shortName(photo))));
  const hint = tool ? [element("p", { class: "next", role: "status" },
    word(state.said || (of ? "mosaic.edit.moving.hint" : `mosaic.edit.${tool}.hint`)))] : [];
  return element("div", { id: "mosaic-tools" }, element("div", { class: "acts" }, ...buttons,
    ...(tool === "area" ? [choice] : [])), ...hint);
}

/**
 * Every edit that stands, and those that were withdrawn.
 * @param {Mosaic} found @param {string} button what the button is called that writes the file
 * @param {(bounds: number[]) => void} frame shows west, south, east, north
 */
export function editSide({ edition, edits = [], withdrawn = [] }, button, frame) {
  const pending = edition ? [element("p", { id: "mosaic-pending", class: "doubted" },
    word("mosaic.edit.pending", { button }))] : [];
  const title = edits.length || withdrawn.length || edition
    ? [element("h3", {}, word("mosaic.edit"))] : [];
  return [...title, ...pending, ...edits.map((edit) => line(edit, frame)),
    ...withdrawn.map(withdrawnLine)];
}

/** Of which photos an edit is. @param {SeamDecided} edit */
const photosOf = ({ what }) => what.split(" | ").map(shortName).join(" | ");

/** What it is, and whose. @param {SeamDecided} edit */
const sentence = (edit) => word(`mosaic.edit.did.${toolOf(edit)}`,
  { what: photosOf(edit), who: edit.who, when: undivided(edit.when) });

/** @param {SeamEdited} edit @param {(bounds: number[]) => void} frame */
const line = (edit, frame) => {
  const { id, turn } = edit;
  const inHand = state.of?.id === id;
  return element("p", { class: `decided${inHand ? " on" : ""}`, "data-edit": id },
    element("span", {}, element("b", {}, `${turn}`), ` \u00b7 ${sentence(edit)}`),
    element("button", { class: "small", disabled: start.guest, "aria-pressed": `${inHand}`,
      title: word("mosaic.edit.corners.tip"), onclick: () => {
        frame(aroundAll(edit.places));
        takeUp(edit);
      } }, word("mosaic.edit.corners")),
    turning("history.back", id));
};

/** @param {SeamDecided & { by: string }} edit */
const withdrawnLine = (edit) => element("p", { class: "decided withdrawn", "data-edit": edit.id,
  title: word("history.by", { who: edit.by }) }, element("span", {}, sentence(edit)),
turning("history.again", edit.id));

/** @param {"history.back" | "history.again"} act @param {number} decision */
const turning = (act, decision) => element("button", { class: "small", disabled: start.guest,
  title: word(`${act}.tip`),
  onclick: () => send({ kind: "back", decision, again: act === "history.again" }) }, word(act));

/**
 * A corner more: in the side it is put on, else behind the last one.
 * @param {Pair} ground @param {(ground: Pair) => Pair} onScreen
 */
export function putCorner(ground, onScreen) {
  const { places, tool } = state;
  if (!places.length) propose(ground);
  const screen = places.map(onScreen);
  const sides = screen.slice(1).map((end, at) => /** @type {const} */ ([screen[at], end]));
  if (tool === "area" && screen.length > 2) sides.push([screen[screen.length - 1], screen[0]]);
  const put = onScreen(ground);
  const side = sides.findIndex(([begin, end]) => offSide(put, begin, end) < NEAR_PX);
  places.splice(side < 0 ? places.length : side + 1, 0, ground);
  state.said = "";
  state.changed();
}

/** How far a place lies off a side, not off what prolongs it. @param {Pair[]} given */
function offSide(...[[x, y], [a, b], [c, d]]) {
  const length = Math.hypot(c - a, d - b) || 1;
  const along = ((x - a) * (c - a) + (y - b) * (d - b)) / length;
  const off = Math.abs((x - a) * (d - b) - (y - b) * (c - a)) / length;
  return along > 0 && along < length ? off : Infinity;
}

/** A click on the last corner, or on the first one of an area, ends it: so does a double click. */
export function tapCorner() {
  const { tool, places, gripped, taking } = state;
  if (taking) return;
  const closes = tool === "area" && gripped === 0 && places.length > 2;
  if (gripped >= 0 && (closes || gripped === places.length - 1)) finish();
}

/** Takes back the corner that is nearest to a place. @param {Pair} place */
function takeNearest([east, north]) {
  const away = state.places.map(([x, y]) => Math.hypot(x - east, y - north));
  if (away.length) state.places.splice(away.indexOf(Math.min(...away)), 1);
}

function finish() {
  const { tool, places, photo, of } = state;
  const most = (/** @type {number} */ value) => Math.round(value * 100) / 100;
  const few = places.length < (tool === "area" ? 3 : 2);
  state.said = few && places.length ? FEW[tool === "area" ? "area" : "line"] : "";
  if (few) return state.changed();
  if (send({ kind: "seam", photo: tool === "area" ? photo : "", replaces: of?.id ?? 0,
    places: places.map((place) => place.map(most)) })) {
    Object.assign(state, { places: [], of: null });
  }
  return state.changed();
}

/**
 * True where a corner lies under the hand, which then drags it: of what is drawn, or of an edit
 * that stands, which is in hand from then on.
 * @param {Pair} screen @param {(ground: Pair) => Pair} onScreen
 */
export function gripCorner([x, y], onScreen) {
  const under = (/** @type {Pair[]} */ places) => places.findIndex((place) => {
    const [px, py] = onScreen(place);
    return Math.hypot(px - x, py - y) < NEAR_PX;
  });
  const laid = handles().find(({ places }) => under(places) >= 0);
  state.taking = Boolean(laid);
  if (laid) takeUp(laid);
  state.gripped = under(state.places);
  return state.gripped >= 0;
}

/** Edits that a hand may take by a corner: those of the tool, while nothing is drawn. */
const handles = () => (state.places.length || start.guest ? []
  : state.edits.filter((edit) => toolOf(edit) === state.tool));

/** True while a corner is dragged. @param {Pair} ground */
export function dragCorner(ground) {
  // A key may have ended or shortened what is drawn while the hand held a corner of it.
  if (!state.places[state.gripped]) return false;
  state.places[state.gripped] = ground;
  return true;
}

export function dropCorner() {
  Object.assign(state, { gripped: -1, taking: false });
}

/**
 * True when the key is of what is being drawn.
 * @param {string} name @param {Pair} cursor @param {(ground: Pair) => Pair} onScreen
 */
export function editKey(name, cursor, onScreen) {
  const tool = TOOLS.find(([, key]) => `Key${key}` === name)?.[0];
  if (tool && !start.guest) use(tool, cursor);
  else if (!isEditing()) return false;
  else if (name === "Escape") {
    if (state.places.length) Object.assign(state, { places: [], said: "", of: null });
    else state.tool = "";
  } else if (name === "Enter") finish();
  else if (name === "Space") putCorner(cursor, onScreen);
  else if (name === "Backspace" || name === "Delete") {
    if (name === "Delete") takeNearest(cursor);
    else state.places.pop();
    state.gripped = -1;
    // Without corners nothing is in hand any more: it stays as it was laid.
    state.said = state.of && !state.places.length ? "mosaic.edit.kept" : "";
    if (!state.places.length) state.of = null;
  } else return false;
  state.changed();
  return true;
}

/**
 * What is being drawn, as far as the pointer.
 * @param {Context} context @param {(ground: Pair) => Pair} onScreen @param {Pair | null} cursor
 */
export function drawEdit(context, onScreen, cursor) {
  const { tool, places, gripped, of } = state;
  for (const { places: laid, turn } of handles()) {
    const corners = laid.map(onScreen);
    Object.assign(context, { strokeStyle: INK, lineWidth: 1.8 });
    for (const [x, y] of corners) context.strokeRect(x - 3, y - 3, 6, 6);
    named(context, `${turn}`, corners[0]);
  }
  if (!places.length) return;
  const ahead = cursor && gripped < 0 && !of ? [...places, cursor] : places;
  halo(context, INK, 1.8, () => {
    ahead.map(onScreen).forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
    if (tool === "area") context.closePath();
  });
  context.fillStyle = INK;
  const corners = places.map(onScreen);
  for (const [x, y] of corners) context.fillRect(x - 3, y - 3, 6, 6);
  if (of) named(context, `${of.turn} \u00b7 ${photosOf(of)}`, corners[0]);
}

/** The number of an edit in the list, at its first corner. @param {Context} context */
const named = (context, /** @type {string} */ words, /** @type {Pair} */ [x, y]) =>
  text(context, words, [x + 7, y - 7], INK);

export const editState = () => {
  const { tool, places, photo, said, of } = state;
  return { tool, places, photo, said, of: of?.id ?? 0 };
};
