// The film beside the form, the scans as small pictures with their state, and the map of outlines.
import {
  again, byId, element, fileSize, first, learnNames, renew, shortName, svg, turn, word,
} from "./words.js";
import { cleared } from "./overlay.js";
import { drawLayer, onTile, rawLayer } from "./tiles.js";
import { Pane, View, oncePerFrame } from "./view.js";

const MARGIN = 0.14; // design: a data strip and what is written beside it, as a share of the side
/** Box of the scan to be looked at, in shares. @type {Record<string, number[]>} */
const SIDES = {
  whole: [0, 0, 1, 1], top: [0, 0, 1, MARGIN], bottom: [0, 1 - MARGIN, 1, 1],
  left: [0, 0, MARGIN, 1], right: [1 - MARGIN, 0, 1, 1],
};
const state = {
  view: new View(0.002, 20),
  pane: /** @type {Pane | null} */ (null),
  scans: /** @type {FoundScan[]} */ ([]),
  scan: /** @type {FoundScan | null} */ (null),
  side: "whole",
};
const redraw = oncePerFrame(draw);

export function setUpFilm() {
  state.pane = new Pane(first(".pane[data-pane=film]"), state.view, {
    redraw, ready: () => state.scan !== null,
  });
  byId("sides").replaceChildren(...Object.keys(SIDES).map((side) => element("button",
    { type: "button", "data-side": side, onclick: () => look(side) }, word(`start.side.${side}`))));
  onTile(redraw);
  look("whole");
}

/** @param {string} side */
function look(side) {
  const { pane, scan, view } = state;
  state.side = side;
  for (const button of byId("sides").children) {
    const own = /** @type {HTMLElement} */ (button);
    turn(own, own.dataset.side === side);
  }
  if (!pane || !scan?.size) return;
  const [width, height] = scan.size;
  const [left, top, right, bottom] = SIDES[side];
  view.fit([left * width, top * height], [right * width, bottom * height], pane.size, 0.97);
  // The film's edge stands at the edge of the pane.
  const [across, down] = pane.size.map((length) => length / 2 / view.scale);
  if (side === "left") view.x = across;
  if (side === "right") view.x = width - across;
  if (side === "top") view.y = down;
  if (side === "bottom") view.y = height - down;
  redraw();
}

/** @param {FoundScan[]} scans */
export function showScans(scans) {
  const { scan: before } = state;
  state.scans = scans;
  learnNames(scans.map(({ photo }) => photo));
  const readable = scans.filter(({ size }) => size);
  state.scan = readable.find(({ photo }) => photo === before?.photo) ?? readable[0] ?? null;
  renew(byId("thumbs"), ...scans.map(thumbPart));
  if (!scans.length) byId("thumbs").append(element("p", { class: "muted" }, word("start.noscans")));
  if (state.scan?.photo !== before?.photo) look("whole");
  redraw();
}

/** @param {FoundScan} scan */
function thumbPart(scan) {
  const { photo, file, size, why, bytes } = scan;
  const said = why ? word(why === "gone" ? "start.gone" : "start.unreadable")
    : `${size?.join("\u00d7")}  ${fileSize(bytes ?? 0)}`;
  return element("button", {
    type: "button", class: `thumb${why ? " bad" : ""}`, "data-photo": photo,
    title: why ? `${file}: ${again(why)}` : file, onclick: () => choose(scan),
  }, element("canvas", { width: 96, height: 76 }), element("b", {}, shortName(photo)),
  element("small", {}, said));
}

/** @param {FoundScan} scan */
function choose(scan) {
  if (!scan.size) return;
  state.scan = scan;
  look(state.side);
}

function draw() {
  const { pane, scan, scans, view } = state;
  if (!pane) return;
  const [context, width, height] = cleared(pane.picture);
  if (scan?.size) {
    if (!view.scale && width) look(state.side);
    const layer = rawLayer(scan.photo, 1, scan.size, false);
    drawLayer(context, layer, view.frame([width, height]), [width, height]);
  }
  pane.label.textContent = scan ? scan.file : word("start.noscans");
  const thumbs = [...byId("thumbs").querySelectorAll(".thumb")];
  thumbs.forEach((thumb, index) => {
    const { size, photo } = scans[index];
    thumb.classList.toggle("on", photo === scan?.photo);
    if (size) drawThumb(/** @type {HTMLCanvasElement} */ (thumb.firstChild), scans[index]);
  });
}

/** @param {HTMLCanvasElement} canvas @param {FoundScan} scan */
function drawThumb(canvas, { photo, size }) {
  const context = canvas.getContext("2d");
  if (!context || !size) return;
  const [width, height] = [canvas.width, canvas.height];
  const small = new View().fit([0, 0], size, [width, height]);
  context.clearRect(0, 0, width, height);
  drawLayer(context, rawLayer(photo, 1, size, false), small.frame([width, height]),
    [width, height]);
}

/** @param {HTMLElement} room @param {Found} found */
export function drawMap(room, { outlines, crs }) {
  if (!outlines.length) {
    return room.replaceChildren(element("p", { class: "muted" }, word("start.nomap")));
  }
  const places = outlines.flatMap(({ corners }) => corners);
  const [east, north] = [places.map(([x]) => x), places.map(([, y]) => -y)];
  const [left, top] = [Math.min(...east), Math.min(...north)];
  const [width, height] = [Math.max(...east) - left || 1, Math.max(...north) - top || 1];
  const rim = 0.04 * Math.max(width, height);
  const shapes = outlines.map(({ kind, name, crs: own, corners }) => svg("polygon", {
    class: kind, points: corners.map(([x, y]) => `${x - left},${-y - top}`).join(" "),
  }, svg("title", {}, `${name} ${own}`)));
  const box = [-rim, -rim, width + 2 * rim, height + 2 * rim].join(" ");
  const kinds = [...new Set(outlines.map(({ kind, crs: own }) => `${kind}|${own}`))];
  const lines = kinds.map((both) => {
    const [kind, own] = both.split("|");
    const same = outlines.filter((one) => one.kind === kind && one.crs === own);
    const values = { what: word(`map.${kind}`), count: same.length };
    const known = same.length === 1 ? same[0].name : word("map.several", values);
    return element("li", { class: `of-${kind}` },
      `${word(`map.${kind}`)}: ${known}, ${own || word("map.nocrs")}`);
  });
  return room.replaceChildren(
    svg("svg", { viewBox: box, role: "img", "aria-label": word("start.map") }, ...shapes),
    element("ul", {}, ...lines, element("li", { class: "of-other" },
      word("map.block", { crs: crs || word("map.nocrs") }))));
}
