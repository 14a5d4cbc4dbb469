// The placing page: the same places clicked in one photo and in the ortho, saved beside the scan.
import {
  again, byId, element, fillWords, first, learnNames, number, renew, shortName, start, word,
} from "./words.js";
import { cleared, crosshair, expectedMark, measuredMark, text } from "./overlay.js";
import {
  drawLayer, groundFromLayer, layerFromGround, onTile, orthoLayer, rawLayer,
} from "./tiles.js";
import { ARROWS, Pane, View, inverse, mapped, oncePerFrame } from "./view.js";
import { listenToKeys } from "./keys.js";
import { nextTheme, setUpTheme } from "./theme.js";
import { keepUnsaved, recallUnsaved } from "./unsaved.js";
import {
  beginRun, cancelButton, post, runLines, runNow, setUpSettings, tell, watchRun,
} from "./run.js";

/** @typedef {"scan" | "ortho"} Side */

const COLOUR = "#56b4e9";
const NUDGED_MS = 400; // design: arrows held down or pressed in a row are one change
const state = {
  panes: /** @type {Record<string, Pane>} */ ({}),
  views: { scan: new View(), ortho: new View() },
  scans: /** @type {ScanToPlace[]} */ ([]),
  scan: /** @type {ScanToPlace | null} */ (null),
  /** Half of the next pair: pixels of the scan, or easting and northing. */
  pending: /** @type {Partial<Record<Side, Pair>>} */ ({}),
  fit: /** @type {PairFit} */ ({}),
  cursor: /** @type {{ side: Side, at: Pair } | null} */ (null),
  /** What an arrow moves. */
  last: /** @type {{ index: number, side: Side } | null} */ (null),
  grip: /** @type {{ index: number, moved: boolean } | null} */ (null),
  wallis: false,
  model: /** @type {"similarity" | "affine"} */ ("similarity"),
  saved: "",
  saving: false,
  /** Photos with saved pairs: without any left, saving gives them back. */
  kept: /** @type {Map<string, string>} */ (new Map()),
  /** Pairs as they were before each change, as JSON. */
  history: /** @type {string[]} */ ([]),
  timers: { nudge: 0 },
};
const redraw = oncePerFrame(draw);
const asked = new URLSearchParams(location.search);
/** Set where the page lies over the desk. */
const desk = window.parent !== window && asked.has("photo") ? window.parent : null;

/** What the chosen model says of the pairs. */
function chosenFit() {
  const { fit, model } = state;
  return model === "affine" ? fit.affine ?? {} : fit;
}

/** @param {Side} side @param {Pair} place */
const layerFrom = (side, place) => (side === "scan" ? place : layerFromGround(place));

/** @param {Pane} pane */
const sideOf = (pane) => /** @type {Side} */ (pane.name);

/** @param {Side} side @param {Pair} place @returns {Pair} */
const onScreen = (side, place) => state.panes[side].screenFromLayer(layerFrom(side, place));

/** @param {Pane} pane @param {Pair} screen */
function placeAt(pane, screen) {
  const place = pane.layerFromScreen(screen);
  return pane.name === "scan" ? place : groundFromLayer(place);
}

/**
 * The ground of a photo, and half as much about it, as far as there is ortho.
 * @param {{ east: number, north: number, pixel: number }} known @param {Pair} size
 */
function lookNear({ east, north, pixel }, size) {
  const { views, panes } = state;
  const middle = layerFromGround([east, north]);
  const whole = [start.lattice.width, start.lattice.height];
  const half = size.map((length) => 0.75 * length * pixel);
  const low = middle.map((place, n) => Math.max(place - half[n], 0));
  const high = middle.map((place, n) => Math.min(place + half[n], whole[n]));
  if (low.every((edge, n) => edge < high[n])) {
    views.ortho.fit(low, high, panes.ortho.size, 0.97);
  } else {
    views.ortho.show(middle, views.scan.scale / pixel / 1.5);
  }
}

/** @param {ScanToPlace} scan */
function choose(scan) {
  const isSaved = state.kept.get(scan.photo) === JSON.stringify(scan.pairs);
  const saved = isSaved ? word("placing.was") : "";
  Object.assign(state, { scan, pending: {}, fit: {}, last: null, history: [], saved });
  fitViews(scan);
  judge();
  show();
}

/** @param {ScanToPlace} scan */
function fitViews(scan) {
  const { views, panes } = state;
  views.scan.fit([0, 0], scan.size, panes.scan.size, 0.97);
  if (scan.known) {
    lookNear(scan.known, scan.size);
  } else if (!views.ortho.scale) {
    const { width, height } = start.lattice;
    views.ortho.fit([0, 0], [width, height], panes.ortho.size, 0.97);
  }
  redraw();
}

async function judge() {
  const { scan } = state;
  if (!scan) return;
  keepUnsaved(state.scans, state.kept);
  const fit = await post(`/fit/${encodeURIComponent(scan.photo)}`, { pairs: scan.pairs });
  if (scan.photo !== state.scan?.photo) return;
  state.fit = fit;
  show();
}

function remember() {
  state.history.push(JSON.stringify(state.scan?.pairs));
  state.saved = "";
}

/** @param {Side} side @param {Pair} place */
function put(side, place) {
  const { scan, pending } = state;
  if (!scan) return;
  if (start.guest) return tell(word("notice.guest"));
  pending[side] = place;
  if (pending.scan && pending.ortho) {
    remember();
    scan.pairs.push([...pending.scan, ...pending.ortho]);
    state.last = { index: scan.pairs.length - 1, side };
    state.pending = {};
    judge();
  }
  show();
}

function takeBack() {
  const { scan, pending, history } = state;
  if (pending.scan || pending.ortho) state.pending = {};
  else if (scan && history.length) {
    scan.pairs = JSON.parse(history.pop() ?? "[]");
    Object.assign(state, { last: null, saved: "" });
    judge();
  } else tell(word("notice.nothing-to-undo"));
  show();
}

/** @param {number} index */
function remove(index) {
  remember();
  state.scan?.pairs.splice(index, 1);
  state.last = null;
  judge();
  show();
}

/** @param {number} index @param {Side} side @param {Pair} place */
function move(index, side, place) {
  state.scan?.pairs[index].splice(side === "scan" ? 0 : 2, 2, ...place);
  state.last = { index, side };
  keepUnsaved(state.scans, state.kept);
  redraw();
}

/** @param {number} right @param {number} down pixels of the picture */
function nudge(right, down) {
  const { scan, last, timers } = state;
  if (!scan || !last || start.guest) return;
  if (!timers.nudge) remember();
  clearTimeout(timers.nudge);
  const [x, y] = halfOf(scan.pairs[last.index], last.side);
  const unit = start.ortho_pixel;
  const moved = last.side === "scan" ? [x + right, y + down] : [x + right * unit, y - down * unit];
  move(last.index, last.side, moved);
  timers.nudge = setTimeout(() => {
    timers.nudge = 0;
    judge();
  }, NUDGED_MS);
}

/** @param {number[]} pair @param {Side} side */
const halfOf = (pair, side) => (side === "scan" ? pair.slice(0, 2) : pair.slice(2));

/** @param {ScanToPlace} scan */
const isNothing = ({ photo, pairs }) => !pairs.length && !state.kept.has(photo);

async function save() {
  const { scan, kept } = state;
  if (!scan || start.guest || isNothing(scan)) return;
  const seat = encodeURIComponent(asked.get("seat") ?? "");
  const address = `/points/${encodeURIComponent(scan.photo)}?seat=${seat}`;
  const sent = JSON.stringify(scan.pairs);
  if (state.saving) return tell(word("notice.ahead"));
  state.saving = true;
  const answer = await post(address, { pairs: scan.pairs });
  state.saving = false;
  if (!answer.ok) return tell(answer.error, true);
  const { saved: file } = answer;
  if (file) kept.set(scan.photo, sent);
  else kept.delete(scan.photo);
  keepUnsaved(state.scans, kept);
  const said = desk ? ["placing.decided", "placing.given-back"]
    : ["placing.saved", "placing.removed"];
  const told = word(said[file ? 0 : 1], { file });
  // What a hand has moved since, and another scan, are not what was saved.
  if (state.scan === scan && JSON.stringify(scan.pairs) === sent) state.saved = told;
  tell(told);
  show();
}

async function writeWorldFile() {
  const { scan, model } = state;
  if (!scan || start.guest) return;
  const address = `/world/${encodeURIComponent(scan.photo)}?model=${model}`;
  const answer = await post(address, { pairs: scan.pairs });
  if (answer.ok) tell(word("placing.world.written", { file: answer.written }));
  else tell(answer.error, true);
}

/** @param {"similarity" | "affine"} model */
function choosePlan(model) {
  state.model = model;
  show();
}

/** A click sets half a pair, a mark is dragged. @type {import("./view.js").Hand} */
const HAND = {
  redraw,
  grips: (pane, [x, y]) => {
    state.grip = null;
    if (start.guest) return false;
    state.scan?.pairs.forEach((pair, index) => {
      const [px, py] = onScreen(sideOf(pane), halfOf(pair, sideOf(pane)));
      if (Math.hypot(px - x, py - y) < 12) state.grip = { index, moved: false };
    });
    return state.grip !== null;
  },
  drag: (pane, screen) => {
    const { grip } = state;
    if (!screen || !grip) return;
    if (!grip.moved) remember();
    grip.moved = true;
    move(grip.index, sideOf(pane), placeAt(pane, screen));
  },
  drop: judge,
  click: (pane, screen) => put(sideOf(pane), placeAt(pane, screen)),
  point: (pane, screen) => {
    state.cursor = screen && { side: sideOf(pane), at: placeAt(pane, screen) };
    redraw();
  },
};

function draw() {
  const { scan, panes, pending, last, cursor, wallis } = state;
  if (!scan) return;
  for (const [name, pane] of Object.entries(panes)) {
    const side = /** @type {Side} */ (name);
    const [context, width, height] = cleared(pane.picture);
    const layer = side === "scan" ? rawLayer(scan.photo, scan.version, scan.size, wallis)
      : orthoLayer(wallis);
    drawLayer(context, layer, pane.view.frame([width, height]), [width, height]);
    const [over] = cleared(pane.marks);
    scan.pairs.forEach((pair, index) => {
      const colour = last?.index === index ? "#ffffff" : COLOUR;
      numbered(over, onScreen(side, halfOf(pair, side)), index + 1, colour);
    });
    const half = pending[side];
    if (half) numbered(over, onScreen(side, half), scan.pairs.length + 1, start.palette.peak);
    if (cursor?.side === side) crosshair(over, onScreen(side, cursor.at), width, height);
    guide(over, side);
    pane.label.textContent = side === "ortho" ? word("pane.ortho")
      : word("pane.raw", { scan: shortName(scan.photo) });
    const at = cursor?.side === side ? cursor.at : [];
    pane.where.textContent = at.map((value) => number(value, 1)).join("  ");
    pane.room.classList.toggle("wanted", Boolean(pending.scan || pending.ortho) && !half);
  }
}

/** @param {Context} context @param {Pair} place @param {number} count @param {string} colour */
function numbered(context, place, count, colour) {
  measuredMark(context, place, colour);
  text(context, `${count}`, [place[0] + 9, place[1] - 9], colour);
}

/**
 * Where the pairs so far put what the other picture's cursor, or half a pair, points at.
 * @param {Context} context @param {Side} side
 */
function guide(context, side) {
  const { pending, cursor } = state;
  const { matrix } = chosenFit();
  const other = side === "scan" ? "ortho" : "scan";
  const from = pending[other] ?? (cursor?.side === other ? cursor.at : null);
  if (!from || !matrix) return;
  const place = mapped(side === "scan" ? inverse(matrix) : matrix, from);
  expectedMark(context, onScreen(side, place), start.palette.predicted, 12);
}

function show() {
  if (!state.scan) return;
  showScans(state.scan);
  showPairs(state.scan);
  showRun();
  redraw();
}

/** @param {ScanToPlace} scan */
function showScans(scan) {
  const lines = state.scans.map((one) => {
    const { photo, pairs: { length: count }, known } = one;
    const place = known ? "" : word("placing.unknown");
    const said = count ? word("placing.pairs.count", { count }) : place;
    const kind = `scan${one === scan ? " on" : ""}`;
    return element("button",
      { class: kind, "data-scan": photo, title: photo, onclick: () => choose(one) },
      element("span", {}, shortName(photo)), element("span", { class: "muted" }, said));
  });
  renew(byId("placing-scans"), element("h2", {}, word("placing.scans")),
    element("div", { class: "scans" }, ...lines));
}

/** @param {ScanToPlace} scan */
function showPairs(scan) {
  const { fit, pending, saved, wallis } = state;
  const count = scan.pairs.length;
  const next = pending.scan ? "ortho" : pending.ortho ? "scan"
    : count < 2 ? "click" : count < 3 ? "enough" : "many";
  const heads = ["", "placing.pixel", "placing.ground", "placing.residual", ""]
    .map((name) => element("th", {}, name && word(name)));
  const lines = scan.pairs.map(pairLine);
  if (count) lines.unshift(element("tr", {}, ...heads));
  const doubts = [scan.why, fit.why].filter(Boolean);
  const act = (
    /** @type {string} */ name, /** @type {string} */ letter, /** @type {object} */ attributes,
  ) => element("button", { ...attributes }, word(name), element("kbd", {}, letter));
  renew(byId("placing-pairs"),
    element("h2", {}, word("placing.pairs", { scan: shortName(scan.photo) })),
    element("p", { class: "next" }, word(`placing.now.${next}`)),
    element("table", {}, ...lines), ...figures(count),
    ...doubts.map((why) => element("p", { class: "doubted" }, again(why ?? ""))),
    element("div", { class: "acts" },
      act("placing.save", "S", {
        id: "placing-save", class: count > 1 && !saved ? "on" : "",
        disabled: start.guest || count === 1 || isNothing(scan), onclick: save,
      }),
      act("act.undo", "U", { disabled: start.guest, onclick: takeBack }),
      act("wallis", "W",
        { class: wallis ? "on" : "", "aria-pressed": `${wallis}`, title: word("wallis.tip"),
          onclick: switchWallis }),
      ...(desk ? [act("placing.world", "T", {
        id: "placing-world", disabled: start.guest || !chosenFit().matrix, onclick: writeWorldFile,
      })] : []),
      act("act.fit", "F", { onclick: () => fitViews(scan) })),
    element("p", { class: "muted" }, saved || word("placing.hint")));
}

/** @param {number[]} pair @param {number} index */
function pairLine(pair, index) {
  const off = chosenFit().residuals?.[index];
  const [column, row, east, north] = pair.map((value) => number(value, 1));
  return element("tr", {}, element("td", {}, `${index + 1}`),
    element("td", {}, `${column}, ${row}`), element("td", {}, `${east}, ${north}`),
    element("td", { class: "off" }, off ? number(Math.hypot(...off), 1, "m") : "\u2013"),
    element("td", {}, element("button", {
      class: "small", disabled: start.guest, title: word("placing.remove"),
      onclick: () => remove(index),
    }, "\u00d7")));
}

/** What the pairs say together. @param {number} count of pairs */
function figures(count) {
  const { fit } = state;
  const [scale, pixel] = [number(fit.scale, 0), number(fit.pixel_m, 2)];
  const values = { scale, pixel, turn: number(fit.turn_deg, 0) };
  /** @type {HTMLElement[]} */
  const shown = fit.matrix ? [element("p", {}, word("placing.figures", values))] : [];
  if (fit.affine) {
    const model = (/** @type {"similarity" | "affine"} */ name) => element("button", {
      "data-model": name, class: state.model === name ? "on" : "",
      "aria-pressed": `${state.model === name}`, onclick: () => choosePlan(name),
    }, word(`board.model.${name}`));
    shown.push(element("span", { class: "segments" }, model("similarity"), model("affine")));
  }
  const { rms } = chosenFit();
  if (rms !== null && rms !== undefined) {
    const said = `placing.rms.${state.model}`;
    shown.push(element("p", {}, word(said, { rms: number(rms, 1), count: fit.count })));
  } else if (count === 2) shown.push(element("p", { class: "muted" }, word("placing.two")));
  return shown;
}

function switchWallis() {
  state.wallis = !state.wallis;
  show();
}

function showRun() {
  const { saved, scans } = state;
  const { state: now } = runNow();
  const ready = scans.some((one) => one.pairs.length > 1) && saved;
  const rerun = {
    id: "placing-start", disabled: start.guest || now === "done",
    class: ready ? "on" : "", onclick: beginRun,
  };
  const button = now === "running"
    ? cancelButton()
    : element("button", rerun, word("placing.run"));
  renew(byId("placing-run"),
    element("h2", {}, word("placing.run.title")), ...runLines("placing.done"),
    element("div", { class: "acts" }, button),
    element("p", { class: "muted" }, word("placing.run.hint", { command: start.command })));
}

/** @type {Record<string, () => unknown>} */
const ACTS = {
  s: save, t: () => desk && chosenFit().matrix && writeWorldFile(), u: takeBack, w: switchWallis,
  j: () => step(1), k: () => step(-1), f: () => state.scan && fitViews(state.scan),
  Escape: () => {
    if (desk && !state.pending.scan && !state.pending.ortho) return desk.gruberPlaced?.();
    state.pending = {};
    show();
  },
  Delete: () => state.last && remove(state.last.index),
};

const REPEATS = new Set(["j", "k"]);

/** @param {number} by */
function step(by) {
  const { scans, scan } = state;
  if (!scan) return;
  const next = scans[Math.min(Math.max(scans.indexOf(scan) + by, 0), scans.length - 1)];
  if (next !== scan) choose(next);
}

/** @param {KeyboardEvent} event */
function takeKey(event) {
  if (event.type !== "keydown" || !state.scan) return false;
  const [right, down] = ARROWS[event.key] ?? [0, 0];
  const far = event.shiftKey ? 10 : 1;
  const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const act = right || down ? () => nudge(far * right, far * down) : ACTS[name];
  if (act && (!event.repeat || right || down || REPEATS.has(name))) act();
  return Boolean(act);
}

async function open() {
  Object.assign(start, await (await fetch("/start")).json());
  if (desk) Object.assign(start, await (await fetch("/placing")).json());
  document.body.classList.toggle("embedded", Boolean(desk));
  const scans = start.scans;
  state.scans = scans;
  state.kept = new Map(scans.filter(({ pairs }) => pairs.length)
    .map(({ photo, pairs }) => [photo, JSON.stringify(pairs)]));
  for (const said of recallUnsaved(scans, state.kept)) tell(said);
  learnNames(scans.map((one) => one.photo));
  document.title = `${start.name} \u00b7 ${word("placing")}`;
  fillWords();
  byId("name").textContent = document.title;
  byId("placing-why").textContent = word(desk ? "placing.anew" : "placing.why");
  // design: from the whole picture to 40 pixels of the screen for one of it.
  state.views = { scan: new View(0.001, 40), ortho: new View(0.001, 40 / start.ortho_pixel) };
  for (const side of /** @type {Side[]} */ (["scan", "ortho"])) {
    state.panes[side] = new Pane(first(`.pane[data-pane=${side}]`), state.views[side], HAND);
  }
  onTile(redraw);
  setUpTheme();
  setUpSettings();
  first("[data-act=theme]").addEventListener("click", nextTheme);
  byId("placing-close").addEventListener("click", () => desk?.gruberPlaced?.());
  listenToKeys(takeKey);
  if (window.frameElement) {
    /** @type {HTMLElement} */ (window.frameElement).inert = false;
    window.focus();
  }
  const wanted = scans.find((one) => one.photo === asked.get("photo"));
  choose(wanted ?? scans.find((one) => one.pairs.length) ?? scans[0]);
  const place = () => {
    const { scan, fit, views, pending, saved } = state;
    return { scan, fit, views, pending, run: runNow(), saved };
  };
  window.gruber = { place, toScreen: onScreen };
  watchRun(showRun);
}

open().catch((error) => {
  document.body.textContent = String(error);
});
