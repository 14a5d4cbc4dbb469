// Numbers and formulas of a lesson, as its language writes them.
import { element, number } from "./words.js";

const MATH = "http://www.w3.org/1998/Math/MathML";
const GROUPED = 10_000; // design: shorter numbers are read without a gap
const SIGNS = new Set([",", "+", "\u2212", "=", "(", ")", "\u00b1", "\u2248"]);
const FUNCTIONS = new Set(["sin", "cos", "tan"]);

/** A number with its unit. @param {LessonNumber} shown */
export function told({ value, digits, unit }) {
  const text = number(value, digits);
  const whole = Math.abs(value ?? 0) >= GROUPED
    ? text.replace(/\d+/, (run) => run.replace(/\B(?=(\d{3})+$)/g, "\u202f")) : text;
  return unit && value !== null ? `${whole}\u2009${unit}` : whole;
}

/**
 * A formula with symbols, and again with the present numbers.
 * @param {Equation} equation
 * @param {Record<string, LessonValue>} symbols numbers of all symbols
 */
export function equationShown({ left, right }, symbols) {
  const bare = { plain: true, symbols };
  const numbers = { plain: false, symbols };
  const parts = [[term(left, bare), sign("="), term(right, bare)]];
  // Numbers and result go to rows of their own where one row is too short.
  if (hasNumbers([left, right], symbols)) parts.push([sign("="), term(right, numbers)]);
  if (symbols[left]) parts.push([sign("="), space(), term(left, numbers)]);
  const lines = parts.map((line) => math("math", math("mrow", ...line)));
  for (const line of lines) line.setAttribute("displaystyle", "true");
  return element("div", { class: "equation" }, ...lines);
}

/**
 * Formulas of matrices have no numbers to be shown.
 * @param {LessonMath} part @param {Record<string, unknown>} symbols @returns {boolean}
 */
const hasNumbers = (part, symbols) => (typeof part === "string" ? part in symbols
  : part.some((inside) => hasNumbers(inside, symbols)));

/** @param {string} tag @param {(Node | string)[]} children */
function math(tag, ...children) {
  const made = document.createElementNS(MATH, tag);
  made.append(...children);
  return made;
}

function space() {
  const made = math("mspace");
  made.setAttribute("width", "0.16em");
  return made;
}

/** @param {string} text */
const sign = (text) => math("mo", text);

/** A parenthesis as high as a number. @param {string} text */
function low(text) {
  const made = sign(text);
  made.setAttribute("stretchy", "false");
  return made;
}

/**
 * @param {LessonMath} part
 * @param {{ plain: boolean, symbols: Record<string, LessonValue> }} how
 * @returns {Element}
 */
function term(part, how) {
  if (typeof part === "string") return leaf(part, how);
  const [act, ...inside] = part;
  if (act === "named") {
    const [one, parts] = /** @type {[string, LessonMath]} */ (inside);
    return how.plain || !(one in how.symbols) ? term(parts, how) : leaf(one, how);
  }
  const made = inside.map((one, at) => {
    const shown = term(one, how);
    const isInside = act === "row" && at > 0 && isNegative(one, how);
    return isInside ? math("mrow", low("("), shown, low(")")) : shown;
  });
  if (act === "over") return math("mfrac", ...made);
  if (act === "root") return math("msqrt", ...made);
  if (act === "power") {
    const isNumber = !how.plain && typeof inside[0] === "string" && inside[0] in how.symbols;
    const base = isNumber ? math("mrow", low("("), made[0], low(")")) : made[0];
    return math("msup", base, made[1]);
  }
  if (act === "fence") return math("mrow", sign("("), ...made, sign(")"));
  return math("mrow", ...made);
}

/**
 * Whether a part is one number that begins with a minus.
 * @param {LessonMath} part @param {Parameters<typeof term>[1]} how
 */
function isNegative(part, { plain, symbols }) {
  const known = plain || typeof part !== "string" ? null : symbols[part];
  return known && !Array.isArray(known) ? told(known).startsWith("\u2212") : false;
}

/** @param {string} text @param {Parameters<typeof term>[1]} how */
function leaf(text, { plain, symbols }) {
  if (text === "*") return plain ? space() : sign("\u00b7");
  if (SIGNS.has(text)) return sign(text);
  if (FUNCTIONS.has(text)) return math("mrow", math("mi", text), space());
  if (/^[\d.]+$/.test(text)) {
    return math("mn", number(Number(text), text.split(".")[1]?.length ?? 0));
  }
  const known = symbols[text];
  if (Array.isArray(known)) return plain ? symbol(text) : matrix(known);
  // As `mtext` it would be space, and a sign between two of them lose its room.
  const made = plain || !known ? symbol(text) : math("mn", told(known));
  if (known?.hue !== undefined) made.setAttribute("class", `hue-${known.hue}`);
  return made;
}

/** @param {LessonNumber[][]} rows */
const matrix = (rows) => math("mrow", sign("["), math("mtable", ...rows.map((row) =>
  math("mtr", ...row.map((one) => math("mtd", math("mtext", told(one))))))), sign("]"));

/** A symbol, its index set lower. @param {string} text */
export function symbol(text) {
  const [base, index] = text.split("_");
  return index ? math("msub", math("mi", base), math("mi", index)) : math("mi", base);
}

/** A symbol by itself, as it stands beside a slider. @param {string} text */
export const symbolShown = (text) => math("math", symbol(text));
