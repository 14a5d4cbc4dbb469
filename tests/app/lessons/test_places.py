"""Matching on real places: what is drawn, found and told beside the flight's truth."""

import errno
import sys
import time
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.found_lessons import find_lessons
from app.lessons import places, sheet
from app.teaching import Teacher
from core.errors import ReferenceDataError, StorageError
from core.synthetic.truth import WRONG_M
from tests.forked import Forked

pytestmark = pytest.mark.usefixtures("teaching_cache")
START = places.LESSON.start
HAND, VD, DETECTOR = 1, 4, 6
CFOG, SURF = 5, 3


def seen(**state: float) -> sheet.View:
    return places.LESSON.view(START | state)


def canvas(view: sheet.View, name: str) -> sheet.Canvas:
    return next(one for one in view.canvases if one.name == name)


def middle(view: sheet.View, name: str, look: str, label: str = "") -> np.ndarray:
    """The middle of a square or ring."""
    found = [s for s in canvas(view, name).shapes if s.look == look and s.kind == "line"]
    shape = next(one for one in found if not label or one.label == label)
    return np.mean(shape.points[:-1], axis=0)


class Then(places.LessonGround):
    """The flight with an ortho of its own time."""

    def _site(self, number: int, gsd_m: float, band: places.Band) -> places.ShownJunction:
        ground, found = self.opened()
        then = replace(ground, reference=replace(ground.reference, ortho=ground.older))
        return places.site_of(then, *found[number % len(found)], gsd_m, band)


@pytest.mark.parametrize("way", [HAND, VD, DETECTOR])
def test_unchanged_ground_is_found_where_it_truly_lies__truth(way: int) -> None:
    flight = Then(places.teaching_flight)
    misses = [
        places.view_of(flight, START | {"way": way, "place": i}).figures["miss"].value
        for i in range(1, 10)
    ]
    assert np.median(misses) < 1.0
    assert np.mean(np.array(misses) <= WRONG_M) >= 7 / 9


def test_changed_ground_is_found_by_edges_more_often_than_by_chance__truth() -> None:
    """By chance one of 119 places is within three metres, so that two of nine are 1 in 400."""
    misses = [seen(operator=CFOG, way=VD, place=i).figures["miss"].value for i in range(1, 10)]
    assert np.sum(np.array(misses) <= WRONG_M) >= 2


def test_the_ring_of_truth_is_where_the_photo_truly_shows_the_template__truth() -> None:
    """The way there through the true orientation, which the lesson asks the other way round."""
    flight = places.LessonGround(places.teaching_flight)
    for number in (0, 3):
        site = flight.site(number, 1.0, "grey")
        template = site.grid_point(20.0, -15.0)
        known = site.pair.grid.object_from_grid(template)
        flat = np.column_stack([known, site.ground.reference.dem.heights(known)])
        true = site.ground.truth.heights_at(flat)
        exposure = site.ground.truth.photos[site.opened.photo.photo_id]
        point = np.column_stack([known, true])
        pixel = exposure.pixel_from_object(point, site.ground.truth.camera)
        laid = places.GridPatch(template, 51.0)
        there = site.pair.scan_pixels(site.true_place(laid, "vd"))
        # A tenth of a scan pixel: both pictures are resampled by bilinear tables.
        assert np.abs(there - pixel).max() < 0.15
        back = site.true_place(places.GridPatch(site.true_place(laid, "vd"), 51.0), "hand")
        assert np.abs(back - template).max() < 0.05


def test_template_and_window_lie_where_they_are_dragged__law() -> None:
    view = seen(tx=20, ty=-10, wx=-5, wy=12, way=HAND)
    # To the middle of a pixel of a metre.
    assert middle(view, "scan", "estimate", "template") == pytest.approx([20, -10], abs=0.51)
    assert middle(view, "ortho", "second", "window") == pytest.approx([-5, 12], abs=0.51)
    other = seen(tx=20, ty=-10, wx=-5, wy=12, way=VD)
    assert middle(other, "ortho", "estimate", "template") == pytest.approx([20, -10], abs=0.51)
    assert middle(other, "scan", "second", "window") == pytest.approx([-5, 12], abs=0.51)


@pytest.mark.parametrize("gsd", [0.5, 1.0, 1.5, 2.0])
def test_pictures_lie_where_their_shapes_do__law(gsd: float) -> None:
    """A picture's pixel is as large as the grid's, and a mark lies on the same one in both."""
    state = START | {"gsd": gsd, "tx": 60.0, "ty": -60.0, "wx": -60.0, "wy": 60.0}
    found = places.seek(places.LessonGround(places.teaching_flight), state)
    assert found.template is not None
    view = seen(**state)
    for name, mark, place in (
        ("scan", middle(view, "scan", "estimate", "template"), found.template.place[0]),
        ("ortho", middle(view, "ortho", "second", "window"), found.centre[0]),
    ):
        shown = canvas(view, name).picture
        assert shown is not None
        coded = np.frombuffer(b64decode(shown.address.partition(",")[2]), np.uint8)
        rows, columns = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE).shape
        west, south, east, north = shown.window
        assert shown.window == canvas(view, name).window
        assert ((east - west) / columns, (north - south) / rows) == pytest.approx((gsd, gsd))
        pixel = [(mark[0] - west) / gsd, (north - mark[1]) / gsd]
        assert pixel == pytest.approx(place, abs=1e-6)


def make_for_ever(folder: Path, _: object) -> None:
    (folder / "half.tif").write_text("half")
    sys.stdout.write("begun\n")
    sys.stdout.flush()
    time.sleep(600)


def make_for_ever_in(cache: str) -> int:
    places.cache_folder = lambda: Path(cache)
    places.make_block = make_for_ever
    places.teaching_flight()
    return 0


def make_short(folder: Path, _: object) -> None:
    (folder / "whole.tif").write_text("whole")


def make_on_full_disk(folder: Path, _: object) -> None:
    (folder / "half.tif").write_text("half")
    raise OSError(errno.ENOSPC, "No space left on device", str(folder / "half.tif"))


def test_nothing_stays_of_a_flight_that_was_not_finished__law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Forked(make_for_ever_in, str(tmp_path)) as making:
        assert making.out.readline() == "begun\n"
        making.kill()
        making.ended()
    assert list(tmp_path.rglob("half.tif"))
    monkeypatch.setattr(places, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(places, "make_block", make_on_full_disk)
    with pytest.raises(StorageError, match="disk is full"):
        places.teaching_flight()
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(places, "make_block", make_short)
    folder = places.teaching_flight()
    assert [path.relative_to(folder) for path in tmp_path.rglob("*.tif")] == [Path("whole.tif")]
    monkeypatch.setattr(places, "make_block", make_on_full_disk)
    assert places.teaching_flight() == folder


def test_at_the_rim_nothing_is_read_beyond_the_picture__law() -> None:
    for corner in (-60.0, 60.0):
        for gsd in (0.5, 2.0):
            state = dict.fromkeys(("tx", "ty", "wx", "wy"), corner)
            view = seen(size=101, half=40, gsd=gsd, **state)
            assert view.figures["compared"].value == (2 * round(40 / gsd) + 1) ** 2


def test_detected_points_are_in_built_up_land_alone_if_wanted__law() -> None:
    flight = places.LessonGround(places.teaching_flight)
    count = 0
    for number in range(1, 10):
        state = START | {"way": DETECTOR, "built": 1, "place": number}
        found = places.seek(flight, state)
        if found.template is None:
            label = [s.label for s in canvas(places.LESSON.view(state), "likeness").shapes]
            assert "nothing" in label
            continue
        column, row = np.floor(found.template.place[0]).astype(int)
        assert found.site.built[row, column]
        count += 1
    assert count


def test_without_mahotas_surf_is_said_to_be_missing__law(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "is_installed", lambda name: name != "surf")
    view = seen(operator=SURF)
    assert "missing" in [shape.label for shape in canvas(view, "likeness").shapes]
    assert "best" not in view.figures


def test_the_lesson_takes_a_block_with_truth__truth(tiny_block: Path) -> None:
    lessons = find_lessons(block=tiny_block)
    assert list(lessons) == list(find_lessons())
    teacher = Teacher(lessons)
    hidden, shown = (teacher.view("places", {}, truth) for truth in (False, True))
    assert "miss" not in hidden["figures"]
    assert not [s for c in hidden["canvases"] for s in c["shapes"] if s["look"] == "truth"]
    assert shown["figures"]["miss"]["value"] >= 0
    assert shown["canvases"][0]["picture"]["address"].startswith("data:image/jpeg;base64,")


def test_a_block_without_truth_is_refused_where_the_lesson_is_opened__law(tmp_path: Path) -> None:
    teacher = Teacher(find_lessons(block=tmp_path))
    with pytest.raises(ReferenceDataError, match="gruber demo"):
        teacher.view("places", {}, False)
