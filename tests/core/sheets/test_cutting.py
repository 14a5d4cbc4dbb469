"""Sheets out of a mosaic: no gap, nothing twice, the same pixels in every format."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from pyproj import Transformer
from rasterio.enums import MaskFlags, Resampling
from rasterio.vrt import WarpedVRT
from shapely.geometry import Polygon, box

from core.errors import CrsError
from core.progress import SILENT
from core.raster.grid import Grid, tiles_of
from core.sheets.cutting import (
    SUFFIXES,
    Form,
    OpenMosaic,
    SheetCut,
    plan_cut,
    sheet_pixels,
    write_sheet,
)
from core.sheets.map_sheets import MapSheet
from core.sheets.pixels import TargetSystem, own_system, target_system

# source: EPSG:5239, the transformation that PROJ takes for Czechia; GDAL by itself takes another.
KROVAK = (
    "+proj=krovak +lat_0=49.5 +lon_0=24.8333333333333 +alpha=30.2881397527778 +k=0.9999 "
    "+x_0=0 +y_0=0 +ellps=bessel +towgs84=570.8,85.7,462.8,4.998,1.587,5.261,3.56 +units=m"
)
AROUND_A_CORNER = {
    "HUST24": box(-582_500, -1_190_000, -580_000, -1_188_000),
    "HUST14": box(-580_000, -1_190_000, -577_500, -1_188_000),
    "HUST25": box(-582_500, -1_192_000, -580_000, -1_190_000),
    "HUST15": box(-580_000, -1_192_000, -577_500, -1_190_000),
}
HUST25 = MapSheet("HUST25", AROUND_A_CORNER["HUST25"])
MEETING = (-580_000.13, -1_190_000.37)
SLANTED = {
    "a": Polygon([(-583e3, -1187e3), (-579_700, -1187e3), MEETING, (-583e3, -1_189_900)]),
    "b": Polygon([(-579_700, -1187e3), (-577e3, -1187e3), (-577e3, -1_190_100), MEETING]),
    "c": Polygon([MEETING, (-577e3, -1_190_100), (-577e3, -1193e3), (-580_200, -1193e3)]),
    "d": Polygon([(-583e3, -1_189_900), MEETING, (-580_200, -1193e3), (-583e3, -1193e3)]),
}
CORNERS = {"four sheets that meet": AROUND_A_CORNER, "slanted sheets": SLANTED}


def scene(path: Path, gsd: float, *, kind: str = "uint8", bands: int = 1, side: int = 900) -> Path:
    """Smooth noise from 1 up; nothing is seen in one corner."""
    rng = np.random.default_rng(7)
    top = np.iinfo(kind).max
    noise = [cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), 2.5) for _ in range(bands)]
    values = np.clip(np.stack(noise) * 1.5 * top + top / 2, 1, top).astype(kind)
    values[:, : side // 5, : side // 4] = 0
    west = np.floor(-580_000 / gsd - 0.55 * side) * gsd
    north = np.floor(-1_190_000 / gsd + 0.45 * side) * gsd
    with rasterio.open(
        path, "w", driver="GTiff", width=side, height=side, count=bands, dtype=kind, nodata=0,
        crs="EPSG:5514", transform=Affine(gsd, 0, west, 0, -gsd, north), tiled=True,
    ) as file:  # fmt: skip
        file.write(values)
    return path


@contextmanager
def opened(path: Path) -> Iterator[OpenMosaic]:
    with rasterio.open(path) as file:
        yield OpenMosaic(file)


def pixels_of(mosaic: OpenMosaic, cut: SheetCut) -> np.ndarray:
    whole = np.zeros((mosaic.file.count, cut.grid.rows, cut.grid.columns), mosaic.dtype)
    for tile in tiles_of(cut.grid, 700):
        column, row, columns, rows = tile
        values = sheet_pixels(mosaic, cut, tile)
        if values is not None:
            whole[:, row : row + rows, column : column + columns] = values
    return whole


def laid_together(
    mosaic: OpenMosaic, system: TargetSystem, areas: Mapping[str, Polygon], frame: Grid
) -> tuple[np.ndarray, np.ndarray]:
    """All sheets on one grid: their sum, and how many show each pixel."""
    total = np.zeros((frame.rows, frame.columns), np.int64)
    count = np.zeros_like(total)
    for name, area in areas.items():
        cut = plan_cut(MapSheet(name, area), mosaic.grid, system)
        values = pixels_of(mosaic, cut)[0]
        corner = frame.grid_from_object(np.array([[cut.grid.west, cut.grid.north]]))[0]
        left, top = np.rint(corner).astype(int)
        assert np.abs(corner - (left, top)).max() < 1e-6, "grids share their pixels"
        across = slice(max(left, 0), min(left + cut.grid.columns, frame.columns))
        down = slice(max(top, 0), min(top + cut.grid.rows, frame.rows))
        part = values[down.start - top : down.stop - top, across.start - left : across.stop - left]
        total[down, across] += part
        count[down, across] += part > 0
    return total, count


@pytest.mark.parametrize("areas", CORNERS.values(), ids=CORNERS)
@pytest.mark.parametrize("gsd", [0.5, 2.0, 1.7, 0.3])
def test_neighbours_leave_no_gap_and_show_nothing_twice__law(
    tmp_path: Path, gsd: float, areas: Mapping[str, Polygon]
) -> None:
    """Edges on pixels, through the centres of pixels (2 m) and anywhere else."""
    with opened(scene(tmp_path / "m.tif", gsd)) as mosaic:
        shown = box(*mosaic.grid.bounds)
        assert sum(area.intersects(shown) for area in areas.values()) == 4
        total, count = laid_together(mosaic, own_system("EPSG:5514"), areas, mosaic.grid)
        covered = shapely.contains_xy(
            shapely.unary_union(list(areas.values())).buffer(-gsd),
            *np.meshgrid(*mosaic.grid.centres()),
        )
        values = mosaic.file.read(1)
    assert count.max() == 1
    assert np.array_equal(total[covered], values[covered])


def test_edges_through_the_centres_of_pixels_are_decided_once__truth(tmp_path: Path) -> None:
    path = scene(tmp_path / "m.tif", 2.0)
    with rasterio.open(path, "r+") as file:
        file.transform = Affine(2, 0, -581_001, 0, -2, -1_189_501)
    with opened(path) as mosaic:
        total, count = laid_together(mosaic, own_system("EPSG:5514"), AROUND_A_CORNER, mosaic.grid)
        assert np.array_equal(total, mosaic.file.read(1))
        assert count.max() == 1
        east = plan_cut(MapSheet("HUST15", AROUND_A_CORNER["HUST15"]), mosaic.grid, own_system(""))
    assert (east.grid.west, east.grid.north) == (-580_001, -1_189_999), "east and south take them"


@pytest.mark.parametrize("areas", CORNERS.values(), ids=CORNERS)
def test_neighbours_meet_in_another_system_too__oracle(
    tmp_path: Path, areas: Mapping[str, Polygon]
) -> None:
    """Beside GDAL's warp of the whole mosaic: every pixel once, gray values to its rounding."""
    with opened(scene(tmp_path / "m.tif", 2.0)) as mosaic:
        system = target_system("EPSG:32633", "EPSG:5514", mosaic.grid.bounds, "here")
        assert system.operation is not None
        ground = shapely.transform(box(*mosaic.grid.bounds), system.operation.forward)
        frame = Grid.over(ground.bounds, 2.0)
        total, count = laid_together(mosaic, system, areas, frame)
        with WarpedVRT(
            mosaic.file, src_crs=KROVAK, crs="EPSG:32633", width=frame.columns,
            height=frame.rows, transform=Affine.from_gdal(*frame.geotransform),
            resampling=Resampling.cubic, tolerance=0.001,
        ) as warped:  # fmt: skip
            theirs = warped.read(1)
    assert count.max() == 1
    both = (theirs > 0) & (total > 0)
    inner = cv2.erode(both.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert inner.sum() > 400_000
    differences = np.abs(total - theirs)[inner]
    # The string lies 8 cm beside the operation; OpenCV samples at steps of a 32nd of a pixel.
    assert np.percentile(differences, 99) <= 4
    assert differences.mean() < 1
    # Nothing is lost but at the rim of what is seen.
    lost = cv2.erode(((theirs > 0) & (total == 0)).astype(np.uint8), np.ones((3, 3), np.uint8))
    assert not lost.any()


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
@pytest.mark.parametrize("bands", [1, 3])
def test_every_format_is_opened_and_holds_the_same__oracle(
    tmp_path: Path, kind: str, bands: int
) -> None:
    with opened(scene(tmp_path / "m.tif", 2.0, kind=kind, bands=bands)) as mosaic:
        cut = plan_cut(HUST25, mosaic.grid, own_system("EPSG:5514"))
        wanted = pixels_of(mosaic, cut)
        for form, suffix in SUFFIXES.items():
            path = tmp_path / f"{form}{suffix}"
            write_sheet(mosaic, cut, form, path, lossy_percent=20, progress=SILENT)
            with rasterio.open(path) as file:
                assert file.crs.to_epsg() == 5514
                assert file.shape == (1000, 1250)
                assert file.bounds == (-582_500, -1_192_000, -580_000, -1_190_000)
                assert file.overviews(1)
                assert np.array_equal(file.dataset_mask() > 0, (wanted != 0).any(axis=0)), form
                values = file.read()
                if form == "jp2-lossy":
                    assert file.nodata is None
                    assert file.mask_flag_enums[0] == [MaskFlags.per_dataset]
                    apart = np.abs(values.astype(int) - wanted)[wanted > 0]
                    assert 0 < apart.mean() < 0.05 * np.iinfo(kind).max
                else:
                    assert file.nodata == 0
                    assert np.array_equal(values, wanted), form


@pytest.mark.parametrize("crs", ["EPSG:5514", "EPSG:5513", "EPSG:32633"])
@pytest.mark.parametrize("form", ["geotiff", "jp2"])
def test_world_files_name_the_centre_of_the_first_pixel__oracle(
    tmp_path: Path, crs: str, form: Form
) -> None:
    """To 1e-6 of what GDAL reads from the file itself."""
    with opened(scene(tmp_path / "m.tif", 2.0)) as mosaic:
        system = target_system(crs, "EPSG:5514", mosaic.grid.bounds, "here")
        cut = plan_cut(HUST25, mosaic.grid, system)
        path = tmp_path / f"sheet{SUFFIXES[form]}"
        write_sheet(mosaic, cut, form, path, lossy_percent=20, progress=SILENT)
    world = path.with_suffix({".tif": ".tfw", ".jp2": ".j2w"}[path.suffix])
    a, d, b, e, c, f = map(float, world.read_text().split())
    with rasterio.open(path) as file:
        own = file.transform
        assert file.crs.to_epsg() == int(crs[5:])
    assert np.allclose((a, b, d, e), (own.a, own.b, own.d, own.e), atol=1e-6, rtol=0)
    assert np.allclose((c, f), own @ (0.5, 0.5), atol=1e-6, rtol=0)


def test_axes_that_count_the_other_way_keep_the_pixels__oracle(tmp_path: Path) -> None:
    """EPSG:5513 counts south and west; PROJ takes every corner to where the file has it."""
    with opened(scene(tmp_path / "m.tif", 2.0)) as mosaic:
        system = target_system("EPSG:5513", "EPSG:5514", mosaic.grid.bounds, "here")
        cut = plan_cut(HUST25, mosaic.grid, system)
        own = plan_cut(HUST25, mosaic.grid, own_system(""))
        assert not system.resampled
        assert np.array_equal(pixels_of(mosaic, cut), pixels_of(mosaic, own))
    to_5513 = Transformer.from_crs(5514, 5513, always_xy=True)
    for column, row in ((0, 0), (1250, 0), (1250, 1000), (0.5, 700)):
        east, north = own.system.transform(own.grid) @ (column, row)
        assert np.allclose(
            system.transform(cut.grid) @ (column, row), to_5513.transform(east, north), atol=1e-6
        )


def test_a_sheet_shows_a_rim_of_its_neighbours_where_it_is_wanted__truth(tmp_path: Path) -> None:
    with opened(scene(tmp_path / "m.tif", 2.0)) as mosaic:
        cut = plan_cut(HUST25, mosaic.grid, own_system("EPSG:5514"), 100.0)
        assert cut.grid.bounds == (-582_600, -1_192_100, -579_900, -1_189_900)
        plain = plan_cut(HUST25, mosaic.grid, own_system("EPSG:5514"))
        inner = pixels_of(mosaic, cut)[:, 50:-50, 50:-50]
        assert np.array_equal(inner, pixels_of(mosaic, plain))


def test_nothing_is_shown_beyond_a_border__truth(tmp_path: Path) -> None:
    border = Polygon([(-580_900, -1_190_000), (-580_000, -1_190_000), (-580_000, -1_191_000)])
    with opened(scene(tmp_path / "m.tif", 2.0)) as mosaic:
        cut = plan_cut(HUST25, mosaic.grid, own_system("EPSG:5514"), 0.0, border)
        assert cut.grid.bounds == HUST25.area.bounds, "the sheet keeps its size"
        plain = plan_cut(HUST25, mosaic.grid, own_system("EPSG:5514"))
        values, seen = (pixels_of(mosaic, one)[0] for one in (cut, plain))
        inside = shapely.contains_xy(border, *np.meshgrid(*cut.grid.centres()))
    assert np.array_equal(values[inside], seen[inside])
    assert not values[~inside].any()
    assert values.any()


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:2263", "EPSG:99999"])
def test_systems_without_metres_are_refused__truth(crs: str) -> None:
    bounds: Any = (-582_500.0, -1_192_000.0, -580_000.0, -1_190_000.0)
    with pytest.raises(CrsError, match=r"does not count in metres|does not know"):
        target_system(crs, "EPSG:5514", bounds, "block.toml [sheets] crs")
