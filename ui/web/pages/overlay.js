// What is drawn over pictures: lines with a dark rim, crosses, words; all in css pixels.
import { roundLength } from "./view.js";
import { number, roundNumber, start } from "./words.js";

export const FONT = "12px Inter, sans-serif";

/**
 * An empty canvas as sharp as the screen, with its size in css pixels.
 * @param {HTMLCanvasElement} canvas @returns {[Context, number, number]}
 */
export function cleared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== across || canvas.height !== down) {
    Object.assign(canvas, { width: across, height: down });
  }
  const context = /** @type {Context} */ (canvas.getContext("2d"));
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

/**
 * A line with a dark rim.
 * @param {Context} context @param {string} colour @param {number} width @param {() => void} path
 */
export function halo(context, colour, width, path) {
  for (const [ink, wide] of /** @type {const} */ ([["#000000b0", width + 2], [colour, width]])) {
    context.beginPath();
    path();
    context.strokeStyle = ink;
    context.lineWidth = wide;
    context.stroke();
  }
}

/** @param {Context} context @param {Pair} place @param {string} colour */
export function measuredMark(context, [x, y], colour) {
  halo(context, colour, 1.8, () => {
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + dx * 4, y + dy * 4);
      context.lineTo(x + dx * 15, y + dy * 15);
    }
  });
  context.fillStyle = colour;
  context.fillRect(x - 0.75, y - 0.75, 1.5, 1.5);
}

/** What nobody has decided yet. @param {Context} context @param {Pair} place */
export function draftedMark(context, place) {
  context.setLineDash([3, 3]);
  measuredMark(context, place, start.palette.current);
  context.setLineDash([]);
}

/**
 * Where a point is expected.
 * @param {Context} context @param {Pair} place @param {string} colour @param {number} radius
 */
export function expectedMark(context, [x, y], colour, radius) {
  context.setLineDash([4, 3]);
  halo(context, colour, 1.6, () => context.arc(x, y, radius, 0, 7));
  context.setLineDash([]);
}

/** @param {Context} context @param {Pair} place @param {number} width @param {number} height */
export function crosshair(context, [x, y], width, height) {
  const [cx, cy] = [Math.round(x) + 0.5, Math.round(y) + 0.5];
  const gap = 7;
  for (const [ink, wide] of /** @type {const} */ ([["#00000060", 3], ["#ffffffb8", 1]])) {
    line(context, [0, cy], [cx - gap, cy], ink, wide);
    line(context, [cx + gap, cy], [width, cy], ink, wide);
    line(context, [cx, 0], [cx, cy - gap], ink, wide);
    line(context, [cx, cy + gap], [cx, height], ink, wide);
  }
}

/**
 * @param {Context} context @param {Pair} from @param {Pair} to
 * @param {string} colour @param {number} width
 */
export function line(context, from, to, colour, width) {
  context.beginPath();
  context.moveTo(from[0], from[1]);
  context.lineTo(to[0], to[1]);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

/** @param {Context} context @param {string} words @param {Pair} place @param {string} colour */
export function text(context, words, [x, y], colour) {
  context.font = FONT;
  context.lineWidth = 3;
  context.strokeStyle = "#000000c0";
  context.strokeText(words, x, y);
  context.fillStyle = colour;
  context.fillText(words, x, y);
}

/** @param {Context} context @param {Pair} place @param {Point} point */
export function surveyedMark(context, [x, y], { role }) {
  const colour = role === "check" ? start.palette.check : start.palette.current;
  halo(context, colour, 1.6, () => {
    if (role === "check") return context.rect(x - 8, y - 8, 16, 16);
    if (role === "new") return context.arc(x, y, 8, 0, 7);
    context.moveTo(x, y - 10);
    context.lineTo(x + 9, y + 6);
    context.lineTo(x - 9, y + 6);
    context.closePath();
  });
  context.fillStyle = colour;
  context.fillRect(x - 1, y - 1, 2, 2);
}

/**
 * @param {Context} context @param {Pair} size @param {number} scale css pixels a metre
 * @param {number} pixel of the picture, metres
 */
export function scaleBar(context, [width, height], scale, pixel) {
  const metres = roundLength(80 / scale); // design: beside the mark, not over it
  const [right, bottom] = [width - 10.5, height - 10.5];
  const left = right - metres * scale;
  halo(context, "#ffffff", 1.2, () => {
    context.moveTo(left, bottom - 4);
    context.lineTo(left, bottom);
    context.lineTo(right, bottom);
    context.lineTo(right, bottom - 4);
  });
  const times = scale * pixel;
  // However far it is zoomed out, one figure tells how far.
  const digits = Math.max(1, Math.ceil(-Math.log10(times)));
  context.font = FONT;
  const wide = (/** @type {string} */ words) => context.measureText(words).width;
  const [length, zoom] = [roundNumber(metres, "m"), `${number(times, digits)}\u00d7`];
  // The length over the middle of its bar, and how far it is zoomed in beside it.
  const from = Math.min((left + right - wide(length)) / 2, right - wide(length));
  text(context, length, [from, bottom - 8], "#ffffff");
  text(context, zoom, [Math.min(left, from) - 12 - wide(zoom), bottom - 8], "#ffffff");
}
