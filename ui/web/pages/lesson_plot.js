// The plot of a lesson: curves over one quantity, with the present value marked.
import { svg } from "./words.js";
import { told } from "./lesson_numbers.js";

const MARGIN = { left: 58, right: 16, bottom: 38 };
const EDGE = 8;
const ROW = 17; // of the names above the curves
const GAP = 14; // between them
const TICKS = 5;
const DIGITS = 6; // most decimal places of a tick

/**
 * @param {HTMLElement} room @param {LessonPlot | null} plot @param {(key: string) => string} text
 */
export function drawPlot(room, plot, text) {
  room.hidden = !plot;
  if (!plot) return room.replaceChildren();
  const { width, height } = room.getBoundingClientRect();
  const all = plot.curves.flatMap(({ points }) => points).concat(plot.at ? [plot.at] : []);
  room.replaceChildren();
  if (width < 120 || height < 90 || !all.length) return undefined;
  const across = plot.kinds ? rangeOfKinds(all) : rangeOf(all.map(([x]) => x), false);
  const up = rangeOf(all.map(([, y]) => y), true);
  const sheet = /** @type {SVGSVGElement} */ (svg("svg", { viewBox: `0 0 ${width} ${height}`,
    role: "img", "aria-label": `${text(`axis.${plot.y}`)} / ${text(`axis.${plot.x}`)}` }));
  room.replaceChildren(sheet);
  const top = ROW + 9 + ROW * writeLegend(sheet, plot, text, width);
  const x = (/** @type {number} */ value) => MARGIN.left
    + ((value - across.low) / across.size) * (width - MARGIN.left - MARGIN.right);
  const y = (/** @type {number} */ value) => height - MARGIN.bottom
    - ((value - up.low) / up.size) * (height - top - MARGIN.bottom);
  const places = plot.kinds ? [...new Set(all.map(([place]) => place))] : ticks(across);
  for (const value of places) {
    sheet.append(svg("path", { class: "grid", d: `M${x(value)} ${y(up.low)}V${y(up.high)}` }),
      svg("text", { class: "tick", x: x(value), y: height - MARGIN.bottom + 18,
        "text-anchor": "middle" },
      plot.kinds ? text(`choice.${plot.kinds}.${value}`) : plain(value, across)));
  }
  for (const value of ticks(up)) {
    sheet.append(svg("path", { class: value === 0 ? "nought" : "grid",
      d: `M${x(across.low)} ${y(value)}H${x(across.high)}` }),
    svg("text", { class: "tick", x: MARGIN.left - 7, y: y(value) + 4, "text-anchor": "end" },
      plain(value, up)));
  }
  plot.curves.forEach(({ points, look }) => sheet.append(...(plot.kinds
    ? points.map(([a, b]) => svg("path", { class: `pillar look-${look}`,
      d: `M${x(a)} ${y(0)}V${y(b)}` }))
    : [svg("polyline", { class: `look-${look}`,
      points: points.map(([a, b]) => `${x(a).toFixed(1)},${y(b).toFixed(1)}`).join(" ") })])));
  const names = [
    svg("text", { class: "axis-name", x: EDGE, y: 15 }, text(`axis.${plot.y}`)),
    svg("text", { class: "axis-name", x: width - MARGIN.right, y: height - 4,
      "text-anchor": "end" }, text(`axis.${plot.x}`))];
  sheet.append(...names);
  names.forEach((name) => narrow(name, width - EDGE - MARGIN.right));
  if (plot.at) {
    const [left, down] = [x(plot.at[0]), y(plot.at[1])];
    sheet.append(svg("path", { class: "at", d: `M${left} ${y(up.low)}V${down}` }),
      svg("circle", { class: "at-dot", cx: left, cy: down, r: 5 }));
  }
  return undefined;
}

/**
 * Sets a name in smaller letters if it is too long.
 * @param {SVGElement} name @param {number} most
 */
function narrow(name, most) {
  const long = /** @type {SVGTextElement} */ (name).getComputedTextLength();
  if (long > most) name.style.fontSize = `${(12 * most) / long}px`;
}

/**
 * Names of curves in rows above them. @returns {number} how many rows
 * @param {Element} sheet @param {LessonPlot} plot @param {(key: string) => string} text
 * @param {number} width
 */
function writeLegend(sheet, { curves }, text, width) {
  if (curves.length < 2) return 0;
  let [left, rows] = [EDGE, 1];
  for (const { name, look } of curves) {
    const entry = /** @type {SVGTextElement} */ (svg("text", { class: "legend" },
      svg("tspan", { class: `swatch look-${look}` }, "\u25ac"),
      svg("tspan", { dx: 4 }, text(`curve.${name}`))));
    sheet.append(entry);
    const wide = entry.getComputedTextLength() + 4;
    if (left > EDGE && left + wide > width - EDGE) [left, rows] = [EDGE, rows + 1];
    entry.setAttribute("x", `${left}`);
    entry.setAttribute("y", `${15 + ROW * rows}`);
    left += wide + GAP;
  }
  return rows;
}

/** @param {number[]} values @param {boolean} nought whether nought is shown with them */
function rangeOf(values, nought) {
  const low = Math.min(...values, ...(nought ? [0] : []));
  const high = Math.max(...values, ...(nought ? [0] : []));
  const room = nought ? 0.06 * (high - low) : 0;
  const least = low < 0 ? low - room : low;
  const most = high > 0 ? high + room : high;
  // What is nought everywhere, but for rounding, has an axis all the same.
  return most - least > TICKS * 10 ** -DIGITS ? { low: least, high: most, size: most - least }
    : { low: least, high: least + 1, size: 1 };
}

/** Room to both sides of places that have names. @param {Pair[]} points */
function rangeOfKinds(points) {
  const { low, high } = rangeOf(points.map(([x]) => x), false);
  return { low: low - 0.5, high: high + 0.5, size: high - low + 1 };
}

/** From one round value to the next. @param {number} size */
function stepOf(size) {
  const power = 10 ** Math.floor(Math.log10(size / TICKS));
  return [1, 2, 5, 10].map((one) => one * power).find((one) => size / one <= TICKS + 1)
    ?? 10 * power;
}

/** Round values within a range. @param {{ low: number, high: number, size: number }} range */
function ticks({ low, high, size }) {
  const step = stepOf(size);
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor((high + 1e-9 * size) / step) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, place) => (first + place) * step);
}

/** @param {number} value @param {{ size: number }} range */
function plain(value, { size }) {
  const digits = Math.max(0, Math.min(DIGITS, -Math.floor(Math.log10(stepOf(size)) + 1e-9)));
  return told({ value, digits, unit: "", truth: null });
}
