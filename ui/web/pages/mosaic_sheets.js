// Drawn map sheets on the mosaic: gone through one by one, and said to be good or bad.
import { isInside } from "./mosaic_marks.js";
import { halo, text } from "./overlay.js";
import { once } from "./asked.js";
import { between, byId, element, number, start, word } from "./words.js";
import { send } from "./wire.js";

/** @type {Record<string, string>} */
const INKS = { good: "#7dffb2", bad: "#ff6b6b", open: "#b8c4d0" };
const state = {
  /** The sheet that is judged now; its name. */
  chosen: "",
  /** What was begun to be said of sheets, by their names. */
  drafts: /** @type {Map<string, string>} */ (new Map()),
  /** True until the view has been laid round the chosen sheet. */
  wanted: false,
  /** The sheet of which something was said that the desk has not taken yet: it is said once. */
  saying: "",
  /** What is shown, for the keys. */
  found: /** @type {Mosaic | null} */ (null),
  acts: /** @type {SheetActs | null} */ (null),
};

/**
 * @typedef {object} SheetActs
 * @property {(bounds: number[]) => void} frame lays the view round west, south, east, north
 * @property {() => void} refresh
 */

const sheetsOf = () => state.found?.sampled?.sheets ?? [];
const chosenSheet = () => sheetsOf().find(({ name }) => name === state.chosen);

/** The next time the mosaic is shown, it shows this sheet. @param {string} name */
export function wantSheet(name) {
  Object.assign(state, { chosen: name, wanted: true });
}

/** @param {SampledSheet} sheet west, south, east, north */
function boundsOf({ rings }) {
  const [easts, norths] = [0, 1].map((axis) => rings.flat().map((place) => place[axis]));
  return [Math.min(...easts), Math.min(...norths), Math.max(...easts), Math.max(...norths)];
}

/** Where the view is to go, once. @param {Mosaic} found */
export function wantedBounds(found) {
  state.found = found;
  const sheet = state.wanted && chosenSheet();
  if (!sheet) return null;
  state.wanted = false;
  return boundsOf(sheet);
}

/** Goes on from the chosen sheet, round and round. @param {number} step */
function go(step) {
  const sheets = sheetsOf();
  const at = sheets.findIndex(({ name }) => name === state.chosen);
  show(sheets[(at + step + sheets.length) % sheets.length]);
}

/** @param {SampledSheet | undefined} sheet */
function show(sheet) {
  if (!sheet) return;
  wantSheet(sheet.name);
  state.wanted = false;
  state.acts?.frame(boundsOf(sheet));
  state.acts?.refresh();
}

/** @param {boolean} good */
function say(good) {
  const { chosen, saying, found } = state;
  const words = state.drafts.get(chosen) ?? "";
  if (start.guest || !found || !chosenSheet()) return;
  if (!good && !words.trim()) {
    byId("sheet-words").focus();
    return;
  }
  if (saying === chosen) return;
  // What is wrong with a sheet is not said of a good one: half a word stays where it is.
  const sent = send({ kind: "sheet-judged", sheet: chosen, good, words: good ? "" : words,
    version: found.version }, () => { if (state.saying === chosen) state.saying = ""; });
  if (!sent) return;
  state.saying = chosen;
  if (!good) state.drafts.delete(chosen);
}

/** Why a sheet is what it is, in one line each. @param {SampledSheet} sheet */
export function whyOf({ faults, read, m_p: metres, interval, said }) {
  return [
    ...(faults ? [word("sheet.faults", { count: faults })] : []),
    ...(read ? [word("sheet.read", { count: read, value: number(metres, 2),
      low: number(interval[0], 2), high: number(interval[1], 2) })] : []),
    ...said.map(({ who, good, words, outdated }) => {
      const told = word(outdated ? "sheet.outdated" : "sheet.said",
        { who, state: word(good ? "sheet.good" : "sheet.bad") });
      return words ? `${told} ${word("detail.words", { words })}` : told;
    }),
  ].join(between());
}

/**
 * The chosen sheet and what is said of it; where none is chosen, a way to the first.
 * @param {Mosaic} found @param {SheetActs} acts
 */
export function sheetSide(found, acts) {
  Object.assign(state, { found, acts });
  const sheets = sheetsOf();
  if (!sheets.length) return [];
  const open = sheets.filter((one) => one.state === "open");
  const list = element("p", { class: "muted" }, word("sheet.list",
    { count: sheets.length, open: open.length }));
  const sheet = chosenSheet();
  if (!sheet) {
    return [list, element("div", { class: "acts" }, element("button", { id: "sheet-first",
      onclick: () => show(open[0] ?? sheets[0]) }, word("sheet.first")))];
  }
  const at = sheets.indexOf(sheet) + 1;
  const why = whyOf(sheet);
  const field = element("input", { id: "sheet-words", maxlength: 2000,
    value: state.drafts.get(sheet.name) ?? "", disabled: start.guest,
    placeholder: word("sheet.words"), "aria-label": word("sheet.words"),
    oninput: (/** @type {Event} */ { target }) => {
      state.drafts.set(sheet.name, /** @type {HTMLInputElement} */ (target).value);
    },
    onkeydown: (/** @type {KeyboardEvent} */ event) => {
      if (event.code !== "Enter" && event.code !== "Escape") return;
      // Keys are of the sheets again; without words the field keeps them, and asks for some.
      if (event.code === "Escape") /** @type {HTMLElement} */ (event.target).blur();
      else {
        byId("sheet-bad").focus();
        say(false);
      }
      event.preventDefault();
      event.stopPropagation();
    } });
  const button = (/** @type {string} */ id, /** @type {() => void} */ act, /** @type {string} */
    key, disabled = false) => element("button", { id: `sheet-${id}`, onclick: once(act), disabled },
    word(`sheet.act.${id}`), element("kbd", {}, key));
  return [
    element("h3", {}, element("button", { id: "sheet-name", class: "link",
      title: word("sheet.show"), onclick: () => show(sheet) },
    word("sheet.at", { name: sheet.name, at, count: sheets.length }))),
    element("p", { id: "sheet-state" }, element("b", { class: `sheet-${sheet.state}` },
      word(`sheet.${sheet.state}`)), why ? ` \u00b7 ${why}` : ""),
    list,
    element("div", { class: "acts sheet-form" }, field,
      button("good", () => say(true), "Y", start.guest),
      button("bad", () => say(false), "N", start.guest),
      button("before", () => go(-1), "K"), button("next", () => go(1), "J")),
  ];
}

/** True when the key is of the chosen sheet. @param {string} letter */
export function sheetKey(letter) {
  if (!sheetsOf().length) return false;
  if (letter === "KeyJ" || letter === "KeyK") go(letter === "KeyJ" ? 1 : -1);
  else if ((letter === "KeyY" || letter === "KeyN") && chosenSheet()) say(letter === "KeyY");
  else return false;
  return true;
}

/**
 * Outlines of all drawn sheets, in the colour of what they are; that of the chosen one is strong.
 * @param {Context} context @param {Mosaic} found @param {(ground: Pair) => Pair} onScreen
 */
export function drawSheets(context, { sampled }, onScreen) {
  for (const { name, rings, state: is } of sampled?.sheets ?? []) {
    const chosen = name === state.chosen;
    context.setLineDash(chosen ? [] : [2, 4]);
    halo(context, INKS[is], chosen ? 2.6 : 1.6, () => {
      for (const ring of rings.map((one) => one.map(onScreen))) {
        ring.forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
      }
    });
    context.setLineDash([]);
    const { clientWidth, clientHeight } = context.canvas;
    const places = rings.flat().map(onScreen);
    const corner = /** @type {Pair} */ ([Math.min(...places.map(([x]) => x)) + 5,
      Math.min(...places.map(([, y]) => y)) + 15]);
    if (isInside(corner, [clientWidth, clientHeight])) text(context, name, corner, INKS[is]);
  }
}

export const sheetState = () =>
  ({ chosen: state.chosen, words: state.drafts.get(state.chosen) ?? "" });
