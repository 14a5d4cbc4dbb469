// Labels of a lesson's drawing: each beside its place, none over another.
import { svg } from "./words.js";
import { told } from "./lesson_numbers.js";

const LINE = { above: 12, below: 4 }; // of the base of the letters, css pixels
const FAR = [1, 1.8, 2.8]; // times the usual distance from the place
const KNOB = 9;
const DOT = 4;

/**
 * @typedef {[left: number, upper: number, right: number, lower: number]} Box css pixels
 * @typedef {"right" | "left" | "over" | "under" | "right-under" | "left-under"} Side
 * @typedef {{ at: Pair, width: number, sides: Side[] }} Placed a label's place, and where it
 *   would stand, the best side first
 */

/** @type {Side[]} */
const BESIDE = ["right", "left", "right-under", "left-under", "over", "under"];
/** @type {Side[]} */
const MIDDLE = ["over", "under", "right", "left", "right-under", "left-under"];

/** Where the letters of a label begin, from its place. @param {Side} side @param {number} width */
function offset(side, width, far = 1) {
  const x = side.startsWith("right") ? 9 * far : side.startsWith("left") ? -9 * far - width
    : -width / 2;
  const up = side === "over" ? -10 : -6;
  return [x, side.endsWith("under") ? 19 * far : up * far];
}

/**
 * Where each label begins: on the first side that is free and within the drawing, or else
 * where least is covered.
 * @param {Placed[]} labels @param {Box[]} taken @param {Pair} size @returns {Pair[]}
 */
export function placesOf(labels, taken, [width, height]) {
  const boxes = [...taken];
  return labels.map(({ at, width: own, sides }) => {
    const found = FAR.flatMap((far) => sides.map((side) => {
      const [x, y] = offset(side, own, far);
      const box = /** @type {Box} */ ([at[0] + x, at[1] + y - LINE.above, at[0] + x + own,
        at[1] + y + LINE.below]);
      const room = (box[2] - box[0]) * (box[3] - box[1]) - covered(box, [0, 0, width, height]);
      return { box, bad: boxes.reduce((sum, other) => sum + covered(box, other), room) };
    }));
    const best = found.find(({ bad }) => bad < 1)
      ?? found.reduce((least, one) => (one.bad < least.bad ? one : least));
    boxes.push(best.box);
    return [best.box[0], best.box[3] - LINE.below];
  });
}

/** The area that two boxes share. @param {Box} one @param {Box} other */
const covered = (one, other) => Math.max(0, Math.min(one[2], other[2]) - Math.max(one[0], other[0]))
  * Math.max(0, Math.min(one[3], other[3]) - Math.max(one[1], other[1]));

/**
 * Writes the labels of shapes into a drawing.
 * @param {SVGSVGElement} sheet @param {LessonShape[]} shapes
 * @param {import("./lesson_drawing.js").Scale} scale
 * @param {(key: string) => string} text @param {Box[]} taken
 */
export function writeLabels(sheet, shapes, scale, text, taken) {
  const { width, height } = sheet.getBoundingClientRect();
  const size = /** @type {Pair} */ ([width, height]);
  const marks = shapes.filter(({ points, kind, handle }) => points.length === 1
    && (handle || kind === "dots")).map(({ points: [[x, y]], handle }) => {
    const [left, down, half] = [scale.x(x), scale.y(y), handle ? KNOB : DOT];
    return /** @type {Box} */ ([left - half, down - half, left + half, down + half]);
  });
  const labels = shapes.flatMap((shape) => labelOf(shape, scale, text, size));
  sheet.append(...labels.map(({ node }) => node));
  const places = placesOf(labels.map(({ node, at, sides }) => (
    { at, sides, width: node.getComputedTextLength() })), [...taken, ...marks], size);
  labels.forEach(({ node }, number) => {
    node.setAttribute("x", `${places[number][0]}`);
    node.setAttribute("y", `${places[number][1]}`);
  });
}

/**
 * A shape's label without a place; none of what lies outside of the drawing.
 * @param {LessonShape} shape @param {import("./lesson_drawing.js").Scale} scale
 * @param {(key: string) => string} text @param {Pair} size
 */
function labelOf({ kind, points, look, label: key, number: shown, below }, { x, y }, text, size) {
  if ((!key && !shown) || !points.length) return [];
  const named = key ? text(`label.${key}`) : "";
  const whole = shown ? [named, told(shown)].filter(Boolean).join(" ") : named;
  const within = kind === "line" || kind === "arrow" || kind === "area";
  const place = within ? mean(points.length > 2 && kind === "line"
    ? [points[points.length >> 3]] : points) : points[0];
  const at = /** @type {Pair} */ ([x(place[0]), y(place[1])]);
  if (at.some((value, axis) => value < 0 || value > size[axis])) return [];
  const upright = (kind === "line" || kind === "arrow") && points.length === 2
    && Math.abs(x(points[1][0]) - x(points[0][0])) < Math.abs(y(points[1][1]) - y(points[0][1]));
  const sides = within && !upright ? MIDDLE : BESIDE;
  const lower = [...sides].sort((one, other) => Number(other.endsWith("under"))
    - Number(one.endsWith("under")));
  const node = /** @type {SVGTextElement} */ (svg("text", { class: `label look-${look}` }, whole));
  return [{ node, at, sides: below ? lower : sides }];
}

/** @param {Pair[]} points @returns {Pair} */
const mean = (points) => [0, 1].map((axis) =>
  points.reduce((sum, point) => sum + point[axis], 0) / points.length);
