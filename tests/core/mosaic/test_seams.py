"""Seams divide what the photos show by nearest nadir."""

import numpy as np
import pytest
import shapely

from core.mosaic.overview import read_overview
from core.mosaic.seams import area_of, draw_seams, read_seams, write_seams
from tests.core.mosaic.conftest import CRS


def test_seams_are_a_partition_by_nearest_nadir__truth(block):
    views = [read_overview(ortho, 8) for ortho in block]
    seams = draw_seams([area_of(view) for view in views], {"a": "1938-07-09"})
    assert seams[0].date == "1938-07-09"
    areas = [seam.area for seam in seams]
    whole = shapely.union_all(areas)
    assert sum(area.area for area in areas) == pytest.approx(whole.area, rel=1e-9)
    rng = np.random.default_rng(3)
    west, south, east, north = whole.bounds
    nadirs = np.array([ortho.nadir for ortho in block])
    for place in rng.uniform((west, south), (east, north), (300, 2)):
        point = shapely.Point(place)
        inside = [k for k, view in enumerate(views) if _well_inside(view, place, 20.0)]
        if not inside:
            continue
        nearest = inside[int(np.argmin(np.linalg.norm(nadirs[inside] - place, axis=1)))]
        others = np.linalg.norm(nadirs - place, axis=1)
        if len(inside) == 4 or np.argmin(others) == nearest:
            assert areas[nearest].distance(point) < 1e-6


def _well_inside(view, place, distance):
    ring = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)]
    cells = view.grid.grid_from_object(place + distance * np.array(ring, dtype=float)).astype(int)
    if (cells < 0).any() or (cells >= [view.grid.columns, view.grid.rows]).any():
        return False
    return bool(view.full[cells[:, 1], cells[:, 0]].all())


def test_seams_are_read_back__law(block, tmp_path):
    seams = draw_seams([area_of(read_overview(ortho, 8)) for ortho in block], {"b": "1938"})
    write_seams(seams, tmp_path / "seams.gpkg", CRS)
    again = read_seams(tmp_path / "seams.gpkg")
    assert [(s.photo_id, s.date) for s in again] == [(s.photo_id, s.date) for s in seams]
    assert all(a.area.equals(b.area) for a, b in zip(again, seams, strict=True))
