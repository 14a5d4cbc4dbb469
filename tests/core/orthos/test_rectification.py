"""Orthos of a ground whose every gray value is known."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.enums import ColorInterp
from shapely.geometry import box

from core.errors import Cancelled
from core.geometry.camera import Camera
from core.orthos.rectification import (
    OrthoOptions,
    area_within,
    footprint_of,
    ortho_grid,
    rectify_photo,
)
from core.raster.grid import Grid

CRS = "EPSG:32633"
KINDS = [ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.undefined]


def read(path):
    with rasterio.open(path) as file:
        return file.read(1)


def shifts_in_blocks(values, truth, block=64):
    """Shift (column, row, pixels) of each full block against the truth, by its gradients."""
    rise, run = np.gradient(truth)
    shifts = []
    for row in range(0, values.shape[0] - block, block):
        for column in range(0, values.shape[1] - block, block):
            part = np.s_[row : row + block, column : column + block]
            if not values[part].all():
                continue
            slopes = np.column_stack([run[part].ravel(), rise[part].ravel(), np.ones(block**2)])
            difference = values[part].astype(float).ravel() - truth[part].ravel()
            shifts.append(-np.linalg.lstsq(slopes, difference, rcond=None)[0][:2])
    return np.array(shifts)


def test_ortho_shows_every_detail_where_it_is__truth(scene, middle, ground, tmp_path):
    product = rectify_photo(middle, scene.camera, scene.dem, 0.6, tmp_path / "o.tif", CRS)
    values, truth = read(product.path), ground["texture_on"](product.grid)
    shifts = shifts_in_blocks(values, truth)
    assert len(shifts) > 60
    assert np.abs(shifts).max() < 0.05
    assert np.abs(shifts.mean(axis=0)).max() < 0.01
    inside = values > 0
    inner = np.abs(values.astype(float) - truth)[inside]
    assert np.sqrt(np.mean(inner**2)) < 2.0
    assert 0.6 < product.covered_share < 0.9


def test_coarse_ortho_is_the_mean_of_the_ground__truth(scene, middle, ground, tmp_path):
    product = rectify_photo(middle, scene.camera, scene.dem, 3.0, tmp_path / "o.tif", CRS)
    fine = Grid(
        *product.grid.bounds[:1],
        product.grid.north,
        0.3,
        product.grid.columns * 10,
        product.grid.rows * 10,
    )
    truth = ground["texture_on"](fine).reshape(product.grid.rows, 10, -1, 10).mean(axis=(1, 3))
    values = read(product.path)
    inside = values > 0
    assert np.sqrt(np.mean((values - truth)[inside] ** 2)) < 6.0
    assert np.abs(shifts_in_blocks(values, truth, 32)).max() < 0.1


def test_sixteen_bit_scan_stays_sixteen_bit__truth(scene, ground, tmp_path):
    photo = scene.photo("deep", bits=16)
    product = rectify_photo(photo, scene.camera, scene.dem, 1.2, tmp_path / "o.tif", CRS)
    values = read(product.path)
    assert values.dtype == np.uint16
    truth = ground["texture_on"](product.grid) * 257
    assert abs(np.mean((values - truth)[values > 0])) < 257


def test_windows_of_a_large_scan_give_the_same_ortho__law(scene, middle, tmp_path):
    memory = OrthoOptions(tile_px=256)
    windows = OrthoOptions(tile_px=256, scan_budget_bytes=0)
    for gsd in (0.6, 1.5):
        grids = [
            read(
                rectify_photo(
                    middle, scene.camera, scene.dem, gsd, tmp_path / name, CRS, options=options
                ).path
            )
            for name, options in (("a.tif", memory), ("b.tif", windows))
        ]
        assert np.array_equal(*grids)


def test_tiles_do_not_show__law(scene, middle, tmp_path):
    grid = Grid.over((499_900.0, 4_099_900.0, 500_100.0, 4_100_100.0), 0.5)
    small, large = (
        read(
            rectify_photo(
                middle,
                scene.camera,
                scene.dem,
                grid,
                tmp_path / f"{side}.tif",
                CRS,
                options=OrthoOptions(tile_px=side),
            ).path
        )
        for side in (100, 1024)
    )
    assert np.abs(small.astype(int) - large.astype(int)).max() <= 4


def test_nothing_where_the_dem_has_a_hole__truth(scene, middle, ground, tmp_path):
    holed = replace(scene.dem, hole=(500_050.0, 4_100_020.0, 40.0))
    product = rectify_photo(middle, scene.camera, holed, 0.6, tmp_path / "o.tif", CRS)
    values = read(product.path)
    east, north = np.meshgrid(*product.grid.centres())
    distance = np.hypot(east - 500_050.0, north - 4_100_020.0)
    assert not values[distance < 40].any()
    assert values[(distance > 50) & (distance < 100)].all()


def test_edge_marks_and_unusable_parts_are_left_out__truth(scene, middle, tmp_path):
    marked = replace(scene.camera, fiducials_mm={"1": (20.0, 20.0), "2": (-20.0, -20.0)})
    usable = np.ones((102, 102), dtype=bool)
    usable[:51, :51] = False
    product = rectify_photo(middle, marked, scene.dem, 0.6, tmp_path / "o.tif", CRS, usable=usable)
    values = read(product.path)

    def shown(film):
        pixel = middle.interior.pixel_from_film(np.array([film]))
        point = middle.object_from_pixel(pixel, np.array([300.0]), marked)
        for _ in range(12):
            point = middle.object_from_pixel(pixel, scene.dem.heights(point[:, :2]), marked)
        column, row = product.grid.grid_from_object(point[:, :2])[0].astype(int)
        return values[row, column] > 0

    assert shown((0.5, -0.5))
    assert shown((25.0, 25.0))
    assert not shown((20.0, 20.0))
    assert not shown((29.5, -10.0))
    assert not shown((-15.0, 15.0))


@pytest.mark.parametrize("edge_mm", [1.0, 8.0])
def test_footprint_within_the_edge_is_where_the_ortho_is__truth(scene, middle, tmp_path, edge_mm):
    options = OrthoOptions(edge_mm=edge_mm)
    product = rectify_photo(
        middle, scene.camera, scene.dem, 0.6, tmp_path / "o.tif", CRS, options=options
    )
    footprint = footprint_of(middle, scene.camera, scene.dem, margin_mm=edge_mm)
    shown = product.covered_share * product.grid.columns * product.grid.rows * 0.36
    assert footprint.is_valid
    assert shown == pytest.approx(footprint.area, rel=0.01)


def test_an_area_cuts_by_its_outline_and_changes_nothing_within__law(scene, middle, tmp_path):
    """Its edges run through middles of pixels, where tiles could burn them differently."""
    grid = ortho_grid(middle, scene.camera, scene.dem, 1.0)
    whole = read(rectify_photo(middle, scene.camera, scene.dem, grid, tmp_path / "w.tif", CRS).path)
    ring = box(499_950.5, 4_099_900.5, 500_120.5, 4_100_080.5)
    area = ring.difference(box(500_000.5, 4_099_960.5, 500_040.5, 4_100_000.5))
    part = area_within(area, middle, scene.camera, scene.dem, grid)
    assert part is not None
    assert part.equals(area)
    small = grid.covering(part.bounds)
    made = rectify_photo(
        middle, scene.camera, scene.dem, small, tmp_path / "o.tif", CRS,
        area=part, options=OrthoOptions(tile_px=64),
    )  # fmt: skip
    column, row = np.rint(grid.grid_from_object(np.array([[small.west, small.north]]))[0]).astype(
        int
    )
    there = whole[row : row + small.rows, column : column + small.columns].astype(int)
    values = read(made.path).astype(int)
    shown = values > 0
    assert np.count_nonzero(shown) == area.area
    east, north = np.meshgrid(*small.centres())
    away = shapely.distance(area, shapely.points(east, north))
    assert away[shown].max() == 0
    assert np.abs(values - there)[shown].max() <= 4
    # All of the photo, none of it, and no more than the strip that is left out.
    far = box(*(edge + 5000 for edge in area.bounds))
    assert area_within(far, middle, scene.camera, scene.dem, grid).is_empty
    assert area_within(box(*grid.bounds), middle, scene.camera, scene.dem, grid) is None
    inner, outer = (
        footprint_of(middle, scene.camera, scene.dem, margin_mm=margin) for margin in (2.0, 1.0)
    )
    rim = outer.difference(inner)
    assert area_within(rim, middle, scene.camera, scene.dem, grid, 2.0).is_empty


@pytest.fixture(scope="module")
def ramp(scene, tmp_path_factory):
    """A photo of 16 bit whose gray grows by 30 a column and by 20 a row."""
    photo = scene.photo("ramp", bits=16)
    columns, rows = photo.size_px
    values = (1000 + 30 * np.arange(columns)[None, :] + 20 * np.arange(rows)[:, None]).astype("u2")
    path = tmp_path_factory.mktemp("ramp") / "ramp.tif"
    with rasterio.open(photo.scan) as file:
        profile = file.profile
    with rasterio.open(path, "w", **profile) as file:
        file.write(values, 1)
    return replace(photo, scan=path)


@pytest.mark.parametrize("budget", [800_000_000, 0])
@pytest.mark.parametrize("kernel", ["nearest", "bilinear", "cubic", "lanczos"])
def test_kernels_give_a_ramp_as_it_is_and_the_nearest_pixels_of_it__truth(
    scene, ramp, tmp_path, kernel, budget
):
    """Thirty grays a column: five are a sixth of a pixel."""
    options = OrthoOptions(resampling=kernel, scan_budget_bytes=budget, tile_px=200)
    gsd = 1.3 if kernel == "nearest" else 0.7
    made = rectify_photo(
        ramp, scene.camera, scene.dem, gsd, tmp_path / "o.tif", CRS, options=options
    )
    values = read(made.path)
    east, north = np.meshgrid(*made.grid.centres())
    seen = values > 0
    plane = np.column_stack([east[seen], north[seen]])
    points = np.column_stack([plane, scene.dem.heights(plane)])
    column, row = ramp.pixel_from_object(points, scene.camera).T
    found = values[seen].astype(float)
    assert len(found) > 100_000 / gsd**2
    if kernel == "nearest":
        own = 1000 + 30 * np.floor(column) + 20 * np.floor(row)
        assert np.mean(found == own) > 0.95, "but where the place is all but between two"
        with rasterio.open(ramp.scan) as file:
            assert np.isin(found, file.read(1)).all()
    else:
        away = np.abs(found - (1000 + 30 * (column - 0.5) + 20 * (row - 0.5)))
        # Places in 1/32 of a pixel and whole grays; the wider kernels ripple besides.
        assert away.max() < (1 if kernel == "bilinear" else 5)


def test_rectification_stops_when_asked__law(scene, middle, tmp_path):
    class Impatient:
        def report(self, done, total, what=""):
            raise Cancelled

    options = OrthoOptions(tile_px=128)
    with pytest.raises(Cancelled):
        rectify_photo(
            middle,
            scene.camera,
            scene.dem,
            0.6,
            tmp_path / "o.tif",
            CRS,
            options=options,
            progress=Impatient(),
        )


def test_lens_far_outside_its_frame_shows_nothing__law(scene, middle, tmp_path):
    folding = Camera("fold", 100.0, (60.0, 60.0), radial_distortion=(-1e-6, 0.0, 0.0))
    grid = Grid.over((490_000.0, 4_090_000.0, 510_000.0, 4_110_000.0), 20.0)
    product = rectify_photo(
        middle, folding, scene.dem, grid, tmp_path / "o.tif", CRS, options=OrthoOptions(tile_px=64)
    )
    values = read(product.path)
    rows, columns = np.nonzero(values)
    assert len(rows)
    assert np.abs(columns - 500).max() < 30
    assert np.abs(rows - 500).max() < 30


def test_colours_and_infrared_stay__law(scene, middle, tmp_path):
    """Each band of the ortho is the ortho of that band; alpha is no colour."""
    with rasterio.open(middle.scan) as file:
        gray, profile = file.read(1), file.profile
    bands = [gray, gray // 2 + 40, 255 - gray, np.roll(gray, 40, axis=1)]
    alone = []
    for number, band in enumerate(bands):
        path = tmp_path / f"{number}.tif"
        with rasterio.open(path, "w", **profile) as file:
            file.write(band, 1)
        photo = replace(middle, scan=path)
        made = rectify_photo(photo, scene.camera, scene.dem, 1.0, tmp_path / f"o{number}.tif", CRS)
        alone.append(read(made.path))
    path = tmp_path / "colour.tif"
    more = {"count": 5, "photometric": "rgb", "alpha": "yes"}
    with rasterio.open(path, "w", **(profile | more)) as file:
        file.colorinterp = [*KINDS, ColorInterp.alpha]
        file.write(np.stack([*bands, np.full_like(gray, 255)]))
    for budget in (800_000_000, 0):
        options = OrthoOptions(scan_budget_bytes=budget)
        photo = replace(middle, scan=path)
        target = tmp_path / f"{budget}.tif"
        rectify_photo(photo, scene.camera, scene.dem, 1.0, target, CRS, options=options)
        with rasterio.open(target) as file:
            np.testing.assert_array_equal(file.read(), np.stack(alone))
            assert file.colorinterp[:4] == tuple(KINDS)


def test_a_gray_scan_in_three_bands_makes_a_gray_ortho__truth(scene, middle, tmp_path):
    with rasterio.open(middle.scan) as file:
        gray, profile = file.read(1), file.profile
    path = tmp_path / "rgb.tif"
    with rasterio.open(path, "w", **(profile | {"count": 3, "photometric": "rgb"})) as file:
        file.write(np.stack([gray] * 3))
    made = rectify_photo(
        replace(middle, scan=path), scene.camera, scene.dem, 1.0, tmp_path / "o.tif", CRS
    )
    own = rectify_photo(middle, scene.camera, scene.dem, 1.0, tmp_path / "own.tif", CRS)
    with rasterio.open(made.path) as file:
        assert file.count == 1
        np.testing.assert_allclose(file.read(1).astype(int), read(own.path), atol=1)
