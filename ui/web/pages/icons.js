// Shapes of icons and states, drawn in a box of 16 by 16; C stands for the colour.
const RING = '<circle cx="8" cy="8" fill="none" stroke="C"';
const LINE = 'fill="none" stroke="C" stroke-width="1.5" stroke-linecap="round"'
  + ' stroke-linejoin="round"';

/** @param {string} path */
const drawn = (path) => `<path d="${path}" ${LINE}/>`;

/** @type {Record<string, string>} */
export const SHAPES = {
  circle: `${RING} r="4.6" stroke-width="2"/>`,
  disc: '<circle cx="8" cy="8" r="5.6" fill="C"/>'
    + '<path d="M5.2 8.2l2 2 3.6-4.2" fill="none" stroke="#0b0d10" stroke-width="1.6"/>',
  cross: '<path d="M4 4l8 8M12 4l-8 8" stroke="C" stroke-width="2.4" stroke-linecap="round"/>',
  diamond: '<path d="M8 2l6 6-6 6-6-6z" fill="C"/>',
  square: '<rect x="4.5" y="4.5" width="7" height="7" fill="none" stroke="C" stroke-width="1.6"/>',
  dashed: `${RING} r="4.6" stroke-width="1.8" stroke-dasharray="2.4 1.7"/>`,
  target: `${RING} r="5.2" stroke-width="1.4"/><circle cx="8" cy="8" r="2" fill="C"/>`,
  bare: '<path d="M3 3h10v10H3zM3 3l10 10M13 3L3 13" fill="none" stroke="C" stroke-width="1.5"/>',
  control: '<path d="M8 3l5.5 10h-11z" fill="none" stroke="C" stroke-width="1.5"/>',
  new: `${RING} r="5.2" stroke-width="1.5"/>`
    + '<path d="M8 5.4v5.2M5.4 8h5.2" stroke="C" stroke-width="1.3"/>',
  tie: '<path d="M8 3v10M3 8h10M4.5 4.5l7 7M11.5 4.5l-7 7" stroke="C" stroke-width="1.3"/>',
  photo: '<path d="M2.5 4h11v8.5h-11zM2.5 12.5l5.5-4 5.5 4" fill="none" stroke="C"'
    + ' stroke-width="1.3"/>',
  fiducial: `${RING} r="4.5" stroke-width="1.3"/>`
    + '<path d="M8 1.5v13M1.5 8h13" stroke="C" stroke-width="1.1"/>',
  check: '<rect x="3.2" y="3.2" width="9.6" height="9.6" fill="none" stroke="C"'
    + ' stroke-width="1.5"/><circle cx="8" cy="8" r="1.3" fill="C"/>',
  up: drawn("M3.5 10.5L8 6l4.5 4.5"),
  down: drawn("M3.5 5.5L8 10l4.5-4.5"),
  undo: drawn("M5.5 3L2.5 6l3 3M3 6h6.5a3.5 3.5 0 0 1 0 7H6"),
  redo: drawn("M10.5 3l3 3-3 3M13 6H6.5a3.5 3.5 0 0 0 0 7H10"),
  grow: drawn("M9.5 2.5h4v4M6.5 13.5h-4v-4M13.5 2.5l-5 5M2.5 13.5l5-5"),
  whole: drawn("M2.5 5.5v-3h3M10.5 2.5h3v3M13.5 10.5v3h-3M5.5 13.5h-3v-3"),
  fit: `${RING} r="4.3" stroke-width="1.5"/>${drawn("M8 1.5v4M8 10.5v4M1.5 8h4M10.5 8h4")}`,
  add: drawn("M8 3v10M3 8h10"),
  swap: drawn("M2.5 5.5h10l-3-3M13.5 10.5h-10l3 3"),
  theme: `${RING} r="5.5" stroke-width="1.5"/><path d="M8 2.5a5.5 5.5 0 0 1 0 11z" fill="C"/>`,
  keys: drawn("M1.5 4.5h13v7h-13zM4 7h.1M6.7 7h.1M9.3 7h.1M12 7h.1M5 9.5h6"),
  quality: drawn("M2.5 13.5h11M4 11V7.5M8 11V3M12 11V5.5"),
  map: drawn("M2 4l4-1.5 4 1.5 4-1.5v9.5l-4 1.5-4-1.5-4 1.5zM6 2.5v9.5M10 4v9.5"),
  mosaic: drawn("M2 4.5h5l1.5 3-1 5.5H2zM7 4.5h7v8.5H7.5M8.5 7.5L14 6"),
  mask: drawn("M9.5 3l3.5 3.5-6 6H3.5v-3.5zM8 4.5l3.5 3.5M2 14.5h12"),
  list: drawn("M6 4h7.5M6 8h7.5M6 12h7.5M2.8 4h.1M2.8 8h.1M2.8 12h.1"),
  file: drawn("M4 2h5.5l3 3v9H4zM9.5 2v3h3"),
  gear: drawn("M3 4.5h4M10 4.5h3M8.5 3v3M3 8h1.5M7.5 8H13M6 6.5v3M3 11.5h5.5M11.5 11.5H13M10 10v3"),
  pin: drawn("M8 14.5c-3-3.5-4.5-5-4.5-7a4.5 4.5 0 0 1 9 0c0 2-1.5 3.5-4.5 7zM8 7h.1"),
  play: drawn("M5 3.5l7 4.5-7 4.5z"),
  tiles: drawn("M2.5 2.5h4.5v4.5h-4.5zM9 2.5h4.5v4.5h-4.5z"
    + "M2.5 9h4.5v4.5h-4.5zM9 9h4.5v4.5h-4.5z"),
  area: drawn("M2.5 5V2.5H5M7 2.5h2M11 2.5h2.5V5M13.5 7v2M13.5 11v2.5H11M9 13.5H7M5 13.5H2.5V11"
    + "M2.5 9V7"),
  details: drawn("M2.5 4h11M2.5 8h11M2.5 12h7"),
};
