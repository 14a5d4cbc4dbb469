// Tables and report, to be opened or taken away.
import { byId, element, number, start, word } from "./words.js";

export function setUpResults() {
  const button = byId("results-open");
  button.hidden = !start.results;
  button.textContent = word("results");
  button.title = word("results.tip");
  button.addEventListener("click", open);
  const sheet = byId("results");
  sheet.addEventListener("click", (event) => {
    if (event.target === sheet) sheet.close();
  });
}

async function open() {
  const answer = await fetch("/results/");
  /** @type {[name: string, bytes: number][]} */
  const files = answer.ok ? await answer.json() : [];
  const lines = files.map(([name, bytes]) => element("li", {}, link(name),
    element("span", { class: "muted" }, size(bytes))));
  byId("results").replaceChildren(
    element("h2", {}, word("results")), element("p", {}, word("results.long")),
    files.length ? element("ul", {}, ...lines) : element("p", {}, word("results.none")),
    element("button", { onclick: () => byId("results").close() }, word("act.close")));
  byId("results").showModal();
}

/** @param {string} name */
function link(name) {
  const page = name.endsWith(".html");
  const how = page ? { target: "_blank" } : { download: name };
  const text = page ? word("results.report", { name }) : name;
  return element("a", { href: `/results/${encodeURIComponent(name)}`, ...how }, text);
}

/** @param {number} bytes */
const size = (bytes) => (bytes > 2 ** 20 ? `${number(bytes / 2 ** 20, 1)} MB`
  : `${number(Math.ceil(bytes / 1024), 0)} kB`);
