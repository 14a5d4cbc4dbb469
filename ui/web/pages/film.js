// The deformation of the films: vectors of the marks of one photo, and the mean over the roll.
import { element, number, shortName, start, word } from "/pages/words.js";

let current = "";
let kind = "left"; // after the interior orientation, or after a similarity alone

function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

const vectorOf = (mark) => (kind === "left" ? [mark[3], mark[4]] : [mark[5], mark[6]]);

export function filmPart(found, again) {
  const { films, rolls, frames } = found.films;
  if (!films.length) return element("p", { class: "muted" }, word("film.none"));
  const one = films.find((film) => film.photo === current) ?? films[0];
  current = one.photo;
  const roll = rolls[one.camera];
  const kinds = ["left", "plain"].map((name) => element("button", { class: kind === name ? "on" : "", "data-kind": name, title: word(`film.${name}.tip`), onclick: () => { kind = name; again(); } }, word(`film.${name}`)));
  // One scale for both, so that they can be compared.
  const lengths = [...one.marks, ...(roll?.marks ?? [])].map((mark) => Math.hypot(...vectorOf(mark)));
  const longest = Math.max(...lengths, 0.5);
  const drawings = [figure("film.one", { photo: shortName(one.photo) }, drawing(one.marks, frames[one.camera], longest)),
    roll ? figure("film.roll", { count: roll.count, camera: one.camera }, drawing(roll.marks, frames[one.camera], longest)) : element("p", { class: "muted" }, word("film.single"))];
  return element("div", { class: "films" }, element("p", {}, element("span", { class: "segments" }, ...kinds), element("span", { class: "muted" }, ` ${word(`film.${kind}.tip`)}`)),
    element("div", { class: "film-figures" }, ...drawings), table(films, rolls, one, again), element("p", { class: "muted" }, word("film.long")));
}

const figure = (name, values, drawn) => element("figure", {}, element("figcaption", {}, element("b", {}, word(name, values))), drawn);

// Film upright, x right and y up; arrows so long that the longest fills an eighth of the frame.
function drawing(marks, [width, height], longest) {
  const longer = (0.125 * Math.max(width, height)) / longest; // millimetres on the drawing for a micrometre
  const [margin, unit] = [0.16 * Math.max(width, height), Math.max(width, height) / 100];
  const children = [svg("rect", { x: -width / 2, y: -height / 2, width, height, class: "outline", "stroke-width": 0.25 * unit })];
  for (const mark of marks) {
    const [x, y] = [mark[1], -mark[2]];
    const [dx, dy] = vectorOf(mark).map((value) => value * longer);
    const length = Math.hypot(dx, dy);
    const words = `${mark[0]}: ${vectorOf(mark).map((value) => number(value, 1)).join(", ")} \u00b5m`;
    const group = svg("g", {}, svg("circle", { cx: x, cy: y, r: 0.9 * unit, class: "control" }), svg("line", { x1: x, y1: y, x2: x + dx, y2: y - dy, class: "vector control", "stroke-width": 0.55 * unit }));
    if (length > 2 * unit) {
      const [ux, uy] = [dx / length, -dy / length];
      const tip = 1.9 * unit;
      group.append(svg("path", { d: `M${x + dx - tip * (ux + 0.5 * uy)} ${y - dy - tip * (uy - 0.5 * ux)}L${x + dx} ${y - dy}L${x + dx - tip * (ux - 0.5 * uy)} ${y - dy - tip * (uy + 0.5 * ux)}`, class: "vector control tip", "stroke-width": 0.55 * unit }));
    }
    const title = svg("title");
    title.textContent = words;
    // Inside the frame, where no line runs.
    const name = svg("text", { x: x + (x > unit ? -3 : 3) * unit, y: y + (y > 0 ? -4 : 6.5) * unit, "font-size": 3.4 * unit, "text-anchor": x > unit ? "end" : "start", class: "legend" });
    name.textContent = `${mark[0]} \u00b7 ${number(Math.hypot(...vectorOf(mark)), 1)}`;
    group.append(title, name);
    children.push(group);
  }
  const step = [100, 50, 20, 10, 5, 2, 1, 0.5].find((value) => value <= longest * 1.05) ?? 0.5;
  const [left, low] = [-width / 2, height / 2 + 0.55 * margin];
  const legend = svg("text", { x: left + step * longer + 2 * unit, y: low + 1.2 * unit, "font-size": 3.4 * unit, class: "legend" });
  legend.textContent = `${step} \u00b5m`;
  children.push(svg("line", { x1: left, y1: low, x2: left + step * longer, y2: low, class: "vector check", "stroke-width": 0.7 * unit }), legend);
  return svg("svg", { viewBox: `${-width / 2 - margin} ${-height / 2 - margin} ${width + 2 * margin} ${height + 2 * margin}`, class: "map film" }, ...children);
}

function table(films, rolls, one, again) {
  const heads = ["photo", "scale_x", "scale_y", "shear", "rms", "plain", "redundancy", "chance"].map((name) => element("th", { title: start.words[`film.${name}.tip`] ?? null }, word(name === "plain" ? "film.plain.rms" : `film.${name}`)));
  const lines = films.map((film) => element("tr", { class: film === one ? "on" : "", "data-film": film.photo, onclick: () => { current = film.photo; again(); } }, element("td", { class: "name", title: film.photo }, shortName(film.photo)),
    ...[[film.scale_x, 0], [film.scale_y, 0], [film.shear, 3], [film.rms, 1], [film.rms_plain, 1], [film.redundancy, 0], [film.chance, 3]].map(([value, digits]) => element("td", {}, number(value, digits)))));
  const means = Object.entries(rolls).filter(([, roll]) => roll).map(([camera, roll]) => element("tr", { class: "mean" }, element("td", { class: "name" }, word("film.mean", { camera, count: roll.count })),
    ...roll.mean.map((value, at) => element("td", {}, `${number(value, at < 2 ? 0 : 3)} \u00b1 ${number(roll.spread[at], at < 2 ? 0 : 3)}`)), element("td", {}, number(roll.rms, 1)), element("td", { colspan: 3 })));
  return element("table", { class: "film-table" }, element("tr", {}, ...heads), ...means, ...lines);
}
