// The wire to the desk: gestures go up, what changed comes down; a lost connection is made anew.
import { byId, element, start, word } from "./words.js";

const PIECE = 50; // as `ui/web/channel.py` cuts the table
const FIRST_WAIT_MS = 250; // design: a short break is not noticed
const LONGEST_WAIT_MS = 1000; // design: nobody waits longer for a desk that is back
const LEAVING_MS = 20000; // design: the settings are open by then, or something is wrong
const state = {
  socket: /** @type {WebSocket | null} */ (null),
  waiting: FIRST_WAIT_MS,
  receive: /** @type {(message: Message) => void} */ (() => {}),
  /** Numbers of the last gesture, and of the last one that the desk is done with. */
  sent: 0,
  answered: 0,
  /** What was asked for behind a gesture that the desk is not done with. */
  turns: /** @type {(() => unknown)[]} */ ([]),
  taking: false,
  /** What is done after a gesture: its number, Infinity until it is sent. */
  after: /** @type {Map<() => void, number>} */ (new Map()),
  elsewhere: false,
  /** Until when a desk that does not answer makes room for the settings. */
  leaving: 0,
  finish: /** @type {(() => void)[]} */ ([]),
};

/** Gestures after which another point may be shown than the hand knows of. */
const ELSEWHERE = ["filter", "outline", "sort", "undo", "redo"];

export const isOpen = () => state.socket?.readyState === WebSocket.OPEN;

/** True while the hand is ahead of the picture. */
export const isAhead = () => state.turns.length > 0 || state.answered < state.sent;

/** True until what was sent has shown which point it leads to: nothing is decided about it. */
export const isElsewhere = () => state.elsewhere && isAhead();

/**
 * A gesture to the desk; true when the wire was open. What is to be done after it is done once the
 * desk is done with it, or it is lost; no other gesture waits for that.
 * @type {Send}
 */
export function send(message, after) {
  finish();
  if (after) state.after.set(after, Infinity);
  state.elsewhere ||= ELSEWHERE.includes(`${message.kind}`);
  if (state.turns.length && !state.taking) return queued(message, after);
  if (!isOpen()) {
    state.receive({ notices: [{ text: "notice.wire", values: {}, grave: true }] });
    if (after && state.after.delete(after)) after();
    return false;
  }
  state.socket?.send(JSON.stringify(message));
  // A clock: greater than any number of a page that sat here before.
  state.sent = Math.max(state.sent + 1, Date.now());
  state.socket?.send(JSON.stringify({ kind: "answer", number: state.sent }));
  if (after) state.after.set(after, state.sent);
  return true;
}

/** @type {Send} */
const queued = (message, after) => state.turns.push(() => send(message, after)) > 0;

/** @param {number} answered number of the last gesture that the desk is done with */
function takeAfter(answered) {
  for (const [act, number] of state.after) {
    if (number <= answered && state.after.delete(act)) act();
  }
}

/** About what is shown once the desk is done with all before it. @param {() => unknown} act */
export function inTurn(act) {
  if (isAhead()) state.turns.push(act);
  else act();
}

/** Done before any other gesture. @param {() => void} act sends what waits for the hand to pause */
export const finishBefore = (act) => state.finish.push(act);

/** What waits for the hand to pause is sent now. */
export const finish = () => state.finish.forEach((act) => act());

function takeTurns() {
  state.taking = true;
  while (state.turns.length && state.answered >= state.sent) state.turns.shift()?.();
  state.taking = false;
}

/** A reload keeps its own seat; a new tab takes this browser's last one if nobody sits there. */
export async function takeSeat() {
  const own = sessionStorage.getItem("gruber.seat");
  const wanted = own ?? localStorage.getItem("gruber.seat") ?? "";
  const answer = await fetch(`/start?seat=${encodeURIComponent(wanted)}&own=${own ? 1 : 0}`);
  if (!answer.ok) throw new Error(await answer.text());
  Object.assign(start, await answer.json());
  for (const storage of [sessionStorage, localStorage]) {
    storage.setItem("gruber.seat", start.seat);
  }
}

/** @param {(message: Message) => void} receive */
export function connect(receive) {
  state.receive = receive;
  showWire(false);
  openSocket();
}

/**
 * The table comes in pieces, of which only those that changed are sent; `parts` keeps it whole.
 * @param {Row[]} rows as known before @param {Record<string, any>} message
 * @returns {Row[] | null} null when nothing of it came
 */
export function mergeRows(rows, message) {
  const pieces = Object.keys(message).filter((name) => name.startsWith("rows/"));
  if (!pieces.length) return null;
  for (const name of pieces) {
    if (name !== "rows/count") rows.splice(Number(name.slice(5)) * PIECE, PIECE, ...message[name]);
  }
  if ("rows/count" in message) rows.length = Math.min(rows.length, message["rows/count"]);
  for (const name of pieces) delete message[name];
  return rows;
}

/** The desk closes because it was asked to. */
export function leave() {
  state.leaving = Date.now() + LEAVING_MS;
}

const isLeaving = () => Date.now() < state.leaving;

function openSocket() {
  const address = `${location.origin.replace(/^http/, "ws")}/desk/${start.seat}`;
  const socket = new WebSocket(address);
  state.socket = socket;
  socket.onopen = () => {
    Object.assign(state, { waiting: FIRST_WAIT_MS, leaving: 0 });
    showLost("");
  };
  socket.onmessage = (event) => {
    const { answered = state.answered, ...message } = JSON.parse(event.data);
    state.answered = answered;
    state.receive(message);
    if (!isAhead()) state.elsewhere = false;
    takeAfter(answered);
    takeTurns();
  };
  socket.onclose = () => {
    showWire(false);
    if (isAhead()) state.receive({ notices: [{ text: "notice.wire", values: {}, grave: true }] });
    Object.assign(state, { answered: state.sent, turns: [] });
    takeAfter(Infinity);
    tryLater();
  };
}

function tryLater() {
  setTimeout(tryAgain, state.waiting);
  state.waiting = Math.min(state.waiting * 1.6, LONGEST_WAIT_MS);
}

// A desk opened anew has other pictures behind the same addresses: the page is loaded anew too.
async function tryAgain() {
  const address = `/start?seat=${encodeURIComponent(start.seat)}&own=1`;
  const answer = await fetch(address).catch(() => null);
  if (!answer?.ok) {
    if (!answer) showLost(isLeaving() ? "settings.opening" : "lost.text");
    else if (answer.status === 401) showLost("lost.stranger");
    tryLater();
    return;
  }
  const { edition } = await answer.json();
  if (edition === start.edition) openSocket();
  else location.reload();
}

/** @param {string} text */
function showLost(text) {
  showWire(isOpen());
  byId("lost").hidden = !text;
  const title = text.startsWith("lost.") ? [element("b", {}, word("lost.title"))] : [];
  byId("lost").replaceChildren(...title, ...text ? [word(text)] : []);
}

/** @param {boolean} on */
function showWire(on) {
  const leaving = !on && isLeaving();
  byId("wire").classList.toggle("lost", !on && !leaving);
  const text = word(on ? "status.connected" : leaving ? "settings.opening" : "status.lost");
  byId("wire").title = text;
  byId("wire").replaceChildren(element("span", { class: "dot" }), text);
}
