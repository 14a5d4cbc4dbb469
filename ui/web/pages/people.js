// Who sits at the desk, under which name one decides, and who looks at the same point.
import { byId, element, start, word } from "./words.js";
import { isOpen, send } from "./wire.js";

export function setUpPeople() {
  byId("who").addEventListener("click", askName);
  byId("who").title = word("people.name.tip");
  const label = word("people.name");
  const field = { id: "name-field", maxlength: "40", autocomplete: "off", "aria-label": label };
  byId("naming").replaceChildren(element("form", { method: "dialog", onsubmit: takeName },
    element("h2", {}, label), element("p", {}, word("people.name.tip")), element("input", field),
    element("button", { type: "submit" }, word("people.take"))));
  const kept = localStorage.getItem("gruber.name");
  if (kept && !start.guest) sendLater(kept);
}

/** The wire may not be open yet. @param {string} name */
function sendLater(name, tries = 20) {
  if (isOpen()) send({ kind: "name", name });
  else if (tries) setTimeout(() => sendLater(name, tries - 1), 250);
}

function askName() {
  if (start.guest) return;
  byId("name-field").value = byId("who").dataset.name ?? "";
  byId("naming").showModal();
}

/** The name under which one decides. */
export const sitting = () => byId("who").dataset.name ?? "";

/** Whether somebody is the one who sits here. @param {{ who: string }} said */
export const isOwn = ({ who }) => !start.guest && who === sitting();

function takeName() {
  const name = byId("name-field").value.trim();
  if (!name) return;
  localStorage.setItem("gruber.name", name);
  send({ kind: "name", name });
}

/** @param {Status} status @param {Key} [key] where one is oneself */
export function showPeople({ operator, people }, key) {
  byId("who").dataset.name = operator;
  byId("who").textContent = start.guest
    ? word(start.looking ? "people.looking" : "people.guest") : operator;
  byId("people").hidden = people.length === 0;
  byId("people").replaceChildren(...people.map(([name, place]) => {
    const at = word("people.at", { name, point: place.join(" \u00b7 ") });
    return element("span", { class: "person", title: place.length ? at : name }, name);
  }));
  const here = people.filter(([, [point, photo]]) => key && point === key[0] && photo === key[1]);
  const names = here.map(([name]) => name).join(", ");
  byId("also-here").hidden = here.length === 0;
  byId("also-here").textContent = here.length ? word("people.here", { names }) : "";
}
