// What the page was told at the start: words, palette, lattice; and small helpers to write with them.

export const start = { words: {}, keys: [], palette: { states: {} }, photos: [], lattice: null };

export function word(key, values = {}) {
  const text = start.words[key] ?? key;
  return text.replace(/\{(\w+)\}/g, (whole, name) => values[name] ?? whole);
}

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") made.className = value;
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null) made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

export const byId = (name) => document.getElementById(name);

const SHAPES = {
  circle: '<circle cx="8" cy="8" r="4.6" fill="none" stroke="C" stroke-width="2"/>',
  disc: '<circle cx="8" cy="8" r="5.6" fill="C"/><path d="M5.2 8.2l2 2 3.6-4.2" fill="none" stroke="#0b0d10" stroke-width="1.6"/>',
  cross: '<path d="M4 4l8 8M12 4l-8 8" stroke="C" stroke-width="2.4" stroke-linecap="round"/>',
  diamond: '<path d="M8 2l6 6-6 6-6-6z" fill="C"/>',
  square: '<rect x="4.5" y="4.5" width="7" height="7" fill="none" stroke="C" stroke-width="1.6"/>',
  control: '<path d="M8 3l5.5 10h-11z" fill="none" stroke="C" stroke-width="1.5"/>',
  tie: '<path d="M8 3v10M3 8h10M4.5 4.5l7 7M11.5 4.5l-7 7" stroke="C" stroke-width="1.3"/>',
  photo: '<path d="M2.5 4h11v8.5h-11zM2.5 12.5l5.5-4 5.5 4" fill="none" stroke="C" stroke-width="1.3"/>',
  fiducial: '<circle cx="8" cy="8" r="4.5" fill="none" stroke="C" stroke-width="1.3"/><path d="M8 1.5v13M1.5 8h13" stroke="C" stroke-width="1.1"/>',
  check: '<rect x="3.2" y="3.2" width="9.6" height="9.6" fill="none" stroke="C" stroke-width="1.5"/><circle cx="8" cy="8" r="1.3" fill="C"/>',
};

export function glyph(shape, colour, size = 14) {
  const holder = document.createElement("template");
  holder.innerHTML = `<svg class="glyph" width="${size}" height="${size}" viewBox="0 0 16 16">${SHAPES[shape].replaceAll("C", colour)}</svg>`;
  return holder.content.firstChild;
}

export function stateGlyph(state, size = 14) {
  const look = start.palette.states[state];
  return glyph(look.glyph, look.colour, size);
}

export const roleGlyph = (role, size = 13) => glyph(role, role === "check" ? start.palette.check : "#8d97a6", size);

let prefix = "";

// Scan names share a long beginning as a rule: it is left out in narrow places.
export function learnNames(names) {
  prefix = "";
  if (names.length < 2) return;
  let length = 0;
  while (names.every((name) => length < name.length && name[length] === names[0][length])) length += 1;
  while (length && /[0-9A-Za-z]/.test(names[0][length - 1])) length -= 1;
  prefix = names[0].slice(0, length);
}

export const shortName = (name) => (prefix.length > 2 && name.startsWith(prefix) ? name.slice(prefix.length) : name);

let halves = null;

// Names made of two long coordinates: what all have in common at the beginning of either is left out.
export function learnPoints(names) {
  const parts = names.map((name) => /^([A-Za-z]*)(-?\d{5,})_(-?\d{5,})$/.exec(name)).filter(Boolean);
  halves = null;
  if (parts.length < 2) return;
  const common = (place) => {
    let length = 0;
    const texts = parts.map((part) => part[place]);
    while (texts.every((text) => length < text.length - 3 && text[length] === texts[0][length])) length += 1;
    return length;
  };
  halves = [common(2), common(3)];
}

export function shortPoint(name) {
  if (name.startsWith("photo ")) return word("role.photo.one");
  const part = halves && /^([A-Za-z]*)(-?\d{5,})_(-?\d{5,})$/.exec(name);
  return part ? `${part[1]} ${part[2].slice(halves[0])} ${part[3].slice(halves[1])}` : name;
}

export function number(value, digits, unit = "") {
  if (value === null || value === undefined) return "\u2013";
  return value.toFixed(digits).replace("-", "\u2212") + (unit ? `\u2009${unit}` : "");
}
