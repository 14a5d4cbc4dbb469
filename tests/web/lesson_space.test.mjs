// Drawings in space, as they are seen from a side.
import assert from "node:assert/strict";
import test from "node:test";

import { STANCES, seenFrom } from "../../ui/web/pages/lesson_space.js";

const BOX = [-100, -50, 0, 100, 50, 80];
const cube = (points) => ({ name: "", unit: "m", equal: true, window: BOX,
  shapes: [{ kind: "line", look: "ray", points }] });
const seen = (point, stance) => seenFrom(cube([point]), stance).shapes[0].points[0];
const near = (one, other) => one.forEach((value, axis) =>
  assert.ok(Math.abs(value - other[axis]) < 1e-9, `${one} is not ${other}`));

test("from the side east is right and height is up, from above north is up", () => {
  near(seen([3, 4, 5], STANCES.side), [3, 5]);
  near(seen([3, 4, 5], STANCES.above), [3, 4]);
  near(seen([3, 4, 5], [90, 0]), [4, 5]);
});

test("a turned length is never longer, and along the screen it stays", () => {
  for (const stance of [[-30, 22], [140, -10], [77, 65]]) {
    const turn = (stance[0] * Math.PI) / 180;
    const across = seen([Math.cos(turn), Math.sin(turn), 0], stance);
    near(across, [1, 0]);
    assert.ok(Math.hypot(...seen([0.6, 0, 0.8], stance)) <= 1 + 1e-12);
  }
});

test("the window holds the whole box from every side", () => {
  for (const stance of Object.values(STANCES)) {
    const corner = seenFrom(cube([[-100, -50, 0], [100, 50, 80], [100, -50, 0]]), stance);
    const [left, lower, right, upper] = corner.window;
    for (const [x, y] of corner.shapes[0].points) {
      assert.ok(left < x && x < right && lower < y && y < upper);
    }
  }
});
