// The status line, and the making of orthos.
import { byId, element, number, shortName, start, stateGlyph, word } from "./words.js";

const TALLY = /** @type {State[]} */ (["auto", "accepted", "dubious", "rejected"]);
const state = { sigma: /** @type {number | null} */ (null) };

/** @param {Status} status */
export function showStatus(status) {
  const { sigma, mp, checks, adjusting, converged } = status;
  const room = byId("sigma");
  room.title = word("status.sigma.tip");
  room.dataset.value = `${sigma ?? ""}`;
  room.replaceChildren(word("status.sigma"), ...change(status.sigma_before, sigma));
  if (state.sigma !== null && state.sigma !== sigma) flash(room);
  state.sigma = sigma;
  // The line is short of room: what else there is to say of them stands in the tip.
  byId("mp").title = `${word("status.mp.tip")}${fewer(checks)}${keptOut(checks)}`;
  const { kept: count, kept_rmse: rmse } = checks;
  const short = { count, rmse: number(rmse, 2, "m") };
  byId("mp").replaceChildren(...(mp === null ? [word("status.mp.none")]
    : [word("status.mp.short", { count: checks.count }), ...change(status.mp_before, mp, "m")]),
    count ? `\u00b7 ${word("status.kept.short", short)}` : "");
  byId("tally").replaceChildren(...TALLY.map((name) =>
    element("span", { class: "part", "data-tally": name,
      title: `${word(`status.${name}`)} \u00b7 ${word(`state.${name}.long`)}` },
      stateGlyph(name, 12), element("b", {}, `${status.counts[name]}`),
      element("span", { class: "muted" }, word(`status.${name}`)))));
  byId("drafts").hidden = !status.drafts;
  byId("drafts").textContent = status.drafts ? word("status.drafts", { count: status.drafts }) : "";
  byId("drafts").title = word("status.drafts.tip");
  byId("working").classList.toggle("busy", adjusting);
  byId("working").textContent = adjusting ? word("status.adjusting")
    : converged ? "" : word("status.diverged");
  byId("saved").textContent = word("status.saved", { count: status.decided });
  byId("saved").title = word("status.saved.tip");
  byId("who").textContent = status.operator;
  showMaking(status);
}

/** That there are fewer check points than a statement by the standard needs.
 * @param {Checks} checks */
export const fewer = ({ count, least }) =>
  count && count < least ? ` ${word("status.mp.few", { least })}` : "";

/** The proposals that were kept out, apart from the check points that are independent.
 * @param {Checks} checks */
export const keptOut = ({ kept: count, kept_rmse: rmse }) =>
  count ? ` \u00b7 ${word("status.kept", { count, rmse: number(rmse, 3, "m") })}` : "";

/** @param {number | null} before @param {number | null} now */
function change(before, now, unit = "") {
  const fresh = element("b", {}, number(now, 3, unit));
  if (before === null || number(before, 3) === number(now, 3)) return [fresh];
  return [element("span", { class: "old" }, number(before, 3)),
    element("span", { class: "arrow" }, "\u2192"), fresh];
}

/** @param {HTMLElement} item */
function flash(item) {
  item.classList.remove("flash");
  void item.offsetWidth; // Reading it begins the animation anew.
  item.classList.add("flash");
}

/** What the button that makes results again is called: by orthos that wait, or by the writing. */
export const remakeName = (/** @type {Status | null} */ status) =>
  (!status || status.stale.length || status.written ? "remake" : "remake.write");

/** @param {Status} status */
function showMaking({ remaking, stale, written }) {
  const old = stale.length > 0;
  const said = old ? word("remake.stale", { count: stale.length })
    : word(written ? "remake.fresh" : "remake.unwritten");
  byId("stale").textContent = remaking ? "" : said;
  byId("stale").title = [said, stale.map(shortName).join(", ")].filter(Boolean).join(": ");
  byId("stale").classList.toggle("some", old || !written);
  const name = old || written ? "remake" : "remake.write";
  const button = byId("remake-start");
  Object.assign(button, { hidden: remaking !== null, disabled: !old && written,
    title: word(`${name}.tip`) });
  button.replaceChildren(word(name));
  byId("remake-cancel").hidden = remaking === null;
  byId("making").hidden = remaking === null;
  if (!remaking) return;
  const { what, left, share, cancelling } = remaking;
  byId("remake-cancel").disabled = cancelling;
  /** @type {HTMLElement} */ (byId("making-share").firstChild).style.width = `${100 * share}%`;
  const time = left === null ? "" : word("remake.left", { seconds: Math.ceil(left) });
  const made = start.words[`remake.${what}`] ?? shortName(what);
  byId("making-what").textContent = [made, time].filter(Boolean).join(" \u00b7 ");
}
