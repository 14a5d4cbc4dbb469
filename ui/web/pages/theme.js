// Dark, light, or as the machine likes it.
import { byId, first, glyph, word } from "./words.js";

const THEMES = ["dark", "light"];

export function setUpTheme() {
  show(chosen());
  // Paper is light whatever the desk is.
  addEventListener("beforeprint", () => show("light"));
  addEventListener("afterprint", () => show(chosen()));
}

const chosen = () => localStorage.getItem("gruber.theme") ?? "dark";

export function nextTheme() {
  const now = document.documentElement.dataset.theme ?? "";
  const next = THEMES[(THEMES.indexOf(now) + 1) % THEMES.length];
  localStorage.setItem("gruber.theme", next);
  show(next);
}

/** @param {string} theme */
function show(theme) {
  document.documentElement.dataset.theme = theme;
  const button = first("[data-act=theme]");
  button.replaceChildren(glyph("theme", "currentColor", 15),
    word(theme === "dark" ? "theme.light" : "theme.dark"));
  byId("scene").contentDocument?.documentElement?.setAttribute("data-theme", theme);
}
