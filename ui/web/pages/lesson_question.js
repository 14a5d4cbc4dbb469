// The question of a lesson: new numbers each time, judged by the engine, kept for a table.
import { all, byId, element, number, numberOf, word } from "./words.js";
import { post, tell } from "./run.js";
import { told } from "./lesson_numbers.js";

const KEPT = "gruber.answers";
const STUDENT = "gruber.student";
const state = {
  which: 0,
  seed: 0,
  tries: 0,
  asked: /** @type {LessonAsked} */ ({ name: "", values: {}, unit: "", signed: false }),
  sliders: /** @type {() => Record<string, number>} */ (() => ({})),
  done: false,
};

/** Each attempt, as the table of answers is made of it. @returns {LessonAttempt[]} */
const kept = () => JSON.parse(localStorage.getItem(KEPT) ?? "[]");

/**
 * @param {HTMLElement} room @param {Lesson} lesson
 * @param {(key: string, values?: Record<string, unknown>) => string} text
 * @param {() => Record<string, number>} sliders where they stand
 */
export async function showQuestion(room, lesson, text, sliders) {
  Object.assign(state, { seed: Math.floor(Math.random() * 1e9), tries: 0, done: false, sliders,
    which: state.which % lesson.questions.length });
  const { which, seed } = state;
  room.replaceChildren();
  const asked = await post(`/lesson/${lesson.name}/question`, { which, seed });
  if (!asked.ok) return tell(asked.error, true);
  if (seed !== state.seed) return undefined;
  state.asked = asked;
  const field = element("input", { id: "answer", inputmode: "decimal", autocomplete: "off",
    "aria-label": word("teach.answer") });
  const said = element("p", { id: "said", role: "status" });
  const judged = (/** @type {number | null} */ answer) => judge(lesson, answer, said, text);
  const form = element("form", { class: "answering", onsubmit: (/** @type {Event} */ event) => {
    event.preventDefault();
    const answer = numberOf(field.value);
    if (Number.isFinite(answer)) judged(answer);
    else speak(said, word("teach.nonsense"));
  } }, field, element("span", { class: "unit" }, asked.unit),
  element("button", { class: "on", type: "submit", id: "check" }, word("teach.check")));
  const next = async () => {
    state.which += 1;
    await showQuestion(room, lesson, text, sliders);
    document.getElementById("answer")?.focus();
  };
  const acts = element("div", { class: "acts" },
    act("hint", () => speak(said, text(`hint.${asked.name}`))),
    act("give-up", () => judged(null)), act("next", next));
  room.replaceChildren(element("h2", {}, word("teach.question")),
    element("p", { class: "asked" }, text(`question.${asked.name}`, asked.values),
      asked.signed ? ` ${text(`sign.${asked.name}`)}` : ""), form, acts, said);
  return undefined;
}

/** A verdict or a hint; many figures would leave it below the lower edge. @param {string} words */
function speak(/** @type {HTMLElement} */ said, words) {
  said.textContent = words;
  said.scrollIntoView({ block: "nearest" });
}

/** @param {string} name @param {() => void} onclick */
const act = (name, onclick) => element("button", { class: "small", id: name, onclick },
  word(`teach.${name}`));

/**
 * @param {Lesson} lesson @param {number | null} answer null gives up
 * @param {HTMLElement} said @param {(key: string) => string} text
 */
async function judge(lesson, answer, said, text) {
  const { which, seed, asked } = state;
  const judged = await post(`/lesson/${lesson.name}/answer`, { which, seed, answer });
  if (!judged.ok) return tell(judged.error, true);
  const { right, opposite, answer: truth, digits, tolerance } = judged;
  state.tries += 1;
  const { unit } = asked;
  const shown = (/** @type {number} */ value, places = digits) =>
    told({ value, digits: places, unit, truth: null });
  said.className = right ? "right" : "wrong";
  if (right) {
    speak(said, word("teach.right", { answer: shown(truth),
      tolerance: number(tolerance, tolerance < 1 ? 2 : 1) }));
  } else if (answer === null) {
    speak(said, word("teach.was", { answer: shown(truth) }));
  } else if (opposite) {
    speak(said, word("teach.opposite", {
      sign: asked.signed ? text(`sign.${asked.name}`) : word("teach.unsigned") }));
  } else {
    speak(said, `${word("teach.wrong")} ${state.tries > 1 ? text(`hint.${asked.name}`) : ""}`);
  }
  if (!state.done) keep(lesson.name, answer, right);
  state.done ||= right || answer === null;
  return showScore();
}

/** @param {string} lesson @param {number | null} answer @param {boolean} right */
function keep(lesson, answer, right) {
  const { which, seed } = state;
  const attempt = { when: new Date().toISOString(), lesson, which, seed, answer, right,
    state: { ...state.sliders() } };
  localStorage.setItem(KEPT, JSON.stringify([...kept(), attempt]));
}

export function showScore() {
  const rows = kept();
  const questions = new Set(rows.map(({ lesson, seed }) => `${lesson} ${seed}`));
  const right = rows.filter((one) => one.right).length;
  for (const button of all("#list button")) {
    const done = rows.some((one) => one.right && one.lesson === button.dataset.lesson);
    button.toggleAttribute("data-done", done);
  }
  byId("score").textContent = rows.length
    ? word("teach.score", { right, count: questions.size }) : "";
}

/** All attempts as a table, which the engine writes: it knows the right answers. */
export async function saveAnswers() {
  const student = prompt(word("teach.student"), localStorage.getItem(STUDENT) ?? "");
  if (student === null) return;
  localStorage.setItem(STUDENT, student);
  const answer = await fetch("/answers", { method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ student, attempts: kept() }) }).catch(() => null);
  if (!answer?.ok) {
    tell(answer ? await answer.text() : word("teach.lost"), true);
    return;
  }
  const link = element("a", { href: URL.createObjectURL(await answer.blob()),
    download: "answers.csv" });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
