// The form of block.toml, made from its schema: one field for each key.
import {
  again, between, byId, element, numberOf, start, tip, word, written,
} from "./words.js";

/** @typedef {{ name: string, field: FormField, input: Input, room: HTMLElement }} Shown */
/** @typedef {HTMLInputElement | HTMLTextAreaElement | HTMLSelectElement} Input */

const state = {
  shown: /** @type {Shown[]} */ ([]),
  /** What a hand has written: what was found later does not overwrite it. */
  written: /** @type {Record<string, string>} */ ({}),
  folder: "",
};

const KEPT = "gruber.written.";
const LONG = ["marks", "files", "rasters", "file"];

/** @param {Form} form @param {() => void} changed */
export function showForm(form, changed) {
  const held = heldPlace();
  const several = form.sections.filter(({ kind }) => kind === "camera").length > 1;
  state.shown = [];
  const parts = form.sections.map(({ table, kind, fields }) => {
    const title = word(`form.${kind}`) + (several && kind === "camera" ? ` ${table.slice(7)}` : "");
    const made = fields.map((field) => fieldPart(table, field, changed));
    const more = made.filter((_, index) => fields[index].more);
    const open = fields.some(({ more: folded, known }) => folded && known);
    return element("fieldset", {}, element("h2", {}, title),
      ...made.filter((_, index) => !fields[index].more),
      more.length ? element("details", { open }, element("summary", {}, word("form.more")), ...more)
        : null);
  });
  byId("form").replaceChildren(...parts);
  fillFields(form);
  takeUp(held);
}

/** The field that has the keyboard, and what is marked in it: a form drawn anew keeps both. */
function heldPlace() {
  const field = /** @type {HTMLInputElement | null} */ (document.activeElement);
  return { id: field?.id, from: field?.selectionStart ?? null, to: field?.selectionEnd ?? null };
}

/** @param {ReturnType<typeof heldPlace>} held */
function takeUp({ id, from, to }) {
  const field = /** @type {HTMLInputElement | null} */ (id ? document.getElementById(id) : null);
  field?.focus();
  if (from !== null) field?.setSelectionRange(from, to);
}

/**
 * What was written in this tab and not saved, also before another page took this one's place.
 * @param {string} folder @returns {boolean} true when there is any
 */
export function recallWritten(folder) {
  const kept = sessionStorage.getItem(KEPT + folder);
  if (folder !== state.folder) Object.assign(state, { folder, written: JSON.parse(kept ?? "{}") });
  return Boolean(kept);
}

/** What a hand has written and nobody has saved. */
export const formWritten = () => ({ ...state.written });

/** What the file had of each of these when it was shown; nothing where it had none. */
export const formSeen = () => Object.fromEntries(Object.keys(state.written).map((name) => {
  const field = state.shown.find((one) => one.name === name)?.field;
  return [name, field?.known ? field.value : null];
}));

/** What was written is in the file now, or no longer wanted. @param {Record<string, string>} old */
export function dropWritten(old) {
  for (const [name, text] of Object.entries(old)) {
    if (state.written[name] === text) delete state.written[name];
  }
  keepWritten();
}

function keepWritten() {
  const name = KEPT + state.folder;
  if (Object.keys(state.written).length) {
    sessionStorage.setItem(name, JSON.stringify(state.written));
  } else sessionStorage.removeItem(name);
}

/** Name of a field in words. @param {string} name such as camera.film.frame_mm */
export function formShown(name) {
  const parts = name.split(".");
  return word(`key.${parts[0]}.${parts[parts.length - 1]}`);
}

/**
 * A way to a field that cannot be used; what the form does not have says itself what is wrong.
 * @param {string} name @param {string} why
 */
export function goToField(name, why) {
  const one = state.shown.find((shown) => shown.name === name);
  if (!one) return element("p", {}, `[${name.replace(/\.(?=\w+$)/, "] ")} ${why}`);
  return element("button", { type: "button", class: "small", "data-to": name, title: why,
    onclick: () => {
      const folded = one.room.closest("details");
      if (folded) folded.open = true;
      one.room.scrollIntoView({ block: "nearest" });
      one.input.focus();
    } }, formShown(name));
}

/** @param {string} table @param {FormField} field @param {() => void} changed */
function fieldPart(table, field, changed) {
  const name = `${table}.${field.key}`;
  const id = `field-${name.replaceAll(".", "-")}`;
  const text = state.written[name] ?? textOf(field.value);
  const input = inputOf(field, id);
  input.value = text;
  input.disabled = start.guest;
  const kind = `key.${table.split(".")[0]}.${field.key}`;
  const label = element("label", { for: id, title: tip(kind) ?? `[${table}] ${field.key}` },
    word(kind), field.required ? element("em", {}, "\u00a0*") : null);
  const proposed = !field.known && field.value !== null && state.written[name] === undefined;
  const why = proposed && field.why ? element("small", {},
    word(`form.why.${field.why[0]}`, { size: field.why[1] })) : null;
  const other = field.known && text !== textOf(field.value) ? element("small", { class: "file" },
    word("form.file", { value: textOf(field.value) })) : null;
  const room = element("div", { class: `field${proposed ? " proposed" : ""}` }, label, input,
    why, other, element("span", { class: "wrong", id: `${id}-wrong` }));
  input.setAttribute("aria-describedby", `${id}-wrong`);
  input.addEventListener("input", () => {
    // What the file has anyway is not written again: it may have something newer by then.
    if (field.known && input.value === textOf(field.value)) delete state.written[name];
    else state.written[name] = input.value;
    keepWritten();
    room.classList.remove("proposed");
    changed();
  });
  state.shown.push({ name, field, input, room });
  return room;
}

/** @param {FormField} field @param {string} id @returns {Input} */
function inputOf(field, id) {
  const { kind, choices } = field;
  if (choices.length) {
    const empty = field.required || choices.includes("") ? [] : [["", usual(field)]];
    const known = choices.map((choice) => [choice, chosen(choice)]);
    return element("select", { id }, ...[...empty, ...known]
      .map(([value, text]) => element("option", { value }, text)));
  }
  const placeholder = kind === "marks" ? "1  \u221284.5  0.3" : usual(field);
  if (LONG.includes(kind)) {
    const rows = kind === "marks" ? 4 : Math.min(4, textOf(field.value).split("\n").length);
    return element("textarea", { id, rows, placeholder, spellcheck: "false" });
  }
  return element("input", { id, placeholder, spellcheck: "false" });
}

/** A choice in words; numbers are none. @param {string} choice */
const chosen = (choice) => (choice === "" ? word("form.none")
  : /^\d+$/.test(choice) ? choice : word(`choice.${choice}`));

/** What holds where a field is left empty. @param {FormField} field */
function usual({ choices, default: value, range }) {
  const text = choices.length ? chosen(textOf(value)) : textOf(value);
  if (text) return word("form.usual", { value: text });
  return range.length ? range.map(written).join("\u2013") : "";
}

/** A value as a hand writes it. @param {any} value @returns {string} */
function textOf(value) {
  if (value === null || value === undefined) return "";
  if (Array.isArray(value)) {
    return value.some((item) => typeof item === "string") ? value.join("\n")
      : value.map(written).join(between());
  }
  if (typeof value === "object") {
    return Object.entries(value)
      .map(([name, place]) => [name, ...[place].flat().map(textOf)].join("  ")).join("\n");
  }
  return typeof value === "number" ? written(value) : `${value}`;
}

/** A number; else the text, which is then refused with its reason. @param {string} text */
const numberOr = (text) => (Number.isFinite(numberOf(text)) ? numberOf(text) : text);

/** @param {FormField} field @param {string} text @returns {unknown} */
function valueOf({ kind }, text) {
  const lines = text.split("\n").map((line) => line.trim()).filter(Boolean);
  if (!lines.length) return null;
  if (kind === "number" || kind === "count") return numberOr(lines[0]);
  if (kind === "numbers" || kind === "measures") {
    return text.trim().split(/[\s;]+|,\s+|,(?=\s*$)/).filter(Boolean).map(numberOr);
  }
  if (kind === "marks") {
    const marks = lines.map((line) => {
      const [name, ...place] = line.split(/[\s;=]+/);
      return [name, place.map((part) => numberOr(part.replace(/,$/, "")))];
    });
    // A name that stands twice would be lost among names: it is refused with its reason.
    const names = new Set(marks.map(([name]) => name));
    return names.size < marks.length ? marks : Object.fromEntries(marks);
  }
  if (LONG.includes(kind)) return lines.length === 1 ? lines[0] : lines;
  return text.trim();
}

/**
 * A field filled in from elsewhere, as if a hand had written it.
 * @param {string} key such as camera.frame_mm: that of the first camera @param {string} value
 */
export function fillIn(key, value) {
  const [table, last] = key.split(".");
  const one = state.shown.find(({ name }) =>
    name.startsWith(`${table}.`) && name.endsWith(`.${last}`));
  if (!one) return;
  const folded = one.room.closest("details");
  if (folded) folded.open = true;
  one.input.value = value;
  one.input.dispatchEvent(new Event("input"));
  one.input.focus();
}

/** Every field with its value; null where it is left empty. */
export function formValues() {
  return Object.fromEntries(state.shown.map(({ name, field, input }) =>
    [name, valueOf(field, input.value)]));
}

/** What is wrong stands below its field. @param {Judged} judged */
export function fillFields({ errors }) {
  for (const { name, room, input } of state.shown) {
    const why = again(errors[name] ?? "");
    room.classList.toggle("bad", Boolean(why));
    /** @type {HTMLElement} */ (room.querySelector(".wrong")).textContent = why;
    input.setAttribute("aria-invalid", `${Boolean(why)}`);
    const folded = room.closest("details");
    if (why && folded) folded.open = true;
  }
}
