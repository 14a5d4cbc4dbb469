// Faults of the mosaic: marked at a place, answered, closed and opened again.
import { once } from "./asked.js";
import { halo, text } from "./overlay.js";
import { byId, element, moment, shortName, start, word } from "./words.js";
import { isOwn } from "./people.js";
import { send } from "./wire.js";

const KINDS = ["double", "smear", "cloud", "cut", "tone", "shift", "other"];
const OPEN = "#ff5d8f";
const CLOSED = "#9aa7b4";
const ARM_PX = 6; // design: seen beside an arrow of misfit, and no wider than a double image
const state = {
  kind: KINDS[0], of: "", words: "", assigned: "", answer: "", chosen: 0,
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
    } }, ...KINDS.map((one) =>
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
      Object.assign(state, { words: "", assigned: "" });
    }
  };
  return [element("div", { class: "acts fault-form" }, kind, of, field("words", "fault.words"),
    field("assigned", "fault.assigned"), element("button", { id: "fault-mark", onclick: once(mark),
      disabled: start.guest, title: word("fault.mark.tip") }, word("fault.mark")))];
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
    };
    const shown = state.chosen === fault.id;
    const line = element("button", { class: "scan", "data-fault": `${fault.id}`, onclick: choose,
      "aria-expanded": `${shown}` },
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

/** @param {Fault} fault */
function thread({ id, open, said }) {
  const answer = (/** @type {boolean | null} */ closes) => {
    const whole = { subject: "decision", name: `${id}`, words: state.answer, closes };
    if (say(whole)) state.answer = "";
  };
  const turn = open ? "fault.close" : "fault.open-again";
  const lines = said.map(({ who, when, words, closes }) => element("p", {},
    element("b", {}, who), ` ${moment(when)} UTC `, closes === null ? ""
      : `${word(closes ? "fault.closed" : "fault.open")} `, words));
  return element("div", { class: "fault-thread" }, ...lines, element("div",
    { class: "acts fault-form" }, field("answer", "remark.words"),
    element("button", { id: "fault-say", disabled: start.guest, onclick: once(() => {
      if (state.answer.trim()) answer(null);
      else byId("fault-answer").focus();
    }) }, word("fault.answer")),
    element("button", { id: "fault-turn", disabled: start.guest,
      onclick: once(() => answer(open)) }, word(turn)),
    ...isOwn(said[0]) ? [element("button", { id: "fault-back", title: word("history.back.tip"),
      onclick: () => send({ kind: "back", decision: id }) }, word("history.back"))] : []));
}

/**
 * A cross at every fault.
 * @param {Context} context @param {Mosaic} found @param {(ground: Pair) => Pair} onScreen
 */
export function drawFaults(context, { faults = [] }, onScreen) {
  for (const { id, place, open, kind } of faults) {
    const [x, y] = onScreen(place);
    const colour = open ? OPEN : CLOSED;
    halo(context, colour, 2.4, () => {
      for (const way of [1, -1]) {
        context.moveTo(x - ARM_PX, y - way * ARM_PX);
        context.lineTo(x + ARM_PX, y + way * ARM_PX);
      }
    });
    if (open || id === state.chosen) {
      text(context, word(`fault.${kind}`), [x + ARM_PX + 4, y - ARM_PX], colour);
    }
  }
}
