// All scans of a point in one view: equal pictures of the same ground, the ortho first.
import { cleared, crosshair } from "./overlay.js";
import { drawLayer, layerFromGround, orthoLayer, scanLayer } from "./tiles.js";
import { View } from "./view.js";
import { all, byId, element, number, renew, shortName, stateGlyph, word } from "./words.js";
import { send } from "./wire.js";

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
  renew(room,
    element("div", {}, element("canvas"), element("span", {}, word("pane.ortho"))), ...scans);
}
