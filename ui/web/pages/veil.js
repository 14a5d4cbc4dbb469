// How alike ortho and scan are at every place about the expected one, as a veil over the scan.
import { start } from "/pages/words.js";

let veil = null;
let redraw = () => {};
export function onVeil(callback) { redraw = callback; }

// `onScreen` gives the place on the canvas of a scan pixel. Asked for when it is first to be seen.
export function drawVeil(context, point, onScreen) {
  const [east, north] = point.marks.surveyed;
  const photo = encodeURIComponent(point.key[1]);
  const address = `/tiles/likeness/${photo}/${point.scan.version}/${east}/${north}/${point.figures.surveyed[2]}?e=${start.edition}`;
  if (veil?.address !== address) fetchVeil(address);
  if (!veil?.bitmap) return;
  const [column, row, step] = veil.place;
  const { width, height } = veil.bitmap;
  const [at, right, down] = [[0, 0], [width, 0], [0, height]].map(([x, y]) => onScreen([column + (x - 0.5) * step, row + (y - 0.5) * step]));
  context.save();
  context.transform((right[0] - at[0]) / width, (right[1] - at[1]) / width, (down[0] - at[0]) / height, (down[1] - at[1]) / height, ...at);
  context.drawImage(veil.bitmap, 0, 0);
  context.restore();
}

async function fetchVeil(address) {
  veil = { address };
  const answer = await fetch(address);
  if (answer.status !== 200) return;
  const place = answer.headers.get("X-Place").split(" ").map(Number);
  const bitmap = await createImageBitmap(await answer.blob());
  if (veil.address !== address) return;
  veil = { address, place, bitmap };
  redraw();
}
