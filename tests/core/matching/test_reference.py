"""The reference held in memory is the one on disk; its roads lie on the ground."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from core.block import ShiftedReference
from core.formats.roads import Roads, no_roads
from core.matching.reference import (
    STEP_M,
    USUAL_WIDTH_M,
    WIDTHS_M,
    ReferenceFiles,
    ReferenceLayer,
    lines_on_ground,
    open_reference,
)
from core.raster.grid import Grid
from core.synthetic.options import CRS
from tests.core.raster_files import CRS as PLANE
from tests.core.raster_files import NORTH, WEST, place, write_raster


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


def test_each_layer_serves_where_those_before_it_have_nothing__law(tmp_path: Path) -> None:
    """An old ortho of coarse pixels over the west, today's fine one over all."""
    old = write_raster(tmp_path / "old.tif", np.full((50, 50), 60, np.uint8), place(2.0))
    today = write_raster(tmp_path / "today.tif", np.full((200, 400), 180, np.uint8), place(0.5))
    hill = write_raster(tmp_path / "hill.tif", np.full((10, 10), 300, np.float32), place(10.0))
    plain = write_raster(tmp_path / "plain.tif", np.full((100, 200), 250, np.float32), place(1.0))
    layers = (
        ReferenceLayer("old", (old,), (), 1.5, 0.5),
        ReferenceLayer("hill", (), (hill,), 0.25, 4.0),
        ReferenceLayer("today", (today,), (plain,), 0.3, 0.6, datum=True),
    )
    files = ReferenceFiles(PLANE, (today,), (plain,), ortho_sigma_m=0.3, dem_sigma_m=0.6)
    files = replace(files, layers=layers)
    reference = open_reference(files)
    west, east, beyond = (np.array([[WEST + x, NORTH - 50.0]]) for x in (50.0, 150.0, 500.0))
    plan = np.vstack([west, east, beyond])
    assert reference.layers_at(plan).tolist() == [[0, 1], [2, 2], [-1, -1]]
    assert reference.sigmas_m(plan).tolist() == [[1.5, 4.0], [0.3, 0.6], [0.3, 0.6]]
    seen = reference.ortho.read(Grid(WEST, NORTH, 1.0, 200, 100)).values
    # Kernels reach over the rim of the old ortho.
    assert seen[8:-8, 8:92] == pytest.approx(60, abs=1e-3)
    assert seen[8:-8, 108:-8] == pytest.approx(180, abs=1e-3)
    heights = reference.dem.heights(plan)
    assert heights[:2].tolist() == [300, 250]
    assert np.isnan(heights[2])
    assert reference.dem.ground_sample_distance_m == 1.0
    assert reference.ortho.ground_sample_distance_m == 0.5
    ((old_one, alone), (_, datum)) = files.each_alone
    assert (old_one.shifted, layers[2].shifted) == (ShiftedReference("old", (1.5, 1.5, 0.0)), None)
    assert [files.roads_drawn for files in (alone, datum)] == [False, True]
    alone = open_reference(alone)
    assert alone.layers_at(plan).tolist() == [[0, 1], [-1, 2], [-1, -1]]
    assert alone.ortho.ground_sample_distance_m == 2.0
    here = open_reference(files, (WEST + 120, NORTH - 90, WEST + 180, NORTH - 10))
    assert [layer.name for layer in here.layers] == ["today"]
