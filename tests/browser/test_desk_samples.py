"""Map sheets accepted by a sample in the browser: drawn, gone through, judged and signed."""

from collections.abc import Callable
from typing import Any, cast

import pytest
from shapely.geometry import box

from core.mosaic.composition import MosaicProduct
from core.sheets.delivery import Delivery, SheetFile
from sessions.checks import version_on_disk
from sessions.decisions import DrawSheets, JudgeSheet
from sessions.session import Session
from tests.browser.conftest import PATIENCE_MS, RealDesk
from tests.browser.hands import caught_up, settled
from tests.sessions.test_sheet_samples import cut as write_sheets

Sit = Callable[..., Any]
WHOLE = "() => gruber.mosaicState().drawn.whole"
ACROSS, DOWN = 4, 3


@pytest.fixture
def cut(run_folder: Any) -> None:
    """Twelve map sheets over the mosaic, cut before the desk is opened."""
    with Session.open(run_folder, "ada") as session:
        mosaic = cast("MosaicProduct", session.products.latest_value("mosaic"))
        west, south, east, north = mosaic.grid.bounds
        wide, high = (east - west) / ACROSS, (north - south) / DOWN
        files = [
            SheetFile(
                f"L{row}{column}",
                f"L{row}{column}.tif",
                "geotiff",
                "EPSG:5514",
                box(
                    west + column * wide,
                    north - (row + 1) * high,
                    west + (column + 1) * wide,
                    north - row * high,
                ),
                (),
                (),
                1.0,
                (1, 1),
                (),
                "",
                1,
                (),
            )
            for row in range(DOWN)
            for column in range(ACROSS)
        ]
        version = version_on_disk(session.products)
        write_sheets(session, Delivery(tuple(files), 0, mosaic=version))


def samples_of(desk: RealDesk, sit_at: Sit) -> Any:
    """A page that shows the samples of a desk."""
    page = sit_at(desk.desk.url, scene=False)
    settled(page)
    open_samples(page)
    return page


def open_samples(page: Any) -> None:
    page.keyboard.press("b")
    page.wait_for_selector("#quality[open] [data-part=samples]", timeout=PATIENCE_MS)
    caught_up(page)


def told(desk: RealDesk, kind: type) -> list[Any]:
    return [one.decision for one in desk.session.decisions() if isinstance(one.decision, kind)]


def sheet_state(page: Any, state: str) -> None:
    page.wait_for_selector(f"#sheet-state .sheet-{state}", timeout=PATIENCE_MS)
    caught_up(page)


def draw(page: Any, desk: RealDesk) -> DrawSheets:
    """Have a sample drawn by the button that has the focus."""
    page.focus("#samples-draw")
    page.keyboard.press("Enter")
    page.wait_for_selector("#samples-verdict.grave1", timeout=PATIENCE_MS)
    caught_up(page)
    (sample,) = told(desk, DrawSheets)
    return sample


def open_sheet(page: Any, name: str) -> None:
    page.click(f"[data-sheet={name}] button")
    shows_sheet(page, name)
    page.wait_for_function(WHOLE)


def shows_sheet(page: Any, name: str) -> None:
    page.wait_for_selector(f"#mosaic[open] #sheet-name:has-text('{name}')", timeout=PATIENCE_MS)


def test_a_drawn_sheet_fills_the_picture_of_the_mosaic__law(
    cut: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = samples_of(real_desk, sit_at)
    page.dblclick("#samples-draw")
    page.wait_for_selector("#samples-verdict.grave1", timeout=PATIENCE_MS)
    caught_up(page)
    (sample,) = told(real_desk, DrawSheets)  # not two, for a double click
    assert (sample.plan.lot, sample.plan.sample, sample.plan.accepted) == (12, 6, 0)
    rows = page.locator("[data-part=samples] tr[data-sheet]")
    names = rows.evaluate_all("all => all.map(one => one.dataset.sheet)")
    assert names == [one.name for one in sample.sheets]
    for number in (1, 4):
        page.locator(".samples-drawn .goes").nth(number).click()
        shows_sheet(page, names[number])
        page.wait_for_function(WHOLE)
        west, south, east, north = sample.sheets[number].area.bounds
        pane = page.locator("#mosaic-panes [data-pane=right]").bounding_box()
        (left, top), (right, low) = (
            page.evaluate("place => gruber.mosaicState().toScreen(place)", place)
            for place in ([west, north], [east, south])
        )
        assert min(left, top, pane["width"] - right, pane["height"] - low) > 0
        assert max((right - left) / pane["width"], (low - top) / pane["height"]) > 0.85
        page.click("#mosaic-close")
        open_samples(page)


def test_a_lot_is_judged_and_rejected_by_pointer__law(
    cut: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = samples_of(real_desk, sit_at)
    names = [one.name for one in draw(page, real_desk).sheets]
    open_sheet(page, names[1])
    page.click("#sheet-good")
    sheet_state(page, "good")
    page.click("#sheet-next")
    shows_sheet(page, names[2])
    page.click("#sheet-bad")  # without a word why: it asks for one
    page.wait_for_selector("#sheet-words:focus")
    page.keyboard.type("smeared")
    page.click("#sheet-bad")
    sheet_state(page, "bad")
    assert "smeared" in page.inner_text("#sheet-state")
    # A fault that is marked on a sheet makes it bad without a word.
    page.click("#sheet-next")
    shows_sheet(page, names[3])
    sheet_state(page, "open")
    page.wait_for_function(WHOLE)
    pane = page.locator("#mosaic-panes [data-pane=right]").bounding_box()
    page.mouse.click(pane["x"] + pane["width"] / 2, pane["y"] + pane["height"] / 2)
    page.select_option("#fault-kind", "smear")
    page.click("#fault-mark")
    sheet_state(page, "bad")
    page.click("#mosaic-close")
    open_samples(page)
    page.wait_for_selector("#samples-verdict.grave2:has-text('2')")
    # Another draw is asked about first, and does not make a rejected lot good.
    page.click("#samples-draw")
    page.wait_for_selector("#samples-draw:has-text('3 judged sheets stop counting')")
    assert len(told(real_desk, DrawSheets)) == 1
    assert page.locator("[data-part=verdict] li:has-text('rejected')").count() == 1
    assert page.locator("tr[data-rule=sheets] b.grave2").count() == 1
    said = [(one.sheet, one.good, one.words) for one in told(real_desk, JudgeSheet)]
    assert said == [(names[1], True, ""), (names[2], False, "smeared")]


def test_a_lot_is_gone_through_and_accepted_by_keys__law(
    cut: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = samples_of(real_desk, sit_at)
    names = [one.name for one in draw(page, real_desk).sheets]
    page.focus(f"[data-sheet={names[0]}] button")
    page.keyboard.press("Enter")
    shows_sheet(page, names[0])
    page.wait_for_function(WHOLE)
    page.keyboard.press("n")
    page.wait_for_selector("#sheet-words:focus")
    page.keyboard.type("cloud")
    # What was begun stays with its sheet, and Escape leaves the field alone.
    page.keyboard.press("Escape")
    page.keyboard.press("j")
    shows_sheet(page, names[1])
    assert page.input_value("#sheet-words") == ""
    page.keyboard.press("k")
    shows_sheet(page, names[0])
    assert page.input_value("#sheet-words") == "cloud"
    page.keyboard.press("y")
    sheet_state(page, "good")
    page.keyboard.press("u")
    sheet_state(page, "open")
    page.focus("#sheet-words")
    page.keyboard.press("Enter")
    sheet_state(page, "bad")
    page.keyboard.press("u")
    sheet_state(page, "open")
    for name in names:
        shows_sheet(page, name)
        page.keyboard.press("y")
        sheet_state(page, "good")
        page.keyboard.press("j")
    shows_sheet(page, names[0])
    page.keyboard.press("k")
    shows_sheet(page, names[-1])
    page.keyboard.press("Escape")
    page.wait_for_selector("#mosaic", state="hidden")
    open_samples(page)
    page.wait_for_selector("#samples-verdict.grave0:has-text('accepted')")


def test_a_word_about_a_sheet_outdates_a_signature__law(
    cut: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = samples_of(real_desk, sit_at)
    name = draw(page, real_desk).sheets[2].name
    page.select_option("#sign-verdict", "reject")
    page.fill("#sign-remark", "late")
    page.click("#sign")
    page.wait_for_selector(".signature")
    assert not page.query_selector(".signature .outdated")
    open_sheet(page, name)
    page.fill("#sheet-words", "a double road")
    page.click("#sheet-bad")
    sheet_state(page, "bad")
    page.click("#mosaic-close")
    open_samples(page)
    page.wait_for_selector("#samples-verdict.grave2")
    page.wait_for_selector(".signature .outdated:has-text('sample of map sheets')")


def test_without_map_sheets_nothing_is_drawn__truth(real_desk: RealDesk, sit_at: Sit) -> None:
    page = samples_of(real_desk, sit_at)
    assert page.locator("#samples-draw").count() == 0
    assert "no map sheets" in page.inner_text("[data-part=samples]")
