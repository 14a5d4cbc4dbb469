"""One mark that is shown on real film finds the others; judged by marks read by eye beforehand."""

from pathlib import Path

import numpy as np
import pytest

from core.raster.scan_file import open_scan
from core.scans.copies import mark_shown_at, measure_like
from core.scans.film_area import detect_film_area
from tests.benchmarks.marks_by_eye import read_seen
from tests.benchmarks.prove_canberra import PIXEL_UM, camera_of

GOAL_PX = 1.0
"""An eye reads marks of these coarse scans to half a pixel."""


@pytest.mark.parametrize(
    ("frame", "shown"),
    [("1961_r01_f1", "UL"), ("1972_r01_f85", "UR"), ("1985_r14_f100", "L"), ("1985_r12_f30", "R")],
)
def test_one_shown_mark_finds_the_others__real(shared_data: Path, frame: str, shown: str) -> None:
    """Dim crosses, dark corners, and notches of the picture into the frame."""
    group = ("UL", "UR", "LR", "LL") if len(shown) == 2 else ("T", "R", "B", "L")
    seen = {mark.name: mark for mark in read_seen()["frames"][frame].marks if mark.name in group}
    scan = open_scan(shared_data / "act-canberra-film" / "frames" / f"{frame}.jpg")
    camera, pixel_mm = camera_of(frame), PIXEL_UM.get(frame[:4], 25400 / 200) / 1000
    area = detect_film_area(scan, camera, pixel_mm)
    place = seen[shown].column, seen[shown].row
    found = measure_like(scan, camera, pixel_mm, area, mark_shown_at(scan, area, place, pixel_mm))
    assert {mark.name for mark in found.marks} == set(seen)
    for mark in found.marks:
        eye = seen[mark.name]
        assert np.hypot(mark.column - eye.column, mark.row - eye.row) < GOAL_PX
