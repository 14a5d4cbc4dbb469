// Who a key belongs to: what has the focus, or the page.
import assert from "node:assert/strict";
import test from "node:test";

import { focusUses, undoKey } from "../../ui/web/pages/keys.js";

const uses = (key, tagName, type = "") => focusUses({ key, target: { tagName, type } });

test("buttons are pressed and leave every other key to the desk", () => {
  assert.ok(uses("Enter", "BUTTON") && uses(" ", "BUTTON"));
  assert.ok(!uses("y", "BUTTON") && !uses("ArrowRight", "BUTTON") && !uses("Escape", "BUTTON"));
  assert.ok(uses("Enter", "A") && !uses(" ", "A"));
});

test("sliders move, fields and lists are written in", () => {
  assert.ok(uses("ArrowLeft", "INPUT", "range") && uses("End", "INPUT", "range"));
  assert.ok(!uses("n", "INPUT", "range") && !uses(" ", "INPUT", "range"));
  assert.ok(uses("Enter", "INPUT", "range") && uses("Enter", "INPUT", "checkbox"));
  assert.ok(uses("n", "INPUT", "text") && uses("ArrowUp", "SELECT") && uses("y", "TEXTAREA"));
  assert.ok(uses(" ", "INPUT", "checkbox") && !uses("y", "INPUT", "checkbox"));
});

test("a line between two parts moves, and leaves every other key to the desk", () => {
  const line = (key) => focusUses({ key, target: { tagName: "DIV", role: "separator" } });
  assert.ok(line("ArrowLeft") && line("Home") && !line("y") && !line(" "));
  assert.ok(line("Enter"), "it refines nothing");
});

test("what undoes in other programs means U", () => {
  const pressed = (key, held) => undoKey({ key, code: "", ctrlKey: false, metaKey: false,
    altKey: false, shiftKey: false, repeat: false, ...held });
  for (const held of [{ ctrlKey: true }, { metaKey: true }]) {
    const meant = { key: "u", code: "KeyU", shiftKey: false, repeat: false };
    assert.deepEqual(pressed("z", held), meant);
    assert.ok(pressed("Z", { ...held, shiftKey: true }).shiftKey && pressed("y", held).shiftKey);
  }
  // By place where another alphabet is set.
  assert.ok(pressed("\u044f", { ctrlKey: true, code: "KeyZ" }));
  assert.equal(pressed("z", {}), null);
  assert.equal(pressed("z", { ctrlKey: true, altKey: true }), null);
  assert.equal(pressed("u", { ctrlKey: true }), null);
});

test("what is no control uses no key", () => {
  assert.ok(!uses("Enter", "SECTION") && !uses(" ", "CANVAS"));
  assert.ok(!focusUses({ key: "Enter", target: null }));
});
