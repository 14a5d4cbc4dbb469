"""Marks that nobody knew, found in Chromium: one shown, the others looked at, undone."""

from typing import Any

import numpy as np
import pytest

from app.desk.inputs import desk_inputs
from app.desk.wiring import open_desk
from app.project import read_project
from sessions.decisions import FillMarks, JudgeFiducial, PlaceFiducial
from sessions.session import Session
from tests.browser.hands import caught_up, drawn
from tests.ui.unmarked import without_marks
from ui.web.access import Door

CELLS = "gruber.boardState().found.photos.flatMap(row => row.cells.map(cell => cell.state))"


@pytest.fixture
def unmarked(run_folder: Any):
    """A desk on a block of whose camera nobody knows the marks; and where its marks were found."""
    project = read_project(run_folder)
    with Session.open(project.folder, "anna") as session:
        inputs = desk_inputs(project, session, "anna", Door())
        with open_desk(without_marks(inputs)) as desk:
            yield desk, session, inputs.initial.films


def point_at(page: Any, place: Any):
    """Click a place of the scan that is shown as a whole, come nearer, and click again."""
    pane = page.locator("#mark-room .magnified")
    box = pane.bounding_box()
    photo, _ = page.evaluate("gruber.boardState().current")
    size = page.evaluate(
        "name => gruber.boardState().found.photos.find(row => row.photo === name).size", photo
    )
    scale = min(box["width"] / size[0], box["height"] / size[1])
    off = (np.array(place) - np.array(size) / 2) * scale
    middle = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    page.mouse.click(*(middle + off).tolist())
    page.wait_for_selector('[data-board="fill"]:not([disabled])')
    rough = page.evaluate("name => gruber.boardState().pointed[name]", photo)
    assert np.hypot(*np.subtract(rough, place)) < 2 / scale
    page.keyboard.press("f")
    drawn(page)
    window = page.evaluate("gruber.boardState().found.photos[0].window")
    scale = box["width"] / (1.6 * window)
    page.mouse.click(*(middle + np.subtract(place, rough) * scale).tolist())
    page.wait_for_function(
        "([name, rough]) => String(gruber.boardState().pointed[name]) !== String(rough)",
        arg=[photo, rough],
    )
    near = page.evaluate("name => gruber.boardState().pointed[name]", photo)
    assert np.hypot(*np.subtract(near, place)) < 0.3


def current_mark(page: Any):
    return "|".join(page.evaluate("gruber.boardState().current"))


def worst_first(page: Any):
    """True when the desk shows the most doubtful mark, and it is a doubt."""
    doubts = dict(
        page.evaluate(
            "gruber.boardState().found.photos.flatMap(row => row.cells.map(cell =>"
            " [`${row.photo}|${cell.name}`, cell.doubt]))"
        )
    )
    return doubts[current_mark(page)] == max(doubts.values()) >= 0.5


def place_beside(page: Any) -> None:
    """Place the mark that is shown a little beside, keep it, and be at the next."""
    current = current_mark(page)
    box = page.locator("#mark-room .magnified").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2 + 5, box["y"] + box["height"] / 2 + 3)
    page.wait_for_selector("#board-draft")
    caught_up(page)
    if page.locator("#board-draft.against").count():
        page.keyboard.press("y")
        caught_up(page)
    page.keyboard.press("y")
    page.wait_for_selector(f'#board .mark.placed[data-mark="{current}"]')
    # Only then is the next one shown.
    caught_up(page)


def test_one_mark_is_shown_and_the_others_are_found_corrected_and_undone__truth(
    unmarked: Any, sit_at: Any
):
    desk, session, films = unmarked
    page = sit_at(desk.url, scene=False)
    page.keyboard.press("i")
    page.wait_for_selector("#board .mark.point")
    assert page.evaluate(CELLS) == []
    name = sorted(films)[1]
    page.click(f'#board .mark[data-mark="{name}|"]')
    shown = next(mark for mark in films[name].fiducials if mark.name == "1")
    point_at(page, shown.place)
    page.keyboard.press("l")
    page.wait_for_selector(".notice:has-text('24 marks in 6 of 6 scans')")
    page.wait_for_selector("#board .mark.filled.on")
    assert page.evaluate(CELLS) == ["filled"] * 24
    decision = session.decisions()[-1].decision
    assert isinstance(decision, FillMarks)
    for photo, film in films.items():
        true = sorted(mark.place for mark in film.fiducials)
        found = sorted(mark.place for mark in decision.found[photo])
        assert np.hypot(*(np.array(found) - np.array(true)).T).max() < 0.1
    assert worst_first(page)
    page.wait_for_function("!gruber.parts.status.adjusting")
    first = current_mark(page)
    page.keyboard.press("y")
    page.wait_for_selector(f'#board .mark.used[data-mark="{first}"]')
    for _ in range(2):
        place_beside(page)
    kinds = [type(item.decision) for item in session.decisions()][-4:]
    assert kinds == [FillMarks, JudgeFiducial, PlaceFiducial, PlaceFiducial]
    # All at once, whatever was said of single marks since.
    page.locator("#board .mark.filled").first.click()
    page.click("#mark-room .decided button")
    page.wait_for_function(f"{CELLS}.length === 0")
    page.keyboard.press("Shift+U")
    page.wait_for_function(f"{CELLS}.length === 24")
