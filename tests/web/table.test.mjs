// The table of the queue: put together from pieces, sieved and counted.
import assert from "node:assert/strict";
import test from "node:test";

import { extended, sifted, toldRow } from "../../ui/web/pages/queue.js";
import { mergeRows } from "../../ui/web/pages/wire.js";

const row = (point, photo, role, state, disputed = null) =>
  [point, photo, role, state, 0, 0.5, 1, 2, disputed];
const ROWS = [
  row("1", "a", "control", "auto"), row("1", "b", "control", "rejected"),
  row("2", "a", "check", "unused"), row("t", "a", "tie", "auto"),
];
const ALL = { state: "all", photo: "", role: "", text: "", area: [] };
const ORDER = [3, 2, 1, 0];

test("points are shown in their order, ties only when they are asked for__truth", () => {
  assert.deepEqual(sifted(ROWS, ORDER, ALL).shown, [2, 1, 0]);
  assert.deepEqual(sifted(ROWS, ORDER, { ...ALL, role: "tie" }).shown, [3]);
  assert.deepEqual(sifted(ROWS, ORDER, { ...ALL, photo: "a" }).shown, [2, 0]);
});

test("what is to review is what nobody decided__truth", () => {
  assert.deepEqual(sifted(ROWS, ORDER, { ...ALL, state: "open" }).shown, [0]);
});

test("counts are of the kind that is shown, whatever state is asked for__truth", () => {
  const { counts, kinds } = sifted(ROWS, ORDER, { ...ALL, state: "open" });
  assert.deepEqual([counts.all, counts.open, counts.rejected, counts.unused],
    [3, 1, 1, 1]);
  assert.deepEqual([kinds.control, kinds.check, kinds.tie], [1, 1, 1]);
});

test("done is what somebody decided, not what a draft begins__truth", () => {
  const rows = [...ROWS, row("H1", "a", "control", "accepted"), row("3", "a", "control",
    "dubious")];
  Object.assign(rows[1], { 4: 1 });
  Object.assign(rows[5], { 4: 1 });
  assert.equal(sifted(rows, [...ORDER, 4, 5], ALL).counts.done, 2);
});

test("what the block contradicts is a filter of its own__truth", () => {
  const rows = [...ROWS, row("3", "b", "control", "accepted", 18.2)];
  const { counts, shown } = sifted(rows, [4, ...ORDER], { ...ALL, state: "disputed" });
  assert.deepEqual(shown, [4]);
  assert.deepEqual([counts.disputed, counts.accepted], [1, 1]);
});

test("a second reader is told nothing of how the first reading lies__law", () => {
  const read = [...row("T1", "a", "control", "accepted", 18.2), 9, 1];
  assert.equal(toldRow(read, ALL), read);
  assert.deepEqual(toldRow(read, { ...ALL, state: "second" }),
    ["T1", "a", "control", "accepted", 0, 0, null, 2, null, null, 1]);
});

test("a name is found by its parts__truth", () => {
  const rows = [row("J-5765650_-11947411", "a", "control", "auto"), row("KR12", "a", "control",
    "auto")];
  const named = (text) => sifted(rows, [0, 1], { ...ALL, text }).shown;
  assert.deepEqual([named("j 65650 47411"), named("kr"), named("65650 kr"), named(" ")],
    [[0], [1], [], [0, 1]]);
});

test("an area lets through what lies in it__truth", () => {
  const rows = [[10, 10], [30, 5], [19, 19]].map((place, n) =>
    [...row(`${n}`, "a", "control", "auto"), 0, 1, ...place]);
  const triangle = [[0, 0], [40, 0], [0, 20.5]];
  assert.deepEqual(sifted(rows, [0, 1, 2], { ...ALL, area: triangle }).shown, [0, 1]);
});

test("an order that is ahead of the rows leaves out what is not there yet__law", () => {
  assert.deepEqual(sifted(ROWS.slice(0, 1), ORDER, ALL).shown, [0]);
});

const lines = (count, state) => Array.from({ length: count }, (_, i) => row(`${i}`, "a", "control",
  state));

test("pieces that changed take their place, the others stay__truth", () => {
  const known = lines(120, "auto");
  const message = { "rows/1": lines(50, "accepted"), queue: {} };
  const merged = mergeRows(known, message);
  assert.equal(merged.length, 120);
  assert.deepEqual([49, 50, 99, 100].map((at) => merged[at][3]),
    ["auto", "accepted", "accepted", "auto"]);
  assert.deepEqual(Object.keys(message), ["queue"]);
});

test("a table that got shorter loses its end, one that got longer grows__truth", () => {
  const known = lines(120, "auto");
  assert.equal(mergeRows(known, { "rows/2": lines(3, "auto"), "rows/count": 103 }).length, 103);
  assert.equal(mergeRows(known, { "rows/2": lines(50, "auto"), "rows/count": 150 }).length, 150);
  assert.equal(mergeRows(known, { queue: {} }), null);
});

test("a range marks both its ends, beside what was marked one by one__truth", () => {
  const shown = ["a", "b", "c", "d"];
  const marked = (kept, from, to) => [...extended(shown, kept, from, to)].sort().join("");
  const ranges = [[1, 2], [2, 1], [1, 1]].map((range) => marked([], ...range));
  assert.deepEqual(ranges, ["bc", "bc", "b"]);
  assert.equal(marked(["a", "gone"], 2, 3), "acd");
});
