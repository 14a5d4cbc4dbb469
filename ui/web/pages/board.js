// The fiducial board: every photo by every mark, worst first; one mark large, to be corrected.
import { byId, element, number, shortName, start, stateGlyph, word } from "/pages/words.js";
import { closeMark, fitMark, lookAt, nudgeMark, openMark, zoomMark } from "/pages/mark.js";
import { filmPart } from "/pages/film.js";

const LOOKS = { used: "auto", placed: "accepted", hidden: "rejected", unused: "unused", missing: "dubious" };
const THUMB = 84;
let send = () => {};
let found = null;
let current = null; // [photo, mark]
let tab = "board";

export function setUpBoard(sender) {
  send = sender;
  byId("board").addEventListener("close", () => { closeMark(); send({ kind: "sheet", sheet: "board", shown: false }); });
}

export function openBoard(known) {
  const sheet = byId("board");
  if (sheet.open) { sheet.close(); return; }
  insideOf(sheet).replaceChildren(element("p", { class: "muted" }, word("quality.wait")));
  sheet.showModal();
  found = null;
  if (known) showBoard(known);
  send({ kind: "sheet", sheet: "board", shown: true });
}

const insideOf = (sheet) => sheet.querySelector(".view-body");
const rowOf = (name) => found?.photos.find((row) => row.photo === name);
const cellOf = (row, name) => row?.cells.find((cell) => cell.name === name);
const now = () => { const row = current && rowOf(current[0]); const cell = row && cellOf(row, current[1]); return cell ? { row, cell } : null; };
// Every mark, worst first: the order in which J and K go.
const byDoubt = () => found.photos.flatMap((row) => row.cells.map((cell) => [row.photo, cell.name, cell.doubt])).sort((a, b) => b[2] - a[2]);

// The order stays while the board is open: decisions do not shuffle it underfoot.
export function showBoard(fresh) {
  const sheet = byId("board");
  if (!sheet.open) return;
  if (found) {
    const place = new Map(found.photos.map((row, index) => [row.photo, index]));
    fresh.photos.sort((a, b) => (place.get(a.photo) ?? 1e6) - (place.get(b.photo) ?? 1e6));
  }
  const first = !found;
  found = fresh;
  if (first && found.photos.length) current = byDoubt()[0]?.slice(0, 2) ?? null;
  const [top, left] = [sheet.querySelector(".sheet")?.scrollTop ?? 0, sheet.querySelector(".sheet")?.scrollLeft ?? 0];
  const onTable = document.activeElement?.classList.contains("mark");
  insideOf(sheet).replaceChildren(head(), body());
  const scroller = sheet.querySelector(".sheet");
  if (scroller) Object.assign(scroller, { scrollTop: top, scrollLeft: left });
  if (current) choose(...current, false);
  if (onTable) sheet.querySelector(".mark.on")?.focus({ preventScroll: true });
  showLarge();
}

function head() {
  const tabs = ["board", "film"].map((name) => element("button", { "data-tab": name, class: tab === name ? "on" : "", onclick: () => { tab = name; showBoard(found); } }, word(`board.${name}`)));
  const doubtful = byDoubt().filter((item) => item[2] >= 0.5).length;
  return element("header", {}, element("h2", {}, word("board")), element("span", { class: "segments" }, ...tabs),
    element("span", { class: "muted" }, word("board.count", { photos: found.photos.length, doubtful })),
    element("span", { class: "stretch" }),
    element("button", { id: "board-close", onclick: () => byId("board").close() }, word("act.refuse")));
}

function body() {
  if (!found.photos.length) return element("p", { class: "muted" }, word("board.none"));
  if (tab === "film") return element("div", { class: "sheet" }, filmPart(found, () => showBoard(found)));
  const cameras = [...new Set(found.photos.map((row) => row.camera))];
  const tables = cameras.map((camera) => {
    const rows = found.photos.filter((row) => row.camera === camera);
    const heads = rows[0].cells.map((cell) => element("th", {}, cell.name));
    return element("table", { class: "marks" }, element("thead", {}, element("tr", {}, element("th", { class: "name" }, cameras.length > 1 ? camera : word("quality.photo")), ...heads)), element("tbody", {}, ...rows.map(line)));
  });
  const none = byDoubt().length ? [] : [element("p", { class: "muted" }, word("board.none"))];
  return element("div", { class: "two-rooms" }, element("div", { class: "sheet" }, ...none, ...tables), byId("mark-room") ?? element("aside", { id: "mark-room" }));
}

const kept = new Map();

// A row that has not changed stays as it is, with its pictures.
function line(row) {
  const shape = JSON.stringify(row);
  if (kept.get(row.photo)?.shape !== shape) kept.set(row.photo, { shape, made: freshLine(row) });
  return kept.get(row.photo).made;
}

function freshLine(row) {
  const model = start.words[`board.model.${row.model}`] ?? row.model;
  const said = [element("b", { title: row.photo }, shortName(row.photo)), element("span", { class: "muted" }, row.rms === null ? model : `${model}, RMS ${number(row.rms, 1)}\u2009\u00b5m`)];
  if (row.why.length) said.push(element("span", { class: "warned", title: row.why.join("\n\n") }, word("board.scan-doubt", { count: row.why.length })));
  return element("tr", {}, element("td", { class: "name" }, element("div", {}, ...said)), ...(row.cells.length ? row.cells.map((cell) => element("td", {}, thumb(row, cell))) : [element("td", { class: "unmarked" }, word("board.unmarked"))]));
}

// Integer corner and power of two, so that the page knows where every pixel of the picture lies.
export function windowOf(row, middle, side, pixels) {
  const reduction = 2 ** Math.max(0, Math.floor(Math.log2(side / pixels)));
  const across = Math.max(1, Math.round(side / reduction));
  const [left, top] = middle.map((value) => Math.round(value - (across * reduction) / 2));
  const address = `/tiles/near/${encodeURIComponent(row.photo)}/${row.version}/${left}/${top}/${across}/${reduction}?e=${start.edition}`;
  return { left, top, side: across * reduction, address };
}

function thumb(row, cell) {
  const middle = cell.place ?? cell.expected;
  const length = cell.residual ? Math.hypot(...cell.residual) : null;
  const words = cell.state === "hidden" ? word("board.hidden") : cell.state === "missing" ? word("board.missing")
    : [length === null ? null : `${number(length, 0)}\u2009\u00b5m`, cell.score === null ? null : number(cell.score, 2)].filter(Boolean).join(" \u00b7 ");
  const button = element("button", { class: `mark ${cell.state}`, "data-mark": `${row.photo}|${cell.name}`, title: [word(`board.state.${cell.state}`), ...cell.why].join("\n"), tabindex: -1, onclick: () => choose(row.photo, cell.name) });
  const room = element("span", { class: "picture" });
  if (middle) {
    const view = windowOf(row, middle, row.window, 2 * THUMB);
    room.append(element("img", { src: view.address, loading: "lazy", alt: "", width: THUMB, height: THUMB }), drawn(view, cell));
  }
  const doubt = element("i");
  doubt.style.width = `${100 * cell.doubt}%`;
  button.append(room, element("span", { class: "said" }, stateGlyph(LOOKS[cell.state], 11), words), element("span", { class: "doubt" }, doubt));
  return button;
}

function svg(tag, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

// The measured place as a cross with an open middle, the expected one as a dashed ring.
function drawn(view, cell) {
  const box = svg("svg", { viewBox: `0 0 ${THUMB} ${THUMB}`, width: THUMB, height: THUMB });
  const at = ([column, row]) => [((column - view.left) * THUMB) / view.side, ((row - view.top) * THUMB) / view.side];
  const palette = start.palette;
  if (cell.expected) {
    const [x, y] = at(cell.expected);
    if (Math.abs(x) < 2 * THUMB && Math.abs(y) < 2 * THUMB) box.append(svg("circle", { cx: x, cy: y, r: 9, fill: "none", stroke: palette.predicted, "stroke-dasharray": "3 2.4", "stroke-width": 1.3 }));
  }
  if (cell.place) {
    const [x, y] = at(cell.place);
    const path = [[1, 0], [-1, 0], [0, 1], [0, -1]].map(([a, b]) => `M${x + 5 * a} ${y + 5 * b}l${11 * a} ${11 * b}`).join("");
    box.append(svg("path", { d: path, stroke: "#000000a0", "stroke-width": 3.2 }), svg("path", { d: path, stroke: palette.states[LOOKS[cell.state]].colour, "stroke-width": 1.5 }));
  }
  return box;
}

function choose(photo, name, moving = true) {
  const before = current?.join("|");
  current = [photo, name];
  for (const button of byId("board").querySelectorAll(".mark.on")) { button.classList.remove("on"); button.tabIndex = -1; }
  const button = [...byId("board").querySelectorAll(".mark")].find((one) => one.dataset.mark === current.join("|"));
  button?.classList.add("on");
  if (button) button.tabIndex = 0;
  if (moving) button?.scrollIntoView({ block: "nearest", inline: "nearest" });
  if (before !== current.join("|") || !document.querySelector("#mark-room canvas")) showLarge();
}

function figures({ row, cell }) {
  const lines = [
    ["board.state", word(`board.state.${cell.state}`)],
    ["board.residual", cell.residual ? `${number(cell.residual[0], 1)}, ${number(cell.residual[1], 1)}\u2009\u00b5m` : "\u2013"],
    ["board.score", number(cell.score, 2)],
    ["board.apart", number(cell.apart, 2, "px")],
    ["board.sigma", number(cell.sigma, 2, "px")],
    ["board.place", cell.place ? `${number(cell.place[0], 2)}, ${number(cell.place[1], 2)}\u2009px` : "\u2013"],
    ["board.rms", row.rms === null ? "\u2013" : `${number(row.rms, 1)}\u2009\u00b5m (${start.words[`board.model.${row.model}`] ?? row.model})`],
  ];
  return lines.map(([name, value]) => element("div", { class: "figure", title: start.words[`${name}.tip`] ?? null }, element("span", {}, word(name)), element("span", {}, value)));
}

function showLarge() {
  const room = byId("mark-room");
  const shown = now();
  if (!room) return;
  if (!shown) { room.replaceChildren(); return; }
  const { row, cell } = shown;
  const acts = [["keep", "Y", () => use(true)], ["hide", "V", () => use(false)], ["snap", "Enter", snap], ["undo", "U", () => send({ kind: "undo" })]];
  const buttons = acts.map(([name, key, act]) => element("button", { "data-board": name, title: word(`board.${name}.tip`), disabled: start.guest, onclick: (event) => { act(); event.target.blur(); } }, word(`board.${name}`), element("kbd", {}, key)));
  const said = cell.said ? [element("p", { class: "decided" }, word("board.said", { who: cell.said.who, when: cell.said.when.replace("T", " ") }), element("button", { class: "small", disabled: start.guest, onclick: () => send({ kind: "back", decision: cell.said.id }) }, word("history.back")))] : [];
  const canvasRoom = room.querySelector(".magnified") ?? element("div", { class: "magnified pane" }, element("canvas", { class: "picture" }), element("canvas", { class: "marks" }), element("span", { class: "where" }));
  room.replaceChildren(
    element("h3", {}, stateGlyph(LOOKS[cell.state], 14), element("b", {}, cell.name), element("span", { class: "muted" }, shortName(row.photo)), element("span", { class: "stretch" }),
      element("button", { class: "small", title: word("board.previous"), onclick: () => step(-1) }, "\u2039"), element("button", { class: "small", title: word("board.next"), onclick: () => step(1) }, "\u203a")),
    canvasRoom, element("div", { class: "board-acts" }, ...buttons),
    element("div", { class: "board-figures" }, ...figures(shown)), ...said,
    ...cell.why.map((text) => element("p", { class: "doubted" }, text)),
    ...(cell.why.length ? [] : row.why.slice(0, 2).map((text) => element("p", { class: "doubted" }, text))),
    element("p", { class: "muted" }, word("board.hint")), element("p", { class: "muted" }, word("board.run")));
  openMark(canvasRoom, (place) => put(place));
  lookAt(row, cell, start.palette.states[LOOKS[cell.state]].colour);
}

function put(place, snapped = false) {
  const shown = now();
  if (shown) send({ kind: "mark", photo: shown.row.photo, name: shown.cell.name, place, snap: snapped });
}

function use(wanted) {
  const shown = now();
  if (!shown) return;
  send({ kind: "mark-use", photo: shown.row.photo, name: shown.cell.name, use: wanted });
  step(1);
}

function snap() {
  const shown = now();
  const place = shown && (shown.cell.place ?? shown.cell.expected);
  if (place) put(place, true);
}

// To the next doubtful mark, or the one before.
function step(by) {
  const order = byDoubt();
  const here = order.findIndex(([photo, name]) => current && photo === current[0] && name === current[1]);
  if (!order.length) return;
  const next = order[Math.min(Math.max(here + by, 0), order.length - 1)];
  choose(next[0], next[1]);
}

function walk(right, down) {
  const rows = found.photos.filter((row) => row.cells.length);
  if (!rows.length) return;
  const at = rows.findIndex((row) => row.photo === current?.[0]);
  const row = rows[Math.min(Math.max(at + down, 0), rows.length - 1)];
  const column = Math.max(0, rows[Math.max(at, 0)].cells.findIndex((cell) => cell.name === current?.[1]));
  choose(row.photo, row.cells[Math.min(Math.max(column + right, 0), row.cells.length - 1)].name);
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// Keys while the board is open; true when the key is ours.
export function boardKey(event, letter) {
  const down = event.type === "keydown";
  if (event.key === "Escape" || letter === "KeyI") { if (down) byId("board").close(); return true; }
  if (tab !== "board" || !found) return event.key.length === 1;
  if (ARROWS[event.key]) {
    const onTable = document.activeElement?.classList.contains("mark");
    const arrow = ARROWS[event.key];
    if (down && onTable) { walk(...arrow); byId("board").querySelector(".mark.on")?.focus({ preventScroll: true }); }
    else if (down) nudgeMark(...arrow.map((value) => value * (event.shiftKey ? 1 : 0.1)));
    return true;
  }
  const ours = { KeyY: () => use(true), KeyV: () => use(false), KeyN: () => use(false), KeyJ: () => step(1), KeyK: () => step(-1), KeyF: fitMark, KeyU: () => send({ kind: event.shiftKey ? "redo" : "undo" }) };
  if (letter === "Enter") { if (down && !event.repeat) snap(); return true; }
  if (["+", "=", "-"].includes(event.key)) { if (down) zoomMark(event.key === "-" ? 1 / 1.25 : 1.25); return true; }
  const act = ours[letter];
  if (act && down && (!event.repeat || letter === "KeyJ" || letter === "KeyK")) act();
  return Boolean(act) || event.key.length === 1;
}

export const boardState = () => ({ current, tab, found });
