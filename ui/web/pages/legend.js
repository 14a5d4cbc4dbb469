// What tells how to read the 3D scene: north arrow, scale bar, arrow of the vectors, colours.
import { eyeOf, northOf, pixelMetres } from "./eye.js";
import { roundLength } from "./view.js";
import {
  byId, element, glyph, number, roleGlyph, roundNumber, shortName, start, stateGlyph, svg, word,
} from "./words.js";

const STATES = /** @type {State[]} */ (["auto", "accepted", "dubious", "rejected", "unused"]);
const BAR_PX = 90; // design: a quarter of the inset
const ARROW_PX = [14, 150]; // design: from what can be seen to what fits beside the slider
const FEWEST_RAYS = 2; // as `ui/review/looks.py` has it
const state = {
  scene: /** @type {SceneSwitches | null} */ (null),
  seen: "",
};

/** The eye moved, or the window changed. */
export function followEye() {
  const eye = eyeOf(byId("scene").contentWindow);
  if (!eye || !state.scene) return;
  const { level, scale } = state.scene;
  const seen = JSON.stringify([eye, level, scale]);
  if (seen === state.seen) return;
  state.seen = seen;
  const [x, y] = northOf(eye);
  const length = Math.max(Math.hypot(x, y), 0.35);
  byId("north").style.transform = `rotate(${Math.atan2(x, y)}rad) scaleY(${length})`;
  const pixel = pixelMetres(eye, level);
  byId("scene-scale").hidden = pixel === null;
  if (pixel === null) return;
  const metres = roundLength(BAR_PX * pixel);
  byId("scene-scale").replaceChildren(
    element("i", { style: `width: ${Math.round(metres / pixel)}px` }),
    metres < 1000 ? roundNumber(metres, "m") : roundNumber(metres / 1000, "km"));
  showArrow(pixel, scale);
}

/** An arrow of one metre, as many times longer as the vectors. */
function showArrow(/** @type {number} */ pixel, /** @type {number} */ scale) {
  const room = byId("vector-arrow");
  room.hidden = scale === 0;
  if (scale === 0) return;
  const [least, most] = ARROW_PX;
  let metres = 1;
  // Where a metre does not fit, or would not be seen, another round length is shown.
  if (scale / pixel > most || scale / pixel < least) metres = roundLength((most * pixel) / scale);
  const width = Math.round((metres * scale) / pixel);
  const drawing = svg("svg", { width, height: 9, viewBox: `0 0 ${width} 9` },
    svg("path", { d: `M0 4.5H${width - 1}M${width - 5} 1l4 3.5-4 3.5` }));
  room.replaceChildren(drawing, roundNumber(metres, "m"));
}

/** @param {SceneSwitches} scene */
export function showLegend(scene) {
  state.scene = scene;
  followEye();
  const { layers, photo, inside, top, light, letters } = scene;
  const { sizes, rays, bare, ellipse, chosen } = start.palette;
  const pink = chosen[light ? "light" : "dark"];
  const rows = /** @type {[boolean, string, () => (Node | string)[]][]} */ ([
    [photo !== "", "legend.photo", () =>
      [glyph("photo", pink), element("b", {}, shortName(photo))]],
    [layers.specials, "legend.specials", () => letters.flatMap((letter) =>
      [element("b", { style: `color: ${pink}` }, letter), word(`special.${letter}`)])],
    [layers.points, "legend.points", () =>
      STATES.flatMap((name) => [stateGlyph(name, 12), word(`state.${name}`)])],
    [layers.checks, "legend.checks", () => [roleGlyph("check", 12)]],
    [layers.vectors || layers.tie_vectors, "legend.vectors", () =>
      ["0", ramp(sizes), `\u2265 ${number(top, top < 1 ? 2 : 0, "m")}`]],
    [layers.ellipses, "legend.ellipses", () => [glyph("circle", ellipse, 13)]],
    [layers.ties, "legend.rays", () => (scene.rays
      ? [dot(rays[Math.min(scene.rays - FEWEST_RAYS, rays.length - 1)]), `${scene.rays}`]
      : rays.flatMap((colour, i) => [dot(colour),
        `${i + FEWEST_RAYS}${i === rays.length - 1 ? "+" : ""}`]))],
    [layers.areas, "legend.areas", () => [glyph("bare", bare, 13)]],
  ]);
  const shown = rows.filter(([on]) => on);
  // From inside a photo nothing but the photo is looked at.
  byId("scene-legend").hidden = !shown.length || inside !== "";
  byId("scene-legend").replaceChildren(...shown.map(([, name, parts]) =>
    element("div", { title: word(`${name}.tip`) }, element("span", {}, word(name)), ...parts())));
}

/** @param {string[]} colours */
const ramp = (colours) =>
  element("i", { class: "ramp", style: `background: linear-gradient(90deg, ${colours})` });

/** @param {string} colour */
const dot = (colour) => element("i", { class: "dot", style: `background: ${colour}` });
