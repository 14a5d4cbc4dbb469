"""Pictures can be sent: JSON without surprises, and every word they name exists."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.ui.desk_block import adjust, outlines, tiny_block
from ui.review.compare import (
    drawn_from_block,
    made_with,
    overlay_of,
    redrawn,
    stale_photos,
    with_made,
)
from ui.review.looks import LOOKS, rgb
from ui.review.misfit import misfits
from ui.review.picture import Pictured, point_part, queue_part, scene_part, status_part
from ui.review.queue import NO_ROWS, seat_down
from ui.review.scene import scene_picture
from ui.review.state import DeskState, Seat
from ui.web.front import as_json

PAGES = Path(__file__).resolve().parents[3] / "ui" / "web" / "pages"


@pytest.fixture(scope="module")
def state() -> DeskState:
    block = tiny_block().block
    report = adjust(block)
    return DeskState(block, report, made=made_with(report.block), before=report)


def test_every_part_can_be_sent__law(state):
    table = NO_ROWS.renewed(state)
    rows = table.rows
    seat = seat_down(Seat("seat-1", "anna"), rows)
    drawn, dem = drawn_from_block(state.oriented), tiny_block().land.dem
    parts = [
        table.lines,
        queue_part(seat, table.places),
        scene_part(seat),
        status_part(state, rows, (), seat),
        point_part(state, seat, rows, Pictured(drawn, dem)),
    ]
    for part in parts:
        assert json.loads(as_json(part)) is not None


def test_a_block_without_measurements_can_be_shown__law(state):
    empty = replace(state, block=replace(state.block, measurements={}))
    seat = seat_down(Seat("seat-1", "anna"), {})
    assert seat.current is None
    assert NO_ROWS.renewed(empty).lines == []
    assert point_part(empty, seat, {}, Pictured({}, tiny_block().land.dem)) is None
    assert scene_picture(empty, (), np.zeros((0, 2, 3))).vectors.shape == (0, 2, 3)


def test_overlays_lie_within_a_pixel_of_what_they_mark__truth(state):
    dem = tiny_block().land.dem
    drawn = drawn_from_block(state.oriented)
    good = [key for key in state.block.measurements if key not in tiny_block().blunders]
    offsets = []
    for key in good[:60]:
        overlay = overlay_of(state, drawn, dem, key)
        assert overlay is not None
        offsets.append(np.linalg.norm(overlay.surveyed - overlay.predicted))
    # The DEM is interpolated, the survey has noise: decimetres, not metres.
    assert np.median(offsets) < 0.5


def test_misfits_on_the_ground_are_pixels_times_pixel_size__law(state):
    pixel_m = 0.15 * 1650 / 210
    for misfit in misfits(state).values():
        pixels = np.hypot(*misfit.pixels)
        assert np.hypot(*misfit.metres) == pytest.approx(pixels * pixel_m, rel=0.12, abs=0.02)


def test_misfits_do_not_shrink_when_a_point_gives_way__law(state):
    """Residuals do: with weak coordinates the point follows its measurement."""
    away = misfits(state)
    for key in tiny_block().blunders:
        assert np.hypot(*away[key].pixels) > 0.9 * np.hypot(*state.report.residuals_px[key])
    points = {name: replace(p, sigma_m=p.sigma_m * 20) for name, p in state.block.surveyed.items()}
    weak = adjust(replace(state.block, surveyed=points))
    loose = misfits(replace(state, report=weak))
    sums = [
        sum(np.hypot(*weak.residuals_px[key]) for key in tiny_block().blunders),
        sum(np.hypot(*loose[key].pixels) for key in tiny_block().blunders),
    ]
    assert sums[0] < 0.5 * sums[1]


def test_footprints_are_closed_outlines__law(state):
    outline = outlines(state)
    assert len(outline) == 6 * 48
    assert np.allclose(outline[47, 1], outline[0, 0])


def test_photos_are_drawn_anew_only_when_they_moved__law(state):
    drawn = drawn_from_block(state.oriented)
    assert all(photo.version == 1 for photo in redrawn(drawn, state.oriented).values())
    photos = dict(state.oriented.photos)
    name, photo = next(iter(photos.items()))
    exterior = replace(photo.exterior, centre=photo.exterior.centre + np.array([3.0, 0, 0]))
    photos[name] = photo.with_exterior(exterior, True)
    moved = redrawn(drawn, state.oriented.with_photos(photos))
    assert [n for n, p in moved.items() if p.version == 2] == [name]


def test_orthos_are_stale_until_they_are_made_again__law(state):
    assert stale_photos(state, 0.1) == ()
    older = replace(state, made=made_with(state.block))
    stale = stale_photos(older, 0.1)
    assert set(stale) == set(state.block.photos)
    assert stale_photos(with_made(older, stale, older.oriented), 0.1) == ()


def test_states_differ_in_shape_as_well_as_colour__law():
    assert len({look.glyph for look in LOOKS.values()}) == len(LOOKS)
    assert len({look.cloud_shape for look in LOOKS.values()}) >= 4
    assert len({rgb(look.colour) for look in LOOKS.values()}) == len(LOOKS)


def test_nothing_on_the_pages_comes_from_elsewhere__law():
    for path in PAGES.iterdir():
        found = re.findall(r"https?://[^\s\"'`)]+", path.read_text())
        assert [address for address in found if "www.w3.org" not in address] == []
