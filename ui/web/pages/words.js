// What the page was told at the start: words, palette, lattice; and how to write with them.
import { SHAPES } from "./icons.js";

/** @type {Start} */
export const start = /** @type {any} */ ({
  words: {}, messages: {}, keys: [], palette: { states: {} }, photos: [],
});
const LONG = 200; // design: three lines of a narrow panel
const state = {
  prefix: "", suffix: "", halves: /** @type {number[] | null} */ (null),
  /** Long words that somebody wanted to read whole. @type {Set<string>} */
  whole: new Set(),
};
const NUMERAL = /^[+\-\u2212]?\d+(?:\.\d+)?$/;
/** A time as it is kept, or already shortened. */
const MOMENT = /^(\d{4})-(\d\d)-(\d\d)[T ](\d\d:\d\d)(?::\d\d(?:\.\d+)?(?:\+00:00)?)?$/;
const PLACE = /\{(\w+)(!r)?(?::([^{}]*))?\}/g;
const COORDINATES = /^([A-Za-z]*)(-?\d{5,})_(-?\d{5,})$/;

/** @param {string} key @param {Record<string, unknown>} values @returns {string} */
export const word = (key, values = {}) => filled(start.words[key] ?? key, values);

/**
 * What the engine said, in the language of the page; a terminal's quotes of commands are none here.
 * @param {Told} told @returns {string}
 */
export const again = (told) => (typeof told === "string" ? filled(start.messages[told] ?? told, {})
  : filled(start.messages[told.said] ?? told.said, told.values));

/** A day and time that no line breaks at a hyphen of. @param {string} when */
export const undivided = (when) => when.replaceAll("-", "-\u2060");

/** A key as the language calls it. @param {string} key */
export const keyName = (key) => start.words[`key.${key}`] ?? key;

/**
 * A sentence with its places filled.
 * @param {string} text @param {Record<string, unknown>} values @returns {string}
 */
const filled = (text, values) => text.replaceAll("`", "")
  .replace(PLACE, (whole, name, quoted, format = "") => {
    if ((values[name] ?? null) === null) return whole;
    return quoted ? `'${placed(values[name], format)}'` : placed(values[name], format);
  });

/**
 * One place of a sentence.
 * @param {any} value @param {string} format as `core/said.py` has it @returns {string}
 */
function placed(value, format) {
  if (format.includes("|")) {
    const forms = format.split("|");
    const form = forms[Math.min(nounForm(Number(value)), forms.length - 1)];
    return form.replaceAll("#", placed(value, typeof value === "number" ? "," : ""));
  }
  if (Array.isArray(value)) return value.map((one) => placed(one, format)).join(", ");
  if (typeof value === "number") return signed(formatted(value, format));
  if (typeof value === "string" && NUMERAL.test(value)) {
    return signed(format ? formatted(Number(value), format) : value);
  }
  if (typeof value === "string" && MOMENT.test(value)) return moment(value);
  return typeof value === "string" || value.said ? again(value) : String(value);
}

/** Which form of a noun goes with a number. @param {number} count */
function nounForm(count) {
  if (count === 1) return 0;
  if (start.language !== "cs") return 1;
  return Number.isInteger(count) ? (count >= 2 && count <= 4 ? 1 : 2) : 3;
}

/** @param {number} value @param {string} format `.2f`, `+.1f`, `.0%`, `.1e`, `,` or `g` */
function formatted(value, format) {
  const [, plus = "", comma = "", places, kind = ""] =
    /^(\+?)(,?)(?:\.(\d+))?([fe%g]?)$/.exec(format) ?? [];
  const digits = Number(places ?? 0);
  const text = kind === "f" ? value.toFixed(digits) : kind === "e" ? value.toExponential(digits)
    : kind === "%" ? `${(100 * value).toFixed(digits)}%`
      : kind === "g" ? String(Number(value.toPrecision(6))) : String(value);
  const parted = comma ? text.replace(/\B(?=(\d{3})+(?!\d))/g, "\u202f") : text;
  return plus && value >= 0 ? `+${parted}` : parted;
}

/** A time as the language writes it. @param {string} when */
export const moment = (when) => when.replace(MOMENT, (_, year, month, day, clock) =>
  (start.language === "cs" ? `${Number(day)}.\u00a0${Number(month)}.\u00a0${year}\u00a0${clock}`
    : `${year}-${month}-${day}\u00a0${clock}`));

/** A number as the language writes it. @param {string} text */
function signed(text) {
  const real = text.replace("-", "\u2212");
  return start.language === "cs" ? real.replace(".", ",") : real;
}

/** The longer text of a key; null where it has none. @param {string} key */
export const tip = (key) => start.words[`${key}.tip`] ?? null;

/** The texts of a page that are written in its HTML; and the switch to the other language. */
export function fillWords() {
  document.documentElement.lang = start.language;
  for (const place of all("[data-word]")) {
    const { icon, word: key } = place.dataset;
    place.replaceChildren(...(icon ? [glyph(icon, "currentColor", 15)] : []), word(key ?? ""));
  }
  for (const place of all("[data-label]")) {
    place.setAttribute("aria-label", word(place.dataset.label ?? ""));
  }
  const other = start.language === "cs" ? "en" : "cs";
  Object.assign(byId("language"), {
    textContent: other.toUpperCase(), title: word("language.other"), onclick: () => {
      // A year, for every page and port: `ui/web/front.py` reads it.
      document.cookie = `gruber-language=${other}; path=/; max-age=31536000; samesite=strict`;
      location.reload();
    },
  });
}

/**
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {Record<string, any>} attributes `on...` are listeners; true, and null or false for none
 * @param {(Node | string | null | undefined)[]} children
 * @returns {HTMLElementTagNameMap[T]}
 */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") made.className = value;
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null) made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

/** What a person wrote: three lines of it where it is long, and a button that shows all. */
export function clamped(/** @type {string} */ words) {
  if (words.length <= LONG) return words;
  const { whole } = state;
  const shown = element("span", {}, words);
  const more = element("button", { class: "small", "data-more": words.slice(0, LONG) });
  const show = () => {
    shown.className = whole.has(words) ? "" : "clamped";
    more.textContent = word(whole.has(words) ? "words.less" : "words.more");
  };
  more.addEventListener("click", () => {
    if (!whole.delete(words)) whole.add(words);
    show();
  });
  show();
  return element("span", {}, shown, " ", more);
}

/**
 * The head of a sheet, in sight however long it is: what it is, and how to leave it.
 * @param {HTMLDialogElement} sheet @param {string} title @param {Node[]} acts
 */
export const sheetHead = (sheet, title, ...acts) => element("header", { class: "sheet-head" },
  element("h2", {}, word(title)), element("span", { class: "stretch" }), ...acts,
  element("button", { id: `${sheet.id}-close`, autofocus: true, onclick: () => sheet.close() },
    word("act.close")));

/**
 * A part of a drawing: text only ever as text.
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 * @param {(Node | string)[]} children
 */
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, `${value}`);
  made.append(...children);
  return made;
}

/**
 * @template {string} N
 * @param {N} name
 * @returns {N extends keyof Ids ? Ids[N] : HTMLElement}
 */
export const byId = (name) => /** @type {any} */ (document.getElementById(name));

/**
 * The first element of a selector, where the page is known to have one.
 * @param {string} selector @param {ParentNode} within @returns {HTMLElement}
 */
export const first = (selector, within = document) =>
  /** @type {HTMLElement} */ (within.querySelector(selector));

/** @param {string} selector @param {ParentNode} within @returns {HTMLElement[]} */
export const all = (selector, within = document) => [...within.querySelectorAll(selector)]
  .map((found) => /** @type {HTMLElement} */ (found));

/** A toggle shows, and says, whether it is on. @param {HTMLElement} button @param {boolean} on */
export function turn(button, on) {
  button.classList.toggle("on", on);
  button.setAttribute("aria-pressed", `${on}`);
}

/**
 * Whether a part shows this already. Made anew between press and release, a button loses its click.
 * @param {HTMLElement} room @param {unknown} what
 */
export function shows(room, what) {
  const shape = JSON.stringify(what);
  const same = room.dataset.shape === shape;
  room.dataset.shape = shape;
  return same;
}

const STOPS = "button, input, select, textarea, summary, a[href], [tabindex='0']";

/**
 * Made anew, a part keeps the focus on the control that had it: the same one or, made again, the
 * one that says the same. Where that is gone nothing takes its place: who goes by keys must not
 * find another button under Enter. What was being written in a field stays. Parts that are used
 * again come from a function: taken out of the page before, they would have lost the focus.
 * @param {HTMLElement} room
 * @param {(Node | string)[] | [() => (Node | string)[]]} children
 */
export function renew(room, ...children) {
  const before = focused();
  const stops = () => all(STOPS, room);
  const had = stops();
  const held = before && had.includes(before) ? identity(before) : "";
  const alike = (/** @type {HTMLElement[]} */ of) => of.filter((stop) => identity(stop) === held);
  const twins = held ? alike(had) : [];
  const field = before && held ? keptField(before) : null;
  const [made] = children;
  const notices = room.querySelector(":scope > #notices");
  room.replaceChildren(...(typeof made === "function" ? made()
    : /** @type {(Node | string)[]} */ (children)), ...(notices ? [notices] : []));
  if (!before || !held) return;
  const now = alike(stops());
  const same = room.contains(before) ? before
    : now.length === twins.length ? now[twins.indexOf(before)] : null;
  same?.focus({ preventScroll: true });
  if (same && same !== before) field?.(/** @type {HTMLInputElement} */ (same));
}

/** What tells a control from its neighbours. @param {HTMLElement} stop */
const identity = ({ id, dataset, tagName, textContent }) =>
  `${tagName} ${id || Object.entries(dataset).flat().join(" ") || (textContent ?? "").trim()}`;

/**
 * What a field that is being written in hands on to the one in its place.
 * @param {HTMLElement} before
 */
function keptField(before) {
  const { tagName, type, value, defaultValue, selectionStart, selectionEnd } =
    /** @type {HTMLInputElement} */ (before);
  if (tagName !== "TEXTAREA" && (tagName !== "INPUT" || type !== "text")) return null;
  return (/** @type {HTMLInputElement} */ fresh) => {
    if (value !== defaultValue) fresh.value = value;
    fresh.setSelectionRange(selectionStart, selectionEnd);
  };
}

export const focused = () => /** @type {HTMLElement | null} */ (document.activeElement);

/** @param {string} shape @param {string} colour @returns {Node} */
export function glyph(shape, colour, size = 14) {
  const holder = document.createElement("template");
  const box = `width="${size}" height="${size}" viewBox="0 0 16 16"`;
  // eslint-disable-next-line no-restricted-properties -- of constants only
  holder.innerHTML = `<svg class="glyph" ${box}>${SHAPES[shape].replaceAll("C", colour)}</svg>`;
  return /** @type {Node} */ (holder.content.firstChild);
}

/** @param {State} name */
export function stateGlyph(name, size = 14) {
  const look = start.palette.states[name];
  return glyph(look.glyph, `var(--state-${name}, ${look.colour})`, size);
}

/** @param {string} role */
export const roleGlyph = (role, size = 13) =>
  glyph(role, role === "check" ? `var(--check, ${start.palette.check})` : "var(--muted)", size);

/**
 * Scan names share a long beginning, and some an end: both are left out in narrow places.
 * @param {string[]} names
 */
export function learnNames(names) {
  state.prefix = sharedStart(names);
  state.suffix = turned(sharedStart(names.map((name) => turned(name.slice(state.prefix.length)))));
}

/** What all begin with, up to a sign between words; nothing where that is hardly shorter.
 * @param {string[]} names */
function sharedStart(names) {
  if (names.length < 2) return "";
  let length = 0;
  while (names.every((name) => length < name.length && name[length] === names[0][length])) {
    length += 1;
  }
  while (length && /[0-9A-Za-z]/.test(names[0][length - 1])) length -= 1;
  return length > 2 ? names[0].slice(0, length) : "";
}

/** @param {string} text */
const turned = (text) => [...text].reverse().join("");

/** @param {string} name */
export function shortName(name) {
  const { prefix, suffix } = state;
  return name.startsWith(prefix) && name.endsWith(suffix)
    ? name.slice(prefix.length, name.length - suffix.length) : name;
}

/**
 * Names made of two long coordinates: what all have in common at the beginning is left out.
 * @param {string[]} names
 */
export function learnPoints(names) {
  const parts = names.map((name) => COORDINATES.exec(name)).filter((part) => part !== null);
  state.halves = null;
  if (parts.length < 2) return;
  state.halves = [2, 3].map((place) => {
    let length = 0;
    const texts = parts.map((part) => part[place]);
    const common = (/** @type {string} */ text) =>
      length < text.length - 3 && text[length] === texts[0][length];
    while (texts.every(common)) length += 1;
    return length;
  });
}

/** @param {string} name */
export function shortPoint(name) {
  if (name.startsWith("photo ")) return word("role.photo.one");
  const { halves } = state;
  const part = halves && COORDINATES.exec(name);
  return part ? `${part[1]} ${part[2].slice(halves[0])} ${part[3].slice(halves[1])}` : name;
}

/** @param {number | null | undefined} value @param {number} digits */
export function number(value, digits, unit = "") {
  if (value === null || value === undefined) return "\u2013";
  // What rounds to nought has no sign.
  const rounded = Number(value.toFixed(digits)) || 0;
  return signed(rounded.toFixed(digits)) + (unit ? `\u2009${unit}` : "");
}

/** An area, thousands apart. @param {number} value */
export const squareMetres = (value) => `${formatted(Math.round(value), ",")}\u2009m\u00b2`;

/** A number in a field, with all its digits. @param {number | string} value */
export const written = (value) =>
  (start.language === "cs" ? `${value}`.replace(".", ",") : `${value}`);

/** What a hand wrote, with a point or a comma; NaN where it is no number. @param {string} text */
export const numberOf = (text) => (text.trim()
  ? Number(text.trim().replace(",", ".").replace("\u2212", "-")) : NaN);

/** 1, 2 or 5 of some power of ten, with the digits it has. @param {number} value */
export const roundNumber = (value, unit = "") =>
  number(value, Math.max(0, Math.ceil(-Math.log10(value))), unit);

/** A misfit beyond so many sigmas is marked, as the desk asks about a draft. */
export const MARKED_SIGMA = 3;

/** How large a file is. @param {number} bytes */
export const fileSize = (bytes) => (bytes >= 1e6 ? number(bytes / 1e6, bytes < 1e7 ? 1 : 0, "MB")
  : number(Math.ceil(bytes / 1e3), 0, "kB"));

/** Several numbers in a row. @param {(number | null)[]} values @param {number} digits */
export const numbers = (values, digits) => values.map((value) => number(value, digits))
  .join(between());

/** What parts numbers, where the comma may be in them. */
export const between = () => (start.language === "cs" ? "; " : ", ");
