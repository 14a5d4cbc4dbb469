// Under Block quality: what readings say, the rules of the job, and who vouches for the block.
import { between, clamped, element, moment, number, shortName, start, word } from "./words.js";
import { Question, once, onceRead } from "./asked.js";
import { isOwn } from "./people.js";
import { send } from "./wire.js";

const VERDICTS = ["accept", "accept-with-remarks", "reject"];
/** What one vouches for: who signs has seen it as it is. */
const question = new Question();
const state = {
  verdict: "", remark: "",
  /** Signatures that were there when one was asked for. */
  before: /** @type {number[] | null} */ (null),
  /** True until the desk has answered. */
  signing: false,
};

/** @param {string} name @param {(Node | string)[]} children */
const part = (name, ...children) => element("section",
  { class: "quality-part", "data-part": name }, element("h3", {}, word(name)), ...children);

/** @param {string | Node} content */
const cell = (content, kind = "") => element("td", { class: kind }, content);

/** @param {Quality} found */
export function signing({ signatures, judged }) {
  question.show(JSON.stringify(judged));
  const ids = signatures.map((one) => one.id);
  if (state.before && ids.some((id) => !state.before?.includes(id))) {
    Object.assign(state, { verdict: "", remark: "", before: null });
  }
  const lines = signatures.map((one) => element("p", {
    class: `decided signature${one.changed.length ? " doubted" : ""}`, "data-who": one.who,
  }, element("b", {}, word(`accepted.${one.verdict}`)),
  ` \u00b7 ${one.who} \u00b7 ${moment(one.when)} UTC \u00b7 `, element("code", {}, one.digest),
  ...one.remark ? [" \u00b7 ", clamped(word("detail.words", { words: one.remark }))] : [],
  one.changed.length ? element("span", { class: "outdated" }, " \u00b7 ",
    word("signed.outdated"), " ",
    one.changed.map((name) => word(`signed.part.${name}`)).join(between())) : "", " ",
  ...isOwn(one) ? [element("button", { class: "small",
    onclick: once(() => send({ kind: "back", decision: one.id })) }, word("history.back"))] : []));
  const select = element("select", { id: "sign-verdict", "aria-label": word("sign.verdict"),
    disabled: start.guest, onchange: (/** @type {Event} */ event) => {
      state.verdict = /** @type {HTMLSelectElement} */ (event.target).value;
      sign.disabled = start.guest || !state.verdict;
    } }, element("option", { value: "", disabled: true, selected: !state.verdict },
    word("sign.choose")), ...VERDICTS.map((verdict) => element("option",
    { value: verdict, selected: verdict === state.verdict },
    word(`accepted.${verdict}`))));
  const remark = element("input", { id: "sign-remark", value: state.remark, maxlength: 2000,
    disabled: start.guest, placeholder: word("sign.remark"), "aria-label": word("sign.remark"),
    oninput: (/** @type {Event} */ event) => {
      state.remark = /** @type {HTMLInputElement} */ (event.target).value;
    } });
  const sign = element("button", { id: "sign", disabled: start.guest || !state.verdict,
    onclick: once(() => onceRead(() => {
      if (state.signing) return;
      state.before = ids;
      state.signing = send({ kind: "sign", verdict: state.verdict, remark: state.remark, judged },
        () => { state.signing = false; });
    }, question)) }, word("sign"));
  return part("sign.title", ...(lines.length ? lines
    : [element("p", { class: "muted" }, word("sign.none"))]),
  element("p", { class: "signing" }, select, remark, sign),
  element("p", { class: "muted" }, word("sign.hint")));
}

/**
 * A finding in words, with names as short as everywhere on the desk.
 * @param {string} name @param {Record<string, any>} values
 */
export function findingSaid(name, values) {
  const { worst, photo, class: of } = values;
  const shortened = of ? word(`class.${of}`) : worst ? shortName(worst) : "";
  return word(name, { ...values, ...(shortened ? { worst: shortened } : {}),
    ...(photo ? { photo: shortName(photo) } : {}) });
}

/** @param {string} name @param {Record<string, string>} values */
function valueSaid(name, values) {
  const value = findingSaid(name, values);
  return values.more ? word("rules.value.more", { value, more: Number(values.more) }) : value;
}

/**
 * @param {Quality} found
 * @param {(text: string, values: Record<string, string>) => Node[]} look leads to what was found
 */
export function ruled({ broken, rules }, look) {
  const heads = ["rule", "value", "limit", "source", "result"].map((name) =>
    element("th", {}, word(`rules.${name}`)));
  const lines = rules.map(([rule, grave, name, values, value, limit, source]) => element("tr",
    { "data-rule": rule }, cell(word(`rule.${rule}`)),
    element("td", { class: "why" }, valueSaid(value, values), " ",
      ...(grave ? look(name, values) : [])),
    cell(word(limit, values)),
    cell(element(source === "job" ? "b" : "span", {}, word(`rules.source.${source}`))),
    cell(element("b", { class: `grave${grave}` }, word(`grave.${grave}`)))));
  const hint = broken ? [element("p", { id: "rules-broken", class: "doubted" },
    word("rules.broken"))] : [];
  return part("rules", ...hint,
    element("table", { class: "rules" }, element("tr", {}, ...heads), ...lines));
}

/** @param {string} name @param {ReadRow} row */
function readRow(name, { count, mean, shifted, interval, extreme, ...row }) {
  const { scatter, rms, mp, ce90, nmad } = row;
  const figures = [
    ...mean.map((value, axis) => cell(number(value, 3), shifted[axis] ? "warned" : "")),
    ...[...scatter, ...rms, mp].map((value) => cell(number(value, 3))),
    cell(interval.map((value) => number(value, 2)).join("\u2013")),
    ...[ce90, ...nmad].map((value) => cell(number(value, 3))),
    ...extreme.map((value) => cell(number(value, 2))),
  ];
  return element("tr", { "data-observer": name }, cell(name), cell(`${count}`), ...figures);
}

/** @param {Quality} found */
export function readings({ read, reads }) {
  if (reads) return part("checks", element("p", { class: "muted" }, word("checks.blind")));
  if (!read) return part("checks", element("p", { class: "muted" }, word("checks.none")));
  const said = word("checks.figures", { read: read.read, planned: read.planned,
    doubled: read.doubled, unreadable: read.unreadable });
  if (!read.read) return part("checks", element("p", {}, said));
  const heads = [word("head.observer"), "n", "c_X", "c_Y", "s_X", "s_Y", "m_X", "m_Y", "m_p",
    "95 %", "CE90", "NMAD X", "NMAD Y", "\u0394X max", "\u0394Y max"].map((name) =>
    element("th", {}, name));
  const lines = [
    readRow(word("head.all-places"), read.together),
    ...read.observers.map(([who, row]) => readRow(who, row)),
    ...read.pairs.map(([one, other, row]) => readRow(`${one} / ${other}`, row)),
  ];
  return part("checks", element("p", {}, said),
    element("table", { class: "read" }, element("tr", {}, ...heads), ...lines));
}
