// As the machine likes it, until dark or light is chosen.
import { byId, first, glyph, word } from "./words.js";

const light = matchMedia("(prefers-color-scheme: light)");

export function setUpTheme() {
  show(chosen());
  light.addEventListener("change", () => show(chosen()));
  // Paper is light whatever the desk is.
  addEventListener("beforeprint", () => show("light"));
  addEventListener("afterprint", () => show(chosen()));
}

const chosen = () => localStorage.getItem("gruber.theme") ?? "system";

/** From the system's to what that is not. @param {string} theme */
function after(theme) {
  const themes = ["system", ...(light.matches ? ["dark", "light"] : ["light", "dark"])];
  return themes[(themes.indexOf(theme) + 1) % themes.length];
}

export function nextTheme() {
  localStorage.setItem("gruber.theme", after(chosen()));
  show(chosen());
}

/** @param {string} wanted */
const meant = (wanted) => (wanted !== "system" ? wanted : light.matches ? "light" : "dark");

/** @param {string} wanted */
function show(wanted) {
  const theme = meant(wanted);
  document.documentElement.dataset.theme = theme;
  const button = first("[data-act=theme]");
  button.replaceChildren(glyph("theme", "currentColor", 15),
    word(`theme.${after(wanted)}`));
  byId("scene").contentDocument?.documentElement?.setAttribute("data-theme", theme);
}

// At once; words for its button come later.
document.documentElement.dataset.theme = meant(chosen());
