// Neighbouring blocks of a folder beside one another: what both hold, and how far it differs.
import { again, byId, element, number, renew, start, word } from "./words.js";

const SOUGHT = "gruber.sought"; // what the desk that opens next is to show
const state = {
  /** Opens a block; whether it does. */
  open: /** @type {(path: string) => Promise<boolean>} */ (async () => false),
  asking: false,
  /** The answer that is shown, as text. */
  shown: "",
};

/** @param {(path: string) => Promise<boolean>} open */
export function setUpNeighbours(open) {
  state.open = open;
  // Where this page opens, no desk did.
  sessionStorage.removeItem(SOUGHT);
}

/** Compared when the tab is looked at, what has changed since: many blocks take a while. */
export async function showNeighbours() {
  if (state.asking) return;
  state.asking = true;
  if (!state.shown) say(word("neighbours.wait"));
  const answer = await fetch("/neighbours").catch(() => null);
  const text = answer?.ok || answer?.status === 409 ? await answer.text().catch(() => "") : "";
  state.asking = false;
  if (text && text === state.shown) return;
  const found = text ? JSON.parse(text) : null;
  state.shown = found && !found.error ? text : "";
  if (!found || found.error) return say(found ? again(found.error) : word("neighbours.broke"));
  draw(found);
}

/** @param {string} text */
const say = (text) => renew(byId("neighbours"), element("p", { class: "muted" }, text));

/** @param {Neighbours} found */
function draw({ blocks, level, pairs, left_out: left, unadjusted: count }) {
  const told = pairs.filter((pair) => pair.told).length;
  const about = word("neighbours.about", { blocks, pairs: pairs.length, told, odds: 1 / level });
  renew(byId("neighbours"), element("p", {}, about),
    element("p", { class: "muted" }, word("neighbours.how")),
    ...left.map(({ path, why }) => element("p", { class: "doubted" },
      word("neighbours.left", { path, why: again(why) }))),
    ...count ? [element("p", { class: "muted" }, word("neighbours.unadjusted", { count }))] : [],
    ...pairs.length ? [element("table", {}, head(), ...pairs.map(pairPart))] : []);
}

const head = () => element("thead", {}, element("tr", {},
  ...["what", "length", "sigma", "ratio", "verdict", "open"].map((name) =>
    element("th", { title: word(`neighbours.${name}.tip`) }, word(`neighbours.${name}`)))));

/** @param {NeighbourPair} pair */
function pairPart({ one, other, rows, told, why, one_sided: sides, namesakes, same }) {
  const held = ["photo", "point"].flatMap((of) => {
    const count = rows.filter(({ kind }) => kind === of).length;
    return count ? [word(`neighbours.holds.${of}s`, { count })] : [];
  });
  const notes = [
    ...why ? [again(why)] : [],
    ...held,
    ...same ? [] : [word("neighbours.references")],
    ...sides.length ? [word("neighbours.sides", { photos: sides.join(", ") })] : [],
    ...namesakes.map((photo) => word("neighbours.namesake", { photo })),
  ];
  const title = element("tr", { class: told || why ? "held bad" : "held" },
    element("th", { colspan: 6, scope: "rowgroup" }, `${one} \u2013 ${other}`,
      element("small", {}, notes.join(" \u00b7 "))));
  return element("tbody", {}, title, ...rows.map((row) => rowPart(row, [one, other])));
}

/** @param {NeighbourRow} row @param {string[]} paths */
function rowPart(row, paths) {
  const { kind, name, length_m: length, sigma_m: sigma, ratio, verdict } = row;
  const figure = (/** @type {number | null} */ value, digits = 2) =>
    element("td", { class: "value" }, value === null ? "\u2013" : number(value, digits));
  const goals = kind === "ground" ? [] : paths.map((path, side) => element("button", {
    class: "small", type: "button", disabled: start.guest, title: word("neighbours.go", { path }),
    onclick: () => go(path, kind, side ? row.other_name ?? name : name) }, path));
  return element("tr", { class: verdict, title: details(row) },
    element("td", {}, kind === "ground" ? word("neighbours.ground")
      : word(`neighbours.${kind}`, { name })),
    figure(length), figure(sigma), figure(ratio, 1),
    element("td", {}, word(`neighbours.${verdict}`)),
    element("td", {}, element("div", { class: "goals" }, ...goals)));
}

/** Easting, northing, height and turns with their standard deviations. @param {NeighbourRow} row */
function details({ kind, shift_m: shift, shift_sigma_m: sigmas, turn_deg: turns,
  turn_sigma_deg: turned, places }) {
  const both = (/** @type {(number | null)[]} */ values,
    /** @type {(number | null)[] | undefined} */ spread, /** @type {number} */ digits) =>
    values.map((value, axis) => `${number(value, digits)}${
      spread ? ` \u00b1 ${number(spread[axis], digits)}` : ""}`).join(", ");
  const moved = word(`neighbours.${kind}.shift`, { values: both(shift, sigmas, 2), places });
  return turns ? `${moved}\n${word("neighbours.turn", { values: both(turns, turned, 3) })}` : moved;
}

/** @param {string} path @param {string} kind @param {string} name */
async function go(path, kind, name) {
  sessionStorage.setItem(SOUGHT, JSON.stringify({ kind, name }));
  if (!await state.open(path)) sessionStorage.removeItem(SOUGHT);
}

/** What was clicked on a page before this desk, once: as a place in the queue. */
export function soughtPlace() {
  const text = sessionStorage.getItem(SOUGHT);
  sessionStorage.removeItem(SOUGHT);
  if (!text) return null;
  const { kind, name } = /** @type {{ kind: string, name: string }} */ (JSON.parse(text));
  const column = kind === "photo" ? 1 : 0;
  return { find: (/** @type {Row} */ row) => row[column] === name };
}
