// The two pictures swap by themselves, as fast as one likes.
import { byId } from "./words.js";

const state = { timer: 0, on: false, swapped: false };

/** @param {boolean} on @param {(swapped: boolean) => void} show */
export function flicker(on, show) {
  if (on === state.on) return;
  state.on = on;
  const room = byId("rate");
  room.hidden = !on;
  clearTimeout(state.timer);
  // design: half to three times a second; faster flashes may harm.
  const again = () => {
    state.swapped = !state.swapped;
    show(state.swapped);
    state.timer = setTimeout(again, 1000 / room.valueAsNumber);
  };
  state.swapped = false;
  if (on) again();
  else show(false);
}
