// Tiles: fetched when first needed, kept while they fit, drawn with the best that is there already.
import { start } from "/pages/words.js";

const SIDE = 256;
const KEPT = 600;
const TRIES = 40;
const AGAIN_MS = 500;
const images = new Map();
const waiting = new Set();
const redraw = () => waiting.forEach((callback) => callback());
export function onTile(callback) { waiting.add(callback); }

function image(address, ahead = false) {
  let found = images.get(address);
  if (found) {
    images.delete(address);
    images.set(address, found);
    return found;
  }
  found = new Image();
  found.decoding = "async";
  if (ahead) found.fetchPriority = "low";
  found.onload = () => { found.ready = true; redraw(); };
  let tries = 0;
  // The ortho may still be read for the first time: a tile that is not there yet is asked for again.
  found.onerror = () => {
    if (tries >= TRIES || !address.startsWith("/tiles/ortho/")) { found.failed = true; return; }
    tries += 1;
    setTimeout(() => { if (images.has(address)) found.src = address; }, AGAIN_MS);
  };
  found.src = address;
  images.set(address, found);
  while (images.size > KEPT) images.delete(images.keys().next().value);
  return found;
}

// A layer is {address(level, column, row), levels, pixel, limits?}; its own frame counts x right and
// y down in units of `pixel` at level 0. `view` gives the layer coordinates of the canvas' corner and
// css pixels per unit. True when nothing that is still to come would change it.
export function drawLayer(context, layer, view, width, height) {
  const { level, size, first, last } = covering(layer, view, width, height);
  context.imageSmoothingEnabled = true;
  context.imageSmoothingQuality = "high";
  const at = (value, corner) => Math.round((value - corner) * view.scale);
  let whole = true;
  // Tiles on whole pixels of the screen leave no seams. Where one measures, a tile lies exactly where
  // it belongs as well, over that.
  const exact = view.scale * layer.pixel >= 3;
  const side = size * view.scale;
  for (const exactly of exact ? [false, true] : [false]) {
    for (let row = first[1]; row <= last[1]; row += 1) {
      for (let column = first[0]; column <= last[0]; column += 1) {
        const left = at(column * size, view.x);
        const top = at(row * size, view.y);
        const box = exactly ? [(column * size - view.x) * view.scale, (row * size - view.y) * view.scale, side, side]
          : [left, top, at((column + 1) * size, view.x) - left, at((row + 1) * size, view.y) - top];
        whole = drawTile(context, layer, level, column, row, box) && whole;
      }
    }
  }
  return whole;
}

function covering(layer, view, width, height) {
  const perPixel = view.scale * layer.pixel * (window.devicePixelRatio || 1);
  const level = Math.min(layer.levels - 1, Math.max(0, Math.floor(Math.log2(1 / perPixel) + 0.35)));
  const size = SIDE * layer.pixel * 2 ** level;
  const first = [Math.floor(view.x / size), Math.floor(view.y / size)];
  const last = [Math.floor((view.x + width / view.scale) / size), Math.floor((view.y + height / view.scale) / size)];
  return { level, size, first, last };
}

// Ask for the tiles of a view that will be looked at soon.
export function fetchAhead(layer, view, width, height) {
  const { level, first, last } = covering(layer, view, width, height);
  for (let row = first[1]; row <= last[1]; row += 1) {
    for (let column = first[0]; column <= last[0]; column += 1) image(layer.address(level, column, row), true);
  }
}

function drawTile(context, layer, level, column, row, box) {
  const tile = image(layer.address(level, column, row));
  if (tile.ready) {
    context.drawImage(tile, ...box);
    return true;
  }
  for (let up = 1; up <= 4 && level + up < layer.levels; up += 1) {
    const part = 2 ** up;
    const [over, down] = [Math.floor(column / part), Math.floor(row / part)];
    const address = layer.address(level + up, over, down);
    const coarse = images.get(address);
    if (coarse?.ready) {
      const side = SIDE / part;
      context.drawImage(coarse, (column - over * part) * side, (row - down * part) * side, side, side, ...box);
      break;
    }
  }
  return tile.failed === true;
}

// The browser keeps tiles for a day: an address must never mean another block or another day's desk.
const query = (wallis) => `?e=${start.edition}${wallis ? "&wallis=1" : ""}`;

export function orthoLayer(wallis) {
  const { pixel, levels } = start.lattice;
  return { pixel, levels, address: (l, c, r) => `/tiles/ortho/${l}/${c}/${r}${query(wallis)}` };
}

export function scanLayer(photo, version, wallis) {
  const { pixel, levels } = start.lattice;
  const name = encodeURIComponent(photo);
  return { pixel, levels, address: (l, c, r) => `/tiles/scan/${name}/${version}/${l}/${c}/${r}${query(wallis)}` };
}

export function rawLayer(photo, version, size, wallis) {
  const levels = 1 + Math.max(0, Math.ceil(Math.log2(Math.max(...size) / 512)));
  const name = encodeURIComponent(photo);
  return { pixel: 1, levels, address: (l, c, r) => `/tiles/raw/${name}/${version}/${l}/${c}/${r}${query(wallis)}` };
}
