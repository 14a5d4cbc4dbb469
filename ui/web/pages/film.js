// The deformation of the films: vectors of the marks of one photo, and the mean over the roll.
import { element, number, numbers, roundNumber, shortName, svg, tip, word } from "./words.js";
import { roundLength } from "./view.js";

const COLUMNS = [
  "photo", "scale_x", "scale_y", "shear", "rms", "plain.rms", "redundancy", "chance",
];
const state = {
  current: "",
  /** `left` after the interior orientation, or `plain` after a similarity alone. */
  kind: "left",
};

/** @param {FilmMark} mark micrometres */
const vectorOf = (mark) => (state.kind === "left" ? mark.slice(3, 5) : mark.slice(5, 7))
  .map(Number);

/** @param {Films} found @param {() => void} again shows it anew */
export function filmPart({ films, rolls, frames }, again) {
  if (!films.length) return element("p", { class: "muted" }, word("film.none"));
  const one = films.find((film) => film.photo === state.current) ?? films[0];
  state.current = one.photo;
  const roll = rolls[one.camera];
  const kinds = ["left", "plain"].map((name) => element("button", {
    class: state.kind === name ? "on" : "", "aria-pressed": `${state.kind === name}`,
    "data-kind": name, title: word(`film.${name}.tip`),
    onclick: () => {
      state.kind = name;
      again();
    },
  }, word(`film.${name}`)));
  // One scale for both, so that they can be compared.
  const lengths = [...one.marks, ...(roll?.marks ?? [])].map((m) => Math.hypot(...vectorOf(m)));
  const longest = Math.max(...lengths, 0.5);
  const drawn = (/** @type {FilmMark[]} */ marks) => drawing(marks, frames[one.camera], longest);
  const whole = roll
    ? figure("film.roll", { count: roll.count, camera: one.camera }, drawn(roll.marks))
    : element("p", { class: "muted" }, word("film.single"));
  return element("div", { class: "films" },
    element("p", {}, element("span", { class: "segments" }, ...kinds),
      element("span", { class: "muted" }, ` ${word(`film.${state.kind}.tip`)}`)),
    element("div", { class: "film-figures" },
      figure("film.one", { photo: shortName(one.photo) }, drawn(one.marks)), whole),
    table(films, rolls, one, again), element("p", { class: "muted" }, word("film.long")));
}

/** @param {string} name @param {Record<string, unknown>} values @param {Element} drawn */
const figure = (name, values, drawn) => element("figure", {},
  element("figcaption", {}, element("b", {}, word(name, values))), drawn);

/**
 * Film upright, x right and y up; arrows so long that the longest fills an eighth of the frame.
 * @param {FilmMark[]} marks @param {Pair} frame mm @param {number} longest micrometres
 */
function drawing(marks, [width, height], longest) {
  const side = Math.max(width, height);
  const longer = (0.125 * side) / longest; // millimetres on the drawing for a micrometre
  const [margin, unit] = [0.16 * side, side / 100];
  const outline = { x: -width / 2, y: -height / 2, width, height, class: "outline" };
  const step = Math.min(roundLength(longest * 1.05), 100);
  const [left, low] = [-width / 2, height / 2 + 0.55 * margin];
  const scale = { x1: left, y1: low, x2: left + step * longer, y2: low, class: "vector check" };
  const legend = {
    x: left + step * longer + 2 * unit, y: low + 1.2 * unit,
    "font-size": 4.4 * unit, class: "legend",
  };
  const box = [-width / 2 - margin, -height / 2 - margin, width + 2 * margin, height + 2 * margin];
  return svg("svg", { viewBox: box.join(" "), class: "map film" },
    svg("rect", { ...outline, "stroke-width": 0.25 * unit }),
    ...marks.map((mark) => vector(mark, longer, unit)),
    svg("line", { ...scale, "stroke-width": 0.7 * unit }),
    svg("text", legend, roundNumber(step, "\u00b5m")));
}

/** @param {FilmMark} mark @param {number} longer @param {number} unit */
function vector(mark, longer, unit) {
  const [name, x, y] = [mark[0], mark[1], -mark[2]];
  const [dx, dy] = vectorOf(mark).map((value) => value * longer);
  const [ex, ey] = [x + dx, y - dy];
  const length = Math.hypot(dx, dy);
  const ink = { class: "vector control", "stroke-width": 0.55 * unit };
  const parts = [svg("circle", { cx: x, cy: y, r: 0.9 * unit, class: "control" }),
    svg("line", { x1: x, y1: y, x2: ex, y2: ey, ...ink })];
  if (length > 2 * unit) {
    const [ux, uy] = [dx / length, -dy / length];
    const barb = 1.9 * unit;
    const one = `${ex - barb * (ux + 0.5 * uy)} ${ey - barb * (uy - 0.5 * ux)}`;
    const other = `${ex - barb * (ux - 0.5 * uy)} ${ey - barb * (uy + 0.5 * ux)}`;
    const head = { ...ink, class: "vector control tip" };
    parts.push(svg("path", { d: `M${one}L${ex} ${ey}L${other}`, ...head }));
  }
  const words = numbers(vectorOf(mark), 1);
  // Inside the frame, where no line runs; beside the frame's sides, where no arrow goes.
  const above = Math.abs(x) > 1.2 * Math.abs(y) ? ey > y : y > 0;
  const inward = (ex - x) * x < 0 && (ey - y) * y < 0;
  const label = {
    x: (inward ? ex : x) + (x > unit ? -3 : 3) * unit, y: y + (above ? -4 : 6.5) * unit,
    "font-size": 4.4 * unit, "text-anchor": x > unit ? "end" : "start", class: "legend",
  };
  return svg("g", {}, ...parts, svg("title", {}, `${name}: ${words} \u00b5m`),
    svg("text", label, `${name} \u00b7 ${number(Math.hypot(...vectorOf(mark)), 1)}`));
}

/**
 * @param {Film[]} films @param {Films["rolls"]} rolls @param {Film} one
 * @param {() => void} again
 */
function table(films, rolls, one, again) {
  const heads = COLUMNS.map((name) => element("th",
    { title: tip(`film.${name.split(".")[0]}`) }, word(`film.${name}`)));
  const lines = films.map((film) => {
    const choose = () => {
      state.current = film.photo;
      again();
    };
    const cells = [
      number(film.scale_x, 0), number(film.scale_y, 0), number(film.shear, 3), number(film.rms, 1),
      number(film.rms_plain, 1), number(film.redundancy, 0),
      (film.chance ?? 1) < 0.001 ? `< ${number(0.001, 3)}` : number(film.chance, 3),
    ];
    return element("tr",
      { class: film === one ? "on" : "", "data-film": film.photo, onclick: choose },
      element("td", { class: "name", title: film.photo },
        element("button", { class: "link", "aria-pressed": `${film === one}` },
          shortName(film.photo))),
      ...cells.map((text) => element("td", {}, text)));
  });
  const means = Object.entries(rolls).map(([camera, roll]) => roll && mean(camera, roll))
    .filter((row) => row !== null);
  return element("table", { class: "film-table" }, element("tr", {}, ...heads), ...means, ...lines);
}

/** @param {string} camera @param {Roll} roll */
function mean(camera, roll) {
  const name = word("film.mean", { camera, count: roll.count });
  const cells = roll.mean.map((value, at) => {
    const digits = at < 2 ? 0 : 3;
    return element("td", {}, `${number(value, digits)} \u00b1 ${number(roll.spread[at], digits)}`);
  });
  return element("tr", { class: "mean" }, element("td", { class: "name" }, name), ...cells,
    element("td", {}, number(roll.rms, 1)), element("td", { colspan: 3 }));
}
