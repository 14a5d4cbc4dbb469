"""The mosaic at the desk: looked at beside and over the ortho, and what a place on it leads to."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Route

from app.misfit import PLACES
from core.mosaic.fault_places import FaultPlace
from core.mosaic.seam_edits import SeamArea, SeamLine
from sessions.checks import version_on_disk
from sessions.products import digest_of
from sessions.session import Session
from tests.browser.conftest import PATIENCE_MS, VIOLATIONS, RealDesk
from tests.browser.hands import drawn

Sit = Callable[..., Any]
WHOLE = "() => gruber.mosaicState().drawn.whole"
ALPHA = """pane => {
  const canvas = document.querySelector(`#mosaic-panes [data-pane=${pane}] .picture`);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const middle = Math.floor(canvas.height / 2) * canvas.width + Math.floor(canvas.width / 2);
  return [3, 4 * middle + 3].map(at => data[at]);
}"""
"""Opacity in the corner and in the middle of a picture."""


def open_mosaic(page: Any) -> None:
    page.keyboard.press("Shift+O")
    page.wait_for_selector("#mosaic[open] #mosaic-panes")
    page.wait_for_function(WHOLE)


def show(page: Any, key: str) -> None:
    """Another view by its key, drawn whole."""
    page.keyboard.press(key)
    drawn(page)
    page.wait_for_function(WHOLE)


def middle(page: Any) -> list[float]:
    return page.evaluate(
        "(() => { const [w, s, e, n] = gruber.mosaicState().found.bounds;"
        " return [(w + e) / 2, (s + n) / 2]; })()"
    )


def on_screen(page: Any, pane: str, ground: list[float]) -> tuple[float, float]:
    box = page.locator(f"#mosaic-panes [data-pane={pane}]").bounding_box()
    x, y = page.evaluate("place => gruber.mosaicState().toScreen(place)", ground)
    return box["x"] + x, box["y"] + y


def test_the_whole_mosaic_is_whole_in_another_window__law(sit_at: Sit, real_desk: RealDesk) -> None:
    page = sit_at(real_desk.desk.url, scene=False, size={"width": 1366, "height": 768})
    open_mosaic(page)
    before = page.evaluate("gruber.mosaicState().view.scale")
    page.set_viewport_size({"width": 2560, "height": 1440})
    page.reload()
    page.wait_for_selector(".row.current")
    open_mosaic(page)
    assert page.evaluate("gruber.mosaicState().view.scale") > 1.5 * before


def test_the_mosaic_is_seen_beside_and_over_the_ortho__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    page.click("#results-open")
    page.click("#results [data-open=mosaic]")
    page.wait_for_selector("#mosaic[open] #mosaic-panes")
    page.wait_for_function(WHOLE)
    assert page.locator("#results[open]").count() == 0
    # The whole mosaic is seen, and nothing beside it.
    assert page.evaluate(ALPHA, "right") == [0, 255]
    show(page, "2")
    assert page.locator("#mosaic-panes [data-pane=right]").is_hidden()
    box = page.locator("#mosaic-panes [data-pane=left]").bounding_box()
    across, down = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(across, down)
    page.mouse.down()
    page.mouse.move(across - box["width"] / 4, down, steps=4)
    page.mouse.up()
    assert page.evaluate("gruber.mosaicState().look.share") == pytest.approx(0.25, abs=0.02)
    show(page, "4")
    assert page.evaluate(ALPHA, "left") == [0, 255]
    page.keyboard.down(" ")
    page.wait_for_function("gruber.mosaicState().look.blink")
    page.keyboard.up(" ")
    page.wait_for_function("!gruber.mosaicState().look.blink")
    # Who goes away and comes back is where he was.
    show(page, "+")
    before = page.evaluate(
        "(({view, look}) => [view.x, view.scale, look.mode])(gruber.mosaicState())"
    )
    page.keyboard.press("Escape")
    page.wait_for_selector("#mosaic", state="hidden")
    page.keyboard.press("b")
    page.click("#quality [data-open=mosaic]")
    page.wait_for_selector("#mosaic[open]")
    page.keyboard.press("Escape")
    page.reload()
    page.wait_for_selector(".row.current")
    open_mosaic(page)
    after = page.evaluate(
        "(({view, look}) => [view.x, view.scale, look.mode])(gruber.mosaicState())"
    )
    assert after == [pytest.approx(before[0]), pytest.approx(before[1]), "difference"]


def test_a_place_leads_to_its_photo_and_to_its_points__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    page = sit_at(real_desk.desk.guest_url, scene=False)
    open_mosaic(page)
    place = middle(page)
    page.mouse.click(*on_screen(page, "right", place))
    page.wait_for_selector("#mosaic-photo")
    photo = page.get_attribute("#mosaic-photo", "title")
    seams = {seam["photo"] for seam in page.evaluate("gruber.mosaicState().found.seams")}
    assert photo in seams
    assert "m" in page.inner_text('[data-figure="sigma"]')
    # The same by keys alone: the crosshair is where the pointer left it.
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    page.wait_for_function("east => gruber.mosaicState().picked.place[0] > east + 1", arg=place[0])
    photo = page.get_attribute("#mosaic-photo", "title")
    place = page.evaluate("gruber.mosaicState().picked.place")
    page.click("#mosaic-queue")
    page.wait_for_selector("#mosaic", state="hidden")
    page.wait_for_function("photo => gruber.parts.queue.filter.photo === photo", arg=photo)
    page.wait_for_function("photo => gruber.parts.point.key[1] === photo", arg=photo)
    nearest = page.evaluate("gruber.parts.point.marks.surveyed")
    state = real_desk.desk.loop._now.state  # pyright: ignore[reportPrivateUsage]
    points = [
        point.position[:2]
        for (name, seen), item in state.block.measurements.items()
        if seen == photo and (point := state.point_of(name)) is not None
    ]
    away = np.linalg.norm(np.array(points) - place[:2], axis=1).min()
    assert np.hypot(*np.subtract(nearest, place[:2])) == pytest.approx(away, abs=0.5)
    open_mosaic(page)
    page.click("#mosaic-scene")
    page.wait_for_selector("#mosaic", state="hidden")
    page.wait_for_function("photo => gruber.parts.scene.inside === photo", arg=photo)


@pytest.mark.parametrize(("theme", "language"), [("dark", "en-GB"), ("light", "cs-CZ")])
def test_axe_finds_nothing_on_the_mosaic_and_all_fits_a_small_screen__oracle(
    sit_at: Sit, real_desk: RealDesk, axe: str, theme: str, language: str
) -> None:
    page = sit_at(real_desk.desk.url, scene=False, language=language)
    page.evaluate(f"localStorage.setItem('gruber.theme', '{theme}')")
    page.set_viewport_size({"width": 1366, "height": 768})
    page.reload()
    page.wait_for_selector(".row.current")
    open_mosaic(page)
    page.keyboard.press("Enter")
    page.wait_for_selector("#mosaic-photo")
    page.evaluate(axe)
    assert page.evaluate(VIOLATIONS) == []
    for wide in ("#mosaic header", "#mosaic aside"):
        room = page.locator(wide)
        assert room.evaluate("room => room.scrollWidth <= room.clientWidth"), wide
    # What draws stays in sight however far the lists below it are scrolled.
    room = page.locator("#mosaic aside")
    assert room.evaluate("room => { room.scrollTo(0, 1e6); return room.scrollTop; }") > 50
    top = room.bounding_box()["y"]
    assert top <= page.locator("[data-tool=line]").bounding_box()["y"] < top + 20
    # Holes are listed whole: nothing lies over them or below, and one thing scrolls.
    page.evaluate("""async () => {
      const { showMosaic } = await import("/pages/mosaic.js");
      const { found } = gruber.mosaicState();
      const hole = [...found.bounds.slice(0, 2), 2000, "masked", ["a", "b"]];
      showMosaic({ ...found, holes: Array(20).fill(hole), hole_count: 20 });
    }""")
    room.evaluate("room => room.scrollTo(0, 1e6)")
    holes = page.locator("#mosaic-holes")
    assert holes.evaluate("list => list.scrollHeight <= list.clientHeight")
    last, side = holes.locator("button").last.bounding_box(), room.bounding_box()
    assert last["y"] + last["height"] <= side["y"] + side["height"]
    assert page.locator("#mosaic details").last.get_attribute("open") is None


def seam_of(page: Any) -> tuple[str, str, list[float]]:
    """Two photos and the middle of the seam between them, where it is long."""
    return page.evaluate(
        """() => {
          const { seams } = gruber.mosaicState().found;
          const edges = seams.flatMap(({ photo, rings }) => rings.flatMap(ring =>
            ring.slice(1).map((to, at) => ({ photo, from: ring[at], to }))));
          const near = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]) < 3;
          const shared = edges.flatMap(one => edges.filter(two => two.photo > one.photo
            && near(one.from, two.to) && near(one.to, two.from))
            .map(two => [one.photo, two.photo, one.from, one.to]));
          const long = ([, , a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
          const [one, two, a, b] = shared.sort((x, y) => long(y) - long(x))[0];
          return [one, two, [a[0], a[1], b[0], b[1]]];
        }"""
    )


def enlarge(page: Any, edge: list[float]) -> None:
    """Until the middle half of an edge is as long as a hand tells corners apart: 9 pixels."""
    for _ in range(30):
        ends = np.array([on_screen(page, "right", end) for end in (edge[:2], edge[2:])])
        if np.linalg.norm(ends[1] - ends[0]) > 100:
            break
        page.mouse.move(*ends.mean(axis=0))
        page.mouse.wheel(0, -120)
        drawn(page)
    page.wait_for_function(WHOLE)


def corners_about(edge: list[float]) -> list[list[float]]:
    """Four places: from a seam to one side of it, along it, and back."""
    begin, end = np.array(edge[:2]), np.array(edge[2:])
    length = float(np.linalg.norm(end - begin))
    along = (end - begin) / length
    across = np.array([-along[1], along[0]])
    middle = (begin + end) / 2
    # Within the straight part: further on, the seam turns and other photos border it.
    steps = length * np.array([(-0.45, 0.01), (-0.25, 0.25), (0.25, 0.25), (0.45, 0.01)])
    return [(middle + a * along + c * across).tolist() for a, c in steps]


def move_corners(page: Any, desk: RealDesk, corners: list[list[float]]) -> None:
    """Lay a line anew, a corner dragged and one put on its first side; undo that."""
    moved = (np.array(corners[1]) + 0.3 * np.subtract(corners[1], corners[0])).tolist()
    page.mouse.move(*on_screen(page, "right", corners[1]))
    page.mouse.down()
    page.mouse.move(*on_screen(page, "right", moved), steps=5)
    page.mouse.up()
    assert page.locator(".decided.on b").inner_text() == "1", "the edit in hand is named"
    half = np.mean([corners[0], moved], axis=0).tolist()
    page.mouse.click(*on_screen(page, "right", half))
    assert len(page.evaluate("gruber.mosaicState().edit.places")) == 5
    page.keyboard.press("Enter")
    page.wait_for_function("gruber.mosaicState().found.edits[0].places.length === 5")
    laid = desk.session.decisions()[-1].decision
    assert isinstance(laid, SeamLine)
    assert np.abs(np.subtract(laid.line, [corners[0], half, moved, *corners[2:]])).max() < 8
    assert len(page.evaluate("gruber.mosaicState().found.edits")) == 1
    page.keyboard.press("u")
    page.wait_for_function("gruber.mosaicState().found.edits[0].places.length === 4")
    page.click(".decided.withdrawn button")
    page.wait_for_function("gruber.mosaicState().found.edits[0].places.length === 5")
    assert page.locator(".decided.withdrawn").count() == 0
    page.click(".decided button >> text=Withdraw")
    page.wait_for_function("gruber.mosaicState().found.edits[0].places.length === 4")
    page.evaluate("document.activeElement.blur()")


def test_a_seam_is_drawn_undone_and_drawn_into_the_file__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    open_mosaic(page)
    one, two, edge = seam_of(page)
    enlarge(page, edge)
    corners = corners_about(edge)
    page.keyboard.press("l")
    page.wait_for_selector("[data-tool=line].on")
    for corner in corners:
        page.mouse.click(*on_screen(page, "right", corner))
    page.keyboard.press("Enter")
    page.wait_for_function("gruber.mosaicState().found.edition > 0")
    page.wait_for_function(WHOLE)
    drawn = real_desk.session.decisions()[-1].decision
    assert isinstance(drawn, SeamLine)
    assert {drawn.first, drawn.second} == {one, two}
    # A pixel of the screen is some metres.
    assert np.abs(np.subtract(drawn.line, corners)).max() < 8
    assert "Write results" in page.inner_text("#mosaic-pending")
    assert not page.evaluate("gruber.parts.status.adjusting")
    page.keyboard.press("u")
    page.wait_for_function("gruber.mosaicState().found.edition === 0")
    assert page.locator("#mosaic-pending").count() == 0
    page.keyboard.press("Shift+U")
    page.wait_for_function("gruber.mosaicState().found.edition > 0")
    move_corners(page, real_desk, corners)
    # An area by keys alone: four corners about the crosshair, for the other photo.
    page.keyboard.press("p")
    page.select_option("#mosaic-photo-of", two)
    page.evaluate("document.activeElement.blur()")
    for key in ("ArrowRight", "ArrowDown", "ArrowLeft"):
        for _ in range(3):
            page.keyboard.press(key)
        page.keyboard.press(" ")
    page.keyboard.press("Enter")
    page.wait_for_function("gruber.mosaicState().found.edits.length === 2")
    area = real_desk.session.decisions()[-1].decision
    assert isinstance(area, SeamArea)
    assert (area.photo_id, len(area.outline)) == (two, 3)
    version = page.evaluate("gruber.mosaicState().found.version")
    # The bar's button begins the same, and is called the same.
    assert page.inner_text("#mosaic-remake") == page.locator("#remake-start").text_content()
    page.click("#mosaic-remake")
    page.wait_for_function(
        "was => gruber.mosaicState().found.version > was", arg=version, timeout=3 * PATIENCE_MS
    )
    page.wait_for_function("gruber.mosaicState().found.edition === 0")
    assert page.locator("#mosaic-pending").count() == 0
    assert len(page.evaluate("gruber.mosaicState().found.edits")) == 2


def test_an_area_is_for_the_photo_below_the_pointer_and_is_ended_by_it__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    open_mosaic(page)
    parts = page.evaluate("gruber.mosaicState().found.seams.map(one => [one.photo, one.label])")
    assert len(parts) > 1
    for photo, label in (parts[0], parts[-1]):
        page.mouse.move(*on_screen(page, "right", label))
        page.keyboard.press("p")
        page.wait_for_selector("[data-tool=area].on")
        assert page.input_value("#mosaic-photo-of") == photo
        page.keyboard.press("p")
    photo, label = parts[0]
    page.keyboard.press("p")
    x, y = on_screen(page, "right", label)
    page.mouse.click(x, y)
    page.mouse.click(x + 60, y)
    # The first corner says whose it is, until a hand does.
    assert page.input_value("#mosaic-photo-of") == photo
    told = page.locator("#mosaic-tools [role=status]")
    hint = told.inner_text()
    page.keyboard.press("Enter")
    assert told.inner_text() != hint
    before = len(real_desk.session.decisions())
    page.mouse.dblclick(x, y + 60)
    page.wait_for_function("gruber.mosaicState().edit.places.length === 0")
    page.wait_for_function("gruber.mosaicState().found.edits.length > 0")
    drawn = real_desk.session.decisions()[before].decision
    assert isinstance(drawn, SeamArea)
    assert (drawn.photo_id, len(drawn.outline)) == (photo, 3)


def test_without_a_mosaic_the_sheet_says_what_to_do__law(sit_at: Sit, desk: Any) -> None:
    page = sit_at(desk.url, scene=False)
    page.keyboard.press("Shift+O")
    page.wait_for_selector("#mosaic-none:not([hidden]) button")
    assert page.locator("#mosaic-panes").is_hidden()
    page.keyboard.press("Shift+O")
    page.wait_for_selector("#mosaic", state="hidden")


@pytest.fixture
def likely_faults(run_folder: Path) -> None:
    """Two places that are told of the mosaic; of its own, a good one may have none."""
    with Session.open(run_folder, "ada") as session:
        products = session.products
        seams = products.latest_value("mosaic").seams[:2]
        spots = [(seam.photo_id, seam.area.representative_point()) for seam in seams]
        places = tuple(
            FaultPlace("reference", at.x, at.y, (photo,), (2.0, -1.0), 0.3, (0.2, 0.2), True)
            for photo, at in spots
        )
        products.save_value(PLACES, digest_of("placed"), (version_on_disk(products), places))


@pytest.mark.usefixtures("likely_faults")
def test_a_place_of_misfit_leads_to_its_cause_and_the_queue__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    open_mosaic(page)
    first = page.locator("[data-misfit]").first
    worst = page.evaluate("gruber.mosaicState().found.misfits[0]")
    first.click()
    page.wait_for_selector("#mosaic-cause")
    view = page.evaluate("(({ picked }) => picked.place)(gruber.mosaicState())")
    assert view[:2] == pytest.approx(worst["place"], abs=0.2)
    assert page.get_attribute("#mosaic-photo", "title") == worst["photos"][0]
    assert page.locator("#mosaic-cause tr").count() > 0
    assert page.inner_text("[data-figure=off]") == "E 2.00, N \u22121.00 m"
    assert page.locator("[data-misfit].on").count() == 1
    assert "on" in page.get_attribute("[data-misfit] >> nth=0", "class").split()
    # By keys: the second place, then the queue at its photo's points.
    second = page.locator("[data-misfit]").nth(1)
    other = page.evaluate("gruber.mosaicState().found.misfits[1].photos[0]")
    second.focus()
    page.keyboard.press("Enter")
    page.wait_for_function("p => gruber.mosaicState().picked.photo === p", arg=other)
    page.focus("#mosaic-queue")
    page.keyboard.press("Enter")
    page.wait_for_selector("#mosaic", state="hidden")
    page.wait_for_function("photo => gruber.parts.queue.filter.photo === photo", arg=other)


@pytest.mark.usefixtures("likely_faults")
def test_a_place_of_two_photos_leads_to_either__law(sit_at: Sit, real_desk: RealDesk) -> None:
    """Two rays do not say which of them is wrong."""
    page = sit_at(real_desk.desk.url, scene=False)
    open_mosaic(page)
    *pair, edge = seam_of(page)
    page.evaluate(
        """async ([photos, place]) => {
          const { showMosaic } = await import("/pages/mosaic.js");
          const { found } = gruber.mosaicState();
          const [first] = found.misfits;
          showMosaic({ ...found, misfits: [{ ...first, kind: "ties", place, photos }] });
        }""",
        [pair, edge[:2]],
    )
    page.locator("[data-misfit]").click()
    for here, other in (pair, pair[::-1]):
        page.wait_for_function("p => gruber.mosaicState().picked?.photo === p", arg=here)
        assert page.inner_text("#mosaic-other") in other
        page.click("#mosaic-other")


def test_a_new_mosaic_leaves_the_focus_where_words_are_typed__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    """The letters that followed were commands: U undid."""
    page = sit_at(real_desk.desk.url, scene=False)
    pane = "document.activeElement.dataset.pane"
    for _ in range(2):
        open_mosaic(page)
        assert page.evaluate(pane) == "right"
        page.keyboard.press("Escape")
    open_mosaic(page)
    page.keyboard.press("Enter")
    page.click("#fault-words")
    page.keyboard.type("ch")
    page.evaluate("""async () => {
      const { showMosaic } = await import("/pages/mosaic.js");
      const { found } = gruber.mosaicState();
      showMosaic({ ...found, version: found.version + 1 });
    }""")
    page.keyboard.type("urch")
    assert page.input_value("#fault-words") == "church"


@pytest.mark.parametrize("name", ["sheets", "export"])
def test_long_work_is_seen_and_cancelled_whoever_opens_the_results__law(
    sit_at: Sit, real_desk: RealDesk, name: str
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    told = {"busy": True, "share": 0.4, "what": ""}
    page.route(f"**/{name}", lambda route: route.fulfill(json=told))
    for _ in range(2):
        page.click("#results-open")
        page.wait_for_selector(f"#{name}-said:has-text('40')")
        assert page.is_disabled(f"#{name}-begin")
        page.keyboard.press("Escape")
    page.click("#results-open")
    with page.expect_request(f"**/{name}/cancel"):
        page.click(f"#{name}-cancel")
    told["busy"] = False
    page.wait_for_selector(f"#{name}-begin:not([disabled])")
    # The list that is open is that of now, and what was unfolded stays so.
    made = [["sheets/EPSG-32633/HUST25.tif", 3], ["export/points.csv", 5]]
    page.route("**/results/", lambda route: route.fulfill(json=made))
    told["busy"] = True
    page.keyboard.press("Escape")
    page.click("#results-open")
    page.wait_for_selector(f"#{name}-said:has-text('40')")
    page.click(".files summary >> text=export/")
    made[0] = ["sheets/EPSG-32634/HUST25.tif", 3]
    told["busy"] = False
    page.wait_for_selector(".files summary >> text=EPSG-32634")
    assert page.locator(".files summary >> text=EPSG-32633").count() == 0
    assert page.is_visible("text=points.csv")
    assert page.is_hidden(f"#{name}-cancel")
    assert page.inner_text(f"#{name}-said") == ""


def test_what_an_export_says_waits_for_the_list_that_another_look_renews__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    """The list above grew afterwards and pushed it below the edge of the sheet."""
    page, asked, listed = sit_at(real_desk.desk.url, scene=False), list[Route](), list[Route]()
    page.click("#results-open")
    page.wait_for_selector(".files:not([aria-busy])")
    page.route("**/results/", lambda route: listed.append(route))
    page.route("**/export/*", lambda route: asked.append(route))
    page.route("**/export", lambda route: route.fulfill(json={"busy": False}))
    with page.expect_request("**/results/"):
        page.click("#export-begin")
    with page.expect_response("**/export"):
        asked.pop().fulfill(json={"error": "no room"})
    drawn(page)
    assert "no room" not in page.inner_text("#export-said")
    listed.pop().fulfill(json=[["export/points.csv", 5]])
    page.wait_for_selector("#export-said:has-text('no room')")


def test_an_export_is_taken_from_the_results__truth(sit_at: Sit, real_desk: RealDesk) -> None:
    page = sit_at(real_desk.desk.url, scene=False, size={"width": 1366, "height": 768})
    page.click("#results-open")
    page.click("#export-begin")
    page.wait_for_selector("#export-said a[href^='/results/export/']")
    # What came of it lay below the edge of the sheet.
    said, sheet = (page.locator(name).bounding_box() for name in ("#export-said", "#results"))
    assert said["y"] + said["height"] <= sheet["y"] + sheet["height"]
    assert page.is_hidden("#export-cancel")
    file = page.get_attribute("#export-said a", "href")
    assert page.locator(f".files a[href='{file}']").count() == 1
    page.route("**/export/*", lambda route: route.fulfill(json={}))
    page.click("#export-begin")
    page.wait_for_selector("#export-said:has-text('Cancelled')")
