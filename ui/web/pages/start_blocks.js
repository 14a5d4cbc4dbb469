// The list of blocks in a folder: how good each is, who has signed it, and how far a batch is.
import { all, byId, clamped, element, number, start, word } from "./words.js";

const LOOK_MS = 3000; // design: a stage takes seconds to minutes
const STATES = ["running", "waiting", "left", "failed", "done"];
const state = { batch: /** @type {Batch | null} */ (null), timer: 0 };

/** @param {Found} found @param {(path: string) => void} choose */
export function blocksPart({ blocks, unlisted, batch }, choose) {
  state.batch = batch;
  const more = unlisted ? [element("p", { class: "note" },
    word("start.blocks.unlisted", { count: unlisted }))] : [];
  return [element("h2", {}, word("start.blocks")),
    element("p", { id: "batch", class: "note" }, batchTold()),
    element("ul", { class: "holds" }, ...blocks.map((one) => blockLine(one, choose))), ...more];
}

/** @param {FoundBlock} block @param {(path: string) => void} choose */
function blockLine(block, choose) {
  const broken = block.why && block.written;
  const rejected = block.signed.some(([, verdict, holds]) => holds && verdict === "reject");
  const now = stateTold(block.path);
  const sign = broken ? "!" : rejected ? "\u2717" : block.run ? "\u2713" : "\u00b7";
  return element("li", { class: "have" },
    element("i", { class: broken || rejected ? "broken" : "" }, sign),
    element("span", {}, element("button", { disabled: start.guest,
      onclick: () => choose(block.path) }, block.path),
    element("small", {}, now && !block.run ? "" : blockTold(block).join(" \u00b7 ")),
    element("small", { "data-batch": block.path }, clamped(now))));
}

/** @param {FoundBlock} block */
function blockTold({ run: walked, why, written, sigma, predicted, m_p: mp, open: faults, signed }) {
  const broken = why ? [word("start.block.broken", { why })] : [];
  if (!written) return [word("start.block.new")];
  if (!walked) return why ? broken : [word("start.block.unrun")];
  const figures = Object.entries({ sigma, predicted, read: mp }).filter(([, value]) =>
    value !== null).map(([name, value]) =>
    word(`start.block.${name}`, { value: number(value, 2) }));
  return [...broken, word("start.block.run"), ...figures,
    ...faults ? [word("start.block.faults", { count: faults })] : [],
    ...signed.map(([who, verdict, holds]) => word(holds ? "start.block.signed"
      : "start.block.outdated", { who, verdict: word(`accepted.${verdict}`) }))];
}

/** How many blocks of the batch are in which state; nothing without one. */
function batchTold() {
  if (!state.batch) return "";
  const states = Object.values(state.batch.blocks).map(([name]) => name);
  const told = STATES.filter((name) => states.includes(name)).map((name) =>
    word(`start.batch.${name}`, { count: states.filter((one) => one === name).length }));
  return word("start.batch", { when: state.batch.written, told: told.join(", ") });
}

/** What the batch does with a block, unless it is done. @param {string} path */
function stateTold(path) {
  const [name, stage, message] = state.batch?.blocks[path] ?? ["done", "", ""];
  const where = stage ? word(`stage.${stage}`) : word("start.batch.begins");
  return name === "done" ? "" : word(`start.batch.block.${name}`, { stage: where, message });
}

/** How many blocks of a batch have not ended. @param {Batch | null} batch */
const open = (batch) => Object.values(batch?.blocks ?? {}).filter(([name]) =>
  name === "running" || name === "waiting").length;

/**
 * Looks again and again while a batch is under way; a block that ends changes the whole list.
 * @param {Batch | null} batch @param {() => void} ended
 */
export function watchBatch(batch, ended) {
  clearTimeout(state.timer);
  if (!open(batch)) return;
  state.timer = window.setTimeout(async () => {
    const answer = await fetch("/batch").catch(() => null);
    if (!answer?.ok) return watchBatch(batch, ended);
    const now = (await answer.json()).batch;
    if (open(now) !== open(batch)) return ended();
    state.batch = now;
    byId("batch").textContent = batchTold();
    for (const line of all("[data-batch]")) {
      line.replaceChildren(clamped(stateTold(line.dataset.batch ?? "")));
    }
    watchBatch(now, ended);
  }, LOOK_MS);
}
