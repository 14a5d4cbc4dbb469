"""Gains and offsets that were put in are found again."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio

import core.mosaic.radiometry as radiometry
from core.mosaic.overview import Overview, read_overview
from core.mosaic.radiometry import (
    Balance,
    FilmPlane,
    balance_orthos,
    film_plane,
)
from core.mosaic.tones import toned_as_photo, toned_as_reference
from core.raster.files import gray_from_colour
from core.raster.grid import Grid
from core.raster.ortho import open_ortho
from tests.core.mosaic.conftest import write_ortho


def test_gains_and_offsets_are_found_again__truth(block):
    found = balance_orthos([read_overview(ortho, 4) for ortho in block])
    put_in = {"a": (1.0, 0), "b": (0.8, 25), "c": (1.1, -20), "d": (0.9, 5)}
    gains = [found[name].gain * gain for name, (gain, _) in put_in.items()]
    offsets = [found[name].gain * off + found[name].offset for name, (_, off) in put_in.items()]
    assert np.ptp(gains) < 0.01
    assert np.ptp(offsets) < 1.0
    assert np.mean([balance.gain for balance in found.values()]) == pytest.approx(1, abs=1e-4)


def test_the_block_has_the_tone_of_a_photo_or_of_the_reference__truth(block, tmp_path):
    views = [read_overview(ortho, 4) for ortho in block]
    found = balance_orthos(views)
    own = toned_as_photo(found, "b")
    assert (own["b"].gain, own["b"].offset) == pytest.approx((1, 0))
    ratios = [own[name].gain / found[name].gain for name in found]
    assert ratios == pytest.approx([ratios[0]] * 4)
    # A reference of half the contrast; a photo of gain 1 and offset 0 shows the ground as it is.
    true = next(ortho for ortho in block if ortho.photo_id == "a")
    with rasterio.open(true.path) as file:
        values, profile = file.read(1), file.profile
    path = tmp_path / "reference.tif"
    with rasterio.open(path, "w", **(profile | {"count": 1})) as file:
        file.write(np.where(values > 0, values * 0.5 + 60, 0).astype(np.uint8), 1)
    reference = open_ortho([path], str(profile["crs"]))
    shown = toned_as_reference(found, [[views[0]]], reference, 255.0)
    assert (shown["a"].gain, shown["a"].offset) == pytest.approx((0.5, 60), abs=2)
    assert shown["b"].gain / shown["a"].gain == pytest.approx(found["b"].gain / found["a"].gain)


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


def test_vignetting_gain_and_tilt_are_found_again__truth(tmp_path):
    """Six photos in two strips; corrected, all show the ground but for one tone of the block."""
    rng = np.random.default_rng(6)
    side = 480
    fields = np.kron(rng.uniform(60, 170, (80, 100)), np.ones((12, 12)))
    put_in = [
        (1.0, 0, 6, -4),
        (0.9, 10, -8, 3),
        (1.1, -8, 3, 7),
        (0.95, 4, 5, 5),
        (1.05, -5, -6, -6),
        (1.0, 2, 0, -5),
    ]
    orthos, planes = [], {}
    for number, (gain, offset, tilt_east, tilt_north) in enumerate(put_in):
        row, column = divmod(number, 3)
        top, left = 300 * row, 200 * column
        grid = Grid(1000.0 + left, 5000.0 - top, 1.0, side, side)
        eastings, northings = grid.centres()
        x, y = (
            (eastings - eastings.mean())[None, :] / 240,
            (northings - northings.mean())[:, None] / 240,
        )
        squared = (x**2 + y**2) / 2
        shade = 1 - 0.25 * squared - 0.1 * squared**2
        truth = fields[top : top + side, left : left + side]
        gray = (gain * truth + offset + tilt_east * x + tilt_north * y) * shade
        gray += rng.normal(0, 3, gray.shape)
        name, nadir = f"p{number}", (float(eastings.mean()), float(northings.mean()))
        written = np.clip(np.rint(gray), 1, 255).astype(np.uint8)
        orthos.append(write_ortho(tmp_path / f"{name}.tif", name, grid, written, nadir))
        # Level ground below a camera that looks straight down: half a diagonal is 240 * sqrt(2) m.
        scale = 1 / (240 * np.sqrt(2))
        rows = ((scale, 0.0, 0.0), (0.0, scale, 0.0), (0.0, 0.0, 1.0))
        planes[name] = FilmPlane("wide", nadir, rows, (0.5**0.5, 0.5**0.5))
    views = [read_overview(ortho, 4) for ortho in orthos]

    def misfit(balances):
        shown, truths = [], []
        for number, view in enumerate(views):
            row, column = divmod(number, 3)
            top, left = 75 * row, 50 * column
            small = fields.reshape(240, 4, 300, 4).mean(axis=(1, 3))
            truths.append(small[top : top + 120, left : left + 120].ravel())
            shown.append(balances[view.photo_id].corrected(view.values, view.grid).ravel())
        shown, truths = np.concatenate(shown), np.concatenate(truths)
        slope, constant = np.polyfit(truths, shown, 1)
        return float(np.sqrt(np.mean(((shown - constant) / slope - truths) ** 2)))

    found = balance_orthos(views, planes=planes)
    untouched = {view.photo_id: Balance() for view in views}
    assert misfit(untouched) > 10
    assert misfit(found) < 2
    # Without the camera the corners stay dark.
    assert misfit(balance_orthos(views)) > 2 * misfit(found)


@pytest.fixture(scope="module", params=[(6, 20), (1, 30)], ids=["block", "one strip"])
def strips(request):
    """Strips of photos that are brighter by 5 % towards one side of the film, and the truth."""
    count, photos = request.param
    rng, side, cell = np.random.default_rng(4), 24, 8.0
    fields = np.kron(rng.uniform(60, 170, (60, 162)), np.ones((2, 2)))
    across, views, planes, truths = np.linspace(-1, 1, side), [], {}, []
    for number in range(count * photos):
        strip, along = divmod(number, photos)
        top, left = 16 * strip, 10 * along
        truth = fields[top : top + side, left : left + side]
        # Strips are flown there and back, with the film turned by half a turn.
        way = (-1) ** strip
        gray = truth * (1 + 0.05 * way * across) + rng.normal(0, 3, truth.shape)
        grid = Grid(left * cell, -top * cell, cell, side, side)
        nadir = (grid.west + side * cell / 2, grid.north - side * cell / 2)
        name, scale = f"p{number:03}", way * np.sqrt(2) / (side * cell)
        views.append(Overview(name, nadir, grid, gray, np.ones_like(gray)))
        rows = ((scale, 0.0, 0.0), (0.0, scale, 0.0), (0.0, 0.0, 1.0))
        planes[name] = FilmPlane("wide", nadir, rows, (0.5**0.5, 0.5**0.5))
        truths.append(truth)
    return views, planes, truths


def test_what_photos_differ_by_does_not_add_up_over_a_block__truth(strips):
    """It was taken for certain, and noise made gains shrink: of 406 photos tones were useless."""
    views, planes, truths = strips
    found = balance_orthos(views, planes=planes)
    off = [
        float(np.mean(found[view.photo_id].corrected(view.values.copy(), view.grid) - truth))
        for view, truth in zip(views, truths, strict=True)
    ]
    assert np.std(off) < 2
    assert np.ptp(off) < 10
    assert np.std([balance.gain for balance in found.values()]) < 0.05
    # Half a diagonal is the root of two times half a side, and V takes out what was put in.
    assert found["p000"].slope == pytest.approx((-0.05 * np.sqrt(2), 0.0), abs=0.02)


def test_noise_of_both_photos_makes_no_gain_shrink__law(strips, monkeypatch):
    """Six gains ran from 0.49 to 1.73 where every sample counted."""
    views, planes, _ = strips
    monkeypatch.setattr(radiometry, "INDEPENDENT", 1e9)
    few = {view.photo_id: planes[view.photo_id] for view in views[:6]}
    gains = [balance.gain for balance in balance_orthos(views[:6], planes=few).values()]
    assert min(gains) > 0.85
    assert max(gains) < 1.15


def test_equations_are_the_same_in_parts__law(strips, monkeypatch):
    views, planes, _ = strips
    few = {view.photo_id: planes[view.photo_id] for view in views[:10]}
    whole = balance_orthos(views[:10], planes=few)
    monkeypatch.setattr(radiometry, "SAMPLES_AT_ONCE", 500)
    assert balance_orthos(views[:10], planes=few) == whole


def test_ground_meets_the_film_where_rays_do__truth(scene):
    photo = scene.photo("t", 40.0, -30.0, kappa=0.4)
    plane, camera = film_plane(photo, scene.camera), scene.camera
    rng = np.random.default_rng(3)
    centre = photo.exterior.centre
    places = np.column_stack([centre[:2] + rng.uniform(-250, 250, (20, 2)), np.full(20, 300.0)])
    film = photo.interior.film_from_pixel(photo.pixel_from_object(places, camera))
    away = film - np.array(camera.principal_point_mm)
    expected = (away**2).sum(axis=1) / (np.hypot(*camera.frame_mm) / 2) ** 2
    # Lens distortion and earth's curvature, which tones need not know.
    found = (plane.film(places[:, 0], places[:, 1]) ** 2).sum(axis=1)
    assert np.allclose(found, expected, rtol=0.01)
    corners = photo.object_from_pixel(
        photo.interior.pixel_from_film(np.array([[29.0, 29.0], [31.0, 0.0]])),
        np.full(2, 300.0),
        camera,
    )
    assert [plane.reaches(*corner[:2].tolist()) for corner in corners] == [True, False]


def test_a_correction_is_the_same_in_every_part__law():
    rows = ((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (1e-6, 0.0, 1.0))
    balance = Balance(
        1.1,
        -3.0,
        (0.01, -0.02),
        (1200.0, 3100.0),
        (0.2, 0.1),
        FilmPlane("wide", (1200.0, 3100.0), rows, (0.7, 0.7)),
    )
    whole = Grid(1000.0, 3300.0, 0.5, 90, 70)
    gray = np.random.default_rng(1).uniform(1, 255, (70, 90)).astype(np.float32)
    part = balance.corrected(gray[13:60, 7:81], whole.window(7, 13, 74, 47))
    assert np.array_equal(part, balance.corrected(gray, whole)[13:60, 7:81])


def test_a_photo_that_next_to_nothing_is_compared_with_leaves_the_others_alone__law(block):
    """The one photo without neighbours held the mean gain: 6 there, and 0 everywhere else."""
    views = [read_overview(ortho, 4) for ortho in block]
    without = balance_orthos(views)
    first = views[0]
    far = replace(first.grid, west=first.grid.west + 5000)
    rows, columns = np.nonzero(first.full & views[1].full)
    share = np.zeros_like(first.share)
    share[rows[:30], columns[:30]] = 1
    for other in (
        replace(first, photo_id="far", grid=far),
        replace(first, photo_id="corner", share=share),
    ):
        found = balance_orthos([*views, other])
        assert all(
            found[name].gain == pytest.approx(without[name].gain, abs=0.02) for name in "abcd"
        )
        if other.photo_id == "far":
            assert found["far"].gain == 1
            assert found["far"].offset == 0


def test_luminance_has_the_balance_of_all_its_bands__truth():
    """Seams of colours were sought in grays toned as red alone is."""
    rng = np.random.default_rng(9218)
    rows = ((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (1e-6, 0.0, 1.0))
    plane = FilmPlane("wide", (1200.0, 3100.0), rows, (0.7, 0.7))
    bands = [
        Balance(gain, offset, (tilt, -tilt), (1200.0, 3100.0), (falloff, 0.1), plane)
        for gain, offset, tilt, falloff in rng.uniform(
            (0.7, -20, -0.1, 0), (1.4, 20, 0.1, 0.3), (4, 4)
        )
    ]
    own = replace(bands[0], others=tuple(bands[1:]))
    grid = Grid(1000.0, 3300.0, 0.5, 90, 70)
    gray = rng.uniform(1, 255, (70, 90)).astype(np.float32)
    wanted = gray_from_colour(np.stack([one.corrected(gray, grid) for one in bands[:3]]))
    np.testing.assert_allclose(own.luminance.corrected(gray, grid), wanted, atol=1e-3)
    assert np.abs(own.corrected(gray, grid) - wanted).max() > 5
    assert bands[0].luminance == bands[0]
