// Which level of a pyramid is shown, which tiles of it, and under which address.
import assert from "node:assert/strict";
import test from "node:test";

import { start } from "../../ui/web/pages/words.js";
import { windowOf } from "../../ui/web/pages/fiducial.js";
import {
  groundFromLayer, layerFromGround, levelFor, rawLayer, scanLayer,
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
