"""Composition of orthos whose content is known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import rasterio
import shapely

from core.mosaic.blending import REACH_PX
from core.mosaic.composition import (
    FormerMosaic,
    MosaicOptions,
    compose_mosaic,
    compose_window,
    mosaic_grid,
)
from core.mosaic.drawing import CELL_M
from core.mosaic.radiometry import FilmPlane
from core.mosaic.seam_fit import fit_seams
from core.mosaic.seams import EditedSeams, Seam
from core.raster.grid import Grid, burn_area
from tests.core.mosaic.conftest import write_ortho


def read(path):
    with rasterio.open(path) as file:
        return file.read(1)


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


@pytest.mark.parametrize("depths", [("uint8", "uint16"), ("uint16", "uint8")])
@pytest.mark.parametrize("balance", [True, False])
def test_photos_of_8_and_16_bit_have_one_depth__truth(tmp_path, depths, balance):
    rng = np.random.default_rng(1)
    grid = Grid.over((1000.0, 2000.0, 1700.0, 2600.0), 1.0)
    ground = rng.integers(1, 256, (grid.rows, grid.columns), dtype=np.uint8)
    factors = {"uint8": 1, "uint16": 257}
    orthos = []
    for name, depth, nadir in zip("ab", depths, [(1100.0, 2300.0), (1600.0, 2300.0)], strict=True):
        values = ground.astype(depth) * np.array(factors[depth], depth)
        orthos.append(write_ortho(tmp_path / f"{name}.tif", name, grid, values, nadir))
    product = compose(orthos, tmp_path, options=MosaicOptions(balance=balance))
    assert np.array_equal(read(product.path), ground.astype(np.uint16) * 257)
    part = (200, 100, 300, 200)
    shown = compose_window(orthos, product, product.seams, part)
    assert np.array_equal(shown, ground[100:300, 200:500].astype(np.uint16) * 257)
    (fit,) = fit_seams(product, orthos)
    assert fit.step_95 == 0
    assert fit.matched == fit.places > 10


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


def test_single_ortho_stays_as_it_is__law(block, tmp_path):
    product = compose(block[:1], tmp_path)
    balance = product.balances["a"]
    assert (balance.gain, balance.offset, balance.tilt) == (1.0, 0.0, (0.0, 0.0))
    assert np.array_equal(read(product.path), read(block[0].path))


def test_edited_seams_are_obeyed__truth(block, tmp_path):
    only = [Seam("d", "", shapely.box(*mosaic_grid(block).bounds))]
    product = compose(block, tmp_path, seams=only, options=MosaicOptions(balance=False))
    mosaic, ortho = read(product.path), read(block[3].path)
    column, row = product.grid.grid_from_object(
        np.array([[block[3].grid.west, block[3].grid.north]])
    )[0].astype(int)
    part = mosaic[row : row + ortho.shape[0], column : column + ortho.shape[1]]
    inner = ortho.copy()
    assert np.mean(part[inner > 0] == inner[inner > 0]) > 0.97


def test_a_seam_that_runs_out_and_back_along_one_line_is_composed__oracle(block, tmp_path):
    """GEOS does not clip most of such spikes by a rectangle; they come of edits that overlap."""
    west, south, east, north = mosaic_grid(block).bounds
    corner, rng, spikes = np.array([west, north]), np.random.default_rng(978), []
    for _ in range(20):
        foot, tip = rng.uniform(100, 400, 2)
        low, high = np.array([foot, -40.0]), np.array([tip, 96.0])
        turn = low + 0.75 * (high - low)
        ring = np.array([turn - (0, 30), turn, low, high]) + corner
        spikes += [Seam("c", "", area)] if (area := shapely.Polygon(ring)).is_valid else []
    assert len(spikes) > 4
    seams = [Seam("d", "", shapely.box(west, south, east, north)), *spikes]
    assert compose(block, tmp_path, seams=seams).covered_share > 0


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


def test_only_tiles_that_a_changed_ortho_touches_are_composed_again__law(block, tmp_path):
    stamps = {ortho.photo_id: "before" for ortho in block}
    options = MosaicOptions(tile_px=128, balance=False)
    first = compose(block, tmp_path, stamps=stamps, options=options)
    assert first.composed == len(first.tiles)
    former = FormerMosaic(first.path.rename(tmp_path / "former.tif"), first.tiles)
    again = compose(block, tmp_path, stamps=stamps, former=former, options=options)
    assert again.composed == 0
    assert again.path.read_bytes() == former.path.read_bytes()

    halo = shapely.box(*block[0].grid.bounds).buffer(5, join_style="mitre")
    touched = [name for name in first.tiles if shapely.intersects(_tile_box(name), halo)]
    stamps["a"] = "after"
    changed = compose(block, tmp_path, stamps=stamps, former=former, options=options)
    assert changed.composed == len(touched) < len(first.tiles)
    whole = compose(block, tmp_path, stamps=stamps, options=options)
    assert whole.path.read_bytes() == changed.path.read_bytes()


def _tile_box(name):
    """The ground of a tile by its name: column, row, columns, rows at 1 m from (0, 0)."""
    column, row, columns, rows = (int(word) for word in name.split())
    return shapely.box(column, -row - rows, column + columns, -row)


def test_only_tiles_that_a_changed_seam_touches_are_composed_again__law(block, tmp_path):
    stamps = {ortho.photo_id: "same" for ortho in block}
    options = MosaicOptions(tile_px=64)
    first = compose(block, tmp_path, stamps=stamps, options=options)
    former = FormerMosaic(first.path.rename(tmp_path / "former.tif"), first.tiles)
    west, south, east, north = mosaic_grid(block).bounds
    patch = shapely.box((west + east) / 2, (south + north) / 2, (west + east) / 2 + 60, north - 300)
    seams = [Seam(s.photo_id, s.date, s.area.difference(patch)) for s in first.seams]
    seams.append(Seam("a", "", patch))
    found = compose(block, tmp_path, seams=seams, stamps=stamps, former=former, options=options)
    reached = patch.buffer(REACH_PX + 4, join_style="mitre")
    touched = sum(shapely.intersects(_tile_box(tile), reached) for tile in found.tiles)
    assert 0 < found.composed <= touched < len(found.tiles)
    whole = compose(block, tmp_path, seams=seams, stamps=stamps, options=options)
    assert whole.path.read_bytes() == found.path.read_bytes()


def test_what_edited_seams_leave_open_is_shown_all_the_same__law(block, tmp_path):
    west, south, east, north = mosaic_grid(block).bounds
    edited = EditedSeams((Seam("d", "", shapely.box(west, south, east, north - 500)),), ())
    product = compose(block, tmp_path, seams=edited)
    assert len(product.seams) > 1
    assert ["does not show" in note for note in product.notes] == [True, False]
    assert "open" in product.notes[1]
    shown = compose(block, tmp_path).covered_share
    assert product.covered_share == shown


def test_what_a_photo_shows_is_known_to_some_cells__truth(block, tmp_path):
    product = compose(block, tmp_path)
    reach = 3 * CELL_M
    for ortho in block:
        with rasterio.open(ortho.path) as file:
            seen = file.read(1) > 0
        near = cv2.dilate(seen.astype(np.uint8), np.ones((2 * int(reach) + 1,) * 2, np.uint8)) > 0
        eastings, northings = ortho.grid.centres()
        inside = shapely.contains_xy(
            product.shown[ortho.photo_id], eastings[None, :], northings[:, None]
        )
        assert not (seen & ~inside).any()
        assert not (inside & ~near).any()
        assert (~seen).any()


def test_a_hole_names_the_photos_that_leave_it_out__truth(tmp_path):
    grid = Grid(1000.0, 5000.0, 1.0, 400, 400)
    values = np.full((400, 400), 100, dtype=np.uint8)
    values[180:230, 150:250] = 0
    ortho = write_ortho(tmp_path / "a.tif", "a", grid, values, (1200.0, 4800.0))
    level = ((1 / 300, 0.0, 0.0), (0.0, 1 / 300, 0.0), (0.0, 0.0, 1.0))
    planes = {
        "a": FilmPlane("wide", (1200.0, 4800.0), level, (0.7, 0.7)),
        "b": FilmPlane("wide", (1800.0, 4800.0), level, (0.7, 0.7)),
    }
    holes = compose([ortho], tmp_path, planes=planes).holes
    assert [(hole.area_m2, hole.masked_in) for hole in holes] == [(5000.0, ("a",))]
    assert compose([ortho], tmp_path).holes[0].masked_in == ()


def test_each_colour_is_the_mosaic_of_its_band__law(block, tmp_path):
    """Seams are one; tones, and what is blended, are those of each band alone."""
    changes = (lambda gray: gray, lambda gray: gray // 2 + 30, lambda gray: 230 - gray // 3 * 2)
    alone, colour = [[], [], []], []
    for ortho in block:
        with rasterio.open(ortho.path) as file:
            gray, profile = file.read(1), file.profile
        bands = [np.where(gray > 0, change(gray), 0).astype(np.uint8) for change in changes]
        for own, band in zip(alone, bands, strict=True):
            path = tmp_path / f"{len(own)}_{len(colour)}_{alone.index(own)}.tif"
            own.append(replace(ortho, path=path))
            with rasterio.open(path, "w", **profile) as file:
                file.write(band, 1)
        path = tmp_path / f"{ortho.photo_id}.tif"
        colour.append(replace(ortho, path=path))
        rgb = profile | {"count": 3, "photometric": "rgb", "interleave": "pixel"}
        with rasterio.open(path, "w", **rgb) as file:
            file.write(np.stack(bands))
    grid = mosaic_grid(block)
    made = compose_mosaic(colour, grid, tmp_path / "colour.tif", None)
    with rasterio.open(made.path) as file:
        found = file.read()
        assert [kind.name for kind in file.colorinterp] == ["red", "green", "blue"]
    for number, orthos in enumerate(alone):
        path = tmp_path / f"band{number}.tif"
        own = compose_mosaic(orthos, grid, path, None, seams=made.seams)
        with rasterio.open(own.path) as file:
            np.testing.assert_allclose(found[number].astype(int), file.read(1), atol=1)
    part = (300, 200, 120, 90)
    shown = compose_window(colour, made, made.seams, part)
    np.testing.assert_array_equal(np.moveaxis(shown, -1, 0), found[:, 200:290, 300:420])


def test_share_and_holes_are_those_of_the_area_asked_for__truth(block, tmp_path):
    """It reaches beyond what the photos show, and has a gap of its own."""
    west, south, east, north = mosaic_grid(block).bounds
    middle = (west + east) / 2, (south + north) / 2
    area = shapely.box(west + 300.5, south + 200.5, east - 300.5, north + 100)
    area = area.difference(shapely.Point(middle).buffer(40))
    cut = []
    for ortho in block:
        values = np.where(burn_area(area, ortho.grid), read(ortho.path), 0)
        path = tmp_path / f"{ortho.photo_id}.tif"
        cut.append(write_ortho(path, ortho.photo_id, ortho.grid, values, ortho.nadir))
    whole = read(compose(block, tmp_path, options=MosaicOptions(balance=False)).path) > 0
    made = compose(cut, tmp_path, options=MosaicOptions(balance=False, area=area))
    shown, inside = read(made.path) > 0, burn_area(area, made.grid)
    assert np.array_equal(shown, whole & inside)
    assert made.covered_share == pytest.approx(np.count_nonzero(shown) / area.area)
    assert sum(hole.area_m2 for hole in made.holes) == np.count_nonzero(inside & ~whole)
