// The desk: joins queue, scene, compare and status to the wire; keys and buttons mean the same.
import {
  all, byId, element, fillWords, focused, glyph, keyName, learnNames, start, stateGlyph, tip, word,
} from "./words.js";
import {
  areaShown, clearMarked, isFilterAnswered, markedKeys, ofOne, setUpQueue, showAll, showQueue, walk,
} from "./queue.js";
import { showMany, showPoint } from "./point.js";
import {
  acceptProposals, answersNo, answersYes, areRead, askAbout, askAboutMany, askBack, askWhy,
  dropDraft, explain, once, onceRead, noticeRoom, question, setUpAsked, undo,
} from "./asked.js";
import {
  blink, comparePoint, compareState, fitCompare, nudge, setUpCompare, switchCompare, zoomCompare,
} from "./compare.js";
import { showStatus } from "./status.js";
import { setUpPeople, showPeople } from "./people.js";
import { openQuality, setUpQuality, showQuality } from "./quality.js";
import {
  boardKey, boardState, chooseMark, openBoard, setUpBoard, showBoard, showFilling, showMarkDrafts,
} from "./board.js";
import {
  openPlacement, placementKey, placementState, setUpPlacement, showPlacement,
} from "./placement.js";
import { maskKey, maskState, openMask, setUpMask, showMask } from "./mask.js";
import {
  mosaicKey, mosaicState, openMosaic, setUpMosaic, showMosaic, showPicked, tellMosaic,
} from "./mosaic.js";
import { checksKey, checksState, openChecks, setUpChecks, showChecks } from "./checks.js";
import { openPlaced, setUpPlaced } from "./placed.js";
import { setUpPoints } from "./points.js";
import { soughtPlace } from "./neighbours.js";
import { setUpResults, tellResults } from "./results.js";
import { setUpSettings } from "./run.js";
import { nextTheme, setUpTheme } from "./theme.js";
import { startTour, tourIsNew } from "./tour.js";
import { toggleHelp } from "./help.js";
import { listenToKeys } from "./keys.js";
import { leaveTies, openScene, setUpScene, showScene } from "./block.js";
import {
  closeSight, drawArea, leavePhoto, showCard, showSight, stopArea, takeArea,
} from "./sight.js";
import { grow, setUpLayout, toggleDetails } from "./layout.js";
import { ARROWS, ZOOMS, letterOf } from "./view.js";
import {
  connect, finish, inTurn, isAhead, isElsewhere, leave, mergeRows, send, takeSeat,
} from "./wire.js";

/**
 * @typedef {{ find?: (row: Row) => boolean, key?: any, filter?: Filter, sort?: Sort,
 *   reopened?: boolean }} Seen
 *   where one was in the queue
 */

const NOTICE_MS = 3500; // design: one sentence is read
const GRAVE_MS = 30000; // design: what went wrong is not missed
const state = {
  parts: /** @type {Parts} */ ({}),
  /** Where one was before a desk that was opened anew, until it is there again. */
  wanted: /** @type {Seen | null} */ (null),
  /** True once the desk has told this page of itself. */
  begun: false,
  /** True from a decision until the desk is done with it. */
  deciding: false,
  handAt: -Infinity,
};

/**
 * A decision waits for the row that was chosen. After another decision, a filter or an undo it
 * would be about a point that nobody has seen: then nothing is decided.
 * @param {() => unknown} act
 */
function decide(act) {
  if (question.wasRead() && ((state.deciding && isAhead()) || isElsewhere())) {
    return tell({ text: "notice.ahead", values: {}, grave: false });
  }
  onceRead(() => {
    state.deciding = true;
    inTurn(act);
  });
}

/** One verdict on what is shown, or on all that is marked. @param {string} verdict */
const judge = (verdict) => decide(() => {
  const keys = markedKeys();
  if (keys.length) send({ kind: "judge", keys, verdict });
  else sendOf(({ key }) => ({ kind: "judge", key, verdict }));
  clearMarked();
});

/** About the current point, if there is one. @param {(point: Point) => object} message */
function sendOf(message) {
  if (state.parts.point) send({ ...message(state.parts.point) });
}

/** Leads from draft to draft; where there are none but of fiducials, to their board. */
function goToDraft() {
  const { point, queue, rows = [] } = state.parts;
  const keys = (queue?.drafts ?? []).map((index) => rows[index].slice(0, 2));
  const here = keys.findIndex((key) => key.join() === point?.key.join());
  if (keys.length) send({ kind: "select", key: keys[(here + 1) % keys.length] });
  else ACTS.board();
}

/** The photo that is looked at, placed anew by clicks. */
function placing() {
  const photo = state.parts.point?.key[1] ?? start.photos[0];
  if (start.placeable) openPlaced(photo);
  else tell({ text: "notice.no-ortho", values: {}, grave: false });
}

/** @type {Record<string, () => unknown>} */
const ACTS = {
  accept: () => judge("accept"),
  "accept-all": ofOne(() => decide(() => acceptProposals(state.parts.point))),
  reject: () => judge("reject"),
  dubious: () => judge("dubious"),
  invisible: () => judge("invisible"),
  role: ofOne(() => decide(() => sendOf(({ key }) => ({ kind: "role", point: key[0] })))),
  undo,
  redo: () => send({ kind: "redo" }),
  next: () => send({ kind: "step", step: 1, undecided: true }),
  previous: () => send({ kind: "step", step: -1 }),
  wallis: () => switchCompare("wallis"),
  raw: () => switchCompare("raw"),
  likeness: () => switchCompare("likeness"),
  edges: () => switchCompare("edges"),
  flicker: () => switchCompare("flicker"),
  together: () => switchCompare("together"),
  refine: ofOne(() => inTurn(() => sendOf(({ key }) => ({ kind: "refine", key })))),
  marks: () => switchCompare("marks"),
  fit: () => {
    fitCompare();
    send({ kind: "fit", whole: true });
  },
  "fit-whole": () => send({ kind: "fit", whole: true }),
  "fit-current": () => send({ kind: "fit", whole: false }),
  remake: () => send({ kind: "remake" }),
  cancel: () => send({ kind: "cancel" }),
  help: toggleHelp,
  add: () => switchCompare("adding"),
  all: showAll,
  grow: () => grow(),
  area: () => {
    if (!byId("scene-room").checkVisibility({ visibilityProperty: true })) grow();
    drawArea();
  },
  details: toggleDetails,
  quality: () => openQuality(state.parts.quality),
  board: () => openBoard(state.parts.board),
  placement: () => openPlacement(state.parts.placement),
  mask: () => openMask(state.parts.mask, state.parts.point?.key[1]),
  mosaic: openMosaic,
  checks: () => openChecks(state.parts.checks),
  placing,
  theme: nextTheme,
  tour: startTour,
};
/** @type {Record<string, string>} */
const KEYS = {
  KeyY: "accept", KeyN: "reject", KeyM: "dubious", KeyV: "invisible", KeyC: "role", KeyU: "undo",
  KeyJ: "next", KeyK: "previous", KeyF: "fit", KeyH: "help", KeyR: "raw", KeyL: "likeness",
  KeyP: "add", KeyB: "quality", KeyI: "board", KeyG: "placement", Enter: "refine",
  NumpadEnter: "refine", KeyX: "grow", Period: "details",
  KeyO: "edges", KeyT: "flicker", KeyZ: "together", KeyA: "all",
};
/** Words of buttons that are not `act.` with their name. @type {Record<string, string>} */
const TEXTS = {
  wallis: "wallis", raw: "raw", likeness: "likeness", marks: "marks", blink: "blink",
  remake: "remake", cancel: "remake.cancel", quality: "quality", board: "board",
  placement: "placement", theme: "theme", tour: "tour", "fit-whole": "fit.whole",
  "fit-current": "fit.current", details: "details", edges: "edges",
  flicker: "flicker", together: "together", mask: "mask", placing: "placing",
  mosaic: "mosaic",
  checks: "checks",
};
/** @type {Record<string, State>} */
const GLYPHS = { accept: "accepted", reject: "rejected", dubious: "dubious" };
/** What a key does with Shift. @type {Record<string, string>} */
const SHIFTED = {
  undo: "redo", accept: "accept-all", board: "mask", placement: "placing", edges: "mosaic",
  quality: "checks", fit: "area",
};
/** A double click does them once: the second click would be about the point that comes next. */
const DECIDING = new Set(["accept", "accept-all", "reject", "dubious", "invisible", "role"]);
const REPEATS = new Set(["next", "previous"]);
/** The key that opened a sheet closes it. @type {Record<string, string>} */
const CLOSED_BY = { quality: "KeyB", help: "KeyH" };

/** True when all scans were in sight, and are no longer. */
function leaveTogether() {
  const { point, together } = compareState();
  if (!point || !together) return false;
  switchCompare("together");
  return true;
}

/** True when the key is ours. @param {KeyboardEvent} event */
function takeKey(event) {
  if (answersNo(event)) return true;
  const sheet = document.querySelector("dialog[open]");
  if (sheet) return sheetKey(event, /** @type {HTMLDialogElement} */ (sheet));
  const down = event.type === "keydown";
  if (event.key === "Escape" && down && (stopArea() || clearMarked())) return true;
  if (event.key === "Enter" && down && takeArea()) return true;
  // In the queue it chooses a row, which the arrows have done.
  if (event.key === "Enter" && byId("table").contains(focused())) return true;
  if (event.key === "Escape" && compareState().adding) {
    switchCompare("adding");
    return true;
  }
  if (event.key === "Escape" && down) {
    finish();
    inTurn(() => dropDraft() || leaveTogether() || closeSight() || leavePhoto() || leaveTies());
    return true;
  }
  return pictureKey(event, down) || actKey(event, down, KEYS[letterOf(event)]);
}

/** Nothing is decided behind an open sheet. @param {KeyboardEvent} event */
function sheetKey(event, /** @type {HTMLDialogElement} */ sheet) {
  const letter = letterOf(event);
  if (sheet.id === "board") return boardKey(event, letter);
  if (sheet.id === "placement") return placementKey(event, letter);
  if (sheet.id === "mask") return maskKey(event, letter);
  if (sheet.id === "mosaic") return mosaicKey(event, letter);
  if (sheet.id === "checks") return checksKey(event, letter);
  if (answersYes(event)) return true;
  const closes = event.key === "Escape" || letter === CLOSED_BY[sheet.id];
  if (closes && event.type === "keydown") sheet.close();
  return event.key === "Escape" || event.key.length === 1;
}

/** @param {KeyboardEvent} event @param {boolean} down */
function pictureKey(event, down) {
  if (event.key === " ") {
    blink(down);
    return true;
  }
  if (ZOOMS[event.key]) {
    if (down) zoomCompare(ZOOMS[event.key]);
    return true;
  }
  const [inQueue, ends] = [byId("queue").contains(focused()), ["Home", "End"].includes(event.key)];
  if ((ARROWS[event.key] || (ends && inQueue)) && event.view === window) {
    if (down) inTurn(() => (inQueue ? walk(event) : arrow(event)));
    return true;
  }
  if (!/^[1-5]$/.test(event.key)) return false;
  if (down && !event.repeat) inTurn(() => reason(Number(event.key)));
  return true;
}

/** @param {number} digit */
function reason(digit) {
  if (!explain(digit)) tell({ text: "notice.no-reason", values: {}, grave: false });
}

/** @param {KeyboardEvent} event @param {boolean} down @param {string | undefined} name */
function actKey(event, down, name) {
  if (!name) return false;
  const act = event.shiftKey ? SHIFTED[name] ?? name : name;
  if (down && (!event.repeat || REPEATS.has(name))) ACTS[act]();
  return true;
}

/** @param {KeyboardEvent} event */
function arrow(event) {
  const [right, down] = ARROWS[event.key];
  const step = event.shiftKey ? 1 : 0.1;
  ofOne(() => nudge(right * step, down * step))();
}

// Asked by the scene, whose frames wait where drawing is slow.
window.gruberAtWork = () => {
  const idle = performance.now() - state.handAt;
  return idle < 800 || (idle < 2000 && !compareState().drawn.whole);
};

function watchHand() {
  const worked = () => {
    state.handAt = performance.now();
  };
  for (const type of ["keydown", "pointerdown", "wheel"]) {
    window.addEventListener(type, worked, { capture: true, passive: true });
  }
  window.addEventListener("blur", () => {
    if (focused() !== byId("scene")) blink(false);
  });
}

function setUpButtons() {
  const keyOf = new Map(start.keys.map(([key, name]) => [name, key]));
  for (const button of all("[data-act]")) {
    const act = button.dataset.act ?? "";
    const name = TEXTS[act] ?? `act.${act}`;
    const named = keyOf.get(name);
    const key = named && keyName(named);
    const long = tip(name) ?? word(name);
    button.title = key ? `${long} (${key})` : long;
    label(button, word(name), GLYPHS[act] ? stateGlyph(GLYPHS[act], 14) : null);
    if (key && !button.classList.contains("toggle")) button.append(element("kbd", {}, key));
    if (act === "blink") {
      button.addEventListener("pointerdown", () => blink(true));
      for (const type of ["pointerup", "pointerleave"]) {
        button.addEventListener(type, () => blink(false));
      }
      // A key cannot hold a button down: it turns the pictures over, and back.
      button.addEventListener("click", ({ detail }) => {
        if (!detail) blink(!compareState().blink);
      });
    } else {
      button.addEventListener("click", DECIDING.has(act) ? once(ACTS[act]) : () => ACTS[act]());
    }
  }
}

/**
 * An icon, if the button has one, and its words.
 * @param {HTMLElement} button @param {string} text @param {Node | null} mark
 */
function label(button, text, mark) {
  const { icon } = button.dataset;
  const drawn = icon ? glyph(icon, "currentColor", 15) : mark;
  const silent = button.classList.contains("icon");
  if (silent) button.setAttribute("aria-label", text);
  button.replaceChildren(...(drawn ? [drawn] : []), ...(silent ? [] : [element("span", {}, text)]));
}

/** @param {Message} message */
function receive(message) {
  const { notices = [], ...fresh } = message;
  const { parts, wanted } = state;
  const drafted = draftIn(parts.point);
  const rows = mergeRows(parts.rows ?? [], fresh);
  if (rows) fresh.rows = rows;
  Object.assign(parts, fresh);
  if (fresh.rows || fresh.queue || fresh.order || isFilterAnswered()) showQueue(fresh);
  if (fresh.queue) {
    askWhy(fresh.queue.explaining);
    askBack(fresh.queue.turning);
    keepPlace(fresh.queue);
  }
  if (fresh.status) {
    showStatus(fresh.status);
    showFilling(fresh.status.filling);
    tellMosaic(fresh.status);
    tellResults(fresh.status);
  }
  if (parts.status && (fresh.status || "point" in fresh)) {
    showPeople(parts.status, parts.point?.key);
  }
  if (fresh.quality) showQuality(fresh.quality);
  if (fresh.board_drafts) showMarkDrafts(fresh.board_drafts);
  if (fresh.board) showBoard(fresh.board);
  if (fresh.board_mark) chooseMark(fresh.board_mark[0], fresh.board_mark[1]);
  if (fresh.placement) showPlacement(fresh.placement);
  if (fresh.mask) showMask(fresh.mask);
  if (fresh.mosaic) showMosaic(fresh.mosaic);
  if (fresh.picked) showPicked(fresh.picked);
  if (fresh.checks) showChecks(fresh.checks);
  if (fresh.scene) showScene(fresh.scene);
  if (fresh.card) showCard(fresh.card);
  if (fresh.sight) showSight(fresh.sight);
  const point = parts.point ?? null;
  if ("point" in fresh) {
    if (drafted !== draftIn(point)) forget(({ dataset }) => dataset.draft === drafted);
    showPoint(point);
    askAbout(point);
    comparePoint(point);
  }
  notices.forEach(tell);
  if (!isAhead()) state.deciding = false;
  if (!state.begun) begin();
  if (wanted) comeBack(wanted);
  state.wanted = null;
}

/** Of a page that is loaded anew the desk may think that a sheet still lies over it. */
function begin() {
  state.begun = true;
  send({ kind: "sheet", sheet: "board", shown: false });
  send({ kind: "quality", shown: false });
}

const placeName = () => `gruber.place.${start.name}`;

/**
 * Where one was, for a desk that has been opened anew meanwhile and knows of no seat.
 * @param {Queue} queue
 */
function keepPlace({ current, filter, sort }) {
  const row = state.parts.rows?.[current];
  const key = row && [row[0], row[1]];
  const place = JSON.stringify({ edition: start.edition, key, filter, sort });
  for (const storage of [sessionStorage, localStorage]) storage.setItem(placeName(), place);
}

function keptPlace() {
  const own = sessionStorage.getItem(placeName());
  const text = own ?? localStorage.getItem(placeName());
  const place = text && JSON.parse(text);
  const other = place && place.edition !== start.edition;
  return other ? { ...place, reopened: own !== null } : null;
}

/** @param {Seen} seen */
function comeBack({ find, key, filter, sort, reopened }) {
  if (reopened) tell({ text: "notice.reopened", values: {}, grave: false });
  if (find) key = state.parts.rows?.find(find)?.slice(0, 2);
  if (sort) send({ kind: "sort", ...sort });
  if (filter) send({ kind: "filter", ...filter });
  if (key) send({ kind: "select", key });
}

/** The draft in sight, as its notices name it. @param {Point | null} [point] */
const draftIn = (point) => (point?.draft ? point.key.join("|") : "");

/**
 * Notices that hold no longer go; returned is where the others are.
 * @param {(box: HTMLElement) => unknown} isOver
 */
function forget(isOver) {
  for (const box of all(".notice", noticeRoom())) if (isOver(box)) box.remove();
  return noticeRoom();
}

/**
 * What went wrong stays until it is clicked away, or a while; what is said of a draft goes with it.
 * @param {Notice} notice
 */
function tell({ text: name, values, grave, draft }) {
  const text = word(name, values);
  const of = draft?.join("|") ?? null;
  const notices = forget((old) => old.textContent === text || (of && old.dataset.draft === of));
  const kind = `notice${grave ? " grave" : ""}`;
  const away = () => box.remove();
  const box = element("div", { class: kind, "data-draft": of, onclick: away }, text);
  notices.append(box);
  setTimeout(() => box.remove(), grave ? GRAVE_MS : NOTICE_MS);
}

async function open() {
  await takeSeat();
  document.title = `${start.name} \u00b7 ${word("title")}`;
  fillWords();
  Object.assign(byId("name"), { textContent: start.name, title: start.name });
  learnNames(start.photos);
  setUpButtons();
  setUpLayout();
  setUpQueue((count) => {
    showMany(count);
    askAboutMany(count);
  }, () => tell({ text: "notice.one-row", values: {}, grave: false }));
  setUpAsked(tell);
  byId("drafts").addEventListener("click", goToDraft);
  setUpCompare();
  setUpScene();
  setUpPeople();
  setUpQuality();
  setUpBoard();
  setUpPlacement();
  setUpMask();
  setUpMosaic();
  setUpChecks();
  setUpPlaced();
  setUpPoints();
  setUpResults();
  setUpSettings(() => {
    const { people = [], remaking, filling } = state.parts.status ?? {};
    return [...people.length ? [word("settings.ask", { people: people.length })] : [],
      ...remaking || filling ? [word("settings.stop")] : []];
  }, leave);
  setUpTheme();
  document.body.classList.toggle("guest", start.guest);
  watchHand();
  window.gruberKey = listenToKeys(takeKey);
  state.wanted = soughtPlace() ?? keptPlace();
  connect(receive);
  if (start.looking) tell({ text: "notice.read-only", values: {}, grave: true });
  openScene();
  window.gruber = {
    parts: state.parts, isAhead: () => isAhead() || !areRead(), compareState, boardState,
    placementState, maskState, mosaicState, checksState, areaShown,
  };
  if (tourIsNew()) startTour();
}

open().catch((error) => {
  document.body.textContent = String(error);
});
