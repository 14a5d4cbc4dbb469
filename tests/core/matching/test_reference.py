"""The reference held in memory is the one on disk; its roads lie on the ground."""

import numpy as np
import shapely

from core.formats.roads import Roads, no_roads
from core.matching.reference import (
    STEP_M,
    USUAL_WIDTH_M,
    WIDTHS_M,
    lines_on_ground,
    open_reference,
)
from core.synthetic.options import CRS


def test_heights_held_in_memory_are_those_on_disk__law(given, placed):
    bounds = placed.block.bounds
    held, whole = open_reference(given.reference, bounds), open_reference(given.reference)
    rng = np.random.default_rng(0)
    places = rng.uniform(bounds[:2], bounds[2:], (200, 2))
    np.testing.assert_allclose(held.dem.heights(places), whole.dem.heights(places), atol=1e-6)


def roads_at(tiny, level=(0, 0, -1)):
    """Three straight roads across the middle of the DEM; widths known, unknown and absurd."""
    west, south, east, north = tiny.reference.dem.bounds
    x, y = (west + east) / 2, (south + north) / 2
    lines = np.array(
        [shapely.LineString([(x, y + d), (x + 300, y + d)]) for d in (0, 50, 100)], dtype=object
    )
    words = np.array(["a"] * 3)
    width = np.array([np.nan, 40.0, 5.0])
    return Roads(CRS, lines, words, words, words, np.array(level), width), (x, y)


def test_lines_follow_the_terrain_and_tunnels_are_not_seen__truth(tiny):
    roads, (x, y) = roads_at(tiny)
    lines = lines_on_ground(roads, tiny.reference.dem)
    assert len(lines.first) == 2
    np.testing.assert_allclose(lines.width_m, [USUAL_WIDTH_M, WIDTHS_M[1]])
    np.testing.assert_allclose(
        lines.points[:, 2], tiny.reference.dem.heights(lines.points[:, :2].copy())
    )
    (only,) = lines.within((x, y - 5, x + 10, y + 5))
    assert only[1] == USUAL_WIDTH_M
    steps = np.linalg.norm(np.diff(only[0][:, :2], axis=0), axis=1)
    assert steps.max() <= STEP_M + 1e-6
    assert lines.within((x, y - 500, x + 10, y - 400)) == []


def test_no_roads_are_no_lines__law(tiny):
    lines = lines_on_ground(no_roads(CRS), tiny.reference.dem)
    assert len(lines.first) == 0
    assert lines.within((-1e7, -1e7, 1e7, 1e7)) == []
