"""Nadir, isocentre, principal point in scan and scene, and corrections at the cursor."""

from itertools import pairwise

import numpy as np
import pytest

from tests.browser.conftest import scene_of
from tests.browser.hands import caught_up, grow, until
from tests.ui.desk_block import tiny_block, tiny_snapshot
from ui.review.compare import DrawnPhoto
from ui.review.photo_points import corrections_part, special_part

CELLS = "[...document.querySelectorAll('#corrections td')].map(e => e.textContent)"
ASKED = "performance.getEntriesByType('resource').filter(e => e.name.includes('/corrections/'))"
SWITCH = "#tools [data-layer=specials]"


def drawn(page) -> DrawnPhoto:
    return tiny_snapshot().drawn[page.evaluate("gruber.parts.point.key[1]")]


def switch_on(page):
    page.click(SWITCH)
    page.wait_for_function("gruber.parts.scene.layers.specials")
    caught_up(page)


def pane_middle(page) -> tuple[float, float]:
    box = page.locator("[data-pane=right]").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def told(page) -> list[list[float]]:
    """The numbers of the table, row by row."""
    cells = [text.replace("\u2212", "-") for text in page.evaluate(CELLS)]
    return [[float(text) for text in cells[at + 1 : at + 4]] for at in range(0, len(cells), 4)]


@pytest.mark.parametrize("raw", [False, True])
def test_the_table_at_the_cursor_tells_what_the_engine_computes__law(sit, raw):
    page = sit(scene=False)
    page.click("[data-act=fit]")
    if raw:
        page.keyboard.press("r")
    across, down = pane_middle(page)
    page.mouse.move(across, down)
    assert not page.locator("#corrections").is_visible()
    switch_on(page)
    for off in (20, -40):
        with page.expect_response("**/tiles/corrections/**") as answered:
            page.mouse.move(across + off, down + off)
        page.wait_for_selector("#corrections tr[data-effect=together]")
        assert answered.value.ok

        def tells_of_the_newest() -> bool:
            # Which may have been asked for after the first answer.
            *_, frame, east, north = page.evaluate(f"{ASKED}.at(-1).name").split("/")
            assert frame == ("scan" if raw else "ground")
            rows = corrections_part(
                drawn(page), tiny_block().land.dem, frame, np.array([[float(east), float(north)]])
            )
            shown = told(page)
            assert len(shown) == len(rows)
            return np.allclose(shown, [row[1:] for row in rows], rtol=0, atol=0.051)

        until(page, tells_of_the_newest)
    page.mouse.move(5, 5)
    page.wait_for_selector("#corrections", state="hidden")
    page.click(SWITCH)
    page.wait_for_function("!gruber.parts.scene.layers.specials")


def test_the_table_stays_within_its_pane_and_follows_without_a_queue__law(sit):
    """However fast the hand, one question is asked at a time, and the newest is answered soon."""
    page = sit(scene=False, size={"width": 1366, "height": 768})
    for _ in range(8):
        page.keyboard.press("+")
    switch_on(page)
    box = page.locator("[data-pane=right]").bounding_box()
    page.mouse.move(*pane_middle(page))
    page.wait_for_selector("#corrections tr[data-effect=together]")
    for step in range(120):
        page.mouse.move(box["x"] + 15 + step, box["y"] + 20 + step)
    rested = page.evaluate("performance.now()")
    # The table tells of where the hand came to rest.
    page.wait_for_function(f"performance.now() - {ASKED}.at(-1).responseEnd > 150")
    after = page.evaluate(f"{ASKED}.filter(e => e.startTime > {rested}).length")
    assert after <= 2, "what the hand has passed is not asked about"
    asked = page.evaluate(f"{ASKED}.map(e => [e.startTime, e.responseEnd])")
    assert len(asked) > 1
    assert all(later[0] >= earlier[1] for earlier, later in pairwise(asked))
    right, low = box["width"] - 6, box["height"] - 6

    def lies_within() -> bool:
        table = page.locator("#corrections").bounding_box()
        return all(
            box[at] - 1 <= table[at] <= box[at] + box[size] - table[size] + 1
            for at, size in (("x", "width"), ("y", "height"))
        )

    for x, y in ((6, 6), (right, 6), (6, low), (right, low)):
        page.mouse.move(box["x"] + x, box["y"] + y)
        page.wait_for_timeout(150)
        until(page, lies_within)


def test_the_points_are_told_to_the_page_and_drawn_in_the_scan__truth(sit):
    page = sit(scene=False)
    shown = page.evaluate("gruber.parts.point.specials")
    expected = special_part(drawn(page), tiny_block().land.dem)
    for (letter, raw, ground), (name, *places) in zip(shown, expected, strict=True):
        assert letter == name
        assert [*raw, *ground] == pytest.approx([*places[0], *places[1]], abs=0.011)
    for _ in range(14):
        page.keyboard.press("-")
    page.wait_for_function("gruber.compareState().drawn.whole")
    marks = "document.querySelector('[data-pane=right] .marks').toDataURL()"
    plain = page.evaluate(marks)
    switch_on(page)
    page.wait_for_function(f"plain => {marks} !== plain", arg=plain)


def test_plumb_line_and_letters_stand_in_the_scene_with_a_legend__truth(sit):
    page = sit()
    scene = scene_of(page)
    grow(page, "block")
    page.click("#layers [data-layer=specials]")
    scene.wait_for_function(
        "Object.keys(__viserMutable.nodeRefFromName).some(n => n.startsWith('/specials/'))"
    )
    page.wait_for_selector("#scene-legend:has-text('isocentre'):has-text('nadir')")
    assert "fiducial" not in page.inner_text("#scene-legend")
