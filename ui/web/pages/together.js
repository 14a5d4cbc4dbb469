// All scans of a point in one view: equal pictures of the same ground, the ortho first.
import { cleared, crosshair } from "./overlay.js";
import { drawLayer, layerFromGround, orthoLayer, scanLayer } from "./tiles.js";
import { View } from "./view.js";
import {
  all, byId, element, number, renew, shortName, start, stateGlyph, turn, word,
} from "./words.js";
import { send } from "./wire.js";

/** @typedef {import("./compare.js").Switch} Switch */

const SWITCHES = /** @type {Switch[]} */ (
  ["wallis", "raw", "likeness", "marks", "edges", "flicker", "together", "adding"]);
const REST = "[data-act=blink], #modes button, #contrast, #swipe";

/** @param {Switch} what */
export const worksTogether = (what) => what === "wallis" || what === "together";

/**
 * What would change nothing in all scans is out of use there, and does not look as if it did.
 * @param {Record<Switch, boolean>} look @param {boolean} together
 */
export function showTools(look, together) {
  for (const name of SWITCHES) {
    const idle = together && !worksTogether(name);
    for (const button of all(`[data-act=${name === "adding" ? "add" : name}]`)) {
      turn(button, look[name] && !idle);
      button.toggleAttribute("disabled", idle);
    }
  }
  for (const tool of all(REST, byId("tools"))) tool.toggleAttribute("disabled", together);
}

/** @param {Point} point */
const shapeOf = ({ key, others }) => JSON.stringify([key, others]);

/**
 * True when every picture is whole.
 * @param {Point} point @param {number} scale css pixels a metre @param {boolean} wallis
 */
export function drawTogether(point, scale, wallis) {
  const room = byId("together");
  if (room.dataset.shape !== shapeOf(point)) build(room, point);
  const { marks: { surveyed }, others } = point;
  const view = new View().show(layerFromGround(surveyed), scale);
  return all("canvas", room).map((found, index) => {
    const [context, width, height] = cleared(/** @type {HTMLCanvasElement} */ (found));
    const size = [width, height];
    const other = others[index - 1];
    const layer = other ? scanLayer(other.photo, other.version, wallis) : orthoLayer(wallis);
    const whole = drawLayer(context, layer, view.frame(size), size);
    crosshair(context, [width / 2, height / 2], width, height);
    return whole;
  }).every(Boolean);
}

/**
 * What lies beside a scan: the ortho or, where there is none, the scan that shows the point best,
 * one where it was measured before others; its place there lies where the point is given.
 * @param {Point} point @param {View} view @param {boolean} wallis
 */
export function beside({ key, marks, others }, view, wallis) {
  if (start.ortho) return { layer: orthoLayer(wallis), view, name: word("pane.ortho") };
  const rest = others.filter(({ photo, hidden }) => photo !== key[1] && !hidden);
  const other = rest.find(({ state }) => state === "accepted") ?? rest[0];
  if (!other) return { layer: orthoLayer(wallis), view, name: word("pane.no-ortho") };
  const [here, there] = [marks.surveyed, other.at ?? marks.surveyed].map(layerFromGround);
  const moved = new View().show(
    [view.x + there[0] - here[0], view.y + there[1] - here[1]], view.scale);
  const name = word("pane.scan", { scan: shortName(other.photo) });
  return { layer: scanLayer(other.photo, other.version, wallis), view: moved, name };
}

/** @param {HTMLElement} room @param {Point} point */
function build(room, point) {
  room.dataset.shape = shapeOf(point);
  const { key: [name, current], others } = point;
  const across = Math.ceil(Math.sqrt((others.length + 1) * 1.6));
  room.style.gridTemplateColumns = `repeat(${across}, minmax(0, 1fr))`;
  const scans = others.map(({ photo, state, misfit }) => {
    const here = photo === current;
    return element("button", {
      class: here ? "on" : "", "aria-pressed": `${here}`, title: photo, "data-photo": photo,
      onclick: () => send({ kind: "select", key: [name, photo] }),
    }, element("canvas"), element("span", {}, stateGlyph(state, 12),
      `${shortName(photo)} \u00b7 ${number(misfit, 1)} px`));
  });
  const ortho = word(start.ortho ? "pane.ortho" : "pane.no-ortho");
  renew(room, element("div", {}, element("canvas"), element("span", {}, ortho)), ...scans);
}
