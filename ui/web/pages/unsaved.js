// Pairs of the placing page and marks of Checks that nobody has saved: they outlive the page.
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

/** @param {string} whose */
const marksOf = (whose) => `gruber.marks.${start.name}.${whose}`;

/**
 * What one observer has marked and not kept, by mosaic and place.
 * @param {string} whose @returns {Map<string, (Pair | null)[]>}
 */
export const recallMarks = (whose) =>
  new Map(whose ? JSON.parse(localStorage.getItem(marksOf(whose)) ?? "[]") : []);

/**
 * Another window of the same observer keeps its own.
 * @param {string} whose @param {string} name of mosaic and place
 * @param {(Pair | null)[] | null} marks
 */
export function keepMarks(whose, name, marks) {
  const [version] = name.split(" ");
  const kept = recallMarks(whose);
  kept.delete(name);
  // Marks are of the mosaic they were set in: those of an earlier one are of no use.
  const still = [...kept].filter(([other]) => other.startsWith(`${version} `));
  localStorage.setItem(marksOf(whose), JSON.stringify(marks ? [...still, [name, marks]] : still));
}
