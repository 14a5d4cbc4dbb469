// Under Block quality: the sample of map sheets that decides for all, its risks and its sheets.
import { openMosaic } from "./mosaic.js";
import { wantSheet, whyOf } from "./mosaic_sheets.js";
import { Question, notice, once, onceRead } from "./asked.js";
import { again, byId, element, moment, number, start, svg, word, written } from "./words.js";

const GRAVE = { accepted: 0, rejected: 2 };
const [WIDE, HIGH] = [260, 150]; // design: of the curve, in its own unit; words are 10 of it high
const [STEPS, MOST_TICKS] = [[0.5, 1, 2, 5, 10, 20], 6]; // design: figures stand apart
const state = { drawing: false, asked: "" };
const replaced = new Question(); // whether a sample that was judged is to be replaced

/** @param {string} seen the digest of the sample that is replaced */
async function draw(seen) {
  if (state.drawing) return;
  state.drawing = true;
  try {
    const query = new URLSearchParams({ seat: start.seat, seen });
    const answer = await (await fetch(`/checks/sheets?${query}`, { method: "POST" })).json();
    if (answer.error) notice(again(answer.error));
  } catch (error) {
    notice(String(error));
  }
  state.drawing = false;
}

/** @param {string} name */
function openSheet(name) {
  byId("quality").close();
  wantSheet(name);
  openMosaic();
}

/** One that was judged is replaced by a second press. @param {Sample | null} sample */
function drawButton(sample) {
  const judged = sample ? sample.drawn - sample.open : 0;
  const asks = judged > 0 && sample?.digest === state.asked;
  const name = !sample ? "samples.draw" : asks ? "samples.again.anyway" : "samples.again";
  const text = word(name, { count: judged });
  replaced.show(asks ? text : "");
  const press = () => {
    if (!sample || !judged || asks) {
      onceRead(() => draw(sample?.digest ?? ""), replaced);
      return;
    }
    state.asked = sample.digest;
    byId("samples-draw").replaceWith(drawButton(sample));
    byId("samples-draw").focus();
  };
  return element("button", { id: "samples-draw", disabled: start.guest, onclick: once(press),
    title: start.words[`${name}.tip`] ?? null }, text);
}

/** @param {(Node | string)[]} children */
const part = (...children) => element("section", { class: "quality-part", "data-part": "samples" },
  element("h3", {}, word("samples")), ...children);

/** @param {Quality} found */
export function samples({ sheets: { count, sample }, map }) {
  const said = (/** @type {string} */ words) => element("p", { class: "muted" }, words);
  if (!sample) {
    return count ? part(said(word("samples.hint", { count })), element("p", {},
      drawButton(null))) : part(said(word("samples.none")));
  }
  const { state: of, bad, open } = sample;
  const grave = GRAVE[/** @type {keyof typeof GRAVE} */ (of)] ?? 1;
  const verdict = of ? element("p", { id: "samples-verdict", class: `grave${grave}` },
    element("b", {}, word(`samples.${of}`, { bad, open }))) : said(word("checks.blind"));
  const [good, poor] = [sample.good_lot, sample.bad_lot];
  // Risks are those of the limits of now: a sample by others has others.
  const risks = sample.changed ? "" : word("samples.risks", { good: written(good[0]),
    bad: written(poor[0]), few: good[1], many: poor[1], producer: number(100 - good[2], 1),
    consumer: number(poor[2], 1) });
  return part(verdict,
    said(word("samples.drawn", { ...sample, when: moment(sample.when) })),
    ...(sample.unchanged ? [] : [element("p", { class: "doubted" }, word("samples.tampered"))]),
    ...(sample.rejected ? [element("p", { class: "grave2" },
      word("samples.rejected-before", { count: sample.rejected }))] : []),
    ...(sample.replaced ? [element("p", { class: "doubted" },
      word("samples.replaced", { count: sample.replaced }))] : []),
    element("div", { class: "pair" }, table(sample), element("div", { class: "samples-drawn" },
      element("figure", {}, element("figcaption", {}, element("b", {}, word("samples.map"))),
        sheetMap(sample, map)),
      element("figure", {}, element("figcaption", {}, element("b", {}, word("samples.curve")),
        ` ${risks}`), curve(sample)))),
    element("p", {}, drawButton(sample)));
}

/** @param {Sample} sample */
function table({ sheets }) {
  const heads = [word("sheet"), word("sheet.state"), word("samples.why")].map((name) =>
    element("th", { class: "name" }, name));
  const lines = sheets.map((sheet) => element("tr", { "data-sheet": sheet.name },
    element("td", { class: "name" }, element("button", { class: "link",
      title: word("samples.go"), onclick: () => openSheet(sheet.name) }, sheet.name)),
    element("td", { class: "name" }, element("b", { class: `sheet-${sheet.state}` },
      word(`sheet.${sheet.state}`))),
    element("td", { class: "name" }, whyOf(sheet))));
  return element("div", { class: "samples-table" },
    element("table", {}, element("tr", {}, ...heads), ...lines));
}

/** Drawn sheets over the footprints. @param {Sample} sample @param {Quality["map"]} map */
function sheetMap({ sheets }, { outlines, origin }) {
  const local = (/** @type {Pair} */ [east, north]) => [east - origin[0], north - origin[1]];
  const rings = sheets.map(({ rings: of }) => of.map((ring) => ring.map(local)));
  const every = [...Object.values(outlines).flat(), ...rings.flat(2)];
  const [[west, south], [east, north]] = [Math.min, Math.max].map((most) =>
    [0, 1].map((axis) => most(...every.map((place) => place[axis]))));
  const unit = Math.max(east - west, north - south, 1) / 420;
  const points = (/** @type {number[][]} */ ring) =>
    ring.map(([x, y]) => `${x - west},${north - y}`).join(" ");
  const box = [-8 * unit, -8 * unit, east - west + 16 * unit, north - south + 16 * unit];
  return svg("svg", { viewBox: box.join(" "), class: "map" },
    ...Object.values(outlines).map((ring) => svg("polygon",
      { points: points(ring), class: "outline", "stroke-width": 0.8 * unit })),
    ...sheets.map(({ name, state: is }, at) => {
      const group = svg("g", { class: `goes sheet-${is}` }, ...rings[at].map((ring) =>
        svg("polygon", { points: points(ring), "stroke-width": 1.6 * unit })),
      svg("title", {}, `${name}: ${word(`sheet.${is}`)}`));
      group.addEventListener("click", () => openSheet(name));
      return group;
    }));
}

/** How often lots are accepted, by their bad sheets. @param {Sample} sample */
function curve({ curve: points, lot, good_lot: good, bad_lot: poor }) {
  const most = Math.max(points.at(-1)?.[0] ?? 100, 1);
  const at = (/** @type {number[]} */ [share, often]) =>
    [(share / most) * WIDE, HIGH * (1 - often / 100)];
  const axis = (/** @type {number[]} */ from, /** @type {number[]} */ to) => svg("line",
    { x1: from[0], y1: from[1], x2: to[0], y2: to[1], class: "scale", "stroke-width": 1 });
  const words = (/** @type {string} */ said, /** @type {number} */ x, /** @type {number} */ y,
    anchor = "middle") => svg("text",
    { x, y, "font-size": 10, "text-anchor": anchor, class: "legend" }, said);
  const marks = [good, poor].flatMap(([, sheets, often], of) => {
    const [x, y] = at([Math.min((100 * sheets) / lot, most), often]);
    return [svg("circle", { cx: x, cy: y, r: 3.4, class: of ? "curve-bad" : "curve-good" }),
      words(`${number(often, 1)} %`, x + 6, of ? y - 5 : y + 12, "start")];
  });
  const step = STEPS.find((one) => most / one <= MOST_TICKS) ?? 100;
  const ticks = Array.from({ length: Math.floor(most / step) + 1 }, (_, count) =>
    words(written(count * step), (count * step / most) * WIDE, HIGH + 13));
  return svg("svg", { viewBox: `-34 -8 ${WIDE + 62} ${HIGH + 26}`, class: "map curve" },
    axis([0, HIGH], [WIDE, HIGH]), axis([0, 0], [0, HIGH]), ...ticks,
    ...[0, 50, 100].map((often) => words(`${often}`, -5, HIGH * (1 - often / 100) + 3, "end")),
    svg("polyline", { points: points.map((one) => at(one).join(",")).join(" "),
      class: "vector control curve", "stroke-width": 1.6 }), ...marks);
}
