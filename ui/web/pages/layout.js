// Where the parts of the desk lie: splitters, the part that takes all, and what is folded.
import { all, byId, first, focused, glyph, turn, word } from "./words.js";

const PARTS = ["queue", "block", "compare"];
const TALL_PX = 1200; // design: pictures stay large beside all figures
/** A press moves a splitter by this share of the window: right, down. */
const STEPS = /** @type {Record<string, number[]>} */ ({
  ArrowLeft: [-0.02, 0], ArrowRight: [0.02, 0], ArrowUp: [0, -0.02], ArrowDown: [0, 0.02],
});
const state = {
  /** The part the hand is in. */
  under: "compare",
};

export function setUpLayout() {
  for (const part of PARTS) {
    const room = byId(part);
    for (const type of ["pointerenter", "focusin"]) {
      room.addEventListener(type, () => {
        state.under = part;
      });
    }
    const button = first("[data-grow]", room);
    button.title = `${word("grow.tip")} (X)`;
    button.setAttribute("aria-label", word("grow"));
    button.append(glyph("grow", "currentColor", 15));
    button.addEventListener("click", () => grow(part));
    turn(button, false);
  }
  setUpSplit("left", (x) => [(100 * x) / window.innerWidth, 15, 60]);
  const end = () => byId("block").getBoundingClientRect().bottom;
  setUpSplit("low", (_, y) => [(100 * (end() - y)) / window.innerHeight, 12, 70]);
  const kept = localStorage.getItem("gruber.details");
  unfold(kept === null ? window.innerHeight >= TALL_PX : kept === "open");
}

/** A part takes all, or everything is as before. */
export function grow(part = state.under) {
  const desk = byId("desk");
  if (desk.dataset.grown) delete desk.dataset.grown;
  else desk.dataset.grown = part;
  for (const room of PARTS) {
    byId(room).setAttribute("role", room === (desk.dataset.grown ?? "compare") ? "main" : "region");
  }
  for (const button of all("[data-grow]", desk)) {
    turn(button, desk.dataset.grown === button.dataset.grow);
  }
  // What had the focus may be out of sight now.
  if (focused()?.checkVisibility({ visibilityProperty: true }) === false) focused()?.blur();
}

/** @param {string} part */
export function growTo(part) {
  if (byId("desk").dataset.grown === part) return;
  showAllParts();
  grow(part);
}

/** No part has the window for itself. */
export function showAllParts() {
  const { grown } = byId("desk").dataset;
  if (grown) grow(grown);
}

/** What is not needed to decide is shown, or folded away. */
export function toggleDetails() {
  const open = byId("details").hidden === true;
  localStorage.setItem("gruber.details", open ? "open" : "folded");
  unfold(open);
}

/** @param {boolean} open */
function unfold(open) {
  byId("details").hidden = !open;
  byId("compare").classList.toggle("detailed", open);
  turn(first("[data-act=details]"), open);
}

/**
 * A line between two parts. What it keeps is a share of the window, so that it fits another one.
 * @param {string} side
 * @param {(x: number, y: number) => number[]} measure share, and between which it stays, percent
 */
function setUpSplit(side, measure) {
  const root = document.documentElement.style;
  const [name, variable] = [`gruber.share.${side}`, `--${side}`];
  const take = (/** @type {number} */ share) =>
    root.setProperty(variable, `${share}${side === "left" ? "vw" : "vh"}`);
  const kept = Number(localStorage.getItem(name));
  if (kept) take(kept);
  const split = first(`.split[data-side=${side}]`);
  split.title = word("split.tip");
  split.tabIndex = 0;
  split.role = "separator";
  split.ariaLabel = word(`split.${side}`);
  split.ariaOrientation = side === "left" ? "vertical" : "horizontal";
  const tell = () => {
    const { x, bottom } = split.getBoundingClientRect();
    const [now, least, most] = measure(x, bottom);
    const share = Math.min(Math.max(now, least), most);
    for (const [key, value] of Object.entries({ now: share, min: least, max: most })) {
      split.setAttribute(`aria-value${key}`, `${Math.round(value)}`);
    }
  };
  /** The line comes to a place of the window. @param {number} x @param {number} y */
  const move = (x, y) => {
    const [share, least, most] = measure(x, y);
    take(Math.min(Math.max(share, least), most));
    localStorage.setItem(name, parseFloat(root.getPropertyValue(variable)).toFixed(2));
    tell();
  };
  const reset = () => {
    root.removeProperty(variable);
    localStorage.removeItem(name);
    tell();
  };
  tell();
  split.addEventListener("focus", tell);
  split.addEventListener("keydown", (event) => {
    const [right, down] = STEPS[event.key] ?? [0, 0];
    const { x, bottom: y } = split.getBoundingClientRect();
    if (event.key === "Home") reset();
    else if (right || down) move(x + right * window.innerWidth, y + down * window.innerHeight);
    else return;
    event.preventDefault();
  });
  split.addEventListener("pointerdown", (event) => {
    split.setPointerCapture(event.pointerId);
    split.classList.add("moving");
    byId("scene").style.pointerEvents = "none";
  });
  split.addEventListener("pointermove", (event) => {
    if (split.hasPointerCapture(event.pointerId)) move(event.clientX, event.clientY);
  });
  split.addEventListener("pointerup", () => {
    split.classList.remove("moving");
    byId("scene").style.pointerEvents = "";
  });
  split.addEventListener("dblclick", reset);
}
