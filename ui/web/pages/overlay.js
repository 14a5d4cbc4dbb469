// What is drawn over pictures: lines with a dark rim, crosses, words; all in css pixels.

/**
 * An empty canvas as sharp as the screen, with its size in css pixels.
 * @param {HTMLCanvasElement} canvas @returns {[Context, number, number]}
 */
export function cleared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== across || canvas.height !== down) {
    Object.assign(canvas, { width: across, height: down });
  }
  const context = /** @type {Context} */ (canvas.getContext("2d"));
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

/**
 * A line with a dark rim.
 * @param {Context} context @param {string} colour @param {number} width @param {() => void} path
 */
export function halo(context, colour, width, path) {
  for (const [ink, wide] of /** @type {const} */ ([["#000000b0", width + 2], [colour, width]])) {
    context.beginPath();
    path();
    context.strokeStyle = ink;
    context.lineWidth = wide;
    context.stroke();
  }
}

/** @param {Context} context @param {Pair} place @param {string} colour */
export function measuredMark(context, [x, y], colour) {
  halo(context, colour, 1.8, () => {
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + dx * 4, y + dy * 4);
      context.lineTo(x + dx * 15, y + dy * 15);
    }
  });
  context.fillStyle = colour;
  context.fillRect(x - 0.75, y - 0.75, 1.5, 1.5);
}

/**
 * Where a point is expected.
 * @param {Context} context @param {Pair} place @param {string} colour @param {number} radius
 */
export function expectedMark(context, [x, y], colour, radius) {
  context.setLineDash([4, 3]);
  halo(context, colour, 1.6, () => context.arc(x, y, radius, 0, 7));
  context.setLineDash([]);
}

/** @param {Context} context @param {Pair} place @param {number} width @param {number} height */
export function crosshair(context, [x, y], width, height) {
  const [cx, cy] = [Math.round(x) + 0.5, Math.round(y) + 0.5];
  const gap = 7;
  for (const [ink, wide] of /** @type {const} */ ([["#00000060", 3], ["#ffffffb8", 1]])) {
    line(context, [0, cy], [cx - gap, cy], ink, wide);
    line(context, [cx + gap, cy], [width, cy], ink, wide);
    line(context, [cx, 0], [cx, cy - gap], ink, wide);
    line(context, [cx, cy + gap], [cx, height], ink, wide);
  }
}

/**
 * @param {Context} context @param {Pair} from @param {Pair} to
 * @param {string} colour @param {number} width
 */
export function line(context, from, to, colour, width) {
  context.beginPath();
  context.moveTo(from[0], from[1]);
  context.lineTo(to[0], to[1]);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

/** @param {Context} context @param {string} words @param {Pair} place @param {string} colour */
export function text(context, words, [x, y], colour) {
  context.font = "12px Inter, sans-serif";
  context.lineWidth = 3;
  context.strokeStyle = "#000000c0";
  context.strokeText(words, x, y);
  context.fillStyle = colour;
  context.fillText(words, x, y);
}
