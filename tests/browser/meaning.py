"""What an operator means by a key or a click, and what of it may be in the session file."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sessions.decisions import Decision
from ui.words.catalogue import words

EYE = """(() => {
  if (window.walk) return;
  const NAMES = "[data-act], [data-board], [data-check], [data-reason], .row, "
    + "#keep button, #reasons button, #history li button, .decided button, .magnified, .pane, "
    + "button, a, select, input, textarea, summary, tr, iframe";
  const NAMED = [["#keep button:first-of-type", "act accept"], ["#keep button", "drop"],
    ["#reasons button", "reason"], ["#history li button, .decided button", "back"],
    [".magnified", "magnified"], [".pane", "pane"]];
  const nameOf = from => {
    const e = from?.closest?.(NAMES);
    if (!e || e.disabled) return "";
    const { act, board, check, key, reason } = e.dataset;
    if (act) return `act ${act}`;
    if (check || reason) return `check ${check ?? "reason"}`;
    if (board) return `board ${board}`;
    if (key) return `row ${key}`;
    return NAMED.find(([selector]) => e.matches(selector))?.[1]
      ?? (e.id || `${e.tagName.toLowerCase()} ${(e.textContent || "").trim().slice(0, 24)}`);
  };
  // Keys that a control would have used which is gone since are not for the desk.
  let held = null;
  window.addEventListener("focusin", ({ target }) => { held = target; }, true);
  for (const type of ["pointerdown", "close"]) {
    window.addEventListener(type, () => { held = null; }, true);
  }
  window.addEventListener("click", ({ detail }) => { if (detail) held = null; });
  window.addEventListener("keydown", ({ key }) => {
    const gone = isGone();
    queueMicrotask(() => {
      if (document.activeElement === document.body && !(gone && PRESSES.includes(key))
        && !["Shift", "Tab"].includes(key)) held = null;
    });
  });
  const PRESSES = ["Enter", " "];
  const isGone = () => Boolean(held && document.activeElement === document.body
    && (held.disabled || !held.checkVisibility()));
  const shown = id => document.getElementById(id)?.checkVisibility() ?? false;
  const asks = () => Boolean(document.querySelector("#asked.against, #turning"));
  const look = () => {
    const head = [...document.querySelectorAll("#point-name > b, #point-name > .scan")];
    const e = document.activeElement;
    return {
      dialog: document.querySelector("dialog[open]")?.id ?? "",
      current: head.map(part => part.textContent).join("|"),
      state: document.querySelector("#acts .stands")?.dataset.act ?? "",
      asked: document.getElementById("asked")?.className ?? "",
      asks: asks(),
      drafts: document.getElementById("drafts")?.textContent ?? "",
      draftRows: (window.gruber?.parts?.queue?.drafts ?? [])
        .map(index => window.gruber.parts.rows[index].slice(0, 2).join("|")),
      marked: [...document.querySelectorAll(".row.marked")].map(r => r.dataset.state),
      many: document.getElementById("queue-place")?.className === "many",
      chip: document.querySelector(".chip.on")?.dataset.state ?? "",
      mark: document.querySelector("#board .mark.on")?.dataset.mark ?? "",
      able: !document.querySelector("[data-act=accept]")?.disabled,
      tag: e?.tagName ?? "", role: e?.role ?? "", kind: e?.type ?? "",
      drafted: shown("board-draft"), area: shown("scene-area"),
      inQueue: Boolean(e?.closest("#queue")), gone: isGone(),
    };
  };
  window.walk = { texts: [], seen: [], asks: 0, asked: 0, look, nameOf };
  for (const type of ["keydown", "click"]) window.addEventListener(type, event => {
    const { key, shiftKey: shift, ctrlKey: ctrl, repeat, target } = event;
    const inside = window !== top;
    const on = nameOf(type === "click" ? target : document.activeElement);
    const at = performance.timeOrigin + event.timeStamp;
    top.walk.seen.push({ type, key, shift, ctrl, repeat, inside, on, at, ...top.walk.look() });
  }, true);
  let asked = false;
  new MutationObserver(records => {
    if (!asked && asks()) {
      window.walk.asks += 1;
      window.walk.asked = performance.timeOrigin + performance.now();
    }
    asked = asks();
    for (const { addedNodes } of records) for (const node of addedNodes) {
      if (!node.classList?.contains("notice")) continue;
      window.walk.texts.push(node.textContent);
    }
  }).observe(document,
    { childList: true, subtree: true, attributes: true, attributeFilter: ["class"] });
  window.print = () => ["beforeprint", "afterprint"].forEach(n => dispatchEvent(new Event(n)));
})()"""
"""What an eye sees at the moment of every key and click, before the page acts on it."""
Names = frozenset[str]
VERDICTS = {"y": "accept", "n": "reject", "m": "dubious", "v": "invisible"}
OTHERS = {"JudgeTie", "JudgePhoto", "JudgeFiducial"}
WRITES: dict[str, Names] = {
    "accept": frozenset({"AddPoint", "Accept", "Place", "ChoosePeak", *OTHERS}),
    "reject": frozenset({"Reject", *OTHERS}),
    "dubious": frozenset({"MarkDubious"}), "invisible": frozenset({"MarkNotVisible"}),
    "role": frozenset({"SetRole"}), "undo": frozenset({"Withdraw"}),
    "redo": frozenset({"Withdraw"}), "back": frozenset({"Withdraw"}),
    "reason": frozenset({"Withdraw", "Reject"}),
    "use": frozenset({"JudgeFiducial", "PlaceFiducial"}),
    "fill": frozenset({"FillMarks"}), "draw": frozenset({"DrawMask", "SeamLine", "SeamArea"}),
    "stand": frozenset({"PlacePhoto"}),
    "read": frozenset({"ReadCheck"}), "sign": frozenset({"SignBlock"}),
    "say": frozenset({"Remark"}),
}  # fmt: skip
"""Decisions that a meaning may leave in the file."""
STANDS = {"accept": "accept", "reject": "reject", "dubious": "dubious", "invisible": "reject"}
"""The button that is lit where a verdict stands."""
REFUSED = (
    "ahead", "yes-or-no", "still-drafts", "guest", "wire", "not-done", "overtaken", "place-first",
    "read-first", "only-draft", "no-role", "far-off", "unread",
)  # fmt: skip
ANSWERS = {
    "undo": ("nothing-to-undo", "nothing-to-undo.here"), "back": ("turned",),
    "redo": ("nothing-to-redo", "nothing-to-redo.here"), "reason": ("no-reason",),
    "refine": ("refined", "refined.photos", "not-refined"),
    "fill": ("filled", "filled-anew", "not-filled"),
}  # fmt: skip
"""Notices that answer what was meant, in the file or not."""
LATE = frozenset({"fill"})
"""What is measured first, or waits for the hand to pause."""
PRESSES, MOVES = {"Enter", " "}, {"Home", "End", "PageUp", "PageDown"}
ARROWS = {"ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"}


@dataclass(frozen=True)
class Meaning:
    """What a gesture means to who made it."""

    what: str
    key: str = ""
    """The row it is about; nothing where the hand was ahead of the picture."""
    must: bool = False
    """True when it has to be in the file, or be answered in words."""
    state: str = ""
    """The verdict that stood there, as an eye saw it."""
    at: float = field(default_factory=time.monotonic)


def meaning_of(seen: dict[str, Any]) -> Meaning | None:
    """What an operator means by one key or click; None where nothing is decided by it."""
    if seen["type"] == "click":
        return _click_means(seen)
    if seen["on"] == "remark-words" and seen["key"] == "Enter":
        return Meaning("say")
    if _is_used_up(seen):
        return None
    if seen["dialog"]:
        means = SHEETS.get(seen["dialog"])
        return means(seen) if means else None
    return None if seen["repeat"] else _key_means(seen)


def drafts_nothing(seen: dict[str, Any]) -> bool:
    """True for what surely leaves no new draft: verdicts, undo, and going from row to row."""
    if seen["type"] == "click":
        return seen["on"].startswith(("row ", "act undo", "act reject", "act dubious"))
    return seen["key"].lower() in (*"ynmvujk12345", "shift", "escape")


def _is_used_up(seen: dict[str, Any]) -> bool:
    """True for a key that what has the focus uses itself; a press comes as a click."""
    key, tag = seen["key"], seen["tag"]
    if seen["role"] in ("separator", "region"):
        return key in _USES["range"]
    if tag in ("BUTTON", "SUMMARY", "A"):
        return key in PRESSES
    if tag == "INPUT":
        return seen["kind"] not in _USES or key in _USES[seen["kind"]]
    return tag in ("SELECT", "TEXTAREA")


def _key_means(seen: dict[str, Any]) -> Meaning | None:
    key = seen["key"]
    letter = key.lower() if len(key) == 1 else key
    if letter in VERDICTS:
        return _verdict(VERDICTS[letter], seen)
    if letter in "12345":
        return Meaning("reason", must=seen["asked"] == "why")
    if letter in ("c", "Enter"):
        if seen["area"] and letter == "Enter":
            return None
        # After a button that is gone Enter may mean nothing; it never means anything else.
        must = seen["able"] and not (seen["gone"] and letter == "Enter")
        return Meaning("role" if letter == "c" else "refine", seen["current"], must)
    return _undo(seen) if letter == "u" else None


_USES = {"range": ARROWS | MOVES | {"Enter"}, "checkbox": {" "}, "radio": {" ", *ARROWS}}


def _undo(seen: dict[str, Any]) -> Meaning:
    """What was done last is taken back first: a draft goes without a word."""
    drafted = seen["drafts"] or seen["drafted"]
    return Meaning("redo" if seen["shift"] else "undo", must=seen["shift"] or not drafted)


def _verdict(what: str, seen: dict[str, Any]) -> Meaning:
    if seen["many"]:
        return Meaning(f"{what} all", must="auto" in seen["marked"])
    return Meaning(what, seen["current"], seen["able"] and bool(seen["current"]), seen["state"])


def _click_means(seen: dict[str, Any]) -> Meaning | None:
    on, dialog = seen["on"], seen["dialog"]
    kind, _, name = on.partition(" ")
    if kind == "board":
        # A draft against the other marks is asked about first.
        return {
            "keep": Meaning("use", seen["mark"], not seen["drafted"]),
            "hide": Meaning("use", seen["mark"], True),
            "undo": _undo(seen),
            "fill": Meaning("fill"),
        }.get(name)
    if kind == "act":
        return _act_means(name, seen)
    if kind == "check":
        return {"keep": Meaning("read"), "reason": Meaning("read"), "back": Meaning("back")}.get(
            name
        )
    drawing = {"mask": Meaning("draw"), "mosaic": Meaning("draw")}
    return {
        "back": Meaning("back", must=True),
        "reason": Meaning("reason", must=seen["asked"] == "why"),
        "placing-save": Meaning("stand"),
        "sign": Meaning("sign"),
        "fault-mark": Meaning("say"),
        "fault-say": Meaning("say"),
        "fault-turn": Meaning("say"),
        "fault-back": Meaning("back"),
        "remark-say": Meaning("say"),
        "pane": drawing.get(dialog),
    }.get(on)


def _act_means(name: str, seen: dict[str, Any]) -> Meaning | None:
    if name in VERDICTS.values():
        return _verdict(name, seen)
    if name in ("role", "refine"):
        return Meaning(name, seen["current"], seen["able"])
    return {
        "redo": Meaning("redo", must=True),
        "undo": _undo({**seen, "shift": False}),
        "accept-all": Meaning("accept all"),
    }.get(name)


def _board_means(seen: dict[str, Any]) -> Meaning | None:
    key, mark = seen["key"], seen["mark"]
    letter = key.lower() if len(key) == 1 else key
    if not mark or seen["repeat"]:
        return None
    if letter in ("y", "v", "n"):
        return Meaning("use", mark, must=letter != "y" or not seen["drafted"])
    if letter in ("u", "l"):
        return _undo(seen) if letter == "u" else Meaning("fill")
    return None


def _mask_means(seen: dict[str, Any]) -> Meaning | None:
    key = seen["key"]
    if key in PRESSES:
        return Meaning("draw")
    return _undo(seen) if key.lower() == "u" and not seen["repeat"] else None


def _placed_means(seen: dict[str, Any]) -> Meaning | None:
    return Meaning("stand") if seen["key"] == "s" else None


def _checks_means(seen: dict[str, Any]) -> Meaning | None:
    if seen["key"].lower() == "u" and not seen["repeat"]:
        return _undo(seen)
    return Meaning("read") if seen["key"].lower() in ("y", *"1234") else None


SHEETS: dict[str, Callable[[dict[str, Any]], Meaning | None]] = {
    "board": _board_means,
    "mask": _mask_means,
    "mosaic": _mask_means,
    "placed": _placed_means,
    "checks": _checks_means,
}
"""What keys mean in an open sheet; in any other they decide nothing."""
SAID = {
    name: tuple(words(language)[f"notice.{name}"].partition("{")[0] for language in ("en", "cs"))
    for name in (*REFUSED, *(name for names in ANSWERS.values() for name in names))
}
"""How each of these notices begins."""


def is_about(decision: Decision, key: str) -> bool:
    """True when a decision is about a row or a mark of the board."""
    one, _, other = key.partition("|")
    point, photo = getattr(decision, "point_id", None), getattr(decision, "photo_id", None)
    if type(decision).__name__ in ("SetRole", "AddPoint"):
        return point == one
    if point is not None:
        return (point, photo) == (one, other)
    return photo in (one, other)
