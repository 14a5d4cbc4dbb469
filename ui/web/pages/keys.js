// Who a key belongs to: what has the focus and uses it, or else the page.
import { focused } from "./words.js";

const PRESSES = ["Enter", " "];
const MOVES = [
  "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown",
];
/** What an element does with keys by itself; one that is not listed uses none. */
const USES = /** @type {Record<string, string[]>} */ ({
  BUTTON: PRESSES, SUMMARY: PRESSES, A: ["Enter"], range: MOVES, checkbox: [" "],
  radio: [" ", ...MOVES],
});
const WRITES = ["TEXTAREA", "SELECT", "INPUT"];

/**
 * True when what has the focus uses the key itself: buttons are pressed, sliders move, fields and
 * lists are written in.
 * @param {{ key: string, target: EventTarget | null }} event
 */
export function focusUses({ key, target }) {
  const { tagName, type } = /** @type {HTMLInputElement} */ (target ?? {});
  const uses = tagName === "INPUT" ? USES[type] : USES[tagName];
  return uses ? uses.includes(key) : WRITES.includes(tagName);
}

/**
 * Every key of the page that nothing else uses goes to `take`, which says whether it meant
 * something. The same question is returned for frames that hand their keys up.
 * @param {(event: KeyboardEvent) => boolean} take
 */
export function listenToKeys(take) {
  const takes = (/** @type {KeyboardEvent} */ event) =>
    !event.ctrlKey && !event.altKey && !event.metaKey && !focusUses(event) && take(event);
  for (const type of /** @type {const} */ (["keydown", "keyup"])) {
    window.addEventListener(type, (event) => {
      if (takes(event)) event.preventDefault();
    }, true);
  }
  // A button pressed by pointer does not keep the keys; by key it does, for the next press.
  window.addEventListener("click", ({ detail }) => {
    if (detail && focused()?.tagName === "BUTTON") focused()?.blur();
  });
  return takes;
}
