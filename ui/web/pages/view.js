// Pan and zoom, the same in every pane: which part of a layer is shown, and what the pointer does.
import { byId, element, first } from "./words.js";

// design: pixels that a press moves by itself: less than one of the coarser picture as it is first
// shown, so that nobody pans so little; a finger rolls by 8, as Android has it.
const STILL_PX = { mouse: 2, finger: 8 };
// design: a hand that holds the picture longer wants to move it, and has not.
const CLICK_MS = 1000;
// design: longer than between two presses of a key, shorter than a thought.
const PAUSE_MS = 400;

/**
 * Which part of a layer a pane shows. Places on a layer count x to the right and y down in the
 * layer's own unit: metres from the north-west corner of the lattice, or pixels of a scan.
 */
export class View {
  x = 0;
  y = 0;
  /** Css pixels a unit; 0 while there is nothing to show. */
  scale = 0;
  /** The box that fills the pane, until a hand moves or zooms: then the pane may grow. */
  filled = /** @type {{ from: Pair, to: Pair, share: number } | null} */ (null);

  /** Scales between which it zooms. */
  constructor(least = 0, most = Infinity) {
    this.least = least;
    this.most = most;
  }

  /** @param {Pair} middle @param {number} scale */
  show([x, y], scale) {
    return Object.assign(this, { x, y, scale, filled: null });
  }

  /** @param {Pair} place @param {Pair} size of the pane, css pixels @returns {Pair} */
  screenFromLayer([x, y], [width, height]) {
    return [(x - this.x) * this.scale + width / 2, (y - this.y) * this.scale + height / 2];
  }

  /** @param {Pair} screen @param {Pair} size @returns {Pair} */
  layerFromScreen([x, y], [width, height]) {
    return [this.x + (x - width / 2) / this.scale, this.y + (y - height / 2) / this.scale];
  }

  /** The layer's place in the corner of the pane, and the scale. @param {Pair} size */
  frame(size) {
    const [x, y] = this.layerFromScreen([0, 0], size);
    return { x, y, scale: this.scale };
  }

  /** What lay at `from` comes to lie at `to`. @param {Pair} from @param {Pair} to */
  pan(from, to) {
    this.x += from[0] - to[0];
    this.y += from[1] - to[1];
    this.filled = null;
  }

  /** The place `fixed` stays where it is on the screen. @param {number} factor */
  zoom(factor, fixed = [this.x, this.y]) {
    if (!this.scale) return;
    const scale = Math.min(Math.max(this.scale * factor, this.least), this.most);
    const share = this.scale / scale;
    this.x = fixed[0] + (this.x - fixed[0]) * share;
    this.y = fixed[1] + (this.y - fixed[1]) * share;
    this.scale = scale;
    this.filled = null;
  }

  /**
   * A box of the layer fills a share of the pane.
   * @param {Pair} from @param {Pair} to @param {Pair} size
   */
  fit(from, to, [width, height], share = 1) {
    const [across, down] = [Math.abs(to[0] - from[0]), Math.abs(to[1] - from[1])];
    const middle = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
    this.show(middle, share * Math.min(width / across, height / down));
    return Object.assign(this, { filled: { from, to, share } });
  }

  /** What filled the pane fills it again at its new size. @param {Pair} size */
  refit(size) {
    if (this.filled && size[0] && size[1]) {
      this.fit(this.filled.from, this.filled.to, size, this.filled.share);
    }
  }
}

/** @param {Affine} matrix @param {Pair} place @returns {Pair} */
export const mapped = (matrix, [x, y]) => matrix.map(([a, b, shift]) => a * x + b * y + shift);

/** The way back. @param {Affine} matrix @returns {Affine} */
export function inverse([[a, b, x], [c, d, y]]) {
  const whole = a * d - b * c || 1;
  return [
    [d / whole, -b / whole, (b * y - d * x) / whole],
    [-c / whole, a / whole, (c * x - a * y) / whole],
  ];
}

/** Units of the target for one of the source, of equal area. @param {Affine} matrix */
export const scaleOf = ([[a, b], [c, d]]) => Math.sqrt(Math.abs(a * d - b * c)) || 1;

/** At most one drawing a frame, however often it is asked for. @param {() => void} draw */
export function oncePerFrame(draw) {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      draw();
    });
  };
}

/**
 * Done once the hand has paused, or at once when it is asked for by `now`: arrows held down or
 * pressed in a row are one place.
 * @template {unknown[]} T
 * @param {(...values: T) => void} act
 */
export function afterPause(act, ms = PAUSE_MS) {
  let timer = 0;
  let waiting = /** @type {T | null} */ (null);
  const now = () => {
    clearTimeout(timer);
    const values = waiting;
    waiting = null;
    if (values) act(...values);
  };
  const later = (/** @type {T} */ ...values) => {
    clearTimeout(timer);
    waiting = values;
    timer = setTimeout(now, ms);
  };
  return Object.assign(later, { now });
}

/** Steps of the arrow keys: right and down. @type {Record<string, Pair>} */
export const ARROWS = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
};

/** By how much a key zooms. @type {Record<string, number>} */
export const ZOOMS = { "+": 1.25, "=": 1.25, "-": 0.8 };

/**
 * Letters by what is printed on the key; by place only where another alphabet is set.
 * @param {Pick<KeyboardEvent, "key" | "code">} event
 */
export function letterOf({ key, code }) {
  if (key === "Enter") return "Enter";
  return /^[a-z]$/i.test(key) ? `Key${key.toUpperCase()}` : code;
}

/** The longest of 1, 2, 5, 10 and so on that fits: scale bars are read best so. */
export function roundLength(/** @type {number} */ most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((step) => step * power).find((length) => length <= most) ?? power;
}

/**
 * What a page does with the pointer; panning and zooming need nothing of it.
 * @typedef {object} Hand
 * @property {() => void} redraw
 * @property {() => boolean} [ready] true when there is something to point at
 * @property {(pane: Pane, screen: Pair) => Pair} [layerFromScreen] where it is not the view's own
 * @property {(pane: Pane, screen: Pair | null) => void} [point] without a button; null: gone
 * @property {(pane: Pane, screen: Pair) => void} [click]
 * @property {(pane: Pane, screen: Pair) => boolean} [grips] true when a drag moves a mark
 * @property {(pane: Pane, screen: Pair) => void} [tap] a click where a drag would move a mark
 * @property {(pane: Pane, screen: Pair | null) => void} [drag] null when it is over
 * @property {(pane: Pane) => void} [drop]
 */

/** Empty elements for a pane that the page's HTML does not have. @param {string} name */
export const paneElement = (name) => element("div", { class: `${name} pane` },
  element("canvas", { class: "picture" }), element("canvas", { class: "marks" }),
  element("span", { class: "where" }));

/**
 * A short press and release of the left button alone.
 * @param {{ button: number, timeStamp: number }} event
 * @param {{ button: number, since: number }} down
 */
export const isClick = ({ button, timeStamp }, down) =>
  button === 0 && down.button === 0 && timeStamp - down.since < CLICK_MS;

/**
 * True while a press has not become a drag.
 * @param {Pair} from @param {Pair} to @param {string} pointer what presses
 */
export const isStill = (from, to, pointer) => Math.hypot(to[0] - from[0], to[1] - from[1])
  <= (pointer === "mouse" ? STILL_PX.mouse : STILL_PX.finger);

/** @typedef {{ at: Pair, since: number, button: number, moved: boolean, grips: boolean }} Down */

/** A picture with marks over it: a drag moves the picture or a mark, the wheel zooms. */
export class Pane {
  /** @param {HTMLElement} room @param {View} view @param {Hand} hand */
  constructor(room, view, hand) {
    this.room = room;
    this.view = view;
    this.hand = hand;
    this.name = room.dataset.pane ?? "";
    this.shown = "";
    this.picture = /** @type {HTMLCanvasElement} */ (first(".picture", room));
    this.marks = /** @type {HTMLCanvasElement} */ (first(".marks", room));
    this.label = first(".label", room);
    this.where = first(".where", room);
    this.#listen();
    new ResizeObserver(() => {
      view.refit(this.size);
      hand.redraw();
    }).observe(room);
  }

  /**
   * A sign stands where a picture of something else is to come, until it is there.
   * @param {boolean} whole @param {string} what
   */
  await(whole, what) {
    if (whole) this.shown = what;
    this.room.classList.toggle("waiting", this.shown !== what);
    return whole;
  }

  get size() {
    return [this.room.clientWidth, this.room.clientHeight];
  }

  /** @param {Pair} place */
  screenFromLayer(place) {
    return this.view.screenFromLayer(place, this.size);
  }

  /** @param {Pair} screen */
  layerFromScreen(screen) {
    const own = this.hand.layerFromScreen;
    return own ? own(this, screen) : this.view.layerFromScreen(screen, this.size);
  }

  #listen() {
    const { room, hand } = this;
    /** @type {Down | null} */
    let down = null;
    const ready = () => this.view.scale > 0 && (hand.ready?.() ?? true);
    const screenOf = (/** @type {MouseEvent} */ event) => {
      const box = room.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    room.addEventListener("pointerdown", (event) => {
      if (!ready() || event.button > 1) return;
      const at = screenOf(event);
      const grips = event.button === 0 && (hand.grips?.(this, at) ?? false);
      down = { at, since: event.timeStamp, button: event.button, moved: false, grips };
      room.setPointerCapture(event.pointerId);
      event.preventDefault();
      byId("compare").focus({ preventScroll: true });
    });
    room.addEventListener("pointermove", (event) => {
      if (!ready()) return;
      const at = screenOf(event);
      if (down && !down.moved && !isStill(down.at, at, event.pointerType)) {
        Object.assign(down, { moved: true, at });
      }
      if (down?.moved && down.grips) hand.drag?.(this, at);
      else if (down?.moved) {
        room.classList.add("panning");
        this.view.pan(this.layerFromScreen(down.at), this.layerFromScreen(at));
        down.at = at;
        hand.redraw();
      }
      hand.point?.(this, at);
    });
    room.addEventListener("pointerup", (event) => {
      room.classList.remove("panning");
      if (!down) return;
      const at = screenOf(event);
      if (down.moved && down.grips) hand.drop?.(this);
      else if (!down.moved && isClick(event, down) && isStill(down.at, at, event.pointerType)) {
        (down.grips ? hand.tap : hand.click)?.(this, at);
      }
      hand.drag?.(this, null);
      down = null;
    });
    room.addEventListener("pointercancel", () => {
      down = null;
      hand.drag?.(this, null);
    });
    room.addEventListener("pointerleave", () => {
      if (!down) hand.point?.(this, null);
    });
    room.addEventListener("wheel", (event) => {
      if (!ready()) return;
      event.preventDefault();
      const factor = Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015));
      this.view.zoom(factor, this.layerFromScreen(screenOf(event)));
      hand.redraw();
    }, { passive: false });
  }
}
