// The page of lessons: a lesson is chosen, its sliders are moved, its question is answered.
import {
  again, all, byId, element, fillWords, first, number, numberOf, start, turn, word, written,
} from "./words.js";
import { post, tell } from "./run.js";
import { takeSeat } from "./wire.js";
import { nextTheme, setUpTheme } from "./theme.js";
import { afterPause } from "./view.js";
import { drawingRooms } from "./lesson_drawing.js";
import { drawPlot } from "./lesson_plot.js";
import { equationShown, symbolShown, told } from "./lesson_numbers.js";
import { saveAnswers, showQuestion, showScore } from "./lesson_question.js";

const HUES = 6;
const HERE = ["localhost", "127.0.0.1", "[::1]"];
/**
 * Rooms of formulas, each larger, and sizes of letters: the first in which all of them fit.
 * From 15 on no letter is smaller than 12 pixels.
 */
const ROOMS = /** @type {[string, number[]][]} */ (
  [["", [19, 17, 15]], ["long", [15]], ["longer", [15, 14, 13, 12, 11]]]);
const state = {
  lessons: /** @type {Lesson[]} */ ([]),
  lesson: /** @type {Lesson} */ (/** @type {unknown} */ (null)),
  values: /** @type {Record<string, number>} */ ({}),
  view: /** @type {LessonView | null} */ (null),
  truth: false,
  asking: false,
  again: false,
  show: /** @type {((canvases: LessonCanvas[]) => void) | null} */ (null),
  /** What tests and measurements look at: milliseconds from slider to picture. */
  waits: /** @type {number[]} */ ([]),
};

/** A text of the present lesson; the key itself where it has none. @param {string} key */
function text(key, values = {}) {
  const whole = `lesson.${state.lesson.name}.${key}`;
  return whole in start.words ? word(whole, values) : key.replace(/^label\./, "");
}

async function load() {
  await takeSeat();
  const answer = await fetch(`/lessons/${start.language}`);
  const listed = await answer.json();
  Object.assign(start.words, listed.words);
  state.lessons = listed.lessons;
  fillWords();
  setUpTheme();
  showList();
  const asked = new URLSearchParams(location.search);
  const wanted = state.lessons.find(({ name }) => name === asked.get("lesson"));
  if (asked.get("lesson") && !wanted) {
    tell(word("teach.unknown", { name: asked.get("lesson") }), true);
  }
  choose(wanted ?? state.lessons[0], asked);
}

function showList() {
  byId("list").replaceChildren(...state.lessons.map(({ name, letter }) => element("button",
    { "data-lesson": name, onclick: () => go(lessonOf(name)) },
    element("i", {}, letter), element("span", {}, word(`lesson.${name}.title`)))));
}

/** @param {string} name */
const lessonOf = (name) => /** @type {Lesson} */ (state.lessons.find((one) => one.name === name));

/** Another lesson; the browser's Back returns. @param {Lesson} lesson */
function go(lesson) {
  if (lesson !== state.lesson) {
    keepLinkNow();
    history.pushState(null, "", `/?lesson=${lesson.name}`);
  }
  choose(lesson, null);
}

function goBack() {
  const asked = new URLSearchParams(location.search);
  choose(lessonOf(asked.get("lesson") ?? "") ?? state.lessons[0], asked);
}

/** @param {Lesson} lesson @param {URLSearchParams | null} asked a link's values */
function choose(lesson, asked) {
  byId("lesson").removeAttribute("data-stale");
  Object.assign(state, { lesson, view: null, show: null, truth: asked?.get("truth") === "1" });
  state.values = Object.fromEntries(lesson.sliders.map(({ name, start: opening, low, high }) => {
    const given = Number(asked?.get(name) || NaN);
    return [name, given >= low && given <= high ? given : opening];
  }));
  for (const button of all("#list button")) {
    button.setAttribute("aria-current", `${button.dataset.lesson === lesson.name}`);
  }
  document.title = `${text("title")} \u2013 Gruber`;
  byId("about").replaceChildren(element("h1", {}, text("title")),
    element("p", {}, text("idea")), element("p", { class: "try" }, text("try")));
  for (const room of ["drawings", "formulas", "plot", "figures"]) byId(room).replaceChildren();
  showSliders();
  showQuestion(byId("question"), lesson, text, () => state.values);
  refresh();
}

function showSliders() {
  const { sliders, truth } = state.lesson;
  const rows = sliders.filter(({ moved_in: within }) => !within).map(sliderRow);
  const acts = [element("button", { class: "small", id: "reset", onclick: reset },
    word("teach.reset"))];
  if (truth) {
    const button = element("button", { class: "small", id: "truth", onclick: () => {
      state.truth = !state.truth;
      turn(button, state.truth);
      refresh();
    } }, word("teach.truth"));
    turn(button, state.truth);
    acts.unshift(button);
  }
  byId("sliders").replaceChildren(element("h2", {}, word("teach.sliders")), ...rows,
    element("div", { class: "acts" }, ...acts));
}

/** @param {LessonSlider} slider */
function sliderRow(slider) {
  const { name, low, high, step, unit, symbol, switch: onOff } = slider;
  const title = text(`slider.${name}`);
  if (onOff) {
    const box = element("input", { type: "checkbox", id: `slider-${name}`, "data-name": name,
      oninput: () => set(name, box.checked ? 1 : 0) });
    box.checked = Boolean(state.values[name]);
    return element("label", { class: "slider on-off", "data-slider": name }, box, title);
  }
  if (`lesson.${state.lesson.name}.choice.${name}.${low}` in start.words) return choices(slider);
  const range = element("input", { type: "range", id: `slider-${name}`, min: low, max: high, step,
    "data-name": name, oninput: () => set(name, Number(range.value)) });
  const typed = element("input", { inputmode: "decimal", autocomplete: "off",
    "data-typed": name, "aria-label": title, onchange: () => {
      const given = numberOf(typed.value);
      set(name, Number.isFinite(given) ? Math.min(Math.max(given, low), high)
        : state.values[name]);
    } });
  range.value = `${state.values[name]}`;
  typed.value = written(state.values[name]);
  const hue = hueOf(slider);
  return element("div", { class: `slider ${hue === undefined ? "" : `hue-${hue}`}`,
    "data-slider": name },
  element("label", { for: `slider-${name}` }, title, symbol ? symbolShown(symbol) : null),
  element("span", { class: "typed" }, ...(name === "step" ? paced(slider, typed)
    : [typed, element("span", { class: "unit" }, unit)])), range);
}

/** A field with buttons that go through a lesson's steps. @param {LessonSlider} slider */
function paced({ name, low, high, step }, /** @type {Node} */ field) {
  const by = (/** @type {string} */ key, /** @type {string} */ sign, /** @type {number} */ way) =>
    element("button", { type: "button", class: "small", title: word(`teach.${key}`),
      "aria-label": word(`teach.${key}`), "data-pace": key, onclick: () =>
        set(name, Math.min(Math.max(state.values[name] + way * step, low), high)) }, sign);
  return [by("back", "\u25c0", -1), field, by("forward", "\u25b6", 1)];
}

/** A slider whose few values have names. @param {LessonSlider} slider */
function choices({ name, low, high, step }) {
  const count = Math.round((high - low) / step) + 1;
  const buttons = Array.from({ length: count }, (_, place) => {
    const value = low + place * step;
    const made = element("button", { type: "button", "data-choice": name, "data-value": value,
      onclick: () => set(name, value) }, text(`choice.${name}.${value}`));
    turn(made, state.values[name] === value);
    return made;
  });
  return element("div", { class: "slider", "data-slider": name },
    element("span", {}, text(`slider.${name}`)),
    element("div", { class: "segments choices" }, ...buttons));
}

/** Sliders of a formula have a colour that their numbers share. @param {LessonSlider} slider */
function hueOf({ name, symbol }) {
  const place = state.lesson.sliders.filter((one) => one.symbol)
    .findIndex((one) => one.name === name);
  return symbol ? place % HUES : undefined;
}

/** @param {string} name @param {number} value */
function set(name, value) {
  state.values[name] = value;
  showValue(name, value);
  refresh();
}

/** @param {string} name @param {number} value */
function showValue(name, value) {
  const range = /** @type {HTMLInputElement | null} */ (document.getElementById(`slider-${name}`));
  const typed = /** @type {HTMLInputElement | null} */ (
    document.querySelector(`[data-typed="${name}"]`));
  if (range?.type === "checkbox") range.checked = Boolean(value);
  else if (range) range.value = `${value}`;
  if (typed) typed.value = written(value);
  for (const button of all(`[data-choice="${name}"]`)) {
    turn(button, Number(button.dataset.value) === value);
  }
}

/** The truth of what is to be tried again is hidden with it. */
function reset() {
  state.truth = false;
  const shown = document.getElementById("truth");
  if (shown) turn(shown, false);
  for (const { name, start: opening } of state.lesson.sliders) set(name, opening);
}

/** Moves two sliders by a handle. @param {[string, string]} names @param {Pair} to */
function move(names, to, nudge = false) {
  names.forEach((name, axis) => {
    const slider = state.lesson.sliders.find((one) => one.name === name);
    if (!slider) return;
    const { low, high, step } = slider;
    const wanted = nudge ? state.values[name] + step * to[axis] : to[axis];
    const rounded = low + Math.round((wanted - low) / step) * step;
    set(name, Number(Math.min(Math.max(rounded, low), high).toFixed(6)));
  });
}

/** One question to the engine at a time; while it computes only the newest state waits. */
async function refresh() {
  state.again = true;
  keepLink();
  if (state.asking) return;
  state.asking = true;
  try {
    await askNewest();
  } finally {
    state.asking = false;
  }
}

async function askNewest() {
  while (state.again) {
    state.again = false;
    const [began, { lesson }] = [performance.now(), state];
    const answer = await post(`/lesson/${lesson.name}`,
      { state: state.values, truth: state.truth });
    if (lesson === state.lesson && answer.error) showFault(answer.error);
    else if (lesson === state.lesson) {
      // A step may have another number of drawings than the one before.
      if (state.view?.canvases.length !== answer.canvases.length) state.show = null;
      state.view = answer;
      byId("lesson").removeAttribute("data-stale");
      show();
      state.waits.push(performance.now() - began);
    }
  }
}

/**
 * In the place of the figures; what was shown before is no longer true. @param {Told} said
 */
function showFault(said) {
  byId("lesson").toggleAttribute("data-stale", true);
  const named = typeof said === "string" ? said
    : { ...said, values: { ...said.values, file: text("title") } };
  byId("figures").replaceChildren(element("h2", {}, word("teach.figures")),
    element("p", { class: "beware", role: "alert" }, again(named)));
}

function show() {
  const { view, lesson } = state;
  if (!view || byId("lesson").hasAttribute("data-stale")) return;
  state.show ??= drawingRooms(byId("drawings"), view.canvases, {
    text, move, describe: (names) => names.map((name) => text(`slider.${name}`)).join(", "),
  });
  first("#about p").textContent = text(view.step ? `step.${view.step}` : "idea");
  showIdle(view);
  byId("plot").hidden = !view.plot;
  showFormulas(view, lesson);
  showFigures(view);
  // Plot and formulas first: what they need is not the drawings'.
  drawPlot(byId("plot"), view.plot, text);
  state.show(view.canvases);
}

/** @param {LessonView} view @param {Lesson} lesson */
function showFormulas({ symbols, step, equations: own }, { sliders, equations }) {
  const known = /** @type {Record<string, LessonValue>} */ ({ ...symbols });
  for (const slider of sliders) {
    if (!slider.symbol) continue;
    const digits = (`${slider.step}`.split(".")[1] ?? "").length;
    const { unit, name } = slider;
    // A formula may have it in another unit than the slider.
    const moved = { value: state.values[name], digits, unit, truth: null };
    const here = symbols[slider.symbol] ?? moved;
    known[slider.symbol] = Array.isArray(here) ? here : { ...here, hue: hueOf(slider) };
  }
  const source = text(step ? `source_of.${step}` : "source");
  const shown = own.length ? own : equations;
  byId("formulas").replaceChildren(...shown.map((one) => equationShown(one, known)),
    element("p", { class: "source" }, `${word("teach.source")}: ${source}`));
  const room = byId("formulas");
  ROOMS.some(([wide, sizes]) => {
    byId("lesson").className = wide;
    return sizes.some((size) => {
      room.style.setProperty("--size", `${size}px`);
      return room.scrollHeight <= room.clientHeight && [...room.children].every((row) =>
        row.scrollWidth <= row.clientWidth);
    });
  });
}

/**
 * Sliders that move nothing now cannot be moved, say why, and show what is in force.
 * @param {LessonView} view
 */
function showIdle({ idle, in_force: inForce }) {
  const said = new Set();
  for (const row of all("#sliders [data-slider]")) {
    const name = row.dataset.slider ?? "";
    const reason = idle[name];
    if (reason || row.querySelector(":disabled")) {
      showValue(name, inForce[name] ?? state.values[name]);
    }
    for (const input of /** @type {NodeListOf<HTMLInputElement | HTMLButtonElement>} */ (
      row.querySelectorAll("input, button"))) input.disabled = Boolean(reason);
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (
      row.querySelectorAll("[data-choice]"))) {
      turn(button, Number(button.dataset.value) === (reason ? inForce : state.values)[name]);
    }
    row.querySelector(".idle")?.remove();
    // One reason of several sliders is said under the first of them.
    if (reason && !said.has(reason)) {
      row.append(element("small", { class: "idle" }, text(`idle.${reason}`)));
    }
    said.add(reason);
  }
}

/** @param {LessonView} view */
function showFigures({ figures, warning }) {
  const rows = Object.entries(figures).map(([name, shown]) => element("div",
    { class: "figure", "data-figure": name, "data-value": `${shown.value}` },
    element("span", {}, text(`figure.${name}`)), element("b", {}, told(shown)),
    shown.truth === null ? null
      : element("em", {}, `${word("teach.truth.is")} ${told({ ...shown, value: shown.truth })}`)));
  const beware = warning ? [element("p", { class: "beware" }, text(`warning.${warning}`))] : [];
  byId("figures").replaceChildren(element("h2", {}, word("teach.figures")), ...beware, ...rows);
}

/** What opens the lesson as it is now. */
function linkValues() {
  const kept = new URLSearchParams({ lesson: state.lesson.name });
  for (const { name, start: opening } of state.lesson.sliders) {
    if (state.values[name] !== opening) kept.set(name, `${state.values[name]}`);
  }
  if (state.truth) kept.set("truth", "1");
  return kept;
}

/** The address holds lesson and sliders: the page comes back as it was. */
const keepLinkNow = () => history.replaceState(null, "", `/?${linkValues()}`);
const keepLink = afterPause(keepLinkNow);

/** A link for students: it lets them in, as guests. */
async function copyLink() {
  const link = new URL(start.invitation);
  // Who came by a name of the network hands that on.
  if (!HERE.includes(location.hostname)) link.host = location.host;
  linkValues().forEach((value, name) => link.searchParams.set(name, value));
  try {
    await navigator.clipboard.writeText(link.href);
    tell(word("teach.copied"));
  } catch {
    // Browsers give the clipboard to safe addresses only.
    prompt(word("teach.copy"), link.href);
  }
}

document.addEventListener("click", (event) => {
  const act = /** @type {HTMLElement} */ (event.target).closest("[data-act=theme]");
  if (act) nextTheme();
});
byId("answers-save").addEventListener("click", saveAnswers);
byId("link-copy").addEventListener("click", copyLink);
addEventListener("resize", show);
addEventListener("popstate", goBack);
window.gruber = { state, number };
load().then(showScore, (error) => tell(String(error), true));
