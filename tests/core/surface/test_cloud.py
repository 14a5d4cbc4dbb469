"""Point clouds of surfaces, read by laspy."""

import subprocess
import sys
from dataclasses import astuple
from pathlib import Path

import laspy
import numpy as np
import pytest

from core.errors import ProjectError
from core.progress import Work
from core.surface import cloud
from core.surface.cloud import check_cloud_writer, write_cloud
from tests.core.surface.rasters import CELL_M, CRS, NORTH, WEST, grid_of, written


@pytest.fixture(scope="module")
def heights() -> np.ndarray:
    """Hills of 140 m, higher than a node of the finest depth is, with a hole."""
    row, column = np.mgrid[0:900, 0:700]
    surface = 300 + 80 * np.sin(row / 300) + 60 * np.cos(column / 200)
    surface[100:150, 200:260] = np.nan
    return surface


@pytest.fixture(scope="module")
def made(heights, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("surface")
    path = folder / "surface.copc.laz"
    assert (
        write_cloud(path, written(folder, heights), grid_of(heights), CRS, Work())
        == np.isfinite(heights).sum()
    )
    return path


def cells_of(points) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the cell in whose middle a point stands."""
    column = (np.array(points.x) - WEST) / CELL_M - 0.5
    row = (NORTH - np.array(points.y)) / CELL_M - 0.5
    assert np.abs(column - np.rint(column)).max() < 0.001
    assert np.abs(row - np.rint(row)).max() < 0.001
    return np.rint(row).astype(int), np.rint(column).astype(int)


def test_every_known_cell_is_a_point_once__oracle(heights, made):
    points = laspy.read(made)
    row, column = cells_of(points)
    seen = np.zeros(heights.shape, dtype=int)
    np.add.at(seen, (row, column), 1)
    assert (seen == np.isfinite(heights)).all()
    assert np.abs(np.array(points.z) - heights[row, column]).max() < 0.0006
    assert np.allclose(points.sigma_z, 0.1 + row / 10_000, atol=1e-6)
    assert (np.array(points.user_data) == 1 + row % 5).all()
    head = points.header
    assert head.parse_crs().to_epsg() == 5514
    assert head.point_count == head.number_of_points_by_return[0] == len(points)
    assert head.mins == pytest.approx([points.x.min(), points.y.min(), points.z.min()])
    assert head.maxs == pytest.approx([points.x.max(), points.y.max(), points.z.max()])


def test_depths_are_coarser_surfaces_and_parts_are_read_alone__oracle(heights, made):
    with laspy.CopcReader.open(str(made)) as reader:
        row, column = cells_of(reader.query(level=0))
        coarse = np.isfinite(heights[::4, ::4])
        assert len(row) == coarse.sum()
        assert ((row % 4 == 0) & (column % 4 == 0)).all()
        half = reader.query(resolution=2 * CELL_M)
        assert len(half) == np.isfinite(heights[::2, ::2]).sum()
        corner = np.array([WEST + 100, NORTH - 200])
        part = reader.query(laspy.Bounds(corner, corner + 40))
        row, column = cells_of(part)
        east, north = WEST + (column + 0.5) * CELL_M, NORTH - (row + 0.5) * CELL_M
        assert ((east >= corner[0]) & (east <= corner[0] + 40)).all()
        assert ((north >= corner[1]) & (north <= corner[1] + 40)).all()
        assert len(part) == 50 * 50


def test_the_same_surface_gives_the_same_bytes__law(heights, made, tmp_path):
    again = tmp_path / "again.copc.laz"
    write_cloud(again, written(tmp_path, heights), grid_of(heights), CRS, Work())
    assert again.read_bytes() == made.read_bytes()


@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
def test_a_disk_that_is_full_is_an_error__law(heights, made, tmp_path, share):
    """A process that may write no longer files, as on a full disk."""
    written(tmp_path, heights)
    most = int(made.stat().st_size * share)
    program = f"""
import resource, signal
from pathlib import Path
from core.progress import Work
from core.raster.grid import Grid
from core.surface.cloud import write_cloud
from core.surface.stage import SurfaceFiles
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({most}, resource.RLIM_INFINITY))
folder = Path({str(tmp_path)!r})
try:
    grid = Grid(*{astuple(grid_of(heights))})
    write_cloud(folder / "full.copc.laz", SurfaceFiles.within(folder), grid, {CRS!r}, Work())
except OSError:
    print("told")
"""
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False
    )
    assert run.stdout == "told\n", run.stderr


def test_steps_longer_than_a_band_of_the_file_keep_their_places__oracle(tmp_path, monkeypatch):
    """As of a surface of more than a hundred thousand cells."""
    monkeypatch.setattr(cloud, "NODE_CELLS", 4)
    heights = np.add.outer(np.arange(2100.0) / 10, np.arange(8.0))
    path = tmp_path / "surface.copc.laz"
    write_cloud(path, written(tmp_path, heights), grid_of(heights), CRS, Work())
    points = laspy.read(path)
    row, column = cells_of(points)
    assert len({*zip(row.tolist(), column.tolist(), strict=True)}) == heights.size
    assert np.abs(np.array(points.z) - heights[row, column]).max() < 0.0006
    with laspy.CopcReader.open(str(path)) as reader:
        row, _ = cells_of(reader.query(level=0))
    assert sorted({*row.tolist()}) == [0, 1024, 2048]


def test_without_its_libraries_it_says_what_to_install__law(monkeypatch):
    check_cloud_writer(Path("block.toml"))
    monkeypatch.setattr(cloud, "find_spec", lambda name: None)
    with pytest.raises(ProjectError, match=r"block\.toml.*laspy and lazrs"):
        check_cloud_writer(Path("block.toml"))
