// The quality of the block: verdict with reasons, maps, photos worst first; printable.
import {
  all, byId, element, first, number, renew, shortName, start, svg, tip, word,
} from "./words.js";
import { showTies } from "./block.js";
import { openBoard } from "./board.js";
import { openChecks } from "./checks.js";
import { showAllParts } from "./layout.js";
import { mosaicButton, openMosaic } from "./mosaic.js";
import { lets } from "./queue.js";
import { fewer, keptOut } from "./status.js";
import { samples } from "./samples.js";
import { findingSaid, readings, ruled, signing } from "./sign.js";
import { send } from "./wire.js";

const WORST_TIES = 10; // design: so many can be gone through
const MOST_SHIFTS = 12; // design: the photos that moved furthest; the rest says nothing more
/** Kinds of the queue by class of residuals. @type {Record<string, string>} */
const CLASS_ROLES = {
  tie: "tie", dem: "tie", control_image: "control", control_plan: "control",
  control_height: "control",
};
const state = { shown: "" };

export function setUpQuality() {
  byId("quality").addEventListener("close", () => send({ kind: "quality", shown: false }));
  addEventListener("beforeprint", () => {
    const when = new Date().toISOString().slice(0, 16);
    const values = { when, who: byId("who").textContent ?? "", version: start.version };
    for (const line of all(".printed", byId("quality"))) {
      line.textContent = word("quality.printed", values);
    }
  });
}

/** @param {Quality} [known] what was told last: it is not told again when nothing changed */
export function openQuality(known) {
  const sheet = byId("quality");
  if (sheet.open) return sheet.close();
  renew(sheet, element("p", { class: "muted" }, word("wait")));
  sheet.showModal();
  state.shown = "";
  if (known) showQuality(known);
  send({ kind: "quality", shown: true });
}

/** @param {Quality} found */
export function showQuality(found) {
  const sheet = byId("quality");
  const shape = JSON.stringify(found);
  if (!sheet.open || state.shown === shape) return;
  state.shown = shape;
  const kept = sheet.querySelector(".sheet")?.scrollTop ?? 0;
  const rules = () => ruled(found, (kind, values) => lookFor(found, kind, values));
  const parts = [verdict, readings, samples, signing, maps, rules, flight, photos, overlaps,
    adjustments].map((make) => make(found));
  renew(sheet, head(found), element("div", { class: "sheet" }, ...parts));
  first(".sheet", sheet).scrollTop = kept;
}

/** @param {string} name @param {Node[]} children */
const part = (name, ...children) => element("section",
  { class: "quality-part", "data-part": name },
  element("h3", {}, word(`quality.${name}`)), ...children);

/** Heads stand as the cells below them do. @param {string[]} names @param {Element[]} lines */
function table(names, lines) {
  const heads = names.map((name, column) => element("th", { title: tip(`quality.${name}`),
    class: lines[0]?.children[column]?.className ?? "" }, word(`quality.${name}`)));
  return element("table", {}, element("tr", {}, ...heads), ...lines);
}

/** @param {string | Node} content */
const cell = (content, kind = "") => element("td", { class: kind }, content);

/** @param {Quality} found */
function head({ sigma, mp, checks }) {
  const own = mp === null ? word("status.mp.none")
    : `${word("status.mp", { count: checks.count })} ${number(mp, 3, "m")}${fewer(checks)}`;
  const accuracy = own + keptOut(checks);
  const words = `${word("status.sigma")} ${number(sigma, 3)} \u00b7 ${accuracy}`;
  const close = () => byId("quality").close();
  return element("header", {}, element("h2", {}, `${word("quality")} \u00b7 ${start.name}`),
    element("span", { class: "muted" }, words), element("span", { class: "stretch" }),
    mosaicButton("quality"),
    element("button", { id: "quality-checks", title: word("checks.tip"), onclick: () => {
      byId("quality").close();
      openChecks(undefined);
    } }, word("checks")),
    element("button", { onclick: () => window.print() }, word("quality.print")),
    element("button", { id: "quality-close", onclick: close }, word("act.close")));
}

/**
 * @typedef {{ state?: string, photo?: string, role?: string, area?: Pair[], key?: Key,
 *   worst?: string }} Aim a measurement among others of its state, or all of a photo, kind or
 *   place; `worst`: the column by which those furthest off are shown first
 */

/** Goes on in the queue; where all of a state is decided, among what is. @param {Aim} aim */
function goTo({ state: among = "all", photo = "", role = "", area = [], key, worst }) {
  byId("quality").close();
  showAllParts();
  const filter = { photo, role, area, state: among };
  if (worst) send({ kind: "sort", column: worst, descending: true });
  send({ kind: "filter", ...filter, state: key || lets(filter) ? among : "all" });
  if (key) send({ kind: "select", key });
}

/** A photo that the queue has nothing of leads nowhere. @param {string} name */
const photoLink = (name) => (lets({ photo: name }) ? element("button", {
  class: "link", title: tip("quality.photo.go"), onclick: () => goTo({ photo: name }),
}, shortName(name)) : element("span", {}, shortName(name)));

/** To a part of this sheet. @param {string} where */
function scrollTo(where) {
  const room = first(where, byId("quality"));
  room.tabIndex = -1;
  room.scrollIntoView();
  room.focus();
}

/** @param {Pair} [place] */
function inMosaic(place) {
  byId("quality").close();
  openMosaic(place);
}

/** @param {number} rays */
function ties3d(rays) {
  byId("quality").close();
  showTies(rays);
}

const toPart = (/** @type {string} */ name) => () => scrollTo(`[data-part=${name}]`);
const [toControl, toRays, toOverlaps, toPhotos, toSamples] =
  ["control", "rays", "overlaps", "photos", "samples"].map(toPart);
const toReadings = () => {
  byId("quality").close();
  openChecks(undefined);
};

const DISPUTED = { state: "disputed", worst: "gain" };
const CHECKS = { role: "check" };
/** What the queue has of doubts about many measurements. @type {Record<string, Aim | undefined>} */
const AIMS = {
  contradicted: DISPUTED, "contradicted-far": DISPUTED, "contradicted-check": DISPUTED,
  "contradicted-more": DISPUTED, unchecked: { state: "unchecked" },
  "one-check": CHECKS, "checks-few": CHECKS, "checks-better": CHECKS, "checks-worse": CHECKS,
  "checks-over": CHECKS,
};
/** Doubts about how a photo was flown: no measurement of it tells why. */
const FLOWN = ["tilt-over", "crab-over"];
/**
 * Where doubts lead that the queue has nothing of.
 * @type {Record<string, ((values: Record<string, string>) => void) | undefined>}
 */
const LEADS = {
  holes: ({ east, north }) => inMosaic([Number(east), Number(north)]),
  "misfit-places": ({ east, north }) => inMosaic([Number(east), Number(north)]),
  "faults-open": () => inMosaic(),
  "along-small": toOverlaps, "across-small": toOverlaps,
  "rays-few": toRays, "no-ties": toRays,
  "control-few": toControl, "control-gaps": toControl, "control-on-a-line": toControl,
  "inside-few-plan": toControl, "inside-few-heights": toControl,
  systematic: () => scrollTo("[data-map=pattern]"),
  "class-large": toPhotos,
  "no-checks": toReadings, "second-few": toReadings, "second-none": toReadings,
  ...Object.fromEntries(["few", "replaced", "late", "outdated", "over", "shifted", "worse"]
    .map((of) => [`read-${of}`, toReadings])), ...Object.fromEntries(["open", "rejected",
    "rejected-before", "changed", "replaced"].map((of) => [`sheets-${of}`, toSamples])),
};

/**
 * The button that leads to what a doubt is about; none where there is nothing to be seen. One of
 * several leads to all of them.
 * @param {Quality} found @param {string} text @param {Record<string, string>} values
 */
function lookFor({ photos: flown }, text, values) {
  const { count, worst, photo, more, class: of } = values;
  const kind = text.replace("verdict.", "");
  const among = kind === "unchecked" ? kind : "disputed";
  const isPhoto = flown.some((one) => one.photo === worst);
  /** @type {(Aim | false | undefined)[]} */
  const aims = [
    Boolean(worst && photo && !more && !(Number(count) > 1))
      && { state: among, key: [worst, photo] },
    isPhoto && !FLOWN.includes(kind) && { photo: worst },
    Boolean(CLASS_ROLES[of]) && { state: "open", role: CLASS_ROLES[of], worst: "misfit" },
    AIMS[kind],
  ];
  const aim = aims.find((one) => one && (one.key || lets({ ...one, state: "all" })));
  const lead = isPhoto ? toPhotos : LEADS[kind];
  if (!aim && !lead) return [];
  const open = () => (aim ? goTo(aim) : lead?.(values));
  return [element("button", { onclick: open }, word("quality.look"))];
}

/** @param {Quality} found */
function verdict(found) {
  const { verdict: gravest, findings } = found;
  const lines = findings.map(([text, grave, values]) => element("li", { class: `grave${grave}` },
    element("b", {}, word(`grave.${grave}`)), findingSaid(text, values), " ",
    ...(grave ? lookFor(found, text, values) : [])));
  const words = element("p", { class: `verdict grave${gravest}` }, word(`verdict.${gravest}`));
  const attributes = { class: "quality-part", "data-part": "verdict" };
  const signed = element("p", { class: "signed" }, word("quality.signed"));
  return element("section", attributes, element("p", { class: "printed" }), words,
    element("ul", {}, ...lines), signed);
}

/** @param {Quality} found */
function maps(found) {
  const { outlines, control, checks, ties, origin } = found.map;
  const every = Object.values(outlines).flat();
  if (!every.length) return part("map", element("p", {}, word("quality.map.none")));
  const [[west, south], [east, north]] = [Math.min, Math.max].map((most) =>
    [0, 1].map((axis) => most(...every.map((place) => place[axis]))));
  const [wide, high] = [Math.max(east - west, 1), Math.max(north - south, 1)];
  const unit = Math.max(wide, high) / 420;
  const at = (/** @type {Pair} */ [x, y]) => [x - west, north - y];
  const vectors = [...control.map(([x, y, dx, dy]) => [x, y, dx, dy]), ...checks]
    .map((place) => place.map(Number));
  const lengths = vectors.map((p) => Math.hypot(p[2], p[3])).sort((a, b) => a - b);
  const typical = lengths[Math.floor(0.8 * lengths.length)] || 1;
  const longer = (24 * unit) / typical;
  // Arrows may leave the block; an arrow of a blunder does not make all else small.
  const [over, under] = [Math.min, Math.max].map((most) => [0, 1].map((axis) => most(0,
    ...vectors.map(([x, y, dx, dy]) => at([x + dx * longer, y + dy * longer])[axis]
      - (most === Math.max ? [wide, high][axis] : 0)))));
  const room = (/** @type {number} */ beyond) => Math.min(Math.abs(beyond), 60 * unit) + 12 * unit;
  const low = high + room(under[1]) + 10 * unit;
  const box = [-room(over[0]), -room(over[1]), wide + room(over[0]) + room(under[0]),
    low + 10 * unit + room(over[1])].join(" ");
  const ground = roundBelow(wide / 5);
  const draw = (/** @type {Node[]} */ ...children) => svg("svg", { viewBox: box, class: "map" },
    ...Object.values(outlines).map((ring) => svg("polygon", {
      points: ring.map((p) => at(p).join(",")).join(" "),
      class: "outline", "stroke-width": 0.8 * unit,
    })), ...children, ...scaleBar([0, low], ground, number(ground, 0, "m"), unit));
  const arrows = vectors.flatMap((place, index) => {
    const [point, photo] = (control[index] ?? []).slice(4);
    const drawn = vector(place, at, unit, longer, index < control.length ? "control" : "check");
    if (!point || !photo) return drawn;
    return [going(`${point}`, () => goTo({ key: [`${point}`, `${photo}`] }), drawn)];
  });
  oneStop(arrows);
  const metres = roundBelow(120 * unit / longer);
  const digits = Math.max(0, Math.ceil(-Math.log10(metres)));
  const scale = scaleBar([wide - metres * longer, low], metres * longer,
    number(metres, digits, "m"), unit, "vector control");
  const [dots, ramp] = sigmas(ties, at, unit, origin);
  oneStop(dots);
  return element("div", { class: "maps" },
    figure("residuals", draw(...arrows, ...scale), word("quality.residuals.long")),
    figure("sigma", draw(...dots), word("quality.sigma.long"), ramp),
    figure("pattern", pattern(found), word("quality.pattern.long"), element("button",
      { class: "link", onclick: onFilm }, word("quality.pattern.photos"))));
}

function onFilm() {
  byId("quality").close();
  openBoard(undefined, "film");
}

/**
 * A part of a drawing that is a button, too.
 * @param {string} name @param {() => void} act @param {Element[]} drawn
 */
function going(name, act, drawn) {
  const label = { class: "goes", role: "button", tabindex: -1, "aria-label": name };
  const group = /** @type {SVGElement} */ (svg("g", label, ...drawn, svg("title", {}, name)));
  group.addEventListener("click", act);
  group.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    act();
  });
  return group;
}

/** Of many buttons in a drawing Tab reaches one, arrows the others. @param {Element[]} drawn */
function oneStop(drawn) {
  const stops = /** @type {SVGElement[]} */ (drawn.filter((one) => one.matches(".goes")));
  stops[0]?.setAttribute("tabindex", "0");
  stops.forEach((stop, at) => stop.addEventListener("keydown", ({ key }) => {
    const step = Number(key === "ArrowRight") - Number(key === "ArrowLeft");
    const next = stops[at + step];
    if (!step || !next) return;
    stop.setAttribute("tabindex", "-1");
    next.setAttribute("tabindex", "0");
    next.focus();
  }));
}

/**
 * @param {string} name @param {Element} drawing @param {string} words @param {Element[]} below
 */
const figure = (name, drawing, words, ...below) => element("figure", { "data-map": name },
  element("figcaption", {}, element("b", {}, word(`quality.${name}`)), ` ${words}`), drawing,
  ...below);

/** One, two or five times a power of ten. @param {number} most */
export function roundBelow(most) {
  const step = 10 ** Math.floor(Math.log10(most));
  return (most >= 5 * step ? 5 : most >= 2 * step ? 2 : 1) * step;
}

/**
 * A line from a place to the right, as long as its words say.
 * @param {Pair} place @param {number} length @param {string} words
 * @param {number} unit @param {string} kind
 */
function scaleBar([x, y], length, words, unit, kind = "scale") {
  const line = { x1: x, y1: y, x2: x + length, y2: y, "stroke-width": 1.8 * unit, class: kind };
  const above = { x, y: y - 4 * unit, "font-size": 12 * unit, class: "legend" };
  return [svg("line", line), svg("text", above, words)];
}

/**
 * @param {number[]} point @param {(place: Pair) => Pair} at @param {number} unit
 * @param {number} longer @param {string} kind
 */
function vector([x, y, dx, dy], at, unit, longer, kind) {
  const [left, top] = at([x, y]);
  const end = { x2: left + dx * longer, y2: top - dy * longer };
  const ink = { class: `vector ${kind}`, "stroke-width": 1.4 * unit };
  const line = svg("line", { x1: left, y1: top, ...end, ...ink });
  const [side, low] = [6 * unit, top + 2.4 * unit];
  const corners = `L${left + 3.2 * unit} ${low}L${left - 3.2 * unit} ${low}Z`;
  const box = { x: left - side / 2, y: top - side / 2, width: side, height: side, class: kind };
  return [line, kind === "check" ? svg("rect", box)
    : svg("path", { d: `M${left} ${top - 3.6 * unit}${corners}`, class: kind })];
}

/**
 * Dots from small and grey to large and warm: size tells as well as colour. The worst lead to their
 * places in the mosaic.
 * @param {Quality["map"]["ties"]} ties @param {(place: Pair) => Pair} at @param {number} unit
 * @param {Pair} origin @returns {[Element[], Element]}
 */
function sigmas(ties, at, unit, [east, north]) {
  const known = ties.map((tie) => tie[2]).filter((value) => value !== null).sort((a, b) => a - b);
  const [low = 0, high = 1] = [0.05, 0.95].map((share) => known[Math.floor(share * known.length)]);
  const least = known.at(-WORST_TIES) ?? high;
  const dots = ties.map(([x, y, sigma]) => {
    const off = ((sigma ?? high) - low) / Math.max(high - low, 1e-6);
    const share = Math.min(Math.max(off, 0), 1);
    const [cx, cy] = at([x, y]);
    const style = `fill: color-mix(in oklab, var(--warn) ${100 * share}%, var(--faint))`;
    const dot = svg("circle", { cx, cy, r: (0.8 + 2.2 * share) * unit, style });
    const name = number(sigma, 2, "m");
    if (sigma !== null && sigma >= least) {
      return going(name, () => inMosaic([east + x, north + y]), [dot]);
    }
    dot.append(svg("title", {}, name));
    return dot;
  });
  const ramp = element("p", { class: "muted ramped" }, `\u2264 ${number(low, 2)} `,
    element("i", { class: "ramp" }), ` \u2265 ${number(high, 2, "m")}`);
  return [dots, ramp];
}

/** @param {Quality} found */
function pattern(found) {
  const side = found.pattern.length;
  const lengths = found.pattern.flat().map(([x, y]) => Math.hypot(x ?? 0, y ?? 0));
  const longest = Math.max(1, ...lengths);
  const outline = { x: 0, y: 0, width: side, height: side, class: "outline" };
  const children = [svg("rect", { ...outline, "stroke-width": 0.03 })];
  found.pattern.forEach((line, row) => line.forEach(([x, y], column) => {
    if (x === null || y === null) return;
    const [cx, cy] = [column + 0.5, row + 0.5];
    const end = { x2: cx + (0.45 * x) / longest, y2: cy - (0.45 * y) / longest };
    const ink = { class: "vector control", "stroke-width": 0.05 };
    const size = number(Math.hypot(x, y), 1, "\u00b5m");
    const words = `${size} \u00b7 ${found.pattern_counts[row][column]}`;
    children.push(svg("line", { x1: cx, y1: cy, ...end, ...ink }),
      svg("circle", { cx, cy, r: 0.05, class: "control" }, svg("title", {}, words)));
  }));
  const words = word("quality.longest", { value: number(longest, 1) });
  const place = { x: 0, y: side + 0.32, "font-size": 0.26, class: "legend" };
  return svg("svg", { viewBox: `-0.2 -0.2 ${side + 0.4} ${side + 0.7}`, class: "map" },
    ...children, svg("text", place, words));
}

/** @param {Quality} found */
function flight(found) {
  const total = found.rays.reduce((sum, [, count]) => sum + count, 0) || 1;
  const bars = found.rays.map(([rays, count]) => element("div", { class: "bar" },
    element("button", { class: "link", title: word("quality.rays.tip"),
      onclick: () => ties3d(rays) }, `${rays}`), bar(count / total),
    element("span", { class: "muted" }, `${count}`)));
  const cells = element("div", { class: "cells" }, ...found.control_cells.flat()
    .map((count, index) => {
      const area = cellArea(found, index);
      return element("button", { class: count ? "" : "empty", disabled: !lets({ area }),
        title: word("quality.control.tip"), onclick: () => goTo({ area }) }, `${count}`);
    }));
  const words = element("p", { class: "muted" }, word("quality.control.long"));
  return element("div", { class: "pair" }, part("rays", ...bars), part("control", words, cells));
}

/** Corners of one of the nine parts of the block. @param {Quality} found @param {number} index */
function cellArea({ map: { bounds } }, index) {
  const [west, south, east, north] = bounds;
  const [wide, high] = [(east - west) / 3, (north - south) / 3];
  const [left, top] = [west + (index % 3) * wide, north - Math.floor(index / 3) * high];
  return [[left, top], [left + wide, top], [left + wide, top - high], [left, top - high]];
}

/** @param {number} share */
function bar(share) {
  const inner = element("i");
  inner.style.width = `${100 * share}%`;
  return element("span", { class: "share" }, inner);
}

/** @param {Quality} found */
function photos(found) {
  const [tilt, crab] = found.turned;
  const large = (/** @type {number | null} */ value, /** @type {number} */ limit) =>
    cell(number(value, 1), (value ?? 0) > limit ? "large" : "");
  const areas = (/** @type {number[]} */ cells) => element("span", { class: "cells small" },
    ...cells.map((count) => element("i", { class: count ? "" : "empty", title: `${count}` })));
  const lines = found.photos.map((photo) => element("tr", { class: photo.oriented ? "" : "loose" },
    cell(photoLink(photo.photo), "name"), cell(number(photo.rms, 2)), cell(`${photo.control}`),
    cell(`${photo.ties}`), cell(number(photo.sigma, 2)), large(photo.tilt, tilt),
    large(photo.crab, crab), cell(areas(photo.cells))));
  const names = ["photo", "rms", "control.count", "ties", "centre", "tilt", "crab", "areas"];
  return part("photos", table(names, lines));
}

/** @param {Quality} found */
function overlaps(found) {
  const lines = found.overlaps.map(([one, other, share, ties, along]) => {
    const direction = along === null ? "diagonal" : along ? "along" : "across";
    const pair = element("div", {}, photoLink(one), " \u2013 ", photoLink(other));
    return element("tr", {}, cell(pair, "name"),
      cell(`${share} %`), cell(`${ties}`, ties ? "" : "large"),
      cell(word(`quality.${direction}`), "name"));
  });
  return part("overlaps", table(["pair", "share", "common", "direction"], lines));
}

/** @param {Quality} found */
function adjustments(found) {
  const { milestones, compared } = found;
  const pair = compared?.pair ?? [0, 0];
  const [a, b] = pair.map((wanted) => milestones.find((one) => one.number === wanted));
  const lines = [
    compareLine("sigma", a?.sigma, b?.sigma), compareLine("mp", a?.mp, b?.mp),
    ...["tie", "control", "check"].map((name) =>
      compareLine(`rms.${name}`, a?.rms[name], b?.rms[name])),
    compareLine("used", a?.used, b?.used, 0), compareLine("decided", a?.decided, b?.decided, 0),
  ];
  const shifts = (compared?.shifts ?? []).slice(0, MOST_SHIFTS).map(([name, metres]) =>
    element("tr", {}, cell(photoLink(name), "name"), cell(number(metres, 2, "m"))));
  const [one, other] = pair.map((wanted, place) => choice(milestones, wanted, place));
  return element("div", { class: "pair" },
    part("compared", element("p", {}, one, " \u2192 ", other), element("table", {}, ...lines),
      ...(start.free.length ? [freed(found)] : [])),
    part("shifts", element("table", {}, ...shifts)));
}

/** @param {string} name @param {number | null} [before] @param {number | null} [after] */
const compareLine = (name, before, after, digits = 3) => element("tr", {},
  cell(word(`quality.compared.${name}`), "name"), cell(number(before, digits)),
  cell(number(after, digits)));

/** @param {Milestone[]} milestones @param {number} chosen @param {number} place in the pair */
function choice(milestones, chosen, place) {
  const options = milestones.map(({ number: value, decided }) => element("option",
    { value, selected: value === chosen },
    word("quality.adjustment", { number: value, decided })));
  const select = element("select",
    { "aria-label": word("quality.compared"), "data-pair": place }, ...options);
  select.addEventListener("change", () => {
    const selects = /** @type {HTMLSelectElement[]} */ (all("[data-pair]", byId("quality")));
    send({ kind: "quality", shown: true, pair: selects.map((item) => Number(item.value)) });
  });
  return select;
}

/** What the adjustment estimates; every change runs it again. @param {Quality} found */
function freed(found) {
  const boxes = ["cameras", "robust"].map((option, place) => {
    const disabled = start.guest || !start.free[place];
    const attributes = { "data-free": option, checked: found.free[place], disabled };
    const box = element("input", { type: "checkbox", ...attributes });
    box.addEventListener("change", () => {
      const asked = /** @type {HTMLInputElement[]} */ (all("[data-free]", byId("quality")));
      const chosen = asked.map((item) => [item.dataset.free, item.checked]);
      send({ kind: "free", ...Object.fromEntries(chosen) });
    });
    const name = `quality.free.${option}`;
    return element("label", { title: tip(name) }, box, word(name));
  });
  return element("p", { class: "free" }, ...boxes);
}
