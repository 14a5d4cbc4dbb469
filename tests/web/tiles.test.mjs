// Which level of a pyramid is shown, which tiles of it, and under which address.
import assert from "node:assert/strict";
import test from "node:test";

import { start } from "../../ui/web/pages/words.js";
import { windowOf } from "../../ui/web/pages/fiducial.js";
import {
  drawLayer, fetchAhead, groundFromLayer, layerFromGround, levelFor, onTile, orthoLayer, rawLayer,
  scanLayer,
} from "../../ui/web/pages/tiles.js";

start.edition = "today";
start.lattice = { west: -742000, north: -1040000, pixel: 0.5, levels: 6 };

test("halving the scale takes the next level, between the first and the last__truth", () => {
  assert.deepEqual([8, 1, 0.5, 0.25].map((scale) => levelFor(scale, 6)), [0, 0, 1, 2]);
  assert.equal(levelFor(1e-6, 6), 5);
});

test("a coarser level is enlarged by 27 % at most before a finer one is taken__law", () => {
  for (let scale = 0.02; scale < 1; scale *= 1.01) {
    assert.ok(scale * 2 ** levelFor(scale, 20) < 1.2747);
  }
});

test("a place on the ground and on the layer lead to each other__law", () => {
  assert.deepEqual(layerFromGround([-741990, -1040020]), [10, 20]);
  assert.deepEqual(groundFromLayer([10, 20]), [-741990, -1040020]);
});

test("addresses hold the name, the version and the edition__truth", () => {
  const name = "roll 1/a";
  assert.equal(scanLayer(name, 3, true).address(2, 5, 7),
    "/tiles/scan/roll%201%2Fa/3/2/5/7?e=today&wallis=1");
  assert.equal(rawLayer(name, 3, [512, 400], false).levels, 1);
  assert.equal(rawLayer(name, 3, [9000, 8000], false).levels, 6);
});

test("a window has whole corners and a power of two, and holds its middle__law", () => {
  const row = { photo: "a", version: 1 };
  for (const side of [84, 300, 1000, 4321]) {
    const { left, top, side: across, address } = windowOf(row, [1234.6, 987.2], side, 168);
    const [pixels, reduction] = address.split("?")[0].split("/").slice(-2).map(Number);
    assert.ok(Number.isInteger(left) && Number.isInteger(top));
    assert.equal(Math.log2(reduction) % 1, 0);
    assert.equal(pixels * reduction, across);
    assert.ok(Math.abs(left + across / 2 - 1234.6) <= 0.5);
    assert.ok(Math.abs(top + across / 2 - 987.2) <= 0.5);
  }
});

/** Pictures as the browser loads them: each is told when it has come. */
const state = { asked: new Map() };
const { asked } = state;
globalThis.Image = class {
  set src(address) {
    this.address = address;
    asked.set(address, this);
  }
};
const SIZE = [512, 256];
const LAYER = { pixel: 1, levels: 4, address: (l, c, r) => `/tiles/scan/${l}/${c}/${r}` };

/** Keeps what is drawn, and where it is cut off. */
const contextFor = (pictures, cuts = []) => ({
  save() {}, restore() {}, beginPath() {}, clip() {},
  rect: (...box) => cuts.push(box), drawImage: (...values) => pictures.push(values),
});

function drawn(frame) {
  const pictures = [];
  const whole = drawLayer(contextFor(pictures), LAYER, frame, SIZE);
  return { pictures, whole };
}

test("a view asks for the tiles it shows and draws them once they have come__truth", () => {
  asked.clear();
  let told = 0;
  onTile(() => {
    told += 1;
  });
  const frame = { x: 256, y: 256, scale: 1 };
  assert.deepEqual(drawn(frame), { pictures: [], whole: false });
  const names = [...asked.keys()];
  assert.ok(["/tiles/scan/0/1/1", "/tiles/scan/0/2/1"].every((name) => names.includes(name)));
  for (const picture of asked.values()) picture.onload();
  assert.equal(told, names.length);
  const { pictures, whole } = drawn(frame);
  assert.ok(whole);
  const first = pictures.find(([picture]) => picture.address === "/tiles/scan/0/1/1");
  assert.deepEqual(first.slice(1), [0, 0, 256, 256]);
});

test("what was asked for ahead tells nobody before a view shows it__law", () => {
  asked.clear();
  let told = 0;
  onTile(() => {
    told += 1;
  });
  const frame = { x: 4096, y: 256, scale: 1 };
  fetchAhead(LAYER, frame, SIZE);
  const [first, ...others] = asked.values();
  first.onload();
  assert.equal(told, 0);
  drawn(frame);
  for (const picture of others) picture.onload();
  assert.equal(told, others.length);
});

test("until a tile has come a part of a coarser one stands in its place__truth", () => {
  asked.clear();
  fetchAhead(LAYER, { x: 2048, y: 2048, scale: 0.5 }, SIZE);
  const coarse = asked.get("/tiles/scan/1/4/4");
  coarse.onload();
  const { pictures, whole } = drawn({ x: 2304, y: 2048, scale: 1 });
  assert.equal(whole, false);
  const [picture, x, y, width, height, left, top] = pictures[0];
  assert.equal(picture, coarse);
  assert.deepEqual([x, y, width, height, left, top], [128, 0, 128, 128, 0, 0]);
});

test("a photo that moved is drawn where it was until its new tiles have come__law", () => {
  asked.clear();
  const frame = { x: 0, y: 0, scale: 2 };
  const pictures = [];
  const draw = (version) =>
    drawLayer(contextFor(pictures), scanLayer("moved", version, false), frame, [100, 100]);
  draw(1);
  for (const picture of asked.values()) picture.onload();
  assert.ok(draw(1));
  const old = pictures.at(-1)[0];
  asked.clear();
  pictures.length = 0;
  assert.equal(draw(3), false);
  assert.equal(pictures.at(-1)?.[0], old);
  for (const picture of asked.values()) picture.onload();
  assert.ok(draw(3));
  assert.notEqual(pictures.at(-1)[0], old);
});

test("beyond its extent a layer draws nothing__truth", () => {
  const cuts = [];
  const layer = { ...LAYER, extent: [300, 200] };
  drawLayer(contextFor([], cuts), layer, { x: 100, y: 50, scale: 2 }, SIZE);
  assert.deepEqual(cuts, [[-200, -100, 600, 400]]);
  // The ortho ends where its files do, not where its last tile does.
  Object.assign(start.lattice, { width: 1300, height: 900 });
  assert.deepEqual(orthoLayer(false).extent, [1300, 900]);
});

test("a tile of a scan that is not there is drawn no more, and the view is whole__law", () => {
  asked.clear();
  const frame = { x: 9216, y: 9216, scale: 1 };
  drawn(frame);
  for (const picture of asked.values()) picture.onerror();
  assert.ok(drawn(frame).whole);
});
