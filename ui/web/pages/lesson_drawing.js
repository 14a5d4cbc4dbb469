// The drawings of a lesson: shapes to scale, labels beside them, handles that move sliders.
import { element, svg, word } from "./words.js";
import { told } from "./lesson_numbers.js";
import { writeLabels } from "./lesson_labels.js";
import { STANCES, isInSpace, letTurn, seenFrom, sides } from "./lesson_space.js";

const PAD = 14; // css pixels around a drawing
const HANDLE = 9;
const BAR_SHARE = 0.22; // of a drawing's width, at most
const HEAD = 9; // length of an arrow's head, css pixels
const state = {
  /** @type {{ canvas: LessonCanvas, names: [string, string], scale: Scale } | null} */
  held: null,
};

/**
 * @typedef {{ x: (value: number) => number, y: (value: number) => number,
 *   back: (across: number, down: number) => Pair, unit: number }} Scale
 * @typedef {{ text: (key: string) => string, move: (names: [string, string], to: Pair,
 *   nudge?: boolean) => void, describe: (names: [string, string]) => string }} Doer
 */

/**
 * Rooms for drawings; each shows a canvas when it is told to.
 * @param {HTMLElement} room @param {LessonCanvas[]} first @param {Doer} doer
 */
export function drawingRooms(room, first, doer) {
  const rooms = first.map((canvas) => drawingRoom(canvas, doer));
  room.replaceChildren(...rooms.map(({ box }) => box));
  return (/** @type {LessonCanvas[]} */ canvases) =>
    canvases.forEach((canvas, place) => rooms[place].show(canvas));
}

/** @param {LessonCanvas} first @param {Doer} doer */
function drawingRoom(first, doer) {
  let canvas = first;
  const stance = /** @type {import("./lesson_space.js").Stance} */ ([...STANCES.oblique]);
  const sheet = /** @type {SVGSVGElement} */ (svg("svg", { role: "img" }));
  const title = element("figcaption");
  const box = element("figure", { class: "drawing" }, title, sheet);
  const again = () => draw(sheet, isInSpace(canvas) ? seenFrom(canvas, stance) : canvas, doer);
  if (isInSpace(first)) {
    letTurn(sheet, stance, again);
    box.append(sides(stance, again));
    box.title = word("teach.turned");
  }
  return { box, show: (/** @type {LessonCanvas} */ newest) => {
    canvas = newest;
    title.textContent = doer.text(`canvas.${canvas.name}`);
    sheet.setAttribute("aria-label", isInSpace(canvas)
      ? `${title.textContent} (${word("teach.turned")})` : title.textContent);
    again();
  } };
}

/** @param {SVGSVGElement} sheet @param {LessonCanvas} canvas @param {Doer} doer */
function draw(sheet, canvas, doer) {
  const { width, height } = sheet.getBoundingClientRect();
  if (width < 1 || height < 1) return;
  const scale = scaleOf(canvas, width, height);
  const handles = canvas.shapes.filter(({ handle }) => handle);
  const focus = [...sheet.querySelectorAll(".handle")].indexOf(
    /** @type {Element} */ (document.activeElement));
  const ordered = [...canvas.shapes.filter(({ handle }) => !handle), ...handles];
  sheet.setAttribute("role", handles.length || sheet.hasAttribute("tabindex") ? "group" : "img");
  sheet.setAttribute("viewBox", `0 0 ${width} ${height}`);
  sheet.replaceChildren(...beneath(canvas, scale),
    ...ordered.flatMap((shape) => parts(shape, scale)),
    ...(canvas.equal ? scaleBar(canvas, scale, width, height) : []));
  writeLabels(sheet, ordered, scale, doer.text, besides(sheet));
  const knobs = handles.map((shape) => knob(shape, canvas, scale, doer));
  sheet.append(...knobs);
  if (focus >= 0) /** @type {SVGElement} */ (knobs[focus])?.focus();
  sheet.onpointermove = (event) => drag(event, sheet, doer);
  sheet.onpointerup = () => { state.held = null; };
  sheet.onpointercancel = sheet.onpointerup;
}

/** What labels leave free: title, scale bar and buttons. @param {SVGSVGElement} sheet */
function besides(sheet) {
  const { left, top } = sheet.getBoundingClientRect();
  const others = sheet.parentElement?.querySelectorAll("figcaption, .bar-text, .sides") ?? [];
  return [...others].map((one) => {
    const box = one.getBoundingClientRect();
    return /** @type {import("./lesson_labels.js").Box} */ (
      [box.left - left, box.top - top, box.right - left, box.bottom - top]);
  });
}

/** @param {LessonCanvas} canvas @param {number} width @param {number} height @returns {Scale} */
function scaleOf({ window: [left, lower, right, upper], equal }, width, height) {
  let across = (width - 2 * PAD) / (right - left);
  let up = (height - 2 * PAD) / (upper - lower);
  if (equal) across = up = Math.min(across, up);
  const originX = (width - across * (right + left)) / 2;
  const originY = (height + up * (upper + lower)) / 2;
  return {
    x: (value) => originX + across * value,
    y: (value) => originY - up * value,
    back: (x, y) => [(x - originX) / across, (originY - y) / up],
    unit: across,
  };
}

/** The picture that shapes are drawn on. @param {LessonCanvas} canvas @param {Scale} scale */
function beneath({ picture }, { x, y }) {
  if (!picture) return [];
  const [left, lower, right, upper] = picture.window;
  return [svg("image", { href: picture.address, preserveAspectRatio: "none",
    x: x(left), y: y(upper), width: x(right) - x(left), height: y(lower) - y(upper) })];
}

/** @param {LessonShape} shape @param {Scale} scale @returns {Node[]} */
function parts({ kind, points, look, handle }, { x, y }) {
  const places = points.map(([a, b]) => [x(a), y(b)]);
  const list = places.map((place) => place.map((value) => value.toFixed(1)).join(",")).join(" ");
  if (!places.length || handle || kind === "text") return [];
  const look_ = `look-${look}`;
  if (kind === "line") return [svg("polyline", { class: look_, points: list })];
  if (kind === "area") return [svg("polygon", { class: look_, points: list })];
  if (kind === "dots") {
    return places.map(([cx, cy]) => svg("circle", { class: `dot ${look_}`, cx, cy, r: 4 }));
  }
  if (kind === "crosses") {
    return places.map(([cx, cy]) => svg("path",
      { class: look_, d: `M${cx - 6} ${cy}h12M${cx} ${cy - 6}v12` }));
  }
  return arrow(places, look_);
}

/** @param {number[][]} places @param {string} look @returns {Node[]} */
function arrow([[fromX, fromY], [toX, toY]], look) {
  const [runX, runY] = [toX - fromX, toY - fromY];
  const length = Math.hypot(runX, runY);
  if (length < 1) return [svg("circle", { class: `dot ${look}`, cx: fromX, cy: fromY, r: 1.5 })];
  const head = Math.min(HEAD, 0.6 * length);
  const [ux, uy] = [runX / length, runY / length];
  const [baseX, baseY] = [toX - head * ux, toY - head * uy];
  const side = 0.42 * head;
  return [svg("path", { class: look, d: `M${fromX} ${fromY}L${baseX} ${baseY}` }),
    svg("path", { class: `head ${look}`,
      d: `M${toX} ${toY}L${baseX - side * uy} ${baseY + side * ux}`
        + `L${baseX + side * uy} ${baseY - side * ux}Z` })];
}

/**
 * @param {LessonCanvas} canvas @param {Scale} scale @param {number} width @param {number} height
 */
function scaleBar({ unit }, { unit: scale }, width, height) {
  const most = (BAR_SHARE * width) / scale;
  const power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((step) => step * power).find((one) => one <= most) ?? power;
  const [right, down] = [width - 12, height - 12];
  const left = right - length * scale;
  const digits = Math.max(0, -Math.floor(Math.log10(length)));
  return [svg("path", { class: "bar", d: `M${left} ${down - 4}v4H${right}v-4` }),
    svg("text", { class: "bar-text", x: (left + right) / 2, y: down - 6, "text-anchor": "middle" },
      told({ value: length, digits, unit, truth: null }))];
}

/**
 * @param {LessonShape} shape @param {LessonCanvas} canvas @param {Scale} scale @param {Doer} doer
 */
function knob(shape, canvas, scale, doer) {
  const names = /** @type {[string, string]} */ (shape.handle);
  const [east, north] = shape.points[0];
  const made = svg("circle", {
    class: `handle look-${shape.look}`, cx: scale.x(east), cy: scale.y(north), r: HANDLE,
    tabindex: 0, role: "slider", "aria-label": doer.describe(names),
    "aria-valuetext": `${told({ value: east, digits: 0, unit: canvas.unit, truth: null })}, ${
      told({ value: north, digits: 0, unit: canvas.unit, truth: null })}`,
    "aria-valuenow": east, "data-names": names.join(" "),
  });
  made.addEventListener("pointerdown", (event) => {
    state.held = { canvas, names, scale };
    made.ownerSVGElement?.setPointerCapture(/** @type {PointerEvent} */ (event).pointerId);
    event.preventDefault();
    /** @type {SVGElement} */ (made).focus();
  });
  made.addEventListener("keydown", (event) => {
    const key = /** @type {KeyboardEvent} */ (event).key;
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
    if (!by) return;
    event.preventDefault();
    doer.move(names, by, true);
  });
  return made;
}

/** @param {PointerEvent} event @param {SVGSVGElement} sheet @param {Doer} doer */
function drag(event, sheet, doer) {
  if (!state.held) return;
  const { left, top } = sheet.getBoundingClientRect();
  const { names, scale } = state.held;
  doer.move(names, scale.back(event.clientX - left, event.clientY - top));
}
