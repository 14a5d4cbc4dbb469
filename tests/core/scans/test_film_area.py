"""The picture area of little scans, and the mask of what is photograph."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from core.geometry.camera import Camera
from core.raster.scan_file import open_scan, read_overview
from core.scans.film_area import detect_film_area, find_data_strip
from core.scans.interior_orientation import orient_scan
from core.scans.photo_mask import find_usable_area
from tests.core.scans.film_maker import FIDUCIALS, Film, film_from_pixel, make_film, write_gray

CAMERA = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=FIDUCIALS)


def true_corners(film: Film, size: int) -> np.ndarray:
    matrix = film_from_pixel(film, size)
    return np.linalg.solve(matrix[:, :2], (CAMERA.frame_corners_mm - matrix[:, 2]).T).T


@pytest.mark.parametrize("turn_deg", [-1.8, 0.0, 1.1])
@pytest.mark.parametrize("margin", [8.0, 250.0])
def test_corners_within_a_third_of_a_millimetre__truth(
    tmp_path: Path, turn_deg: float, margin: float
) -> None:
    film = Film(turn_deg=turn_deg, margin=margin)
    make_film(tmp_path / "film.tif", film)
    scan = open_scan(tmp_path / "film.tif")
    area = detect_film_area(scan, CAMERA, film.pixel_mm)
    assert set(area.seen) == {"left", "right", "top", "bottom"}
    assert area.trusted
    away = np.linalg.norm(area.corners - true_corners(film, scan.size_px[0]), axis=1)
    assert away.max() * film.pixel_mm < 0.33


@pytest.mark.parametrize("bed", [250, 2], ids=["white bed", "dark bed"])
def test_the_picture_is_found_within_a_film_cut_close_to_it__truth(
    tmp_path: Path, bed: int
) -> None:
    """The edge of the film stands out from the bed far more than the picture from its rim."""
    film = Film(turn_deg=0.8, margin=8.0 if bed > 100 else 250.0)
    make_film(tmp_path / "film.tif", film)
    gray = read_overview(open_scan(tmp_path / "film.tif"), 1)
    gray[:] = gray.clip(60, 200) if film.margin > 100 else gray.clip(0, 90)
    size = gray.shape[0]
    matrix = film_from_pixel(film, size)
    rows, columns = np.indices(gray.shape) + 0.5
    place = [
        matrix[axis, 0] * columns + matrix[axis, 1] * rows + matrix[axis, 2] for axis in (0, 1)
    ]
    beyond = np.maximum(*np.abs(place)) - film.half_mm
    gray[beyond >= 0] = film.margin
    gray[beyond >= 0.5] = bed
    write_gray(tmp_path / "cut.tif", gray.astype(np.uint8))
    area = detect_film_area(open_scan(tmp_path / "cut.tif"), CAMERA, film.pixel_mm)
    away = np.linalg.norm(area.corners - true_corners(film, size), axis=1)
    assert away.max() * film.pixel_mm < 0.33


def test_scratches_make_no_side_of_another_picture__truth(tmp_path: Path) -> None:
    """Two edges of the film and a long scratch were a picture 7 mm beside the one that is there,
    which had all four sides: its marks were then looked for in the wrong places."""
    film, rim, aside = Film(turn_deg=0.4, margin=8.0), 90, 80
    make_film(tmp_path / "film.tif", film)
    plain = read_overview(open_scan(tmp_path / "film.tif"), 1)
    gray = np.pad(plain, rim, constant_values=film.margin)
    corners = true_corners(film, plain.shape[0]) + rim
    left, top = corners.min(axis=0).round().astype(int).tolist()
    right, bottom = corners.max(axis=0).round().astype(int).tolist()
    gray[bottom + aside :] = gray[:, right + aside :] = 70.0
    scratch = top + aside + 20
    gray[scratch - 6 : scratch, left + aside :] = 200.0
    write_gray(tmp_path / "scratched.tif", gray.astype(np.uint8))
    area = detect_film_area(open_scan(tmp_path / "scratched.tif"), CAMERA, film.pixel_mm)
    assert len(area.seen) == 4
    assert np.linalg.norm(area.corners - corners, axis=1).max() * film.pixel_mm < 0.33


def test_side_cut_off_by_the_scanner_follows_from_the_frame__truth(tmp_path: Path) -> None:
    film = Film()
    make_film(tmp_path / "film.tif", film)
    gray = read_overview(open_scan(tmp_path / "film.tif"), 1)
    cut = 95
    write_gray(tmp_path / "cut.tif", gray[:, :-cut].astype(np.uint8))
    area = detect_film_area(open_scan(tmp_path / "cut.tif"), CAMERA, film.pixel_mm)
    assert set(area.seen) == {"left", "top", "bottom"}
    away = np.linalg.norm(area.corners - true_corners(film, gray.shape[0]), axis=1)
    assert away.max() * film.pixel_mm < 0.5


def test_nothing_to_see_is_not_trusted__truth(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    write_gray(tmp_path / "blank.tif", (120 + rng.normal(0, 5, (1600, 1600))).astype(np.uint8))
    area = detect_film_area(open_scan(tmp_path / "blank.tif"), CAMERA, 0.04)
    assert not area.trusted


@pytest.mark.parametrize("factor", [1, 16, 257], ids=["8 bit", "12 bit of 16", "16 bit"])
def test_the_data_strip_is_found_at_any_depth__truth(tmp_path: Path, factor: int) -> None:
    film = Film(margin_mm=12.0)
    make_film(tmp_path / "film.tif", film)
    gray = read_overview(open_scan(tmp_path / "film.tif"), 1).astype(np.uint16)
    for row in (900, 1150):
        cv2.ellipse(gray, (150, row), (110, 65), 0, 0, 360, (220,), -1)
    # A faint note on another side is no strip, however deep the scan.
    gray[-200:-50, 800:1000] += 8
    write_gray(tmp_path / "dials.tif", gray.astype(np.uint8) if factor == 1 else gray * factor)
    scan = open_scan(tmp_path / "dials.tif")
    area = detect_film_area(scan, CAMERA, film.pixel_mm)
    assert find_data_strip(scan, film.pixel_mm, area) == "left"


def test_mask_keeps_picture_and_leaves_out_marks_and_margin__truth(tmp_path: Path) -> None:
    film = Film()
    make_film(tmp_path / "film.tif", film)
    oriented = orient_scan(tmp_path / "film.tif", CAMERA, film.pixel_mm * 1000)
    reduction = 8
    mask = oriented.usable(reduction).mask
    rows, columns = np.indices(mask.shape)
    centres = (np.column_stack([columns.ravel(), rows.ravel()]) + 0.5) * reduction
    places = oriented.interior.film_from_pixel(centres).reshape(*mask.shape, 2)
    border = np.abs(places).max(axis=2)
    marks = np.array(list(FIDUCIALS.values()))
    to_mark = np.linalg.norm(places[:, :, None] - marks, axis=3).min(axis=2)
    assert not mask[border > 29.6].any()
    assert not mask[to_mark < 2.0].any()
    assert mask[(border < 28) & (to_mark > 4)].mean() > 0.99


def test_dark_housing_at_the_border_is_left_out__truth(tmp_path: Path) -> None:
    film = Film(fiducials={})
    make_film(tmp_path / "film.tif", film)
    scan = open_scan(tmp_path / "film.tif")
    gray = read_overview(scan, 1)
    corners = true_corners(film, gray.shape[0])
    column, row = corners[3].astype(int)
    gray[row : row + 200, column : column + 250] = film.margin
    write_gray(tmp_path / "housing.tif", gray.clip(0, 255).astype(np.uint8))
    scan = open_scan(tmp_path / "housing.tif")
    area = detect_film_area(scan, CAMERA, film.pixel_mm)
    mask = find_usable_area(scan, area, film.pixel_mm, (), 8).mask
    inner = mask[(row + 20) // 8 : (row + 180) // 8, (column + 20) // 8 : (column + 230) // 8]
    assert inner.mean() < 0.02
    assert mask[100:, 100:-30].mean() > 0.8


@pytest.mark.parametrize("tone", [250, 2], ids=["white", "black"])
@pytest.mark.parametrize("corner", [1.0, 0.4], ids=["an even light", "dark corners"])
def test_what_is_written_is_left_out_and_a_field_or_wood_is_not__truth(
    tmp_path: Path, tone: int, corner: float
) -> None:
    film = Film(fiducials={})
    make_film(tmp_path / "film.tif", film)
    gray = read_overview(open_scan(tmp_path / "film.tif"), 1).clip(40, 180)
    down, across = np.indices(gray.shape) / gray.shape[0] - 0.5
    gray = (gray * (1 - (1 - corner) * 2 * (down**2 + across**2))).astype(np.uint8)
    left, top = (int(value) for value in true_corners(film, gray.shape[0])[3])
    note, field = (left + 250, top + 200), (left + 900, top + 200)
    cv2.putText(gray, "5486", note, cv2.FONT_HERSHEY_SCRIPT_SIMPLEX, 4.0, (tone,), 8, cv2.LINE_AA)
    cv2.rectangle(gray, field, (field[0] + 150, field[1] + 100), (tone,), -1)
    write_gray(tmp_path / "note.tif", gray)
    scan = open_scan(tmp_path / "note.tif")
    area = detect_film_area(scan, CAMERA, film.pixel_mm)
    mask = find_usable_area(scan, area, film.pixel_mm, (), 4).mask
    written = gray[note[1] - 90 : note[1], note[0] : note[0] + 280] == tone
    masked = ~mask[(note[1] - 90) // 4 : note[1] // 4, note[0] // 4 : (note[0] + 280) // 4]
    shown = written[::4, ::4][: masked.shape[0], : masked.shape[1]]
    assert masked[: shown.shape[0], : shown.shape[1]][shown].mean() > 0.98
    assert mask[field[1] // 4 : field[1] // 4 + 25, field[0] // 4 : field[0] // 4 + 37].all()


def test_white_scratches_do_not_hide_what_is_written__truth(tmp_path: Path) -> None:
    film = Film(fiducials={})
    make_film(tmp_path / "film.tif", film)
    gray = read_overview(open_scan(tmp_path / "film.tif"), 1).clip(40, 180).astype(np.uint8)
    left, top = (int(value) for value in true_corners(film, gray.shape[0])[3])
    note = (left + 250, top + 200)
    cv2.putText(gray, "5486", note, cv2.FONT_HERSHEY_SCRIPT_SIMPLEX, 4.0, (215,), 8, cv2.LINE_AA)
    for row in range(top + 600, top + 1100, 100):
        cv2.line(gray, (left + 100, row), (gray.shape[1] - left - 100, row), (250,), 2)
    write_gray(tmp_path / "note.tif", gray)
    scan = open_scan(tmp_path / "note.tif")
    area = detect_film_area(scan, CAMERA, film.pixel_mm)
    usable = find_usable_area(scan, area, film.pixel_mm, (), 4)
    assert len(usable.scratches) == 5
    rows, columns = np.nonzero(gray[note[1] - 90 : note[1], note[0] : note[0] + 280] == 215)
    places = np.column_stack([columns + note[0], rows + note[1] - 90]) + 0.5
    assert usable.at(places).mean() < 0.02
