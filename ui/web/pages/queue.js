// The queue: a virtual table; only the rows in sight exist.
import { byId, element, learnPoints, number, roleGlyph, shortName, shortPoint, start, stateGlyph, word } from "/pages/words.js";

const ROW = 25;
const STATES = ["review", "all", "open", "dubious", "accepted", "rejected", "unused"];
const COLUMNS = [["point", "point", ""], ["photo", "photo", ""], ["misfit", "misfit", "right"], ["score", "score", "right"], ["doubt", "doubt", ""]];
const KINDS = ["control", "check", "tie", "photo", "fiducial"];
const POINTS = ["control", "check"];
const [POINT, PHOTO, ROLE, STATE, HUMAN, DOUBT, MISFIT, SCORE] = [0, 1, 2, 3, 4, 5, 6, 7];

let rows = [];
let order = [];
let queue = null;
let learnt = 0;
let send = () => {};
const drawn = new Map();
// Rows to be decided together, by key; `anchor` is where a range of them begins.
const marked = new Set();
let anchor = -1;
const keyOf = (index) => JSON.stringify([rows[index][POINT], rows[index][PHOTO]]);
export const markedKeys = () => [...marked].map((key) => JSON.parse(key));

export function clearMarked() {
  if (!marked.size) return false;
  marked.clear();
  showQueue(null, null, null);
  return true;
}

// The current row, on the way to the next one.
export function markCurrent() {
  if (queue && rows[queue.current]) marked.add(keyOf(queue.current));
}

// A click goes there; with Ctrl it marks a row as well, with Shift all up to it.
function pointAt(event, index) {
  const place = queue.shown.indexOf(index);
  if (event.shiftKey) {
    const from = anchor >= 0 ? anchor : Math.max(0, queue.shown.indexOf(queue.current));
    for (let at = Math.min(from, place); at <= Math.max(from, place); at += 1) marked.add(keyOf(queue.shown[at]));
  } else if (event.ctrlKey || event.metaKey) {
    if (!marked.delete(keyOf(index))) marked.add(keyOf(index));
  } else {
    marked.clear();
    send({ kind: "select", key: [rows[index][POINT], rows[index][PHOTO]] });
  }
  anchor = place;
  showQueue(null, null, null);
}

export function setUpQueue(sender) {
  send = sender;
  for (const state of STATES) {
    const mark = state === "all" || state === "review" ? null : stateGlyph(state === "open" ? "auto" : state, 13);
    byId("chips").append(element("button", { class: "chip", "data-state": state, title: word(`state.${state}.long`), onclick: () => sieve({ state }) }, mark, word(`state.${state}`), element("b")));
  }
  fill("sieve-photo", [["", word("photo.all")], ...start.photos.map((name) => [name, shortName(name)])], (photo) => sieve({ photo }));
  fill("sieve-role", [["", word("role.both")], ...KINDS.map((kind) => [kind, word(`role.${kind}`)])], (role) => sieve({ role }));
  fill("sort-column", ["gain", "doubt", "misfit", "score", "photo", "point"].map((name) => [name, word(`sort.${name}`)]), (column) => sort(column, !["photo", "point", "score"].includes(column)));
  byId("sort-column").title = word("sort.by");
  byId("sort-turn").title = word("sort.turn");
  byId("sort-turn").addEventListener("click", () => sort(queue.sort.column, !queue.sort.descending));
  byId("columns").append(element("span"), element("span"));
  for (const [column, name, side] of COLUMNS) {
    const heading = element("span", { class: side, "data-column": column, title: `${word("sort.by")}: ${word(`sort.${column}.long`)}` }, word(`column.${name}`));
    heading.addEventListener("click", () => {
      const same = queue.sort.column === column;
      sort(column, same ? !queue.sort.descending : !["photo", "point", "score"].includes(column));
    });
    byId("columns").append(heading);
  }
  byId("queue-place").title = word("queue.marked.tip");
  byId("table").addEventListener("scroll", draw, { passive: true });
  new ResizeObserver(draw).observe(byId("table"));
}

function fill(name, options, chosen) {
  const select = byId(name);
  for (const [value, text] of options) select.append(element("option", { value }, text));
  select.addEventListener("change", () => { chosen(select.value); select.blur(); });
}

// What a filter lets through is found here at once; the desk hears of it and moves on if need be.
function sieve(change) {
  const filter = { ...queue.filter, ...change };
  send({ kind: "filter", ...filter });
  showQueue(null, { ...queue, filter }, null);
}

const ofKind = (row, filter) => (filter.role ? row[ROLE] === filter.role : POINTS.includes(row[ROLE])) && (!filter.photo || row[PHOTO] === filter.photo);
const inState = (row, state) => state === "all" || (state === "review" ? row[STATE] !== "unused" : row[STATE] === (state === "open" ? "auto" : state));

function sifted() {
  const counts = Object.fromEntries(STATES.map((state) => [state, 0]));
  const kinds = Object.fromEntries(KINDS.map((kind) => [kind, 0]));
  const shown = [];
  for (const index of order) {
    const row = rows[index];
    if (!row) continue;
    if (row[STATE] === "auto" || row[STATE] === "unused") kinds[row[ROLE]] += 1;
    if (!ofKind(row, queue.filter)) continue;
    counts.all += 1;
    counts[row[STATE] === "auto" ? "open" : row[STATE]] += 1;
    if (row[STATE] !== "unused") counts.review += 1;
    if (inState(row, queue.filter.state)) shown.push(index);
  }
  return { counts, kinds, shown };
}

const sort = (column, descending) => send({ kind: "sort", column, descending });

export function showQueue(newRows, newQueue, newOrder) {
  const before = queue ? `${queue.current} ${queue.shown?.indexOf(queue.current)}` : "";
  if (newRows) rows = newRows;
  if (newOrder) order = newOrder;
  if (newQueue) queue = newQueue;
  if (!queue) return;
  if (rows.length !== learnt) learnPoints([...new Set(rows.map((row) => row[POINT]))]);
  learnt = rows.length;
  const { counts, kinds, shown } = sifted();
  Object.assign(queue, { counts, shown, isTaken: new Map(queue.taken ?? []) });
  for (const option of byId("sieve-role").options) {
    if (!POINTS.includes(option.value) && option.value) option.textContent = `${word(`role.${option.value}`)} (${kinds[option.value]})`;
  }
  for (const chip of byId("chips").children) {
    chip.classList.toggle("on", chip.dataset.state === queue.filter.state);
    chip.querySelector("b").textContent = queue.counts[chip.dataset.state];
  }
  byId("sieve-photo").value = queue.filter.photo;
  byId("sieve-role").value = queue.filter.role;
  byId("sort-column").value = queue.sort.column;
  byId("sort-turn").textContent = queue.sort.descending ? "\u2193" : "\u2191";
  for (const heading of byId("columns").children) heading.classList.toggle("by", heading.dataset.column === queue.sort.column);
  const inSight = new Set(marked.size ? shown.map(keyOf) : []);
  for (const key of marked) if (!inSight.has(key)) marked.delete(key);
  const place = queue.shown.indexOf(queue.current);
  byId("queue-place").classList.toggle("many", marked.size > 0);
  byId("queue-place").textContent = marked.size ? word("queue.marked", { count: marked.size }) : word("queue.place", { here: place < 0 ? "\u2013" : place + 1, all: queue.shown.length });
  byId("queue-empty").textContent = start.words[`queue.empty.${queue.filter.role}`] && !counts.all ? word(`queue.empty.${queue.filter.role}`) : word("queue.empty");
  byId("queue-empty").hidden = queue.shown.length > 0;
  byId("rows").style.height = `${queue.shown.length * ROW}px`;
  if (before !== `${queue.current} ${place}`) intoSight(place);
  for (const line of drawn.values()) line.dataset.stale = "1";
  draw();
}

function intoSight(place) {
  const table = byId("table");
  if (place < 0) return;
  const top = place * ROW;
  if (top < table.scrollTop + ROW || top > table.scrollTop + table.clientHeight - 3 * ROW) {
    table.scrollTop = Math.max(0, top - table.clientHeight * 0.4);
  }
}

function draw() {
  if (!queue) return;
  const table = byId("table");
  const first = Math.max(0, Math.floor(table.scrollTop / ROW) - 4);
  const last = Math.min(queue.shown.length, Math.ceil((table.scrollTop + table.clientHeight) / ROW) + 4);
  for (const [place, line] of drawn) {
    if (place < first || place >= last) { line.remove(); drawn.delete(place); }
  }
  for (let place = first; place < last; place += 1) {
    let line = drawn.get(place);
    if (!line) {
      line = element("div", { class: "row" });
      line.style.top = `${place * ROW}px`;
      drawn.set(place, line);
      byId("rows").append(line);
    } else if (!line.dataset.stale) continue;
    delete line.dataset.stale;
    write(line, queue.shown[place]);
  }
}

function write(line, index) {
  const row = rows[index];
  const taken = queue.isTaken.get(index);
  const chosen = marked.has(keyOf(index));
  const shape = JSON.stringify([row, index === queue.current, taken, chosen]);
  if (line.dataset.shape === shape) return;
  line.dataset.shape = shape;
  line.className = `row${index === queue.current ? " current" : ""}${row[HUMAN] ? " human" : ""}${chosen ? " marked" : ""}${taken ? " taken" : ""}`;
  line.dataset.key = `${row[POINT]}|${row[PHOTO]}`;
  line.dataset.state = row[STATE];
  line.title = `${row[POINT]} \u00b7 ${row[PHOTO]} \u00b7 ${word(`role.${row[ROLE]}`)} \u00b7 ${word(`state.${row[STATE]}.long`)}${taken ? ` \u00b7 ${word("people.here", { names: taken })}` : ""}`;
  line.onclick = (event) => pointAt(event, index);
  const bar = element("i");
  bar.style.width = `${Math.round(row[DOUBT] * 100)}%`;
  line.replaceChildren(
    stateGlyph(row[STATE]),
    roleGlyph(row[ROLE], 12),
    element("span", { class: "name" }, shortPoint(row[POINT])),
    element("span", { class: "scan" }, shortName(row[PHOTO])),
    element("span", { class: `right${row[MISFIT] > 3 && row[STATE] !== "unused" ? " large" : ""}` }, number(row[MISFIT], row[MISFIT] >= 100 ? 0 : 2)),
    element("span", { class: "right" }, number(row[SCORE], 2)),
    element("span", { class: "doubt" }, bar),
  );
}
