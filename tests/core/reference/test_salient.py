"""Salient points: where they are put, and where not."""

import numpy as np
import pytest
import shapely

from core.matching.reference import Reference
from core.raster.dem import open_dem
from core.raster.grid import Grid
from core.raster.ortho import open_ortho
from core.reference import salient
from core.reference.salient import (
    find_salient_points,
    line_structure,
    self_similarity,
)
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster


def lines_drawn(*segments, size=400, width=3.0, noise=2.0) -> np.ndarray:
    """A gray field with bright lines (column, row to column, row)."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:size, :size] + 0.5
    picture = rng.normal(100, noise, (size, size))
    for (x0, y0), (x1, y1) in segments:
        dx, dy = x1 - x0, y1 - y0
        share = np.clip(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0, 1)
        distance = np.hypot(x - x0 - share * dx, y - y0 - share * dy)
        picture += 80 * np.clip(width - distance, 0, 1)
    return picture.clip(0, 255).astype(np.uint8)


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setattr(salient, "TEMPLATE_PX", 51)

    def made(picture: np.ndarray, heights: np.ndarray | None = None, nodata=None):
        ortho = write_raster(tmp_path / "o.tif", picture, place(1.0), nodata=nodata)
        ground = np.full((100, 100), 200, np.float32) if heights is None else heights
        dem = write_raster(tmp_path / "d.tif", ground, place(4.0), nodata=np.nan)
        return Reference(open_ortho([ortho], CRS), open_dem(dem, CRS), 0.25, 0.5)

    return made


BOUNDS = (WEST, NORTH - 400, WEST + 400, NORTH)
CORNER = [((0, 180), (220, 180)), ((220, 180), (220, 399))]


def pixels(points) -> np.ndarray:
    return np.array([[p.position[0] - WEST, NORTH - p.position[1]] for p in points])


def test_a_bend_is_found_and_a_straight_road_is_not__truth(scene, monkeypatch):
    monkeypatch.setattr(salient, "LEAST_ROUNDNESS", 0.3)
    reference = scene(lines_drawn(*CORNER, ((0, 60), (399, 60))))
    points = find_salient_points(reference, BOUNDS, 400.0)
    (at,) = pixels(points)
    assert np.hypot(*(at - [220, 180])) < 30
    assert points[0].position[2] == 200
    assert points[0].point_id.startswith("S")
    road = scene(lines_drawn(((0, 60), (399, 60)), ((0, 300), (399, 310))))
    assert not find_salient_points(road, BOUNDS, 400.0)


def test_busy_woods_come_after_a_bend__truth(scene):
    picture = lines_drawn(*CORNER).astype(float)
    rng = np.random.default_rng(1)
    picture[220:, :200] += rng.normal(0, 50, (180, 200))
    reference = scene(picture.clip(0, 255).astype(np.uint8))
    (best,) = find_salient_points(reference, BOUNDS, 400.0)
    assert np.hypot(*(pixels([best])[0] - [220, 180])) < 40


def test_a_pattern_that_repeats_is_refused__truth(scene):
    y, x = np.mgrid[:400, :400]
    orchard = (100 + 80 * ((x % 20 < 4) | (y % 20 < 4))).astype(np.uint8)
    assert not find_salient_points(scene(orchard), BOUNDS, 200.0)
    assert self_similarity(orchard.astype(np.float32), 200, 200) > 0.95
    alone = lines_drawn(*CORNER).astype(np.float32)
    assert self_similarity(alone, 220, 180) < 0.8


def test_points_are_spread_and_spare_cells_with_junctions__truth(scene):
    rng = np.random.default_rng(3)
    segments = [tuple(map(tuple, rng.uniform(0, 400, (2, 2)))) for _ in range(25)]
    reference = scene(lines_drawn(*segments))
    points = find_salient_points(reference, BOUNDS, 100.0)
    cells = {tuple(cell) for cell in (pixels(points) // 100).astype(int).tolist()}
    assert len(cells) == len(points) >= 8
    taken = points[0]
    fewer = find_salient_points(reference, BOUNDS, 100.0, existing=taken.position[None, :2])
    here = tuple((pixels([taken])[0] // 100).astype(int))
    assert here not in {tuple(cell) for cell in (pixels(fewer) // 100).astype(int).tolist()}
    away = np.hypot(*(pixels(fewer) - pixels([taken])[0]).T)
    assert away.min() > 20


def test_mask_nodata_and_gaps_of_the_dem_are_avoided__truth(scene):
    rng = np.random.default_rng(3)
    segments = [tuple(map(tuple, rng.uniform(0, 400, (2, 2)))) for _ in range(25)]
    picture = lines_drawn(*segments)
    picture[:, :150] = 0
    heights = np.full((100, 100), 200, np.float32)
    heights[60:] = np.nan
    reference = scene(picture, heights, nodata=0)
    mask = shapely.box(WEST + 300, NORTH - 400, WEST + 400, NORTH)
    at = pixels(find_salient_points(reference, BOUNDS, 100.0, mask=mask))
    assert len(at)
    # With a template of 51 pixels of which 95 % must be usable.
    assert at[:, 0].min() > 150 + 20
    assert at[:, 0].max() < 300 - 20
    assert at[:, 1].max() < 240 - 25


def test_measures_do_not_hang_on_brightness_and_contrast__law():
    gray = lines_drawn(*CORNER).astype(np.float32)
    usable = np.ones(gray.shape, bool)
    one = line_structure(gray, usable)
    other = line_structure(60 + 0.25 * gray, usable)
    np.testing.assert_allclose(other[0], one[0], atol=1e-3)
    np.testing.assert_allclose(other[1], one[1], atol=1e-2)


def test_nothing_where_the_reference_does_not_reach__truth(scene):
    reference = scene(lines_drawn(*CORNER))
    far = (WEST + 5000, NORTH, WEST + 6000, NORTH + 1000)
    assert find_salient_points(reference, far, 200.0) == ()


@pytest.mark.parametrize("crs", ["lo25", "EPSG:32735"])
def test_sentinel_2_gives_points_everywhere__real(shared_data, crs, monkeypatch):
    monkeypatch.setattr(salient, "TEMPLATE_PX", 31)
    folder = shared_data / "ngi-baviaanskloof"
    block = (folder / "io" / "ngi_xyz_opk.prj").read_text() if crs == "lo25" else crs
    ortho = open_ortho([folder / "reference" / "sentinel2_b432_byte.tif"], block)
    dem = open_dem(folder / "frames" / "dem.tif", block)
    points = find_salient_points(Reference(ortho, dem, 10.0, 5.0), dem.bounds, 500.0)
    # 8 km x 12 km in cells of 500 m, most with a point.
    grid = Grid.over(dem.bounds, 500.0)
    places = np.array([point.position[:2] for point in points])
    cells = {tuple(cell) for cell in grid.grid_from_object(places).astype(int).tolist()}
    assert len(cells) > 0.5 * 16 * 24
    assert all(np.isfinite(point.position).all() for point in points)
    assert len({point.point_id for point in points}) == len(points)
