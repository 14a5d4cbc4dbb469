// Dark, light, or as the machine likes it.
import { byId, first, glyph, word } from "./words.js";

const THEMES = ["dark", "light", "system"];
const light = matchMedia("(prefers-color-scheme: light)");

export function setUpTheme() {
  show(chosen());
  light.addEventListener("change", () => show(chosen()));
  // Paper is light whatever the desk is.
  addEventListener("beforeprint", () => show("light"));
  addEventListener("afterprint", () => show(chosen()));
}

const chosen = () => localStorage.getItem("gruber.theme") ?? "dark";

/** @param {string} theme */
const after = (theme) => THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length];

export function nextTheme() {
  localStorage.setItem("gruber.theme", after(chosen()));
  show(chosen());
}

/** @param {string} wanted */
function show(wanted) {
  const theme = wanted !== "system" ? wanted : light.matches ? "light" : "dark";
  document.documentElement.dataset.theme = theme;
  const button = first("[data-act=theme]");
  button.replaceChildren(glyph("theme", "currentColor", 15),
    word(`theme.${after(wanted)}`));
  byId("scene").contentDocument?.documentElement?.setAttribute("data-theme", theme);
}
