// Faults of the mosaic: marked at a place, answered, closed and opened again.
import { Question, once, onceRead } from "./asked.js";
import { FONT, halo, text } from "./overlay.js";
import { boxOf, isInside, roomFor } from "./mosaic_marks.js";
import { byId, clamped, element, moment, shortName, start, word } from "./words.js";
import { isOwn } from "./people.js";
import { send } from "./wire.js";

const KINDS = ["double", "smear", "cloud", "cut", "tone", "shift", "other"];
const OPEN = "#ff5d8f";
const CLOSED = "#9aa7b4";
const ARM_PX = 6; // design: seen beside an arrow of misfit, and no wider than a double image
const NEAR_PX = 16; // design: marks nearer than this lie over each other, and share one
/** Whether the fault is open: a press is not meant for a button that has just changed its word. */
const turning = new Question();
const state = {
  kind: "", of: "", words: "", assigned: "", answer: "", chosen: 0,
  /** True until the desk has taken what was said: it is said once. */
  saying: false,
};

/** @typedef {"words" | "assigned" | "answer"} Text */

/** @param {object} said */
function say(said) {
  if (state.saying) return false;
  state.saying = send({ kind: "remark", ...said }, () => { state.saying = false; });
  return state.saying;
}

/** @param {Text} name @param {string} label */
const field = (name, label) => element("input", { id: `fault-${name}`, value: state[name],
  maxlength: name === "assigned" ? 40 : 2000, disabled: start.guest, placeholder: word(label),
  "aria-label": word(label), oninput: (/** @type {Event} */ { target }) => {
    state[name] = /** @type {HTMLInputElement} */ (target).value;
  } });

/** What is wrong at the place that is picked. @param {PickedPlace | null} picked */
export function markFault(picked) {
  if (!picked) return [];
  const kind = element("select", { id: "fault-kind", "aria-label": word("fault.kind"),
    disabled: start.guest, onchange: (/** @type {Event} */ { target }) => {
      state.kind = /** @type {HTMLSelectElement} */ (target).value;
      marks.disabled = start.guest || !state.kind;
    } }, element("option", { value: "", disabled: true, selected: !state.kind },
    word("fault.choose")), ...KINDS.map((one) =>
    element("option", { value: one, selected: one === state.kind }, word(`fault.${one}`))));
  const photos = (picked.others ?? []).map(([name]) => name);
  if (!photos.includes(state.of)) state.of = "";
  const of = element("select", { id: "fault-of", "aria-label": word("fault.of"),
    disabled: start.guest, onchange: (/** @type {Event} */ { target }) => {
      state.of = /** @type {HTMLSelectElement} */ (target).value;
    } }, ...["", ...photos].map((name) => element("option", { value: name, title: name,
    selected: name === state.of }, name ? word("fault.of.photo", { photo: shortName(name) })
      : word("fault.of.mosaic"))));
  const mark = () => {
    const about = state.of ? { subject: "photo", name: state.of } : { subject: "place" };
    if (say({ ...about, place: picked.place.slice(0, 2), fault: state.kind, words: state.words,
      assigned: state.assigned })) {
      Object.assign(state, { kind: "", words: "", assigned: "" });
    }
  };
  const marks = element("button", { id: "fault-mark", onclick: once(mark),
    disabled: start.guest || !state.kind, title: word("fault.mark.tip") }, word("fault.mark"));
  return [element("div", { class: "acts fault-form" }, kind, of, field("words", "fault.words"),
    field("assigned", "fault.assigned"), marks)];
}

/**
 * Every fault, open ones first; the chosen one with what was answered.
 * @param {Mosaic} found @param {(ground: Pair) => void} ask @param {() => void} changed
 */
export function faultList({ faults = [] }, ask, changed) {
  if (!faults.length) return [element("p", { class: "muted" }, word("faults.none"))];
  const lines = faults.flatMap((fault) => {
    const choose = () => {
      state.chosen = state.chosen === fault.id ? 0 : fault.id;
      state.answer = "";
      if (state.chosen) ask(fault.place);
      changed();
      showThread();
    };
    const shown = state.chosen === fault.id;
    const line = element("button", { class: `scan${shown ? " on" : ""}`,
      "data-fault": `${fault.id}`, onclick: choose, "aria-expanded": `${shown}` },
    element("span", { class: fault.open ? "doubted" : "" }, word(`fault.${fault.kind}`)),
    element("span", { class: "muted" }, [[shortName(fault.photo),
      word(fault.open ? "fault.open" : "fault.closed")].filter(Boolean).join(" \u00b7 "),
    fault.assigned].filter(Boolean).join(" \u2192 ")));
    return shown ? [line, thread(fault)] : [line];
  });
  const open = faults.filter((one) => one.open).length;
  return [element("h3", {}, word("faults", { count: faults.length, open })),
    element("div", { class: "scans", id: "mosaic-faults" }, ...lines)];
}

/** Bring the answers of the chosen fault into sight. */
export const showThread = () =>
  document.querySelector(".fault-thread")?.scrollIntoView({ block: "nearest" });

/** @param {Fault} fault */
function thread({ id, open, said }) {
  const answer = (/** @type {boolean | null} */ closes) => {
    const whole = { subject: "decision", name: `${id}`, words: state.answer, closes };
    if (!say(whole)) return;
    state.answer = "";
    /** @type {HTMLInputElement} */ (byId("fault-answer")).value = "";
  };
  const turn = open ? "fault.close" : "fault.open-again";
  turning.show(`${id} ${open}`);
  const lines = said.map(({ who, when, words, closes }) => element("p", {},
    element("b", {}, who), ` ${moment(when)} UTC `, closes === null ? ""
      : `${word(closes ? "fault.closed" : "fault.open")} `, clamped(words)));
  return element("div", { class: "fault-thread" }, ...lines, element("div",
    { class: "acts fault-form" }, field("answer", "remark.words"),
    element("button", { id: "fault-say", disabled: start.guest, onclick: once(() => {
      if (state.answer.trim()) answer(null);
      else byId("fault-answer").focus();
    }) }, word("fault.answer")),
    element("button", { id: "fault-turn", disabled: start.guest,
      onclick: once(() => onceRead(() => answer(open), turning)) }, word(turn)),
    ...isOwn(said[0]) ? [element("button", { id: "fault-back", title: word("history.back.tip"),
      onclick: () => send({ kind: "back", decision: id }) }, word("history.back"))] : []));
}

/**
 * Faults whose marks would lie over each other, together.
 * @param {Mosaic} found @param {(ground: Pair) => Pair} onScreen
 */
function grouped({ faults = [] }, onScreen) {
  const groups = /** @type {{ at: Pair, faults: Fault[] }[]} */ ([]);
  for (const fault of faults) {
    const at = onScreen(fault.place);
    const near = groups.find(({ at: [x, y] }) => Math.hypot(at[0] - x, at[1] - y) < NEAR_PX);
    if (near) near.faults.push(fault);
    else groups.push({ at, faults: [fault] });
  }
  return groups;
}

/**
 * The fault under the hand is chosen; of several at one mark the next one, click by click.
 * @param {Mosaic} found @param {(ground: Pair) => Pair} onScreen @param {Pair} hand on the screen
 */
export function chooseFault(found, onScreen, [x, y]) {
  const under = grouped(found, onScreen).find(({ at }) =>
    Math.hypot(at[0] - x, at[1] - y) < NEAR_PX)?.faults ?? [];
  if (!under.length) return null;
  const next = under[(under.findIndex(({ id }) => id === state.chosen) + 1) % under.length];
  if (next.id !== state.chosen) Object.assign(state, { chosen: next.id, answer: "" });
  return next;
}

/** The fault whose answers are shown. */
export const isChosen = (/** @type {Fault} */ { id }) => id === state.chosen;

/**
 * A cross at every fault; where several lie over each other one cross, with all their kinds.
 * @param {Context} context @param {Mosaic} found @param {(ground: Pair) => Pair} onScreen
 */
export function drawFaults(context, found, onScreen) {
  const { clientWidth, clientHeight } = context.canvas;
  const groups = grouped(found, onScreen);
  const taken = groups.map(({ at: [x, y] }) => boxOf([x - ARM_PX, y + ARM_PX], 2 * ARM_PX));
  context.font = FONT;
  for (const { at: [x, y], faults } of groups) {
    if (!isInside([x, y], [clientWidth, clientHeight])) continue;
    const chosen = faults.some(isChosen);
    const colour = faults.some(({ open }) => open) ? OPEN : CLOSED;
    halo(context, colour, chosen ? 3.6 : 2.4, () => {
      for (const way of [1, -1]) {
        context.moveTo(x - ARM_PX, y - way * ARM_PX);
        context.lineTo(x + ARM_PX, y + way * ARM_PX);
      }
    });
    if (faults.length === 1 && colour === CLOSED && !chosen) continue;
    const kinds = faults.map(({ kind }) => word(`fault.${kind}`)).join(", ");
    const said = faults.length > 1 ? word("fault.several", { count: faults.length, kinds }) : kinds;
    const wide = context.measureText(said).width;
    const place = roomFor(wide, [x, y], false, [clientWidth, clientHeight], taken);
    taken.push(boxOf(place, wide));
    text(context, said, place, colour);
  }
}
