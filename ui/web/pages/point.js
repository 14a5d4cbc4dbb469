// The numbers of the current point: figures old and new, why it is doubtful, its peaks, scans.
import {
  MARKED_SIGMA, all, between, byId, clamped, element, first, moment, number, numbers, renew,
  roleGlyph, shortName, shortPoint, shows, start, stateGlyph, tip, word,
} from "./words.js";
import { leftOut } from "./asked.js";
import { ellipseRadius } from "./expected.js";
import { ofOne } from "./queue.js";
import { send } from "./wire.js";

const UNCHECKED = 0.1; // design: less than a tenth of an error would show in the residual
/** @type {Partial<Record<State, string>>} */
const STATE_ACTS = { accepted: "accept", rejected: "reject", dubious: "dubious" };
const PARTS = ["figures", "off", "why", "trial", "doubts", "neighbours", "point-name"];
const TO_MEASURE = ["predicted", "proposed"];
/** What is decided about all marked rows at once. */
const VERDICTS = ["accept", "reject", "dubious", "invisible"];
const LINES = 2; // design: what fits in sight, the rest is folded
const LINE_PX = 20; // a reason that is higher takes both

const shown = {
  point: /** @type {Point | null} */ (null),
  /** How many rows are marked, to be decided together. */
  many: 0,
};

/** What decides tells how many rows it is about. @param {number} many rows that are marked */
export function showMany(many) {
  if (many === shown.many) return;
  shown.many = many;
  byId("acts").classList.toggle("many", many > 0);
  for (const act of VERDICTS) {
    const said = many ? word(`act.${act}.many`, { count: many }) : word(`act.${act}`);
    first(`#acts [data-act=${act}] > span`).textContent = said;
  }
  if (shown.point) showTrial(shown.point);
}

/** @param {Point | null} point */
export function showPoint(point) {
  shown.point = point;
  byId("nothing").hidden = point !== null;
  for (const name of PARTS) byId(name).replaceChildren();
  for (const button of all("#acts button")) {
    button.classList.remove("stands");
    button.toggleAttribute("disabled", !point);
  }
  showOthers(point);
  showPeaks(point);
  showHistory(point);
  if (!point) return;
  const { key: [name, photo], role, state } = point;
  const badge = { class: "badge", id: "state-badge", title: word(`state.${state}.long`) };
  byId("point-name").append(
    roleGlyph(role, 15), element("b", {}, name),
    element("span", { class: "scan", title: photo }, photo), span("", "stretch"),
    element("span", { class: "badge", title: word(`role.${role}.long`) }, word(`role.${role}`)),
    element("span", badge, stateGlyph(state, 13), word(`state.${state}`)));
  const act = STATE_ACTS[state];
  if (act) first(`#acts [data-act=${act}]`).classList.add("stands");
  showOff(point);
  showFigures(point.figures);
  showWhy(point);
  showTrial(point);
}

/**
 * Everything that was decided about the point, newest first; each can be turned round by itself.
 * @param {Point | null} point
 */
function showHistory(point) {
  const room = byId("history");
  if (shows(room, point && [point.key, point.history])) return;
  if (!point) return room.replaceChildren();
  const { key, history } = point;
  const lines = history.map(({ id, when, who, what, detail, stands, turns, by }) => {
    const title = [`${moment(when)} UTC`, ...by ? [word("history.by", { who: by })] : []]
      .join(" \u00b7 ");
    const turn = stands ? "history.back" : "history.again";
    const back = () => send({ kind: "back", decision: id, again: !stands });
    const button = { class: "small", title: word(`${turn}.tip`), onclick: back,
      "data-decision": id };
    return element("li", { class: stands ? "" : "withdrawn", title },
      span(when.slice(11, 16), "faint"), span(word(`did.${what}`), ""),
      element("span", { class: "faint" }, clamped(word(...detail))), span(who, "muted"),
      turns ? element("button", button, word(turn)) : null);
  });
  const title = history.length ? [element("h3", {}, word("history"))] : [];
  return renew(room, ...title, element("ul", {}, ...lines), ...saying(key, history));
}

/**
 * Words about the point, its photo, or one of the decisions.
 * @param {Key} key @param {HistoryItem[]} history
 */
function saying([point, photo], history) {
  if (start.guest) return [];
  const about = [["point", point], ["photo", photo],
    ...history.map(({ id }) => ["decision", `${id}`])];
  const options = about.map(([subject, name]) => element("option",
    { value: `${subject}/${name}` }, word(`remark.about.${subject}`,
      { name: subject === "photo" ? shortName(name) : name })));
  const choice = /** @type {HTMLSelectElement} */ (element("select",
    { id: "remark-subject", "aria-label": word("remark.subject") }, ...options));
  const field = /** @type {HTMLInputElement} */ (element("input", { id: "remark-words",
    maxlength: 2000, placeholder: word("remark"), "aria-label": word("remark.words"),
    title: word("remark.tip") }));
  const say = (/** @type {Event} */ event) => {
    event.preventDefault();
    const [subject, ...rest] = choice.value.split("/");
    const words = field.value.trim();
    if (!words) return;
    if (send({ kind: "remark", subject, name: rest.join("/"), words })) field.value = "";
  };
  return [element("form", { class: "acts fault-form", onsubmit: say }, choice, field,
    element("button", { type: "submit", id: "remark-say", class: "small" }, word("remark.say")))];
}

/** @param {Pair | null} pair */
const length = (pair) => (pair && pair[0] !== null ? Math.hypot(pair[0], pair[1]) : null);

/** @param {string} text @param {string} kind */
const span = (text, kind) => element("span", { class: kind }, text);

/** How far the measurement is off: metres, sigma, pixels. @param {Point} point */
function showOff({ draft, ellipse, figures: { ground, misfit, ratio }, role, scan, state }) {
  if (state === "predicted" && !draft && ellipse) {
    const pixels = ellipseRadius(ellipse);
    byId("off").title = tip("figure.expected") ?? "";
    byId("off").append(element("h3", {}, word("figure.expected")),
      element("div", { class: "large" }, span(`\u00b1${number(pixels * scan.pixel, 2)} m`, ""),
        element("small", {}, `${number(pixels, 1)} px`)));
    return;
  }
  const [metres, pixels] = [length(ground), length(misfit)];
  const far = ratio !== null && ratio > MARKED_SIGMA;
  byId("off").title = tip("figure.misfit") ?? "";
  byId("off").append(element("h3", {}, word("figure.misfit")),
    element("div", { class: pixels === null ? "" : "large" },
      metres === null ? null : span(`${number(metres, 2)} m`, ""),
      ratio === null ? null : span(`${number(ratio, 1)} \u03c3`, far ? "warned" : ""),
      pixels === null ? span(role === "new" ? word("misfit.unknown") : "\u2013", "")
        : element("small", {}, `${number(pixels, 2)} px`)));
}

/** @param {Figures} figures */
function showFigures(figures) {
  const { ground, residual, redundancy, surveyed, surveyed_sigma: sigma } = figures;
  const [now, then] = [length(figures.misfit), length(figures.misfit_before)];
  const misfit = /** @type {(string | Node)[]} */ ([`${number(now, 2)} px`]);
  if (then !== null && now !== null && Math.abs(then - now) > 0.005) {
    misfit.unshift(span(number(then, 2), "old"), span("\u2192", "arrow"));
  }
  if (figures.misfit) misfit.push(parted(figures.misfit, "", ""));
  const unchecked = redundancy !== null && redundancy < UNCHECKED;
  put("misfit", misfit);
  put("ground", !ground ? ["\u2013"]
    : [`${number(length(ground), 2)} m`, parted(ground, "E ", "N ")]);
  put("residual", !residual ? ["\u2013"]
    : [`${number(length(residual), 2)} px`, parted(residual, "", "")]);
  put("sigma", [`${number(figures.sigma, 2)} px`]);
  const { hand, score } = figures;
  put("score", [hand ? word("peak.hand") : number(score === null ? null : 100 * score, 0, "%")]);
  put("redundancy", [redundancy === null ? "\u2013"
    : span(number(redundancy, 2), unchecked ? "worse" : "")], unchecked ? word("unchecked") : "");
  put("place", [`${numbers(figures.place, 1)} px`]);
  put("surveyed", [`${numbers(surveyed, 1)} m`]);
  put("source", [word(`source.${figures.source}`),
    span(` \u00b1${number(sigma[0], 2)} \u00b1${number(sigma[2], 2)} m`, "faint")]);
}

/** @param {Pair} pair @param {string} one @param {string} other names of its two parts */
const parted = ([x, y], one, other) =>
  span(` (${one}${number(x, 2)}${between()}${other}${number(y, 2)})`, "faint");

/** @param {string} name @param {(string | Node)[]} content */
function put(name, content, warning = "") {
  const title = warning || tip(`figure.${name}`);
  byId("figures").append(element("div", { class: "figure", "data-figure": name, title },
    element("span", {}, word(`figure.${name}`)), element("span", {}, ...content)));
}

/** @param {Point} point */
function showWhy({ figures: { remark }, readings, state, why }) {
  const kind = state === "unused" || state === "rejected" ? state : "other";
  const lines = /** @type {[string, string][]} */ (
    why.map(([text, value]) => [word(text, { value }), ""]));
  if (TO_MEASURE.includes(state)) lines.push([word(`why.${state}`), "remark"]);
  if (readings.length === 2) {
    const [one, other] = readings.map(({ raw }) => raw);
    const value = number(Math.hypot(one[0] - other[0], one[1] - other[1]), 2);
    lines.unshift([word("readings", { value, one: readings[0].who, other: readings[1].who }),
      "remark"]);
  }
  const told = /** @type {[string, string]} */ ([word(`remark.${kind}`, { remark }), "remark"]);
  if (remark && kind === "other") lines.push(told);
  else if (remark) lines.unshift(told);
  if (!lines.length) lines.push([word("why.not"), "fine"]);
  const items = lines.map(([line, look]) => element("li", { class: look, title: line }, line));
  byId("why").title = lines.map(([line]) => line).join("\n");
  const head = element("h3", {}, word(TO_MEASURE.includes(state) ? "why.measure" : "why"));
  const list = element("ul", {}, items[0]);
  byId("why").append(head, list);
  const fitting = items[0].offsetHeight > LINE_PX ? 1 : LINES;
  list.append(...items.slice(1, fitting));
  const more = items.slice(fitting);
  if (!more.length) return;
  head.append(span(` \u00b7 ${word("why.more", { count: more.length })}`, ""));
  byId("doubts").append(element("h3", {}, word("why")), element("ul", {}, ...more));
}

/**
 * Filled in a moment after the rest: an adjustment with this one measurement turned.
 * @param {Point} point
 */
function showTrial({ draft, figures, idle, key, others, role, state, trial }) {
  byId("neighbours").replaceChildren();
  if (shown.many) return showEffect("trial.effect", [word("trial.many")]);
  if (role === "new") return showCoordinates(figures, others);
  const lines = [];
  const title = draft ? "trial.draft" : !trial || state === "predicted" ? "trial.effect"
    : trial.rejects ? "trial.reject" : "trial.accept";
  if (role === "check") lines.push(word("trial.check"));
  else if (idle) lines.push(word("trial.idle", { photo: shortName(key[1]) }));
  else if (state === "predicted" && !draft) lines.push(word("trial.measure"));
  else if (!trial) lines.push(word("trial.wait"));
  else {
    const [now, sigma] = [number(trial.now, 3), number(trial.sigma, 3)];
    const values = { now, sigma, shift: number(trial.shift, 2), photo: shortName(trial.photo) };
    lines.push(word("trial.sigma", values), word("trial.shift", values));
    // Of a draft the question above the buttons says it.
    if (!draft) lines.push(...leftOut(trial));
  }
  showEffect(title, lines);
  const beside = (trial?.neighbours ?? []).map(([name, , now, then]) => {
    const kind = then > now + 0.02 ? "worse" : then < now - 0.02 ? "better" : "muted";
    return element("div", { class: "figure neighbour" }, span(shortPoint(name), ""),
      span(`${number(now, 2)} \u2192 ${number(then, 2)} px`, kind));
  });
  if (!beside.length) return;
  byId("neighbours").replaceChildren(element("h3", {}, word("trial.neighbours")), ...beside);
}

/** @param {string} title @param {string[]} lines */
const showEffect = (title, lines) => byId("trial").replaceChildren(
  element("h3", {}, word(title)),
  ...lines.map((line) => element("div", { class: "figure", title: line }, line)));

/**
 * What the adjustment makes of a new point; from one scan alone its ray is known.
 * @param {Figures} figures @param {Point["others"]} others
 */
function showCoordinates({ surveyed, surveyed_sigma: sigma }, others) {
  const count = others.filter(({ state: known }) => known === "accepted").length;
  const lines = count < 2 ? [word("coordinates.wait", { count })]
    : ["E", "N", "H"].map((axis, n) =>
      `${axis} ${number(surveyed[n], 2)} \u00b1${number(sigma[n], 2)} m`);
  showEffect("coordinates", lines);
}

/** @param {Point | null} point */
function showPeaks(point) {
  const room = byId("peaks");
  if (shows(room, point && [point.key, point.peaks])) return;
  if (!point?.peaks.length) return room.replaceChildren();
  const { key, peaks } = point;
  const lines = peaks.map(({ away, operator, score }, index) => {
    const here = away < 0.05;
    const place = here ? word("mark.measured")
      : word("peak.away", { distance: number(away, 1) });
    const title = `${operator} \u00b7 ${word("peak.tip")}`;
    const choose = ofOne(() => send({ kind: "peak", key, index }));
    return element("button",
      { class: `peak${here ? " on" : ""}`, "aria-pressed": `${here}`, title, onclick: choose,
        "data-peak": index },
      element("span", {}, `${index + 1}`),
      element("b", {}, operator === "operator" ? word("peak.hand") : number(score, 1)),
      element("span", {}, place));
  });
  return renew(room, element("h3", {}, word("peaks")), ...lines);
}

/** @param {Point | null} point */
function showOthers(point) {
  const strip = byId("others");
  // Who measures goes from scan to scan; who judges unfolds them.
  strip.classList.toggle("always", Boolean(point?.ellipse));
  if (shows(strip, point && [point.key, point.others, point.marks.surveyed])) return;
  if (!point) return strip.replaceChildren();
  const { key: [name, current], marks: { surveyed } } = point;
  const pixel = Math.max(start.ortho_pixel, point.scan.pixel) * 0.8;
  const scans = point.others.map(({ at, hidden, misfit, photo, score, state, version }) => {
    const here = photo === current;
    const [east, north] = at ?? surveyed;
    const place = `${east}/${north}/${pixel.toFixed(4)}?e=${start.edition}`;
    const said = hidden ? word("other.hidden") : word(`state.${state}.long`);
    const figure = state === "proposed" ? number(score && 100 * score, 0, "%")
      : state === "predicted" || hidden ? "" : number(misfit, 2, "px");
    const src = `/tiles/point/${encodeURIComponent(photo)}/${version}/${place}`;
    const select = () => send({ kind: "select", key: [name, photo] });
    const button = element("button",
      {
        class: `other ${state}${here ? " on" : ""}${hidden ? " unseen" : ""}`,
        "aria-pressed": `${here}`, title: `${photo} \u00b7 ${said}`, onclick: select,
        "data-photo": photo,
      },
      element("img", { src, alt: "", draggable: "false" }),
      element("span", {}, stateGlyph(state, 11), element("em", {}, shortName(photo)),
        figure));
    if (here) queueMicrotask(() => {
      strip.scrollLeft = Math.max(0, button.offsetLeft - strip.clientWidth / 2);
    });
    return button;
  });
  return renew(strip, ...scans);
}
