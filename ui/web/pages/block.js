// The room of the 3D scene: its layers, the length of vectors, and when it is loaded.
import { compareState } from "./compare.js";
import { followEye, showLegend } from "./legend.js";
import { growTo, showAllParts } from "./layout.js";
import { showPhotoPoints } from "./photo_points.js";
import { setUpSight, showInside } from "./sight.js";
import { all, byId, element, first, focused, start, turn, word } from "./words.js";
import { send } from "./wire.js";

const LAYERS = [
  "terrain", "hillshade", "photos", "footprints", "areas", "points", "vectors", "ellipses",
  "checks", "ties", "tie_vectors", "labels", "specials",
];
const RELIEFS = [1, 2, 5]; // as `ui/review/state.py` has them
const state = {
  layers: /** @type {Record<string, boolean>} */ ({}),
  /** Only tie points of so many photos are shown, and whether any were before. */
  rays: 0,
  before: false,
  /** As the scene is drawn; null before it is told. */
  light: /** @type {boolean | null} */ (null),
};

const slider = () => /** @type {HTMLInputElement} */ (first("#vectors input"));

export function setUpScene() {
  for (const layer of LAYERS) {
    const name = word(`layer.${layer}`);
    const onclick = () => send({ kind: "layer", layer, shown: !state.layers[layer] });
    const title = start.words[`layer.${layer}.tip`] ?? word("layer.tip", { name });
    byId("layers").append(element("button", { "data-layer": layer, title, onclick }, name));
    // What is seen in the scan as well is switched there, too.
    for (const button of all(`#tools [data-layer=${layer}]`)) {
      Object.assign(button, { title, onclick, textContent: name });
    }
  }
  // Twice as far for every six steps: one slider serves both tenths of metres and of pixels.
  slider().addEventListener("input", () => {
    const { valueAsNumber: steps } = slider();
    send({ kind: "vectors", scale: steps === 0 ? 0 : Math.round(2 ** (steps / 6)) });
  });
  byId("vectors").title = word("vectors.tip");
  for (const relief of RELIEFS) {
    byId("relief").append(element("button", {
      "data-relief": relief, title: word("relief.tip"),
      onclick: () => send({ kind: "relief", relief }),
    }, `${relief}\u00d7`));
  }
  byId("relief").setAttribute("aria-label", word("relief"));
  setUpSight();
  new MutationObserver(tellTheme)
    .observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
  window.gruberEye = followEye;
  awaitScene();
}

/** Tie points of so many photos alone, in the whole window, until Esc. @param {number} rays */
export function showTies(rays) {
  if (!state.rays) state.before = state.layers.ties ?? false;
  send({ kind: "layer", layer: "ties", shown: true, rays });
  growTo("block");
}

/** Back to all parts and layers as they were; true where tie points had been asked for. */
export function leaveTies() {
  if (!state.rays) return false;
  send({ kind: "layer", layer: "ties", shown: state.before });
  showAllParts();
  return true;
}

/** The scene is the heaviest to load: first comes the point that is to be looked at. */
export function openScene(patience = 40) {
  if (patience > 0 && !compareState().drawn.whole) {
    setTimeout(() => openScene(patience - 1), 50);
  } else byId("scene").src = `/scene/${start.seat}/`;
}

/** The scene is covered until there is something to see in it, at first and when it comes back. */
function awaitScene() {
  const inside = /** @type {any} */ (byId("scene").contentWindow);
  const there = Boolean(inside?.__viserMutable?.nodeRefFromName["/terrain"]);
  byId("scene-wait").hidden = there && !inside.gruberLost;
  setTimeout(awaitScene, 200);
}

/** What stands against its ground is drawn so that it is seen there. */
function tellTheme() {
  const light = document.documentElement.dataset.theme === "light";
  if (state.light !== null && light !== state.light) send({ kind: "theme", light });
}

/** @param {SceneSwitches} scene */
export function showScene(scene) {
  const { layers, scale, relief, light, rays } = scene;
  const opened = state.light === null;
  Object.assign(state, { layers, light, rays });
  if (opened) tellTheme();
  showPhotoPoints(layers.specials);
  for (const button of all("[data-layer]")) {
    turn(button, layers[button.dataset.layer ?? ""]);
  }
  const steps = scale ? Math.round(6 * Math.log2(scale)) : 0;
  if (focused() !== slider()) slider().value = `${steps}`;
  for (const button of all("button", byId("relief"))) {
    turn(button, Number(button.dataset.relief) === relief);
  }
  showLegend(scene);
  showInside(scene);
}
