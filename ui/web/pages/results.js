// Tables and report, to be opened or taken away.
import { mosaicButton } from "./mosaic.js";
import { post } from "./run.js";
import {
  again, all, byId, element, fileSize, focused, renew, sheetHead, start, word,
} from "./words.js";

const state = {
  /** When the report shown was written. */
  written: 0,
  /** Whether the files are what the decisions make of them. */
  fresh: true,
  /** The tab it was opened in. */
  page: /** @type {Window | null} */ (null),
  /** Whether long work was under way when that was asked last, and when it is asked again. */
  busy: { sheets: false, export: false },
  timers: { sheets: 0, export: 0 },
  /** Until the list is renewed. */
  listed: Promise.resolve(),
};
/** Long work that others may have begun, by its address, and what is said of it. */
const WORKS = {
  sheets: { begin: "sheets.begin", making: "sheets.making", cancelled: "sheets.cancelled" },
  export: { begin: "export.begin", making: "export.making", cancelled: "export.cancelled" },
};
/** @typedef {keyof typeof WORKS} Work */
const ASKED_MS = 700; // design: as a run that is watched

/** A report written anew is listed, and shown where it is open. @param {Status} status */
export function tellResults({ written_ms: written, written: fresh, stale }) {
  const before = state.written;
  Object.assign(state, { written, fresh: fresh && !stale.length });
  document.getElementById("sheets-old")?.toggleAttribute("hidden", state.fresh);
  if (!before || before === written) return;
  if (state.page && !state.page.closed) state.page.location.reload();
  listAgain();
}

/** The list as it is now, where it is open. */
async function listAgain() {
  const list = document.querySelector("#results[open] .files");
  if (list) await fill(/** @type {HTMLElement} */ (list));
}

export function setUpResults() {
  const button = byId("results-open");
  button.hidden = !start.results;
  button.title = word("results.tip");
  button.addEventListener("click", open);
  const sheet = byId("results");
  sheet.addEventListener("click", (event) => {
    if (event.target === sheet) sheet.close();
  });
}

async function open() {
  const sheet = byId("results");
  const list = element("div", { class: "files", "aria-busy": "true" }, word("wait"));
  // The sheet opens before its list is there, so that no key goes to what lies below.
  renew(sheet,
    sheetHead(sheet, "results"), element("p", {}, word("results.long")),
    element("p", {}, mosaicButton("results")), list, ...sheets(), ...exporting());
  sheet.showModal();
  for (const name of /** @type {Work[]} */ (Object.keys(WORKS))) {
    if (document.getElementById(`${name}-begin`)) watch(name);
  }
  await fill(list);
}

/** @param {HTMLElement} list */
async function fill(list) {
  const answer = await fetch("/results/");
  /** @type {[name: string, bytes: number][]} */
  const files = answer.ok ? await answer.json() : [];
  const folders = [...new Set(files.map(([name]) => folderOf(name)))];
  const unfolded = all("details[open]", list).map(({ dataset }) => dataset.folder);
  list.removeAttribute("aria-busy");
  list.replaceChildren(
    ...folders.map((folder) => {
      const lines = files.filter(([name]) => folderOf(name) === folder).map(line);
      const inside = element("ul", {}, ...lines);
      const said = `${folder}/ (${lines.length})`;
      const [top] = folder.split("/");
      const what = meaning(`results.folder.${top}`);
      return folder ? element("details", { "data-folder": folder,
        open: unfolded.includes(folder) }, element("summary", {}, said, " ", what), inside)
        : inside;
    }),
    files.length ? "" : element("p", {}, word("results.none")));
}

/** @param {string} name */
const folderOf = (name) => name.slice(0, Math.max(name.lastIndexOf("/"), 0));

/** @param {[name: string, bytes: number]} file */
const line = ([name, bytes]) => element("li", {}, link(name),
  meaning(`results.file.${name}`), element("span", { class: "muted" }, fileSize(bytes)));

/** What a file or a folder holds, where that is known. @param {string} key */
const meaning = (key) => element("span", { class: "muted what" }, start.words[key] ?? "");

/** @param {string} name */
function link(name) {
  const page = name.endsWith(".html");
  const plain = name.split("/").at(-1) ?? name;
  const how = page ? { target: "_blank", onclick: openPage } : { download: plain };
  const text = page ? word("results.report", { name }) : plain;
  const href = `/results/${name.split("/").map(encodeURIComponent).join("/")}`;
  return element("a", { href, ...how }, text);
}

/** In a tab that is kept, to be loaded again. @param {MouseEvent} event */
function openPage(event) {
  event.preventDefault();
  const { href } = /** @type {HTMLAnchorElement} */ (event.currentTarget);
  state.page = window.open(href, href);
}

/**
 * A button that cannot be pressed for a while; what is returned gives it back, with the focus.
 * @param {HTMLButtonElement} button
 */
function held(button) {
  const focus = focused() === button;
  button.disabled = true;
  return () => {
    button.disabled = false;
    if (focus && focused() === document.body) button.focus();
  };
}

/**
 * A button for long work, one that stops it, and where is said how far it is and what came of it.
 * @param {Work} name @param {() => Promise<any>} ask
 * @param {(answer: any) => (string | Node)[][]} told lines of what was made
 */
function working(name, ask, told) {
  const said = element("div", { id: `${name}-said`, role: "status" });
  const begin = element("button", { id: `${name}-begin`, onclick: make }, word(WORKS[name].begin));
  const stop = element("button", { id: `${name}-cancel`, hidden: true,
    onclick: () => post(`/${name}/cancel`) }, word("remake.cancel"));
  return { begin, stop, said };

  async function make() {
    const goOn = held(/** @type {HTMLButtonElement} */ (begin));
    state.busy[name] = true;
    stop.hidden = false;
    said.replaceChildren(word(WORKS[name].making, { share: 0, what: "" }));
    // On a small screen it lies below the edge of the sheet.
    said.scrollIntoView({ block: "nearest" });
    state.timers[name] = setTimeout(() => watch(name), ASKED_MS);
    const answer = await ask();
    goOn();
    await watch(name);
    const lines = answer.error ? [[again(answer.error)]]
      : answer.file ? told(answer) : [[word(WORKS[name].cancelled)]];
    // The sheet may have been closed and opened again meanwhile.
    const place = document.getElementById(`${name}-said`);
    place?.replaceChildren(...lines.map((one) => element("p", {}, ...one)));
    place?.scrollIntoView({ block: "nearest" });
  }
}

/** How far long work is, whoever began it, until it is done. @param {Work} name */
async function watch(name) {
  clearTimeout(state.timers[name]);
  const answer = await fetch(`/${name}`).catch(() => null);
  const { busy, share, what } = answer?.ok ? await answer.json() : { busy: false };
  if (!byId("results").open) return;
  if (busy) {
    clearTimeout(state.timers[name]);
    state.timers[name] = setTimeout(() => watch(name), ASKED_MS);
  }
  byId(`${name}-cancel`).hidden = !busy;
  byId(`${name}-begin`).toggleAttribute("disabled", busy);
  const making = word(WORKS[name].making, { share: Math.round(100 * share), what });
  if (busy) byId(`${name}-said`).replaceChildren(making);
  else if (state.busy[name]) {
    byId(`${name}-said`).replaceChildren();
  }
  const ended = state.busy[name] && !busy;
  state.busy[name] = busy;
  // What was made is there, and what it took the place of is gone. Another look may have begun to
  // list it: what is said below stays where it is only when that is done.
  if (ended) state.listed = listAgain();
  await state.listed;
}

/** Map sheets of the mosaic. */
function sheets() {
  if (start.guest) return [];
  const { begin, stop, said } = working("sheets", () => post("/sheets"),
    (answer) => [[again(answer.said), " \u00b7 ", link(answer.file)]]);
  return [element("h3", {}, word("sheets")), element("p", {}, word("sheets.long")),
    element("p", { id: "sheets-old", class: "doubted", hidden: state.fresh }, word("sheets.old")),
    element("p", {}, begin, " ", stop), said];
}

/** A format to choose, and the block in it. */
function exporting() {
  const formats = Object.entries(start.formats);
  if (!formats.length || start.guest) return [];
  const chosen = element("select", { id: "export-format", "aria-label": word("export.format") },
    ...formats.map(([name, title]) => element("option", { value: name }, again(title))));
  const pictures = element("input", { type: "checkbox", id: "export-pictures" });
  const upright = element("label", { title: word("export.pictures.tip") }, pictures, " ",
    word("export.pictures"));
  const choose = () => {
    upright.hidden = !start.upright.includes(/** @type {HTMLSelectElement} */ (chosen).value);
  };
  chosen.addEventListener("change", choose);
  choose();
  const { begin, stop, said } = working("export", write, (answer) => [[link(answer.file)],
    ...answer.notes.map((/** @type {any} */ note) => [again(note)])]);
  return [element("h3", {}, word("export")), element("p", {}, word("export.long")),
    element("p", {}, chosen, " ", begin, " ", stop), element("p", {}, upright), said];

  function write() {
    const { checked } = /** @type {HTMLInputElement} */ (pictures);
    const format = /** @type {HTMLSelectElement} */ (chosen).value;
    return post(`/export/${format}`, { pictures: checked && !upright.hidden });
  }
}
