// The sheet of keys and marks, those of the other sheets too.
import { byId, element, first, glyph, keyName, sheetHead, start, stateGlyph, tip, word }
  from "./words.js";

/** @type {State[]} */
const STATES = ["auto", "accepted", "dubious", "rejected", "unused"];

export function toggleHelp() {
  const dialog = byId("help");
  if (dialog.open) return dialog.close();
  const lines = start.keys.map(([key, name]) => element("tr", {},
    element("td", {}, element("kbd", {}, keyName(key))),
    element("td", {}, word(name), element("span", {}, tip(name) ?? ""))));
  const half = Math.ceil(lines.length / 2);
  const { current, check, predicted, peak } = start.palette;
  const looks = STATES.map((state) => element("span", { title: word(`state.${state}.long`) },
    stateGlyph(state, 15), word(`state.${state}`)));
  const marks = [
    ["control", current, word("role.control")], ["check", check, word("role.check")],
    ["circle", predicted, word("mark.predicted")], ["square", peak, word("mark.peak")],
  ].map(([shape, colour, text]) => element("span", {},
    element("i", { class: "on-picture" }, glyph(shape, colour, 15)), text));
  const sheets = ["mosaic", "checks", "board", "mask"].map((name) => element("p", {},
    element("b", {}, `${word(name)}: `), word(`${name}.hint`)));
  const tour = () => {
    dialog.close();
    first("[data-act=tour]").click();
  };
  dialog.replaceChildren(
    sheetHead(dialog, "help.title", element("button", { onclick: tour }, word("tour"))),
    element("div", { class: "marks-key" }, ...looks, ...marks),
    element("div", { class: "two" }, element("table", {}, ...lines.slice(0, half)),
      element("table", {}, ...lines.slice(half))),
    element("div", { class: "gestures" }, element("p", {}, word("place.hint")),
      element("p", {}, word("help.pictures")), element("p", {}, word("help.camera")), ...sheets));
  dialog.showModal();
}
