// The year the mosaic is compared with: those of other orthos and mosaics, the reference last.
import { byId, element, start, word } from "./words.js";

const state = { year: /** @type {number | undefined} */ (undefined) };

/** Its number among the years, and what it is called. @returns {[number | undefined, string]} */
export function comparedYear() {
  const at = state.year ?? start.years?.length ?? 0;
  const year = start.years?.[at];
  return year ? [at, `${year}`]
    : [undefined, word(start.ortho ? "pane.ortho" : "pane.no-ortho")];
}

/** A slider over the years; nothing where there is no other. @param {() => void} redraw */
export function yearSlider(redraw) {
  const years = start.years ?? [];
  if (!years.length) return [];
  const told = element("output", { for: "mosaic-year" }, comparedYear()[1]);
  const ticks = [...years.map(String), word("pane.ortho")].map(
    (label, at) => element("option", { value: at, label }));
  const slider = element("input", { type: "range", id: "mosaic-year", min: 0, max: years.length,
    step: 1, value: state.year ?? years.length, list: "mosaic-years", title: word("mosaic.year"),
    "aria-label": word("mosaic.year"), "aria-valuetext": comparedYear()[1] });
  slider.addEventListener("input", () => {
    state.year = byId("mosaic-year").valueAsNumber;
    const [, label] = comparedYear();
    told.textContent = label;
    slider.setAttribute("aria-valuetext", label);
    redraw();
  });
  return [slider, element("datalist", { id: "mosaic-years" }, ...ticks), told];
}
