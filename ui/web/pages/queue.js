// The queue: a virtual table; only the rows in sight exist.
import {
  MARKED_SIGMA, all, byId, element, learnPoints, number, roleGlyph, shortName, shortPoint,
  start, stateGlyph, turn, word,
} from "./words.js";
import { afterPause, letterOf } from "./view.js";
import { finishBefore, isAhead, send } from "./wire.js";

const ROW = 25; // as `.row` in desk.css
const TYPING_MS = 150; // design: a word typed is one search
const MOST_SIGNS = 14; // design: of a scan's name, beside that of a point
const ASIDE = 4; // design: rows beyond the edge of the table, so that scrolling shows no gap
const STATES = ["open", "measure", "second", "all", "disputed", "unchecked", "dubious", "accepted",
  "rejected", "unused"];
const TO_MEASURE = ["predicted", "proposed"];
const RARE = ["measure", "second", "unchecked"]; // shown where there is something in them
const DONE = ["accepted", "rejected", "dubious"];
const COLUMNS = ["point", "photo", "misfit", "score", "doubt"];
const FIGURES = ["misfit", "score"];
const SORTS = ["gain", "doubt", "misfit", "score", "photo", "point", "distance"];
const RISING = ["photo", "point", "score"];
const KINDS = ["control", "check", "new", "tie", "photo", "fiducial"];
const POINTS = ["control", "check", "new"];
const [POINT, PHOTO, ROLE, STATE, HUMAN, DOUBT, MISFIT, SCORE, DISPUTED, SIGMAS, READINGS, EAST,
  NORTH, UNCHECKED] = /** @type {const} */ ([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]);
/** States of the rows behind a filter of another name. @type {Record<string, State>} */
const LOOKS = { open: "auto", measure: "predicted" };
const PLAIN = ["all", "disputed", "second", "unchecked"]; // filters that are no state of a row

const state = {
  rows: /** @type {Row[]} */ ([]),
  order: /** @type {number[]} */ ([]),
  queue: /** @type {SiftedQueue | null} */ (null),
  /** The filter the desk told last, and the one chosen here until the desk is done with it. */
  told: /** @type {Filter | null} */ (null),
  asked: /** @type {Filter | null} */ (null),
  learnt: 0,
  drawn: /** @type {Map<number, HTMLElement>} */ (new Map()),
  /** Rows to be decided together, by key: those kept one by one, and a range from `anchor` on. */
  marked: /** @type {Set<string>} */ (new Set()),
  kept: /** @type {Set<string>} */ (new Set()),
  anchor: "",
  /** True from a sort by hand until it is shown: one looks for the first then. */
  sorted: false,
  /** Hears how many rows are marked. */
  tellMarked: (/** @type {number} */ _count) => {},
  /** Says that what was asked for is about one row. */
  refuse: () => {},
  hidden: false,
};

/** @param {number} index @returns {Key} */
const keyOf = (index) => [state.rows[index][POINT], state.rows[index][PHOTO]];
/** @param {number} index */
const textOf = (index) => JSON.stringify(keyOf(index));

/** @returns {Key[]} */
export const markedKeys = () => [...state.marked].map((key) => JSON.parse(key));

export function clearMarked() {
  if (!state.marked.size) return false;
  state.marked.clear();
  showQueue({});
  return true;
}

/** What is about one row says so while several are marked. @param {() => unknown} act */
export const ofOne = (act) => () => (state.marked.size ? state.refuse() : act());

/**
 * What is marked with a range, both its ends among it, beside what was marked one by one.
 * @param {string[]} shown @param {Iterable<string>} kept @param {number} from @param {number} to
 */
export const extended = (shown, kept, from, to) => new Set([
  ...[...kept].filter((key) => shown.includes(key)),
  ...shown.slice(Math.min(from, to), Math.max(from, to) + 1),
]);

/** All from the anchor up to a row, which is shown then. @param {number} place */
function extendTo(place) {
  const { queue, marked } = state;
  if (!queue || !queue.shown.length) return;
  if (!marked.size) Object.assign(state, { kept: new Set(), anchor: currentText() });
  const shown = queue.shown.map(textOf);
  const from = shown.indexOf(state.anchor);
  state.marked = extended(shown, state.kept, from < 0 ? place : from, place);
  send({ kind: "select", key: keyOf(queue.shown[place]) });
  showQueue({});
}

function currentText() {
  const { queue, rows } = state;
  return queue && rows[queue.current] ? textOf(queue.current) : "";
}

/** @param {KeyboardEvent} event */
function markAll(event) {
  if (!(event.ctrlKey || event.metaKey) || letterOf(event) !== "KeyA") return;
  event.preventDefault();
  const marked = new Set(state.queue?.shown.map(textOf));
  Object.assign(state, { marked, kept: new Set(), anchor: currentText() });
  showQueue({});
}

/**
 * To another row of the list; with Shift all on the way are marked.
 * @param {KeyboardEvent} event
 */
export function walk({ key, shiftKey }) {
  const { current = -1, shown = [] } = state.queue ?? {};
  const [here, last] = [shown.indexOf(current), shown.length - 1];
  const place = { ArrowUp: here - 1, ArrowDown: here + 1, Home: 0, End: last }[key];
  if (place === undefined || last < 0) return;
  const within = Math.min(Math.max(place, 0), last);
  if (shiftKey) return extendTo(within);
  clearMarked();
  send(key.startsWith("Arrow") ? { kind: "step", step: key === "ArrowUp" ? -1 : 1 }
    : { kind: "select", key: keyOf(shown[within]) });
}

/**
 * A click goes there; with Ctrl it marks a row as well, with Shift all up to it.
 * @param {MouseEvent} event @param {number} index
 */
function pointAt(event, index) {
  const { queue, marked } = state;
  if (!queue) return;
  if (event.shiftKey) return extendTo(queue.shown.indexOf(index));
  if (event.ctrlKey || event.metaKey) {
    // The row one stands on is the first of them.
    const first = !marked.size;
    if (first && currentText()) marked.add(currentText());
    if (!(first && index === queue.current) && !marked.delete(textOf(index))) {
      marked.add(textOf(index));
    }
    Object.assign(state, { kept: new Set(marked), anchor: textOf(index) });
  } else {
    marked.clear();
    send({ kind: "select", key: keyOf(index) });
  }
  showQueue({});
}

/**
 * @param {(count: number) => void} tellMarked hears how many rows are marked
 * @param {() => void} refuse says that what was asked for is about one row
 */
export function setUpQueue(tellMarked, refuse) {
  Object.assign(state, { tellMarked, refuse });
  for (const name of STATES) {
    const look = /** @type {State} */ (LOOKS[name] ?? name);
    const mark = PLAIN.includes(name) ? null : stateGlyph(look, 13);
    const title = word(`state.${name}.long`);
    byId("chips").append(element("button",
      { class: "chip", "data-state": name, title, onclick: () => sieve({ state: name }) },
      mark, word(`state.${name}`), element("b")));
  }
  byId("chips").append(element("button",
    { class: "chip", id: "sieve-area", title: word("queue.area.tip"), hidden: true,
      onclick: () => sieveArea([]) },
    word("queue.area"), element("b", {}, "\u00d7")));
  const photos = start.photos.map((name) => [name, shortName(name)]);
  const longest = Math.max(0, ...photos.map(([, name]) => name.length));
  byId("queue").style.setProperty("--scan", `${Math.min(longest, MOST_SIGNS) + 0.5}ch`);
  byId("queue").style.setProperty("--scan-whole", `${longest + 0.5}ch`);
  fill("sieve-photo", [["", word("photo.all")], ...photos], (photo) => sieve({ photo }));
  const kinds = KINDS.map((kind) => [kind, word(`role.${kind}`)]);
  fill("sieve-role", [["", word("role.both")], ...kinds], (role) => sieve({ role }));
  byId("sieve-text").placeholder = word("queue.search");
  byId("sieve-text").addEventListener("input", () => typed(byId("sieve-text").value));
  byId("sieve-text").addEventListener("change", () => byId("sieve-text").blur());
  byId("sieve-text").addEventListener("keydown", ({ key }) => {
    if (key !== "Escape") return;
    if (!byId("sieve-text").value) return byId("sieve-text").blur();
    byId("sieve-text").value = "";
    sieve({ text: "" });
  });
  byId("queue-empty").append(element("button", { id: "queue-all", onclick: showAll },
    word("queue.all"), element("kbd", {}, "A")));
  fill("sort-column", SORTS.map((name) => [name, word(`sort.${name}`)]), sort);
  byId("sort-column").title = word("sort.by");
  byId("sort-turn").title = word("sort.turn");
  byId("sort-turn").addEventListener("click", () => sort(state.queue?.sort.column ?? ""));
  byId("columns").append(element("span"), element("span"));
  for (const column of COLUMNS) {
    const side = FIGURES.includes(column) ? "right" : "";
    const title = `${word("sort.by")}: ${word(`sort.${column}.long`)}`;
    byId("columns").append(element("span",
      { class: side, "data-column": column, title, onclick: () => sort(column) },
      word(`column.${column}`)));
  }
  byId("queue-place").title = word("queue.marked.tip");
  byId("table").addEventListener("keydown", markAll);
  byId("table").addEventListener("scroll", draw, { passive: true });
  new ResizeObserver(resized).observe(byId("table"));
}

/**
 * @param {"sieve-photo" | "sieve-role" | "sort-column"} name @param {string[][]} options
 * @param {(value: string) => void} chosen
 */
function fill(name, options, chosen) {
  const select = byId(name);
  for (const [value, text] of options) select.append(element("option", { value }, text));
  select.addEventListener("change", () => {
    chosen(select.value);
    // Chosen by pointer, the keys are the desk's again; by key one goes on choosing.
    if (!select.matches(":focus-visible")) select.blur();
  });
}

/** By the same column once more: the other way round. @param {string} column */
function sort(column) {
  const { sort: before } = state.queue ?? {};
  const descending = before?.column === column ? !before.descending : !RISING.includes(column);
  state.sorted = true;
  send({ kind: "sort", column, descending });
}

const typed = afterPause((/** @type {string} */ text) => sieve({ text }), TYPING_MS);
// A row that is clicked before the hand has paused is chosen under the name that was typed.
finishBefore(typed.now);

/**
 * What a filter lets through is found here at once; the desk hears of it and moves on if need be.
 * @param {Partial<Filter>} change
 */
function sieve(change) {
  typed.now();
  const { queue } = state;
  if (!queue) return;
  // Sorted before, it is the row that is to be seen now.
  Object.assign(state, { asked: { ...queue.filter, ...change }, sorted: false });
  send({ kind: "filter", ...state.asked });
  showQueue({});
}

/** True when the desk is done with the filter that was chosen here: its own word counts again. */
export const isFilterAnswered = () => Boolean(state.asked) && !isAhead();

/** @param {Filter} filter */
const isNarrowed = ({ area, photo, role, text }) => Boolean(area.length || photo || role || text);

/** No filter at all. */
export const showAll = () => sieve({ state: "all", photo: "", role: "", text: "", area: [] });

/** Only points within an area; without corners, all. @param {Pair[]} area */
export const sieveArea = (area) => sieve({ area });

/** The area of the filter, and where what it lets through lies. */
export function areaShown() {
  const { area = [] } = state.queue?.filter ?? {};
  const places = (state.queue?.shown ?? []).map((index) => placeAt(state.rows[index]));
  return { area, places };
}

/** @param {Row} row @returns {Pair} */
const placeAt = (row) => [row[EAST], row[NORTH]];

/** Whether a line from a place to the east crosses the outline oddly, as `ui/review/state.py`.
 * @param {Pair} place @param {Pair[]} area */
const isWithin = ([east, north], area) => area.reduce((crossed, [e1, n1], i) => {
  const [e2, n2] = area[(i + 1) % area.length];
  const crosses = (n1 > north) !== (n2 > north)
    && east < e1 + ((e2 - e1) * (north - n1)) / (n2 - n1);
  return crosses ? !crossed : crossed;
}, !area.length);

/** By parts of a name, as `ui/review/queue.py`. @param {string} name @param {string} text */
const isNamed = (name, text) =>
  text.toLowerCase().split(" ").every((part) => name.toLowerCase().includes(part));

/** @param {Row} row @param {Filter} filter */
const ofKind = (row, { photo, role, text, area }) => (!photo || row[PHOTO] === photo)
  && (role ? row[ROLE] === role : POINTS.includes(row[ROLE]))
  && (!text || isNamed(row[POINT], text)) && (!area.length || isWithin(placeAt(row), area));

/** @param {Row} row @param {string} wanted */
const inState = (row, wanted) => wanted === "all"
  || (wanted === "second" && isSecond(row))
  || (wanted === "unchecked" && row[UNCHECKED] > 0)
  || (wanted === "disputed" ? row[DISPUTED] !== null : stateName(row) === wanted);

/**
 * Whether a filter lets anything through.
 * @param {{ state?: string, photo?: string, role?: string, area?: Pair[] }} wanted
 */
export function lets({ state: among = "all", photo = "", role = "", area = [] }) {
  const filter = { state: among, photo, role, area, text: "" };
  return state.rows.some((row) => ofKind(row, filter) && inState(row, among));
}

/** Placed by one operator alone. @param {Row} row */
const isSecond = (row) => row[READINGS] === 1 && row[STATE] === "accepted";

/** @param {Row} row */
const stateName = (row) => (row[STATE] === "auto" ? "open"
  : TO_MEASURE.includes(row[STATE]) ? "measure" : row[STATE]);

/**
 * What a filter lets through, in order, and how many there are of each kind and state.
 * @param {Row[]} rows @param {number[]} order @param {Filter} filter
 */
export function sifted(rows, order, filter) {
  const counts = Object.fromEntries([...STATES, "done"].map((name) => [name, 0]));
  const kinds = Object.fromEntries(KINDS.map((kind) => [kind, 0]));
  const shown = order.filter((index) => {
    const row = rows[index];
    if (!row) return false;
    if (row[STATE] === "auto" || row[STATE] === "unused") kinds[row[ROLE]] += 1;
    if (!ofKind(row, filter)) return false;
    counts.all += 1;
    counts[stateName(row)] += 1;
    // A new point that is nothing but a draft is decided by nobody.
    if (row[HUMAN] && DONE.includes(row[STATE])) counts.done += 1;
    if (row[DISPUTED] !== null) counts.disputed += 1;
    if (isSecond(row)) counts.second += 1;
    counts.unchecked += row[UNCHECKED];
    return inState(row, filter.state);
  });
  return { counts, kinds, shown };
}

/** @param {{ rows?: Row[], queue?: Queue, order?: number[] }} fresh what has changed */
export function showQueue(fresh) {
  const before = state.queue ? placeOf(state.queue) : "";
  const { rows, order } = Object.assign(state, { rows: fresh.rows ?? state.rows,
    order: fresh.order ?? state.order });
  const told = fresh.queue ?? state.queue;
  if (!told) return;
  if (fresh.queue) state.told = told.filter;
  // What the desk says of an older filter does not undo the hand's last one.
  if (!isAhead()) state.asked = null;
  told.filter = state.asked ?? state.told ?? told.filter;
  if (rows.length !== state.learnt) learnPoints([...new Set(rows.map((row) => row[POINT]))]);
  state.learnt = rows.length;
  const { counts, kinds, shown } = sifted(rows, order, told.filter);
  const drafted = new Set(told.drafts);
  const queue = Object.assign(told, { counts, shown, drafted, isTaken: new Map(told.taken) });
  state.queue = queue;
  showSieve(queue, kinds);
  showPlace(queue);
  byId("rows").style.height = `${shown.length * ROW}px`;
  if (state.sorted && fresh.order) byId("table").scrollTop = 0;
  else if (before !== placeOf(queue)) intoSight(shown.indexOf(queue.current));
  if (fresh.order) state.sorted = false;
  for (const line of state.drawn.values()) line.dataset.stale = "1";
  draw();
}

/** @param {SiftedQueue} queue */
const placeOf = ({ current, shown }) => `${current} ${shown.indexOf(current)}`;

/** @param {SiftedQueue} queue @param {Record<string, number>} kinds */
function showSieve({ counts, filter, sort: by }, kinds) {
  for (const option of byId("sieve-role").options) {
    const { value } = option;
    if (value && !POINTS.includes(value)) {
      option.textContent = `${word(`role.${value}`)} (${kinds[value]})`;
    }
  }
  byId("sieve-area").hidden = !filter.area.length;
  for (const chip of all("[data-state]", byId("chips"))) {
    const name = chip.dataset.state ?? "";
    turn(chip, name === filter.state);
    chip.hidden = RARE.includes(name) && name !== filter.state && !counts[name];
    chip.lastElementChild?.replaceChildren(`${counts[name]}`);
  }
  byId("sieve-photo").value = filter.photo;
  byId("sieve-role").value = filter.role;
  if (document.activeElement !== byId("sieve-text")) byId("sieve-text").value = filter.text;
  byId("sort-column").value = by.column;
  // The last one is the distance from a place of the mosaic, for those who came from there.
  byId("sort-column").options[SORTS.length - 1].hidden = by.column !== "distance";
  byId("sort-turn").textContent = by.descending ? "\u2193" : "\u2191";
  for (const heading of /** @type {Iterable<HTMLElement>} */ (byId("columns").children)) {
    heading.classList.toggle("by", heading.dataset.column === by.column);
  }
}

/** @param {SiftedQueue} queue */
function showPlace({ current, shown, counts, filter }) {
  const { marked } = state;
  const inSight = new Set(marked.size ? shown.map(textOf) : []);
  for (const key of marked) if (!inSight.has(key)) marked.delete(key);
  state.tellMarked(marked.size);
  const place = shown.indexOf(current);
  const values = { here: place < 0 ? "\u2013" : place + 1, all: shown.length };
  byId("queue-place").classList.toggle("many", marked.size > 0);
  byId("table").classList.toggle("many", marked.size > 0);
  byId("queue-place").textContent = marked.size
    ? word("queue.marked", { count: marked.size }) : word("queue.place", values);
  const measuring = filter.state === "measure";
  const left = measuring ? counts.measure : counts.open;
  const { done } = counts;
  byId("progress").title = byId("progress-said").textContent =
    word(measuring ? "queue.unmeasured" : "queue.progress", { left, done });
  byId("progress-done").style.width = `${(100 * done) / Math.max(done + left, 1)}%`;
  const own = `queue.empty.${filter.role}`;
  const name = start.words[own] && !counts.all ? own
    : (filter.state === "open" || measuring) && done ? "queue.empty.done" : "queue.empty";
  byId("queue-empty-said").textContent = word(name);
  byId("nothing").textContent = word(shown.length ? "compare.none" : name);
  byId("queue-empty").hidden = shown.length > 0;
  byId("queue-all").hidden = !counts.all && !isNarrowed(filter);
}

/** @param {number} place */
function intoSight(place) {
  const table = byId("table");
  if (place < 0) return;
  const top = place * ROW;
  if (top < table.scrollTop + ROW || top > table.scrollTop + table.clientHeight - 3 * ROW) {
    table.scrollTop = Math.max(0, top - table.clientHeight * 0.4);
  }
}

/** What went on while the table was hidden could not scroll it. */
function resized() {
  const { queue, hidden } = state;
  state.hidden = !byId("table").clientHeight;
  if (hidden && !state.hidden && queue) intoSight(queue.shown.indexOf(queue.current));
  draw();
}

function draw() {
  const { queue, drawn } = state;
  if (!queue) return;
  const { scrollTop, clientHeight } = byId("table");
  const first = Math.max(0, Math.floor(scrollTop / ROW) - ASIDE);
  const last = Math.min(queue.shown.length, Math.ceil((scrollTop + clientHeight) / ROW) + ASIDE);
  for (const [place, line] of drawn) {
    if (place >= first && place < last) continue;
    line.remove();
    drawn.delete(place);
  }
  for (let place = first; place < last; place += 1) {
    let line = drawn.get(place);
    if (!line) {
      line = element("div", { class: "row", role: "option", id: `row-${place}` });
      line.style.top = `${place * ROW}px`;
      drawn.set(place, line);
      byId("rows").append(line);
    } else if (!line.dataset.stale) continue;
    delete line.dataset.stale;
    write(line, queue.shown[place], queue);
  }
}

/**
 * A row as it is told: to a second reader nothing of how the first reading lies.
 * @param {Row} row @param {{ state: string }} filter
 */
export function toldRow(row, filter) {
  if (filter.state !== "second") return row;
  const hidden = { [DOUBT]: 0, [MISFIT]: null, [DISPUTED]: null, [SIGMAS]: null };
  return /** @type {Row} */ (/** @type {unknown} */ (Object.assign([...row], hidden)));
}

/** @param {HTMLElement} line @param {number} index @param {SiftedQueue} queue */
function write(line, index, { current, drafted, filter, isTaken }) {
  const row = toldRow(state.rows[index], filter);
  const taken = isTaken.get(index);
  const chosen = state.marked.has(textOf(index));
  const draft = drafted.has(index);
  // The index counts as well: a row that moved in the list is another one to click.
  const many = state.marked.size > 0;
  const shape = JSON.stringify([index, row, index === current, taken, chosen, draft, many]);
  if (line.dataset.shape === shape) return;
  line.dataset.shape = shape;
  const kinds = { current: index === current, human: row[HUMAN], marked: chosen, taken, draft };
  const on = Object.entries(kinds).filter(([, value]) => value).map(([name]) => name);
  line.className = ["row", ...on].join(" ");
  line.dataset.key = `${row[POINT]}|${row[PHOTO]}`;
  line.dataset.state = row[STATE];
  const [role, long] = [word(`role.${row[ROLE]}`), word(`state.${row[STATE]}.long`)];
  const said = [row[POINT], row[PHOTO], role, long];
  if (row[DISPUTED] !== null) said.push(word("doubt.disputed", { value: row[DISPUTED] }));
  if (draft) said.push(word("draft.row"));
  if (taken) said.push(word("people.here", { names: taken }));
  line.title = said.join(" \u00b7 ");
  line.setAttribute("aria-selected", `${many ? chosen : index === current}`);
  if (index === current) byId("table").setAttribute("aria-activedescendant", line.id);
  line.onclick = (event) => pointAt(event, index);
  const bar = element("i");
  bar.style.width = `${Math.round(row[DOUBT] * 100)}%`;
  const misfit = row[MISFIT] ?? 0;
  const byHand = row[SCORE] === null && POINTS.includes(row[ROLE])
    && !TO_MEASURE.includes(row[STATE]);
  const large = (row[SIGMAS] ?? 0) > MARKED_SIGMA && row[STATE] !== "unused" ? " large" : "";
  line.replaceChildren(
    stateGlyph(row[STATE]),
    roleGlyph(row[ROLE], 12),
    element("span", { class: "name" }, shortPoint(row[POINT])),
    element("span", { class: "scan" }, shortName(row[PHOTO])),
    element("span", { class: `right${large}` }, number(row[MISFIT], misfit >= 100 ? 0 : 2)),
    element("span", { class: "right" }, byHand ? word("score.hand") : number(row[SCORE], 2)),
    element("span", { class: "doubt" }, bar));
}
