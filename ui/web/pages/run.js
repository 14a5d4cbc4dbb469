// A run that was begun on a page: a line for each stage, what is left of it, cancel and log.
import { Question, noticeRoom } from "./asked.js";
import { timeOf } from "./keys.js";
import { again, all, byId, element, number, start, word } from "./words.js";

const BUSY_MS = 700; // design: a run is watched closely, an idle page now and then
const IDLE_MS = 4000;
const state = {
  run: /** @type {Run} */ ({ state: "idle", lines: [], stages: [], log: [] }),
  timer: 0,
  changed: /** @type {() => void} */ (() => {}),
};

export const runNow = () => state.run;

/** @param {string} address @param {unknown} body */
export async function post(address, body = {}) {
  const headers = { "content-type": "application/json" };
  const answer = await fetch(address, { method: "POST", body: JSON.stringify(body), headers })
    .catch(() => null);
  if (!answer) return { ok: false, error: word("notice.wire") };
  settle(address);
  const isJson = answer.headers.get("content-type")?.includes("json");
  if (isJson) return { ok: answer.ok, ...(await answer.json()) };
  const error = answer.status === 403 ? word(start.looking ? "notice.read-only" : "notice.guest")
    : await answer.text();
  return { ok: answer.ok, error };
}

/**
 * A notice, which stays until the same is answered anew, it is clicked away, or a while.
 * @param {Told} said @param {string} about address that was asked; nothing for what stands alone
 */
export function tell(said, grave = false, about = "") {
  const kind = `notice${grave ? " grave" : ""}`;
  const box = element("div", { class: kind, "data-about": about, onclick: () => box.remove() },
    again(said));
  noticeRoom().append(box);
  setTimeout(() => box.remove(), grave ? 30000 : 3500);
}

/** What was said about it no longer holds; or only what was refused. @param {string} about */
export function settle(about, refused = false) {
  const kind = refused ? ".notice.grave" : ".notice";
  for (const box of all(`${kind}[data-about="${about}"]`)) box.remove();
}

export async function beginRun() {
  const answer = await post("/run");
  if (answer.ok === false) tell(answer.error ?? "", true, "/run");
  else state.run = answer;
  state.changed();
  watchRun(state.changed);
}

async function cancelRun() {
  state.run.cancelling = true;
  state.changed();
  const answer = await post("/run/cancel");
  if (answer.ok === false) tell(answer.error ?? "", true);
  watchRun(state.changed);
}

/** What stops the run: out of use once it was asked to. */
export const cancelButton = () => element("button", { type: "button", "data-act": "remake.cancel",
  disabled: start.guest || state.run.cancelling, onclick: cancelRun },
word(state.run.cancelling ? "run.cancelling" : "remake.cancel"));

/**
 * Ask again and again how far the run is. What follows on the same port, such as the desk, takes
 * this page's place.
 * @param {() => void} changed called whenever it is farther
 */
export async function watchRun(changed) {
  state.changed = changed;
  clearTimeout(state.timer);
  try {
    const before = JSON.stringify(state.run);
    const answer = await fetch("/run");
    if (!answer.ok) return await lookAgain();
    state.run = await answer.json();
    if (JSON.stringify(state.run) !== before) changed();
  } catch {
    return lookAgain();
  }
  // The desk, which may have taken this port, knows runs of its own: only its edition tells.
  const wait = state.run.state === "done" ? BUSY_MS : IDLE_MS;
  if (state.run.state !== "running") return lookAgain(wait);
  state.timer = setTimeout(() => watchRun(changed), BUSY_MS);
}

/** True while a run is under way, whoever began it. */
export async function isRunning() {
  const answer = await fetch("/run").catch(() => null);
  return Boolean(answer?.ok) && (await answer?.json()).state === "running";
}

/**
 * Files and settings take the place of this page, for everybody who has it open.
 * @param {() => string[]} hinders what would be lost, who is disturbed: it is said, and asked, once
 * @param {() => void} leave done once the page makes room
 */
export function setUpSettings(hinders = () => [], leave = () => {}) {
  const button = byId("settings-open");
  const question = new Question();
  let asked = "";
  button.title = word("settings.tip");
  button.addEventListener("click", async (press) => {
    const run = await isRunning() ? [word("settings.stop")] : [];
    const whys = [...new Set([...hinders(), ...run])];
    const before = asked;
    asked = whys.join();
    // One that was clicked away, or is long gone, is asked anew.
    const notices = all(`.notice[data-about="${button.id}"]`);
    const stands = notices.some((one) => one.checkVisibility());
    if (!stands) question.show("");
    question.show(asked);
    const read = stands && question.isRead(timeOf(press));
    if (whys.length && (asked !== before || !read)) {
      settle(button.id);
      return whys.forEach((why) => tell(why, true, button.id));
    }
    // By this mark the page that follows knows whose doing it was.
    const mark = `${Math.random()}`;
    sessionStorage.setItem("gruber.leaving", mark);
    const who = localStorage.getItem("gruber.name") ?? "";
    const answer = await post("/settings", { who, mark });
    if (answer.ok === false) tell(answer.error ?? "", true);
    else leave();
  });
}

/** Another page may be open at this address by now. */
export async function lookAgain(wait = BUSY_MS) {
  const answer = await fetch("/start").catch(() => null);
  const edition = answer?.ok ? (await answer.json()).edition : start.edition;
  if (edition !== start.edition) return location.reload();
  clearTimeout(state.timer);
  state.timer = setTimeout(() => watchRun(state.changed), wait);
}

/** @param {number} seconds */
const clock = (seconds) =>
  `${Math.floor(seconds / 60)}:${`${Math.round(seconds % 60)}`.padStart(2, "0")}`;

/** The run as it is shown. @param {string} done what is said at the end */
export function runLines(done) {
  const { run } = state;
  if (run.state === "idle") return [];
  const walked = new Set(run.lines.map(({ stage }) => stage));
  const after = run.state === "running" || run.state === "cancelled"
    ? run.stages.filter((stage) => !walked.has(stage)) : [];
  const table = element("div", { class: "stages" }, ...run.lines.flatMap(stageLine),
    ...after.map((stage) => element("div", { class: "stage later" },
      element("span", {}, "\u00b7"), element("span", {}, word(`stage.${stage}`)))));
  const ends = {
    running: null, idle: null,
    failed: element("p", { class: "doubted", role: "alert" }, again(run.why ?? "")),
    cancelled: element("p", {}, word("run.cancelled")), done: element("p", {}, word(done)),
  };
  const log = run.log.length
    ? [element("details", { class: "log" }, element("summary", {}, word("run.log")),
      element("pre", {}, run.log.map(again).join("\n")))] : [];
  return [table, ends[run.state], ...log].filter((part) => part !== null);
}

/** @param {RunLine} line */
function stageLine({ stage, pass, seconds, said, share, what, taken, left }) {
  const passed = pass > 1 ? ` (${word("run.pass", { pass })})` : "";
  const title = element("span", {}, word(`stage.${stage}`), passed);
  if (seconds !== undefined) {
    return [element("div", { class: "stage ended" }, element("span", {}, "\u2713"), title,
      element("span", { class: "muted" }, number(seconds, 1, "s")),
      element("span", { class: "said muted", title: again(said ?? "") }, again(said ?? "")))];
  }
  const stopped = state.run.state !== "running";
  const bar = element("i");
  bar.style.width = `${100 * share}%`;
  const time = left === null || left === undefined ? clock(taken ?? 0)
    : word("run.left", { taken: clock(taken ?? 0), left: clock(left) });
  return [element("div", { class: `stage ${stopped ? "stopped" : "now"}` },
    element("span", {}, stopped ? "\u2717" : "\u25b8"), title,
    element("span", { class: "muted" }, stopped ? "" : time),
    element("span", { class: "share", role: "progressbar",
      "aria-label": word(`stage.${stage}`), "aria-valuenow": Math.round(100 * share) }, bar),
    element("span", { class: "said muted" }, stopped ? "" : again(what)))];
}
