// Where a point lies in all likelihood, and what was compared there: laid over scan and ortho.
import { notice } from "./asked.js";
import { halo, text } from "./overlay.js";
import { inverse, mapped, scaleOf } from "./view.js";
import { start } from "./words.js";

/** @typedef {(ground: Pair, raw: Pair | null) => Pair} OnScreen */
/** @typedef {{ ground: Pair, raw: Pair | null }} Place raw: pixels, where the raw scan is shown */
/** @typedef {{ at: Pair, frame: "scan" | "ground" }} Nudged a place in the frame it was put in */

const CORNERS = 64; // design: an ellipse of a whole window looks round

/** The ground about the point into the raw scan. @param {Point} point @returns {Affine} */
export function rawFromGround({ raw, marks: { predicted: [east, north] } }) {
  return raw.matrix.map(([a, b], i) => [a, b, raw.predicted[i] - a * east - b * north]);
}

/** False where only yes or no applies, which is said. @param {Point} point */
export function isPlaceable({ fixed }) {
  if (fixed) notice("notice.yes-or-no");
  return !fixed;
}

/** @param {Place} place @returns {Nudged} */
export const framed = ({ ground, raw }) => (raw ? { at: raw, frame: "scan" }
  : { at: ground, frame: "ground" });

/** What a hand put in one frame, in both. @param {Nudged | null} nudged @param {Point} point */
export function inBoth(nudged, point) {
  if (!nudged) return null;
  const [{ at, frame }, matrix] = [nudged, rawFromGround(point)];
  return frame === "scan" ? { ground: mapped(inverse(matrix), at), raw: at }
    : { ground: at, raw: mapped(matrix, at) };
}

/** The longer half axis of an ellipse, pixels of the scan. @param {number[][]} root */
export function ellipseRadius([[a, b], [c, d]]) {
  const [sum, det] = [a * a + b * b + c * c + d * d, a * d - b * c];
  return Math.sqrt((sum + Math.sqrt(Math.max(sum * sum - 4 * det * det, 0))) / 2);
}

/**
 * The error ellipse of a predicted place.
 * @param {Context} context @param {Point} point @param {OnScreen} onScreen
 */
export function drawEllipse(context, point, onScreen) {
  const { ellipse, raw } = point;
  if (!ellipse) return;
  const back = inverse(rawFromGround(point));
  context.setLineDash([7, 4]);
  halo(context, start.palette.predicted, 1.5, () => {
    for (let corner = 0; corner <= CORNERS; corner += 1) {
      const turn = (2 * Math.PI * corner) / CORNERS;
      const place = raw.predicted.map((middle, i) =>
        middle + ellipse[i][0] * Math.cos(turn) + ellipse[i][1] * Math.sin(turn));
      const [x, y] = onScreen(mapped(back, place), place);
      context.lineTo(x, y);
    }
  });
  context.setLineDash([]);
}

/**
 * Where each of several operators placed the point.
 * @param {Context} context @param {Point} point @param {OnScreen} onScreen
 */
export function drawReadings(context, point, onScreen) {
  const back = inverse(rawFromGround(point));
  const { states } = start.palette;
  point.readings.forEach(({ who, raw }, index) => {
    const [x, y] = onScreen(mapped(back, raw), raw);
    halo(context, states.accepted.colour, 1.2, () => context.arc(x, y, 3.5, 0, 7));
    // Names stand one below the other: readings are near each other.
    text(context, who, [x + 22, y - 8 + 22 * index], states.accepted.colour);
  });
}

/**
 * Outline of the patch the engine compared: along the scan's axes, about the point.
 * @param {Context} context @param {Point} point @param {boolean} onScan @param {OnScreen} onScreen
 */
export function drawPatch(context, point, onScan, onScreen) {
  if (!start.template) return;
  const { marks, raw } = point;
  const matrix = rawFromGround(point);
  const half = start.template * scaleOf(matrix);
  const middle = onScan ? point.draft?.raw ?? raw.measured : raw.predicted;
  const shift = [0, 1].map((i) => (onScan ? 0 : marks.surveyed[i] - marks.predicted[i]));
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => {
    const place = [middle[0] + x * half, middle[1] + y * half];
    const ground = mapped(inverse(matrix), place).map((value, i) => value + shift[i]);
    return onScreen(ground, place);
  });
  context.globalAlpha = 0.75;
  halo(context, "#ffffff", 1, () => {
    corners.forEach(([x, y]) => context.lineTo(x, y));
    context.closePath();
  });
  context.globalAlpha = 1;
}
