// The wire to the desk: gestures go up, what changed comes down; a lost connection is made anew.
import { byId, element, start, word } from "./words.js";

const PIECE = 50; // as `ui/web/channel.py` cuts the table
const FIRST_WAIT_MS = 250; // design: a short break is not noticed
const LONGEST_WAIT_MS = 1000; // design: nobody waits longer for a desk that is back
const CHOSEN_MS = 5000; // design: a choice that was not followed by then was refused
const state = {
  chosen: { key: "", at: 0 },
  socket: /** @type {WebSocket | null} */ (null),
  waiting: FIRST_WAIT_MS,
  receive: /** @type {(message: Message) => void} */ (() => {}),
};

/** A gesture to the desk; true when the wire was open. @type {Send} */
export function send(message) {
  const open = state.socket?.readyState === WebSocket.OPEN;
  const key = message.kind === "select" ? String(message.key) : "";
  if (key || message.kind === "step" || message.kind === "filter") {
    state.chosen = { key, at: Date.now() };
  }
  if (open) state.socket?.send(JSON.stringify(message));
  return open;
}

/** True while another point was chosen than the one on show. @param {Key} shown */
export function awaitsAnother(shown) {
  const { key, at } = state.chosen;
  return key !== "" && key !== String(shown) && Date.now() - at < CHOSEN_MS;
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

function openSocket() {
  const address = `${location.origin.replace(/^http/, "ws")}/desk/${start.seat}`;
  const socket = new WebSocket(address);
  state.socket = socket;
  socket.onopen = () => {
    state.waiting = FIRST_WAIT_MS;
    showWire(true);
    showLost("");
  };
  socket.onmessage = (event) => state.receive(JSON.parse(event.data));
  socket.onclose = () => {
    showWire(false);
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
    if (!answer) showLost("lost.text");
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
  byId("lost").hidden = !text;
  const words = text ? [element("b", {}, word("lost.title")), word(text)] : [];
  byId("lost").replaceChildren(...words);
}

/** @param {boolean} on */
function showWire(on) {
  byId("wire").classList.toggle("lost", !on);
  const text = word(on ? "status.connected" : "status.lost");
  byId("wire").replaceChildren(element("span", { class: "dot" }), text);
}
