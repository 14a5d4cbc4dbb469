// The quality of the block: verdict with reasons, maps, photos worst first; printable.
import { byId, element, number, shortName, start, word } from "/pages/words.js";

let send = () => {};
let showing = null;

export function setUpQuality(sender) {
  send = sender;
  byId("quality").addEventListener("close", () => send({ kind: "quality", shown: false }));
}

// `known` is what was told last: it is not told again when nothing changed.
export function openQuality(known) {
  const sheet = byId("quality");
  if (sheet.open) { sheet.close(); return; }
  sheet.replaceChildren(element("p", { class: "muted" }, word("quality.wait")));
  sheet.showModal();
  showing = null;
  if (known) showQuality(known);
  send({ kind: "quality", shown: true });
}

export function showQuality(found) {
  const sheet = byId("quality");
  const shape = JSON.stringify(found);
  if (!sheet.open || showing === shape) return;
  showing = shape;
  const kept = sheet.querySelector(".sheet")?.scrollTop ?? 0;
  sheet.replaceChildren(head(found), element("div", { class: "sheet" }, verdict(found), maps(found), flight(found), photos(found), overlaps(found), adjustments(found)));
  sheet.querySelector(".sheet").scrollTop = kept;
}

const part = (name, ...children) => element("section", { class: "quality-part", "data-part": name }, element("h3", {}, word(`quality.${name}`)), ...children);
const table = (names, lines) => element("table", {}, element("tr", {}, ...names.map((name) => element("th", { title: start.words[`quality.${name}.tip`] ?? null }, word(`quality.${name}`)))), ...lines);
const cell = (content, kind = "") => element("td", { class: kind }, content);

function head(found) {
  return element("header", {}, element("h2", {}, `${word("quality")} \u00b7 ${start.name}`),
    element("span", { class: "muted" }, `${word("status.sigma")} ${number(found.sigma, 3)} \u00b7 ${found.mp === null ? word("status.mp.none") : `${word("status.mp")} ${number(found.mp, 3, "m")}`}`),
    element("span", { class: "stretch" }),
    element("button", { onclick: () => window.print() }, word("quality.print")),
    element("button", { id: "quality-close", onclick: () => byId("quality").close() }, word("act.refuse")));
}

function verdict(found) {
  const lines = found.findings.map(([text, grave, values]) => {
    const shown = { ...values, ...(values.worst ? { worst: shortName(values.worst) } : {}) };
    return element("li", { class: `grave${grave}` }, element("b", {}, word(`grave.${grave}`)), word(text, shown));
  });
  return element("section", { class: "quality-part", "data-part": "verdict" }, element("p", { class: `verdict grave${found.verdict}` }, word(`verdict.${found.verdict}`)), element("ul", {}, ...lines));
}

// An SVG from tag, attributes and children: text only ever as text.
function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function maps(found) {
  const rings = Object.values(found.map.outlines);
  const every = rings.flat();
  if (!every.length) return part("map", element("p", {}, word("quality.map.none")));
  const [west, east] = [Math.min(...every.map((p) => p[0])), Math.max(...every.map((p) => p[0]))];
  const [south, north] = [Math.min(...every.map((p) => p[1])), Math.max(...every.map((p) => p[1]))];
  const [wide, high] = [Math.max(east - west, 1), Math.max(north - south, 1)];
  const unit = Math.max(wide, high) / 420;
  const at = ([x, y]) => [x - west, north - y];
  const draw = (...children) => svg("svg", { viewBox: `${-12 * unit} ${-12 * unit} ${wide + 24 * unit} ${high + 24 * unit}`, class: "map" }, ...outlines(found, at, unit), ...children);
  const lengths = [...found.map.control, ...found.map.checks].map((p) => Math.hypot(p[2] ?? 0, p[3] ?? 0)).sort((a, b) => a - b);
  const typical = lengths[Math.floor(0.8 * lengths.length)] || 1;
  const longer = (24 * unit) / typical;
  return element("div", { class: "maps" },
    figure("residuals", draw(...vectors(found.map.control, at, unit, longer, "control"), ...vectors(found.map.checks, at, unit, longer, "check")), word("quality.residuals.long", { longer: number(longer, 0) })),
    figure("sigma", draw(...sigmas(found.map.ties, at, unit)), word("quality.sigma.long")),
    figure("pattern", pattern(found), word("quality.pattern.long")));
}

const figure = (name, drawing, words) => element("figure", { "data-map": name }, element("figcaption", {}, element("b", {}, word(`quality.${name}`)), ` ${words}`), drawing);

function outlines(found, at, unit) {
  return Object.values(found.map.outlines).map((ring) => svg("polygon", { points: ring.map((p) => at(p).join(",")).join(" "), class: "outline", "stroke-width": 0.8 * unit }));
}

function vectors(points, at, unit, longer, kind) {
  return points.flatMap(([x, y, dx, dy]) => {
    const [left, top] = at([x, y]);
    const line = svg("line", { x1: left, y1: top, x2: left + (dx ?? 0) * longer, y2: top - (dy ?? 0) * longer, class: `vector ${kind}`, "stroke-width": 1.4 * unit });
    const mark = kind === "check" ? svg("rect", { x: left - 3 * unit, y: top - 3 * unit, width: 6 * unit, height: 6 * unit, class: kind }) : svg("path", { d: `M${left} ${top - 3.6 * unit}L${left + 3.2 * unit} ${top + 2.4 * unit}L${left - 3.2 * unit} ${top + 2.4 * unit}Z`, class: kind });
    return [line, mark];
  });
}

// Dots from small and cool to large and warm: size tells as well as colour.
function sigmas(ties, at, unit) {
  const known = ties.map((tie) => tie[2]).filter((value) => value !== null).sort((a, b) => a - b);
  const [low, high] = [known[Math.floor(0.05 * known.length)] ?? 0, known[Math.floor(0.95 * known.length)] ?? 1];
  return ties.map(([x, y, sigma]) => {
    const share = Math.min(Math.max(((sigma ?? high) - low) / Math.max(high - low, 1e-6), 0), 1);
    const [left, top] = at([x, y]);
    return svg("circle", { cx: left, cy: top, r: (0.8 + 2.2 * share) * unit, fill: `hsl(${200 - 170 * share} 75% 52%)` }, svg("title", {}, number(sigma, 2, "m")));
  });
}

function pattern(found) {
  const side = found.pattern.length;
  const longest = Math.max(0.05, ...found.pattern.flat().map(([x, y]) => Math.hypot(x ?? 0, y ?? 0)));
  const children = [svg("rect", { x: 0, y: 0, width: side, height: side, class: "outline", "stroke-width": 0.03 })];
  found.pattern.forEach((line, row) => line.forEach(([x, y], column) => {
    const [cx, cy] = [column + 0.5, row + 0.5];
    if (x === null) return;
    const [ex, ey] = [cx + (0.45 * x) / longest, cy + (0.45 * y) / longest];
    children.push(svg("line", { x1: cx, y1: cy, x2: ex, y2: ey, class: "vector control", "stroke-width": 0.05 }), svg("circle", { cx, cy, r: 0.05, class: "control" }, svg("title", {}, `${number(Math.hypot(x, y), 2)} px \u00b7 ${found.pattern_counts[row][column]}`)));
  }));
  const text = svg("text", { x: 0, y: side + 0.32, "font-size": 0.26, class: "legend" });
  text.textContent = word("quality.longest", { value: number(longest, 2) });
  return svg("svg", { viewBox: `-0.2 -0.2 ${side + 0.4} ${side + 0.7}`, class: "map" }, ...children, text);
}

function flight(found) {
  const total = found.rays.reduce((sum, [, count]) => sum + count, 0) || 1;
  const bars = found.rays.map(([rays, count]) => element("div", { class: "bar" }, element("span", {}, `${rays}`), bar(count / total), element("span", { class: "muted" }, `${count}`)));
  const cells = element("div", { class: "cells" }, ...found.control_cells.flat().map((count) => element("i", { class: count ? "" : "empty" }, `${count}`)));
  return element("div", { class: "pair" }, part("rays", ...bars), part("control", element("p", { class: "muted" }, word("quality.control.long")), cells));
}

function bar(share) {
  const inner = element("i");
  inner.style.width = `${100 * share}%`;
  return element("span", { class: "share" }, inner);
}

function photos(found) {
  const lines = found.photos.map((photo) => element("tr", { class: photo.oriented ? "" : "loose" }, cell(shortName(photo.photo), "name"),
    cell(number(photo.rms, 2)), cell(`${photo.control}`), cell(`${photo.ties}`), cell(number(photo.sigma, 2)),
    cell(number(photo.tilt, 1), photo.tilt > 3 ? "large" : ""), cell(number(photo.crab, 1), photo.crab > 5 ? "large" : ""),
    cell(element("span", { class: "cells small" }, ...photo.cells.map((count) => element("i", { class: count ? "" : "empty", title: `${count}` }))))));
  return part("photos", table(["photo", "rms", "control.count", "ties", "centre", "tilt", "crab", "areas"], lines));
}

function overlaps(found) {
  const lines = found.overlaps.map(([one, other, share, ties, along]) => element("tr", {}, cell(`${shortName(one)} \u2013 ${shortName(other)}`, "name"), cell(`${share} %`), cell(`${ties}`, ties ? "" : "large"), cell(word(along === true ? "quality.along" : along === false ? "quality.across" : "quality.diagonal"), "name")));
  return part("overlaps", table(["pair", "share", "common", "direction"], lines));
}

function adjustments(found) {
  const [one, other] = found.compared?.pair ?? [0, 0];
  const choice = (chosen, place) => {
    const select = element("select", { "data-pair": place }, ...found.milestones.map((m) => element("option", { value: m.number, selected: m.number === chosen }, word("quality.adjustment", { number: m.number, decided: m.decided }))));
    select.addEventListener("change", () => {
      const pair = [...byId("quality").querySelectorAll("[data-pair]")].map((item) => Number(item.value));
      send({ kind: "quality", shown: true, pair });
    });
    return select;
  };
  const of = (number_) => found.milestones.find((m) => m.number === number_) ?? {};
  const [a, b] = [of(one), of(other)];
  const figures = [["sigma", a.sigma, b.sigma, 3], ["mp", a.mp, b.mp, 3], ...["tie", "control", "check"].map((name) => [`rms.${name}`, a.rms?.[name], b.rms?.[name], 3]), ["used", a.used, b.used, 0], ["decided", a.decided, b.decided, 0]];
  const lines = figures.map(([name, before, after, digits]) => element("tr", {}, cell(word(`quality.compared.${name}`), "name"), cell(number(before, digits)), cell(number(after, digits))));
  const shifts = (found.compared?.shifts ?? []).slice(0, 12).map(([name, metres]) => element("tr", {}, cell(shortName(name), "name"), cell(number(metres, 2, "m"))));
  return element("div", { class: "pair" }, part("compared", element("p", {}, choice(one, "0"), " \u2192 ", choice(other, "1")), element("table", {}, ...lines), ...(start.free ? [freed(found)] : [])), part("shifts", element("table", {}, ...shifts)));
}

// What the adjustment estimates; every change runs it again.
function freed(found) {
  const boxes = ["cameras", "robust"].map((name, place) => {
    const box = element("input", { type: "checkbox", "data-free": name, checked: found.free[place], disabled: start.guest });
    box.addEventListener("change", () => {
      const chosen = Object.fromEntries([...byId("quality").querySelectorAll("[data-free]")].map((item) => [item.dataset.free, item.checked]));
      send({ kind: "free", ...chosen });
    });
    return element("label", { title: word(`quality.free.${name}.tip`) }, box, word(`quality.free.${name}`));
  });
  return element("p", { class: "free" }, ...boxes);
}
