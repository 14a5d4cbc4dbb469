// Seams drawn by hand: a line that a seam follows, or the outline of what one photo shows.
import { photoAt } from "./mosaic_marks.js";
import { halo } from "./overlay.js";
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
    said: "" });
  if (place) propose(place);
  state.changed();
}

/** The photo that shows a place, unless a hand chose one. @param {Pair} place */
function propose(place) {
  if (!state.chosen) state.photo = photoAt(state.seams, place) || state.photo;
}

/**
 * What draws, in sight however long the lists below are.
 * @param {Mosaic} found @param {PickedPlace | null} picked
 */
export function editTools(found, picked) {
  const { tool } = state;
  state.seams = found.seams ?? [];
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
    word(state.said || `mosaic.edit.${tool}.hint`))] : [];
  return element("div", { id: "mosaic-tools" }, element("div", { class: "acts" }, ...buttons,
    ...(tool === "area" ? [choice] : [])), ...hint);
}

/**
 * Every edit that stands.
 * @param {Mosaic} found @param {string} button what the button is called that writes the file
 */
export function editSide({ edition, edits = [] }, button) {
  const pending = edition ? [element("p", { id: "mosaic-pending", class: "doubted" },
    word("mosaic.edit.pending", { button }))] : [];
  const title = edits.length || edition ? [element("h3", {}, word("mosaic.edit"))] : [];
  return [...title, ...pending, ...edits.map(line)];
}

/** @param {SeamEdited} edit */
const line = ({ id, who, when, area, what }) => element("p", { class: "decided" },
  word(`mosaic.edit.did.${area ? "area" : "line"}`, {
    what: what.split(" | ").map(shortName).join(" | "), who, when: undivided(when),
  }),
  element("button", { class: "small", disabled: start.guest, title: word("history.back.tip"),
    onclick: () => send({ kind: "back", decision: id }) }, word("history.back")));

/** A corner more. @param {Pair} ground */
export function putCorner(ground) {
  if (!state.places.length) propose(ground);
  state.places.push(ground);
  state.said = "";
  state.changed();
}

/** A click on the last corner, or on the first one of an area, ends it: so does a double click. */
export function tapCorner() {
  const { tool, places, gripped } = state;
  const closes = tool === "area" && gripped === 0 && places.length > 2;
  if (gripped >= 0 && (closes || gripped === places.length - 1)) finish();
}

/** Takes back the corner that is nearest to a place. @param {Pair} place */
function takeNearest([east, north]) {
  const away = state.places.map(([x, y]) => Math.hypot(x - east, y - north));
  if (away.length) state.places.splice(away.indexOf(Math.min(...away)), 1);
}

function finish() {
  const { tool, places, photo } = state;
  const most = (/** @type {number} */ value) => Math.round(value * 100) / 100;
  const few = places.length < (tool === "area" ? 3 : 2);
  state.said = few && places.length ? FEW[tool === "area" ? "area" : "line"] : "";
  if (few) return state.changed();
  if (send({ kind: "seam", photo: tool === "area" ? photo : "",
    places: places.map((place) => place.map(most)) })) state.places = [];
  return state.changed();
}

/**
 * True where a corner lies under the hand, which then drags it.
 * @param {Pair} screen @param {(ground: Pair) => Pair} onScreen
 */
export function gripCorner([x, y], onScreen) {
  state.gripped = state.places.findIndex((place) => {
    const [px, py] = onScreen(place);
    return Math.hypot(px - x, py - y) < NEAR_PX;
  });
  return state.gripped >= 0;
}

/** True while a corner is dragged. @param {Pair} ground */
export function dragCorner(ground) {
  if (state.gripped < 0) return false;
  state.places[state.gripped] = ground;
  return true;
}

export function dropCorner() {
  state.gripped = -1;
}

/** True when the key is of what is being drawn. @param {string} name @param {Pair} cursor */
export function editKey(name, cursor) {
  const tool = TOOLS.find(([, key]) => `Key${key}` === name)?.[0];
  if (tool && !start.guest) use(tool, cursor);
  else if (!isEditing()) return false;
  else if (name === "Escape") {
    if (state.places.length) Object.assign(state, { places: [], said: "" });
    else state.tool = "";
  } else if (name === "Enter") finish();
  else if (name === "Space") putCorner(cursor);
  else if (name === "Backspace" || name === "Delete") {
    if (name === "Delete") takeNearest(cursor);
    else state.places.pop();
    state.said = "";
  } else return false;
  state.changed();
  return true;
}

/**
 * What is being drawn, as far as the pointer.
 * @param {Context} context @param {(ground: Pair) => Pair} onScreen @param {Pair | null} cursor
 */
export function drawEdit(context, onScreen, cursor) {
  const { tool, places, gripped } = state;
  if (!places.length) return;
  const ahead = cursor && gripped < 0 ? [...places, cursor] : places;
  halo(context, INK, 1.8, () => {
    ahead.map(onScreen).forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
    if (tool === "area") context.closePath();
  });
  context.fillStyle = INK;
  for (const [x, y] of places.map(onScreen)) context.fillRect(x - 3, y - 3, 6, 6);
}

export const editState = () => {
  const { tool, places, photo, said } = state;
  return { tool, places, photo, said };
};
