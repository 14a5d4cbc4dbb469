// Pairs of the placing page that nobody has saved: they outlive the page.
import { shortName, start, word } from "./words.js";

/** @typedef {{ pairs: number[][], over: string }} Unsaved `over`: what was saved before, as JSON */

const place = () => `gruber.pairs.${start.name}`;

/** @param {ScanToPlace[]} scans @param {Map<string, string>} kept saved pairs, as JSON */
export function keepUnsaved(scans, kept) {
  const unsaved = scans.map(({ photo, pairs }) =>
    /** @type {[string, Unsaved]} */ ([photo, { pairs, over: kept.get(photo) ?? "[]" }]))
    .filter(([, { pairs, over }]) => JSON.stringify(pairs) !== over);
  sessionStorage.setItem(place(), JSON.stringify(Object.fromEntries(unsaved)));
}

/**
 * Unsaved pairs are those of their scans again; returned is what is to be said of it.
 * @param {ScanToPlace[]} scans @param {Map<string, string>} kept
 */
export function recallUnsaved(scans, kept) {
  /** @type {Record<string, Unsaved>} */
  const unsaved = JSON.parse(sessionStorage.getItem(place()) ?? "{}");
  const recalled = scans.filter(({ photo }) => photo in unsaved);
  for (const scan of recalled) scan.pairs = unsaved[scan.photo].pairs;
  const others = recalled.filter(({ photo }) => unsaved[photo].over !== (kept.get(photo) ?? "[]"));
  const names = others.map(({ photo }) => shortName(photo)).join(", ");
  return [...(recalled.length ? [word("placing.recalled")] : []),
    ...(names ? [word("placing.overtaken", { names })] : [])];
}
