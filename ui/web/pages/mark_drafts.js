// Drafts of fiducials: where the hand has put a mark, until a key keeps or drops it.
import { Question, notice, onceRead } from "./asked.js";
import { element, number, tip, word } from "./words.js";
import { afterPause } from "./view.js";
import { finishBefore, send } from "./wire.js";

const question = new Question();
const state = {
  told: /** @type {MarkDraft[]} */ ([]),
  /** The draft that is under the hand, ahead of the desk's answer. */
  hand: /** @type {MarkDraft | null} */ (null),
  /** True until the desk has answered whether one is kept. */
  keeping: false,
};

/** @param {string} photo @param {string} name */
export function draftOf(photo, name) {
  const every = [state.hand, ...state.told];
  return every.find((one) => one?.photo === photo && one.name === name) ?? null;
}

/** What the desk knows. @param {MarkDraft[]} drafts */
export function takeDrafts(drafts) {
  state.told = drafts;
}

const tellLater = afterPause((
  /** @type {MarkDraft} */ hand, /** @type {() => void} */ answered,
) => {
  const { photo, name, place } = hand;
  send({ kind: "mark", photo, name, place }, () => {
    if (state.hand === hand) state.hand = null;
    answered();
  });
});
finishBefore(tellLater.now);

/**
 * A mark put somewhere, told once the hand pauses: it is drawn at once, and again when the desk
 * has answered.
 * @param {{ photo: string, name: string, place: Pair }} put @param {() => void} draw
 */
export function draftMark({ photo, name, place }, draw) {
  const bare = { off: null, rms: null, against: false, asking: false };
  const { hand } = state;
  // The hand is on one mark at a time.
  if (hand && (hand.photo !== photo || hand.name !== name)) tellLater.now();
  state.hand = { ...bare, ...draftOf(photo, name), photo, name, place };
  tellLater(state.hand, draw);
  draw();
}

/**
 * True where there was one to give up: it is gone at once.
 * @param {string} photo @param {string} name
 */
export function dropDraft(photo, name) {
  const draft = draftOf(photo, name);
  if (!draft || !send({ kind: "mark-drop", photo, name })) return false;
  state.told = state.told.filter((one) => one.photo !== photo || one.name !== name);
  if (state.hand === draft) state.hand = null;
  return true;
}

/** What is asked about one is to be read anew. */
export const leaveDrafts = () => question.show("");

/**
 * Kept, or asked about first: nobody answers what was not there to be read.
 * @param {MarkDraft} draft @param {() => void} answered
 */
export function keepDraft({ photo, name }, answered) {
  if (state.keeping) return notice("notice.ahead");
  onceRead(() => {
    state.keeping = send({ kind: "mark-use", photo, name, use: true }, () => {
      state.keeping = false;
      answered();
    });
  }, question);
}

/**
 * What keeping a draft would make of its scan.
 * @param {MarkDraft} draft @param {() => void} drop
 */
export function draftBar({ photo, name, asking, against, off, rms }, drop) {
  question.show(asking ? `${photo}|${name}` : "");
  const text = off === null ? "board.draft.bare" : asking ? "board.draft.asking"
    : against ? "board.draft.against" : "board.draft";
  const values = { off: number(off, 1), rms: number(rms, 1) };
  return element("p", { id: "board-draft", class: against ? "against" : "" },
    element("span", {}, word(text, values)),
    element("button", {
      class: "small", "data-board": "drop", title: tip("draft.drop"), onclick: drop,
    }, word("draft.drop"), element("kbd", {}, "Esc")));
}
