// Put into viser's page: keys of the desk are handed up to it before viser sees them; the keys that
// move viser's camera stay its own. Where drawing is slow, frames wait for a hand that works at the
// desk.
/** @typedef {{ later?: number, frame?: number }} Ticket */

const state = {
  handAt: -Infinity,
  waiting: /** @type {Map<number, Ticket>} */ (new Map()),
  tickets: 0,
  heldSince: 0,
  frameAt: 0,
  /** Milliseconds of a frame, smoothed. */
  took: 0,
  inside: false,
};
const worked = () => {
  state.handAt = performance.now();
};
for (const type of ["pointerdown", "pointermove", "wheel", "keydown"]) {
  window.addEventListener(type, worked, { capture: true, passive: true });
}

for (const type of /** @type {const} */ (["keydown", "keyup"])) {
  window.addEventListener(type, (event) => {
    if (window.parent !== window && window.parent.gruberKey?.(event)) {
      event.preventDefault();
      event.stopImmediatePropagation();
    }
  }, true);
}

// Viser connects again only while its own page has the focus, which the desk nearly always has; and
// what it shows meanwhile is old without a sign.
document.hasFocus = () => window.parent.document.hasFocus();
if (window.parent !== window) {
  window.parent.addEventListener("focus", () => window.dispatchEvent(new Event("focus")));
}
window.Worker = class extends window.Worker {
  /** @param {string | URL} address @param {WorkerOptions} [options] */
  constructor(address, options) {
    super(address, options);
    this.addEventListener("message", ({ data }) => {
      if (data?.type === "closed") window.gruberLost = true;
      if (data?.type === "connected") window.gruberLost = false;
    });
  }
};

// Without a GPU smooth edges cost four times as much, and viser draws once a second though nothing
// changed.
const HEARTBEAT_MS = 1000;
const contextOf = HTMLCanvasElement.prototype.getContext;
const drawnByProcessor = (() => {
  const canvas = document.createElement("canvas");
  const probe = /** @type {WebGL2RenderingContext | null} */ (contextOf.call(canvas, "webgl2"));
  const told = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = told ? probe?.getParameter(told.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
})();
if (drawnByProcessor) {
  const every = /** @type {Function} */ (window.setInterval).bind(window);
  const setInterval = (/** @type {TimerHandler} */ act, /** @type {number} */ delay,
    /** @type {unknown[]} */ ...rest) =>
    every(act, delay === HEARTBEAT_MS ? 8 * delay : delay, ...rest);
  /**
   * @this {HTMLCanvasElement}
   * @param {string} kind @param {object} [asked]
   */
  function getContext(kind, asked) {
    const attributes = /^webgl/.test(kind) ? { ...asked, antialias: false } : asked;
    return contextOf.call(this, kind, attributes);
  }
  Object.assign(window, { setInterval });
  Object.assign(HTMLCanvasElement.prototype, { getContext });
}

// Without a GPU one frame of the block takes as long as ten of the desk, and both draw in one
// thread.
const SLOW_MS = 45;
const PATIENCE_MS = 3000;
const PAUSE_MS = 80;
const LOOK_AGAIN_MS = 25;
const frames = {
  real: window.requestAnimationFrame.bind(window), stop: window.cancelAnimationFrame.bind(window),
};

function givesWay() {
  const now = performance.now();
  const idle = now - state.handAt;
  const held = state.took > SLOW_MS && idle > 600 && window.parent.gruberAtWork?.();
  if (!held) {
    state.heldSince = 0;
    return false;
  }
  if (!state.heldSince || now - state.heldSince > PATIENCE_MS + PAUSE_MS) state.heldSince = now;
  // However long the hand works, the block is drawn now and then.
  return now - state.heldSince < PATIENCE_MS;
}

/** @param {number} ticket @param {FrameRequestCallback} callback @param {boolean} inFrame */
function ask(ticket, callback, inFrame) {
  const { waiting } = state;
  if (givesWay()) {
    waiting.set(ticket, { later: setTimeout(() => ask(ticket, callback, false), LOOK_AGAIN_MS) });
    return;
  }
  const frame = frames.real((time) => {
    waiting.delete(ticket);
    const now = performance.now();
    // Frames that follow one another tell how long one takes.
    if (inFrame && now > state.frameAt + 1) {
      state.took += 0.3 * (Math.min(now - state.frameAt, 1000) - state.took);
    }
    Object.assign(state, { frameAt: now, inside: true });
    callback(time);
    state.inside = false;
    window.parent.gruberEye?.();
  });
  waiting.set(ticket, { frame });
}

window.requestAnimationFrame = (callback) => {
  state.tickets += 1;
  ask(state.tickets, callback, state.inside);
  return state.tickets;
};
window.cancelAnimationFrame = (ticket) => {
  const found = state.waiting.get(ticket);
  state.waiting.delete(ticket);
  if (found?.later) clearTimeout(found.later);
  if (found?.frame) frames.stop(found.frame);
};

// Behind the block stands the ground of the page around it.
const around = window.parent.document.documentElement;
const ground = document.createElement("style");
document.head.append(ground);
const follow = () => {
  const colour = getComputedStyle(around).getPropertyValue("--scene").trim();
  // Another canvas of viser's lies above the drawn one.
  ground.textContent = `canvas[data-engine] { background: ${colour}; }`;
};
new MutationObserver(follow).observe(around, { attributes: true, attributeFilter: ["data-theme"] });
follow();
