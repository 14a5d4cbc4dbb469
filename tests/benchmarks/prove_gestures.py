"""Every gesture by key and by pointer, on 24 scans and 1,500 proposals.

Run: python -m tests.benchmarks.prove_gestures

Each gesture is made in a real Chromium. Of those that decide, the session is opened from disk by
another reader: what is new there must be as the gesture means it, about the point that was shown.
Of those that only look, the page must show something else, and nothing may be on disk.
"""

import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from playwright.sync_api import Error as PlaywrightError
from playwright.sync_api import Page

from sessions.decisions import Recorded
from sessions.session import Session
from tests.benchmarks.desk_browser import browser, served, sit_down
from tests.benchmarks.gestures import BOARD, BOARD_LOOKING, DECISIONS, LOOKING, Decides, Looks
from tests.benchmarks.large_desk import say
from tests.browser.conftest import scene_of

PATIENCE_TICKS, TICK_MS, SETTLE_MS = 100, 100, 1500


def recorded(folder: Path) -> tuple[Recorded, ...]:
    """What is on disk, as another reader finds it."""
    with Session.open(folder, "reader") as session:
        return session.decisions()


def decided(page: Page, folder: Path, gesture: Decides) -> list[Recorded]:
    """Make a gesture; what is on disk after it that was not there before."""
    before, fresh = len(recorded(folder)), []
    gesture.hand(page)
    for _ in range(PATIENCE_TICKS):
        page.wait_for_timeout(TICK_MS)
        fresh = list(recorded(folder)[before:])
        if len(fresh) >= len(gesture.kinds):
            # The page has to hear of it too: a hand ahead of the picture judges nothing twice.
            page.wait_for_timeout(SETTLE_MS)
            break
    return list(recorded(folder)[before:])


def stands(page: Page, folder: Path, gesture: Decides, on_board: bool) -> bool:
    """One gesture that decides, and its line."""
    shown = "gruber.boardState().current" if on_board else "gruber.parts.point.key"
    before = page.evaluate(shown)
    with suppress(PlaywrightError):
        page.wait_for_selector(".notice", state="detached", timeout=8000)
    fresh = decided(page, folder, gesture)
    aimed = {*before, *(page.evaluate(shown) or []), *(page.evaluate("window.aimed") or [])}
    found = tuple(type(item.decision).__name__ for item in fresh)
    about = {
        getattr(item.decision, "photo_id" if on_board else "point_id", before[0]) for item in fresh
    }
    # A new point has a name of its own; several decided at once are several points.
    free = "AddPoint" in found or (len(found) > 1 and not gesture.reason)
    good = found == gesture.kinds and (free or about <= aimed)
    if gesture.reason:
        good = good and getattr(fresh[-1].decision, "reason", "") == gesture.reason
    told = "on disk" if good else f"BROKEN: {found} {about}"
    say(f"{gesture.name:28} {gesture.kinds[-1]:16} {told}")
    return good


def seen(page: Page, folder: Path, gesture: Looks) -> bool:
    """One gesture that only looks, and its line."""
    saved, before = len(recorded(folder)), page.evaluate(gesture.probe)
    gesture.hand(page)
    now = before
    for _ in range(PATIENCE_TICKS):
        page.wait_for_timeout(TICK_MS)
        now = page.evaluate(gesture.probe)
        if now != before:
            break
    changed, quiet = now != before, len(recorded(folder)) == saved
    good = changed and quiet
    why = "seen" if good else "BROKEN: " + ("something was recorded" if changed else f"still {now}")
    say(f"{gesture.name:28} {'':16} {why}")
    return good


def main() -> int:
    """A line for each gesture; 1 when one of them is not as it was meant."""
    results: list[bool] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "desk"
        with served(folder, "--film") as (url, _), browser() as chromium:
            page = sit_down(chromium, url)
            page.set_default_timeout(150_000)
            scene_of(page)
            page.wait_for_timeout(4000)
            results += [stands(page, folder, one, on_board=False) for one in DECISIONS]
            page.wait_for_function("!gruber.parts.status.adjusting")
            results += [seen(page, folder, one) for one in (*LOOKING, *BOARD_LOOKING)]
            page.wait_for_selector("#board .mark.on")
            results += [stands(page, folder, one, on_board=True) for one in BOARD]
    say(f"{len(results)} gestures on 24 scans, {results.count(False)} broken")
    return 1 if False in results else 0


if __name__ == "__main__":
    sys.exit(main())
