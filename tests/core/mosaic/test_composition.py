"""Seams, balance and composition, on orthos whose content is known."""

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine

from core.mosaic.composition import MosaicOptions, compose_mosaic, mosaic_grid
from core.mosaic.overview import common_cells, read_overview
from core.mosaic.radiometry import Balance, balance_orthos
from core.mosaic.seams import area_of, draw_seams, read_seams, write_seams
from core.orthos.rectification import OrthoProduct, rectify_photo
from core.raster.grid import Grid

CRS = "EPSG:32633"


def write_ortho(path, name, grid, values, nadir):
    profile = {"width": grid.columns, "height": grid.rows, "count": 1, "dtype": values.dtype}
    transform = Affine.from_gdal(*grid.geotransform)
    with rasterio.open(
        path, "w", driver="GTiff", crs=CRS, transform=transform, nodata=0, **profile
    ) as file:
        file.write(values, 1)
    return OrthoProduct(name, path, grid, float(np.mean(values > 0)), nadir)


def read(path):
    with rasterio.open(path) as file:
        return file.read(1)


@pytest.fixture(scope="module")
def block(scene, tmp_path_factory):
    """Orthos of four photos in two strips that overlap; gains and offsets differ."""
    folder = tmp_path_factory.mktemp("block")
    places = {
        "a": (-130, -120, 1.0, 0),
        "b": (130, -110, 0.8, 25),
        "c": (-120, 120, 1.1, -20),
        "d": (135, 125, 0.9, 5),
    }
    return [
        rectify_photo(
            scene.photo(name, e, n, 0.05, gain, offset),
            scene.camera,
            scene.dem,
            1.0,
            folder / f"{name}_ortho.tif",
            CRS,
        )
        for name, (e, n, gain, offset) in places.items()
    ]


def compose(orthos, folder, **more):
    grid = mosaic_grid(orthos)
    return compose_mosaic(orthos, grid, folder / "m.tif", folder / "seams.gpkg", **more)


def test_mosaic_of_identical_orthos_is_the_ortho__law(tmp_path):
    rng = np.random.default_rng(1)
    grid = Grid.over((1000.0, 2000.0, 1700.0, 2600.0), 1.0)
    values = rng.integers(1, 256, (grid.rows, grid.columns), dtype=np.uint8)
    values[:50, :90] = 0
    orthos = [
        write_ortho(tmp_path / f"{k}.tif", f"p{k}", grid, values, nadir)
        for k, nadir in enumerate([(1100.0, 2100.0), (1600.0, 2500.0), (1350.0, 2300.0)])
    ]
    product = compose(orthos, tmp_path, options=MosaicOptions(tile_px=256))
    assert np.array_equal(read(product.path), values)
    assert len(product.seams) == 3
    assert product.covered_share == pytest.approx(np.mean(values > 0))


def test_mosaic_shows_what_any_ortho_shows__law(block, tmp_path):
    product = compose(block, tmp_path, options=MosaicOptions(balance=False))
    mosaic = read(product.path)
    shown = np.zeros(mosaic.shape, dtype=bool)
    for ortho in block:
        column, row = product.grid.grid_from_object(
            np.array([[ortho.grid.west, ortho.grid.north]])
        )[0].astype(int)
        part = np.s_[row : row + ortho.grid.rows, column : column + ortho.grid.columns]
        shown[part] |= read(ortho.path) > 0
    assert np.array_equal(mosaic > 0, shown)


def test_balanced_mosaic_is_the_ground__truth(block, ground, tmp_path):
    product = compose(block, tmp_path)
    mosaic = read(product.path)
    truth = ground["texture_on"](product.grid)
    seen = mosaic > 0
    slope, constant = np.polyfit(truth[seen], mosaic[seen].astype(float), 1)
    spread = np.std(mosaic[seen] - slope * truth[seen] - constant)
    assert slope == pytest.approx(0.95, abs=0.05)
    assert spread < 2.5


def test_gains_and_offsets_are_found_again__truth(block):
    found = balance_orthos([read_overview(ortho, 4) for ortho in block])
    put_in = {"a": (1.0, 0), "b": (0.8, 25), "c": (1.1, -20), "d": (0.9, 5)}
    gains = [found[name].gain * gain for name, (gain, _) in put_in.items()]
    offsets = [found[name].gain * off + found[name].offset for name, (_, off) in put_in.items()]
    assert np.ptp(gains) < 0.01
    assert np.ptp(offsets) < 1.0
    assert np.mean([balance.gain for balance in found.values()]) == pytest.approx(1, abs=1e-4)


def test_changed_fields_do_not_bend_the_balance__truth(tmp_path):
    rng = np.random.default_rng(2)
    grid = Grid.over((0.0, 0.0, 640.0, 640.0), 1.0)
    scene = np.kron(rng.uniform(40, 200, (40, 40)), np.ones((16, 16)))
    other = scene * 0.7 + 30
    other[:160] = np.kron(rng.uniform(40, 200, (10, 40)), np.ones((16, 16)))
    views = [
        read_overview(
            write_ortho(tmp_path / f"{k}.tif", k, grid, v.astype(np.uint8), (0.0, 0.0)), 16
        )
        for k, v in (("a", scene), ("b", other))
    ]
    found = balance_orthos(views)
    assert found["b"].gain * 0.7 == pytest.approx(found["a"].gain, rel=0.02)


def test_single_ortho_stays_as_it_is__law(block, tmp_path):
    product = compose(block[:1], tmp_path)
    assert product.balances["a"] == Balance(1.0, 0.0)
    assert np.array_equal(read(product.path), read(block[0].path))


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


def test_edited_seams_are_obeyed__truth(block, tmp_path):
    drawn = draw_seams([area_of(read_overview(ortho, 8)) for ortho in block])
    whole = shapely.union_all([seam.area for seam in drawn])
    only = [type(drawn[0])("d", "", whole)]
    product = compose(block, tmp_path, seams=only, options=MosaicOptions(balance=False))
    mosaic, ortho = read(product.path), read(block[3].path)
    column, row = product.grid.grid_from_object(
        np.array([[block[3].grid.west, block[3].grid.north]])
    )[0].astype(int)
    part = mosaic[row : row + ortho.shape[0], column : column + ortho.shape[1]]
    inner = ortho.copy()
    assert np.mean(part[inner > 0] == inner[inner > 0]) > 0.97


def test_tiles_of_the_mosaic_do_not_show__law(block, tmp_path):
    images = []
    for side in (64, 1024):
        folder = tmp_path / str(side)
        folder.mkdir()
        images.append(read(compose(block, folder, options=MosaicOptions(tile_px=side)).path))
    assert np.array_equal(*images)


def test_mosaic_is_a_cloud_optimized_geotiff__oracle(block, tmp_path):
    product = compose(block, tmp_path)
    with rasterio.open(product.path) as file:
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert file.block_shapes == [(512, 512)]
        assert file.overviews(1)
        assert file.nodata == 0
        assert file.crs.to_epsg() == 32633
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.tif", "seams.gpkg"]


def test_overview_cells_coincide__law(block):
    views = [read_overview(ortho, 8) for ortho in block]
    here, there = common_cells(views[0], views[2])
    assert len(here) > 200
    assert np.std(here * 1.1 - 20 - there) < 3.0


def test_coarser_overview_is_the_overview_of_larger_cells__law(block):
    fine, coarse = read_overview(block[0], 4).coarser(3), read_overview(block[0], 12)
    assert fine.grid == coarse.grid
    assert np.allclose(fine.share, coarse.share)
    assert np.allclose(fine.values, coarse.values, atol=0.01, equal_nan=True)
