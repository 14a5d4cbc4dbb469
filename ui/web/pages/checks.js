// Checks: the same detail marked in mosaic and reference, without the program's opinion.
import { again, byId, element, first, focused, renew, start, word } from "./words.js";
import { cleared, crosshair, expectedMark, measuredMark, scaleBar } from "./overlay.js";
import {
  drawLayer, groundFromLayer, layerFromGround, mosaicLayer, onTile, orthoLayer,
} from "./tiles.js";
import { ARROWS, Pane, View, ZOOMS, oncePerFrame, paneElement } from "./view.js";
import { Question, onceRead, undoOrRedo } from "./asked.js";
import { keepMarks, recallMarks } from "./unsaved.js";
import { sitting } from "./people.js";
import { send } from "./wire.js";

const SIDES = ["mosaic", "reference"];
const COLOUR = "#56b4e9";
const RING_PX = 26; // design: round a detail, clear of it
const NUDGE = 0.1; // design: of the finest pixel, as at the desk; with Shift ten times that
const REASONS = ["changed", "hidden", "blurred", "other"];
const state = {
  found: /** @type {CheckSheet | null} */ (null),
  current: "",
  /** Ground marked in mosaic and reference, metres. */
  marks: /** @type {(Pair | null)[]} */ ([null, null]),
  /** What an arrow moves. */
  last: 0,
  cursor: /** @type {{ side: number, at: Pair } | null} */ (null),
  panes: /** @type {Pane[]} */ ([]),
  // design: from the whole block to 60 pixels of the screen for a metre.
  views: [new View(0.02, 60), new View(0.02, 60)],
  scale: 0,
  asking: false,
  /** What stood of a place before it was said not to be identifiable: its answer is awaited. */
  waiting: /** @type {{ decision?: number } | null} */ (null),
  /** Marks that nobody has kept yet, by mosaic and place; and whose they are. */
  drafts: recallMarks(""),
  whose: "",
  /** The reading that was asked about: once more keeps it. */
  doubted: "",
  /** True where marks were left behind in an earlier mosaic. */
  left: false,
  /** Ends a plan that is being drawn, and how far it is. */
  drawing: /** @type {AbortController | null} */ (null),
  drawn: { grid: 0, share: 0 },
  said: "",
};
const question = new Question();
const redraw = oncePerFrame(draw);

/** @param {Pane} pane */
const sideOf = (pane) => state.panes.indexOf(pane);

/** @type {import("./view.js").Hand} */
const HAND = {
  redraw,
  ready: () => Boolean(now()),
  point: (pane, screen) => {
    state.cursor = screen && { side: sideOf(pane), at: pane.layerFromScreen(screen) };
    redraw();
  },
  click: (pane, screen) => put(sideOf(pane), groundFromLayer(pane.layerFromScreen(screen))),
};

export function setUpChecks() {
  onTile(redraw);
  byId("checks").addEventListener("close", () => {
    state.drawing?.abort();
    Object.assign(state, { panes: [], found: null, current: "", said: "", waiting: null });
    send({ kind: "sheet", sheet: "checks", shown: false });
  });
}

/** @param {CheckSheet | undefined} known */
export function openChecks(known) {
  const sheet = byId("checks");
  if (sheet.open) return sheet.close();
  renew(first(".view-body", sheet), element("p", { class: "muted" }, word("wait")));
  sheet.showModal();
  if (known) showChecks(known);
  send({ kind: "sheet", sheet: "checks", shown: true });
}

/** @param {string | undefined} name */
const placeNamed = (name) => state.found?.places.find(({ place }) => place === name);
const now = () => placeNamed(state.current);
const draftName = (name = state.current) => `${state.found?.mosaic?.version} ${name}`;
const isDone = (/** @type {CheckedPlace} */ { state: known }) =>
  known === "read" || known === "unreadable";

/** @param {CheckSheet} found */
export function showChecks(found) {
  const sheet = byId("checks");
  if (!sheet.open) return;
  const [before, shown, whose] = [now(), state.found?.mosaic?.version, sitting()];
  if (whose !== state.whose) Object.assign(state, { whose, drafts: recallMarks(whose) });
  const had = state.drafts.has(draftName());
  state.found = found;
  const renewed = Boolean(before) && shown !== found.mosaic?.version;
  const why = !found.plan ? "checks.none" : found.gone ? "mosaic.gone"
    : !found.mosaic ? "checks.no-mosaic"
    : !start.ortho ? "checks.no-ortho" : "";
  if (why) {
    const close = element("button", { id: "checks-close", onclick: () => sheet.close() },
      word("act.close"));
    const planning = why !== "checks.none" || start.guest ? [] : planPart();
    renew(first(".view-body", sheet), element("header", {}, element("h2", {}, word("checks")),
      element("span", { class: "stretch" }), close), element("p", {}, word(why)), ...planning);
    return;
  }
  if (!state.panes.length) state.panes = state.views.map(room);
  const rooms = () => element("div", { class: "two-panes" }, ...state.panes.map((pane, side) =>
    element("figure", { "data-side": SIDES[side] }, caption(side), pane.room)));
  // A spare that is no longer asked for leaves one at the place that it stood in for.
  const place = now() ?? placeNamed(before?.after)
    ?? found.places.find(({ place: name }) => state.drafts.has(draftName(name)))
    ?? found.places.find((one) => !isDone(one)) ?? found.places[0];
  renew(first(".view-body", sheet), () =>
    [head(found, place), rooms(), ...(state.asking ? [whyNot()] : [])]);
  if (place.place !== state.current || renewed) choose(place, renewed && had);
  else if (state.waiting && place.decision !== state.waiting.decision) goOn();
  redraw();
}

/** The button that begins, or how far it is and the one that cancels. */
function planPart() {
  const { drawing, drawn: { grid, share }, said } = state;
  if (!drawing) {
    return [element("p", {}, element("button", { id: "checks-plan", onclick: plan },
      word("checks.plan"))), element("p", { id: "checks-said", role: "status" }, said)];
  }
  const bar = element("i");
  bar.style.width = `${100 * share}%`;
  return [element("p", { id: "checks-said", role: "status" },
    word("checks.planning", { grid: Math.max(grid, 1) })),
    element("div", { id: "checks-share", class: "share", role: "progressbar",
      "aria-label": word("checks.plan"), "aria-valuenow": Math.round(100 * share) }, bar),
    element("p", {}, element("button", { id: "checks-cancel", onclick: () => drawing.abort() },
      word("remake.cancel")))];
}

/** The places come by the wire; here how far they are, and why there are none. */
async function plan() {
  const drawing = new AbortController();
  Object.assign(state, { drawing, drawn: { grid: 1, share: 0 }, said: "" });
  refresh();
  try {
    const address = `/checks/plan?seat=${encodeURIComponent(start.seat)}`;
    const answer = await fetch(address, { method: "POST", signal: drawing.signal });
    if (!answer.ok) throw new Error(await answer.text());
    await readLines(answer, (line) => {
      if ("share" in line) showDrawn(line);
      state.said = again(line.error ?? "");
    });
  } catch (error) {
    state.said = drawing.signal.aborted ? word("checks.cancelled") : String(error);
  }
  state.drawing = null;
  refresh();
}

/** The button stays the same: a press is not lost. @param {typeof state.drawn} line */
function showDrawn(line) {
  state.drawn = line;
  const [said, share] = planPart();
  document.getElementById("checks-said")?.replaceWith(said);
  document.getElementById("checks-share")?.replaceWith(share);
}

/** @param {Response} answer @param {(line: any) => void} take what each line holds */
async function readLines({ body }, take) {
  const reader = body?.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { done = true, value = "" } = await reader?.read() ?? {};
    if (done) return;
    const lines = (rest + value).split("\n");
    rest = lines.pop() ?? "";
    lines.forEach((line) => take(JSON.parse(line)));
  }
}

/** A picture that takes the keys of its mark. @param {View} view @param {number} side */
function room(view, side) {
  const made = paneElement("check-room");
  const ariaLabel = word(`checks.pane.${SIDES[side]}`);
  Object.assign(made, { tabIndex: 0, role: "application", ariaLabel });
  made.addEventListener("focus", () => {
    state.last = side;
  });
  return new Pane(made, view, HAND);
}

/** @param {number} side */
function caption(side) {
  const surveyed = side === 1 && now()?.surveyed;
  return element("figcaption", {}, word(surveyed ? "checks.surveyed" : `checks.${SIDES[side]}`));
}

/** @param {string} name @param {string} key @param {() => void} does @param {boolean} [off] */
const button = (name, key, does, off = false) => element("button", {
  "data-check": name, disabled: start.guest || off, onclick: does,
}, word(`checks.${name}`), element("kbd", {}, key));

/** @param {CheckedPlace} place */
function stateOf({ after, state: known, reason }) {
  if (state.drafts.has(draftName())) {
    return word(state.marks.every(Boolean) ? "checks.state.draft" : "checks.state.half");
  }
  if (state.left) return word("checks.state.left");
  if (known === "unreadable") return word(`unreadable.${reason}`);
  const beside = placeNamed(after);
  if (known === "read" && beside && beside.state !== "unreadable") {
    return word("checks.state.beside", { place: after });
  }
  return known === "open" && after ? word("checks.state.spare", { place: after })
    : word(`checks.state.${known}`);
}

/** @param {CheckSheet} found @param {CheckedPlace} place */
function head({ places, wanted }, place) {
  const done = places.filter(isDone).length;
  const at = places.indexOf(place) + 1;
  const far = isDoubted() && farOff();
  question.show(far ? state.doubted : "");
  const said = far ? word("checks.far") : stateOf(place);
  return element("header", {}, element("h2", {}, word("checks")),
    element("b", { id: "checks-place" }, place.place),
    element("span", { class: "muted" }, word("checks.at", { at, count: places.length })),
    element("span", {
      id: "checks-state", role: "status", title: said, class: far ? "against" : "",
    }, said),
    element("span", { class: "muted", id: "checks-done" }, word("checks.done", { done, wanted })),
    button("keep", "Y", keep, !state.marks.every(Boolean)),
    button("not", "N", ask),
    element("button", { "data-check": "back", disabled: start.guest || !place.decision,
      onclick: () => send({ kind: "back", decision: place.decision }) }, word("history.back")),
    element("span", { class: "segments" },
      element("button", { "data-step": "back", onclick: () => step(-1) },
        word("act.previous"), element("kbd", {}, "K")),
      element("button", { "data-step": "on", onclick: () => step(1) },
        word("act.next"), element("kbd", {}, "J"))),
    element("button", { "data-check": "fit", onclick: fit }, word("act.fit"),
      element("kbd", {}, "F")),
    element("button", { id: "checks-close", onclick: () => byId("checks").close() },
      word("act.close")));
}

/** Why nothing can be identified: over the pictures, so that they stay where they are. */
const whyNot = () => element("div", { class: "asked-over" }, element("p", {}, word("checks.not")),
  ...REASONS.map((reason, index) => element("button", {
    "data-reason": reason, onclick: () => unreadable(reason),
  }, word(`unreadable.${reason}`), element("kbd", {}, `${index + 1}`))));

function refresh() {
  if (state.found) showChecks(state.found);
}

/** @param {CheckedPlace} place @param {boolean} [left] its marks are of an earlier mosaic */
function choose(place, left = false) {
  const own = place.marks ?? [null, place.surveyed ? place.at : null];
  const last = Math.max(state.panes.findIndex(({ room: pane }) => pane === focused()), 0);
  Object.assign(state, {
    current: place.place, marks: [...state.drafts.get(draftName(place.place)) ?? own], last,
    asking: false, doubted: "", waiting: null, left,
  });
  fit();
  refresh();
}

/** The ground round the place, as it is shown first. */
function fit() {
  const place = now();
  if (!place) return;
  const [width] = state.panes[0].size;
  state.scale = (width || 700) / place.width;
  state.views.forEach((view, side) =>
    view.show(layerFromGround(place.views[side]), state.scale));
  redraw();
}

/** @param {number} side @param {Pair} ground */
function put(side, ground) {
  if (start.guest || (side === 1 && now()?.surveyed)) return;
  state.marks[side] = ground;
  state.last = side;
  draft(state.marks);
  refresh();
}

/** The marks of this place wait, or no longer do. @param {(Pair | null)[] | null} marks */
function draft(marks) {
  if (marks) state.drafts.set(draftName(), marks);
  else state.drafts.delete(draftName());
  keepMarks(state.whose, draftName(), marks);
}

const isDoubted = () => state.doubted !== "" && state.doubted === JSON.stringify(state.marks);

/** Whether the two marks lie further apart than may be expected: nobody is told how far. */
function farOff() {
  const { found, current, marks: [mosaic, reference] } = state;
  const sigmas = found?.sigmas[current];
  if (!found || !sigmas || !mosaic || !reference) return false;
  const ratios = mosaic.map((value, axis) => (value - reference[axis]) / sigmas[axis]);
  return Math.hypot(...ratios) > found.asking;
}

function keep() {
  const [mosaic, reference] = state.marks;
  const place = now();
  if (start.guest || !place || !mosaic || !reference) return;
  if (farOff() && !isDoubted()) {
    state.doubted = JSON.stringify(state.marks);
    return refresh();
  }
  onceRead(() => sendReading(place, mosaic, reference), question);
}

/** @param {CheckedPlace} place @param {Pair} mosaic @param {Pair} reference */
function sendReading(place, mosaic, reference) {
  const round = (/** @type {Pair} */ pair) => pair.map((value) => Math.round(value * 1000) / 1000);
  if (!send({ kind: "check-read", place: place.place, mosaic: round(mosaic),
    reference: round(reference), version: state.found?.mosaic?.version })) return;
  draft(null);
  goOn();
}

/** The question about a reading goes, its marks stay. */
function forget() {
  state.doubted = "";
  refresh();
  redraw();
}

function ask() {
  state.asking = !state.asking;
  refresh();
}

/** @param {string} reason */
function unreadable(reason) {
  state.asking = false;
  // The spare that follows comes with the answer.
  if (send({ kind: "check-read", place: state.current, reason,
    version: state.found?.mosaic?.version })) {
    state.waiting = { decision: now()?.decision };
    draft(null);
  }
  refresh();
}

/**
 * True of a spare that is not asked for once the place is read.
 * @param {CheckedPlace} one @returns {boolean}
 */
function standsForCurrent({ after }) {
  const before = placeNamed(after);
  return after === state.current || Boolean(before && standsForCurrent(before));
}

/** To the next place that is not done; what was just decided is. */
function goOn() {
  const places = state.found?.places ?? [];
  const at = places.findIndex(({ place }) => place === state.current);
  const after = places.slice(at + 1);
  const asked = state.waiting ? after : after.filter((one) => !standsForCurrent(one));
  state.waiting = null;
  const coming = [...asked, ...places.slice(0, at)];
  const next = coming.find((one) => !isDone(one)) ?? coming[0];
  if (next) choose(next);
}

/** @param {number} by */
function step(by) {
  const places = state.found?.places ?? [];
  const at = places.findIndex(({ place }) => place === state.current) + by;
  const next = places[(at + places.length) % places.length];
  if (next) choose(next);
}

/**
 * The mark by arrows; the first one sets it in the middle of the picture that has the focus.
 * @param {Pair} way @param {number} times
 */
function nudge([right, down], times) {
  const { last, views: { [last]: view } } = state;
  const mark = state.marks[last];
  if (start.guest || (last === 1 && now()?.surveyed)) return;
  if (!mark) return put(last, groundFromLayer([view.x, view.y]));
  const metres = NUDGE * times * start.lattice.pixel;
  state.marks[state.last] = [mark[0] + right * metres, mark[1] - down * metres];
  const known = state.drafts.has(draftName());
  draft(state.marks);
  return state.doubted || !known ? forget() : redraw();
}

/** Both pictures at the scale of the one that was zoomed. */
function zoomTogether() {
  const { views } = state;
  const fresh = views.find(({ scale }) => scale !== state.scale) ?? views[0];
  state.scale = fresh.scale;
  for (const view of views) view.scale = fresh.scale;
}

function draw() {
  const place = now();
  const mosaic = state.found?.mosaic;
  if (!place || !mosaic || !state.panes.length) return;
  zoomTogether();
  state.panes.forEach((pane, side) => {
    const [context, width, height] = cleared(pane.picture);
    const size = /** @type {Pair} */ ([width, height]);
    const layer = side ? orthoLayer(false) : mosaicLayer(mosaic, false);
    drawLayer(context, layer, pane.view.frame(size), size);
    const [over] = cleared(pane.marks);
    const onScreen = (/** @type {Pair} */ ground) => pane.screenFromLayer(layerFromGround(ground));
    // The plan is made on the reference: there it shows which detail is meant.
    if (side) expectedMark(over, onScreen(place.at), COLOUR, RING_PX);
    const mark = state.marks[side];
    if (mark) measuredMark(over, onScreen(mark), COLOUR);
    scaleBar(over, size, pane.view.scale, side ? start.ortho_pixel : mosaic.pixel ?? 1);
    const { cursor } = state;
    // Without coordinates: who copies them from one picture to the other reads nothing.
    if (cursor?.side === side) crosshair(over, pane.screenFromLayer(cursor.at), width, height);
  });
}

/** @type {Record<string, (event: KeyboardEvent) => void>} */
const ACTS = {
  KeyY: keep, KeyN: ask, KeyJ: () => step(1), KeyK: () => step(-1), KeyF: fit,
  KeyU: undoOrRedo,
};
const LOOKS = ["KeyJ", "KeyK", "KeyF"];

/** True when the key is ours. @param {KeyboardEvent} event @param {string} letter */
export function checksKey(event, letter) {
  const down = event.type === "keydown";
  if (event.key === "Escape") {
    if (down && state.asking) ask();
    else if (down && state.doubted) forget();
    else if (down) byId("checks").close();
    return true;
  }
  if (ARROWS[event.key]) {
    if (down) nudge(ARROWS[event.key], event.shiftKey ? 10 : 1);
    return true;
  }
  if (ZOOMS[event.key]) {
    if (down) {
      state.views.forEach((view) => view.zoom(ZOOMS[event.key]));
      redraw();
    }
    return true;
  }
  const reason = state.asking ? REASONS[Number(event.key) - 1] : undefined;
  if (reason && down && !event.repeat) unreadable(reason);
  const act = ACTS[letter];
  if (act && down && !event.repeat && !(start.guest && !LOOKS.includes(letter))) act(event);
  return event.key.length === 1;
}

export const checksState = () => {
  const { found, current, marks, panes } = state;
  const toScreen = (/** @type {number} */ side, /** @type {Pair} */ ground) =>
    panes[side]?.screenFromLayer(layerFromGround(ground));
  return { found, current, marks, toScreen };
};
