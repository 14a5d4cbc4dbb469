// Whose part of the mosaic a place lies in, and which tiles of it are asked for.
import assert from "node:assert/strict";
import test from "node:test";

import {
  dragCorner, editKey, editState, gripCorner, putCorner, setUpEdit, tapCorner,
} from "../../ui/web/pages/mosaic_edit.js";
import { photoAt, roomFor } from "../../ui/web/pages/mosaic_marks.js";
import { comparedYear } from "../../ui/web/pages/mosaic_years.js";
import { fetchAhead, mosaicLayer, orthoLayer } from "../../ui/web/pages/tiles.js";
import { start } from "../../ui/web/pages/words.js";

start.edition = "today";
start.lattice = { west: 1000, north: 5000, pixel: 0.5, levels: 6, width: 4000, height: 3000 };

const box = (west, south, east, north) => [[west, south], [east, south], [east, north],
  [west, north]];
const SEAMS = [
  { photo: "a", rings: [box(0, 0, 100, 100), box(40, 40, 60, 60)] },
  { photo: "b", rings: [box(40, 40, 60, 60)] },
  { photo: "c", rings: [box(100, 0, 200, 100), box(300, 0, 310, 10)] },
];

test("a place belongs to the part that holds it, not to one that goes round it__truth", () => {
  assert.equal(photoAt(SEAMS, [10, 10]), "a");
  assert.equal(photoAt(SEAMS, [50, 50]), "b");
  assert.equal(photoAt(SEAMS, [150, 50]), "c");
  assert.equal(photoAt(SEAMS, [305, 5]), "c");
  assert.equal(photoAt(SEAMS, [250, 50]), "");
});

test("no tile is asked for where there is no mosaic__law", () => {
  const asked = [];
  globalThis.Image = class {
    set src(address) {
      asked.push(address);
    }
  };
  const mosaic = { version: 12, stale: [], bounds: [1100, 4000, 1300, 4900] };
  const layer = mosaicLayer(mosaic, true, { ...mosaic, version: 11 });
  assert.equal(layer.older.address(0, 1, 2), "/tiles/mosaic/11/0/0/1/2?e=today&wallis=1");
  fetchAhead(layer, { x: -5000, y: -5000, scale: 2 }, [40000, 40000]);
  const columns = new Set(asked.map((address) => Number(address.split("/")[6])));
  const rows = new Set(asked.map((address) => Number(address.split("/")[7].split("?")[0])));
  // 128 m a tile: from 100 to 300 m east of the corner, from 100 to 1000 m south of it.
  assert.deepEqual([Math.min(...columns), Math.max(...columns)], [0, 2]);
  assert.deepEqual([Math.min(...rows), Math.max(...rows)], [0, 7]);
  assert.ok(asked[0].startsWith("/tiles/mosaic/12/0/0/"));
});

test("only tiles near an edited seam are others than those of the file__law", () => {
  const mosaic = { version: 12, stale: [], edition: 77, changed: [1300, 4700, 1350, 4720] };
  const { address } = mosaicLayer(mosaic, false);
  const editions = (level, tiles) =>
    tiles.map(([column, row]) => Number(address(level, column, row).split("/")[4]));
  // 128 m a tile: the edit lies from 300 to 350 m east and 280 to 300 m south of the corner.
  assert.deepEqual(editions(0, [[2, 2], [3, 2], [0, 2], [2, 0], [5, 2], [2, 4]]),
    [77, 0, 0, 0, 0, 0]);
  assert.deepEqual(editions(3, [[0, 0], [1, 0]]), [77, 0]);
});

test("words of a place are whole, beside no arrow and over no other words__law", () => {
  const size = [400, 300];
  const told = ([x, y]) => [x, y - 13, x + 40, y];
  const [x, y] = roomFor(40, [200, 150], false, size, []);
  assert.ok(y - 13 > 150 && x < 200, "below the mark, not behind its arrow");
  assert.ok(roomFor(40, [200, 150], true, size, [])[1] < 150, "above an arrow that points down");
  assert.ok(roomFor(40, [398, 150], false, size, [])[0] + 40 <= 400);
  assert.ok(roomFor(40, [200, 299], false, size, [])[1] <= 300);
  const taken = [told([x, y])];
  const [left, top, right, bottom] = told(roomFor(40, [200, 150], false, size, taken));
  const [a, b, c, d] = taken[0];
  assert.ok(right < a || left > c || bottom < b || top > d);
});

test("what is drawn too short says so, and loses any corner__law", () => {
  setUpEdit(() => {});
  editKey("KeyP", [0, 0]);
  editKey("Enter", [0, 0]);
  assert.equal(editState().said, "");
  const onScreen = (ground) => ground;
  for (const corner of [[0, 0], [50, 0], [100, 0]]) putCorner(corner, onScreen);
  // The middle one is nearest, though the last was set last.
  editKey("Delete", [44, 9]);
  assert.deepEqual(editState().places, [[0, 0], [100, 0]]);
  editKey("Enter", [0, 0]);
  assert.equal(editState().said, "mask.few");
  editKey("Backspace", [0, 0]);
  assert.deepEqual([editState().places, editState().said], [[[0, 0]], ""]);
  editKey("KeyL", [0, 0]);
  putCorner([0, 0], onScreen);
  // A double click sets a corner and ends there.
  assert.ok(gripCorner([3, 3], onScreen));
  tapCorner();
  assert.equal(editState().said, "mosaic.edit.line.few");
  // Dropped while a hand holds a corner of it: nothing is left to drag.
  assert.ok(gripCorner([3, 3], onScreen));
  editKey("Escape", [0, 0]);
  assert.ok(!dragCorner([9, 9]));
  assert.deepEqual(editState().places, []);
  editKey("Escape", [0, 0]);
  assert.equal(editState().tool, "");
});

test("the reference is compared with until a year is chosen__law", () => {
  Object.assign(start, { ortho: true, years: [1953, 1984], words: { "pane.ortho": "Ortho" } });
  assert.deepEqual(comparedYear(), [undefined, "Ortho"]);
  assert.equal(orthoLayer(false).address(2, 3, 4), "/tiles/ortho/2/3/4?e=today");
  assert.equal(orthoLayer(true, 0).address(2, 3, 4), "/tiles/year/0/2/3/4?e=today&wallis=1");
});
