// The numbers of the current point: figures old and new, why it is doubtful, its peaks, other scans.
import { byId, element, number, roleGlyph, shortName, shortPoint, start, stateGlyph, word } from "/pages/words.js";

let send = () => {};
export function setUpPoint(sender) { send = sender; }

export function showPoint(point) {
  byId("nothing").hidden = point !== null;
  for (const name of ["figures", "why", "trial", "peaks", "point-name", "history"]) byId(name).replaceChildren();
  for (const button of document.querySelectorAll("#acts button")) button.classList.remove("stands");
  if (!point) { showOthers(null); return; }
  const [name, photo] = point.key;
  byId("point-name").append(
    roleGlyph(point.role, 15), element("b", {}, name), element("span", { class: "scan", title: photo }, photo), element("span", { class: "stretch" }),
    element("span", { class: "badge", title: word(`role.${point.role}.long`) }, word(`role.${point.role}`)),
    element("span", { class: "badge", id: "state-badge", title: word(`state.${point.state}.long`) }, stateGlyph(point.state, 13), word(`state.${point.state}`)),
  );
  const act = { accepted: "accept", rejected: "reject", dubious: "dubious" }[point.state];
  if (act) document.querySelector(`#acts [data-act=${act}]`).classList.add("stands");
  showFigures(point.figures);
  showWhy(point);
  showTrial(point);
  showPeaks(point);
  showHistory(point);
  showOthers(point);
}

// Everything that was decided about the point, newest first; each can be turned round by itself.
function showHistory(point) {
  if (!point.history.length) return;
  const lines = point.history.map((item) => element("li", { class: item.stands ? "" : "withdrawn", title: `${item.when}${item.by ? ` \u00b7 ${word("history.by", { who: item.by })}` : ""}` },
    span(item.when.slice(11, 16), "faint"), span(word(`did.${item.what}`), ""), span(item.detail, "faint"), span(item.who, "muted"),
    element("button", { class: "small", title: word(item.stands ? "history.back.tip" : "history.again.tip"), onclick: () => send({ kind: "back", decision: item.id }) }, word(item.stands ? "history.back" : "history.again"))));
  byId("history").append(element("h3", {}, word("history")), element("ul", {}, ...lines));
}

const length = (pair) => (pair && pair[0] !== null ? Math.hypot(pair[0], pair[1]) : null);
const span = (text, kind) => element("span", { class: kind }, text);

function showFigures(figures) {
  const now = length(figures.misfit);
  const then = length(figures.misfit_before);
  const misfit = [`${number(now, 2)} px`];
  if (then !== null && now !== null && Math.abs(then - now) > 0.005) {
    misfit.unshift(span(number(then, 2), "old"), span("\u2192", "arrow"));
  }
  if (figures.misfit) misfit.push(span(` (${number(figures.misfit[0], 2)}, ${number(figures.misfit[1], 2)})`, "faint"));
  const residual = figures.residual ? [`${number(length(figures.residual), 2)} px`, span(` (${number(figures.residual[0], 2)}, ${number(figures.residual[1], 2)})`, "faint")] : ["\u2013"];
  const ground = figures.ground ? [`${number(length(figures.ground), 2)} m`, span(` (E ${number(figures.ground[0], 2)}, N ${number(figures.ground[1], 2)})`, "faint")] : ["\u2013"];
  const redundancy = figures.redundancy === null ? ["\u2013"] : [span(number(figures.redundancy, 2), figures.redundancy < 0.1 ? "worse" : "")];
  const sigma = figures.surveyed_sigma;
  put("misfit", misfit);
  put("ground", ground);
  put("residual", residual);
  put("sigma", [`${number(figures.sigma, 2)} px`]);
  put("score", [number(figures.score, 2)]);
  put("redundancy", redundancy, figures.redundancy !== null && figures.redundancy < 0.1 ? word("unchecked") : "");
  put("place", [`${number(figures.place[0], 1)}, ${number(figures.place[1], 1)} px`]);
  put("surveyed", [`${number(figures.surveyed[0], 1)}  ${number(figures.surveyed[1], 1)}  ${number(figures.surveyed[2], 1)} m`]);
  put("source", [word(`source.${figures.source}`), span(` \u00b1${number(sigma[0], 2)} \u00b1${number(sigma[2], 2)} m`, "faint")]);
}

function put(name, content, tip = "") {
  byId("figures").append(element("div", { class: "figure", "data-figure": name, title: tip || (start.words[`figure.${name}.tip`] ?? null) }, element("span", {}, word(`figure.${name}`)), element("span", {}, ...content)));
}

function showWhy(point) {
  const list = element("ul");
  const { remark } = point.figures;
  if (remark) list.append(element("li", { class: "remark" }, word(`remark.${["unused", "rejected"].includes(point.state) ? point.state : "other"}`, { remark })));
  for (const [text, value] of point.why) list.append(element("li", {}, word(text, { value })));
  if (!point.why.length && !remark) list.append(element("li", { class: "fine" }, word("why.not")));
  byId("why").append(element("h3", {}, word("why")), list);
}

// Filled in a moment after the rest: an adjustment with this one measurement turned.
function showTrial(point) {
  const { trial } = point;
  const lines = [];
  if (point.role === "check") lines.push(word("trial.check"));
  else if (!trial) lines.push(word("trial.wait"));
  else {
    const values = { now: number(trial.now, 3), sigma: number(trial.sigma, 3), shift: number(trial.shift, 2), photo: shortName(trial.photo) };
    lines.push(word(trial.rejects ? "trial.reject" : "trial.accept", values), word("trial.shift", values));
  }
  const beside = (trial?.neighbours ?? []).map(([name, , now, then]) => element("div", { class: "figure neighbour" },
    span(shortPoint(name), ""), span(`${number(now, 2)} \u2192 ${number(then, 2)} px`, then > now + 0.02 ? "worse" : then < now - 0.02 ? "better" : "faint")));
  if (beside.length) beside.unshift(element("div", { class: "figure faint" }, word("trial.neighbours")));
  byId("trial").replaceChildren(element("h3", {}, word("trial")), ...lines.map((line) => element("div", { class: "figure" }, line)), ...beside);
}

function showPeaks(point) {
  if (!point.peaks.length) return;
  byId("peaks").append(element("h3", {}, word("peaks")));
  point.peaks.forEach((peak, index) => {
    const here = peak.away < 0.05;
    byId("peaks").append(element("button", { class: `peak${here ? " on" : ""}`, title: `${peak.operator} \u00b7 ${word("peak.tip")}`, onclick: () => send({ kind: "peak", key: point.key, index }) },
      element("span", {}, `${index + 1}`), element("b", {}, peak.operator === "operator" ? word("peak.hand") : number(peak.score, 1)),
      element("span", {}, here ? word("mark.measured") : word("peak.away", { distance: number(peak.away, 1) }))));
  });
}

function showOthers(point) {
  const strip = byId("others");
  const shape = JSON.stringify(point && [point.key, point.others, point.marks.surveyed]);
  if (strip.dataset.shape === shape) return;
  strip.dataset.shape = shape;
  strip.replaceChildren();
  if (!point) return;
  const [east, north] = point.marks.surveyed;
  const pixel = Math.max(start.ortho_pixel, point.scan.pixel) * 0.8;
  for (const other of point.others) {
    const address = `/tiles/point/${encodeURIComponent(other.photo)}/${other.version}/${east}/${north}/${pixel.toFixed(4)}?e=${start.edition}`;
    const button = element("button", { class: `other${other.photo === point.key[1] ? " on" : ""}`, title: other.photo, onclick: () => send({ kind: "select", key: [point.key[0], other.photo] }) },
      element("img", { src: address, alt: "", draggable: "false" }),
      element("span", {}, stateGlyph(other.state, 11), element("em", {}, shortName(other.photo)), number(other.misfit, 1)));
    strip.append(button);
    if (other.photo === point.key[1]) queueMicrotask(() => { strip.scrollLeft = Math.max(0, button.offsetLeft - strip.clientWidth / 2); });
  }
}
