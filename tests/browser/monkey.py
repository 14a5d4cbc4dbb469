"""Seeded hands on every page, which know what their gestures mean and read the session file.

Nothing is asked of the desk: what a gesture may write follows from where the focus was and what an
eye sees.
"""

import json
import random
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from playwright.sync_api import TimeoutError as TooLong

from sessions.decisions import AddPoint, Decision, SignBlock, Withdraw, standing
from sessions.session import Session
from tests.browser.conftest import PATIENCE_MS
from tests.browser.meaning import (
    ANSWERS,
    ARROWS,
    LATE,
    REFUSED,
    SAID,
    STANDS,
    WRITES,
    Meaning,
    Names,
    drafts_nothing,
    is_about,
    meaning_of,
)
from tests.browser.test_desk_layout import CUT_OFF

LARGE = ((1366, 768), (1600, 1000), (1920, 1080))
SIZES = (*LARGE, (1024, 700), (800, 600))
OPERATOR = "monkey"
PATIENCE_S = PATIENCE_MS / 1000
QUIET_S = 0.03
CONTROLS = """() => [...document.querySelectorAll("button, a, select, input, textarea, summary, "
    + ".row, .chip, .mark, tr, .split, [data-column], .pane")].filter(e => !e.disabled)
  .map(e => [e, e.getBoundingClientRect()]).map(([e, box]) => [e, box.x + box.width / 2,
    box.y + box.height / 2])
  .filter(([e, x, y]) => e.contains(document.elementFromPoint(x, y)))
  .map(([e, x, y]) => [window.walk.nameOf(e), x, y])"""
"""What can be clicked: name and place."""

FAR = 20
"""Long steps that lead further off than three sigma."""
PAUSE_S = 0.6
"""After it a nudge has become a draft."""
DRAFTING_S = 3.0
"""Within this time a draft that was asked for is there."""
LATE_S = 1.5
"""Within this time anything else is in the file."""
KEYS = (
    *"yyyynnnmvccuuuU12345jjjkkk", "Enter", "Enter", *ARROWS, "Shift+ArrowDown", "Shift+ArrowRight",
    *"fhrlpbigxotz.", "Shift+O", "Shift+B", "Shift+I", "Shift+G",
    " ", "+", "-", "Tab", "Tab", "Tab", "Shift+Tab", "Escape", "Escape", "Escape",
    "Home", "End", "w", "q",
)  # fmt: skip
QUICK = (*"yynnmvcuUjk12", "ArrowRight", "ArrowDown", "Escape", "Enter", "row", "row")
AWAY = frozenset({
    "language", "settings-open", "act settings", "placing-start", "act placing.run",
    "act start.desk", "act start.place", "act start.link.this", "act start.open.this",
})  # fmt: skip
"""Leave the page or begin a run: tests of the start page go that way."""


class Wrong(Exception):
    """A walk went wrong, in words."""


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
            ("key", "click", "anywhere", "drag", "wheel", "resize", "choose", "hold", "twice"),
            (50, 20, 6, 6, 3, 2, 3, 2, 4),
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

    def twice(self, key: str = "") -> None:
        """One key two times in one breath."""
        key = key or self.rng.choice(self.keys)
        self.press(key)
        self.press(key)

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
        name = select.get_attribute("id")
        values = select.evaluate("e => [...e.options].map(option => option.value)")
        value = self.rng.choice(values)
        self.write(f"choose {value!r} of {name}")
        # By its name: the form may be drawn anew meanwhile.
        self.page.select_option(f'[id="{name}"]', value)


@dataclass
class Room:
    """One of the pages, open on a folder of its own."""

    kind: type["PageWalk"]
    url: str
    folder: Path
    session: Session | None = None
    rows: Any = None
    """The queue as it was before any decision."""
    freed: Sequence[bool] = ()
    """What the adjustment estimated then."""


class PageWalk(Monkey):
    """A walk over a page where only saving writes."""

    ready = "body"
    keys = ("Tab", "Tab", "Enter", " ", "Escape", *ARROWS, *"sujkfw12.3xyn", "Delete", "Home")
    saves: Names = frozenset()
    writes: Names = frozenset()
    """Endings of the files that saving writes."""

    def begin(self, room: Room) -> None:
        self.room, self.files, self.owed = room, files_of(room.folder), False

    def walk(self, count: int) -> None:
        for _ in range(count):
            self.page.evaluate("walk.seen.length = 0")
            self.step()
            time.sleep(QUIET_S)
            seen = self.page.evaluate("walk.seen.splice(0)")
            # A busy machine writes what was asked for before while the next key is pressed.
            self.owed |= any(
                one["on"] in self.saves if one["type"] == "click" else one["key"] in self.saves
                for one in seen
            )
            self.look_at_files()

    def look_at_files(self) -> None:
        files = files_of(self.room.folder)
        other = {name for name in {*files, *self.files} if files.get(name) != self.files.get(name)}
        if any(not self.owed or Path(name).suffix not in self.writes for name in other):
            raise Wrong(f"written without being meant: {sorted(other)}")
        self.files, self.owed = files, self.owed and not other

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
        self.expect(
            "document.querySelector('#placing-scans button:nth-child(2).on')",
            "a scan is clicked and not shown",
        )


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
        self.drafted_at, self.decided_last = 0.0, False
        self.page.wait_for_function("gruber.parts.point && !gruber.parts.status.adjusting")
        rows = self.page.evaluate(ROWS)
        room.rows = room.rows or rows
        # A tour is left to the walk.
        if not room.freed and not self.page.query_selector("dialog[open]"):
            room.freed = self.free([])
        if rows != room.rows:
            raise Wrong("the block is not as it was before the walk")

    def walk(self, count: int) -> None:
        for _ in range(count):
            told = self.page.evaluate("walk.seen.length = 0, walk.texts.length")
            if self.rng.random() < 0.15:
                self.look_at_file(self.hurry(), told)
                continue
            # A hand that does not hurry looks at what it has before it.
            self.answered()
            if self.rng.random() < 0.03:
                self.keep_far() if self.rng.random() < 0.5 else self.go_on_from_draft()
                continue
            made = self.step()
            seen = self.page.evaluate("walk.seen.splice(0)")
            meant = self.meant(seen)
            if made == "drag":
                # With a brush a drag draws; elsewhere it is no click.
                brushed = self.page.query_selector("#mask[open]")
                meant = (
                    [Meaning("draw")]
                    if brushed
                    else self.meant(one for one in seen if one["on"] not in ("pane", "magnified"))
                )
            self.look_at_file(meant, told)

    def keep_far(self) -> None:
        """A place far off the block's, and two keys that would keep it."""
        told = self.page.evaluate("walk.texts.length")
        for _ in range(FAR):
            self.press("Shift+ArrowRight")
        time.sleep(PAUSE_S)
        self.answered()
        self.twice("y")
        self.look_at_file(self.meant(self.page.evaluate("walk.seen.splice(0)")), told)

    def go_on_from_draft(self) -> None:
        """A draft is left, another row is decided, and undo is pressed on the row of the draft."""
        for key in ("ArrowRight", "j", "n", "k", "u"):
            told = self.page.evaluate("walk.seen.length = 0, walk.texts.length")
            self.press(key)
            seen = self.page.evaluate("walk.seen.splice(0)")
            self.look_at_file(self.meant(seen), told)
            time.sleep(DRAFTING_S if key == "k" else PAUSE_S)
            self.answered()

    def twice(self, key: str = "") -> None:
        """What the first press asks the second one does not answer, unless it came much later."""
        asks = self.page.evaluate("walk.asks")
        super().twice(key)
        self.answered()
        if self.page.evaluate(HASTY, asks):
            raise Wrong("a question was answered before it could be read")

    def answered(self) -> None:
        begun = time.monotonic()
        self.expect("!gruber.isAhead()", "the desk does not answer")
        # What it was busy with was not late.
        waited = time.monotonic() - begun
        self.owed = [replace(one, at=one.at + waited) for one in self.owed]

    def meant(self, seen: Iterable[dict[str, Any]]) -> list[Meaning]:
        """What gestures mean; after an arrow a nudge may wait, which undo takes back first."""
        found: list[Meaning] = []
        for one in seen:
            meaning, now = meaning_of(one), time.monotonic()
            if meaning and meaning.what == "undo":
                sure = self.decided_last and now - self.drafted_at > DRAFTING_S
                loose = now - self.nudged_at < 1 or self.signed()
                meaning = replace(meaning, must=(meaning.must or sure) and not loose)
            if one["key"] in ARROWS or one["on"] == "pane":
                self.nudged_at = now
            if not drafts_nothing(one):
                self.drafted_at, self.decided_last = now, False
            found += [meaning] if meaning else []
        return found

    def hurry(self) -> list[Meaning]:
        """Several keys and rows before the desk can answer the first."""
        if self.page.query_selector("dialog[open]"):
            return []
        self.page.evaluate("document.activeElement?.blur?.()")
        meant: list[Meaning] = []
        stays = ("1", "2", "ArrowRight", "ArrowDown", "Escape", "Enter", "c")
        # The gesture before may not be answered yet.
        aim, ahead, drafted = None, self.page.evaluate("gruber.isAhead()"), False
        for what in self.rng.choices(QUICK, k=self.rng.randint(2, 4)):
            if what == "row":
                rows = [c for c in self.page.evaluate(CONTROLS) if c[0].startswith("row ")]
                if rows:
                    name, x, y = self.rng.choice(rows)
                    self.write(f"at once: click {name} at {x:.0f}, {y:.0f}")
                    self.page.mouse.click(x, y)
                    # The list may be in another order by now: what was hit counts.
                    hit = [s for s in self.page.evaluate("walk.seen") if s["type"] == "click"]
                    name = hit[-1]["on"] if hit else name
                    aim, ahead = name.removeprefix("row "), True
                continue
            self.press(what)
            seen = self.page.evaluate("walk.seen.splice(0)")
            drafted = drafted or what in (*ARROWS, "y") or any(one["drafts"] for one in seen)
            if drafted and what not in stays:
                # A draft that the desk asks about stays one where the hand has gone on.
                meant = [replace(one, must=one.must and one.what != "accept") for one in meant]
            meaning = next(iter(self.meant(seen[-1:])), None)
            # The reason is that of the rejection which is asked about, wherever the hand is.
            if meaning and ahead and meaning.what != "reason":
                sure = aim is not None and not meaning.what.endswith(" all")
                meaning = replace(meaning, key=aim or "", must=meaning.must and sure, state="")
            meant += [meaning] if meaning else []
            # In the queue an arrow goes to the next row, elsewhere it nudges.
            steps = what == "ArrowDown" and bool(seen) and seen[-1]["inQueue"]
            if steps or what not in stays:
                aim, ahead = None, True
        return meant

    def look_at_file(self, meant: Sequence[Meaning], told: int) -> None:
        """Wait until everything that had to be is in the file or answered; nothing else may be."""
        now = time.monotonic()
        if self.page.evaluate("gruber.isAhead()"):  # On a busy machine the hand outruns the desk.
            self.owed = [replace(one, at=now) for one in self.owed]
        self.owed += meant
        # What came since the last look may answer what was owed then.
        fresh = self.fresh()
        self.owed = [one for one in self.owed if one.what in LATE or now - one.at < LATE_S]
        waiting = [meaning for meaning in meant if meaning.must]
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
                self.decided_last = self.decided_last or bool(fresh)
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
            # A new point is kept with the place that was drafted for it.
            if cause.what in STANDS and not isinstance(decision, AddPoint):
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
        # Of a row that was left meanwhile the draft is all that is told.
        if what == "refine" and meaning.key in eye["draftRows"]:
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
        self.answered()
        for _ in range(4):
            page.keyboard.press("Escape")
        self.expect("!document.querySelector('dialog[open]')", "no way out of a sheet")
        if page.query_selector("#desk[data-grown]"):
            page.click('[data-grow][aria-pressed="true"]')
        page.click('.chip[data-state="all"]')
        page.fill("#sieve-text", "")
        if page.locator("#sieve-area").is_visible():
            page.click("#sieve-area")
        for select in ("sieve-photo", "sieve-role"):
            page.select_option(f"#{select}", "")
        self.expect("document.querySelector('.row')?.checkVisibility()", "no queue in sight")
        self.answered()
        # By its name: lines come and go where the list moves to what is current.
        row = json.dumps(page.locator(".row:not(.current)").first.get_attribute("data-key"))
        page.click(f".row[data-key={row}]")
        self.expect(
            f"document.querySelector('.row.current')?.dataset.key === {row}",
            "a row is clicked and not shown",
        )
        self.expect("document.querySelector('#lost').hidden", "the desk is lost")
        time.sleep(0.5)  # A nudge may still wait for the hand to pause.
        self.fresh()
        self.undo_all()
        self.free(self.room.freed)
        self.expect(
            f"!gruber.parts.status.adjusting && JSON.stringify({ROWS}) === rows",
            "undone to the beginning, the block is another",
            rows=json.dumps(self.room.rows, ensure_ascii=False, separators=(",", ":")),
        )
        if page.locator("#details").is_visible():
            page.keyboard.press(".")
        try:
            self.expect(f"!({CUT_OFF})().length", "cut off")
        except Wrong as error:
            raise Wrong(f"cut off: {page.viewport_size}, {page.evaluate(CUT_OFF)}") from error

    def tidy(self) -> None:
        """The next walk begins with the block as it was."""
        self.page.reload()
        self.page.wait_for_function("window.gruber?.parts.queue")
        self.page.click('.chip[data-state="all"]')
        self.known = len(self.session.decisions())
        self.undo_all()

    def free(self, wanted: Sequence[bool]) -> list[bool]:
        """What the adjustment estimates, which is no decision to undo; set as it is wanted."""
        self.page.keyboard.press("b")
        boxes = self.page.locator("#quality[open] [data-free]")
        boxes.last.wait_for()
        found = [box.is_checked() for box in boxes.all()]
        for box, known, want in zip(boxes.all(), found, wanted, strict=False):
            if known != want:
                box.click()
        self.page.keyboard.press("Escape")
        self.expect("!document.querySelector('dialog[open]')", "no way out of a sheet")
        return found

    def signed(self) -> bool:
        """Whether undo is about a signature, and so asked about first."""
        mine = [item for item in standing(self.session.decisions()) if item.who == OPERATOR]
        return bool(mine) and isinstance(mine[-1].decision, SignBlock)

    def undo_all(self) -> None:
        """Press U until nothing stands and nothing is drafted; a draft goes where it is shown."""
        for _ in range(400):
            self.owed = [Meaning("undo")]
            mine = [item for item in standing(self.session.decisions()) if item.who == OPERATOR]
            rows, drafts = self.page.evaluate(
                "(({ draftRows, drafts }) => [draftRows, drafts])(walk.look())"
            )
            if all(isinstance(item.decision, Withdraw) for item in mine):
                if not rows:
                    return
                self.page.click("#drafts")
            # It may lead to a question, which is not answered before it is read.
            self.answered()
            self.page.keyboard.press("u")
            begun = time.monotonic()
            asks = "document.querySelector('[data-answer=\"history.back\"]') !== null"
            while not self.fresh() and self.page.evaluate("walk.look().drafts") == drafts:
                if self.page.evaluate(asks):
                    break
                if time.monotonic() - begun > PATIENCE_S:
                    raise Wrong("undo does not come to an end")
                time.sleep(QUIET_S)
        raise Wrong("undo does not come to an end")


HASTY = """asks => walk.asks > asks && !walk.look().asks
  && (walk.seen.at(-1)?.at ?? 0) < walk.asked + 300"""
"""Whether a question that came meanwhile was answered sooner than anybody reads."""
ROWS = """(({ rows, queue }) => {
  const drafted = new Set(queue.drafts.map(index => rows[index][0]));
  return rows.map(row => row.slice(0, 5)).filter(([name, , role]) =>
    !drafted.has(name) || (role !== "new" && !/^H\\d+$/.test(name))).sort();
})(gruber.parts)"""
"""What the queue says of every measurement: point, photo, role, state, by hand.

Without points that are only drafted.
"""
