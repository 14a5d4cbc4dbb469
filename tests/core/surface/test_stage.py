"""A surface of photos whose true one is known: hills, houses, woods, ground that changed."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio
import shapely
from scipy import ndimage

from core.doubts import Failure
from core.geometry.robust import nmad
from core.progress import Work
from core.surface.stage import SurfaceFiles, SurfaceOptions, make_surface
from tests.surface_scene import SurfacePlan, make_scene

PLAN = SurfacePlan(size_px=440, relief_m=12, houses=8, woods=2)
CELL_M = 1.2


def everything(name):
    return None


def made_of(scene, folder, block=None, usable=everything, **more):
    return make_surface(
        block or scene.block,
        scene,
        SurfaceFiles.within(folder),
        usable,
        ties=np.zeros((0, 3)),
        options=SurfaceOptions(CELL_M),
        **({"work": Work()} | more),
    )


def band_of(path):
    with rasterio.open(path) as file:
        return file.read(1, masked=True)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(PLAN, tmp_path_factory.mktemp("surface"), 3)


@pytest.fixture(scope="module")
def surface(scene, tmp_path_factory):
    return made_of(scene, tmp_path_factory.mktemp("made"))


@pytest.fixture(scope="module")
def errors(scene, surface):
    return band_of(surface.files.surface) - scene.on(scene.surface, surface.grid)


def test_open_ground_is_as_good_as_the_geometry_allows__truth(scene, surface, errors):
    open_ground = scene.on(scene.open_ground, surface.grid, np.all) & ~errors.mask
    found = errors[open_ground].compressed()
    assert len(found) > 20_000
    assert nmad(found) <= PLAN.sigma_m
    assert abs(np.median(found)) < 0.3 * PLAN.sigma_m
    assert surface.completeness >= 0.85


def test_standard_deviations_are_true_to_a_third__truth(scene, surface, errors):
    sigma = band_of(surface.files.sigma)
    open_ground = scene.on(scene.open_ground, surface.grid, np.all) & ~errors.mask
    ratio = nmad((errors / sigma)[open_ground].compressed())
    assert 0.7 < ratio < 1.3


def test_ground_that_changed_stands_out_from_the_dem__truth(scene, surface):
    difference = band_of(surface.files.difference)
    changed = scene.on(scene.changed, surface.grid, np.mean) > 0.5
    standing = scene.on(scene.surface - scene.ground, surface.grid, np.max) > 0.3
    shown = ~difference.mask & ~standing
    found = ndimage.median_filter(np.abs(difference.filled(0)) > 2.0, 7)
    both = (found & changed & shown).sum() / ((found | changed) & shown).sum()
    assert both >= 0.7


def test_houses_and_woods_stand_above_the_ground__truth(scene, surface):
    heights = band_of(surface.files.surface) - scene.on(scene.ground, surface.grid)
    true = scene.on(scene.surface - scene.ground, surface.grid, np.min)
    high = (ndimage.minimum_filter(true, 5) > 3.0) & ~heights.mask
    assert high.sum() > 100
    assert np.median((heights - true)[high].compressed()) == pytest.approx(0.5, abs=1.5)


def test_holes_are_marked_in_all_rasters__law(surface):
    count, heights = band_of(surface.files.count), band_of(surface.files.surface)
    sigma = band_of(surface.files.sigma)
    np.testing.assert_array_equal(count.mask, heights.mask)
    np.testing.assert_array_equal(sigma.mask, heights.mask)
    assert heights.mask.any()
    assert set(np.unique(count.compressed())) <= {1, 2, 3}
    assert sigma.min() > 0


def test_threads_make_the_same_surface__law(scene, surface, tmp_path):
    def backwards(function, items):
        return list(reversed([function(item) for item in reversed(list(items))]))

    again = made_of(scene, tmp_path, work=Work(mapper=backwards))
    for one, other in zip(surface.files.paths, again.files.paths, strict=True):
        np.testing.assert_array_equal(band_of(one), band_of(other))


def test_what_is_masked_is_a_hole__truth(scene, surface, tmp_path):
    """The middle photo takes part in both pairs, so half of it masked is half of the surface."""
    half = np.ones((44, 44), dtype=bool)
    half[:22] = False
    masked = made_of(scene, tmp_path, usable=lambda name: half if name == "0_1" else None)
    known = (~band_of(surface.files.count).mask).sum()
    assert 0.4 * known < (~band_of(masked.files.count).mask).sum() < 0.75 * known


def test_water_is_a_hole_and_does_not_count_as_incomplete__law(scene, surface, tmp_path):
    west, south, east, north = surface.grid.bounds
    lake = shapely.box((west + east) / 2, south, east, north)
    made = made_of(scene, tmp_path, water=lake)
    dry, count = surface.grid.columns // 2, band_of(made.files.count)
    assert count[:, dry + 1 :].mask.all()
    np.testing.assert_array_equal(
        count[:, : dry - 1].filled(0), band_of(surface.files.count)[:, : dry - 1].filled(0)
    )
    assert made.completeness == pytest.approx(surface.completeness, abs=0.05)


def test_photos_from_one_place_make_no_surface__truth(scene, tmp_path):
    first = next(iter(scene.block.photos.values()))
    same = {name: replace(first, photo_id=name) for name in ("a", "b")}
    made = made_of(scene, tmp_path, scene.block.with_photos(same))
    assert isinstance(made, Failure)
    assert not list(tmp_path.iterdir())
