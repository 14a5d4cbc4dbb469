// What is told beside the mosaic: how old it is, what a place on it leads to, and its holes.
import { faultList, markFault } from "./faults.js";
import { editSide, editTools } from "./mosaic_edit.js";
import { isAt } from "./mosaic_marks.js";
import { sheetSide } from "./mosaic_sheets.js";
import { remakeName } from "./status.js";
import {
  element, number, shortName, shortPoint, squareMetres, start, undivided, word,
} from "./words.js";
import { send } from "./wire.js";

const HIGH_PX = 900; // design: below, what is wrong here would be pushed out of sight
const state = {
  /** Parts that a hand folded or unfolded. @type {Map<string, boolean>} */
  unfolded: new Map(),
};

/**
 * What the buttons set off.
 * @typedef {object} Acts
 * @property {(ground: Pair) => void} goTo @property {() => void} remake
 * @property {(part: string) => void} leave
 * @property {(ground: Pair, photo?: string) => void} ask goes to a place and asks about it
 * @property {() => void} refresh
 * @property {(bounds: number[]) => void} frame lays the view round west, south, east, north
 */

/**
 * @param {Mosaic} found @param {PickedPlace | null} picked @param {Status | null} status
 * @param {Acts} acts
 */
export function mosaicSide(found, picked, status, acts) {
  return [
    editTools(found, picked),
    element("p", { id: "mosaic-said" }, word("mosaic.said", {
      pixel: number(found.pixel, 2, "m"), area: number((found.area ?? 0) / 1e6, 2),
      count: found.seams?.length ?? 0, when: undivided(found.written ?? ""),
    })),
    ...stale(found, status, acts), ...sheetSide(found, acts), ...misfits(found, picked, acts),
    ...place(found, picked, acts),
    ...markFault(picked), ...behind(picked), ...faultList(found, acts.ask, acts.refresh),
    ...editSide(found, word(remakeName(status)), acts.frame),
    folded("mosaic.help", element("p", { class: "muted" }, word("mosaic.hint"))),
    ...holes(found, acts),
  ];
}

/** @param {Mosaic} found @param {Status | null} status @param {Acts} acts */
function stale(found, status, { remake }) {
  const { stale: photos } = found;
  const making = status?.remaking;
  if (making) {
    // Results alone are written where no ortho and no seam waits.
    const made = photos.length || found.edition ? "mosaic.making" : "mosaic.writing";
    const share = word(made, { share: Math.round(100 * making.share) });
    return [element("p", { id: "mosaic-stale", class: "doubted", role: "status" }, share)];
  }
  const outside = found.outside ? [element("p", { id: "mosaic-outside", class: "doubted" },
    word(`mosaic.outside.${found.outside}`))] : [];
  const waits = found.gone || found.outside === "waiting";
  if (!photos.length && !found.edition && !waits) return outside;
  const [names, name] = [photos.map(shortName).join(", "), remakeName(status)];
  const moved = photos.length ? [element("p", { id: "mosaic-stale", class: "doubted" },
    word("mosaic.stale", { count: photos.length, names }))] : [];
  const gone = found.gone ? [element("p", { id: "mosaic-gone", class: "doubted" },
    word("mosaic.gone"))] : [];
  return [...gone, ...outside, ...moved, element("div", {}, element("button", { id: "mosaic-remake",
    onclick: remake, disabled: start.guest, title: word(`${name}.tip`) }, word(name)))];
}

/** @param {string} name @param {string} value */
const figure = (name, value) => element("div", { class: "figure" },
  element("span", {}, word(`mosaic.${name}`)), element("b", { "data-figure": name }, value));

/** @param {Mosaic} found @param {PickedPlace | null} picked @param {Acts} acts */
function place(found, picked, { ask, leave }) {
  if (!picked) return [element("p", { class: "muted" }, word("mosaic.pick"))];
  const { photo, place: at } = picked;
  const where = figure("place", at.slice(0, 2).map((value) => number(value, 1)).join("  "));
  if (!photo) return [element("h3", {}, word("mosaic.nothing")), where];
  const { sigma } = picked;
  const precision = sigma ? word("mosaic.sigma.of",
    { east: number(sigma[0], 2), north: number(sigma[1], 2) }) : word("mosaic.unknown");
  const near = picked.points
    ? word(picked.nearest === null ? "mosaic.points.unused" : "mosaic.points.of",
      { count: picked.points, metres: number(picked.nearest, 0) })
    : word("mosaic.points.none");
  const scene = () => {
    leave("block");
    send({ kind: "enter", photo });
  };
  const queue = () => {
    leave("queue");
    send({ kind: "near", photo, place: at.slice(0, 2) });
  };
  return [
    element("h3", { id: "mosaic-photo", title: photo }, shortName(photo),
      picked.shown === photo ? "" : ` \u00b7 ${word("mosaic.beside")}`,
      picked.stale ? ` \u00b7 ${word("mosaic.moved")}` : ""),
    ...otherOf(found, picked, ask),
    element("div", { class: "board-figures" }, ...offBy(found, picked),
      figure("date", picked.date || word("mosaic.unknown")), figure("pixel", number(picked.pixel,
        2, "m")), figure("sigma", precision), where, figure("height", number(at[2], 1, "m")),
      figure("points", near)),
    element("div", { class: "acts" },
      element("button", { id: "mosaic-scene", onclick: scene }, word("mosaic.scene")),
      element("button", { id: "mosaic-queue", onclick: queue, disabled: !picked.points },
        word("mosaic.queue"))),
  ];
}

/**
 * How far a likely fault is off.
 * @param {Mosaic} found @param {PickedPlace} picked
 */
function offBy({ misfits: places = [] }, picked) {
  const { shift: [east, north] = [0, 0] } = places.find(({ place: at }) => isAt(picked, at)) ?? {};
  return east || north ? [figure("off", word("mosaic.sigma.of",
    { east: number(east, 2), north: number(north, 2) }))] : [];
}

/**
 * Leads from one photo of a likely fault to the other one.
 * @param {Mosaic} found @param {PickedPlace} picked @param {Acts["ask"]} ask
 */
function otherOf({ misfits: places = [] }, picked, ask) {
  const pair = places.find(({ photos, place: at }) => photos.length > 1 && isAt(picked, at));
  const other = pair?.photos.find((name) => name !== picked.photo);
  return pair && other ? [element("p", { class: "muted" }, `${word("mosaic.pair")} `,
    element("button", { id: "mosaic-other", onclick: () => ask(pair.place, other) },
      shortName(other)))] : [];
}

/** What lies behind a place: what holds its photo, and which photos see it. */
function behind(/** @type {PickedPlace | null} */ picked) {
  if (!picked?.photo) return [];
  const seen = (picked.others ?? []).map(([name, nadir, pixel]) => element("tr",
    { class: name === picked.photo ? "on" : "" }, element("td", { class: "name" }, shortName(name)),
    element("td", {}, number(nadir, 0, "\u00b0")), element("td", {}, number(pixel, 2, "m"))));
  const heads = ["photo", "nadir", "pixel"].map((name) =>
    element("th", {}, word(`mosaic.${name}`)));
  const table = element("table", { class: "film-table" }, element("tr", {}, ...heads), ...seen);
  return [folded("mosaic.cause", ...cause(picked)), folded("sight.title", table)];
}

/**
 * A part that is unfolded where the window is high, until a hand says otherwise.
 * @param {string} name @param {Node[]} children
 */
function folded(name, ...children) {
  const room = /** @type {HTMLDetailsElement} */ (element("details",
    { open: state.unfolded.get(name) ?? window.innerHeight > HIGH_PX },
    element("summary", { onclick: () => state.unfolded.set(name, !room.open) }, word(name)),
    ...children));
  return room;
}

/** What holds the photo near by. @param {PickedPlace} picked */
function cause({ control = [], ties }) {
  const rows = control.map(({ point, away, residual, state: known }) => element("tr", {},
    element("td", { class: "name", title: point }, shortPoint(point)),
    element("td", {}, number(away, 0, "m")),
    element("td", {}, residual === null ? "" : number(residual, 1, "px")),
    element("td", { class: known === "dubious" ? "doubted" : "" }, word(`state.${known}`))));
  const held = ties ? word("mosaic.ties.of", { count: ties.count, metres: number(ties.away, 0),
    rms: number(ties.rms, 2), largest: number(ties.largest, 2) }) : word("mosaic.ties.none");
  return [element("table", { class: "film-table", id: "mosaic-cause" }, ...rows),
    element("p", { id: "mosaic-ties", class: "muted" }, held)];
}

/**
 * Places that are likely wrong, worst first.
 * @param {Mosaic} found @param {PickedPlace | null} picked @param {Acts} acts
 */
function misfits({ misfits: places = [] }, picked, { ask }) {
  if (!places.length) return [element("p", { class: "muted" }, word("mosaic.misfit.none"))];
  const lines = places.map(({ kind, height, length, photos, place: ground, predicted, sigma,
    significant }) => {
    const what = word(`mosaic.misfit.${kind}`, { height: number(height, 0) });
    const tip = word("mosaic.misfit.tip", { length: number(length, 2), sigma: number(sigma, 2),
      predicted: number(predicted, 2) });
    return element("button", { class: `scan${isAt(picked, ground) ? " on" : ""}`,
      "data-misfit": kind, title: `${what}: ${tip}`, onclick: () => ask(ground, photos[0]) },
    element("span", { class: significant ? "doubted" : "" },
      `${number(length, 1)} \u00b1 ${number(sigma, 1, "m")} ${what}`,
      significant ? "" : `, ${word("mosaic.misfit.unsure")}`),
    element("span", { class: "muted" }, photos.map(shortName).join(" | ")));
  });
  const count = places.filter(({ significant }) => significant).length;
  return [element("h3", {}, word("mosaic.misfit",
    { count, unsure: places.length - count })),
    element("div", { class: "scans", id: "mosaic-misfits" }, ...lines)];
}

/** @param {Mosaic} found @param {Acts} acts */
function holes({ holes: found = [], hole_count: count = 0 }, { goTo }) {
  if (!count) return [element("p", { class: "muted" }, word("mosaic.holes.none"))];
  const lines = found.map(([east, north, area, why, scans]) => element("button", { class: "scan",
    "data-hole": "", onclick: () => goTo([east, north]) },
  element("span", {}, squareMetres(area)),
  element("span", { class: "muted" }, `${number(east, 0)}  ${number(north, 0)}`),
  element("small", {}, word(`hole.${why}`, { scans: scans.map(shortName).join(", ") }))));
  return [element("h3", {}, word("mosaic.holes", { count })),
    element("div", { class: "scans", id: "mosaic-holes" }, ...lines)];
}
