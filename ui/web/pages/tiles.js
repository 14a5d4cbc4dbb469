// Tiles: fetched when first needed, kept while they fit, drawn with the best that is there already.
import { start } from "./words.js";

/** @typedef {HTMLImageElement & { ready?: boolean, failed?: boolean, ahead?: boolean }} Picture */
/**
 * Its own frame counts x right and y down in units of which `pixel` make one at level 0.
 * @typedef {object} Layer
 * @property {(level: number, column: number, row: number) => string} address
 * @property {number} levels @property {number} pixel
 * @property {Pair} [extent] beyond it there is nothing, in the layer's unit
 * @property {number[]} [box] left, top, right and bottom of all that there is, in the layer's unit
 * @property {Layer | null} [older] as the same was drawn before: better than nothing for a while
 */

const SIDE = 256;
const KEPT = 600; // design: pictures of a few screens, some 150 MB at most
const TRIES = 40; // design: gives up after twenty seconds
const AGAIN_MS = 500;
const OLDER = 3; // design: moves of a photo within the second that its new tiles take
const state = {
  images: /** @type {Map<string, Picture>} */ (new Map()),
  waiting: /** @type {Set<() => void>} */ (new Set()),
};

/** Called whenever a picture has come. @param {() => void} callback */
export function onTile(callback) {
  state.waiting.add(callback);
}

/** A picture, asked for if it is not there: `ready` when it is. @param {string} address */
export function image(address, ahead = false) {
  const { images, waiting } = state;
  const known = images.get(address);
  if (known) {
    known.ahead &&= ahead;
    images.delete(address);
    images.set(address, known);
    return known;
  }
  /** @type {Picture} */
  const found = new Image();
  found.decoding = "async";
  found.ahead = ahead;
  if (ahead) found.fetchPriority = "low";
  found.onload = () => {
    found.ready = true;
    // Nobody draws yet what was only asked for ahead.
    if (!found.ahead) waiting.forEach((callback) => callback());
  };
  let tries = 0;
  // The ortho may still be read for the first time: a tile not there yet is asked for again.
  found.onerror = () => {
    tries += 1;
    found.failed = tries > TRIES || !address.startsWith("/tiles/ortho/");
    if (found.failed) return;
    setTimeout(() => {
      if (images.has(address)) found.src = address;
    }, AGAIN_MS);
  };
  found.src = address;
  images.set(address, found);
  while (images.size > KEPT) images.delete(/** @type {string} */ (images.keys().next().value));
  return found;
}

/**
 * The pyramid's level for so many pixels of the screen to a pixel of level 0.
 * @param {number} scale @param {number} levels
 */
export function levelFor(scale, levels) {
  const perPixel = scale * (globalThis.devicePixelRatio || 1);
  // design: a tile is enlarged by 27 % at most before a finer one is taken.
  return Math.min(levels - 1, Math.max(0, Math.floor(Math.log2(1 / perPixel) + 0.35)));
}

/**
 * True when nothing that is still to come would change it.
 * @param {Context} context @param {Layer} layer
 * @param {{ x: number, y: number, scale: number }} frame layer's place in the corner, and scale
 * @param {Pair} size
 */
export function drawLayer(context, layer, frame, size) {
  const { level, side, first, last } = covering(layer, frame, size);
  context.imageSmoothingEnabled = true;
  context.imageSmoothingQuality = "high";
  const at = (/** @type {number} */ value, /** @type {number} */ corner) =>
    Math.round((value - corner) * frame.scale);
  let whole = true;
  context.save();
  if (layer.extent) {
    const [right, bottom] = layer.extent;
    context.beginPath();
    context.rect(-frame.x * frame.scale, -frame.y * frame.scale,
      right * frame.scale, bottom * frame.scale);
    context.clip();
  }
  // Tiles on whole pixels of the screen leave no seams. Where one measures, a tile lies exactly
  // where it belongs as well, over that.
  const exact = frame.scale * layer.pixel >= 3;
  const exactSide = side * frame.scale;
  for (const exactly of exact ? [false, true] : [false]) {
    for (let row = first[1]; row <= last[1]; row += 1) {
      for (let column = first[0]; column <= last[0]; column += 1) {
        const [x, y] = [column * side, row * side];
        const [left, top] = [at(x, frame.x), at(y, frame.y)];
        const box = exactly
          ? [(x - frame.x) * frame.scale, (y - frame.y) * frame.scale, exactSide, exactSide]
          : [left, top, at(x + side, frame.x) - left, at(y + side, frame.y) - top];
        whole = drawTile(context, layer, [level, column, row], box) && whole;
      }
    }
  }
  context.restore();
  return whole;
}

/**
 * @param {Layer} layer @param {{ x: number, y: number, scale: number }} frame @param {Pair} size
 */
function covering(layer, frame, [width, height]) {
  const level = levelFor(frame.scale * layer.pixel, layer.levels);
  const side = SIDE * layer.pixel * 2 ** level;
  const [right, low] = [frame.x + width / frame.scale, frame.y + height / frame.scale];
  const [least, top, most, bottom] = layer.box ?? [-Infinity, -Infinity, Infinity, Infinity];
  const tile = (/** @type {number} */ place) => Math.floor(place / side);
  return { level, side, first: [tile(Math.max(frame.x, least)), tile(Math.max(frame.y, top))],
    last: [tile(Math.min(right, most)), tile(Math.min(low, bottom))] };
}

/**
 * Ask for the tiles of a view that will be looked at soon.
 * @param {Layer} layer @param {{ x: number, y: number, scale: number }} frame @param {Pair} size
 */
export function fetchAhead(layer, frame, size) {
  const { level, first, last } = covering(layer, frame, size);
  for (let row = first[1]; row <= last[1]; row += 1) {
    for (let column = first[0]; column <= last[0]; column += 1) {
      image(layer.address(level, column, row), true);
    }
  }
}

/**
 * The tile as it was drawn before, where it is still there.
 * @param {Layer} layer @param {number[]} tile
 */
function olderTile(layer, [level, column, row]) {
  for (let { older } = layer; older; { older } = older) {
    const known = state.images.get(older.address(level, column, row));
    if (known?.ready) return known;
  }
  return null;
}

/** @param {Context} context @param {Layer} layer @param {number[]} tile @param {number[]} box */
function drawTile(context, layer, [level, column, row], [left, top, width, height]) {
  const tile = image(layer.address(level, column, row));
  const there = tile.ready ? tile : olderTile(layer, [level, column, row]);
  if (there) {
    context.drawImage(there, left, top, width, height);
    return there === tile;
  }
  for (let up = 1; up <= 4 && level + up < layer.levels; up += 1) {
    const part = 2 ** up;
    const [over, down] = [Math.floor(column / part), Math.floor(row / part)];
    const coarse = state.images.get(layer.address(level + up, over, down));
    if (coarse?.ready) {
      const side = SIDE / part;
      const [x, y] = [(column - over * part) * side, (row - down * part) * side];
      context.drawImage(coarse, x, y, side, side, left, top, width, height);
      break;
    }
  }
  return tile.failed === true;
}

/** A place on the ortho's layer, metres from the lattice's corner. @param {Pair} ground */
export const layerFromGround = ([east, north]) =>
  [east - start.lattice.west, start.lattice.north - north];

/** @param {Pair} place */
export const groundFromLayer = ([x, y]) => [start.lattice.west + x, start.lattice.north - y];

// The browser keeps tiles for a day: an address never means another block or another day's desk.
const query = (/** @type {boolean} */ wallis) => `?e=${start.edition}${wallis ? "&wallis=1" : ""}`;

/**
 * The reference, or that of another year by its number.
 * @param {boolean} wallis @param {number} [year] @returns {Layer}
 */
export function orthoLayer(wallis, year) {
  const { pixel, levels, width, height } = start.lattice;
  const source = year === undefined ? "ortho" : `year/${year}`;
  return { pixel, levels, extent: [width, height],
    address: (l, c, r) => `/tiles/${source}/${l}/${c}/${r}${query(wallis)}` };
}

/**
 * The mosaic; while it is drawn anew it is seen as it was.
 * Only where seams were edited the tiles are others than those of the file.
 * @param {Mosaic} mosaic @param {boolean} wallis @param {Mosaic | null} before
 * @returns {Layer}
 */
export function mosaicLayer({ version, bounds = [], edition = 0, changed }, wallis, before = null) {
  const { pixel, levels } = start.lattice;
  const [west, south, east, north] = bounds;
  const box = [...layerFromGround([west, north]), ...layerFromGround([east, south])];
  const older = before && mosaicLayer(before, wallis);
  const [left, low, right, high] = changed ?? [Infinity, Infinity, -Infinity, -Infinity];
  const ofSeams = (/** @type {number} */ l, /** @type {number} */ c, /** @type {number} */ r) => {
    // A seam is felt some pixels beside it, and further where contrast is evened out.
    const [side, room] = [SIDE * pixel * 2 ** l, SIDE * pixel * 2 ** l / 4];
    const [x, y] = groundFromLayer([c * side, r * side]);
    const there = x - room < right && x + side + room > left && y + room > low
      && y - side - room < high;
    return there ? edition : 0;
  };
  return { pixel, levels, box, older, address: (l, c, r) =>
    `/tiles/mosaic/${version}/${ofSeams(l, c, r)}/${l}/${c}/${r}${query(wallis)}` };
}

/**
 * A photo that moved is drawn where it was until it is drawn anew.
 * @param {string} photo @param {number} version @param {boolean} wallis @returns {Layer}
 */
export function scanLayer(photo, version, wallis, back = OLDER) {
  const { pixel, levels } = start.lattice;
  const folder = `/tiles/scan/${encodeURIComponent(photo)}/${version}`;
  const older = version > 1 && back > 0 ? scanLayer(photo, version - 1, wallis, back - 1) : null;
  return { pixel, levels, older,
    address: (l, c, r) => `${folder}/${l}/${c}/${r}${query(wallis)}` };
}

/**
 * @param {string} photo @param {number} version @param {Pair} size @param {boolean} wallis
 * @returns {Layer}
 */
export function rawLayer(photo, version, size, wallis) {
  const levels = 1 + Math.max(0, Math.ceil(Math.log2(Math.max(...size) / 512)));
  const folder = `/tiles/raw/${encodeURIComponent(photo)}/${version}`;
  return { pixel: 1, levels, address: (l, c, r) => `${folder}/${l}/${c}/${r}${query(wallis)}` };
}
