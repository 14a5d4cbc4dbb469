"""Scratches drawn at known places, and what is as thin or as long but lies on the ground."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from core.geometry.camera import Camera
from core.raster.scan_file import Scratch, UsableArea, open_scan, read_overview
from core.scans.interior_orientation import orient_scan
from core.scans.photo_mask import find_scratches
from tests.core.scans.film_maker import FIDUCIALS, Film, make_film, write_gray

FILM = Film(fiducials={}, turn_deg=0.4)
SIZE = round((2 * FILM.half_mm + 5.0) / FILM.pixel_mm)
WHOLE = np.ones((SIZE // 4, SIZE // 4), bool)
SQUARE = np.array([[0.0, SIZE], [SIZE, SIZE], [SIZE, 0.0], [0.0, 0.0]])
BRIGHT = np.array([[200.5, 400.5], [500.5, 405.5], [900.5, 410.0], [1300.5, 412.5]])
DARK = np.array([[150.5, 1100.5], [1000.5, 1094.5]])


def drawn(lines: list[tuple[np.ndarray, int, int]], path: Path, depth: type = np.uint8) -> Path:
    """A film with lines (places, tone, width) upon it."""
    make_film(path, FILM)
    gray = read_overview(open_scan(path), 1)[:1500]
    for line, tone, width in lines:
        places = np.round((line - 0.5) * 256).astype(np.int32)
        cv2.polylines(gray, [places], False, float(tone), width, cv2.LINE_AA, 8)
    write_gray(path, (gray * (257 if depth == np.uint16 else 1)).astype(depth))
    return path


def course(scratch: Scratch, line: np.ndarray) -> np.ndarray:
    """How far a found scratch lies beside a drawn line, over its length, pixels."""
    along = np.linspace(scratch.first + 10, scratch.last - 10, 50)
    return np.polyval(scratch.course, along) - np.interp(along, line[:, 0], line[:, 1])


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_scratches_are_found_where_they_were_drawn__truth(tmp_path: Path, depth: type) -> None:
    path = drawn([(BRIGHT, 235, 1), (DARK, 30, 1)], tmp_path / "film.tif", depth)
    found = find_scratches(open_scan(path), SQUARE, WHOLE, FILM.pixel_mm)
    assert [scratch.axis for scratch in found] == [0, 0]
    for scratch, line in zip(found, (BRIGHT, DARK), strict=True):
        assert np.abs(course(scratch, line)).max() < 2.0
        assert abs(scratch.first - line[0, 0]) < 20
        assert abs(scratch.last - line[-1, 0]) < 20


def test_those_down_a_scan_are_those_across_it_turned__law(tmp_path: Path) -> None:
    path = drawn([(BRIGHT, 235, 1), (DARK, 30, 1)], tmp_path / "film.tif")
    across = find_scratches(open_scan(path), SQUARE, WHOLE, FILM.pixel_mm)
    write_gray(tmp_path / "down.tif", read_overview(open_scan(path), 1).T.astype(np.uint8))
    down = find_scratches(open_scan(tmp_path / "down.tif"), SQUARE, WHOLE, FILM.pixel_mm)
    assert [scratch.axis for scratch in down] == [1, 1]
    for one, other in zip(across, down, strict=True):
        np.testing.assert_allclose(
            [one.first, one.last, *one.course], [other.first, other.last, *other.course]
        )


@pytest.mark.parametrize(
    ("line", "width"),
    [
        (BRIGHT, 9),
        (np.array([[200.5, 400.5], [1300.5, 480.5]]), 1),
        (np.array([[200.5, 400.5], [500.5, 402.5]]), 1),
        (np.array([[200.5, 400.5], [700.5, 430.5], [1300.5, 401.5]]), 1),
        (np.array([[300.5, 400.5], [760.5, 400.5], [761.5, 404.5], [1220.5, 404.5]]), 1),
    ],
    ids=["a road", "a lane aslant", "a short lane", "a bend", "a lane with a step"],
)
def test_what_lies_on_the_ground_is_no_scratch__truth(
    tmp_path: Path, line: np.ndarray, width: int
) -> None:
    path = drawn([(line, 235, width)], tmp_path / "film.tif")
    assert not find_scratches(open_scan(path), SQUARE, WHOLE, FILM.pixel_mm)


def test_outside_the_photograph_none_is_sought__truth(tmp_path: Path) -> None:
    path = drawn([(BRIGHT, 235, 1), (DARK, 30, 1)], tmp_path / "film.tif")
    lower = WHOLE.copy()
    lower[: 800 // 4] = False
    (found,) = find_scratches(open_scan(path), SQUARE, lower, FILM.pixel_mm)
    assert np.abs(course(found, DARK)).max() < 2.0


def test_a_scan_shorter_than_a_scratch_has_none__truth(tmp_path: Path) -> None:
    write_gray(tmp_path / "scrap.tif", np.full((12, 500), 90, np.uint8))
    assert find_scratches(open_scan(tmp_path / "scrap.tif"), SQUARE, WHOLE, 0.04) == ()


def test_the_mask_of_a_scan_leaves_out_its_scratches_alone__truth(tmp_path: Path) -> None:
    path = drawn([(BRIGHT, 235, 1)], tmp_path / "film.tif")
    # Marks that are known and not there are given up at once; unknown ones are sought everywhere.
    camera = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=FIDUCIALS)
    usable = orient_scan(path, camera, FILM.pixel_mm * 1000).masked().scan.usable
    assert usable is not None
    cells = UsableArea.of(usable.mask, usable.size_px)
    along = np.linspace(BRIGHT[0, 0] + 20, BRIGHT[-1, 0] - 20, 200)
    row = np.interp(along, BRIGHT[:, 0], BRIGHT[:, 1])
    assert not usable.at(np.column_stack([along, row])).any()
    for off in (-8.0, 8.0, 300.0):
        beside = np.column_stack([along, row + off])
        np.testing.assert_array_equal(usable.at(beside), cells.at(beside))
        assert usable.at(beside).all()
