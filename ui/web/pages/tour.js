// Five steps for whoever sits down for the first time.
import { byId, element, start, word } from "/pages/words.js";

const STEPS = [["queue", "right"], ["panes", "left"], ["acts", "left"], ["aside", "left"], ["status", "above"]];
let step = 0;

export const tourIsNew = () => !localStorage.getItem("gruber.tour") && !navigator.webdriver;

export function startTour() {
  step = 0;
  show();
}

function end() {
  localStorage.setItem("gruber.tour", "seen");
  byId("tour").hidden = true;
  document.querySelector(".toured")?.classList.remove("toured");
}

function show() {
  document.querySelector(".toured")?.classList.remove("toured");
  if (step >= STEPS.length) return end();
  const [place, side] = STEPS[step];
  const target = byId(place);
  target.classList.add("toured");
  const box = target.getBoundingClientRect();
  const room = byId("tour");
  room.hidden = false;
  room.replaceChildren(element("b", {}, word(`tour.${place}.title`)), element("p", {}, word(`tour.${place}`)),
    element("footer", {}, element("span", { class: "muted" }, `${step + 1} / ${STEPS.length}`), element("span", { class: "stretch" }),
      element("button", { id: "tour-end", onclick: end }, word("tour.end")),
      element("button", { id: "tour-next", class: "on", onclick: () => { step += 1; show(); } }, word(step === STEPS.length - 1 ? "tour.done" : "tour.next"))));
  const [width, height] = [room.offsetWidth, room.offsetHeight];
  const left = side === "right" ? box.right + 14 : side === "left" ? box.left - width - 14 : window.innerWidth / 2 - width / 2;
  const top = side === "above" ? box.top - height - 14 : box.top + Math.min(40, box.height / 2);
  room.style.left = `${Math.min(Math.max(8, left), window.innerWidth - width - 8)}px`;
  room.style.top = `${Math.min(Math.max(8, top), window.innerHeight - height - 8)}px`;
  byId("tour-next").focus();
}
