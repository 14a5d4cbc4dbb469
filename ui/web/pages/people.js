// Who sits at the desk, under which name one decides, and who looks at the same point.
import { byId, element, start, word } from "/pages/words.js";

let send = () => {};

export function setUpPeople(sender) {
  send = sender;
  byId("who").addEventListener("click", askName);
  byId("who").title = word("people.name.tip");
  const form = element("form", { method: "dialog", onsubmit: chosen },
    element("h2", {}, word("people.name")),
    element("p", {}, word("people.name.tip")),
    element("input", { id: "name-field", maxlength: "40", autocomplete: "off", "aria-label": word("people.name") }),
    element("button", { type: "submit" }, word("people.take")));
  byId("naming").replaceChildren(form);
  const kept = localStorage.getItem("gruber.name");
  if (kept && !start.guest) sendLater(kept);
}

// The wire may not be open yet.
function sendLater(name, tries = 20) {
  if (!send({ kind: "name", name }) && tries) setTimeout(() => sendLater(name, tries - 1), 250);
}

function askName() {
  if (start.guest) return;
  byId("name-field").value = byId("who").dataset.name ?? "";
  byId("naming").showModal();
}

function chosen() {
  const name = byId("name-field").value.trim();
  if (!name) return;
  localStorage.setItem("gruber.name", name);
  send({ kind: "name", name });
}

export function showPeople(status, key) {
  byId("who").dataset.name = status.operator;
  byId("who").textContent = start.guest ? word("people.guest") : status.operator;
  byId("people").hidden = status.people.length === 0;
  byId("people").replaceChildren(...status.people.map(([name, place]) => element("span", { class: "person", title: place.length ? word("people.at", { name, point: place.join(" \u00b7 ") }) : name }, name)));
  const here = status.people.filter(([, place]) => key && place[0] === key[0] && place[1] === key[1]).map(([name]) => name);
  byId("also-here").hidden = here.length === 0;
  byId("also-here").textContent = here.length ? word("people.here", { names: here.join(", ") }) : "";
}
