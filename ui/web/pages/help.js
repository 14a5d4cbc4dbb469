// The sheet of keys and marks.
import { byId, element, glyph, start, stateGlyph, word } from "/pages/words.js";

export function toggleHelp() {
  const dialog = byId("help");
  if (dialog.open) { dialog.close(); return; }
  const lines = start.keys.map(([key, name]) => element("tr", {}, element("td", {}, element("kbd", {}, key)), element("td", {}, word(name), element("span", {}, start.words[`${name}.tip`] ?? ""))));
  const half = Math.ceil(lines.length / 2);
  const palette = start.palette;
  const looks = ["auto", "accepted", "dubious", "rejected", "unused"].map((state) => element("span", { title: word(`state.${state}.long`) }, stateGlyph(state, 15), word(`state.${state}`)));
  dialog.replaceChildren(element("h2", {}, word("help.title")),
    element("div", { class: "two" }, element("table", {}, ...lines.slice(0, half)), element("table", {}, ...lines.slice(half))),
    element("div", { class: "marks-key" }, ...looks, element("span", {}, glyph("control", palette.current, 15), word("role.control")), element("span", {}, glyph("check", palette.check, 15), word("role.check")), element("span", {}, glyph("circle", palette.predicted, 15), word("mark.predicted")), element("span", {}, glyph("square", palette.peak, 15), word("mark.peak"))),
    element("p", {}, word("place.hint")), element("p", {}, word("help.pictures")), element("p", {}, word("help.camera")),
    element("p", {}, element("button", { onclick: () => { dialog.close(); document.querySelector("[data-act=tour]").click(); } }, word("tour"))));
  dialog.showModal();
}
