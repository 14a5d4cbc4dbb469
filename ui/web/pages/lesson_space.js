// A drawing in space, seen from a side: turned by hand or keys, and then drawn as a flat one.
import { element, word } from "./words.js";

/** @typedef {[azimuth: number, elevation: number]} Stance degrees */
/** @type {Record<string, Stance>} */
export const STANCES = { oblique: [-30, 22], side: [0, 0], above: [0, 90] };
const DEGREES_PER_PX = 0.4;
const STEP = 5; // degrees of a key
const LOWEST = -10;
const ROOM = 0.04; // of the size, around the box

/** @param {LessonCanvas} canvas */
export const isInSpace = ({ window }) => window.length === 6;

/**
 * The drawing as it is seen from a side, in parallel rays: its window holds the whole box.
 * @param {LessonCanvas} canvas @param {Stance} stance @returns {LessonCanvas}
 */
export function seenFrom(canvas, stance) {
  const [west, south, low, east, north, high] = canvas.window;
  const seen = viewOf(stance);
  const corners = [west, east].flatMap((x) => [south, north].flatMap((y) =>
    [low, high].map((z) => seen([x, y, z]))));
  const [across, up] = [0, 1].map((axis) => corners.map((corner) => corner[axis]));
  const edges = [Math.min(...across), Math.min(...up), Math.max(...across), Math.max(...up)];
  const room = ROOM * Math.max(edges[2] - edges[0], edges[3] - edges[1]);
  return {
    ...canvas,
    window: edges.map((edge, place) => (place < 2 ? edge - room : edge + room)),
    shapes: canvas.shapes.map((shape) => ({ ...shape,
      points: shape.points.map((place) => seen(/** @type {number[]} */ (place))) })),
  };
}

/** @param {Stance} stance @returns {(place: number[]) => Pair} */
function viewOf([azimuth, elevation]) {
  const [turn, lift] = [azimuth, elevation].map((angle) => (angle * Math.PI) / 180);
  const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
  return ([x, y, z]) => [x * cos + y * sin,
    z * Math.cos(lift) + (y * cos - x * sin) * Math.sin(lift)];
}

/**
 * Lets a drawing be turned; `show` draws it again.
 * @param {Element} sheet @param {Stance} stance is changed @param {() => void} show
 */
export function letTurn(sheet, stance, show) {
  const by = (/** @type {number} */ azimuth, /** @type {number} */ elevation) => {
    stance[0] = (stance[0] + azimuth) % 360;
    stance[1] = Math.min(90, Math.max(LOWEST, stance[1] + elevation));
    show();
  };
  let last = /** @type {PointerEvent | null} */ (null);
  const on = (/** @type {string} */ name, /** @type {(event: any) => void} */ act) =>
    sheet.addEventListener(name, act);
  sheet.classList.add("in-space");
  sheet.setAttribute("tabindex", "0");
  on("pointerdown", (event) => {
    last = event;
    sheet.setPointerCapture(event.pointerId);
  });
  on("pointermove", (event) => {
    if (!last) return;
    by((last.clientX - event.clientX) * DEGREES_PER_PX,
      (event.clientY - last.clientY) * DEGREES_PER_PX);
    last = event;
  });
  on("pointerup", () => { last = null; });
  on("pointercancel", () => { last = null; });
  on("keydown", (event) => {
    const turned = { ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0], ArrowUp: [0, STEP],
      ArrowDown: [0, -STEP] }[/** @type {string} */ (event.key)];
    if (!turned) return;
    event.preventDefault();
    by(turned[0], turned[1]);
  });
}

/**
 * Buttons for the usual sides. @param {Stance} stance is changed @param {() => void} show
 */
export const sides = (stance, show) => element("div", { class: "sides" },
  ...Object.entries(STANCES).map(([name, to]) => element("button", {
    type: "button", class: "small", "data-side": name, onclick: () => {
      [stance[0], stance[1]] = to;
      show();
    },
  }, word(`teach.${name}`))));
