// Five steps for whoever sits down for the first time.
import { byId, element, word } from "./words.js";

const STEPS = [
  ["queue", "right"], ["panes", "left"], ["acts", "above"], ["facts", "above"], ["status", "above"],
];
const GAP = 14;
const EDGE = 8;
const state = { step: 0 };

export const tourIsNew = () => !localStorage.getItem("gruber.tour");

export function startTour() {
  state.step = 0;
  byId("tour").addEventListener("close", ended, { once: true });
  byId("tour").showModal();
  addEventListener("resize", show);
  show();
}

function ended() {
  removeEventListener("resize", show);
  localStorage.setItem("gruber.tour", "seen");
  document.querySelector(".toured")?.classList.remove("toured");
}

const end = () => byId("tour").close();

function next() {
  state.step += 1;
  show();
}

function show() {
  document.querySelector(".toured")?.classList.remove("toured");
  if (state.step >= STEPS.length) return end();
  const [place, side] = STEPS[state.step];
  const target = byId(place);
  target.classList.add("toured");
  const box = target.getBoundingClientRect();
  const room = byId("tour");
  const go = word(state.step === STEPS.length - 1 ? "tour.done" : "tour.next");
  room.replaceChildren(
    element("b", {}, word(`tour.${place}.title`)), element("p", {}, word(`tour.${place}`)),
    element("footer", {},
      element("span", { class: "muted" }, `${state.step + 1} / ${STEPS.length}`),
      element("span", { class: "stretch" }),
      element("button", { id: "tour-end", onclick: end }, word("tour.end")),
      element("button", { id: "tour-next", class: "on", onclick: next }, go)));
  const [width, height] = [room.offsetWidth, room.offsetHeight];
  const left = side === "right" ? box.right + GAP : side === "left" ? box.left - width - GAP
    : window.innerWidth / 2 - width / 2;
  const top = side === "above" ? box.top - height - GAP : box.top + Math.min(40, box.height / 2);
  const [right, low] = [window.innerWidth - width, window.innerHeight - height];
  room.style.left = `${Math.min(Math.max(EDGE, left), right - EDGE)}px`;
  room.style.top = `${Math.min(Math.max(EDGE, top), low - EDGE)}px`;
  byId("tour-next").focus();
}
