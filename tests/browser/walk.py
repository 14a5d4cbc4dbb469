"""Random walks over the pages: a monkey that knows what its keys mean and reads the session file.

`python -m tests.browser.walk --seeds 0-499 --steps 30` walks, and prints the steps of each walk
that went wrong; `--seeds 17` walks that one again. Nothing is asked of the desk: what a gesture may
write follows from where the focus was and what an eye sees.
"""

import argparse
import json
import logging
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from playwright.sync_api import Error as PageError
from playwright.sync_api import TimeoutError as TooLong
from playwright.sync_api import sync_playwright

from app.desk.inputs import desk_inputs
from app.desk.wiring import open_desk
from app.placing import Placeable, open_placing
from app.project import described, read_project
from app.start import open_start
from core.matching.reference import open_reference
from core.progress import Progress
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from sessions.decisions import Decision, Withdraw, standing
from sessions.session import Session
from tests.browser.conftest import ARGUMENTS, chromium_path, toured, without_viser
from tests.browser.test_desk_layout import CUT_OFF
from tests.tiny import open_tiny, with_check_points
from ui.words.catalogue import words

REPOSITORY = Path(__file__).resolve().parents[2]
LARGE = ((1366, 768), (1600, 1000), (1920, 1080))
SIZES = (*LARGE, (1024, 700), (800, 600))
OPERATOR = "monkey"
PATIENCE_S = 10.0
QUIET_S = 0.03
EYE = """(() => {
  if (window.walk) return;
  const NAMES = "[data-act], [data-board], .row, #keep button, #reasons button, #history button, "
    + ".decided button, .magnified, .pane, button, a, select, input, textarea, summary, tr, iframe";
  const NAMED = [["#keep button:first-of-type", "act accept"], ["#reasons button", "reason"],
    ["#history button, .decided button", "back"], [".magnified", "magnified"], [".pane", "pane"]];
  const nameOf = from => {
    const e = from?.closest?.(NAMES);
    if (!e || e.disabled) return "";
    const { act, board, key } = e.dataset;
    if (act) return `act ${act}`;
    if (board) return `board ${board}`;
    if (key) return `row ${key}`;
    return NAMED.find(([selector]) => e.matches(selector))?.[1]
      ?? (e.id || `${e.tagName.toLowerCase()} ${(e.textContent || "").trim().slice(0, 24)}`);
  };
  const shown = id => document.getElementById(id)?.checkVisibility() ?? false;
  const look = () => {
    const head = [...document.querySelectorAll("#point-name > b, #point-name > .scan")];
    const e = document.activeElement;
    return {
      dialog: document.querySelector("dialog[open]")?.id ?? "",
      current: head.map(part => part.textContent).join("|"),
      state: document.querySelector("#acts .stands")?.dataset.act ?? "",
      asked: document.getElementById("asked")?.className ?? "",
      adding: shown("adding"), drafts: document.getElementById("drafts")?.textContent ?? "",
      marked: [...document.querySelectorAll(".row.marked")].map(r => r.dataset.state),
      many: document.getElementById("queue-place")?.className === "many",
      chip: document.querySelector(".chip.on")?.dataset.state ?? "",
      mark: document.querySelector("#board .mark.on")?.dataset.mark ?? "",
      able: !document.querySelector("[data-act=accept]")?.disabled,
      tag: e?.tagName ?? "", kind: e?.type ?? "", onMark: e?.classList.contains("mark") ?? false,
      inQueue: Boolean(e?.closest("#queue")),
    };
  };
  window.walk = { texts: [], seen: [], look, nameOf };
  for (const type of ["keydown", "click"]) window.addEventListener(type, event => {
    const { key, shiftKey: shift, ctrlKey: ctrl, repeat, target } = event;
    const inside = window !== top;
    const on = nameOf(inside ? null : type === "click" ? target : document.activeElement);
    top.walk.seen.push({ type, key, shift, ctrl, repeat, inside, on, ...top.walk.look() });
  }, true);
  new MutationObserver(records => {
    for (const { addedNodes } of records) for (const node of addedNodes) {
      if (!node.classList?.contains("notice")) continue;
      window.walk.texts.push(node.textContent);
    }
  }).observe(document, { childList: true, subtree: true });
  window.print = () => ["beforeprint", "afterprint"].forEach(n => dispatchEvent(new Event(n)));
})()"""
"""What an eye sees at the moment of every key and click, before the page acts on it."""
CONTROLS = """() => [...document.querySelectorAll("button, a, select, input, textarea, summary, "
    + ".row, .chip, .mark, tr, .split, [data-column], .pane")].filter(e => !e.disabled)
  .map(e => [e, e.getBoundingClientRect()]).map(([e, box]) => [e, box.x + box.width / 2,
    box.y + box.height / 2])
  .filter(([e, x, y]) => e.contains(document.elementFromPoint(x, y)))
  .map(([e, x, y]) => [window.walk.nameOf(e), x, y])"""
"""What can be clicked: name and place."""

Names = frozenset[str]
VERDICTS = {"y": "accept", "n": "reject", "m": "dubious", "v": "invisible"}
OTHERS = {"JudgeTie", "JudgePhoto", "JudgeFiducial"}
WRITES: dict[str, Names] = {
    "accept": frozenset({"Accept", "Place", "ChoosePeak", *OTHERS}),
    "reject": frozenset({"Reject", *OTHERS}),
    "dubious": frozenset({"MarkDubious"}), "invisible": frozenset({"MarkNotVisible"}),
    "role": frozenset({"SetRole"}), "undo": frozenset({"Withdraw"}),
    "redo": frozenset({"Withdraw"}), "back": frozenset({"Withdraw"}),
    "reason": frozenset({"Withdraw", "Reject"}), "add": frozenset({"AddPoint"}),
    "use": frozenset({"JudgeFiducial"}), "put": frozenset({"PlaceFiducial"}),
    "fill": frozenset({"FillMarks"}),
}  # fmt: skip
"""Decisions that a meaning may leave in the file."""
STANDS = {"accept": "accept", "reject": "reject", "dubious": "dubious", "invisible": "reject"}
"""The button that is lit where a verdict stands."""
REFUSED = ("ahead", "yes-or-no", "still-drafts", "guest", "wire", "not-done", "overtaken")
ANSWERS = {
    "undo": ("nothing-to-undo",), "redo": ("nothing-to-redo",), "reason": ("no-reason",),
    "refine": ("refined", "not-refined"), "put": ("outside", "snapped", "not-snapped"),
    "fill": ("filled", "filled-anew", "not-filled"),
}  # fmt: skip
"""Notices that answer what was meant, in the file or not."""
LATE = frozenset({"add", "put", "fill"})
"""What is measured first, or waits for the hand to pause."""
LATE_S = 1.5
"""Within this time anything else is in the file."""
PRESSES, MOVES = {"Enter", " "}, {"Home", "End", "PageUp", "PageDown"}
ARROWS = {"ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"}
KEYS = (
    *"yyyynnnmvccuuuU12345jjjkkk", "Enter", "Enter", *ARROWS, "Shift+ArrowDown", "Shift+ArrowRight",
    *"fhrlpbigxotz.", " ", "+", "-", "Tab", "Tab", "Tab", "Shift+Tab", "Escape", "Escape", "Escape",
    "Home", "End", "w", "q",
)  # fmt: skip
QUICK = (*"yynnmvcuUjk12", "ArrowRight", "ArrowDown", "Escape", "Enter", "row", "row")
AWAY = frozenset({
    "settings-open", "act settings", "placing-start", "act placing.run", "act start.desk",
    "act start.place", "act start.link.this", "act start.open.this",
})  # fmt: skip
"""Leave the page or begin a run: tests of the start page go that way."""


class Wrong(Exception):
    """A walk went wrong, in words."""


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
    key, tag = seen["key"], seen["tag"]
    if tag in ("BUTTON", "SUMMARY", "A") and key in PRESSES:
        return None  # The press comes as a click.
    if tag in ("SELECT", "TEXTAREA") or (tag == "INPUT" and seen["kind"] not in _USES):
        return None
    if tag == "INPUT" and key in _USES[seen["kind"]]:
        return None
    if seen["dialog"] == "board":
        return _board_means(seen)
    if seen["dialog"] or seen["repeat"]:
        return None
    letter = key.lower() if len(key) == 1 else key
    if letter in VERDICTS:
        return _verdict(VERDICTS[letter], seen)
    if letter in "12345":
        return Meaning("reason", must=seen["asked"] == "why")
    if letter in ("c", "Enter"):
        return Meaning("role" if letter == "c" else "refine", seen["current"], seen["able"])
    return _undo(seen) if letter == "u" else None


_USES = {"range": ARROWS | MOVES, "checkbox": {" "}, "radio": {" ", *ARROWS}}


def _undo(seen: dict[str, Any]) -> Meaning:
    """What was done last is taken back first: a draft goes without a word."""
    return Meaning("redo" if seen["shift"] else "undo", must=seen["shift"] or not seen["drafts"])


def _verdict(what: str, seen: dict[str, Any]) -> Meaning:
    if seen["many"]:
        return Meaning(f"{what} all", must="auto" in seen["marked"])
    return Meaning(what, seen["current"], seen["able"] and bool(seen["current"]), seen["state"])


def _click_means(seen: dict[str, Any]) -> Meaning | None:
    on = seen["on"]
    kind, _, name = on.partition(" ")
    if on == "back":
        return Meaning("back", must=True)
    if on == "reason":
        return Meaning("reason", must=seen["asked"] == "why")
    if on == "magnified":
        return Meaning("put", seen["mark"], must=True)
    if kind == "board":
        return {
            "keep": Meaning("use", seen["mark"], True), "hide": Meaning("use", seen["mark"], True),
            "snap": Meaning("put", seen["mark"]), "undo": _undo(seen), "fill": Meaning("fill"),
        }.get(name)  # fmt: skip
    if on == "pane" and seen["adding"] and not seen["dialog"]:
        return Meaning("add")
    if kind != "act":
        return None
    if name in VERDICTS.values():
        return _verdict(name, seen)
    if name in ("role", "refine"):
        return Meaning(name, seen["current"], seen["able"])
    if name == "redo":
        return Meaning("redo", must=True)
    return _undo({**seen, "shift": False}) if name == "undo" else None


def _board_means(seen: dict[str, Any]) -> Meaning | None:
    key, mark = seen["key"], seen["mark"]
    letter = key.lower() if len(key) == 1 else key
    if not mark or (seen["repeat"] and key not in ARROWS):
        return None
    if letter in ("y", "v", "n"):
        return Meaning("use", mark, must=True)
    if letter in ("u", "l"):
        return _undo(seen) if letter == "u" else Meaning("fill")
    if letter == "Enter" or (key in ARROWS and not seen["onMark"]):
        return Meaning("put", mark)
    return None


SAID = {
    name: tuple(words(language)[f"notice.{name}"].partition("{")[0] for language in ("en", "cs"))
    for name in (*REFUSED, *(name for names in ANSWERS.values() for name in names))
}
"""How each of these notices begins."""


def is_about(decision: Decision, key: str) -> bool:
    """True when a decision is about a row or a mark of the board."""
    one, _, other = key.partition("|")
    point, photo = getattr(decision, "point_id", None), getattr(decision, "photo_id", None)
    if type(decision).__name__ == "SetRole":
        return point == one
    if point is not None:
        return (point, photo) == (one, other)
    return photo in (one, other)


@dataclass
class Monkey:
    """A seeded hand on one page."""

    page: Any
    rng: random.Random
    steps: list[str] = field(default_factory=list)
    keys: Sequence[str] = KEYS

    def step(self) -> str:
        """One gesture, written down; `drag` where no click is meant."""
        if self.page.query_selector("#naming[open]"):
            self.press("Escape")  # Another name has decisions of its own to undo.
            return "key"
        chosen = self.rng.choices(
            ("key", "click", "anywhere", "drag", "wheel", "resize", "choose", "hold"),
            (50, 20, 6, 6, 3, 2, 3, 2),
        )[0]
        getattr(self, chosen)()
        return chosen

    def write(self, what: str) -> None:
        self.steps.append(what)

    def key(self) -> None:
        self.press(self.rng.choice(self.keys))

    def press(self, key: str) -> None:
        key = "Shift+U" if key == "U" else key
        self.write(f"key {key}")
        self.page.keyboard.press(key)

    def hold(self) -> None:
        key = self.rng.choice("ynjku")
        self.write(f"hold {key}")
        for _ in range(3):
            self.page.keyboard.down(key)
        self.page.keyboard.up(key)

    def click(self) -> None:
        controls = [c for c in self.page.evaluate(CONTROLS) if c[0] not in AWAY]
        if not controls:
            return
        # Names first: two hundred rows are not two hundred times as tempting as one button.
        kinds = sorted({name.partition(" ")[0] for name, *_ in controls})
        kind = self.rng.choice(kinds)
        name, x, y = self.rng.choice([c for c in controls if c[0].partition(" ")[0] == kind])
        self.click_at(x, y, name)

    def click_at(self, x: float, y: float, name: str) -> None:
        held = self.rng.choices(("", "Control", "Shift"), (8, 1, 1))[0] if "row" in name else ""
        self.write(f"{held} click {name} at {x:.0f}, {y:.0f}".strip())
        if held:
            self.page.keyboard.down(held)
        self.page.mouse.click(x, y)
        if held:
            self.page.keyboard.up(held)

    def place(self) -> tuple[float, float]:
        size = self.page.viewport_size
        return self.rng.uniform(1, size["width"] - 2), self.rng.uniform(1, size["height"] - 2)

    def anywhere(self) -> None:
        x, y = self.place()
        name = self.page.evaluate(
            "([x, y]) => walk.nameOf(document.elementFromPoint(x, y))", [x, y]
        )
        if name not in AWAY:
            self.click_at(x, y, name)

    def drag(self) -> None:
        (x, y), (right, down) = self.place(), self.place()
        self.write(f"drag {x:.0f}, {y:.0f} to {right:.0f}, {down:.0f}")
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(right, down, steps=3)
        self.page.mouse.up()

    def wheel(self) -> None:
        x, y = self.place()
        by = self.rng.choice((-400, -100, 100, 400))
        self.write(f"wheel {by} at {x:.0f}, {y:.0f}")
        self.page.mouse.move(x, y)
        self.page.mouse.wheel(0, by)

    def resize(self) -> None:
        width, height = self.rng.choice(SIZES)
        self.write(f"resize {width} {height}")
        self.page.set_viewport_size({"width": width, "height": height})

    def choose(self) -> None:
        selects = [s for s in self.page.query_selector_all("select") if s.is_visible()]
        if not selects or self.page.query_selector("dialog[open]"):
            return
        select = self.rng.choice(selects)
        values = select.evaluate("e => [...e.options].map(option => option.value)")
        value = self.rng.choice(values)
        self.write(f"choose {value!r} of {select.get_attribute('id')}")
        select.select_option(value)


@dataclass
class Room:
    """One of the pages, open on a folder of its own."""

    kind: type["PageWalk"]
    url: str
    folder: Path
    session: Session | None = None
    rows: Any = None
    """The queue as it was before any decision."""


class PageWalk(Monkey):
    """A walk over a page where only saving writes."""

    ready = "body"
    keys = ("Tab", "Tab", "Enter", " ", "Escape", *ARROWS, *"sujkfw12.3xyn", "Delete", "Home")
    saves: Names = frozenset()
    writes: Names = frozenset()
    """Endings of the files that saving writes."""

    def begin(self, room: Room) -> None:
        self.room, self.files = room, files_of(room.folder)

    def walk(self, count: int) -> None:
        for _ in range(count):
            self.page.evaluate("walk.seen.length = 0")
            self.step()
            time.sleep(QUIET_S)
            seen = self.page.evaluate("walk.seen.splice(0)")
            meant = any(
                one["on"] in self.saves if one["type"] == "click" else one["key"] in self.saves
                for one in seen
            )
            self.look_at_files(meant)

    def look_at_files(self, meant: bool) -> None:
        files = files_of(self.room.folder)
        other = {name for name in {*files, *self.files} if files.get(name) != self.files.get(name)}
        if any(not meant or Path(name).suffix not in self.writes for name in other):
            raise Wrong(f"written without being meant: {sorted(other)}")
        self.files = files

    def tidy(self) -> None:
        """What the next walk needs; nothing where nothing is kept."""

    def end(self) -> None:
        self.page.set_viewport_size({"width": 1366, "height": 768})
        for _ in range(3):
            self.page.keyboard.press("Escape")
        self.expect("!document.querySelector('dialog[open]')", "no way out of a sheet")
        self.expect("document.documentElement.scrollWidth <= innerWidth", "wider than the window")

    def expect(self, condition: str, otherwise: str, **names: str) -> None:
        """Wait until something is so, in words if it does not come."""
        inner = f"({', '.join(names)}) => ({condition})"
        try:
            self.page.wait_for_function(
                f"args => ({inner})(...args)", arg=list(names.values()), timeout=1000 * PATIENCE_S
            )
        except TooLong as error:
            raise Wrong(otherwise) from error


class StartWalk(PageWalk):
    """Over the start page of a folder with scans."""

    ready = ".thumb"
    saves = frozenset({"act start.save"})
    writes = frozenset({".toml"})

    def end(self) -> None:
        super().end()
        for tab in ("run", "map", "film"):
            self.page.click(f'[data-tab="{tab}"]')
            self.expect(f"document.getElementById('{tab}').checkVisibility()", f"no {tab}")


class PlacingWalk(PageWalk):
    """Over the placing page."""

    ready = "#placing-scans button"
    saves = frozenset({"s", "placing-save"})
    writes = frozenset({".points"})

    def end(self) -> None:
        super().end()
        self.page.click("#placing-scans button >> nth=1")
        self.expect("document.querySelector('#placing-scans button:nth-child(2).on')",
                    "a scan is clicked and not shown")  # fmt: skip


class ReportWalk(PageWalk):
    """Over the report, opened as a file."""

    ready = "table"


def files_of(folder: Path) -> dict[str, tuple[int, int]]:
    """Files of a folder with size and time, but for what can be made again."""
    return {
        f"{path.relative_to(folder)}": (path.stat().st_size, path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and ".gruber" not in path.parts
    }


class DeskWalk(PageWalk):
    """A walk at the desk: the session file is read after every gesture."""

    ready = ".row.current"
    keys = KEYS

    def begin(self, room: Room) -> None:
        assert room.session is not None
        self.room, self.session = room, room.session
        self.known = len(self.session.decisions())
        self.owed: list[Meaning] = []
        self.nudged_at = 0.0
        self.page.wait_for_function("gruber.parts.status && !gruber.parts.status.adjusting")
        rows = self.page.evaluate(ROWS)
        room.rows = room.rows or rows
        if rows != room.rows:
            raise Wrong("the block is not as it was before the walk")

    def walk(self, count: int) -> None:
        for _ in range(count):
            told = self.page.evaluate("walk.seen.length = 0, walk.texts.length")
            if self.rng.random() < 0.15:
                self.look_at_file(self.hurry(), told)
                continue
            made = self.step()
            seen = self.page.evaluate("walk.seen.splice(0)")
            if made == "drag":
                seen = [one for one in seen if one["on"] not in ("pane", "magnified")]
            self.look_at_file(self.meant(seen), told)

    def meant(self, seen: Sequence[dict[str, Any]]) -> list[Meaning]:
        """What gestures mean; after an arrow a nudge may wait, which undo takes back first."""
        found: list[Meaning] = []
        for one in seen:
            meaning = meaning_of(one)
            if meaning and meaning.what == "undo" and time.monotonic() - self.nudged_at < 1:
                meaning = replace(meaning, must=False)
            if one["key"] in ARROWS or one["on"] == "pane":
                self.nudged_at = time.monotonic()
            found += [meaning] if meaning else []
        return found

    def hurry(self) -> list[Meaning]:
        """Several keys and rows before the desk can answer the first."""
        if self.page.query_selector("dialog[open]"):
            return []
        self.page.evaluate("document.activeElement?.blur?.()")
        meant: list[Meaning] = []
        aim, ahead = None, False
        for what in self.rng.choices(QUICK, k=self.rng.randint(2, 4)):
            if what == "row":
                rows = [c for c in self.page.evaluate(CONTROLS) if c[0].startswith("row ")]
                if rows:
                    name, x, y = self.rng.choice(rows)
                    self.write(f"at once: click {name} at {x:.0f}, {y:.0f}")
                    self.page.mouse.click(x, y)
                    aim, ahead = name.removeprefix("row "), True
                continue
            self.press(what)
            seen = self.page.evaluate("walk.seen.splice(0)")
            meaning = next(iter(self.meant(seen[-1:])), None)
            if meaning and ahead:
                sure = aim is not None and not meaning.what.endswith(" all")
                meaning = replace(meaning, key=aim or "", must=meaning.must and sure, state="")
            meant += [meaning] if meaning else []
            if what not in ("1", "2", "ArrowRight", "ArrowDown", "Escape", "Enter", "c"):
                aim, ahead = None, True
        return meant

    def look_at_file(self, meant: Sequence[Meaning], told: int) -> None:
        """Wait until everything that had to be is in the file or answered; nothing else may be."""
        now = time.monotonic()
        self.owed = [one for one in self.owed if one.what in LATE or now - one.at < LATE_S]
        self.owed += meant
        waiting, fresh = [meaning for meaning in meant if meaning.must], []
        while True:
            time.sleep(QUIET_S)
            fresh += self.fresh()
            eye = self.page.evaluate(
                "told => ({ ...walk.look(), texts: walk.texts.slice(told) })", told
            )
            # What stood there before may be shown a moment longer: first the file has time.
            sure = time.monotonic() - now > LATE_S
            waiting = [
                one
                for one in waiting
                if not (self.is_done(one, fresh, eye) or (sure and self.stands(one, eye)))
            ]
            if not waiting:
                return
            if time.monotonic() - now > PATIENCE_S:
                raise Wrong(f"dropped without a word: {waiting}")

    def fresh(self) -> list[Decision]:
        """What is new in the file; it is wrong when nothing that was done means it."""
        recorded = self.session.decisions()
        new = [item.decision for item in recorded[self.known :]]
        self.known = len(recorded)
        for decision in new:
            cause = next((one for one in self.owed if self.allows(one, decision)), None)
            if cause is None:
                raise Wrong(f"decided without being meant: {decision}, owed {self.owed}")
            if cause.what in STANDS:
                self.owed.remove(cause)
        return new

    def allows(self, meaning: Meaning, decision: Decision) -> bool:
        what = meaning.what.removesuffix(" all")
        if type(decision).__name__ not in WRITES.get(what, frozenset()):
            return False
        return not meaning.key or isinstance(decision, Withdraw) or is_about(decision, meaning.key)

    def is_done(self, meaning: Meaning, fresh: Sequence[Decision], eye: dict[str, Any]) -> bool:
        """True when it is in the file, or a notice answers it."""
        what = meaning.what.removesuffix(" all")
        if any(self.allows(meaning, decision) for decision in fresh):
            return True
        names = (*REFUSED, *ANSWERS.get(what, ()))
        return any(text.startswith(SAID[name]) for text in eye["texts"] for name in names)

    def stands(self, meaning: Meaning, eye: dict[str, Any]) -> bool:
        """True when it was so already, or is asked about."""
        what = meaning.what.removesuffix(" all")
        if eye["asked"] == "against" or meaning.state == STANDS.get(what, "no verdict"):
            return True
        about = [
            item.decision
            for item in standing(self.session.decisions())
            if not isinstance(item.decision, Withdraw) and is_about(item.decision, meaning.key)
        ]
        return what in STANDS and any(type(one).__name__ in WRITES[what] for one in about[-1:])

    def end(self) -> None:
        """No dead end: a few known gestures lead to a usable desk, and undo to the block before."""
        page = self.page
        page.set_viewport_size(dict(zip(("width", "height"), self.rng.choice(LARGE), strict=True)))
        for _ in range(4):
            page.keyboard.press("Escape")
        self.expect("!document.querySelector('dialog[open]')", "no way out of a sheet")
        if page.query_selector("#desk[data-grown]"):
            page.click('[data-grow][aria-pressed="true"]')
        page.click('.chip[data-state="all"]')
        for select in ("sieve-photo", "sieve-role"):
            page.select_option(f"#{select}", "")
        self.expect("document.querySelector('.row')?.checkVisibility()", "no queue in sight")
        page.click(".row >> nth=1")
        self.expect("document.querySelectorAll('.row')[1].classList.contains('current')",
                    "a row is clicked and not shown")  # fmt: skip
        self.expect("document.querySelector('#lost').hidden", "the desk is lost")
        time.sleep(0.5)  # A nudge may still wait for the hand to pause.
        self.fresh()
        self.undo_all()
        self.expect(f"!gruber.parts.status.adjusting && JSON.stringify({ROWS}) === rows",
                    "undone to the beginning, the block is another", rows=json.dumps(self.room.rows,
                    ensure_ascii=False, separators=(",", ":")))  # fmt: skip
        if page.locator("#details").is_visible():
            page.keyboard.press(".")
        try:
            self.expect(f"!({CUT_OFF})().length", "cut off")
        except Wrong as error:
            raise Wrong(f"cut off: {page.viewport_size}, {page.evaluate(CUT_OFF)}") from error

    def tidy(self) -> None:
        """The next walk begins with the block as it was."""
        self.page.reload()
        self.page.wait_for_selector(self.ready)
        self.known = len(self.session.decisions())
        self.undo_all()

    def undo_all(self) -> None:
        """Press U until nothing stands; a draft goes first, and without a word."""
        for _ in range(400):
            self.owed = [Meaning("undo")]
            mine = [item for item in standing(self.session.decisions()) if item.who == OPERATOR]
            if all(isinstance(item.decision, Withdraw) for item in mine):
                return
            drafts = self.page.evaluate("walk.look().drafts")
            self.page.keyboard.press("u")
            begun = time.monotonic()
            while not self.fresh() and self.page.evaluate("walk.look().drafts") == drafts:
                if time.monotonic() - begun > PATIENCE_S:
                    raise Wrong("undo does not come to an end")
                time.sleep(QUIET_S)
        raise Wrong("undo does not come to an end")


ROWS = "gruber.parts.rows.map(row => row.slice(0, 5)).sort()"
"""What the queue says of every measurement: point, photo, role, state, by hand."""


def remake(photo_ids: tuple[str, ...], progress: Progress, report: object) -> None:
    """In the place of orthos, which take a minute of every walk."""
    for step in range(3):
        progress.report(step, 3, photo_ids[0] if photo_ids else "")
        time.sleep(0.1)


@contextmanager
def open_rooms(block: Path, folder: Path) -> Generator[list[Room]]:
    """Every page, each on a copy of a block that was run."""
    desk, start, placing = (folder / name for name in ("desk", "start", "placing"))
    for copy in (desk, placing):
        shutil.copytree(block, copy)
    for part in ("scans", "ortho"):
        shutil.copytree(block / part, start / part)
    with ExitStack() as stack:
        project = read_project(desk)
        session = stack.enter_context(Session.open(desk, OPERATOR))
        inputs = desk_inputs(project, session, OPERATOR, "127.0.0.1", 0)
        opened = stack.enter_context(open_desk(replace(inputs, remake=remake)))
        reader = stack.enter_context(Session.open(desk, "reader"))
        started = stack.enter_context(open_start(start, "127.0.0.1", 0))
        project = read_project(placing)
        given = described(project)
        with Session.open(placing, OPERATOR) as placed:
            scans: Any = placed.products.latest_value("scans")
            archive: Any = placed.products.latest_value("georeference")
        found = Placeable(given, scans, open_reference(given.reference), archive.block)
        page = stack.enter_context(open_placing(project, found, "127.0.0.1", 0))
        report = (desk / "results" / "report.html").as_uri()
        yield [
            Room(DeskWalk, opened.url, desk, reader), Room(StartWalk, started.url, start),
            Room(PlacingWalk, page.url, placing), Room(ReportWalk, report, desk / "results"),
        ]  # fmt: skip


GONE = ("net::ERR_ABORTED",)
"""What was asked for by a page that is no longer there."""


class Ear(logging.Handler):
    """Every error of the browser and of the server."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.heard: list[str] = []

    def __enter__(self) -> Self:
        logging.getLogger().addHandler(self)
        self.before = threading.excepthook
        threading.excepthook = lambda died: self.heard.append(repr(died.exc_value))
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger().removeHandler(self)
        threading.excepthook = self.before

    def emit(self, record: logging.LogRecord) -> None:
        self.heard.append(self.format(record))

    def listen(self, page: Any) -> None:
        note = self.note
        page.on("pageerror", lambda error: note(f"script: {error}"))
        page.on("console", lambda said: note(f"console: {said.text}", said.type == "error"))
        page.on("requestfailed", lambda one: note(f"failed: {one.url}", one.failure not in GONE))
        page.on("response", lambda one: note(f"{one.status}: {one.url}", one.status >= 400))
        page.on("filechooser", lambda _: None)

    def note(self, text: str, grave: bool = True) -> None:
        if grave:
            self.heard.append(text)


def walk_once(browser: Any, rooms: Sequence[Room], seed: int, steps: int, ear: Ear) -> list[str]:
    """One walk; what went wrong and the steps to it, nothing where all was well."""
    rng = random.Random(seed)
    room = rng.choices(rooms, (14, 2, 3, 1))[0]
    language, theme = rng.choice(("en-GB", "cs-CZ")), rng.choice(("dark", "light"))
    new = rng.random() < 0.15
    storage = None if new or room.url.startswith("file:") else toured(room.url)
    width, height = rng.choice(LARGE)
    context = browser.new_context(
        locale=language, bypass_csp=True, storage_state=storage,
        viewport={"width": width, "height": height},
    )  # fmt: skip
    context.set_default_timeout(1000 * PATIENCE_S)
    context.add_init_script(EYE)
    if not new:
        context.add_init_script(f"localStorage.setItem('gruber.theme', '{theme}')")
    without_viser(context)
    ear.heard.clear()
    page = context.new_page()
    ear.listen(page)
    walk = room.kind(page, rng, [f"{room.kind.__name__} {language} {theme}"])
    wrong: list[str] = []
    try:
        page.goto(room.url)
        page.wait_for_selector(room.kind.ready)
        walk.begin(room)
        walk.walk(steps)
        walk.end()
    except (Wrong, PageError) as error:
        wrong = [str(error)]
        walk.tidy()
    wrong += ear.heard
    context.close()
    return [*walk.steps, *(f"  WRONG {text}" for text in wrong)] if wrong else []


def made_block(folder: Path) -> Path:
    """The tiny block of the tests, run."""
    make_block(folder, SyntheticOptions("tiny"))
    with_check_points(open_tiny(folder))
    subprocess.run([sys.executable, "-m", "app", "run", str(folder)], cwd=REPOSITORY, check=True)
    return folder


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0-499", help="one seed, or the first and the last")
    parser.add_argument("--steps", type=int, default=30, help="gestures of each walk")
    parser.add_argument("--block", type=Path, help="a block that was run; made without one")
    asked = parser.parse_args()
    first, _, last = asked.seeds.partition("-")
    seeds, failed, begun = range(int(first), int(last or first) + 1), 0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright, Ear() as ear:
        block = asked.block or made_block(Path(folder) / "made")
        path = chromium_path(playwright)
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        with open_rooms(block, Path(folder)) as rooms:
            for seed in seeds:
                wrong = walk_once(browser, rooms, seed, asked.steps, ear)
                failed += bool(wrong)
                if wrong:
                    say("\n  ".join([f"seed {seed}:", *wrong]))
        browser.close()
    took = f"{time.monotonic() - begun:.0f} s"
    say(f"{len(seeds)} walks of {asked.steps} steps in {took}, {failed} went wrong")
    return min(failed, 1)


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
