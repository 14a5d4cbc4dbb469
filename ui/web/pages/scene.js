// Put into viser's page: keys of the desk are handed up to it before viser sees them; the keys that
// move viser's camera stay its own. Where drawing is slow, frames wait for a hand that works at the desk.
let handAt = -Infinity;
for (const type of ["pointerdown", "pointermove", "wheel", "keydown"]) {
  window.addEventListener(type, () => { handAt = performance.now(); }, { capture: true, passive: true });
}

for (const type of ["keydown", "keyup"]) {
  window.addEventListener(type, (event) => {
    if (/^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "")) return;
    if (window.parent !== window && window.parent.gruberKey?.(event)) {
      event.preventDefault();
      event.stopImmediatePropagation();
    }
  }, true);
}

// Without a GPU smooth edges cost four times as much, and viser draws once a second though nothing changed.
const HEARTBEAT_MS = 1000;
const context = HTMLCanvasElement.prototype.getContext;
const drawnByProcessor = (() => {
  const probe = context.call(document.createElement("canvas"), "webgl2");
  const told = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = told ? probe.getParameter(told.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
})();
if (drawnByProcessor) {
  const every = window.setInterval.bind(window);
  window.setInterval = (act, delay, ...rest) => every(act, delay === HEARTBEAT_MS ? 8 * delay : delay, ...rest);
  HTMLCanvasElement.prototype.getContext = function (kind, asked) {
    return context.call(this, kind, /^webgl/.test(kind) ? { ...asked, antialias: false } : asked);
  };
}

// Without a GPU one frame of the block takes as long as ten of the desk, and both draw in one thread.
const SLOW_MS = 45;
const PATIENCE_MS = 3000;
const PAUSE_MS = 80;
const LOOK_AGAIN_MS = 25;
const frames = { real: window.requestAnimationFrame.bind(window), stop: window.cancelAnimationFrame.bind(window) };
const waiting = new Map();
let tickets = 0;
let heldSince = 0;
let frameAt = 0;
let took = 0;
let inside = false;

function givesWay() {
  const now = performance.now();
  const held = took > SLOW_MS && now - handAt > 600 && window.parent.gruberAtWork?.();
  if (!held) {
    heldSince = 0;
    return false;
  }
  if (!heldSince || now - heldSince > PATIENCE_MS + PAUSE_MS) heldSince = now;
  // However long the hand works, the block is drawn now and then.
  return now - heldSince < PATIENCE_MS;
}

function ask(ticket, callback, inFrame) {
  if (givesWay()) {
    waiting.set(ticket, { later: setTimeout(() => ask(ticket, callback, false), LOOK_AGAIN_MS) });
    return;
  }
  const frame = frames.real((time) => {
    waiting.delete(ticket);
    const now = performance.now();
    // Frames that follow one another tell how long one takes.
    if (inFrame && now > frameAt + 1) took += 0.3 * (Math.min(now - frameAt, 1000) - took);
    frameAt = now;
    inside = true;
    callback(time);
    inside = false;
  });
  waiting.set(ticket, { frame });
}

window.requestAnimationFrame = (callback) => {
  const ticket = (tickets += 1);
  ask(ticket, callback, inside);
  return ticket;
};
window.cancelAnimationFrame = (ticket) => {
  const found = waiting.get(ticket);
  waiting.delete(ticket);
  if (found?.later) clearTimeout(found.later);
  if (found?.frame) frames.stop(found.frame);
};
