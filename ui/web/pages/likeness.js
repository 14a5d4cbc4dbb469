// How alike ortho and scan are at every place about the expected one, laid over the scan.
import { start } from "./words.js";

/** @typedef {{ address: string, place?: number[], bitmap?: ImageBitmap }} LikenessMap */
const state = { map: /** @type {LikenessMap | null} */ (null) };

/**
 * Asked for when it is first to be seen; then drawn by `redraw`.
 * @param {Context} context @param {Point} point
 * @param {(raw: Pair) => Pair} onScreen place on the canvas of a scan pixel
 * @param {() => void} redraw
 */
export function drawLikeness(context, point, onScreen, redraw) {
  const { marks: { surveyed: [east, north] }, figures, scan } = point;
  const place = `${encodeURIComponent(point.key[1])}/${scan.version}/${east}/${north}`;
  const address = `/tiles/likeness/${place}/${figures.surveyed[2]}?e=${start.edition}`;
  if (state.map?.address !== address) fetchLikeness(address).then(redraw);
  if (!state.map?.bitmap) return;
  const { bitmap, place: [column, row, step] = [0, 0, 1] } = state.map;
  const { width, height } = bitmap;
  const [at, right, down] = [[0, 0], [width, 0], [0, height]]
    .map(([x, y]) => onScreen([column + (x - 0.5) * step, row + (y - 0.5) * step]));
  const across = [0, 1].map((i) => (right[i] - at[i]) / width);
  const along = [0, 1].map((i) => (down[i] - at[i]) / height);
  context.save();
  context.transform(across[0], across[1], along[0], along[1], at[0], at[1]);
  context.drawImage(bitmap, 0, 0);
  context.restore();
}

/** @param {string} address */
async function fetchLikeness(address) {
  state.map = { address };
  const answer = await fetch(address);
  if (answer.status !== 200) return;
  const place = (answer.headers.get("X-Place") ?? "").split(" ").map(Number);
  const bitmap = await createImageBitmap(await answer.blob());
  if (state.map.address === address) state.map = { address, place, bitmap };
}
