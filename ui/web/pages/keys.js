// Who a key belongs to: what has the focus and uses it, or else the page.
import { letterOf } from "./view.js";
import { focused } from "./words.js";

const PRESSES = ["Enter", " "];
const MOVES = [
  "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown",
];
/** Keys of an element, whether it does something with them or not; one not listed has none. */
const USES = /** @type {Record<string, string[]>} */ ({
  BUTTON: PRESSES, SUMMARY: PRESSES, A: ["Enter"], range: ["Enter", ...MOVES], checkbox: PRESSES,
  radio: [...PRESSES, ...MOVES],
});
const WRITES = ["TEXTAREA", "SELECT", "INPUT"];

/**
 * True when what has the focus uses the key itself: buttons are pressed, sliders move, fields and
 * lists are written in.
 * @param {{ key: string, target: EventTarget | null }} event
 */
export function focusUses({ key, target }) {
  const { tagName, type, role } = /** @type {HTMLInputElement} */ (target ?? {});
  if (role === "separator" || role === "region") return USES.range.includes(key);
  const uses = tagName === "INPUT" ? USES[type] : USES[tagName];
  return uses ? uses.includes(key) : WRITES.includes(tagName);
}

const hand = {
  /** The control that had the focus last by keys. @type {HTMLElement | null} */
  held: null,
  /** When something was pressed last, by the clock of `now`. */
  pressed: 0,
};

/** Milliseconds; those of frames are the same. */
export const now = () => performance.timeOrigin + performance.now();

/** When the last key or button was pressed: a busy page answers it later. */
export const pressedAt = () => hand.pressed;

/** When something was pressed, by the clock of `now`. @param {UIEvent} event */
export const timeOf = ({ timeStamp, view }) =>
  (view ?? window).performance.timeOrigin + timeStamp;

/** @param {UIEvent} event */
function noteWhen(event) {
  hand.pressed = timeOf(event);
}

/**
 * A control that went away, or cannot be pressed any more, left the focus to nothing: keys that it
 * would have used are not meant for the page. Any other key, the pointer or Tab goes on.
 * @param {KeyboardEvent} event
 */
function wasForGone(event) {
  const { held } = hand;
  const { disabled } = /** @type {HTMLButtonElement} */ (held ?? {});
  if (!held || focused() !== document.body) return false;
  if ((disabled || !held.checkVisibility()) && focusUses({ key: event.key, target: held })
    && event.key !== "Escape") return true;
  if (event.type === "keydown" && !["Shift", "Tab"].includes(event.key)) hand.held = null;
  return false;
}

/**
 * What undoes and does again in other programs means U here; null for any other key.
 * @param {Pick<KeyboardEvent, "key" | "code" | "ctrlKey" | "metaKey" | "altKey" | "shiftKey"
 *   | "repeat">} event
 */
export function undoKey({ key, code, ctrlKey, metaKey, altKey, shiftKey, repeat }) {
  const letter = letterOf({ key, code });
  if (ctrlKey === metaKey || altKey || !["KeyZ", "KeyY"].includes(letter)) return null;
  return { key: "u", code: "KeyU", shiftKey: shiftKey || letter === "KeyY", repeat };
}

/**
 * A held Enter presses a button once: what it would press next nobody has seen.
 * @param {KeyboardEvent} event
 */
const isHeld = ({ key, repeat, target }) => repeat && key === "Enter"
  && ["BUTTON", "SUMMARY", "A"].includes(/** @type {HTMLElement} */ (target).tagName);

/**
 * Every key of the page that nothing else uses goes to `take`, which says whether it meant
 * something. The same question is returned for frames that hand their keys up.
 * @param {(event: KeyboardEvent) => boolean} take
 */
export function listenToKeys(take) {
  const takes = (/** @type {KeyboardEvent} */ event) => {
    if (event.type === "keydown") noteWhen(event);
    const undo = undoKey(event);
    const bare = !event.ctrlKey && !event.altKey && !event.metaKey;
    return (bare || undo !== null) && !focusUses(event)
      && (wasForGone(event) || take(undo ? new KeyboardEvent(event.type, undo) : event));
  };
  for (const type of /** @type {const} */ (["keydown", "keyup"])) {
    window.addEventListener(type, (event) => {
      if (takes(event) || isHeld(event)) event.preventDefault();
    }, true);
  }
  window.addEventListener("focusin", ({ target }) => {
    hand.held = /** @type {HTMLElement} */ (target);
  });
  for (const type of ["pointerdown", "close"]) {
    window.addEventListener(type, () => {
      hand.held = null;
    }, true);
  }
  window.addEventListener("pointerdown", noteWhen, true);
  // A click of no pointer: by a key, whose time it has, or by a screen reader.
  window.addEventListener("click", (event) => {
    if (!event.detail) noteWhen(event);
  }, true);
  // What is pressed by pointer does not keep the keys: arrows nudge what was chosen.
  window.addEventListener("click", ({ detail }) => {
    if (!detail) return;
    hand.held = null;
    const pressed = "button, [role=listbox], [role=region], [role=separator]";
    if (focused()?.matches(pressed)) focused()?.blur();
  });
  return takes;
}
