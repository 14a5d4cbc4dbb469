// Edges of the ortho, to be laid over the scan: what agrees there was what was compared.
import { drawLayer, layerFromGround, orthoLayer } from "./tiles.js";
import { start } from "./words.js";

const SHARE = 0.06; // design: the strongest of all places are drawn, whatever the contrast
const BLUR = "blur(1.6px)"; // design: what is smaller than three pixels of the scan is noise
const MOST = 900; // design: pixels of a side, found within a frame of the screen
const INK = [255, 230, 70];
const state = { shape: "", drawing: document.createElement("canvas"), whole: false };

/**
 * The canvas with the edges of a part of the ortho: what is no edge is clear.
 * @param {Pair} middle on the layer @param {Pair} metres across and down
 * @param {number} coarse metres of a pixel of the scan: finer things were not compared
 */
function edgesOf(middle, metres, coarse) {
  const pixel = Math.max(start.ortho_pixel, coarse, Math.max(...metres) / MOST);
  const size = metres.map((length) => Math.max(3, Math.round(length / pixel)));
  const shape = JSON.stringify([middle, size, pixel]);
  const { drawing } = state;
  if (shape === state.shape && state.whole) return drawing;
  Object.assign(drawing, { width: size[0], height: size[1] });
  const context = /** @type {Context} */ (drawing.getContext("2d", { willReadFrequently: true }));
  const frame = { x: middle[0] - metres[0] / 2, y: middle[1] - metres[1] / 2, scale: 1 / pixel };
  const whole = drawLayer(context, orthoLayer(false), frame, size);
  Object.assign(state, { shape, whole });
  context.filter = BLUR;
  context.drawImage(drawing, 0, 0);
  context.filter = "none";
  const picture = context.getImageData(0, 0, size[0], size[1]);
  context.putImageData(inked(picture), 0, 0);
  return drawing;
}

/** Thin lines where the picture changes most. @param {ImageData} picture */
function inked(picture) {
  const { width, height, data } = picture;
  const grey = new Float32Array(width * height);
  for (let at = 0; at < grey.length; at += 1) {
    grey[at] = data[4 * at + 3] >= 250 ? 0.3 * data[4 * at] + 0.6 * data[4 * at + 1]
      + 0.1 * data[4 * at + 2] : NaN;
  }
  const [across, down, size] = [grey, grey, grey].map(() => new Float32Array(grey.length));
  for (let row = 1; row < height - 1; row += 1) {
    for (let column = 1; column < width - 1; column += 1) {
      const at = row * width + column;
      // Sobel's operator.
      const [up, low] = [at - width, at + width];
      across[at] = grey[up + 1] + 2 * grey[at + 1] + grey[low + 1]
        - grey[up - 1] - 2 * grey[at - 1] - grey[low - 1];
      down[at] = grey[low - 1] + 2 * grey[low] + grey[low + 1]
        - grey[up - 1] - 2 * grey[up] - grey[up + 1];
      size[at] = Math.hypot(across[at], down[at]) || 0;
    }
  }
  const sorted = Float32Array.from(size).sort();
  const least = Math.max(sorted[Math.floor((1 - SHARE) * sorted.length)], 1);
  data.fill(0);
  for (let at = width; at < size.length - width; at += 1) {
    if (size[at] < least) continue;
    const beside = Math.abs(across[at]) > Math.abs(down[at]) ? 1 : width;
    if (size[at] < size[at - beside] || size[at] < size[at + beside]) continue;
    data.set([...INK, 230], 4 * at);
  }
  return picture;
}

/**
 * Lay the edges over a picture of the same ground.
 * @param {Context} context @param {Pair} middle ground @param {Pair} metres across and down
 * @param {number} coarse metres of a pixel of the scan
 * @param {(ground: Pair) => Pair} onScreen
 */
export function drawEdges(context, middle, metres, coarse, onScreen) {
  const drawing = edgesOf(layerFromGround(middle), metres, coarse);
  const [east, north] = middle;
  const [half, low] = [metres[0] / 2, metres[1] / 2];
  const at = onScreen([east - half, north + low]);
  const right = onScreen([east + half, north + low]);
  const down = onScreen([east - half, north - low]);
  context.save();
  context.transform((right[0] - at[0]) / drawing.width, (right[1] - at[1]) / drawing.width,
    (down[0] - at[0]) / drawing.height, (down[1] - at[1]) / drawing.height, at[0], at[1]);
  context.drawImage(drawing, 0, 0);
  context.restore();
}

