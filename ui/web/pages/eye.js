// The eye in the 3D scene, read from viser's page: rays under the pointer, north, metres of a
// pixel. Places are in the local frame: east, north, up.

const FRAME = "/footprints"; // a node that lies in the local frame as it is
const LEVEL_SLOPE = 0.05; // design: nearer to the horizon a scale bar says nothing

/** @param {number[]} one @param {number[]} other */
const dot = (one, other) => one.reduce((sum, value, i) => sum + value * other[i], 0);
/** @param {ArrayLike<number>} matrix by columns @param {number} number */
const column = (matrix, number) => [0, 1, 2].map((row) => matrix[4 * number + row]);

/**
 * Where the eye is, and the axes of its screen.
 * @param {any} inside window of viser's page @returns {Eye | null} null before there is one
 */
export function eyeOf(inside) {
  const { camera, canvas, nodeRefFromName } = inside?.__viserMutable ?? {};
  const frame = nodeRefFromName?.[FRAME]?.matrixWorld.elements;
  const own = camera?.matrixWorld.elements;
  if (!frame || !own || !canvas?.clientHeight) return null;
  const local = (/** @type {number[]} */ vector) =>
    [0, 1, 2].map((axis) => dot(column(frame, axis), vector));
  const origin = column(frame, 3);
  return {
    at: local(column(own, 3).map((value, i) => value - origin[i])),
    right: local(column(own, 0)),
    up: local(column(own, 1)),
    forward: local(column(own, 2)).map((value) => -value),
    slope: Math.tan((camera.fov * Math.PI) / 360),
    size: [canvas.clientWidth, canvas.clientHeight],
  };
}

/**
 * Origin and direction of the ray through a place on the screen.
 * @param {Eye} eye @param {Pair} screen css pixels @returns {number[]} six numbers
 */
export function rayThrough({ at, right, up, forward, slope, size: [width, height] }, [x, y]) {
  const [across, rise] = [(2 * x - width) / height, (height - 2 * y) / height];
  const towards = forward.map((value, i) => value + slope * (across * right[i] + rise * up[i]));
  const length = Math.hypot(...towards);
  return [...at, ...towards.map((value) => value / length)];
}

/**
 * Metres of a css pixel on the ground in the middle of the screen; null without ground there.
 * @param {Eye} eye @param {number} level height of the ground
 */
export function pixelMetres({ at, forward, slope, size: [, height] }, level) {
  if (forward[2] > -LEVEL_SLOPE || at[2] <= level) return null;
  return (2 * slope * (level - at[2])) / forward[2] / height;
}

/** North on the screen: right and up, at most 1 long. @param {Eye} eye @returns {Pair} */
export const northOf = ({ right, up }) => [right[1], up[1]];
