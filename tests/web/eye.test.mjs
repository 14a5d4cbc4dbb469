// The eye in the 3D scene as numbers: rays, north and the scale, without viser.
import assert from "node:assert/strict";
import test from "node:test";

import { eyeOf, northOf, pixelMetres, rayThrough } from "../../ui/web/pages/eye.js";
import { isChoice } from "../../ui/web/pages/sight.js";

const near = (found, wanted, within = 1e-9) => found.forEach((value, i) =>
  assert.ok(Math.abs(value - wanted[i]) <= within, `${found} is not ${wanted}`));

/** Above the origin, looking down, east to the right. */
const DOWN = {
  at: [0, 0, 1000], right: [1, 0, 0], up: [0, 1, 0], forward: [0, 0, -1], slope: 0.5,
  size: [800, 400],
};

test("the middle of the screen looks straight ahead__truth", () => {
  near(rayThrough(DOWN, [400, 200]), [0, 0, 1000, 0, 0, -1]);
});

test("a ray meets the ground where the scale says__law", () => {
  const pixel = pixelMetres(DOWN, 200);
  assert.equal(pixel, (2 * 0.5 * 800) / 400);
  const [, , , x, y, z] = rayThrough(DOWN, [400 + 60, 200 - 90]);
  near([(x / -z) * 800, (y / -z) * 800], [60 * pixel, 90 * pixel]);
});

test("without ground in the middle of the screen there is no scale__truth", () => {
  assert.equal(pixelMetres({ ...DOWN, forward: [0, 1, 0] }, 0), null);
  assert.equal(pixelMetres({ ...DOWN, at: [0, 0, -5] }, 0), null);
});

test("north turns with the eye__truth", () => {
  near(northOf(DOWN), [0, 1]);
  near(northOf({ ...DOWN, right: [0, -1, 0], up: [1, 0, 0] }), [-1, 0]);
});

test("viser's own axes are turned into east, north, up__truth", () => {
  // Its world has y up; the frame of the scene turns z up into it.
  const frame = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1];
  const camera = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 7, -9, 1];
  const found = eyeOf({ __viserMutable: {
    camera: { fov: 90, matrixWorld: { elements: camera } },
    canvas: { clientWidth: 300, clientHeight: 200 },
    nodeRefFromName: { "/footprints": { matrixWorld: { elements: frame } } },
  } });
  near(found.at, [5, 9, 7]);
  near(found.up, [0, 0, 1]);
  near(found.forward, [0, 1, 0]);
  near([found.slope], [1]);
  assert.equal(eyeOf({}), null);
});

test("a click chooses; a drag and the second click of a double click do not__law", () => {
  const click = (detail, clientX) => isChoice({ detail, clientX, clientY: 20 }, [10, 20]);
  assert.ok(click(1, 10) && click(1, 13));
  assert.ok(!click(1, 90) && !click(2, 10) && !click(3, 10));
});
