// Words, numbers and short names.
import assert from "node:assert/strict";
import test from "node:test";

import {
  again, fileSize, learnNames, learnPoints, moment, number, numberOf, numbers, roundNumber,
  shortName, shortPoint, squareMetres, start, tip, word, written,
} from "../../ui/web/pages/words.js";

test("values are put into a sentence, and a word nobody knows shows its key__truth", () => {
  start.words = { "queue.place": "{here} of {all}" };
  assert.equal(word("queue.place", { here: 0, all: 7 }), "0 of 7");
  assert.equal(word("queue.place", { here: 1 }), "1 of {all}");
  assert.equal(word("nothing"), "nothing");
});

test("numbers have a real minus, a narrow space before the unit, a dash for none__truth", () => {
  assert.equal(number(-1.256, 2, "m"), "\u22121.26\u2009m");
  assert.equal(number(0, 1), "0.0");
  assert.equal(number(null, 1, "m"), "\u2013");
  assert.equal(number(undefined, 1), "\u2013");
});

test("a time is written as the language does__truth", () => {
  start.language = "cs";
  start.words = { said: "{when}, {who}" };
  assert.equal(word("said", { when: "2026-11-05T03:12", who: "ada" }),
    "5.\u00a011.\u00a02026\u00a003:12, ada");
  start.language = "en";
  assert.equal(moment("2026-11-05T03:12:07.250+00:00"), "2026-11-05\u00a003:12");
  assert.equal(moment("1938-05-16"), "1938-05-16");
});

test("a field shows a number as the language does, and takes a point and a comma__law", () => {
  for (const [language, shown] of [["cs", "-84,5"], ["en", "-84.5"]]) {
    start.language = language;
    assert.equal(written(-84.5), shown);
    for (const text of [shown, " -84.5 ", "-84,5", "\u221284,5"]) {
      assert.equal(numberOf(text), -84.5);
    }
  }
  assert.equal(written(""), "");
  assert.ok([" ", "", "1,2,3", "m"].every((text) => Number.isNaN(numberOf(text))));
});

test("quotes of commands for a terminal are left out__truth", () => {
  assert.equal(again("Make it with `gruber new`."), "Make it with gruber new.");
  assert.equal(again({ said: "Did you mean `{a}`?", values: { a: "b" } }), "Did you mean b?");
});

test("what the engine quotes is quoted__truth", () => {
  const told = { said: "must be a number, not {value!r}.", values: { value: "abc" } };
  assert.equal(again(told), "must be a number, not 'abc'.");
});

test("a round number has the digits it has__truth", () => {
  const wanted = { 0.05: "0.05", 0.1: "0.1", 0.5: "0.5", 1: "1", 20: "20", 500: "500" };
  for (const [value, text] of Object.entries(wanted)) {
    assert.equal(roundNumber(Number(value), "m"), `${text}\u2009m`);
  }
});

test("a small file has a size too__truth", () => {
  start.language = "en";
  assert.deepEqual([1, 999_999, 1_500_000, 45_600_000].map(fileSize),
    ["1\u2009kB", "1000\u2009kB", "1.5\u2009MB", "46\u2009MB"]);
});

test("a count names its form, and Czech has three, with a comma in numbers__truth", () => {
  start.words = { ties: "{count:# tie|# ties}" };
  assert.equal(word("ties", { count: 1 }), "1 tie");
  assert.equal(word("ties", { count: 2300 }), "2\u202f300 ties");
  start.words = { holes: "{area:,.0f} m" };
  const areas = [squareMetres(18678.4), word("holes", { area: "18678" })];
  assert.deepEqual(areas, ["18\u202f678\u2009m\u00b2", "18\u202f678 m"]);
  start.language = "cs";
  start.words = { ties: "{count:# bod|# body|# bodů}", far: "{m:.1f} m ({share:.0%})" };
  assert.deepEqual([1, 3, 5].map((count) => word("ties", { count })),
    ["1 bod", "3 body", "5 bodů"]);
  assert.equal(word("far", { m: -2.26, share: 0.3 }), "\u22122,3 m (30%)");
  assert.equal(number(1.5, 2), "1,50");
  assert.equal(numbers([1.5, 2], 1), "1,5; 2,0");
  start.language = "en";
});

test("what the engine said is told in the language of the page__truth", () => {
  start.messages = { "{n} marks: {why}": "Značky: {n}. {why}", "Lost.": "Ztraceno." };
  const why = { said: "Lost.", values: {} };
  assert.equal(again({ said: "{n} marks: {why}", values: { n: 2, why } }), "Značky: 2. Ztraceno.");
  assert.equal(again("An older sentence."), "An older sentence.");
  start.messages = {};
});

test("scan names lose what all begin or end with, never in the middle of a number__truth", () => {
  learnNames(["block_1938_0114", "block_1938_0115", "block_1938_0120"]);
  assert.equal(shortName("block_1938_0114"), "0114");
  assert.equal(shortName("other"), "other");
  learnNames(["2015_06_0253_RGB", "2015_05_0182_RGB"]);
  assert.equal(shortName("2015_06_0253_RGB"), "06_0253");
});

test("a single name is not shortened, nor are names with little in common__truth", () => {
  learnNames(["block_1938_0114"]);
  assert.equal(shortName("block_1938_0114"), "block_1938_0114");
  learnNames(["a_1", "a_2"]);
  assert.equal(shortName("a_1"), "a_1");
});

test("points named by coordinates lose the digits all have in common__truth", () => {
  learnPoints(["J-742123_-1040456", "J-742199_-1040777", "H1"]);
  assert.equal(shortPoint("J-742123_-1040456"), "J 123 456");
  assert.equal(shortPoint("H1"), "H1");
});

test("a text may have a longer one, or none__truth", () => {
  start.words = { "act.fit": "Fit", "act.fit.tip": "Centre the point" };
  assert.equal(tip("act.fit"), "Centre the point");
  assert.equal(tip("act.other"), null);
});

test("a value that holds a place of its own is not filled again__law", () => {
  start.words = { "notice.not-done": "That could not be done: {why}" };
  const why = "scan {scan} is gone";
  assert.equal(word("notice.not-done", { why, scan: "7" }), `That could not be done: ${why}`);
});
