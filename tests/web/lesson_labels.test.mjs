// Labels of a lesson's drawing: none lies over another, and none is cut.
import assert from "node:assert/strict";
import test from "node:test";

import { placesOf } from "../../ui/web/pages/lesson_labels.js";

const SIZE = [400, 300];
const SIDES = ["right", "left", "right-under", "left-under", "over", "under"];
const label = (at, width = 60) => ({ at, width, sides: SIDES });
const boxes = (labels, taken = []) => placesOf(labels, taken, SIZE).map(([x, y], number) =>
  [x, y - 12, x + labels[number].width, y + 4]);
const apart = (one, other) => one[2] <= other[0] || other[2] <= one[0] || one[3] <= other[1]
  || other[3] <= one[1];

test("a label alone stands to the right of its place__law", () => {
  assert.deepEqual(placesOf([label([100, 100])], [], SIZE), [[109, 94]]);
});

test("labels of one place lie beside each other__law", () => {
  const found = boxes(Array.from({ length: 6 }, () => label([200, 150])));
  found.forEach((one, number) => found.slice(number + 1).forEach((other) =>
    assert.ok(apart(one, other), `${one} lies over ${other}`)));
});

test("a label at the edge stays within the drawing__law", () => {
  for (const at of [[399, 1], [1, 299], [1, 1], [399, 299]]) {
    const [[left, upper, right, lower]] = boxes([label(at)]);
    assert.ok(left >= 0 && upper >= 0 && right <= SIZE[0] && lower <= SIZE[1], `${at}`);
  }
});

test("a label leaves what is taken free__law", () => {
  const mark = [105, 80, 180, 110];
  assert.ok(apart(boxes([label([100, 100])], [mark])[0], mark));
});

test("where all is taken the least is covered__law", () => {
  assert.equal(placesOf([label([200, 150])], [[0, 0, 400, 300]], SIZE).length, 1);
});
