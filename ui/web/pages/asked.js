// What the desk asks or says above the buttons that decide: a draft to keep or drop, the reason of
// a rejection, or how a point is placed.
import { now, pressedAt } from "./keys.js";
import { byId, element, number, renew, shortName, shortPoint, stateGlyph, word } from "./words.js";
import { letterOf } from "./view.js";
import { send } from "./wire.js";

const REASON_MS = 6000; // design: time to read five reasons; after it digits mean nothing
const READ_MS = 300; // design: nobody reads a question sooner; a second key until then is none

/** All that this page asks. @type {Question[]} */
const questions = [];

/** Something to be read before it is answered: what was pressed before it was in sight is none. */
export class Question {
  #said = "";

  #since = 0;

  constructor() {
    questions.push(this);
  }

  /** @param {string} said what is asked; nothing when empty */
  show(said) {
    if (said === this.#said) return;
    this.#said = said;
    this.again();
  }

  /** In sight again, after something lay over it: it is to be read again. */
  again() {
    const said = this.#said;
    this.#since = Infinity;
    requestAnimationFrame(() => {
      if (said === this.#said) this.#since = Math.min(this.#since, now());
    });
  }

  /** False where it came into sight only just before, or not yet. @param {number} then */
  isRead(then = now()) {
    return !this.#said || then - this.#since >= READ_MS;
  }

  /** Whether what was pressed last can answer it: it is not meant before it. */
  wasRead() {
    return this.isRead(pressedAt());
  }
}

/** False where something came into sight only just before. */
export const areRead = () => questions.every((one) => one.isRead());

/** What is asked before something weighty is done. */
export const question = new Question();
const state = {
  point: /** @type {Point | null} */ (null),
  /** How many rows are marked: nothing is asked about one of them. */
  many: 0,
  /** The measurements just rejected, and until when a digit is their reason. */
  explaining: /** @type {Key[]} */ ([]),
  until: 0,
  timer: 0,
  notices: /** @type {HTMLElement | null} */ (null),
  /** The question before a weighty decision is taken back. */
  turning: /** @type {Notice | null} */ (null),
  tell: /** @type {(notice: Notice) => void} */ (() => {}),
};

/** @param {(notice: Notice) => void} tell */
export function setUpAsked(tell) {
  state.tell = tell;
  for (const type of ["pointerdown", "click", "close"]) {
    window.addEventListener(type, ({ target }) => {
      // Notices in a sheet that is closed are to be seen all the same, and so are questions.
      if (type === "close") {
        noticeRoom();
        for (const one of questions) one.again();
      }
      const own = target instanceof Element
        && target.closest("#turning, #asked.turning, [data-act=undo]");
      if (!own) dropTurning();
    }, true);
  }
}

/** @param {Point | null} point */
export function askAbout(point) {
  state.point = point;
  show();
}

/** @param {number} many rows that are marked */
export function askAboutMany(many) {
  if (many === state.many) return;
  state.many = many;
  show();
}

/** @param {Key[]} explaining the measurements just rejected */
export function askWhy(explaining) {
  if (JSON.stringify(explaining) === JSON.stringify(state.explaining)) return;
  clearTimeout(state.timer);
  Object.assign(state, { explaining, until: explaining.length ? Date.now() + REASON_MS : 0 });
  if (explaining.length) state.timer = setTimeout(show, REASON_MS);
  show();
}

/** @param {Notice | null} turning the question before a weighty decision is taken back */
export function askBack(turning) {
  if (JSON.stringify(turning) === JSON.stringify(state.turning)) return;
  state.turning = turning;
  show();
}

/** The reason of what was just rejected; false when none is asked for. @param {number} digit */
export function explain(digit) {
  if (Date.now() >= state.until) return false;
  state.until = 0;
  send({ kind: "explain", digit });
  show();
  return true;
}

/** The question in sight answered with no, or the draft given up; false when there is neither. */
export function dropDraft() {
  const { point } = state;
  return dropTurning() || Boolean(point?.draft) && send({ kind: "drop", key: point?.key });
}

/** The question before something is taken back goes, which is about no measurement. */
function dropTurning() {
  if (!state.turning) return false;
  askBack(null);
  return send({ kind: "drop", key: ["", ""] });
}

/**
 * Any key but that of undo answers the question with no; true for the one that does nothing else.
 * @param {KeyboardEvent} event
 */
export function answersNo(event) {
  const again = letterOf(event) === "KeyU" && !event.shiftKey;
  if (event.type !== "keydown" || again || ["Shift", "Tab"].includes(event.key)) return false;
  return dropTurning() && event.key === "Escape";
}

/**
 * `U` answers it with yes, in a sheet that has no undo of its own.
 * @param {KeyboardEvent} event
 */
export function answersYes(event) {
  if (!state.turning || event.type !== "keydown" || letterOf(event) !== "KeyU") return false;
  if (!event.repeat) undo();
  return true;
}

/** Where scans are proposed to show the point. @param {Point} point */
const proposalsOf = ({ others }) => others.filter(({ state: known }) => known === "proposed");

/**
 * All of them as one decision; what is likelier wrong than right is left.
 * @param {Point | null | undefined} point
 */
export function acceptProposals(point) {
  const proposed = point ? proposalsOf(point) : [];
  const likely = proposed.filter(({ score }) => (score ?? 0) > 0.5);
  const keys = likely.map(({ photo }) => [point?.key[0], photo]);
  const left = proposed.length - keys.length;
  if (keys.length) send({ kind: "judge", keys, verdict: "accept" });
  if (left) state.tell({ text: "notice.unlikely", values: { count: `${left}` }, grave: false });
  else if (!keys.length) notice("notice.no-proposal");
}

/**
 * Done once the question is read; else it is said that nothing was.
 * @param {() => unknown} act @param {Question} asked
 */
export function onceRead(act, asked = question) {
  if (asked.wasRead()) act();
  else notice("notice.unread");
}

/**
 * What was done last is taken back; what is asked about first is answered by doing it once more.
 * @param {object} [about] the fiducial that is shown
 */
export const undo = (about = {}) =>
  onceRead(() => send({ kind: "undo", asked: state.turning !== null, ...about }));

/** `U`, or with Shift what was taken back is done again. @param {KeyboardEvent} event */
export const undoOrRedo = ({ shiftKey }) => (shiftKey ? send({ kind: "redo" }) : undo());

/** Where notices stand: what is to be seen over an open sheet must lie in it. */
export function noticeRoom() {
  // A sheet that was drawn anew may have thrown them out of the page.
  state.notices ??= byId("notices");
  const home = document.querySelector("dialog[open]") ?? document.body;
  if (state.notices.parentElement !== home) home.append(state.notices);
  return state.notices;
}

/** @param {string} text */
export const notice = (text) => state.tell({ text, values: {}, grave: false });

function show() {
  const { explaining, many, turning, until } = state;
  const point = many ? null : state.point;
  question.show(turning ? JSON.stringify(turning) : point?.draft?.asking ? `${point.key}` : "");
  document.getElementById("turning")?.remove();
  if (turning) return showTurning(turning);
  const why = explaining.length > 0 && Date.now() < until && !point?.draft?.asking;
  const room = byId("asked");
  room.className = why ? "why" : point?.draft ? (point.draft.asking ? "against" : "draft") : "";
  byId("reasons").hidden = !why;
  byId("keep").hidden = why || !point?.draft;
  const count = point && !why && !point.draft ? proposalsOf(point).length : 0;
  byId("proposals").hidden = !count;
  byId("proposals-said").textContent = word("proposals", { count });
  byId("hint").hidden = why || Boolean(point?.draft) || count > 0 || !(point || many);
  byId("hint").textContent = many ? word("many.hint") : word("place.hint");
  if (why) showReasons(explaining);
  if (!why && point?.draft) showDraft(point);
  // What is hidden is read out all the same.
  else byId("keep").replaceChildren();
}

/** In sight as long as it is asked: in a sheet that lies over the desk. @param {Notice} turning */
function showTurning({ text, values }) {
  const said = word(text, values);
  const asked = [element("p", { title: said }, said),
    answer("history.back", "U", () => undo()),
    answer("remake.cancel", "Esc", dropTurning)];
  const sheet = document.querySelector("dialog[open]");
  if (sheet || !byId("asked").checkVisibility({ visibilityProperty: true })) {
    (sheet ?? document.body).append(
      element("div", { id: "turning", class: "asked-over", role: "alert" }, ...asked));
    return;
  }
  byId("asked").className = "against turning";
  for (const name of ["reasons", "proposals", "hint"]) byId(name).hidden = true;
  byId("keep").hidden = false;
  renew(byId("keep"), ...asked);
}

/** The second click of a double click answers nothing. @param {() => unknown} act */
export const once = (act) => (/** @type {MouseEvent} */ { detail }) => detail < 2 && act();

/** @param {string} name @param {string} cap @param {() => unknown} act */
const answer = (name, cap, act) =>
  element("button", { class: "small", "data-answer": name, onclick: once(() => onceRead(act)) },
    word(name), element("kbd", {}, cap));

/** @param {Key[]} explaining */
function showReasons(explaining) {
  const choices = [1, 2, 3, 4, 5].map((digit) => element("button",
    { class: "small", onclick: once(() => explain(digit)) },
    element("kbd", {}, `${digit}`), word(`reason.${digit}`)));
  renew(byId("reasons"),
    element("p", { title: explaining.map((key) => key.join(" \u00b7 ")).join("\n") },
      stateGlyph("rejected", 13), explaining.length > 1
        ? word("reason.ask.many", { count: explaining.length })
        : word("reason.ask", {
          point: shortPoint(explaining[0][0]), scan: shortName(explaining[0][1]) })), ...choices);
}

/** A sentence about others that a decision would leave out. @param {Trial | null} trial */
export const leftOut = (trial) => (trial?.out.length ? [word("trial.out", {
  count: trial.out.length, point: shortPoint(trial.out[0][0]), scan: shortName(trial.out[0][1]),
})] : []);

/** @param {Point} point */
function showDraft({ key, draft, figures, role, trial }) {
  const values = {
    sigma: number(figures.ratio, (figures.ratio ?? 0) < 10 ? 1 : 0),
    shift: trial && number(trial.shift, 2), scan: trial && shortName(trial.photo),
  };
  // A check point moves nothing.
  const still = role === "check" ? "draft.against" : "draft.against.wait";
  const [plain, moved] = draft?.asking ? [still, "draft.against.moved"] : ["draft", "draft.moved"];
  const measured = figures.ratio === null ? word("draft.alone")
    : word(trial ? moved : plain, values);
  const who = draft?.asking && draft.opponent;
  const said = [...(who ? [word("draft.opposed", { who })] : []), ...leftOut(trial), measured]
    .join(" ");
  renew(byId("keep"), element("p", { title: said }, said),
    answer("draft.keep", "Y", () => send({ kind: "judge", key, verdict: "accept" })),
    answer("draft.drop", "Esc", dropDraft));
}
