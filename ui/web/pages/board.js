// The fiducial board: every photo by every fiducial, worst first; one large, to be corrected.
import { undo as takeBack } from "./asked.js";
import {
  again, all, byId, element, first, focused, number, numbers, renew, shortName, start, stateGlyph,
  svg, tip, turn, word,
} from "./words.js";
import {
  closeFiducial, fitFiducial, nudgeFiducial, openFiducial, showFiducial, windowOf, zoomFiducial,
} from "./fiducial.js";
import { filmPart } from "./film.js";
import {
  draftBar, draftMark, draftOf, dropDraft, keepDraft, leaveDrafts, takeDrafts,
} from "./mark_drafts.js";
import { ARROWS, ZOOMS, paneElement } from "./view.js";
import { send } from "./wire.js";

/** @type {Record<FiducialState, State>} */
const LOOKS = {
  used: "auto", filled: "proposed", placed: "accepted", hidden: "rejected", unused: "unused",
  missing: "dubious",
};
const THUMB = 84; // as `.mark .picture` in views.css
const DOUBTFUL = 0.5;
const state = {
  found: /** @type {Board | null} */ (null),
  /** Without a name: the whole scan, in which an example is pointed at. */
  current: /** @type {[photo: string, name: string] | null} */ (null),
  pointed: /** @type {Record<string, Pair>} */ ({}),
  filling: /** @type {Making | null} */ (null),
  tab: "board",
  /** A row that has not changed stays as it is, with its pictures. */
  lines: /** @type {Map<string, { shape: string, made: HTMLElement }>} */ (new Map()),
};

export function setUpBoard() {
  byId("board").addEventListener("close", () => {
    closeFiducial();
    leaveDrafts();
    send({ kind: "sheet", sheet: "board", shown: false });
  });
}

/** @param {Board} [known] @param {string} [tab] */
export function openBoard(known, tab = state.tab) {
  const sheet = byId("board");
  if (sheet.open) return sheet.close();
  state.tab = tab;
  const waiting = element("p", { class: "muted" }, word("wait"));
  first(".view-body", sheet).replaceChildren(waiting);
  sheet.showModal();
  state.found = null;
  if (known) showBoard(known);
  send({ kind: "sheet", sheet: "board", shown: true });
}

/** @param {MarkDraft[]} fresh */
export function showMarkDrafts(fresh) {
  takeDrafts(fresh);
  if (byId("board").open) showDrafts();
}

function showDrafts() {
  tellDrafts();
  showLarge();
}

/** Cells of marks with a draft look so. */
function tellDrafts() {
  for (const button of all(".mark", byId("board"))) {
    const [photo, name] = (button.dataset.mark ?? "").split("|");
    button.classList.toggle("drafted", Boolean(draftOf(photo, name)));
  }
}

function now() {
  const row = state.found?.photos.find(({ photo }) => photo === state.current?.[0]);
  const cell = row?.cells.find(({ name }) => name === state.current?.[1])
    ?? (row && state.current?.[1] === "" ? pointedAt(row) : null);
  return row && cell ? { row, cell } : null;
}

/** The place that was pointed at in a scan, as a mark without a name. @param {ScanRow} row */
const pointedAt = ({ photo }) => /** @type {Fiducial} */ ({
  name: "", state: "missing", place: state.pointed[photo] ?? null, expected: null, residual: null,
  score: null, apart: null, sigma: null, doubt: 0, why: [], said: null,
});

/** Every fiducial, worst first: the order in which J and K go. */
const byDoubt = () => (state.found?.photos ?? [])
  .flatMap(({ photo, cells }) => cells.map(({ name, doubt }) => ({ photo, name, doubt })))
  .sort((a, b) => b.doubt - a.doubt);

/**
 * The order stays while the board is open: decisions do not shuffle it underfoot.
 * @param {Board} fresh
 */
export function showBoard(fresh) {
  const sheet = byId("board");
  if (!sheet.open) return;
  const opened = !state.found;
  // Found by an example: the worst of them comes first.
  const asked = Boolean(state.found) && last(fresh)?.id !== last(state.found)?.id;
  if (state.found && !asked) {
    const place = new Map(state.found.photos.map((row, index) => [row.photo, index]));
    const end = place.size;
    fresh.photos.sort((a, b) => (place.get(a.photo) ?? end) - (place.get(b.photo) ?? end));
  }
  state.found = fresh;
  const worst = byDoubt()[0];
  if ((opened || asked) && fresh.photos.length) {
    state.current = worst ? [worst.photo, worst.name] : null;
  }
  const { scrollTop = 0, scrollLeft = 0 } = sheet.querySelector(".sheet") ?? {};
  const onTable = focused()?.classList.contains("mark");
  renew(first(".view-body", sheet), () => [head(fresh), body(fresh)]);
  const scroller = sheet.querySelector(".sheet");
  if (scroller) Object.assign(scroller, { scrollTop, scrollLeft });
  if (state.current) choose(...state.current, false);
  tellDrafts();
  if (onTable && focused() === document.body) focusCurrent();
  showLarge();
}

/** The example that was shown last. @param {Board | null} found @param {string} [camera] */
const last = (found, camera) =>
  found?.examples.filter((one) => !camera || one.camera === camera).at(-1);

const focusCurrent = () => first(".mark.on", byId("board"))?.focus({ preventScroll: true });

/** @param {Board} found */
function head(found) {
  const doubtful = byDoubt().filter(({ doubt }) => doubt >= DOUBTFUL).length;
  const tab = (/** @type {string} */ name) => element("button", {
    "data-tab": name, class: state.tab === name ? "on" : "",
    "aria-pressed": `${state.tab === name}`,
    onclick: () => {
      state.tab = name;
      showBoard(found);
    },
  }, word(`board.${name}`));
  const remarks = found.photos.reduce((sum, { why }) => sum + why.length, 0);
  const count = word("board.count", { photos: found.photos.length, doubtful, remarks });
  const close = () => byId("board").close();
  return element("header", {}, element("h2", {}, word("board")),
    element("span", { class: "segments" }, tab("board"), tab("film")),
    element("span", { class: "muted" }, count), element("span", { class: "stretch" }),
    element("button", { id: "board-close", onclick: close }, word("act.close")));
}

/** @param {Board} found */
function body(found) {
  const { photos } = found;
  const none = element("p", { class: "muted" }, word("board.none"));
  if (!photos.length) return none;
  if (state.tab === "film") {
    return element("div", { class: "sheet" }, filmPart(found.films, () => showBoard(found)));
  }
  const cameras = [...new Set(photos.map((row) => row.camera))];
  const tables = cameras.map((camera) => {
    const rows = photos.filter((row) => row.camera === camera);
    const title = cameras.length > 1 ? camera : word("quality.photo");
    const heads = rows[0].cells.map((cell) => element("th", {}, cell.name));
    return element("table", { class: "marks", style: `--marks: ${heads.length || 1}` },
      element("thead", {}, element("tr", {}, element("th", { class: "name" }, title), ...heads)),
      element("tbody", {}, ...rows.map(line)));
  });
  const sheet = element("div", { class: "sheet board" }, byDoubt().length ? null : none, ...tables);
  const room = byId("mark-room") ?? element("aside", { id: "mark-room" });
  return element("div", { class: "two-rooms" }, sheet, room);
}

/** @param {ScanRow} row */
function line(row) {
  const shape = JSON.stringify(row);
  const known = state.lines.get(row.photo);
  if (known?.shape === shape) return known.made;
  const made = freshLine(row);
  state.lines.set(row.photo, { shape, made });
  return made;
}

/** @param {ScanRow} row */
const modelOf = (row) => start.words[`board.model.${row.model}`] ?? row.model;

/** @param {ScanRow} row */
function freshLine(row) {
  const rms = row.rms === null ? "" : `, RMS ${number(row.rms, 1)}\u2009\u00b5m`;
  const remarks = row.why.map(again).join("\n\n");
  const doubts = remarks ? element("span", { class: "warned", title: remarks },
    word("board.scan-doubt", { count: row.why.length })) : null;
  const name = element("div", {}, element("b", { title: row.photo }, shortName(row.photo)),
    element("span", { class: "muted" }, `${modelOf(row)}${rms}`), doubts);
  const cells = row.cells.length ? row.cells.map((cell) => element("td", {}, thumb(row, cell)))
    : [element("td", { class: "unmarked" }, word("board.unmarked"))];
  if (!row.certified && start.fill) {
    cells.push(element("td", {}, element("button", {
      class: "mark point", "data-mark": `${row.photo}|`, tabindex: -1, title: tip("board.point"),
      onclick: () => choose(row.photo, ""),
    }, word("board.point"))));
  }
  return element("tr", {}, element("td", { class: "name" }, name), ...cells);
}

/** @param {ScanRow} row @param {Fiducial} cell */
function thumb(row, cell) {
  const middle = cell.place ?? cell.expected;
  const length = cell.residual ? Math.hypot(...cell.residual) : null;
  const off = length === null ? "" : `${number(length, length < 9.95 ? 1 : 0)}\u2009\u00b5m`;
  const score = cell.score === null ? null : number(cell.score, 2);
  const words = cell.state === "hidden" || cell.state === "missing" ? word(`board.${cell.state}`)
    : [off, score].filter(Boolean).join(" \u00b7 ");
  const room = element("span", { class: "picture" });
  if (middle) {
    const view = windowOf(row, middle, row.window, 2 * THUMB);
    const size = { width: THUMB, height: THUMB };
    const picture = element("img", { src: view.address, loading: "lazy", alt: "", ...size });
    room.append(picture, drawing(view, cell));
  }
  const doubt = element("i");
  doubt.style.width = `${100 * cell.doubt}%`;
  return element("button", {
    class: `mark ${cell.state}`, "data-mark": `${row.photo}|${cell.name}`, tabindex: -1,
    title: [word(`board.state.${cell.state}`), ...cell.why.map(again)].join("\n"),
    onclick: () => choose(row.photo, cell.name),
  }, room, element("span", { class: "said" }, stateGlyph(LOOKS[cell.state], 11), words),
  element("span", { class: "doubt" }, doubt));
}

/**
 * The measured place as a cross with an open middle, the expected one as a dashed ring.
 * @param {import("./fiducial.js").ScanWindow} view @param {Fiducial} cell
 */
function drawing(view, cell) {
  const box = svg("svg", { viewBox: `0 0 ${THUMB} ${THUMB}`, width: THUMB, height: THUMB });
  const at = (/** @type {Pair} */ [column, row]) =>
    [column - view.left, row - view.top].map((value) => (value * THUMB) / view.side);
  const { predicted: stroke, states } = start.palette;
  if (cell.expected) {
    const [cx, cy] = at(cell.expected);
    const ring = { cx, cy, r: 9, fill: "none", stroke, "stroke-dasharray": "3 2.4" };
    const near = Math.abs(cx) < 2 * THUMB && Math.abs(cy) < 2 * THUMB;
    if (near) box.append(svg("circle", { ...ring, "stroke-width": 1.3 }));
  }
  if (cell.place) {
    const [x, y] = at(cell.place);
    const d = [[1, 0], [-1, 0], [0, 1], [0, -1]]
      .map(([a, b]) => `M${x + 5 * a} ${y + 5 * b}l${11 * a} ${11 * b}`).join("");
    const ink = states[LOOKS[cell.state]].colour;
    box.append(svg("path", { d, stroke: "#000000a0", "stroke-width": 3.2 }));
    box.append(svg("path", { d, stroke: ink, "stroke-width": 1.5 }));
  }
  return box;
}

/** @param {string} photo @param {string} name */
function choose(photo, name, moving = true) {
  const key = `${photo}|${name}`;
  const before = state.current?.join("|");
  state.current = [photo, name];
  for (const button of all(".mark", byId("board"))) {
    const chosen = button.dataset.mark === key;
    turn(button, chosen);
    button.tabIndex = chosen ? 0 : -1;
    if (chosen && moving) button.scrollIntoView({ block: "nearest", inline: "nearest" });
  }
  if (before !== key || !document.querySelector("#mark-room canvas")) showLarge();
}

/** To a mark, while the board is open. @param {string} photo @param {string} name */
export function chooseMark(photo, name) {
  if (byId("board").open) choose(photo, name);
}

/** @param {ScanRow} row @param {Fiducial} cell */
function figures(row, cell) {
  const pair = (/** @type {Pair | null} */ values, /** @type {number} */ digits) =>
    values && numbers(values, digits);
  const [residual, place] = [pair(cell.residual, 1), pair(cell.place, 2)];
  const rms = row.rms === null ? "\u2013" : `${number(row.rms, 1)}\u2009\u00b5m (${modelOf(row)})`;
  const lines = [
    ["board.state", word(`board.state.${cell.state}`)],
    ["board.residual", residual ? `${residual}\u2009\u00b5m` : "\u2013"],
    ["board.score", number(cell.score, 2)],
    ["board.apart", number(cell.apart, 2, "px")],
    ["board.sigma", number(cell.sigma, 2, "px")],
    ["board.place", place ? `${place}\u2009px` : "\u2013"],
    ["board.rms", rms],
  ];
  return lines.map(([name, value]) => element("div",
    { class: "figure", title: tip(name) },
    element("span", {}, word(name)), element("span", {}, value)));
}

function showLarge() {
  const room = byId("mark-room");
  const shown = now();
  if (!room) return;
  if (!shown) return room.replaceChildren();
  const { row, cell } = shown;
  const act = (
    /** @type {string} */ name, /** @type {string} */ key, /** @type {() => void} */ does,
  ) => element("button", {
    "data-board": name, title: word(`board.${name}.tip`), onclick: does,
    disabled: start.guest || (!cell.name && name !== "undo"),
  }, word(`board.${name}`), element("kbd", {}, key));
  const stepTo = (/** @type {"previous" | "next"} */ name, /** @type {number} */ by) => {
    const title = word(`board.${name}`);
    const arrow = by < 0 ? "\u2039" : "\u203a";
    return element("button",
      { class: "small", title, "aria-label": title, onclick: () => step(by) }, arrow);
  };
  const large = /** @type {HTMLElement | null} */ (room.querySelector(".magnified"))
    ?? paneElement("magnified");
  const draft = draftOf(row.photo, cell.name);
  const doubts = (cell.why.length ? cell.why : row.why.slice(0, 2)).map(again);
  renew(room,
    element("h3", {}, stateGlyph(LOOKS[cell.state], 14),
      element("b", {}, cell.name || word("board.point")),
      element("span", { class: "muted" }, shortName(row.photo)),
      element("span", { class: "stretch" }),
      stepTo("previous", -1), stepTo("next", 1)),
    large,
    ...(draft ? [draftBar(draft, () => drop())] : []),
    element("div", { class: "board-acts" }, act("keep", "Y", () => use(true)),
      act("hide", "V", () => use(false)), act("snap", "Enter", snap),
      act("undo", "U", undo), fillPart()),
    ...(cell.name ? [element("div", { class: "board-figures" }, ...figures(row, cell))] : []),
    ...decided(row, cell.said),
    ...doubts.map((text) => element("p", { class: "doubted" }, text)),
    element("p", { class: "muted" }, word(cell.name ? "board.hint" : "board.point.hint")),
    ...(cell.name ? [element("p", { class: "muted" }, word("board.run"))] : []));
  openFiducial(large, put);
  const { colour } = start.palette.states[LOOKS[cell.state]];
  showFiducial(row, cell, colour, draft?.place ?? null);
}

/** @param {ScanRow} row @param {Fiducial["said"]} said */
function decided(row, said) {
  if (!said) return [];
  const back = () => send({ kind: "back", decision: said.id });
  const values = { who: said.who, when: said.when };
  return [element("p", { class: "decided" }, said.filled ? exampleOf(row) : null,
    word(said.filled ? "board.filled" : "board.said", values),
    element("button", {
      class: "small", disabled: start.guest, onclick: back,
    }, word(said.filled ? "board.fill-back" : "history.back")))];
}

/** The mark that was shown, beside those that were found by it. @param {ScanRow} row */
function exampleOf({ camera }) {
  const example = last(state.found, camera);
  const shown = state.found?.photos.find(({ photo }) => photo === example?.photo);
  if (!example || !shown) return null;
  const { address } = windowOf(shown, example.place, shown.window, 2 * THUMB);
  return element("img", { src: address, width: 44, height: 44, alt: word("board.example") });
}

/** What finds the others, or how far that is. */
function fillPart() {
  const { filling } = state;
  if (!start.fill) return null;
  if (!filling) {
    return element("div", { id: "board-fill" }, element("button", {
      "data-board": "fill", title: tip("board.fill"), onclick: fill,
      disabled: start.guest || !now()?.cell.place,
    }, word("board.fill"), element("kbd", {}, "L")));
  }
  const { share, what, left, cancelling } = filling;
  const done = element("i");
  done.style.width = `${100 * share}%`;
  const time = left === null ? "" : word("remake.left", { seconds: Math.ceil(left) });
  return element("div", { id: "board-fill" }, element("span", { class: "doubt" }, done),
    element("span", { class: "muted" }, [shortName(what), time].filter(Boolean).join(" \u00b7 ")),
    element("button", {
      "data-board": "fill-cancel", disabled: cancelling,
      onclick: () => send({ kind: "cancel", filling: true }),
    }, word("remake.cancel")));
}

/** How far the search by an example is. @param {Making | null} filling */
export function showFilling(filling) {
  if (!filling && !state.filling) return;
  state.filling = filling;
  const fresh = fillPart();
  const room = byId("board-fill");
  if (fresh && room) renew(room, ...fresh.childNodes);
}

/** All marks like the one that is shown, on all scans of the camera. */
function fill() {
  const { row, cell } = now() ?? {};
  if (!row || !cell?.place || state.filling || !start.fill) return;
  send({ kind: "mark", photo: row.photo, name: cell.name, place: cell.place, fill: true });
}

/** @param {Pair} place @param {string} photo @param {string} name */
function put(place, photo, name) {
  if (start.guest) return;
  if (name) return draftMark({ photo, name, place }, showDrafts);
  state.pointed[photo] = place;
  showLarge();
}

/** @param {boolean} wanted */
function use(wanted) {
  const shown = now();
  if (!shown?.cell.name) return;
  const { row: { photo }, cell: { name } } = shown;
  const drafted = wanted && draftOf(photo, name);
  if (!drafted) {
    send({ kind: "mark-use", photo, name, use: wanted });
    return step(1);
  }
  keepDraft(drafted, () => {
    // One that the desk asks about stays in sight.
    if (state.current?.join() === `${photo},${name}` && !draftOf(photo, name)) step(1);
  });
}

/** The draft of the mark that is shown given up; false where there is none. */
function drop() {
  const { row, cell } = now() ?? {};
  if (!row || !cell || !dropDraft(row.photo, cell.name)) return false;
  showDrafts();
  return true;
}

/** What was done last is taken back: the draft that is shown, or a decision. */
function undo() {
  const { row, cell } = now() ?? {};
  return takeBack(row && cell ? { key: [row.photo, cell.name] } : {});
}

function snap() {
  const { row, cell } = now() ?? {};
  if (!row || !cell?.name) return;
  const { photo } = row;
  const place = draftOf(photo, cell.name)?.place ?? cell.place ?? cell.expected;
  if (place) send({ kind: "mark", photo, name: cell.name, place, snap: true });
}

/** To the next doubtful fiducial, or the one before. @param {number} by */
function step(by) {
  const order = byDoubt();
  const [photo, name] = state.current ?? [];
  const here = order.findIndex((one) => one.photo === photo && one.name === name);
  const next = order[Math.min(Math.max(here + by, 0), order.length - 1)];
  if (next) choose(next.photo, next.name);
}

/** @param {number} right @param {number} down cells of the table */
function walk(right, down) {
  const rows = (state.found?.photos ?? []).filter((row) => row.cells.length);
  if (!rows.length) return;
  const at = rows.findIndex((row) => row.photo === state.current?.[0]);
  const row = rows[Math.min(Math.max(at + down, 0), rows.length - 1)];
  const names = rows[Math.max(at, 0)].cells.map((cell) => cell.name);
  const column = Math.max(0, names.indexOf(state.current?.[1] ?? "")) + right;
  choose(row.photo, row.cells[Math.min(Math.max(column, 0), row.cells.length - 1)].name);
  focusCurrent();
}

/** @type {Record<string, (event: KeyboardEvent) => void>} */
const ACTS = {
  KeyY: () => use(true), KeyV: () => use(false), KeyN: () => use(false),
  KeyJ: () => step(1), KeyK: () => step(-1), KeyF: fitFiducial, KeyL: fill,
  KeyU: (event) => event.shiftKey ? send({ kind: "redo" }) : undo(), Enter: snap,
};

/**
 * Keys while the board is open; true when the key is ours.
 * @param {KeyboardEvent} event @param {string} letter
 */
export function boardKey(event, letter) {
  const down = event.type === "keydown";
  if (event.key === "Escape" || letter === "KeyI") {
    const drops = event.key === "Escape" && state.tab === "board";
    if (down && !(drops && drop())) byId("board").close();
    return true;
  }
  if (state.tab !== "board" || !state.found) return event.key.length === 1;
  const arrow = ARROWS[event.key];
  if (arrow) {
    const [right, below] = arrow;
    const far = event.shiftKey ? 1 : 0.1;
    if (down && focused()?.classList.contains("mark")) walk(right, below);
    else if (down) nudgeFiducial(far * right, far * below);
    return true;
  }
  if (ZOOMS[event.key]) {
    if (down) zoomFiducial(ZOOMS[event.key]);
    return true;
  }
  const act = ACTS[letter];
  if (act && down && (!event.repeat || ["KeyJ", "KeyK"].includes(letter))) act(event);
  return Boolean(act) || event.key.length === 1;
}

export const boardState = () =>
  ({ current: state.current, tab: state.tab, found: state.found, pointed: state.pointed });
