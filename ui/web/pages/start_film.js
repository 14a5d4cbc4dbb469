// The film beside the form, the scans as small pictures with their state, and the map of outlines.
import {
  again, byId, element, fileSize, first, learnNames, number, renew, shortName, start, svg, turn,
  word,
} from "./words.js";
import { fillIn, formValues } from "./start_form.js";
import { halo } from "./overlay.js";
import { post, tell } from "./run.js";
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
  /** What lies in the folder is known. */
  looked: false,
  side: "whole",
  /** What was read beside the pictures, by photo. @type {Record<string, MarginField[]>} */
  read: {},
  reading: "",
  /** What reads print is not installed. */
  missing: false,
};
const redraw = oncePerFrame(draw);

export function setUpFilm() {
  state.pane = new Pane(first(".pane[data-pane=film]"), state.view, {
    redraw, ready: () => state.scan !== null,
  });
  byId("sides").replaceChildren(...Object.keys(SIDES).map((side) => element("button",
    { type: "button", "data-side": side, onclick: () => look(side) }, word(`start.side.${side}`))));
  byId("film-acts").append(element("button", { type: "button", id: "read-margin",
    disabled: start.guest, title: word("margin.tip"), onclick: readMargin }, word("margin.read")));
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
  if (side !== "whole") view.filled = null;
  redraw();
}

/** Proposals from the margin of the scan in sight; none holds before it is taken over. */
async function readMargin() {
  const { scan } = state;
  if (!scan || state.reading) return;
  state.reading = scan.photo;
  showMargin();
  const answer = await post("/margin", { photo: scan.photo, values: formValues() });
  state.reading = "";
  state.missing = answer.ok && !answer.fields;
  if (answer.ok && answer.fields) state.read[scan.photo] = answer.fields;
  else if (!answer.ok) tell(answer.error, true);
  showMargin();
}

function showMargin() {
  const { scan, read, reading } = state;
  const fields = scan && read[scan.photo];
  const parts = fields?.map((field) => element("li", {},
    element("button", { type: "button", class: "small", title: word("margin.look"),
      onclick: () => lookAt(field) }, word(`margin.${field.name}`)),
    element("b", {}, field.value), element("q", {}, field.text),
    element("span", { class: "muted" }, number(100 * field.probability, 0, "%")),
    field.key ? element("button", { type: "button", class: "small", "data-use": field.key,
      onclick: () => fillIn(field.key, field.value) }, word("margin.use")) : null));
  const said = reading ? word("margin.reading", { scan: shortName(reading) })
    : fields && !fields.length ? word("margin.nothing")
      : state.missing ? word("margin.missing") : "";
  renew(byId("margin"), ...(said ? [element("p", { class: "muted" }, said)] : []),
    ...(parts?.length ? [element("ul", {}, ...parts)] : []));
  redraw();
}

/** The line of a proposal, large. @param {MarginField} field */
function lookAt({ corners }) {
  if (!state.pane) return;
  const [columns, rows] = [0, 1].map((axis) => corners.map((corner) => corner[axis]));
  const rim = 0.6 * Math.max(Math.max(...columns) - Math.min(...columns),
    Math.max(...rows) - Math.min(...rows));
  state.view.fit([Math.min(...columns) - rim, Math.min(...rows) - rim],
    [Math.max(...columns) + rim, Math.max(...rows) + rim], state.pane.size, 0.97);
  redraw();
}

/** @param {FoundScan[]} scans */
export function showScans(scans) {
  const { scan: before } = state;
  Object.assign(state, { scans, looked: true });
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
  const said = why ? word(bytes === undefined ? "start.gone" : "start.unreadable")
    : `${size?.join("\u00d7")}\n${fileSize(bytes ?? 0)}`;
  return element("button", {
    type: "button", class: `thumb${why ? " bad" : ""}`, "data-photo": photo,
    title: why ? `${file}: ${again(why)}` : file, onclick: () => choose(scan),
  }, element("canvas", { width: 96, height: 76 }), element("b", {}, shortName(photo)),
  element("small", {}, said));
}

/** @param {FoundScan} scan */
function choose(scan) {
  if (!scan.size) {
    const why = `${scan.file}: ${again(scan.why)}`;
    return renew(byId("margin"), element("p", { class: "doubted" }, why));
  }
  state.scan = scan;
  look(state.side);
  showMargin();
}

/** A scan alone: its tiles are filled up beside it. @param {string} photo @param {Pair} size */
const scanLayer = (photo, size) => ({ ...rawLayer(photo, 1, size, false), extent: size });

function draw() {
  const { pane, scan, scans, view } = state;
  if (!pane) return;
  const [context, width, height] = cleared(pane.picture);
  if (scan?.size) {
    if (!view.scale && width) look(state.side);
    drawLayer(context, scanLayer(scan.photo, scan.size), view.frame([width, height]),
      [width, height]);
  }
  const [over] = cleared(pane.marks);
  for (const { corners } of (scan && state.read[scan.photo]) || []) {
    halo(over, "#5dade2", 1.4, () => {
      corners.map((corner) => pane.screenFromLayer(corner))
        .forEach(([x, y], at) => (at ? over.lineTo(x, y) : over.moveTo(x, y)));
      over.closePath();
    });
  }
  pane.label.textContent = scan ? scan.file
    : word(state.looked ? "start.noscans" : "wait");
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
  drawLayer(context, scanLayer(photo, size), small.frame([width, height]),
    [width, height]);
}

/** @param {HTMLElement} room @param {Found} found */
export function drawMap(room, { outlines: found, crs }) {
  const outlines = found.map((one) => ({ ...one, crs: again(one.crs) }));
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
