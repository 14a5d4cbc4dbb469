// The pointer on a pane: click places, drag moves the picture or the mark, wheel zooms.
import { byId } from "/pages/words.js";

// `hand` says what each of these does to the pictures.
export function listen(pane, hand) {
  const { room } = pane;
  let down = null;
  const at = (event) => {
    const box = room.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  room.addEventListener("pointerdown", (event) => {
    if (!hand.ready() || event.button > 1) return;
    const [x, y] = at(event);
    down = { x, y, button: event.button, moved: false, grips: event.button === 0 && hand.grips(pane, x, y) };
    room.setPointerCapture(event.pointerId);
    event.preventDefault();
    byId("compare").focus({ preventScroll: true });
  });
  room.addEventListener("pointermove", (event) => {
    if (!hand.ready()) return;
    const [x, y] = at(event);
    if (down && !down.moved && Math.hypot(x - down.x, y - down.y) > 4) Object.assign(down, { moved: true, px: x, py: y });
    if (down?.moved && down.grips) hand.drag(hand.at(pane, x, y));
    else if (down?.moved) {
      room.classList.add("panning");
      hand.pan(hand.at(pane, down.px, down.py), hand.at(pane, x, y));
      [down.px, down.py] = [x, y];
    }
    hand.point(hand.at(pane, x, y));
  });
  room.addEventListener("pointerup", (event) => {
    room.classList.remove("panning");
    if (!down) return;
    const [x, y] = at(event);
    if (down.moved && down.grips) hand.drop(pane);
    else if (!down.moved && !down.grips && down.button === 0) hand.click(pane, x, y);
    hand.drag(null);
    down = null;
  });
  room.addEventListener("pointercancel", () => { down = null; hand.drag(null); });
  room.addEventListener("pointerleave", () => { if (!down) hand.point(null); });
  room.addEventListener("wheel", (event) => {
    if (!hand.ready()) return;
    event.preventDefault();
    hand.zoom(pane, ...at(event), Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
  }, { passive: false });
}
