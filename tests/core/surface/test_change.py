"""Differences of two surfaces: what was planted is found, what is systematic is not."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from core.raster.dem import open_dem
from core.surface.change import DatedSurface, compare_surfaces
from core.surface.ground import NODATA_M
from tests.core.raster_files import CRS, place, write_raster

SIDE, CELL_M, SIGMA_M = 300, 2.0, 0.5
CUT, FILL = np.s_[60:100, 50:90], np.s_[180:200, 200:240]


def surface(folder: Path, name: str, heights: np.ndarray, sigma_m: float = SIGMA_M) -> DatedSurface:
    sigmas = np.where(heights == NODATA_M, NODATA_M, sigma_m).astype(np.float32)
    paths = [folder / f"{name}.tif", folder / f"{name}_sigma.tif"]
    for path, values in zip(paths, (heights.astype(np.float32), sigmas), strict=True):
        write_raster(path, values, place(CELL_M), nodata=NODATA_M)
    return DatedSurface(open_dem(paths[0], CRS), open_dem(paths[1], CRS))


def compared(folder: Path, earlier: DatedSurface, later: DatedSurface):
    bounds = later.heights.bounds
    return compare_surfaces(earlier, later, bounds, folder / "away.tif", CRS)


def pair(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights of two epochs: noise of each, and a tilt and a bowl between them."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[-1 : 1 : SIDE * 1j, -1 : 1 : SIDE * 1j]
    ground = 300 + 20 * x * y
    first, second = (ground + rng.normal(0, SIGMA_M, ground.shape) for _ in range(2))
    return first, second + 1.5 + 2 * x - y + 1.2 * (x**2 + y**2)


def test_cut_and_fill_are_found_with_area_and_volume__truth(tmp_path: Path) -> None:
    first, second = pair(9224)
    second[CUT] -= 4.0
    second[FILL] += 3.0
    first[150:160, :] = NODATA_M
    one, other = surface(tmp_path, "1938", first), surface(tmp_path, "1953", second)
    found = compared(tmp_path, one, other)
    assert found is not None
    assert found.compared_m2 == (SIDE - 10) * SIDE * CELL_M**2
    assert found.trend.coefficients == pytest.approx([1.5, 2.0, 1.0, 1.2], abs=0.1)
    lowered, raised = found.areas
    assert lowered.volume_m3 == pytest.approx(-4.0 * 1600 * CELL_M**2, rel=0.08)
    assert raised.volume_m3 == pytest.approx(3.0 * 800 * CELL_M**2, rel=0.08)
    assert lowered.sigma_m == pytest.approx(np.sqrt(2) * SIGMA_M)
    west, north = other.heights.bounds[0], other.heights.bounds[3]
    true = shapely.box(west + 100, north - 200, west + 180, north - 120)
    both = lowered.outline.intersection(true).area / lowered.outline.union(true).area
    assert both > 0.85
    back = compared(tmp_path, other, one)
    assert back is not None
    assert back.areas[0].volume_m3 == pytest.approx(-lowered.volume_m3)


def test_nothing_is_found_where_nothing_changed__law(tmp_path: Path) -> None:
    """Also where both state to know more than they do."""
    for seed, stated_m in ((9225, SIGMA_M), (9226, 0.2 * SIGMA_M)):
        one, other = (
            surface(tmp_path, f"{seed}{n}", heights, stated_m)
            for n, heights in enumerate(pair(seed))
        )
        found = compared(tmp_path, one, other)
        assert found is not None
        assert found.areas == ()
