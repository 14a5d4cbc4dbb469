// The status line, and the making of orthos.
import { byId, element, number, shortName, start, stateGlyph, word } from "/pages/words.js";

let lastSigma = null;

export function showStatus(status) {
  const sigma = byId("sigma");
  sigma.title = word("status.sigma.tip");
  sigma.dataset.value = status.sigma ?? "";
  sigma.replaceChildren(word("status.sigma"), ...change(status.sigma_before, status.sigma, 3, ""));
  if (lastSigma !== null && lastSigma !== status.sigma) flash(sigma);
  lastSigma = status.sigma;
  byId("mp").title = word("status.mp.tip");
  byId("mp").replaceChildren(...(status.mp === null ? [word("status.mp.none")] : [word("status.mp"), ...change(status.mp_before, status.mp, 3, "m")]));
  byId("tally").replaceChildren(...[["used", "accepted"], ["open", "auto"], ["dubious", "dubious"], ["rejected", "rejected"]].map(([name, look]) =>
    element("span", { class: "part", "data-tally": name }, stateGlyph(look, 12), element("b", {}, `${status.counts[name]}`), element("span", { class: "muted" }, word(`status.${name}`)))));
  const working = byId("working");
  working.classList.toggle("busy", status.adjusting);
  working.textContent = status.adjusting ? word("status.adjusting") : status.converged ? "" : word("status.diverged");
  byId("saved").textContent = word("status.saved", { count: status.decided });
  byId("saved").title = word("status.saved.tip");
  byId("who").textContent = status.operator;
  showMaking(status);
}

function change(before, now, digits, unit) {
  const fresh = element("b", {}, number(now, digits, unit));
  if (before === null || before === undefined || number(before, digits) === number(now, digits)) return [fresh];
  return [element("span", { class: "old" }, number(before, digits)), element("span", { class: "arrow" }, "\u2192"), fresh];
}

function flash(item) {
  item.classList.remove("flash");
  void item.offsetWidth;
  item.classList.add("flash");
}

function showMaking(status) {
  const making = status.remaking;
  byId("stale").textContent = making ? "" : status.stale.length ? word("remake.stale", { count: status.stale.length }) : word(status.written ? "remake.fresh" : "remake.unwritten");
  byId("stale").title = status.stale.map(shortName).join(", ");
  byId("stale").classList.toggle("some", status.stale.length > 0 || !status.written);
  byId("remake-start").hidden = making !== null;
  byId("remake-start").disabled = status.stale.length === 0 && status.written;
  byId("remake-start").textContent = word(status.stale.length || status.written ? "remake" : "remake.write");
  byId("remake-cancel").hidden = making === null;
  byId("making").hidden = making === null;
  if (!making) return;
  byId("remake-cancel").disabled = making.cancelling;
  byId("making-share").firstChild.style.width = `${100 * making.share}%`;
  byId("making-what").textContent = [start.words[`remake.${making.what}`] ?? shortName(making.what), making.left === null ? "" : word("remake.left", { seconds: Math.ceil(making.left) })].filter(Boolean).join(" \u00b7 ");
}
