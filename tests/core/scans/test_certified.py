"""Marks of kinds that no list knows at the places that a certificate gives."""

from dataclasses import replace
from pathlib import Path

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
from tests.core.scans.film_maker import FIDUCIALS, Film, make_film

CAMERA = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=FIDUCIALS)
SIDES = {"5": (0.0, 27.0), "6": (27.0, 0.0), "7": (0.0, -27.0), "8": (-27.0, 0.0)}
PIXEL_MM = 0.04
LOOSE_PX = 0.4
"""What has no middle of its own is centred alike everywhere, but not where it was drawn."""


def doubted(found: FiducialSet) -> set[str]:
    """Names of marks that the operator is told to look at."""
    return {str(doubt.evidence["fiducial"]) for doubt in found.doubts}


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
