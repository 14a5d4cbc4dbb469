// The placing page: the same places clicked in one photo and in the ortho, saved beside the scan.
import { byId, element, learnNames, number, shortName, start, word } from "/pages/words.js";
import { canvas, crosshair, halo, measuredMark, text } from "/pages/marks.js";
import { drawLayer, onTile, orthoLayer, rawLayer } from "/pages/tiles.js";
import { listen } from "/pages/pointing.js";
import { nextTheme, setUpTheme } from "/pages/theme.js";

const COLOUR = "#56b4e9";
const panes = {};
let scans = [];
let scan = null;
let views = {};
let pending = {}; // {scan: [column, row]} or {ortho: [east, north]}: half of the next pair
let fit = {};
let cursor = null; // {pane, at}
let last = null; // what an arrow moves: {index, pane}
let wallis = false;
let saved = "";
let run = { state: "idle" };
let told = "";
let history = [];
let asked = false;

const answerOf = async (answer) => ({ ok: answer.ok, ...(answer.headers.get("content-type")?.includes("json") ? await answer.json() : { error: await answer.text() }) });
const post = async (address, body = {}) => answerOf(await fetch(address, { method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json" } }));

// Layer coordinates: pixels of the scan; metres east and south of the lattice's corner.
const toLayer = (name, [a, b]) => (name === "scan" ? [a, b] : [a - start.lattice.west, start.lattice.north - b]);
const fromLayer = (name, [x, y]) => (name === "scan" ? [x, y] : [start.lattice.west + x, start.lattice.north - y]);
const sizeOf = (name) => [panes[name].room.clientWidth, panes[name].room.clientHeight];

function toScreen(name, place) {
  const [x, y] = toLayer(name, place);
  const [width, height] = sizeOf(name);
  return [(x - views[name].x) * views[name].scale + width / 2, (y - views[name].y) * views[name].scale + height / 2];
}

function fromScreen(name, x, y) {
  const [width, height] = sizeOf(name);
  return fromLayer(name, [views[name].x + (x - width / 2) / views[name].scale, views[name].y + (y - height / 2) / views[name].scale]);
}

// What the pairs so far say of the other picture.
const mapped = ([column, row]) => fit.matrix && [0, 1].map((i) => fit.matrix[i][0] * column + fit.matrix[i][1] * row + fit.matrix[i][2]);
function unmapped([east, north]) {
  if (!fit.matrix) return null;
  const [[a, b, e0], [c, d, n0]] = fit.matrix;
  const whole = a * d - b * c;
  return [(d * (east - e0) - b * (north - n0)) / whole, (a * (north - n0) - c * (east - e0)) / whole];
}

function choose(name) {
  scan = scans.find((one) => one.photo === name);
  pending = {};
  fit = {};
  last = null;
  history = [];
  saved = scan.pairs.length ? word("placing.was") : "";
  const [width, height] = sizeOf("scan");
  views.scan = { x: scan.size[0] / 2, y: scan.size[1] / 2, scale: Math.min(width / scan.size[0], height / scan.size[1]) * 0.97 };
  const known = scan.known;
  const extent = (2 ** (start.lattice.levels - 1)) * start.lattice.pixel * 512;
  if (known) { const [x, y] = toLayer("ortho", [known.east, known.north]); views.ortho = { x, y, scale: views.scan.scale / known.pixel / 1.5 }; }
  else if (!views.ortho) views.ortho = { x: extent / 2, y: extent / 2, scale: Math.min(...sizeOf("ortho")) / extent };
  judge();
  show();
}

async function judge() {
  const name = scan.photo;
  const found = await post(`/fit/${encodeURIComponent(name)}`, { pairs: scan.pairs });
  if (name === scan.photo) { fit = found; show(); }
}

function remember() { history.push(JSON.stringify(scan.pairs)); saved = ""; }

function put(name, place) {
  if (start.guest) return tell(word("notice.guest"));
  pending[name] = place;
  if (pending.scan && pending.ortho) {
    remember();
    scan.pairs.push([...pending.scan, ...pending.ortho]);
    last = { index: scan.pairs.length - 1, pane: name };
    pending = {};
    judge();
  }
  show();
}

function takeBack() {
  if (pending.scan || pending.ortho) pending = {};
  else if (history.length) { scan.pairs = JSON.parse(history.pop()); last = null; saved = ""; judge(); }
  show();
}

function remove(index) { remember(); scan.pairs.splice(index, 1); last = null; judge(); show(); }

function move(index, name, place) {
  scan.pairs[index].splice(name === "scan" ? 0 : 2, 2, ...place);
  last = { index, pane: name };
  redraw();
}

function nudge(right, down) {
  if (!last || start.guest) return;
  if (!nudge.later) remember();
  clearTimeout(nudge.later);
  const from = toLayer(last.pane, pairPlace(scan.pairs[last.index], last.pane));
  const unit = last.pane === "scan" ? 1 : start.ortho_pixel;
  move(last.index, last.pane, fromLayer(last.pane, [from[0] + right * unit, from[1] + down * unit]));
  nudge.later = setTimeout(() => { nudge.later = 0; judge(); }, 400);
}

const pairPlace = (pair, name) => (name === "scan" ? pair.slice(0, 2) : pair.slice(2));

async function save() {
  if (start.guest) return;
  const answer = await post(`/points/${encodeURIComponent(scan.photo)}`, { pairs: scan.pairs });
  if (!answer.ok) return tell(answer.error, true);
  saved = answer.saved ? word("placing.saved", { file: answer.saved }) : word("placing.removed");
  tell(saved);
  show();
}

// One hand for both panes: a click sets half a pair, a mark is dragged, the wheel zooms.
let grip = null;
const HAND = {
  ready: () => scan !== null,
  grips: (pane, x, y) => {
    grip = null;
    if (start.guest) return false;
    scan.pairs.forEach((pair, index) => { const [px, py] = toScreen(pane.name, pairPlace(pair, pane.name)); if (Math.hypot(px - x, py - y) < 12) grip = { index, pane: pane.name }; });
    return grip !== null;
  },
  at: (pane, x, y) => ({ pane: pane.name, at: fromScreen(pane.name, x, y), screen: [x, y] }),
  drag: (at) => { if (at && grip) { if (!grip.moved) { remember(); grip.moved = true; } move(grip.index, grip.pane, at.at); } },
  drop: () => { judge(); },
  pan: (from, to) => { const view = views[to.pane]; view.x -= (to.screen[0] - from.screen[0]) / view.scale; view.y -= (to.screen[1] - from.screen[1]) / view.scale; redraw(); },
  point: (at) => { cursor = at; redraw(); },
  click: (pane, x, y) => put(pane.name, fromScreen(pane.name, x, y)),
  zoom: (pane, x, y, factor) => {
    const view = views[pane.name];
    const [width, height] = sizeOf(pane.name);
    const scale = Math.min(Math.max(view.scale * factor, 0.001), 40 / (pane.name === "scan" ? 1 : start.ortho_pixel));
    const [dx, dy] = [(x - width / 2) / view.scale, (y - height / 2) / view.scale];
    const share = 1 - view.scale / scale;
    Object.assign(view, { x: view.x + dx * share, y: view.y + dy * share, scale });
    redraw();
  },
};

function redraw() {
  if (asked || !scan) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; draw(); });
}

function draw() {
  for (const [name, pane] of Object.entries(panes)) {
    const [context, width, height] = canvas(pane.picture);
    const view = views[name];
    const layer = name === "scan" ? rawLayer(scan.photo, scan.version, scan.size, wallis) : orthoLayer(wallis);
    drawLayer(context, layer, { x: view.x - width / 2 / view.scale, y: view.y - height / 2 / view.scale, scale: view.scale }, width, height);
    const [over] = canvas(pane.marks);
    scan.pairs.forEach((pair, index) => numbered(over, toScreen(name, pairPlace(pair, name)), index + 1, last?.index === index ? "#ffffff" : COLOUR));
    if (pending[name]) numbered(over, toScreen(name, pending[name]), scan.pairs.length + 1, start.palette.peak);
    guide(over, name, width, height);
    pane.label.textContent = name === "scan" ? word("pane.raw", { scan: shortName(scan.photo) }) : word("pane.ortho");
    pane.where.textContent = cursor?.pane === name ? cursor.at.map((value) => number(value, 1)).join("  ") : "";
    pane.room.classList.toggle("wanted", Boolean(pending.scan || pending.ortho) && !pending[name]);
  }
}

function numbered(context, place, count, colour) {
  measuredMark(context, place, colour);
  context.font = "bold 12px sans-serif";
  text(context, `${count}`, place[0] + 9, place[1] - 9, colour);
}

// Where the pairs so far put what the other picture's cursor, or half a pair, points at.
function guide(context, name, width, height) {
  const other = name === "scan" ? "ortho" : "scan";
  const across = name === "scan" ? unmapped : mapped;
  if (cursor?.pane === name) crosshair(context, toScreen(name, cursor.at), width, height);
  const from = pending[other] ?? (cursor?.pane === other ? cursor.at : null);
  const place = from && across(from);
  if (!place) return;
  const [x, y] = toScreen(name, place);
  context.setLineDash([4, 3]);
  halo(context, start.palette.predicted, 1.6, () => context.arc(x, y, 12, 0, 7));
  context.setLineDash([]);
}

function show() {
  if (!scan) return;
  showScans();
  showPairs();
  showRun();
  redraw();
}

function showScans() {
  const lines = scans.map((one) => element("button", { class: `scan${one === scan ? " on" : ""}`, "data-scan": one.photo, title: one.photo, onclick: () => choose(one.photo) }, element("span", {}, shortName(one.photo)), element("span", { class: "muted" }, one.pairs.length ? word("placing.pairs.count", { count: one.pairs.length }) : one.known ? "" : word("placing.unknown"))));
  byId("placing-scans").replaceChildren(element("h3", {}, word("placing.scans")), element("div", { class: "scans" }, ...lines));
}

function showPairs() {
  const lines = scan.pairs.map((pair, index) => {
    const off = fit.residuals?.[index];
    return element("tr", {}, element("td", {}, `${index + 1}`), element("td", {}, `${number(pair[0], 1)}, ${number(pair[1], 1)}`), element("td", {}, `${number(pair[2], 1)}, ${number(pair[3], 1)}`),
      element("td", { class: "off" }, off ? number(Math.hypot(...off), 1, "m") : "\u2013"), element("td", {}, element("button", { class: "small", disabled: start.guest, title: word("placing.remove"), onclick: () => remove(index) }, "\u00d7")));
  });
  const next = pending.scan ? "placing.now.ortho" : pending.ortho ? "placing.now.scan" : scan.pairs.length < 2 ? "placing.now.click" : scan.pairs.length < 3 ? "placing.now.enough" : "placing.now.many";
  const figures = fit.matrix ? [element("p", {}, word("placing.figures", { scale: number(fit.scale, 0), pixel: number(fit.pixel_m, 2), turn: number(fit.turn_deg, 0) }))] : [];
  if (fit.rms !== null && fit.rms !== undefined) figures.push(element("p", {}, word("placing.rms", { rms: number(fit.rms, 1), count: fit.count })));
  else if (scan.pairs.length === 2) figures.push(element("p", { class: "muted" }, word("placing.two")));
  byId("placing-pairs").replaceChildren(element("h3", {}, word("placing.pairs", { scan: shortName(scan.photo) })), element("p", { class: "next" }, word(next)),
    element("table", {}, ...(lines.length ? [element("tr", {}, ...["", "placing.pixel", "placing.ground", "placing.residual", ""].map((name) => element("th", {}, name ? word(name) : "")))] : []), ...lines), ...figures,
    ...(scan.why ? [element("p", { class: "doubted" }, scan.why)] : []), ...(fit.why ? [element("p", { class: "doubted" }, fit.why)] : []),
    element("div", { class: "acts" }, element("button", { id: "placing-save", class: scan.pairs.length > 1 && !saved ? "on" : "", disabled: start.guest || scan.pairs.length === 1, onclick: save }, word("placing.save"), element("kbd", {}, "S")),
      element("button", { disabled: start.guest, onclick: takeBack }, word("act.undo"), element("kbd", {}, "U")), element("button", { class: wallis ? "on" : "", title: word("wallis.tip"), onclick: () => { wallis = !wallis; show(); } }, word("wallis"), element("kbd", {}, "W")), element("button", { onclick: () => choose(scan.photo) }, word("act.fit"), element("kbd", {}, "F"))),
    element("p", { class: "muted" }, saved || word("placing.hint")));
}

function showRun() {
  const ready = scans.some((one) => one.pairs.length > 1);
  const busy = run.state === "running";
  const bar = element("i");
  bar.style.width = `${100 * (run.share ?? 0)}%`;
  const lines = busy ? [element("p", {}, word("placing.stage", { place: run.place ?? 1, stages: run.stages ?? "", title: run.title ?? "" })), element("span", { class: "share" }, bar), element("p", { class: "muted" }, `${run.what ?? ""}`)]
    : run.state === "failed" ? [element("p", { class: "doubted" }, run.why)] : run.state === "cancelled" ? [element("p", {}, word("placing.cancelled"))] : run.state === "done" ? [element("p", {}, word("placing.done"))] : [];
  byId("placing-run").replaceChildren(element("h3", {}, word("placing.run.title")), ...lines,
    element("div", { class: "acts" }, busy ? element("button", { disabled: start.guest, onclick: async () => { run = await post("/run/cancel"); } }, word("remake.cancel")) : element("button", { id: "placing-start", disabled: start.guest || run.state === "done", class: ready && saved ? "on" : "", onclick: begin }, word("placing.run"))),
    element("p", { class: "muted" }, word("placing.run.hint", { command: start.command })));
}

async function begin() {
  run = await post("/run");
  if (run.ok === false) tell(run.error, true);
  showRun();
  watch();
}

// The desk takes this page's place once the run has gone through.
async function watch() {
  clearTimeout(watch.later);
  try {
    run = await (await fetch("/run")).json();
    if (JSON.stringify(run) !== told) { told = JSON.stringify(run); showRun(); }
  } catch {
    const answer = await fetch("/start").catch(() => null);
    const edition = answer?.ok ? (await answer.json()).edition : start.edition;
    if (edition !== start.edition) return location.reload();
  }
  watch.later = setTimeout(watch, run.state === "running" || run.state === "done" ? 700 : 4000);
}

function tell(words, grave = false) {
  const box = element("div", { class: `notice${grave ? " grave" : ""}`, onclick: () => box.remove() }, words);
  byId("notices").append(box);
  setTimeout(() => box.remove(), grave ? 30000 : 3500);
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
function key(event) {
  if (event.ctrlKey || event.altKey || event.metaKey || !scan) return;
  const step = (by) => choose(scans[Math.min(Math.max(scans.indexOf(scan) + by, 0), scans.length - 1)].photo);
  const acts = { s: save, u: takeBack, w: () => { wallis = !wallis; show(); }, f: () => choose(scan.photo), j: () => step(1), k: () => step(-1), Escape: () => { pending = {}; show(); }, Delete: () => last && remove(last.index) };
  const arrow = ARROWS[event.key];
  const act = arrow ? () => nudge(...arrow.map((value) => value * (event.shiftKey ? 10 : 1))) : acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!act) return;
  event.preventDefault();
  act();
}

async function open() {
  Object.assign(start, await (await fetch("/start")).json());
  scans = start.scans;
  learnNames(scans.map((one) => one.photo));
  document.title = `${start.name} \u00b7 ${word("placing")}`;
  byId("name").textContent = `${start.name} \u00b7 ${word("placing")}`;
  byId("placing-why").textContent = word("placing.why");
  for (const name of ["scan", "ortho"]) {
    const room = document.querySelector(`.pane[data-pane=${name}]`);
    panes[name] = { name, room, picture: room.querySelector(".picture"), marks: room.querySelector(".marks"), label: room.querySelector(".label"), where: room.querySelector(".where") };
    listen(panes[name], HAND);
    new ResizeObserver(redraw).observe(room);
  }
  onTile(redraw);
  setUpTheme();
  document.querySelector("[data-act=theme]").addEventListener("click", nextTheme);
  window.addEventListener("keydown", key);
  choose((scans.find((one) => one.pairs.length) ?? scans[0]).photo);
  window.gruber = { place: () => ({ scan, fit, views, pending, run, saved }), toScreen };
  watch();
}

open().catch((error) => { document.body.textContent = String(error); });
