// Surveyed points of the operator: a list looked at before it comes in, or one point typed.
import { Question, onceRead } from "./asked.js";
import {
  again, byId, element, numberOf, renew, sheetHead, start, svg, word, written,
} from "./words.js";

const QUANTITIES = [
  "", "id", "X", "Y", "Z", "sigma_X", "sigma_Y", "sigma_Z", "sigma_xy", "role", "description",
  "sketch",
];
const ROLES = ["control", "check", "plan", "height"];
const MAP = 260; // design: large enough to see a point beside the block
/** Whether a point that lies far from the block is meant. */
const meant = new Question();
const state = {
  name: "",
  data: /** @type {Blob | null} */ (null),
  /** What another program's file would bring. */
  foreign: /** @type {ReadForeign | null} */ (null),
  /** What was chosen by hand; all else is recognised. */
  reading: /** @type {Record<string, any>} */ ({}),
  found: /** @type {ReadList | null} */ (null),
  error: "",
  /** The typed point of which it was said that it lies far from the block, and what was asked. */
  far: "",
  doubts: /** @type {string[]} */ ([]),
  /** True while a list or a point comes in. */
  bringing: false,
  /** How often the list was read; only the last answer counts. */
  turn: 0,
};

export function setUpPoints() {
  const button = byId("points-open");
  button.hidden = start.guest;
  button.title = word("points.tip");
  if (button.hidden) return;
  button.addEventListener("click", open);
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    const files = [...event.dataTransfer?.files ?? []];
    if (!files.length) return;
    open();
    take(files);
  });
}

function open() {
  const turn = state.turn + 1;
  Object.assign(state,
    { name: "", data: null, reading: {}, found: null, foreign: null, error: "", turn, far: "" });
  meant.show("");
  draw();
  if (!byId("points").open) byId("points").showModal();
}

/** One behind the other, with their names and sizes. @param {File[]} files */
function take(files) {
  const reading = { files: files.map(({ name, size }) => [name, size]) };
  Object.assign(state, { name: files[0].name, data: new Blob(files), reading });
  readAgain();
}

/** @param {string} act @param {Blob} data @param {string} name @param {object} reading */
async function ask(act, data, name, reading) {
  const asked = new URLSearchParams({ name, seat: start.seat, reading: JSON.stringify(reading) });
  const answer = await fetch(`/points/${act}?${asked}`, { method: "POST", body: data })
    .catch(() => null);
  if (!answer) return { error: word("notice.wire") };
  if (!answer.ok && answer.status !== 409) return { error: await answer.text() };
  return answer.json();
}

/** Brought once, however often it is pressed. @param {Parameters<typeof ask>} what */
async function bring(...what) {
  if (state.bringing) return null;
  state.bringing = true;
  if (state.data) draw();
  const answer = await ask(...what);
  state.bringing = false;
  return answer;
}

async function readAgain() {
  if (!state.data) return;
  const turn = ++state.turn;
  const answer = await ask("read", state.data, state.name, state.reading);
  // An answer to what was chosen before would draw the newer choices away.
  if (turn !== state.turn) return;
  state.error = answer.error ? again(answer.error) : "";
  state.found = answer.error || answer.format ? null : answer;
  state.foreign = answer.format ? answer : null;
  draw();
}

/** One setting changed; columns and axes are recognised anew where the cells are others. */
function choose(/** @type {string} */ about, /** @type {any} */ value) {
  if (["encoding", "delimiter", "decimal", "header"].includes(about)) {
    delete state.reading.columns;
    delete state.reading.axes;
  }
  if (about === "crs") delete state.reading.axes;
  if (value === "" && about !== "columns") delete state.reading[about];
  else state.reading[about] = value;
  // The axes that a CRS needs are told with it.
  if (about === "crs" && value) state.reading.axes = state.found?.reading.axes || "E N";
  readAgain();
}

function draw() {
  renew(byId("points"),
    sheetHead(byId("points"), "points"), element("p", {}, word("points.long")),
    chooser(), formatChoice(),
    state.error ? element("p", { class: "bad", role: "alert" }, state.error) : "",
    ...(state.found ? preview(state.found)
      : state.foreign ? [foreignPreview(state.foreign)] : state.data ? [] : [typed()]),
    element("div", { class: "points-acts" }, state.found ? bringButton(state.found)
      : state.foreign ? bringForeign() : null));
}

function chooser() {
  // A browser's own button speaks the browser's language, and knows of no file that was dropped.
  const input = element("input", { type: "file", id: "points-file", multiple: true, hidden: true,
    onchange: (/** @type {any} */ { target }) => target.files[0] && take([...target.files]) });
  return element("p", {}, word("points.file"), " ", input,
    element("button", { id: "points-choose", onclick: () => input.click() }, word("points.choose")),
    state.name ? element("b", {}, ` ${state.name}`) : null);
}

/** A table, or the format of another program; what the names of the files say at first. */
function formatChoice() {
  if (!state.data || !Object.keys(start.imports).length) return "";
  const now = state.reading.format ?? state.foreign?.format ?? "";
  const options = [["", word("points.table")], ...Object.entries(start.imports)].map(
    ([value, text]) => element("option", { value, selected: value === now }, again(text)));
  const onchange = (/** @type {any} */ { target }) => {
    state.reading.format = target.value;
    readAgain();
  };
  return element("p", {}, element("label", {}, word("points.format"), " ",
    element("select", { id: "points-format", onchange }, ...options)));
}

/** @param {ReadForeign} foreign */
const foreignPreview = ({ counts, notes }) => element("ul", { class: "points-said" },
  ...Object.entries(counts).map(([what, count]) =>
    element("li", {}, word(`points.brings.${what}`, { count }))),
  ...(Object.keys(counts).length ? [] : [element("li", {}, word("points.brings.nothing"))]),
  ...notes.map((note) => element("li", {}, again(note))));

const bringForeign = () => element("button", { id: "points-bring", class: "primary",
  onclick: bringList,
  disabled: state.bringing || !Object.keys(state.foreign?.counts ?? {}).length },
word("points.bring.foreign"));

/** @param {ReadList} found */
const preview = (found) => [
  settings(found.reading),
  element("ul", { class: "points-said" },
    ...found.evidence.map((said) => element("li", {}, again(said)))),
  element("div", { class: "points-rooms" }, table(found), map(found)),
  ...found.questions.map(question),
  refusedRows(found),
];

/** @param {ReadList["reading"]} reading */
const settings = (reading) => element("div", { class: "points-settings" },
  select("encoding", reading.encoding, ["", "utf-8", "utf-16", "cp1250", "cp1252"]),
  select("delimiter", reading.delimiter, [",", ";", "\t", " "]),
  select("decimal", reading.decimal, [".", ","]),
  select("header", String(reading.header), ["true", "false"]),
  select("axes", reading.axes, ["E N", "N E", "-E -N", "-N -E"]),
  field("crs", reading.crs), select("role", reading.role, ROLES),
  field("sigma_plan_m", written(reading.sigma_plan_m)),
  field("sigma_height_m", written(reading.sigma_height_m)));

/** @param {string} name @param {string} value @param {string[]} choices */
function select(name, value, choices) {
  const listed = choices.includes(value) ? choices : [value, ...choices];
  const options = listed.map((choice) => element("option",
    { value: choice, selected: choice === value }, optionWord(name, choice)));
  const onchange = (/** @type {any} */ { target }) =>
    choose(name, name === "header" ? target.value === "true" : target.value);
  return element("label", {}, word(`points.${name}`),
    element("select", { id: `points-${name}`, onchange }, ...options));
}

const DELIMITERS = new Map([["\t", "tab"], [" ", "blanks"], [";", "semicolon"], [",", "comma"]]);

/** @param {string} name @param {string} choice */
function optionWord(name, choice) {
  if (name === "delimiter") return again(DELIMITERS.get(choice) ?? choice);
  if (name === "header") return word(choice === "true" ? "points.header.yes" : "points.header.no");
  if (name === "role") return word(`points.role.${choice}`);
  return choice || "\u2014";
}

/** @param {string} name @param {string} value */
function field(name, value) {
  const onchange = (/** @type {any} */ { target }) =>
    choose(name, name === "crs" ? target.value.trim() : numberOf(target.value));
  return element("label", {}, word(`points.${name}`),
    element("input", { id: `points-${name}`, value, onchange, size: "9", autocomplete: "off" }));
}

/** The first rows, with a chooser over each column. @param {ReadList} found */
function table({ width, header, rows, reading }) {
  const heads = Array.from({ length: width }, (_, n) => element("th", { scope: "col" },
    columnChoice(n, width, reading.columns), element("small", {}, header[n] ?? "")));
  const lines = rows.map(([number, ...cells]) => element("tr", {},
    element("th", { scope: "row" }, String(number)),
    ...Array.from({ length: width }, (_, n) => element("td", {}, String(cells[n] ?? "")))));
  const corner = element("th", { scope: "col" }, word("points.line"));
  return element("div", { class: "points-table", tabindex: "0", role: "region",
    "aria-label": word("points.rows") },
    element("table", {}, element("thead", {}, element("tr", {}, corner, ...heads)),
      element("tbody", {}, ...lines)));
}

/** @param {number} place @param {number} width @param {string[]} columns */
function columnChoice(place, width, columns) {
  const options = QUANTITIES.map((one) => element("option",
    { value: one, selected: one === (columns[place] ?? "") }, one || "\u2014"));
  // As all of them stand now: the answer to the last one may be on its way.
  const onchange = () => choose("columns", Array.from({ length: width }, (_, n) =>
    /** @type {HTMLSelectElement} */ (document.getElementById(`points-column-${n}`)).value));
  return element("select", { id: `points-column-${place}`, onchange,
    "aria-label": word("points.column", { number: place + 1 }) }, ...options);
}

/** The points over the footprints of the photos. @param {ReadList} found */
function map({ points, footprints }) {
  const corners = footprints.flat();
  const places = [...corners, ...points.map(([, east, north]) => [east, north])];
  const easts = places.map(([east]) => east);
  const norths = places.map(([, north]) => north);
  const [west, north] = [Math.min(...easts), Math.max(...norths)];
  const size = Math.max(Math.max(...easts) - west, north - Math.min(...norths), 1);
  const put = (/** @type {number} */ east, /** @type {number} */ up) =>
    [8 + (east - west) / size * (MAP - 16), 8 + (north - up) / size * (MAP - 16)];
  const areas = footprints.map((area) => svg("polygon", {
    class: "points-area", points: area.map(([east, up]) => put(east, up).join(",")).join(" ") }));
  const dots = points.map(([name, east, up, role]) => {
    const [cx, cy] = put(east, up);
    return svg("circle", { class: `points-dot ${role}`, cx, cy, r: 4 }, svg("title", {}, name));
  });
  return svg("svg", { class: "points-map", viewBox: `0 0 ${MAP} ${MAP}`, role: "img",
    "aria-label": word("points.map", { count: points.length }) }, ...areas, ...dots);
}

/** @param {ListQuestion} asked */
function question({ about, words, choices }) {
  const lines = choices.map(({ value, words: said }, n) => element("label", {},
    element("input", { type: "radio", name: `points-ask-${about}`, id: `points-ask-${about}-${n}`,
      onchange: () => choose(about, value) }), again(said)));
  const none = element("span", {}, word("points.columns.ask"));
  return element("fieldset", {}, element("legend", {}, again(words)),
    ...(choices.length ? lines : [none]));
}

/** @param {ReadList} found */
function refusedRows({ refused, refused_count: count }) {
  if (!count) return "";
  return element("details", { open: count <= 5 },
    element("summary", {}, word("points.refused", { count })),
    element("ul", {}, ...refused.map(({ number, text, cause, remedy }) => element("li", {},
      element("b", {}, word("points.refused.line", { number })),
      ` ${again(cause)} ${again(remedy)} `,
      element("code", {}, text.slice(0, 80))))));
}

/** @param {ReadList} found */
function bringButton({ points, questions, replaced }) {
  const button = element("button", { id: "points-bring", class: "primary", onclick: bringList,
    disabled: state.bringing || questions.length > 0 || !points.length },
    word("points.bring", { count: points.length }));
  const note = questions.length ? word("points.ask.first")
    : replaced ? word("points.replaced", { count: replaced }) : "";
  return element("span", {}, button, element("span", { class: "muted" }, ` ${note}`));
}

async function bringList() {
  if (!state.data) return;
  const answer = await bring("bring", state.data, state.name, state.reading);
  if (!answer) return;
  state.error = answer.error ? again(answer.error) : "";
  if (answer.brought) byId("points").close();
  else draw();
}

const TYPED = ["id", "X", "Y", "Z", "sigma_xy", "sigma_Z"];

/** One point, new or corrected. */
function typed() {
  const inputs = TYPED.map((name) => element("label", {}, word(`points.one.${name}`),
    element("input", { id: `points-one-${name}`, name, autocomplete: "off", size: "12",
      required: !name.startsWith("sigma"),
      onchange: name === "id" ? fillKnown : null })));
  const roles = element("select", { id: "points-one-role", name: "role" },
    ...ROLES.map((role) => element("option", { value: role }, word(`points.role.${role}`))));
  const words = element("input", { id: "points-one-description", name: "description",
    autocomplete: "off", size: "28" });
  return element("form", { class: "points-one", onsubmit: bringTyped },
    element("h3", {}, word("points.one")), element("p", {}, word("points.one.long")),
    element("div", { class: "points-settings" }, ...inputs,
      element("label", {}, word("points.role"), roles),
      element("label", {}, word("points.one.description"), words)),
    element("button", { type: "submit", id: "points-one-bring" }, word("points.one.bring")));
}

/** @param {string} name */
const one = (name) => /** @type {HTMLInputElement} */ (
  document.getElementById(`points-one-${name}`));

/** What is known of a point, but for what was typed while the desk was asked. */
async function fillKnown() {
  const fields = [...TYPED, "role", "description"];
  const asked = new Map(fields.map((name) => [name, one(name).value]));
  const name = asked.get("id") ?? "";
  const answer = await fetch(`/points/known?name=${encodeURIComponent(name.trim())}`);
  const known = answer.ok ? await answer.json() : {};
  if (!known.position || one("id")?.value !== name) return;
  const [X, Y, Z] = known.position.map(written);
  const [sigma_xy, sigma_Z] = known.sigma.map((/** @type {number | null} */ sigma) =>
    written(sigma ?? ""));
  const { role, description } = known;
  for (const [label, value] of Object.entries({ X, Y, Z, sigma_xy, sigma_Z, role, description })) {
    if (one(label).value === asked.get(label)) one(label).value = value;
  }
}

/** @param {Event} event */
function bringTyped(event) {
  event.preventDefault();
  const names = [...TYPED, "role", "description"];
  const cells = names.map((name) => one(name).value.replaceAll("\t", " ").trim());
  const plain = cells.map((cell, n) => (n && n < TYPED.length ? cell.replace(",", ".") : cell));
  const text = `${names.join("\t")}\n${plain.join("\t")}\n`;
  if (state.far !== text) meant.show("");
  onceRead(() => bringPoint(text, names), meant);
}

/** @param {string} text of one line below the names of its columns @param {string[]} names */
async function bringPoint(text, names) {
  const kept = state.far === text ? state.doubts : [];
  const reading = { encoding: "utf-8", delimiter: "\t", decimal: ".", header: true, axes: "E N",
    columns: names, ...Object.fromEntries(kept.map((about) => [about, "keep"])) };
  const answer = await bring("bring", new Blob([text]), "", reading);
  if (!answer) return;
  if (answer.brought) {
    byId("points").close();
    return;
  }
  const refused = answer.refused?.[0];
  const asked = answer.questions?.[0];
  if (asked && ["outside", "heights"].includes(asked.about)) {
    Object.assign(state, { far: text, doubts: [...kept, asked.about] });
    meant.show(`${text}${asked.about}`);
    tellTyped(`${again(asked.words)} ${word("points.one.far")}`);
    return;
  }
  const said = answer.error ?? refused?.cause ?? asked?.words ?? "";
  tellTyped(refused ? `${again(said)} ${again(refused.remedy)}` : again(said));
}

/** What is wrong with the typed point, beside its form. @param {string} text */
function tellTyped(text) {
  const form = byId("points").querySelector("form");
  form?.querySelector(".bad")?.remove();
  form?.append(element("p", { class: "bad", role: "alert" }, text));
}
