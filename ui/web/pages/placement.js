// Placement on the map: footprints by the given georeference and as placed, over the reference ortho.
import { byId, element, number, shortName, start, word } from "/pages/words.js";
import { canvas, halo, text } from "/pages/marks.js";
import { drawLayer, onTile, orthoLayer } from "/pages/tiles.js";
import { listen } from "/pages/pointing.js";

const BEFORE = "#f3b13c";
const AFTER = "#56b4e9";
let send = () => {};
let found = null;
let current = "";
let mode = "both";
let view = null; // {x, y: middle, metres east and south of the lattice's corner; scale: css pixels a metre}
let room = null;
let asked = false;

export function setUpPlacement(sender) {
  send = sender;
  byId("placement").addEventListener("close", () => { room = null; send({ kind: "sheet", sheet: "placement", shown: false }); });
}

export function openPlacement(known) {
  const sheet = byId("placement");
  if (sheet.open) { sheet.close(); return; }
  sheet.querySelector(".view-body").replaceChildren(element("p", { class: "muted" }, word("quality.wait")));
  sheet.showModal();
  found = null;
  if (known) showPlacement(known);
  send({ kind: "sheet", sheet: "placement", shown: true });
}

export function showPlacement(fresh) {
  const sheet = byId("placement");
  if (!sheet.open) return;
  const first = !found;
  found = fresh;
  const kept = sheet.querySelector(".shifts")?.scrollTop ?? 0;
  if (!found.photos.some((one) => one.photo === current)) current = found.photos[0]?.photo ?? "";
  const body = sheet.querySelector(".view-body");
  room = body.querySelector(".map-room") ?? freshRoom();
  body.replaceChildren(head(), element("div", { class: "two-rooms placement" }, room, side()));
  sheet.querySelector(".shifts").scrollTop = kept;
  if (first) fit();
  redraw();
}

function freshRoom() {
  const made = element("div", { class: "map-room pane" }, element("canvas", { class: "picture" }), element("canvas", { class: "marks" }), element("span", { class: "where" }));
  listen({ room: made }, {
    ready: () => view !== null, grips: () => false, drag: () => {}, drop: () => {},
    at: (_, x, y) => ({ screen: [x, y] }),
    pan: (from, to) => { view.x -= (to.screen[0] - from.screen[0]) / view.scale; view.y -= (to.screen[1] - from.screen[1]) / view.scale; redraw(); },
    point: (at) => { room.querySelector(".where").textContent = at ? place(at.screen) : ""; },
    click: (_, x, y) => pick(x, y),
    zoom: (_, x, y, factor) => zoom(factor, x, y),
  });
  new ResizeObserver(redraw).observe(made);
  onTile(redraw);
  return made;
}

const toScreen = ([east, north]) => [(east - start.lattice.west - view.x) * view.scale + room.clientWidth / 2, (start.lattice.north - north - view.y) * view.scale + room.clientHeight / 2];
function place([x, y]) {
  const east = start.lattice.west + view.x + (x - room.clientWidth / 2) / view.scale;
  const north = start.lattice.north - view.y - (y - room.clientHeight / 2) / view.scale;
  return `${number(east, 0)}  ${number(north, 0)}`;
}

function zoom(factor, x = room.clientWidth / 2, y = room.clientHeight / 2) {
  const scale = Math.min(Math.max(view.scale * factor, 0.001), 20 / start.ortho_pixel);
  const share = 1 - view.scale / scale;
  view = { x: view.x + ((x - room.clientWidth / 2) / view.scale) * share, y: view.y + ((y - room.clientHeight / 2) / view.scale) * share, scale };
  redraw();
}

function fit() {
  const points = found.photos.flatMap((one) => [...(one.before ?? []), ...(one.after ?? [])]);
  if (!points.length) return;
  const [west, east] = [Math.min(...points.map((p) => p[0])), Math.max(...points.map((p) => p[0]))];
  const [south, north] = [Math.min(...points.map((p) => p[1])), Math.max(...points.map((p) => p[1]))];
  const scale = 0.92 * Math.min((room.clientWidth || 900) / (east - west), (room.clientHeight || 700) / (north - south));
  view = { x: (west + east) / 2 - start.lattice.west, y: start.lattice.north - (south + north) / 2, scale };
  redraw();
}

const middleOf = (ring) => [0, 1].map((axis) => ring.reduce((sum, corner) => sum + corner[axis], 0) / ring.length);

function head() {
  const modes = ["both", "before", "after"].map((name) => element("button", { class: mode === name ? "on" : "", "data-mode": name, onclick: () => { mode = name; showPlacement(found); } }, word(`placement.${name}`)));
  const words = found.median === null ? word(found.photos.some((one) => one.oriented) ? "placement.none-given" : "placement.nothing") : word("placement.summary", { median: number(found.median, 0), worst: number(found.worst, 0) });
  return element("header", {}, element("h2", {}, word("placement")), element("span", { class: "segments" }, ...modes), element("span", { class: "muted" }, words), element("span", { class: "stretch" }),
    element("span", { class: "legend-line before" }, word("placement.given")), element("span", { class: "legend-line after" }, word("placement.placed")),
    element("button", { onclick: fit }, word("act.fit")), element("button", { id: "placement-close", onclick: () => byId("placement").close() }, word("act.refuse")));
}

function side() {
  const lines = found.photos.map((one) => element("tr", { class: one.photo === current ? "on" : one.oriented ? "" : "loose", "data-photo": one.photo, onclick: () => choose(one.photo) }, element("td", { class: "name", title: one.photo }, shortName(one.photo)),
    ...(one.oriented ? [element("td", {}, number(one.shift?.[0], 1)), element("td", {}, number(one.shift?.[1], 1)), element("td", {}, number(one.turn, 1)), element("td", {}, number(one.scale, 3)), element("td", { class: "rms" }, number(one.rms, 1))] : [element("td", { colspan: 5, class: "none" }, word("placement.none"))])));
  const heads = ["photo", "east", "north", "turn", "scale", "rms"].map((name) => element("th", { title: start.words[`placement.${name}.tip`] ?? null }, word(`placement.${name}`)));
  const one = found.photos.find((photo) => photo.photo === current);
  const about = one ? [element("h3", {}, shortName(one.photo)), element("p", {}, one.source ? word("placement.source", { source: word(`placement.source.${one.source}`) }) : ""), ...one.why.map((why) => element("p", { class: "doubted" }, why))] : [];
  const aside = found.set_aside.length ? [element("h3", {}, word("placement.aside")), ...found.set_aside.map(([name, why]) => element("p", { class: "doubted" }, element("b", {}, shortName(name)), ` ${why}`))] : [];
  return element("aside", {}, element("div", { class: "shifts" }, element("table", {}, element("tr", {}, ...heads), ...lines)), ...about, ...aside, element("p", { class: "muted" }, word("placement.hint")));
}

function choose(name) {
  current = name;
  showPlacement(found);
  byId("placement").querySelector("tr.on")?.scrollIntoView({ block: "nearest" });
}

function pick(x, y) {
  const away = (one) => { const [px, py] = toScreen(middleOf(one.after ?? one.before ?? [[1e9, 1e9]])); return Math.hypot(px - x, py - y); };
  const nearest = [...found.photos].sort((a, b) => away(a) - away(b))[0];
  if (nearest) choose(nearest.photo);
}

function redraw() {
  if (asked || !room || !view) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; if (room && found) draw(); });
}

function outline(context, ring, colour, width, dashed) {
  context.setLineDash(dashed ? [7, 5] : []);
  halo(context, colour, width, () => { ring.forEach((corner, index) => (index ? context.lineTo(...toScreen(corner)) : context.moveTo(...toScreen(corner)))); context.closePath(); });
  context.setLineDash([]);
}

function draw() {
  const [context, width, height] = canvas(room.querySelector(".picture"));
  drawLayer(context, orthoLayer(false), { x: view.x - width / 2 / view.scale, y: view.y - height / 2 / view.scale, scale: view.scale }, width, height);
  context.fillStyle = "#0b0d1058";
  context.fillRect(0, 0, width, height);
  const [over] = canvas(room.querySelector(".marks"));
  const order = [...found.photos].sort((a, b) => (a.photo === current) - (b.photo === current));
  for (const one of order) {
    const strong = one.photo === current;
    if (one.before && (mode !== "after" || !one.after)) outline(over, one.before, BEFORE, strong ? 2.4 : 1.1, true);
    if (one.after && mode !== "before") outline(over, one.after, AFTER, strong ? 2.6 : 1.2, false);
    if (strong && one.after && mode !== "before") {
      over.fillStyle = `${AFTER}2c`;
      over.beginPath();
      one.after.forEach((corner) => over.lineTo(...toScreen(corner)));
      over.fill();
    }
    if (one.before && one.after && mode === "both") arrow(over, toScreen(middleOf(one.before)), toScreen(middleOf(one.after)), strong);
    const at = toScreen(middleOf((mode === "before" ? one.before : one.after ?? one.before) ?? [[0, 0]]));
    over.font = strong ? "bold 13px sans-serif" : "11px sans-serif";
    text(over, shortName(one.photo), at[0] + 7, at[1] - 7, strong ? "#ffffff" : one.oriented ? AFTER : BEFORE);
  }
}

function arrow(context, [x1, y1], [x2, y2], strong) {
  const length = Math.hypot(x2 - x1, y2 - y1);
  if (length < 3) return;
  const [ux, uy] = [(x2 - x1) / length, (y2 - y1) / length];
  const tip = Math.min(9, length / 2);
  halo(context, strong ? "#ffffff" : "#d9dee6", strong ? 2.2 : 1.3, () => {
    context.moveTo(x1, y1);
    context.lineTo(x2, y2);
    context.moveTo(x2 - tip * (ux + 0.5 * uy), y2 - tip * (uy - 0.5 * ux));
    context.lineTo(x2, y2);
    context.lineTo(x2 - tip * (ux - 0.5 * uy), y2 - tip * (uy + 0.5 * ux));
  });
}

// Keys while the map is open; true when the key is ours.
export function placementKey(event, letter) {
  const down = event.type === "keydown";
  if (event.key === "Escape" || letter === "KeyG") { if (down) byId("placement").close(); return true; }
  if (!found || !down) return event.key.length === 1;
  const step = (by) => { const at = found.photos.findIndex((one) => one.photo === current); choose(found.photos[Math.min(Math.max(at + by, 0), found.photos.length - 1)].photo); };
  const acts = { KeyJ: () => step(1), KeyK: () => step(-1), ArrowDown: () => step(1), ArrowUp: () => step(-1), KeyF: fit };
  const act = acts[letter] ?? acts[event.key] ?? (["+", "="].includes(event.key) ? () => zoom(1.25) : event.key === "-" ? () => zoom(0.8) : null);
  if (event.key === " ") { mode = mode === "before" ? "after" : "before"; showPlacement(found); return true; }
  if (act) act();
  return Boolean(act) || event.key.length === 1;
}

export const placementState = () => ({ found, current, mode, view });
