// What the pointer does in the 3D scene: what it chooses, cards of what it rests on, the way into
// a photo and out again, and the photos that see a place.
import { eyeOf, rayThrough } from "./eye.js";
import {
  byId, element, first, number, shortName, shortPoint, stateGlyph, turn, word,
} from "./words.js";
import { send } from "./wire.js";

const REST_MS = 120; // design: a hand on its way wants no card
const SIDE_RAYS = 8; // design: hills of an eighth of the area are followed
const MOVED_PX = 5; // design: as still as a hand is held
const BESIDE_PX = 14; // design: clear of the pointer
const state = {
  /** Questions are numbered, also those of a page that was loaded anew. */
  number: Date.now(),
  pointer: /** @type {Pair} */ ([0, 0]),
  /** Where it was pressed. */
  pressed: /** @type {Pair} */ ([0, 0]),
  timer: 0,
  inside: "",
  /** Where a hand has begun to draw an area. */
  corner: /** @type {Pair | null} */ (null),
};

const card = () => byId("scene-card");
const list = () => byId("scene-list");

export function setUpSight() {
  const frame = byId("scene");
  frame.addEventListener("load", () => {
    const inside = frame.contentWindow;
    inside?.addEventListener("pointermove", rest);
    inside?.addEventListener("pointerdown", ({ clientX, clientY }) => {
      hideCard();
      state.pressed = [clientX, clientY];
    });
    inside?.addEventListener("click", (event) => {
      if (isChoice(event, state.pressed)) ask("click", state.pressed);
    });
    inside?.addEventListener("wheel", hideCard, { passive: true });
    inside?.document.addEventListener("pointerleave", hideCard);
    inside?.addEventListener("dblclick", ({ clientX, clientY }) => {
      ask("follow", [clientX, clientY]);
    });
  });
  byId("scene-leave").addEventListener("click", leavePhoto);
  const sheet = byId("scene-area");
  sheet.addEventListener("pointerdown", (event) => {
    sheet.setPointerCapture(event.pointerId);
    state.corner = [event.offsetX, event.offsetY];
  });
  sheet.addEventListener("pointermove", ({ offsetX, offsetY }) => {
    if (state.corner) showBox(state.corner, [offsetX, offsetY]);
  });
  sheet.addEventListener("pointerup", ({ offsetX, offsetY }) => {
    const { corner } = state;
    if (corner && Math.hypot(offsetX - corner[0], offsetY - corner[1]) > MOVED_PX) {
      outline(corner, [offsetX, offsetY]);
      stopArea();
    }
    state.corner = null;
  });
}

/**
 * True of a click that chooses: a drag turns the block, and the second click of a double click
 * would choose of what is seen from where that one leads.
 * @param {Pick<MouseEvent, "clientX" | "clientY" | "detail">} click @param {Pair} pressed
 */
export const isChoice = ({ clientX, clientY, detail }, [x, y]) =>
  detail === 1 && Math.hypot(clientX - x, clientY - y) <= MOVED_PX;

/** The next drag over the scene draws an area of the queue; once more, and it does not. */
export function drawArea() {
  if (stopArea()) return;
  hideCard();
  showBox([0, 0], [0, 0]);
  byId("scene-area").hidden = false;
  turn(first("[data-act=area]"), true);
}

/** All that is in sight, where an area is to be drawn; false where none is. */
export function takeArea() {
  const { hidden, clientWidth, clientHeight } = byId("scene-area");
  if (hidden) return false;
  outline([0, 0], [clientWidth, clientHeight]);
  return stopArea();
}

/** True when an area was to be drawn. */
export function stopArea() {
  const open = !byId("scene-area").hidden;
  byId("scene-area").hidden = true;
  state.corner = null;
  turn(first("[data-act=area]"), false);
  return open;
}

/** @param {Pair} from @param {Pair} to */
function showBox([x1, y1], [x2, y2]) {
  const [left, top] = [Math.min(x1, x2), Math.min(y1, y2)];
  Object.assign(byId("scene-box").style, { left: `${left}px`, top: `${top}px`,
    width: `${Math.abs(x2 - x1)}px`, height: `${Math.abs(y2 - y1)}px` });
}

/** The ground is not flat: several rays along each side. @param {Pair} from @param {Pair} to */
function outline([x1, y1], [x2, y2]) {
  const eye = eyeOf(byId("scene").contentWindow);
  if (!eye) return;
  const corners = /** @type {Pair[]} */ ([[x1, y1], [x2, y1], [x2, y2], [x1, y2]]);
  const places = corners.flatMap(([x, y], i) => {
    const [u, v] = corners[(i + 1) % 4];
    return Array.from({ length: SIDE_RAYS }, (_, n) => /** @type {Pair} */ (
      [x + ((u - x) * n) / SIDE_RAYS, y + ((v - y) * n) / SIDE_RAYS]));
  });
  send({ kind: "outline", rays: places.map((place) => rayThrough(eye, place)) });
}

/** What is under a place of the screen, asked of the desk. */
function ask(/** @type {string} */ kind, /** @type {Pair} */ screen) {
  const eye = eyeOf(byId("scene").contentWindow);
  if (!eye) return;
  state.number += 1;
  send({ kind, number: state.number, ray: rayThrough(eye, screen) });
}

/** @param {PointerEvent} event */
function rest({ clientX, clientY, buttons }) {
  const [x, y] = state.pointer;
  if (!card().hidden && Math.hypot(clientX - x, clientY - y) > MOVED_PX) hideCard();
  clearTimeout(state.timer);
  if (buttons) return;
  state.timer = setTimeout(() => {
    state.pointer = [clientX, clientY];
    ask("hover", state.pointer);
  }, REST_MS);
}

function hideCard() {
  clearTimeout(state.timer);
  card().hidden = true;
}

/** @param {Card} told */
export function showCard(told) {
  if (told.number !== state.number) return;
  const { photo, point } = told;
  card().hidden = !photo && !point;
  if (photo) {
    card().replaceChildren(element("b", {}, shortName(photo)),
      word("card.photo", { rms: number(told.rms, 2), control: told.control, ties: told.ties }));
  } else if (point) {
    const sort = [word(`role.${told.role}`), told.state && word(`state.${told.state}`)];
    const measured = told.misfit_m === null ? word("card.unmeasured")
      : word("card.point", { metres: told.misfit_m, pixels: told.misfit_px, photos: told.photos });
    card().replaceChildren(element("b", {}, shortPoint(point)),
      element("span", {}, told.state ? stateGlyph(told.state, 12) : null,
        sort.filter(Boolean).join(" \u00b7 ")), measured);
  }
  const [x, y] = state.pointer;
  const { clientWidth, clientHeight } = byId("scene-room");
  const [width, height] = [card().offsetWidth + BESIDE_PX, card().offsetHeight + BESIDE_PX];
  const left = x + width > clientWidth ? Math.max(x - width, 0) : x + BESIDE_PX;
  const above = y + height > clientHeight ? Math.max(y - height, 0) : y + BESIDE_PX;
  Object.assign(card().style, { left: `${left}px`, top: `${above}px` });
}

/** @param {Sight} told */
export function showSight(told) {
  if (told.number !== state.number) return;
  const close = element("button", {
    class: "small", title: word("act.close"), "aria-label": word("act.close"), onclick: closeSight,
  }, "\u00d7");
  const rows = told.photos.map(([photo, nadir, pixel]) => element("button", {
    title: word("sight.tip", { name: photo }), "data-photo": photo,
    onclick: () => {
      closeSight();
      send({ kind: "enter", photo });
    },
  }, element("b", {}, shortName(photo)), element("span", {}, number(nadir, 0, "\u00b0")),
  element("span", {}, number(pixel, 2, "m"))));
  const title = word(rows.length ? "sight.title" : "sight.none");
  list().replaceChildren(element("header", {}, element("b", {}, title), close),
    element("p", {}, word("sight.place", { east: told.place[0], north: told.place[1],
      height: told.place[2] })), ...rows);
  list().hidden = false;
}

/** True when the list was open. */
export function closeSight() {
  const open = !list().hidden;
  list().hidden = true;
  return open;
}

/** True when the eye was in a photo. */
export function leavePhoto() {
  const { inside } = state;
  if (inside) send({ kind: "enter", photo: "" });
  return inside !== "";
}

/** @param {SceneSwitches} scene */
export function showInside({ inside }) {
  state.inside = inside;
  const leave = byId("scene-leave");
  leave.hidden = !inside;
  leave.textContent = word("inside.leave", { name: shortName(inside) });
  if (inside) closeSight();
}
