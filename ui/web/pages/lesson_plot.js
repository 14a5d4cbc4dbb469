// The plot of a lesson: curves over one quantity, with the present value marked.
import { svg } from "./words.js";
import { told } from "./lesson_numbers.js";

const MARGIN = { left: 58, right: 16, bottom: 36 };
const ROW = 17; // of the names above the curves
const TICKS = 5;

/**
 * @param {HTMLElement} room @param {LessonPlot | null} plot @param {(key: string) => string} text
 */
export function drawPlot(room, plot, text) {
  room.hidden = !plot;
  if (!plot) return room.replaceChildren();
  const { width, height } = room.getBoundingClientRect();
  const all = plot.curves.flatMap(({ points }) => points).concat(plot.at ? [plot.at] : []);
  if (width < 120 || height < 90 || !all.length) return undefined;
  const across = rangeOf(all.map(([x]) => x), false);
  const up = rangeOf(all.map(([, y]) => y), true);
  const top = ROW + 9 + (plot.curves.length > 1 ? ROW : 0);
  const x = (/** @type {number} */ value) => MARGIN.left
    + ((value - across.low) / across.size) * (width - MARGIN.left - MARGIN.right);
  const y = (/** @type {number} */ value) => height - MARGIN.bottom
    - ((value - up.low) / up.size) * (height - top - MARGIN.bottom);
  const sheet = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img",
    "aria-label": `${text(`axis.${plot.y}`)} / ${text(`axis.${plot.x}`)}` });
  for (const value of ticks(across)) {
    sheet.append(svg("path", { class: "grid", d: `M${x(value)} ${y(up.low)}V${y(up.high)}` }),
      svg("text", { class: "tick", x: x(value), y: height - MARGIN.bottom + 15,
        "text-anchor": "middle" }, plain(value, across)));
  }
  for (const value of ticks(up)) {
    sheet.append(svg("path", { class: value === 0 ? "nought" : "grid",
      d: `M${x(across.low)} ${y(value)}H${x(across.high)}` }),
    svg("text", { class: "tick", x: MARGIN.left - 7, y: y(value) + 4, "text-anchor": "end" },
      plain(value, up)));
  }
  plot.curves.forEach(({ points, look }) => sheet.append(svg("polyline", {
    class: `look-${look}`,
    points: points.map(([a, b]) => `${x(a).toFixed(1)},${y(b).toFixed(1)}`).join(" "),
  })));
  sheet.append(...legend(plot, text),
    svg("text", { class: "axis-name", x: MARGIN.left - 50, y: 15 }, text(`axis.${plot.y}`)),
    svg("text", { class: "axis-name", x: width - MARGIN.right, y: height - 4,
      "text-anchor": "end" }, text(`axis.${plot.x}`)));
  if (plot.at) {
    const [left, down] = [x(plot.at[0]), y(plot.at[1])];
    sheet.append(svg("path", { class: "at", d: `M${left} ${y(up.low)}V${down}` }),
      svg("circle", { class: "at-dot", cx: left, cy: down, r: 5 }));
  }
  return room.replaceChildren(sheet);
}

/** Names of curves in a row above them. @param {LessonPlot} plot */
function legend({ curves }, /** @type {(key: string) => string} */ text) {
  if (curves.length < 2) return [];
  const names = svg("text", { class: "legend", x: MARGIN.left - 50, y: 15 + ROW });
  curves.forEach(({ name, look }, place) => names.append(svg("tspan",
    { class: `swatch look-${look}`, dx: place ? 14 : 0 }, "\u25ac"),
  svg("tspan", { dx: 4 }, text(`curve.${name}`))));
  return [names];
}

/** @param {number[]} values @param {boolean} nought whether nought is shown with them */
function rangeOf(values, nought) {
  const low = Math.min(...values, ...(nought ? [0] : []));
  const high = Math.max(...values, ...(nought ? [0] : []));
  const room = nought ? 0.06 * (high - low) : 0;
  const least = low < 0 ? low - room : low;
  const most = high > 0 ? high + room : high;
  return { low: least, high: most, size: Math.max(most - least, 1e-12) };
}

/** Round values within a range. @param {{ low: number, high: number, size: number }} range */
function ticks({ low, high, size }) {
  const power = 10 ** Math.floor(Math.log10(size / TICKS));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => size / one <= TICKS + 1)
    ?? 10 * power;
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor((high + 1e-9 * size) / step) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, place) => (first + place) * step);
}

/** @param {number} value @param {{ size: number }} range */
function plain(value, { size }) {
  const digits = Math.max(0, Math.min(6, Math.ceil(-Math.log10(size / TICKS / 1.0001))));
  return told({ value, digits, unit: "", truth: null });
}
