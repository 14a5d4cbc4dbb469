"""Marks of kinds that no list knows at the places that a certificate gives."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.doubts import Failure
from core.geometry.camera import Camera
from core.raster.scan_file import open_scan
from core.scans.centring import centre_by_likeness
from core.scans.certified import measure_certified
from core.scans.fiducials import GUESSED, measure_unknown_fiducials
from core.scans.film_area import detect_film_area
from core.scans.judging import FiducialSet
from tests.core.scans.film_maker import FIDUCIALS, Film, make_film, write_gray

CAMERA = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=FIDUCIALS)
SIDES = {"5": (0.0, 27.0), "6": (27.0, 0.0), "7": (0.0, -27.0), "8": (-27.0, 0.0)}
PIXEL_MM = 0.04
LOOSE_PX = 0.4
"""What has no middle of its own is centred alike everywhere, but not where it was drawn."""


def doubted(found: FiducialSet) -> set[str]:
    """Names of marks that the operator is told to look at."""
    return {str(doubt.evidence["fiducial"]) for doubt in found.doubts}


def _gray(path: Path) -> np.ndarray:
    gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert gray is not None
    return gray


@pytest.mark.parametrize("scale", [1.0, 0.93])
def test_unlisted_marks_are_taken_where_the_certificate_has_them__truth(
    tmp_path: Path, scale: float
) -> None:
    truth = make_film(tmp_path / "film.tif", Film(kind="chevrons"), 1)
    certified = {name: (scale * x, scale * y) for name, (x, y) in FIDUCIALS.items()}
    camera, scan = replace(CAMERA, fiducials_mm=certified), open_scan(tmp_path / "film.tif")
    area = detect_film_area(scan, camera, PIXEL_MM)
    found, others = measure_certified(scan, camera, PIXEL_MM, area)
    assert len(others.marks) == 4
    if scale != 1:
        assert len(found.marks) < 3, "one that looks like a mark by chance is no set"
        return
    assert {mark.name for mark in found.marks} == set(truth) == doubted(found)
    for mark in found.marks:
        assert np.hypot(*np.subtract(mark.place, truth[mark.name])) < LOOSE_PX


@pytest.mark.parametrize("kind", ["chevrons", "dot"])
def test_dots_beside_marks_are_not_taken_for_them_however_well_they_fit__truth(
    tmp_path: Path, kind: str
) -> None:
    # Dots beside the marks of a square lie as certified as well, enlarged and turned: its marks go
    # before them, and where there are none they are doubted.
    turned = {n: 1.012 * complex(*at) * np.exp(2j * np.pi / 180) for n, at in FIDUCIALS.items()}
    beside = {name: (at.real, at.imag) for name, at in turned.items()}
    path, film = tmp_path / "film.tif", Film(kind=kind)
    dots = make_film(path, replace(film, kind="dot", fiducials=beside), 1)
    truth = dots
    if kind != "dot":
        gray, truth = _gray(path), make_film(path, film, 1)
        both = _gray(path)
        for column, row in dots.values():
            part = (slice(int(row) - 9, int(row) + 9), slice(int(column) - 9, int(column) + 9))
            both[part] = gray[part]
        write_gray(path, both)
    scan = open_scan(path)
    area = detect_film_area(scan, CAMERA, PIXEL_MM)
    found, _ = measure_certified(scan, CAMERA, PIXEL_MM, area)
    assert {mark.name for mark in found.marks} == set(dots) == doubted(found)
    for mark in found.marks:
        assert np.hypot(*np.subtract(mark.place, truth[mark.name])) < LOOSE_PX


def test_what_nobody_showed_nor_certified_is_doubted_where_much_is_like_it__law(
    tmp_path: Path,
) -> None:
    # The foot of a half arrow is a half arrow as well: only a person knows which is the mark.
    make_film(tmp_path / "film.tif", Film(kind="half-arrow", fiducials=SIDES), 1)
    scan, camera = open_scan(tmp_path / "film.tif"), replace(CAMERA, fiducials_mm={})
    area = detect_film_area(scan, camera, PIXEL_MM)
    found = measure_unknown_fiducials(scan, camera, PIXEL_MM, area)
    guessed = {mark.name for mark in found.marks if mark.kind in GUESSED}
    assert len(guessed) >= 3
    assert guessed <= doubted(found)


def test_the_negative_of_an_example_is_not_like_it__truth() -> None:
    column, row = np.meshgrid(*2 * (np.arange(41.0) - 20,))
    blob = 200 * np.exp(-(column**2 + row**2 + column * row) / 40)
    negative = np.pad(200 - blob, 12, mode="edge").astype(np.float32)
    found = centre_by_likeness(negative, (32.5, 32.5), 2.0, blob, None)
    assert isinstance(found, Failure)
