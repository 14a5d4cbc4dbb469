"""Contour lines of a surface whose lines are known: a cone of circles."""

from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from core.progress import Work
from core.surface.contours import write_contours
from tests.core.surface.rasters import CELL_M, CRS, NORTH, WEST, grid_of, written

TOP_M, FALL, INTERVAL_M = 500.0, 0.2, 10.0
SIDE = 1100
"""Cells; the lines pass from one block of the file to the next."""


def cone() -> np.ndarray:
    """500 m at its top in the middle, one in five."""
    row, column = np.mgrid[0:SIDE, 0:SIDE] - (SIDE - 1) / 2
    return TOP_M - FALL * np.hypot(row, column) * CELL_M


def lines_of(folder: Path, heights: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    path = folder / "surface_contours.gpkg"
    files = written(folder, heights)
    count = write_contours(path, files.surface, grid_of(heights), INTERVAL_M, crs=CRS, work=Work())
    meta, _, geometries, fields = pyogrio.raw.read(path, layer="contours")
    assert len(geometries) == count
    assert meta["crs"] == CRS
    return shapely.from_wkb(geometries), dict(zip(meta["fields"], fields, strict=True))


def test_lines_of_a_cone_are_circles__truth(tmp_path):
    lines, fields = lines_of(tmp_path, cone())
    middle = shapely.Point(WEST + SIDE * CELL_M / 2, NORTH - SIDE * CELL_M / 2)
    whole = (TOP_M - fields["height"]) / FALL < SIDE * CELL_M / 2 - 3 * CELL_M
    assert sorted(fields["height"][whole]) == [
        420.0,
        430.0,
        440.0,
        450.0,
        460.0,
        470.0,
        480.0,
        490.0,
    ]
    for line, height in zip(lines[whole], fields["height"][whole], strict=True):
        radius = (TOP_M - height) / FALL
        assert line.is_closed
        away = np.array([middle.distance(shapely.Point(place)) for place in line.coords])
        # The smoothing lowers a cone by half its variance over the radius.
        assert np.abs(away - radius).max() < 0.2
        assert line.length == pytest.approx(2 * np.pi * radius, rel=0.002)
    assert set(fields["height"][fields["bold"] == 1]) == {400.0, 450.0}


def test_lines_end_at_holes_and_grain_draws_none__truth(tmp_path):
    heights = cone()
    heights[400:700, 700:1100] = np.nan
    heights += np.random.default_rng(3).normal(0, 0.5, heights.shape)
    lines, _ = lines_of(tmp_path, heights)
    hole = shapely.box(
        WEST + 700 * CELL_M, NORTH - 700 * CELL_M, WEST + 1100 * CELL_M, NORTH - 400 * CELL_M
    )
    assert not any(line.intersects(hole.buffer(-CELL_M)) for line in lines)
    # Unsmoothed, half a metre of grain on a slope of one in five draws thousands of rings.
    assert len(lines) < 40
