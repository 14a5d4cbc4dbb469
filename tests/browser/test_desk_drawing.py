"""Masks drawn in the browser, and one photo of a finished block placed anew."""

from collections.abc import Callable
from typing import Any

import numpy as np

from core.formats.world_file import read_world_file
from sessions.decisions import DrawMask, PlacePhoto
from tests.browser.conftest import RealDesk
from tests.browser.hands import becomes, current, gone_on, settled, state_of

Sit = Callable[..., Any]
WHOLE = "() => { const s = gruber.maskState(); return s.found && s.view.scale > 0; }"


def open_masks(page: Any) -> None:
    page.keyboard.press("Shift+I")
    page.wait_for_selector("#mask[open] .mask-room")
    page.wait_for_function(WHOLE)


def scan_pixel(page: Any, place: np.ndarray) -> tuple[float, float]:
    """Where a pixel of the scan is on the screen."""
    box = page.locator(".mask-room").bounding_box()
    x, y = page.evaluate("place => gruber.maskState().toScreen(place)", place.tolist())
    return box["x"] + x, box["y"] + y


def used(desk: RealDesk) -> tuple[str, str, np.ndarray]:
    """A control measurement that the program uses."""
    block = desk.desk.loop._now.state.block  # pyright: ignore[reportPrivateUsage]
    item = next(
        one
        for one in block.measurements.values()
        if one.status == "auto" and block.surveyed[one.point_id].role == "control"
    )
    return item.point_id, item.photo_id, np.array([item.column, item.row])


def test_an_outline_takes_out_what_lies_inside_and_undo_brings_it_back__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    point, photo, place = used(real_desk)
    page = sit_at(real_desk.desk.url, scene=False)
    judged = current(page)
    page.keyboard.press("y")
    gone_on(page, judged)
    open_masks(page)
    page.click(f'#mask [data-scan="{photo}"]')
    page.wait_for_function("photo => gruber.maskState().current === photo", arg=photo)
    for corner in ((-40, -40), (40, -40), (40, 40), (-40, 40)):
        page.mouse.click(*scan_pixel(page, place + corner))
    page.keyboard.press("Enter")
    page.wait_for_selector("#mask-out")
    assert point in page.inner_text("#mask-out")
    drawn = real_desk.session.decisions()[-1].decision
    assert isinstance(drawn, DrawMask)
    assert drawn.subject == photo
    # A pixel of the screen is some pixels of the scan.
    assert np.abs(np.mean(drawn.outline, axis=0) - place).max() < 6
    settled(page)
    assert photo in page.evaluate("gruber.parts.status.stale")
    page.keyboard.press("u")
    page.wait_for_selector("#mask-out", state="detached")
    settled(page)
    assert photo not in page.evaluate("gruber.parts.status.stale")
    # No other mask is left: what was decided on the desk stays, and the page says so.
    page.keyboard.press("u")
    page.wait_for_selector(".notice:has-text('this page')")
    assert state_of(page, judged) == "accepted"
    # Loaded anew, the desk lies under no sheet any more.
    page.reload()
    page.wait_for_selector(".row.current")
    settled(page)
    page.keyboard.press("u")
    becomes(page, judged, "auto")


def test_a_mask_is_drawn_and_erased_by_keys_alone_on_all_scans_of_a_camera__law(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    open_masks(page)
    # Two corners are no outline yet: they stay, whatever else is asked for, until Esc drops them.
    for key in (" ", "ArrowRight", " ", "Enter"):
        page.keyboard.press(key)
    corners = "gruber.maskState().outline.length"
    page.wait_for_selector("#mask-said:has-text('three corners')")
    assert page.evaluate(corners) == 2
    current = page.evaluate("gruber.maskState().current")
    page.keyboard.press("j")
    page.wait_for_selector("#mask-said:has-text('being drawn')")
    assert page.evaluate("gruber.maskState().current") == current
    assert page.evaluate(corners) == 2
    page.keyboard.press("Escape")
    assert page.evaluate(corners) == 0
    assert not page.query_selector("#mask-said")
    page.keyboard.press("c")
    for key in ("ArrowRight", "ArrowDown", "ArrowLeft"):
        for _ in range(4):
            page.keyboard.press(key)
        page.keyboard.press(" ")
    page.keyboard.press("Enter")
    page.wait_for_function("gruber.maskState().found.strokes.length === 1")
    hidden = "gruber.maskState().found.photos.every(one => one.hidden.length === 1)"
    assert page.evaluate(hidden)
    # The brush as an eraser, set down once over the middle line.
    for key in ("e", "b", "ArrowUp", "ArrowUp", " "):
        page.keyboard.press(key)
    page.wait_for_function("gruber.maskState().found.strokes.length === 2")
    assert page.evaluate("gruber.maskState().found.photos.every(one => one.freed.length === 1)")
    decided = [item.decision for item in real_desk.session.decisions()]
    assert [(d.on_film, d.hides) for d in decided if isinstance(d, DrawMask)] == [
        (True, True),
        (True, False),
    ]
    page.keyboard.press("Escape")
    page.wait_for_selector("#mask:not([open])", state="attached")


def click_pairs(page: Any, inner: Any, pixels: np.ndarray, ground: np.ndarray) -> None:
    """The same places in the scan and in the ortho."""
    for pixel, place in zip(pixels, ground, strict=True):
        for side, at in (("scan", pixel), ("ortho", place)):
            box = inner.locator(f".pane[data-pane={side}]").bounding_box()
            x, y = inner.evaluate("([side, at]) => gruber.toScreen(side, at)", [side, at.tolist()])
            page.mouse.click(box["x"] + x, box["y"] + y)


def centre_of(desk: RealDesk, name: str) -> np.ndarray:
    """The perspective centre of a photo in the newest adjustment."""
    state = desk.desk.loop._now.state  # pyright: ignore[reportPrivateUsage]
    return state.report.block.photos[name].exterior.centre


def test_one_photo_of_a_finished_block_is_placed_anew_and_undone__truth(
    sit_at: Sit, real_desk: RealDesk
) -> None:
    state = real_desk.desk.loop._now.state  # pyright: ignore[reportPrivateUsage]
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    name = page.evaluate("gruber.parts.point.key[1]")
    photo, camera = state.oriented.photos[name], state.oriented.camera_of(name)
    columns, rows = photo.size_px
    pixels = np.array([[0.3, 0.3], [0.7, 0.3], [0.7, 0.7], [0.3, 0.7]]) * (columns, rows)
    heights = np.full(4, photo.ground_height_m)
    ground = photo.object_from_pixel(pixels, heights, camera)[:, :2]
    page.keyboard.press("Shift+G")
    frame = page.frame_locator("#placed iframe")
    frame.locator(f'.scan.on[data-scan="{name}"]').wait_for()
    inner = next(one for one in page.frames if "placing.html" in one.url)
    inner.wait_for_function("gruber.place().scan && gruber.place().views.ortho.scale > 0")
    # 200 m beside its place, so that the block has something to follow.
    click_pairs(page, inner, pixels, ground + 200.0)
    inner.wait_for_function("gruber.place().fit.affine?.rms > 0")
    fit = inner.evaluate("gruber.place().fit")
    assert fit["affine"]["rms"] <= fit["rms"]
    inner.click("[data-model=affine]")
    page.keyboard.press("t")
    file = real_desk.results / "world-files" / f"{name}.tfw"
    inner.wait_for_selector("#notices .notice")
    written = read_world_file(file).object_from_pixel
    away = pixels @ written[:, :2].T + written[:, 2] - ground
    assert np.abs(away - 200.0).max() < 30
    before = page.evaluate("gruber.parts.status.decided")
    page.keyboard.press("s")
    page.wait_for_function("before => gruber.parts.status.decided === before + 1", arg=before)
    settled(page)
    moved = centre_of(real_desk, name) - photo.exterior.centre
    assert np.abs(moved[:2] - 200.0).max() < 80
    assert isinstance(real_desk.session.decisions()[-1].decision, PlacePhoto)
    page.keyboard.press("Escape")
    page.wait_for_selector("#placed:not([open])", state="attached")
    page.keyboard.press("u")
    page.wait_for_function("before => gruber.parts.status.decided === before", arg=before)
    settled(page)
    assert np.allclose(centre_of(real_desk, name), photo.exterior.centre, atol=0.02)


def away_and_back(placing: Any, name: str) -> None:
    """To another scan and back to this one; a press is lost while its row is drawn anew."""
    other = placing.locator(f'.scan:not([data-scan="{name}"])').first.get_attribute("data-scan")
    for scan in (other, name):
        placing.locator(f'[data-scan="{scan}"]').click()
        placing.locator(f'.scan.on[data-scan="{scan}"]').wait_for()
        placing.wait_for_function("Object.keys(gruber.place().fit).length > 0")


def test_pairs_are_called_saved_once_they_are__law(sit_at: Sit, real_desk: RealDesk) -> None:
    """Every look at the whole scan called them saved, and forgot what U takes back."""
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    name = page.evaluate("gruber.parts.point.key[1]")
    page.keyboard.press("Shift+G")
    page.frame_locator("#placed iframe").locator(f'.scan.on[data-scan="{name}"]').wait_for()
    inner = next(one for one in page.frames if "placing.html" in one.url)
    inner.wait_for_function("gruber.place().scan && gruber.place().views.ortho.scale > 0")
    for share in (0.4, 0.6):
        for side in ("scan", "ortho"):
            box = inner.locator(f".pane[data-pane={side}]").bounding_box()
            page.mouse.click(
                box["x"] + share * box["width"], box["y"] + (share - 0.05) * box["height"]
            )
    assert len(inner.evaluate("gruber.place().scan.pairs")) == 2
    page.keyboard.press("f")
    assert inner.evaluate("gruber.place().saved") == ""
    away_and_back(inner, name)
    assert inner.evaluate("gruber.place().saved") == ""
    # Closed before they were saved, they are there again, as the last arrow left them.
    page.keyboard.press("Shift+ArrowRight")
    pairs = inner.evaluate("gruber.place().scan.pairs")
    page.keyboard.press("Escape")
    page.wait_for_selector("#placed:not([open])", state="attached")
    page.keyboard.press("Shift+G")
    page.frame_locator("#placed iframe").locator(f'.scan.on[data-scan="{name}"]').wait_for()
    inner = next(one for one in page.frames if "placing.html" in one.url)
    inner.wait_for_function("gruber.place().scan?.pairs.length === 2")
    assert inner.evaluate("gruber.place().scan.pairs") == pairs
    assert inner.evaluate("gruber.place().saved") == ""
    box = inner.locator(".pane[data-pane=ortho]").bounding_box()
    page.mouse.click(box["x"] + 0.3 * box["width"], box["y"] + 0.3 * box["height"])
    page.keyboard.press("f")
    assert inner.evaluate("Boolean(gruber.place().pending.ortho)")
    page.keyboard.press("u")
    before = page.evaluate("gruber.parts.status.decided")
    page.keyboard.press("s")
    page.keyboard.press("s")
    inner.wait_for_function("gruber.place().saved")
    page.wait_for_function("before => gruber.parts.status.decided > before", arg=before)
    settled(page)
    assert page.evaluate("gruber.parts.status.decided") == before + 1, "saved once"
    away_and_back(inner, name)
    assert "saved before" in inner.evaluate("gruber.place().saved")
