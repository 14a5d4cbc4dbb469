// The placing page within the desk: any photo, at any time.
import { byId, element, start, word } from "./words.js";

export function setUpPlaced() {
  const sheet = byId("placed");
  // What was clicked and not saved goes with the page; what was said stays.
  sheet.addEventListener("close", () => sheet.querySelector("iframe")?.remove());
  window.gruberPlaced = () => sheet.close();
}

/** @param {string} photo */
export function openPlaced(photo) {
  const sheet = byId("placed");
  if (sheet.open) return sheet.close();
  const named = new URLSearchParams({ photo, seat: start.seat });
  const src = `/pages/placing.html?${named}`;
  const frame = element("iframe", { title: word("placing"), src });
  // The keys are the page's as soon as it is there.
  frame.addEventListener("load", () => frame.contentWindow?.focus());
  sheet.append(frame);
  sheet.showModal();
}
