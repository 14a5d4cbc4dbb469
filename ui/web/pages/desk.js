// The desk: joins queue, scene, compare and status to the wire; keys and buttons mean the same.
import { byId, element, learnNames, number, shortName, shortPoint, start, stateGlyph, word } from "/pages/words.js";
import { clearMarked, markCurrent, markedKeys, setUpQueue, showQueue } from "/pages/queue.js";
import { setUpPoint, showPoint } from "/pages/point.js";
import { blink, comparePoint, compareState, fitCompare, nudge, setUpCompare, switchCompare, zoomCompare } from "/pages/compare.js";
import { showStatus } from "/pages/status.js";
import { setUpPeople, showPeople } from "/pages/people.js";
import { openQuality, setUpQuality, showQuality } from "/pages/quality.js";
import { boardKey, boardState, openBoard, setUpBoard, showBoard } from "/pages/board.js";
import { openPlacement, placementKey, placementState, setUpPlacement, showPlacement } from "/pages/placement.js";
import { setUpResults } from "/pages/results.js";
import { nextTheme, setUpTheme } from "/pages/theme.js";
import { startTour, tourIsNew } from "/pages/tour.js";
import { toggleHelp } from "/pages/help.js";

const PIECE = 50;
const notices = byId("notices");
const parts = {};
let seat = "";
let socket = null;
let waiting = 250;
let explained = 0;
let wanted = null;
let judged = { shown: "", at: 0 };

function send(message) {
  const open = socket?.readyState === WebSocket.OPEN;
  if (open) socket.send(JSON.stringify(message));
  return open;
}

const shownNow = () => JSON.stringify([parts.point?.key, parts.point?.state]);

// One verdict on what is shown: a hand ahead of the picture must not judge the same point twice.
function judge(verdict) {
  const many = markedKeys();
  if (many.length) {
    for (const key of many) send({ kind: "judge", key, verdict });
    clearMarked();
    return;
  }
  if (!parts.point) return;
  const shown = shownNow();
  if (judged.shown === shown && Date.now() - judged.at < 2000) return;
  judged = { shown, at: Date.now() };
  send({ kind: "judge", key: parts.point.key, verdict });
}

// What every button and key does. `held` acts take part in key up as well.
const ACTS = {
  accept: () => judge("accept"),
  reject: () => judge("reject"),
  dubious: () => judge("dubious"),
  invisible: () => judge("invisible"),
  role: () => parts.point && send({ kind: "role", point: parts.point.key[0] }),
  undo: () => send({ kind: "undo" }),
  redo: () => send({ kind: "redo" }),
  next: () => send({ kind: "step", step: 1 }),
  previous: () => send({ kind: "step", step: -1 }),
  wallis: () => switchCompare("wallis"),
  raw: () => switchCompare("raw"),
  likeness: () => switchCompare("likeness"),
  refine: () => parts.point && send({ kind: "refine", key: parts.point.key }),
  marks: () => switchCompare("marks"),
  fit: () => { fitCompare(); send({ kind: "fit", whole: true }); },
  "fit-whole": () => send({ kind: "fit", whole: true }),
  "fit-current": () => send({ kind: "fit", whole: false }),
  remake: () => send({ kind: "remake" }),
  cancel: () => send({ kind: "cancel" }),
  help: () => toggleHelp(),
  add: () => switchCompare("adding"),
  quality: () => openQuality(parts.quality),
  board: () => openBoard(parts.board),
  placement: () => openPlacement(parts.placement),
  theme: () => nextTheme(),
  tour: () => startTour(),
};
const KEYS = {
  KeyY: "accept", KeyN: "reject", KeyM: "dubious", KeyV: "invisible", KeyC: "role", KeyU: "undo",
  KeyJ: "next", KeyK: "previous", KeyF: "fit", KeyH: "help", KeyR: "raw", KeyL: "likeness", KeyP: "add", KeyB: "quality", KeyI: "board", KeyG: "placement", Enter: "refine", NumpadEnter: "refine",
};
const LAYERS = ["terrain", "photos", "footprints", "points", "vectors", "checks", "ties", "tie_vectors", "labels"];
const REPEATS = new Set(["next", "previous"]);
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
// Letters by what is printed on the key; by place only where another alphabet is set.
const letterOf = (event) => (event.key === "Enter" ? "Enter" : /^[a-z]$/i.test(event.key) ? `Key${event.key.toUpperCase()}` : event.code);

// Also called by viser's page for keys pressed there; true when the key is ours.
window.gruberKey = (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return false;
  const inScene = event.view !== window;
  const sheet = document.querySelector("dialog[open]:not(#help)");
  if (sheet?.id === "board") return boardKey(event, letterOf(event));
  if (sheet?.id === "placement") return placementKey(event, letterOf(event));
  if (sheet) {
    // Nothing is decided behind an open sheet.
    if (event.type === "keydown" && (event.key === "Escape" || (sheet.id === "quality" && letterOf(event) === "KeyB"))) sheet.close();
    return event.key === "Escape" || event.key.length === 1;
  }
  if (event.key === "Escape" && event.type === "keydown" && clearMarked()) return true;
  if (event.key === "Escape" && compareState().adding) {
    switchCompare("adding");
    return true;
  }
  if (byId("help").open) {
    // Nothing is decided behind an open sheet of keys.
    if (event.type === "keydown" && (event.key === "Escape" || letterOf(event) === "KeyH")) toggleHelp();
    return true;
  }
  if (event.key === " ") {
    blink(event.type === "keydown");
    return true;
  }
  if (["+", "=", "-"].includes(event.key)) {
    if (event.type === "keydown") zoomCompare(event.key === "-" ? 1 / 1.25 : 1.25);
    return true;
  }
  if (ARROWS[event.key] && !inScene) {
    if (event.type === "keydown") arrow(event);
    return true;
  }
  if (/^[1-5]$/.test(event.key) && Date.now() < explained) {
    if (event.type === "keydown" && !event.repeat) explain(Number(event.key));
    return true;
  }
  const name = KEYS[letterOf(event)];
  if (!name) return false;
  if (event.type === "keydown" && (!event.repeat || REPEATS.has(name))) {
    ACTS[name === "undo" && event.shiftKey ? "redo" : name]();
  }
  return true;
};

function arrow(event) {
  const [right, down] = ARROWS[event.key];
  if (byId("queue").contains(document.activeElement) || document.activeElement === byId("queue")) {
    if (down && event.shiftKey) markCurrent();
    if (down) send({ kind: "step", step: down });
    return;
  }
  const step = event.shiftKey ? 1 : 0.1;
  nudge(right * step, down * step);
}

function explain(digit) {
  explained = 0;
  byId("reasons").hidden = true;
  send({ kind: "explain", digit });
}

// Asked by the scene, whose frames wait where drawing is slow.
let handAt = -Infinity;
window.gruberAtWork = () => {
  const idle = performance.now() - handAt;
  return idle < 800 || (idle < 2000 && !compareState().drawn.whole);
};

function listenToKeys() {
  for (const type of ["keydown", "pointerdown", "wheel"]) window.addEventListener(type, () => { handAt = performance.now(); }, { capture: true, passive: true });
  for (const type of ["keydown", "keyup"]) {
    window.addEventListener(type, (event) => {
      const target = event.target;
      const writing = target.tagName === "TEXTAREA" || target.tagName === "SELECT" || (target.tagName === "INPUT" && target.type !== "range");
      if (!writing && window.gruberKey(event)) event.preventDefault();
    }, true);
  }
  window.addEventListener("blur", () => { if (document.activeElement !== byId("scene")) blink(false); });
}

function setUpButtons() {
  const keyOf = Object.fromEntries(start.keys.map(([key, name]) => [name, key]));
  const texts = { help: "act.help", wallis: "wallis", raw: "raw", likeness: "likeness", marks: "marks", blink: "blink", remake: "remake", cancel: "remake.cancel", quality: "quality", board: "board", placement: "placement", theme: "theme", tour: "tour", "fit-whole": "fit.whole", "fit-current": "fit.current" };
  const marks = { accept: "accepted", reject: "rejected", dubious: "dubious" };
  for (const button of document.querySelectorAll("[data-act]")) {
    const act = button.dataset.act;
    const name = texts[act] ?? `act.${act}`;
    const key = keyOf[name];
    const tip = start.words[`${name}.tip`];
    button.title = [tip ?? word(name), key ? `(${key})` : ""].join(" ").trim();
    button.replaceChildren(...(marks[act] ? [stateGlyph(marks[act], 14)] : []), word(name));
    if (key && !button.classList.contains("toggle")) button.append(element("kbd", {}, key));
    if (act === "blink") {
      for (const [type, on] of [["pointerdown", true], ["pointerup", false], ["pointerleave", false]]) button.addEventListener(type, () => blink(on));
    } else button.addEventListener("click", () => { ACTS[act](); button.blur(); });
  }
  for (const place of document.querySelectorAll("[data-word]")) place.textContent = word(place.dataset.word);
}

function setUpScene() {
  for (const layer of LAYERS) {
    const name = word(`layer.${layer}`);
    byId("layers").append(element("button", { "data-layer": layer, title: word("layer.tip", { name }), onclick: () => send({ kind: "layer", layer, shown: !parts.scene.layers[layer] }) }, name));
  }
  const slider = document.querySelector("#vectors input");
  // Twice as far for every six steps, so that one slider serves both tenths of metres and of pixels.
  slider.addEventListener("input", () => send({ kind: "vectors", scale: slider.value === "0" ? 0 : Math.round(2 ** (slider.value / 6)) }));
  slider.addEventListener("change", () => slider.blur());
  byId("vectors").title = word("vectors.tip");
}

// The scene is the heaviest to load: first comes the point that is to be looked at; where it is not shown it waits.
function openScene(patience = 40) {
  const seen = byId("scene").offsetParent !== null;
  if (!seen || (patience > 0 && !compareState().drawn.whole)) setTimeout(() => openScene(patience - 1), seen ? 50 : 500);
  else byId("scene").src = `/scene/${seat}/`;
}

function showScene(scene) {
  for (const button of byId("layers").children) button.classList.toggle("on", scene.layers[button.dataset.layer]);
  const slider = document.querySelector("#vectors input");
  if (document.activeElement !== slider) slider.value = scene.scale ? Math.round(6 * Math.log2(scene.scale)) : 0;
  document.querySelector("#vectors output").textContent = number(scene.scale, 0);
}

function showReasons(explaining) {
  const room = byId("reasons");
  const shown = JSON.stringify(explaining);
  if (room.dataset.shown === shown) return;
  room.dataset.shown = shown;
  clearTimeout(showReasons.later);
  room.hidden = !explaining;
  explained = explaining ? Date.now() + 6000 : 0;
  if (!explaining) return;
  const choices = [1, 2, 3, 4, 5].map((digit) => element("button", { onclick: () => explain(digit) }, element("kbd", {}, `${digit}`), word(`reason.${digit}`)));
  room.replaceChildren(element("p", {}, stateGlyph("rejected", 13), word("reason.ask", { point: `${shortPoint(explaining[0])} \u00b7 ${shortName(explaining[1])}` })), ...choices);
  showReasons.later = setTimeout(() => { room.hidden = true; }, 6000);
}

// The table comes in pieces, of which only those that changed are sent.
function takeRows(fresh) {
  const pieces = Object.keys(fresh).filter((name) => name.startsWith("rows/"));
  if (!pieces.length) return;
  const rows = parts.rows ?? [];
  for (const name of pieces) {
    if (name !== "rows/count") rows.splice(Number(name.slice(5)) * PIECE, PIECE, ...fresh[name]);
  }
  if ("rows/count" in fresh) rows.length = Math.min(rows.length, fresh["rows/count"]);
  for (const name of pieces) delete fresh[name];
  fresh.rows = rows;
}

function receive(message) {
  const { notices: told, ...fresh } = message;
  takeRows(fresh);
  Object.assign(parts, fresh);
  if (fresh.rows || fresh.queue || fresh.order) showQueue(fresh.rows, fresh.queue, fresh.order);
  if (fresh.queue) { showReasons(fresh.queue.explaining); keepPlace(fresh.queue); }
  if (fresh.status) showStatus(fresh.status);
  if (parts.status && (fresh.status || "point" in fresh)) showPeople(parts.status, parts.point?.key);
  if (fresh.quality) showQuality(fresh.quality);
  if (fresh.board) showBoard(fresh.board);
  if (fresh.placement) showPlacement(fresh.placement);
  if (fresh.scene) showScene(fresh.scene);
  if ("point" in fresh) {
    if (shownNow() !== judged.shown) judged.shown = "";
    showPoint(parts.point);
    comparePoint(parts.point);
  }
  for (const notice of told ?? []) tell(notice);
  if (told?.some((notice) => notice.grave)) { judged.shown = ""; comparePoint(parts.point ?? null); }
  if (wanted) { comeBack(wanted); wanted = null; }
}

// Where one was, for a desk that has been opened anew meanwhile and knows of no seat.
function keepPlace(queue) {
  const row = parts.rows?.[queue.current];
  const place = JSON.stringify({ edition: start.edition, key: row && [row[0], row[1]], filter: queue.filter, sort: queue.sort });
  for (const storage of [sessionStorage, localStorage]) storage.setItem(`gruber.place.${start.name}`, place);
}

function keptPlace() {
  const text = sessionStorage.getItem(`gruber.place.${start.name}`) ?? localStorage.getItem(`gruber.place.${start.name}`);
  const place = text && JSON.parse(text);
  return place && place.edition !== start.edition ? place : null;
}

function comeBack({ key, filter, sort }) {
  send({ kind: "sort", ...sort });
  send({ kind: "filter", ...filter });
  if (key) send({ kind: "select", key });
}

// What went wrong stays until it is clicked away, or a while.
function tell({ text, grave }) {
  const same = [...notices.children].find((box) => box.textContent === text);
  same?.remove();
  const box = element("div", { class: `notice${grave ? " grave" : ""}`, onclick: () => box.remove() }, text);
  // What is to be seen over an open sheet must lie in it.
  (document.querySelector("dialog[open]") ?? document.body).append(notices);
  notices.append(box);
  setTimeout(() => box.remove(), grave ? 30000 : 3500);
}

function connect() {
  socket = new WebSocket(`${location.origin.replace(/^http/, "ws")}/desk/${seat}`);
  socket.onopen = () => { waiting = 250; showWire(true); showLost(""); };
  socket.onmessage = (event) => receive(JSON.parse(event.data));
  socket.onclose = () => {
    showWire(false);
    later();
  };
}

function later() {
  setTimeout(again, waiting);
  waiting = Math.min(waiting * 1.6, 1000);
}

// A desk opened anew has other pictures behind the same addresses: then the page is loaded anew too.
async function again() {
  let answer;
  try { answer = await fetch(`/start?seat=${encodeURIComponent(seat)}&own=1`); } catch { showLost("lost.text"); return later(); }
  if (answer.status === 401) { showLost("lost.stranger"); return later(); }
  if (!answer.ok) return later();
  const { edition } = await answer.json();
  if (edition === start.edition) connect();
  else location.reload();
}

function showLost(text) {
  byId("lost").hidden = !text;
  byId("lost").replaceChildren(...(text ? [element("b", {}, word("lost.title")), word(text)] : []));
}

function showWire(on) {
  byId("wire").classList.toggle("lost", !on);
  byId("wire").replaceChildren(element("span", { class: "dot" }), word(on ? "status.connected" : "status.lost"));
}

function setUpSplits() {
  const root = document.documentElement.style;
  for (const side of ["left", "right"]) {
    const kept = Number(localStorage.getItem(`gruber.${side}`));
    if (kept) root.setProperty(`--${side}`, `${kept}px`);
    const split = document.querySelector(`.split[data-side=${side}]`);
    split.addEventListener("pointerdown", (event) => { split.setPointerCapture(event.pointerId); split.classList.add("moving"); byId("scene").style.pointerEvents = "none"; });
    split.addEventListener("pointermove", (event) => {
      if (!split.hasPointerCapture(event.pointerId)) return;
      const width = side === "left" ? event.clientX : window.innerWidth - event.clientX;
      const fits = Math.min(Math.max(width, side === "left" ? 260 : 420), window.innerWidth * 0.6);
      root.setProperty(`--${side}`, `${fits}px`);
      localStorage.setItem(`gruber.${side}`, fits);
    });
    split.addEventListener("pointerup", () => { split.classList.remove("moving"); byId("scene").style.pointerEvents = ""; });
    split.addEventListener("dblclick", () => { root.removeProperty(`--${side}`); localStorage.removeItem(`gruber.${side}`); });
  }
}

// A reload keeps its own seat; a new tab takes the last one of this browser if nobody sits there.
async function takeSeat() {
  const own = sessionStorage.getItem("gruber.seat");
  const wanted = own ?? localStorage.getItem("gruber.seat") ?? "";
  const answer = await fetch(`/start?seat=${encodeURIComponent(wanted)}&own=${own ? 1 : 0}`);
  if (!answer.ok) throw new Error(await answer.text());
  Object.assign(start, await answer.json());
  seat = start.seat;
  sessionStorage.setItem("gruber.seat", seat);
  localStorage.setItem("gruber.seat", seat);
}

async function open() {
  await takeSeat();
  document.title = `${start.name} \u00b7 ${word("title")}`;
  document.documentElement.lang = start.language;
  byId("name").textContent = start.name;
  learnNames(start.photos);
  setUpSplits();
  setUpButtons();
  setUpQueue(send);
  setUpPoint(send);
  setUpCompare(send);
  setUpScene();
  setUpPeople(send);
  setUpQuality(send);
  setUpBoard(send);
  setUpPlacement(send);
  setUpResults();
  setUpTheme();
  document.body.classList.toggle("guest", start.guest);
  listenToKeys();
  showWire(false);
  wanted = keptPlace();
  connect();
  openScene();
  window.gruber = { parts, compareState, boardState, placementState };
  if (tourIsNew()) startTour();
}

open().catch((error) => { document.body.textContent = String(error); });
