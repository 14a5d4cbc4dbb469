"""Fiducials of little scans whose marks we drew: kinds, polarities, turns, damage."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.geometry.camera import Camera
from core.raster.scan_file import open_scan, read_overview
from core.scans.fiducials import measure_fiducials, measure_missing_marks
from core.scans.film_area import detect_film_area
from core.scans.interior_orientation import ScanOrientation, orient_scan
from tests.core.scans.film_maker import FIDUCIALS, Film, make_film, write_gray

pytestmark = pytest.mark.slow

CAMERA = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=FIDUCIALS)
GOAL_PX = 0.1


def oriented(
    folder: Path, film: Film, camera: Camera = CAMERA, seed: int = 1
) -> tuple[ScanOrientation, dict]:
    path = folder / "film.tif"
    truth = make_film(path, film, seed)
    return orient_scan(path, camera, film.pixel_mm * 1000), truth


def errors(result: ScanOrientation, truth: dict) -> np.ndarray:
    return np.array(
        [np.hypot(m.column - truth[m.name][0], m.row - truth[m.name][1]) for m in result.fiducials]
    )


@pytest.mark.parametrize("kind", ["cross", "gapped-cross", "dot", "ringed-dot", "ring", "saltire"])
def test_every_kind_to_a_tenth_of_a_pixel__truth(tmp_path: Path, kind: str) -> None:
    result, truth = oriented(tmp_path, Film(kind=kind))
    assert len(result.fiducials) == 4
    assert errors(result, truth).max() < GOAL_PX
    assert result.interior.model == "affine"
    assert [doubt.kind for doubt in result.doubts if doubt.gravity > 0.2] == []


def test_dark_marks_on_light_ground__truth(tmp_path: Path) -> None:
    result, truth = oriented(tmp_path, Film(kind="cross", bright=False))
    assert len(result.fiducials) == 4
    assert errors(result, truth).max() < GOAL_PX


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_turned_scan_is_recognised_by_its_marks__truth(tmp_path: Path, quarter: int) -> None:
    fiducials = {**FIDUCIALS, "3": (26.0, -22.0), "5": (0.0, 27.0)}
    camera = replace(CAMERA, fiducials_mm=fiducials)
    result, truth = oriented(tmp_path, Film(quarter=quarter, fiducials=fiducials), camera)
    assert len(result.fiducials) == 5
    assert errors(result, truth).max() < GOAL_PX


def test_missing_mark_is_a_doubt__truth(tmp_path: Path) -> None:
    result, truth = oriented(tmp_path, Film(missing=("2",)))
    assert {mark.name for mark in result.fiducials} == {"1", "3", "4"}
    assert errors(result, truth).max() < GOAL_PX
    doubt = next(doubt for doubt in result.doubts if doubt.kind == "fiducial-doubtful")
    assert doubt.evidence["fiducial"] == "2"
    assert abs(doubt.evidence["column"] - truth["2"][0]) < 20
    assert result.interior.model == "similarity"


def test_no_marks_are_told_plainly__truth(tmp_path: Path) -> None:
    result, _ = oriented(tmp_path, Film(missing=tuple(FIDUCIALS)))
    kinds = {doubt.kind for doubt in result.doubts}
    assert kinds == {"fiducials-not-found", "interior-nominal"}
    assert result.interior.model == "nominal"
    assert not result.fiducials


def test_one_mark_alone_orients_nothing__truth(tmp_path: Path) -> None:
    result, _ = oriented(tmp_path, Film(missing=("2", "3", "4")))
    assert "interior-nominal" in {doubt.kind for doubt in result.doubts}
    assert result.interior.model == "nominal"


def test_without_certificate_the_frame_is_used__truth(tmp_path: Path) -> None:
    film = Film()
    result, truth = oriented(tmp_path, film, replace(CAMERA, fiducials_mm={}))
    assert result.interior.model == "nominal"
    assert [doubt.kind for doubt in result.doubts] == ["interior-nominal"]
    places = result.interior.film_from_pixel(np.array([truth[name] for name in FIDUCIALS]))
    assert np.abs(places - np.array(list(FIDUCIALS.values()))).max() < 0.4


def test_scratch_across_a_mark_moves_it_little__truth(tmp_path: Path) -> None:
    path = tmp_path / "film.tif"
    film = Film()
    truth = make_film(path, film, 5)
    gray = read_overview(open_scan(path), 1)
    column, row = truth["1"]
    start, end = (int(column) + 12, int(row) - 60), (int(column) + 20, int(row) + 60)
    cv2.line(gray, start, end, 255.0, 2)
    write_gray(path, gray.astype(np.uint8))
    result = orient_scan(path, CAMERA, 40.0)
    worst = errors(result, truth).max()
    assert worst < 0.3


def test_measured_sigmas_are_honest__truth(tmp_path: Path) -> None:
    off, told = [], []
    for seed in (0, 2):
        path = tmp_path / f"{seed}.tif"
        truth = make_film(path, Film(noise=25.0, turn_deg=seed - 1.0), seed)
        scan = open_scan(path)
        marks = measure_fiducials(scan, CAMERA, 0.04, detect_film_area(scan, CAMERA, 0.04)).marks
        assert len(marks) == 4
        for mark in marks:
            off += [mark.column - truth[mark.name][0], mark.row - truth[mark.name][1]]
            told.append(mark.sigma_px)
    assert 0.3 < np.std(off) / np.mean(told) < 2.0


def test_texture_is_not_taken_for_marks__truth(tmp_path: Path) -> None:
    """Chance has its peaks too: a set has to be better than the texture around it."""
    for seed in range(2):
        path = tmp_path / f"{seed}.tif"
        make_film(path, Film(missing=tuple(FIDUCIALS)), seed)
        scan = open_scan(path)
        found = measure_fiducials(scan, CAMERA, 0.04, detect_film_area(scan, CAMERA, 0.04))
        assert not found.marks
        assert [doubt.kind for doubt in found.doubts] == ["fiducials-not-found"]


CERTIFIED = {"5": (0.2, 26.4), "6": (26.7, -0.1), "7": (-0.3, -26.5), "8": (-26.2, 0.3)}
NOTCHED = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=CERTIFIED)


def test_a_lost_mark_is_found_where_the_others_put_it__truth(tmp_path: Path) -> None:
    """And one that is not there stays a doubt, at the place of its name."""
    path = tmp_path / "film.tif"
    film = Film(kind="half-arrow", fiducials=CERTIFIED, mark_size=1.2)
    truth = make_film(path, film, 3)
    scan, pixel_mm = open_scan(path), film.pixel_mm
    area = detect_film_area(scan, NOTCHED, pixel_mm)
    found = measure_fiducials(scan, NOTCHED, pixel_mm, area)
    assert len(found.marks) == 4
    lost = replace(found, marks=tuple(mark for mark in found.marks if mark.name != "7"))
    again = measure_missing_marks(scan, NOTCHED, lost, pixel_mm)
    mark = next(mark for mark in again.marks if mark.name == "7")
    assert np.hypot(mark.column - truth["7"][0], mark.row - truth["7"][1]) < 0.15
