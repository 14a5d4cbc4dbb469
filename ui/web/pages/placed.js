// The placing page within the desk: any photo, at any time.
import { byId, element, start, word } from "./words.js";

export function setUpPlaced() {
  const sheet = byId("placed");
  sheet.addEventListener("close", () => sheet.querySelector("iframe")?.remove());
  window.gruberPlaced = () => sheet.close();
}

/** @param {string} photo */
export function openPlaced(photo) {
  const sheet = byId("placed");
  if (sheet.open) return sheet.close();
  const named = new URLSearchParams({ photo, seat: start.seat });
  const src = `/pages/placing.html?${named}`;
  // The keys are the desk's until the page takes them.
  sheet.append(element("iframe", { title: word("placing"), src, inert: true }));
  sheet.showModal();
}
