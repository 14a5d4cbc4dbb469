"""Marks that were lost from afar and are found where the others put them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from core.geometry.camera import Camera
from core.raster.scan_file import open_scan
from core.scans.fiducials import measure_fiducials
from core.scans.film_area import detect_film_area
from core.scans.judging import FiducialOptions
from core.scans.mark_recovery import looked_again
from tests.core.scans.film_maker import Film, make_film

CERTIFIED = {"5": (0.2, 26.4), "6": (26.7, -0.1), "7": (-0.3, -26.5), "8": (-26.2, 0.3)}
CAMERA = Camera("little", 60.0, (60.0, 60.0), fiducials_mm=CERTIFIED)


def test_a_lost_mark_is_found_where_the_others_put_it__truth(tmp_path: Path) -> None:
    """And one that is not there stays a doubt, at the place of its name."""
    path = tmp_path / "film.tif"
    film = Film(kind="half-arrow", fiducials=CERTIFIED, mark_size=1.2)
    truth = make_film(path, film, 3)
    scan, pixel_mm = open_scan(path), film.pixel_mm
    area = detect_film_area(scan, CAMERA, pixel_mm)
    found = measure_fiducials(scan, CAMERA, pixel_mm, area)
    assert len(found.marks) == 4
    lost = replace(found, marks=tuple(mark for mark in found.marks if mark.name != "7"))
    again = looked_again(scan, CAMERA, lost, pixel_mm, FiducialOptions())
    mark = next(mark for mark in again.marks if mark.name == "7")
    assert np.hypot(mark.column - truth["7"][0], mark.row - truth["7"][1]) < 0.15
