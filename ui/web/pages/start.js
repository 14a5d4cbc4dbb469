// The start page: what a folder holds and lacks, files into it, its settings, and the run.
import { again, all, byId, element, fillWords, first, renew, start, word }
  from "./words.js";
import { beginRun, cancelButton, isRunning, lookAgain, post, runLines, runNow, settle, tell,
  watchRun } from "./run.js";
import { dropWritten, fillFields, formSeen, formShown, formValues, formWritten, goToField,
  recallWritten, showForm } from "./start_form.js";
import { question } from "./asked.js";
import { timeOf } from "./keys.js";
import { blocksPart, watchBatch } from "./start_blocks.js";
import { drawMap, setUpFilm, showScans } from "./start_film.js";
import { setUpNeighbours, showNeighbours } from "./neighbours.js";
import { afterPause } from "./view.js";
import { nextTheme, setUpTheme } from "./theme.js";

const TABS = ["film", "map", "run", "neighbours"];
const BROWSED = "gruber.browsed"; // the folder that was looked into last
const ASKED = ["distance"]; // what is doubted of these is asked about before a run
const state = {
  found: /** @type {Found | null} */ (null),
  /** How often the folder was looked at, and the newest look. */
  looks: 0,
  look: Promise.resolve(),
  uploads: /** @type {Upload[]} */ ([]),
  sending: /** @type {Promise<void> | null} */ (null),
  tab: "film",
  /** What a hand has changed is being checked; and it is another than the file has. */
  checking: false,
  touched: false,
  /** True once it was said that the run stops. */
  leaving: false,
  /** The doubts in spite of which a run was asked for once. */
  asked: "",
  judged: /** @type {Judged} */ ({ errors: {}, missing: [], ready: false }),
};

/** Looks at the folder; who asked before a newer look waits for that one. */
function load() {
  state.looks += 1;
  state.look = look(state.looks);
  return state.look;
}

/** @param {number} turn @returns {Promise<void>} */
async function look(turn) {
  const answer = await fetch("/found");
  // This one says why; any other comes from a page that is not this one.
  if (!answer.ok && answer.status !== 409) return lookAgain();
  const found = await answer.json();
  if (turn !== state.looks) return state.look;
  if (found.error) return tell(found.error, true, "/found");
  const touched = recallWritten(found.folder);
  if (touched && !state.found) tell(word("start.recalled"));
  Object.assign(state, { found, touched, judged: found.form });
  show();
  if (touched) changed();
}

/** The settings as the file has them. */
function discard() {
  dropWritten(formWritten());
  load();
}

function show() {
  const { found } = state;
  if (!found) return;
  showScans(found.scans);
  drawMap(byId("map"), found);
  showForm(found.form, changed);
  renew(byId("files"), ...folderPart(found), ...dropPart(),
    element("div", { id: "holdings" }, ...holdings(found)));
  showGo(found.form);
  first("[data-tab=neighbours]").hidden = found.blocks.filter((one) => one.run).length < 2;
  watchBatch(found.batch, load);
}

/** @param {Found} found */
function folderPart(found) {
  const { folder, blocks, home } = found;
  const back = home ? [element("div", { class: "acts" }, element("button", { type: "button",
    "data-act": "start.home", title: home, disabled: start.guest, onclick: () => open(home) },
  word("start.home")))] : [];
  const parts = [element("h2", {}, word("start.folder")),
    element("p", { class: "path" }, ...breakable(folder)), ...back];
  return blocks.length ? [...parts, ...blocksPart(found, open)] : parts;
}

function dropPart() {
  const pick = (/** @type {boolean} */ whole) => {
    const input = element("input", { type: "file", multiple: true });
    input.webkitdirectory = whole;
    input.addEventListener("change", () => {
      send([...(input.files ?? [])].map((file) => [file.webkitRelativePath || file.name, file]));
    });
    input.click();
  };
  const act = (/** @type {string} */ name, /** @type {() => void} */ onclick) => element("button",
    { type: "button", "data-act": name, disabled: start.guest, onclick }, word(name));
  const drop = element("div", { id: "drop" }, element("span", {}, word("start.drop")),
    element("div", { class: "acts" }, act("start.add.files", () => pick(false)),
      act("start.add.folder", () => pick(true)),
      act("start.link", () => browse(sessionStorage.getItem(BROWSED) ?? ""))));
  return [element("h2", {}, word("start.files")), drop, ...state.uploads.map(uploadLine)];
}

/** @param {Upload} upload */
function uploadLine(upload) {
  const { name, share, why } = upload;
  const bar = element("i");
  bar.style.width = `${100 * share}%`;
  return element("div", { class: "upload" }, element("span", { title: name }, name),
    why ? null : element("button", { class: "small", onclick: () => stopSending(upload) },
      word("remake.cancel")),
    why ? element("span", { class: "doubted" }, why)
      : element("span", { class: "share" }, bar));
}

/** Names of files break after a sign that parts them. @param {string} text */
const breakable = (text) => text.split(/(?<=[/_-])/)
  .flatMap((part) => [part, element("wbr")]).slice(0, -1);

/** True for a folder that only holds blocks: it lacks nothing of one. @param {Found} found */
const isShelf = ({ blocks, scans, written }) => !written && blocks.length > 0
  && (!scans.length || blocks.some((one) => !one.written));

/** @param {Found} folder */
function holdings(folder) {
  const { found, notes, links, added } = folder;
  const gaps = isShelf(folder) ? [] : folder.gaps;
  const line = (/** @type {string} */ kind, /** @type {string} */ sign,
    /** @type {(Node | string)[]} */ ...said) => element("li", { class: kind },
    element("i", {}, sign), element("span", {}, ...said));
  const have = found.map(([name, value]) =>
    line("have", "\u2713", ...breakable(
      `${word(`found.${name}`)}: ${name === "begin" ? word(`choice.${value}`) : again(value)}`)));
  // What cannot be used fills no gap.
  const { errors } = state.judged;
  const filled = new Set(Object.entries(formValues())
    .filter(([name, value]) => value !== null && !errors[name])
    .map(([name]) => name.replace(/^(\w+)\..*?(\w+)$/, "$1.$2")));
  const lacking = gaps.filter(([, , keys]) => !keys.some((key) => filled.has(key)));
  const lacks = lacking.map(([name, out]) => line(out === "nothing" ? "needs" : "lacks",
    out === "nothing" ? "\u2717" : "!", word(`gap.${name}`),
    element("small", {}, word(`gap.out.${out}`))));
  const noted = (/** @type {boolean} */ broken) =>
    notes.filter(([name]) => ["unreadable", "broken"].includes(name) === broken)
      .map(([name, values]) => line(broken ? "needs" : "lacks", broken ? "\u2717" : "!",
        word(`found.note.${name}`, values)));
  const away = (/** @type {string} */ name, /** @type {string} */ sign,
    /** @type {string} */ act) => line("have", sign, `${name} `, element("button",
    { class: "small", "data-away": name, disabled: start.guest, onclick: () => unlink(name) },
    word(act)));
  const linked = links.map((name) => away(name, "\u2192", "start.unlink"));
  const own = added.map((name) => away(name, "+", "start.remove"));
  const list = (/** @type {string} */ title, /** @type {Node[]} */ lines) =>
    (lines.length ? [element("h2", {}, word(title)), element("ul", { class: "holds" }, ...lines)]
      : []);
  return [...list("start.broken", noted(true)), ...list("start.found", have),
    ...list("start.missing", lacks), ...list("start.notes", noted(false)),
    ...list("start.links", linked), ...list("start.added", own)];
}

/** @param {string} name */
async function unlink(name) {
  const answer = await post("/unlink", { path: name });
  if (!answer.ok) tell(answer.error, true, "/unlink");
  load();
}

/** True when a folder takes the place of this page. @param {string} path */
async function open(path) {
  const asks = await isRunning() && !state.leaving;
  state.leaving = asks;
  const answer = asks ? { ok: false, error: word("start.stop") } : await post("/open", { path });
  tell(answer.ok ? word("start.opening") : answer.error, !answer.ok, answer.ok ? "" : "/open");
  if (answer.ok) lookAgain();
  return answer.ok;
}

/** Files go one after the other, whenever they were dropped. @param {[string, File][]} files */
async function send(files) {
  if (start.guest) return tell(word("notice.guest"));
  state.uploads = state.uploads.filter(({ why }) => !why);
  const waiting = files.filter(([name]) => !name.split("/").some((part) => part.startsWith(".")))
    .map(([name, file]) => ({ name, file, share: 0, why: "", request: null }));
  state.uploads.push(...waiting);
  showUploads();
  await (state.sending ??= sendAll());
}

async function sendAll() {
  const next = () => state.uploads.find(({ why }) => !why);
  for (let upload = next(); upload; upload = next()) {
    const why = await sendOne(upload);
    if (why) Object.assign(upload, { why, request: null });
    else state.uploads.splice(state.uploads.indexOf(upload), 1);
    showUploads();
  }
  state.sending = null;
  load();
}

/** Why it failed; nothing where it is there. @param {Upload} upload @returns {Promise<string>} */
function sendOne(upload) {
  return new Promise((resolve) => {
    const request = new XMLHttpRequest();
    upload.request = request;
    const path = upload.name.split("/").map(encodeURIComponent).join("/");
    request.open("PUT", `/files/${path}`);
    request.upload.onprogress = ({ loaded, total }) => {
      upload.share = total ? loaded / total : 0;
      showUploads();
    };
    request.onload = () => {
      if (request.status < 300) return resolve("");
      const json = request.getResponseHeader("content-type")?.includes("json");
      resolve(json ? again(JSON.parse(request.responseText).error) : request.responseText);
    };
    request.onabort = () => resolve(word("start.stopped"));
    request.onerror = () => resolve(word("start.broke"));
    request.send(upload.file);
  });
}

/** The one that is sent, or one that waits for its turn. @param {Upload} upload */
function stopSending(upload) {
  if (upload.request) return upload.request.abort();
  upload.why = word("start.stopped");
  showUploads();
}

function showUploads() {
  for (const line of all(".upload")) line.remove();
  byId("drop").after(...state.uploads.map(uploadLine));
}

/** Files of what was dropped, folders with all that is in them. @param {DataTransfer} dropped */
async function dropped({ items }) {
  /** @type {[string, File][]} */
  const files = [];
  /** @param {any} entry @param {string} folder @returns {Promise<unknown>} */
  const walk = async (entry, folder) => {
    if (entry.isFile) {
      const file = await new Promise((resolve, fail) => { entry.file(resolve, fail); });
      return files.push([folder + entry.name, file]);
    }
    const reader = entry.createReader();
    for (;;) {
      const some = await new Promise((resolve, fail) => { reader.readEntries(resolve, fail); });
      if (!some.length) return null;
      for (const inner of some) await walk(inner, `${folder}${entry.name}/`);
    }
  };
  const entries = [...items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
  for (const entry of entries) await walk(entry, "");
  send(files);
}

/** A folder of this computer, chosen step by step. @param {string} path */
async function browse(path) {
  const dialog = /** @type {HTMLDialogElement} */ (byId("folders"));
  const answer = await post("/folders", { path });
  if (!answer.ok) {
    sessionStorage.removeItem(BROWSED);
    return tell(answer.error, true, "/folders");
  }
  const { path: here, parent, folders, files, block } = answer;
  sessionStorage.setItem(BROWSED, here);
  const step = (/** @type {string} */ name, /** @type {string} */ to) => element("li", {},
    element("button", { onclick: () => browse(to) }, name));
  const act = (/** @type {string} */ name, /** @type {() => void} */ done, on = false) =>
    element("button", {
      class: on ? "on" : "", "data-act": name,
      onclick: () => {
        dialog.close();
        done();
      },
    }, word(name));
  renew(dialog, element("h2", {}, word("start.link")),
    element("p", { class: "path" }, here),
    element("p", {}, word(block ? "start.folder.block" : "start.folder.holds", { count: files })),
    element("ul", {}, step("\u2191 ..", parent),
      ...folders.map((/** @type {string} */ name) => step(name, `${here}/${name}`))),
    element("footer", {}, act("start.link.this", () => link(here), !block),
      act("start.open.this", () => open(here), block), element("span", { class: "stretch" }),
      act("start.close", () => {})),
    element("p", {}, word("start.link.long")));
  if (!dialog.open) dialog.showModal();
}

/** @param {string} path */
async function link(path) {
  const answer = await post("/link", { path });
  if (!answer.ok) return tell(answer.error, true, "/link");
  load();
}

function changed() {
  if (start.guest) return;
  Object.assign(state, { checking: true, touched: true, asked: "" });
  showGo(state.judged);
  judgeSoon();
}

const judgeSoon = afterPause(async () => {
  const values = formValues();
  const answer = await post("/form/judge", { values, written: formSeen() });
  // What was written meanwhile is judged next.
  if (JSON.stringify(values) !== JSON.stringify(formValues())) return;
  state.checking = false;
  if (!answer.ok) return tell(answer.error, true, "/form/judge");
  fillFields(answer);
  if (!Object.keys(answer.errors).length) settle("/form", true);
  if (state.found) state.found.ahead = answer.ahead;
  showGo(answer);
  if (state.found) renew(byId("holdings"), ...holdings(state.found));
});

/** What is missing, what was checked, and the buttons. @param {Judged} judged */
function showGo(judged) {
  state.judged = judged;
  const { found, checking, touched } = state;
  const { missing, errors, ready } = judged;
  const { state: now } = runNow();
  // All checks are of the file; of what was changed since, those of the form's figures alone.
  const checks = (touched ? judged.checks : ready && found?.checks) || [];
  const stops = checks.some(([grave]) => grave);
  const said = checks.map(([grave, name, values]) =>
    element("li", { class: grave ? "needs" : "lacks" }, element("i", {}, grave ? "\u2717" : "!"),
      element("span", {}, word(`check.${name}`, values))));
  const fills = missing.length > 0 && !(found && isShelf(found));
  const lacks = fills ? [element("p", {}, word("start.fill", {
    what: missing.map((name) => formShown(name)).join("; "),
  }))] : [];
  const whole = errors[""] ? [element("p", { class: "doubted" }, again(errors[""]))] : [];
  const wrong = Object.entries(errors).filter(([name]) => name).map(([name, why]) =>
    goToField(name, again(why)));
  const mend = wrong.length ? [element("p", { class: "doubted", id: "mend" },
    word("start.mend")), element("div", { class: "acts" }, ...wrong)] : [];
  const ahead = !ready ? [] : found?.made && found.ahead.length ? [element("p", { class: "muted" },
    word("start.ahead", { what: found.ahead.map((name) => word(`stage.${name}`)).join(", ") }))]
    : found?.made ? [element("p", { class: "muted" }, word("start.fresh"))] : [];
  const act = (/** @type {string} */ name, /** @type {(press: MouseEvent) => void} */ onclick,
    /** @type {object} */ more = {}, label = name) => element("button",
    { type: "button", "data-act": name, disabled: start.guest, onclick, ...more }, word(label));
  const begins = state.asked && doubted(checks) === state.asked ? "start.run.anyway"
    : "placing.run";
  const running = now === "running" || now === "done";
  const busy = checking ? [element("p", { class: "muted" }, word("start.checking"))] : [];
  renew(byId("go"), ...busy, ...whole, ...mend, ...lacks,
    element("ul", { class: "holds" }, ...said), ...ahead,
    element("div", { class: "acts" },
      running ? cancelButton()
        : act("placing.run", run, { class: ready && !stops ? "on main" : "main",
          disabled: start.guest || !ready || stops }, begins),
      act("start.save", () => save(), { disabled: start.guest || running }),
      touched ? act("start.discard", discard) : null,
      found?.made ? act("start.desk", () => open(".")) : null,
      found?.placeable && !found.made && !running
        ? act("start.place", () => open(".")) : null));
}

async function save() {
  const written = formWritten();
  const answer = await post("/form", { values: formValues(), written: formSeen() });
  if (!answer.ok) {
    tell(answer.error, true, "/form");
    // Another page may have saved: what the file has now stands at the field.
    await load();
    return false;
  }
  fillFields(answer);
  if (!answer.saved) {
    showGo(answer);
    first(".field.bad input, .field.bad textarea, .field.bad select")?.focus();
    tell(word("start.wrong"), true, "/form");
    return false;
  }
  dropWritten(written);
  tell(word("start.saved"), false, "/form");
  await load();
  return true;
}

/** Figures that are asked about before a run, as one text. @param {FormCheck[]} checks */
const doubted = (checks) => checks.filter(([, name]) => ASKED.includes(name))
  .map(([, name, values]) => word(`check.${name}`, values)).join(" ");

/**
 * What takes a second is looked at first; what is doubtful is asked about once.
 * @param {MouseEvent} press
 */
async function run(press) {
  const { found } = state;
  if (!await save() || state.found?.checks.some(([grave]) => grave)) return;
  const doubts = doubted(state.found?.checks ?? []);
  const answers = doubts === state.asked && question.isRead(timeOf(press));
  state.asked = doubts;
  question.show(doubts);
  if (doubts && !answers) {
    showGo(state.judged);
    return tell(doubts, true, "/run");
  }
  if (found) choose("run");
  await beginRun();
}

function showRun() {
  const lines = runLines("placing.done");
  renew(byId("run"), element("h2", {}, word("start.run")),
    ...(lines.length ? lines : [element("p", { class: "muted" }, word("start.run.idle"))]));
  if (state.found) showGo(state.judged);
  const { state: now } = runNow();
  if (now === "running" && state.tab !== "run") choose("run");
  if (now === "failed" || now === "cancelled") load();
}

/** @param {string} tab */
function choose(tab) {
  state.tab = tab;
  for (const name of TABS) byId(name).hidden = name !== tab;
  for (const button of all("#tabs button")) {
    button.classList.toggle("on", button.dataset.tab === tab);
    button.setAttribute("aria-selected", `${button.dataset.tab === tab}`);
  }
  if (tab === "neighbours") showNeighbours();
}

function listenToDrops() {
  const over = (/** @type {boolean} */ on) => byId("drop").classList.toggle("over", on);
  addEventListener("dragover", (event) => {
    event.preventDefault();
    over(true);
  });
  addEventListener("dragleave", () => over(false));
  addEventListener("drop", (event) => {
    event.preventDefault();
    over(false);
    if (event.dataTransfer) dropped(event.dataTransfer);
  });
}

/** To all but the one who did it: why the desk is closed, and how it opens again. */
function tellWhoLeft() {
  const { left } = start;
  const others = left && left.mark !== sessionStorage.getItem("gruber.leaving");
  byId("left").hidden = !others;
  if (left && others) byId("left").textContent = word("start.left", { who: left.who });
}

async function begin() {
  Object.assign(start, await (await fetch("/start")).json());
  document.title = `${start.name} \u00b7 ${word("start")}`;
  fillWords();
  byId("name").textContent = document.title;
  setUpTheme();
  tellWhoLeft();
  first("[data-act=theme]").addEventListener("click", nextTheme);
  byId("tabs").replaceChildren(...TABS.map((name) => element("button",
    { role: "tab", "data-tab": name, onclick: () => choose(name) }, word(`start.${name}`))));
  choose("film");
  setUpFilm();
  setUpNeighbours(open);
  await load();
  listenToDrops();
  window.gruber = { found: () => state.found, values: formValues, run: runNow, send, load };
  watchRun(showRun);
}

begin().catch((error) => {
  document.body.textContent = String(error);
});
