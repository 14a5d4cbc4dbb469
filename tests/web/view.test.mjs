// Pan and zoom, and the affine maps between pictures: nothing of it needs a page.
import assert from "node:assert/strict";
import test from "node:test";

import { scaleBar } from "../../ui/web/pages/overlay.js";
import {
  View, afterPause, inverse, isStill, letterOf, mapped, roundLength, scaleOf,
} from "../../ui/web/pages/view.js";

const SIZE = [640, 400];
const near = (found, wanted, within = 1e-9) => found.forEach((value, i) =>
  assert.ok(Math.abs(value - wanted[i]) <= within, `${found} is not ${wanted}`));

test("the middle of the layer lies in the middle of the pane__truth", () => {
  const view = new View().show([100, 50], 2);
  near(view.screenFromLayer([100, 50], SIZE), [320, 200]);
  near(view.screenFromLayer([110, 45], SIZE), [340, 190]);
});

test("screen and layer lead to each other__law", () => {
  const view = new View().show([742000.25, 1040000.5], 0.37);
  for (const screen of [[0, 0], [639, 1], [12.5, 400]]) {
    near(view.screenFromLayer(view.layerFromScreen(screen, SIZE), SIZE), screen, 1e-6);
  }
});

test("a frame begins where the corner of the pane lies__law", () => {
  const view = new View().show([30, 40], 4);
  const { x, y, scale } = view.frame(SIZE);
  near(view.screenFromLayer([x, y], SIZE), [0, 0]);
  assert.equal(scale, 4);
});

test("what is panned follows the hand__law", () => {
  const view = new View().show([30, 40], 4);
  const held = view.layerFromScreen([100, 100], SIZE);
  view.pan(held, view.layerFromScreen([180, 70], SIZE));
  near(view.screenFromLayer(held, SIZE), [180, 70]);
});

test("zooming leaves the place under the pointer where it is__law", () => {
  const view = new View(0.01, 50).show([30, 40], 4);
  const held = view.layerFromScreen([11, 222], SIZE);
  for (const factor of [1.25, 3, 100, 0.001, 0.2]) {
    view.zoom(factor, held);
    near(view.screenFromLayer(held, SIZE), [11, 222], 1e-6);
  }
});

test("zooming stops at its limits__truth", () => {
  const view = new View(0.5, 8).show([30, 40], 4);
  view.zoom(10);
  assert.equal(view.scale, 8);
  view.zoom(0.001);
  assert.equal(view.scale, 0.5);
  near([view.x, view.y], [30, 40]);
});

test("what filled the pane fills it again until a hand moves it__law", () => {
  const view = new View(0.01, 50).fit([0, 0], [200, 100], SIZE);
  const larger = [1280, 800];
  view.refit(larger);
  near(view.screenFromLayer([0, 0], larger), [0, 80]);
  view.refit([0, 0]);
  near(view.screenFromLayer([200, 100], larger), [1280, 720]);
  for (const act of [
    (v) => v.pan([0, 0], [1, 0]), (v) => v.zoom(2), (v) => v.show([100, 50], v.scale),
  ]) {
    view.fit([0, 0], [200, 100], larger);
    act(view);
    const { x, y, scale } = view;
    view.refit(SIZE);
    assert.deepEqual([view.x, view.y, view.scale], [x, y, scale]);
  }
});

test("a view of nothing is not zoomed__law", () => {
  const view = new View(0.5, 8);
  view.zoom(2);
  assert.equal(view.scale, 0);
});

test("a box that is fitted fills its share of the pane and lies in its middle__truth", () => {
  const view = new View().fit([10, 20], [90, 30], SIZE, 0.5);
  assert.equal(view.scale, 4);
  near(view.screenFromLayer([10, 20], SIZE), [160, 180]);
  near(view.screenFromLayer([90, 30], SIZE), [480, 220]);
});

test("an affine map and its inverse undo each other__law", () => {
  const matrix = [[0.3, -1.1, 5000], [-0.9, -0.35, -700]];
  const place = [-742000.5, -1040000.25];
  near(mapped(inverse(matrix), mapped(matrix, place)), place, 1e-6);
});

test("the scale of a map is that of areas__truth", () => {
  assert.equal(scaleOf([[0, 2, 9], [-2, 0, 9]]), 2);
  assert.equal(scaleOf([[2, 0, 0], [0, 8, 0]]), 4);
});

test("several steps in a row are done once, with the last one's values__truth", (context) => {
  context.mock.timers.enable({ apis: ["setTimeout"] });
  const done = [];
  const place = afterPause((...values) => done.push(values), 400);
  place(1, "a");
  context.mock.timers.tick(399);
  place(2, "b");
  context.mock.timers.tick(399);
  assert.deepEqual(done, []);
  context.mock.timers.tick(1);
  assert.deepEqual(done, [[2, "b"]]);
});

test("a key is the letter printed on it, by place only in another alphabet__truth", () => {
  assert.equal(letterOf({ key: "y", code: "KeyZ" }), "KeyY");
  assert.equal(letterOf({ key: "Z", code: "KeyY" }), "KeyZ");
  assert.equal(letterOf({ key: "\u043d", code: "KeyY" }), "KeyY");
  assert.equal(letterOf({ key: "Enter", code: "NumpadEnter" }), "Enter");
});

test("a scale bar is 1, 2 or 5 times a power of ten__truth", () => {
  const found = [80, 50, 49.9, 19, 7, 1, 0.3].map(roundLength);
  near(found, [50, 50, 20, 10, 5, 1, 0.2], 1e-12);
});

test("a scale bar fits and fills at least two fifths of its room__law", () => {
  for (let most = 0.013; most < 9000; most *= 1.07) {
    const share = roundLength(most) / most;
    assert.ok(share <= 1 + 1e-9 && share > 0.4 - 1e-9, `${most}`);
  }
});

test("a picture zoomed far out is not enlarged nought times__truth", () => {
  const told = [];
  const context = new Proxy({}, {
    get: (_, name) => name === "fillText" ? (words) => told.push(words) : () => ({ width: 60 }),
    set: () => true,
  });
  for (const scale of [2, 0.3, 0.04, 0.0002]) scaleBar(context, [400, 300], scale, 1);
  assert.deepEqual(told.filter((words) => words.endsWith("\u00d7")),
    ["2.0\u00d7", "0.3\u00d7", "0.04\u00d7", "0.0002\u00d7"]);
});

test("a press that moves three pixels is a drag, and a finger may roll__truth", () => {
  assert.ok(isStill([10, 10], [11, 11], "mouse") && !isStill([10, 10], [13, 10], "mouse"));
  assert.ok(isStill([10, 10], [16, 14], "touch") && !isStill([10, 10], [19, 10], "touch"));
});
