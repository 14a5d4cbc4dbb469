// What is drawn over the mosaic: seams with the names of their photos, borders of photos, holes.
import { FONT, halo, text } from "./overlay.js";
import { number, shortName, squareMetres } from "./words.js";

/** @typedef {(ground: Pair) => Pair} OnScreen */
/** @typedef {[left: number, top: number, right: number, bottom: number]} Box */

const [SEAM, BORDER, HOLE] = ["#ffd23f", "#56b4e9", "#ff6b6b"];
export const CHOSEN = "#ffffff";
const NAME_PX = 44; // design: a part narrower than its name on the screen has none
const MISFIT = "#ff9a3d";
const ARROW_PX = 34; // design: a direction that is seen; the length is written beside it
const [LINE_PX, OFF_PX] = [13, 9]; // design: height of a line of words, and how far off a mark
const TOLD_PX = 24; // design: smaller holes are only ringed, their areas would lie over each other

/**
 * Outlines of whole photos on the ground; that of the chosen one is named.
 * @param {Context} context @param {Mosaic} found @param {OnScreen} onScreen @param {string} chosen
 */
export function drawBorders(context, { borders = {} }, onScreen, chosen) {
  context.setLineDash([7, 5]);
  for (const [name, ring] of Object.entries(borders)) {
    outline(context, [ring.map(onScreen)], BORDER, name === chosen ? 2.6 : 1.1);
    if (name === chosen) text(context, shortName(name), onScreen(ring[0]), BORDER);
  }
  context.setLineDash([]);
}

/**
 * The chosen photo's part lies over the others.
 * @param {Context} context @param {Mosaic} found @param {OnScreen} onScreen @param {string} chosen
 * @returns {Box[]} where the names are
 */
export function drawSeams(context, { seams = [] }, onScreen, chosen) {
  const named = /** @type {Box[]} */ ([]);
  const rings = seams.map((seam) => seam.rings.map((ring) => ring.map(onScreen)));
  for (const strong of [false, true]) {
    seams.forEach(({ photo }, at) => {
      if ((photo === chosen) !== strong) return;
      outline(context, rings[at], strong ? CHOSEN : SEAM, strong ? 2.2 : 1.3);
    });
  }
  seams.forEach(({ photo, label }, at) => {
    const across = rings[at].flat().map(([place]) => place);
    if (Math.max(...across) - Math.min(...across) < NAME_PX) return;
    const [x, y] = onScreen(label);
    text(context, shortName(photo), [x - 16, y], photo === chosen ? CHOSEN : SEAM);
    named.push(boxOf([x - 16, y], context.measureText(shortName(photo)).width));
  });
  return named;
}

/**
 * @param {Context} context @param {Pair[][]} rings on the screen @param {string} colour
 * @param {number} wide
 */
function outline(context, rings, colour, wide) {
  halo(context, colour, wide, () => {
    for (const ring of rings) {
      ring.forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
    }
  });
}

/**
 * @param {Context} context @param {Mosaic} found @param {OnScreen} onScreen
 * @param {number} scale css pixels a metre
 */
export function drawHoles(context, { holes = [] }, onScreen, scale) {
  for (const [east, north, area] of holes) {
    const [x, y] = onScreen([east, north]);
    const radius = Math.sqrt(area / Math.PI) * scale;
    const reach = Math.max(6, radius + 4);
    halo(context, HOLE, 1.6, () => context.arc(x, y, reach, 0, 7));
    if (2 * radius > TOLD_PX) {
      text(context, squareMetres(area), [x + reach + 4, y + 4], HOLE);
    }
  }
}

/**
 * Shifts of places, enlarged so that they are seen; dashed where this is not sure.
 * @param {Context} context @param {Mosaic} found @param {OnScreen} onScreen
 * @param {Box[]} named where names of photos are @param {PickedPlace | null} picked
 */
export function drawMisfits(context, { misfits = [] }, onScreen, named, picked) {
  const { clientWidth, clientHeight } = context.canvas;
  const taken = [...named];
  context.font = FONT;
  for (const { place, shift: [east, north], length, significant } of misfits) {
    const [x, y] = onScreen(place);
    const [right, down] = [east, -north].map((value) => (value / (length || 1)) * ARROW_PX);
    if (!isInside([x, y], [clientWidth, clientHeight])) continue;
    const chosen = isAt(picked, place);
    context.setLineDash(significant || chosen ? [] : [3, 3]);
    halo(context, chosen ? CHOSEN : MISFIT, chosen ? 3 : significant ? 2 : 1.2, () => {
      context.arc(x, y, 5, 0, 7);
      context.moveTo(x, y);
      context.lineTo(x + right, y + down);
    });
    context.setLineDash([]);
    const said = number(length, 1, "m");
    const wide = context.measureText(said).width;
    const at = roomFor(wide, [x, y], down > 0, [clientWidth, clientHeight], taken);
    taken.push(boxOf(at, wide));
    text(context, said, at, chosen ? CHOSEN : MISFIT);
  }
}

/**
 * Whether a place is the one that is asked about.
 * @param {PickedPlace | null} picked @param {Pair} place told to a tenth of a metre
 */
export const isAt = (picked, [east, north]) => picked !== null
  && Math.hypot(picked.place[0] - east, picked.place[1] - north) < 0.05;

/**
 * Whether a mark is in sight: words about others would stand at the edge.
 * @param {Pair} mark @param {Pair} size of the picture
 */
export const isInside = ([x, y], [width, height]) =>
  x > -ARROW_PX && y > -ARROW_PX && x < width + ARROW_PX && y < height + ARROW_PX;

/** @param {Pair} place where words begin, on their line @param {number} wide @returns {Box} */
export const boxOf = ([x, y], wide) => [x, y - LINE_PX, x + wide, y];

/**
 * Where words about a mark begin: off its arrow, inside the picture and over no other words.
 * @param {number} wide @param {Pair} mark @param {boolean} falls the arrow points down
 * @param {Pair} size of the picture @param {Box[]} taken @returns {Pair}
 */
export function roomFor(wide, [x, y], falls, [width, height], taken) {
  const [above, below] = [y - OFF_PX, y + OFF_PX + LINE_PX];
  const [left, right] = [x - OFF_PX - wide, x + OFF_PX];
  const places = [falls ? above : below, falls ? below : above].flatMap((line) =>
    [x - wide / 2, right, left].map((begin) => /** @type {Pair} */ ([
      Math.max(2, Math.min(begin, width - wide - 2)),
      Math.max(LINE_PX, Math.min(line, height - 2)),
    ])));
  const isFree = (/** @type {Pair} */ place) => {
    const [l, t, r, b] = boxOf(place, wide);
    return taken.every(([a, c, d, e]) => r < a || l > d || b < c || t > e);
  };
  return places.find(isFree) ?? places[0];
}

/**
 * The photo whose part holds a place; empty beside all of them.
 * @param {SeamOf[]} seams @param {Pair} ground
 */
export const photoAt = (seams, ground) =>
  seams.find(({ rings }) => rings.filter((ring) => turnsRound(ring, ground)).length % 2)?.photo
  ?? "";

/** @param {Pair[]} ring @param {Pair} place */
function turnsRound(ring, [east, north]) {
  let inside = false;
  ring.forEach(([x, y], at) => {
    const [before, level] = ring[at ? at - 1 : ring.length - 1];
    const crosses = (y > north) !== (level > north);
    if (crosses && east < ((before - x) * (north - y)) / (level - y) + x) inside = !inside;
  });
  return inside;
}
