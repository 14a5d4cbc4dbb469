"""The steps of a surface, each by itself."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import rasterio

from core.block import Block
from core.raster.grid import Grid
from core.surface.fusion import PairHeights, cell_heights, fuse_pairs, object_points
from core.surface.ground import NODATA_M, fit_trend, hillshade, read_smooth
from core.surface.matching import match_pair
from core.surface.rectified import LaidPhoto, RectifiedPair, Turned, pairs_over, sound_pairs
from tests.core.raster_files import place, write_raster
from tests.flights import FlightPlan, fly


@pytest.fixture(scope="module")
def block() -> Block:
    return fly(FlightPlan(ties=10, control=4, check=0), np.random.default_rng(2)).truth


def test_a_turned_photo_shows_turned_ground_at_the_same_pixels__law(block):
    photo = next(iter(block.photos.values()))
    camera = block.camera_of(photo.photo_id)
    frame = Turned(photo.exterior.centre[:2] + np.array([300.0, -200.0]), 0.7)
    plan = photo.exterior.centre[:2] + np.random.default_rng(1).uniform(-900, 900, (50, 2))
    heights = np.linspace(280, 330, 50)
    pixels = photo.pixel_from_object(np.column_stack([plan, heights]), camera)
    turned = np.column_stack([frame.from_object(plan), heights])
    np.testing.assert_allclose(
        frame.photo(photo).pixel_from_object(turned, camera), pixels, atol=1e-6
    )
    np.testing.assert_allclose(frame.to_object(turned[:, :2]), plan, atol=1e-6)


def test_pairs_are_neighbours_whose_rays_meet_well__truth(block):
    pairs = sound_pairs(block)
    names = {(pair.left, pair.right) for pair in pairs}
    assert ("00_000", "00_001") in names
    assert ("00_000", "01_000") in names
    for pair in pairs:
        assert 0.2 <= pair.base_to_height <= 1.0
    crowded = {
        name: replace(photo, exterior=next(iter(block.photos.values())).exterior)
        for name, photo in block.photos.items()
    }
    assert not sound_pairs(block.with_photos(crowded))


def test_no_more_pairs_than_six_at_one_place__law(block):
    pairs = sound_pairs(block) * 3
    west, south, east, north = block.bounds
    middle = ((west + east) / 2 - 5, (south + north) / 2 - 5)
    assert len(pairs_over(pairs, (*middle, middle[0] + 10, middle[1] + 10))) <= 6
    assert pairs_over(pairs, (east + 5000, north, east + 5100, north + 100)) == ()


def shifted_pair(parallax: np.ndarray, grain: float, seed: int) -> RectifiedPair:
    """Two pictures of a texture, the right one displaced, with grain of its own in each."""
    rng = np.random.default_rng(seed)
    rows, columns = parallax.shape
    texture = sum(
        size
        * 6
        * cv2.GaussianBlur(rng.normal(size=parallax.shape).astype(np.float32), (0, 0), size)
        for size in (1.5, 4.0)
    )
    x, y = np.meshgrid(np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32))
    moved = cv2.remap(texture, x + parallax.astype(np.float32), y, cv2.INTER_CUBIC)

    def laid(values: np.ndarray) -> LaidPhoto:
        noise = cv2.GaussianBlur(rng.normal(size=values.shape).astype(np.float32), (0, 0), 0.7)
        return LaidPhoto(
            (120 + 8 * values + grain * noise).astype(np.float32),
            np.ones(values.shape, dtype=bool),
            np.zeros(3),
        )

    start = np.zeros(parallax.shape, dtype=np.float32)
    grid = Grid(0, rows, 1.0, columns, rows)
    # The left picture at x shows what the right one shows at x - parallax.
    return RectifiedPair(Turned(np.zeros(2), 0.0), grid, start, laid(texture), laid(moved))


def test_parallaxes_are_found_to_parts_of_a_pixel__truth():
    true = 3.0 + 1.5 * np.sin(np.arange(300) / 60)[None, :] * np.ones((280, 1))
    found = match_pair(shifted_pair(true, 3.0, 1), 12)
    inner = np.s_[30:-30, 40:-40]
    error = (found.parallax_px - true)[inner][found.found[inner]]
    assert found.found[inner].mean() > 0.9
    assert 1.48 * np.median(np.abs(error)) < 0.12
    assert abs(np.median(error)) < 0.06


@pytest.mark.parametrize("grain", [4.0, 12.0])
def test_a_parallax_says_how_well_it_is_known__truth(grain):
    found = match_pair(shifted_pair(np.full((320, 320), 2.3), grain, 5), 8)
    inner = np.s_[30:-30, 40:-40]
    sigma = np.hypot(found.sigma_px, found.rounding_px)
    ratio = ((found.parallax_px - 2.3) / sigma)[inner][found.found[inner]]
    assert 0.7 < 1.48 * np.median(np.abs(ratio)) < 1.3


def test_a_wall_that_windows_round_off_is_known_less_well__truth():
    columns = np.arange(320)
    true = np.broadcast_to(np.where(columns < 160, 0.0, 4.0), (240, 320))
    found = match_pair(shifted_pair(true, 3.0, 11), 16)
    part = np.s_[60:-60, 140:184]

    def grossly_off(sigma: np.ndarray) -> float:
        """Share of parallaxes off by more than three standard deviations."""
        off = np.abs(found.parallax_px - true) > 3 * sigma
        return float(off[part][found.found[part]].mean())

    alone = grossly_off(found.sigma_px)
    assert alone > 0.1
    assert grossly_off(np.hypot(found.sigma_px, found.rounding_px)) < alone / 2


def test_a_slope_is_not_rounded_off__truth():
    columns = np.arange(320) - 160.0
    pair = shifted_pair(np.broadcast_to(0.2 * np.abs(columns), (240, 320)), 3.0, 11)
    found = match_pair(pair, 48)
    for part in (np.s_[60:-60, 80:130], np.s_[60:-60, 200:240]):
        assert np.median(found.rounding_px[part]) < 0.5 * np.median(found.sigma_px[part])


CELLS = Grid(0, 40, 1.0, 40, 40)
RING = [("a", "b"), ("b", "c"), ("a", "c")]


def level(height: float, sigma: float, rounding: float = 0.0) -> PairHeights:
    shape = (CELLS.rows, CELLS.columns)
    return PairHeights(*(np.full(shape, value, np.float32) for value in (height, sigma, rounding)))


def test_pairs_that_agree_outvote_one_that_does_not__truth():
    fused = fuse_pairs([level(10, 0.5), level(10.4, 0.5), level(30, 0.5)], RING, CELLS)
    np.testing.assert_allclose(fused.heights, 10.2, atol=1e-5)
    assert (fused.pairs == 2).all()


@pytest.mark.parametrize("sigma", [0.5, 0.51, 2.0])
def test_two_pairs_that_contradict_each_other_leave_a_hole__truth(sigma):
    fused = fuse_pairs([level(10, 0.5), level(30, sigma)], RING[:2], CELLS)
    assert np.isnan(fused.heights).all()
    assert (fused.pairs == 0).all()
    assert np.isnan(fuse_pairs([], [], CELLS).heights).all()


def test_weights_and_scatter_make_the_standard_deviation__truth():
    calm = fuse_pairs([level(10, 0.3), level(10, 0.4)], RING[:2], CELLS)
    np.testing.assert_allclose(calm.sigmas, 0.24, atol=1e-4)
    rough = fuse_pairs([level(10, 0.3), level(11, 0.4)], RING[:2], CELLS)
    # Chi squared of one freedom is 1 / (0.3^2 + 0.4^2) = 4, so twice as much.
    np.testing.assert_allclose(rough.sigmas, 0.48, atol=1e-4)


def test_what_windows_round_off_stays_however_many_pairs_agree__truth():
    fused = fuse_pairs([level(10, 0.3, 0.5)] * 2, [("a", "b"), ("c", "d")], CELLS)
    np.testing.assert_allclose(fused.sigmas, np.hypot(0.3 / np.sqrt(2), 0.5), atol=1e-4)


def test_pairs_that_contradict_each_other_say_nothing_of_the_cells_beside__truth():
    left, right = level(10, 0.3), level(10, 0.3)
    right.heights[:, 20:] = 30
    fused = fuse_pairs([left, right], RING[:2], CELLS)
    assert np.isnan(fused.heights[:, 20:]).all()
    np.testing.assert_allclose(fused.sigmas[:, :20], 0.3 / np.sqrt(2), atol=1e-4)


def test_three_pairs_of_three_photos_are_worth_two__truth():
    """Parallaxes of A-C are those of A-B and B-C: errors of their mean are (a - c) / 2."""
    fused = fuse_pairs([level(10, 0.6), level(10, 0.6), level(10, 0.3)], RING, CELLS)
    np.testing.assert_allclose(fused.sigmas, 0.3, atol=1e-4)


def test_beyond_the_dem_there_are_no_points__law():
    pair = shifted_pair(np.full((160, 160), 2.3), 4.0, 6)
    left, right = (np.array([easting, 80.0, 400.0]) for easting in (0.0, 160.0))
    pair = replace(
        pair,
        left=replace(pair.left, centre=left),
        right=replace(pair.right, centre=right),
    )
    found = match_pair(pair, 8)
    bare = pair.start.copy()
    bare[:, 80:] = np.nan
    whole, part = object_points(pair, found)[0], object_points(replace(pair, start=bare), found)[0]
    assert np.isfinite(part).all()
    assert 0.2 * len(whole) < len(part) < 0.6 * len(whole)


def test_cells_with_too_few_points_stay_open__truth():
    places = np.array([[x + 0.25, y + 0.25] for x in range(10) for y in range(10)])
    points = np.column_stack([places, 100 + places[:, 0]])
    sigmas, grid = np.full((len(points), 2), 0.5), Grid(0, 10, 2.0, 5, 5)
    found = cell_heights(points, sigmas, grid, 0.5)
    np.testing.assert_allclose(found.heights[0], 100.75 + 2 * np.arange(5), atol=1e-4)
    assert np.isnan(cell_heights(points[::3], sigmas[::3], grid, 0.5).heights).any()
    # Four points whose windows are nearly one: their mean is no better known than each.
    np.testing.assert_allclose([found.own, found.rounding], 0.5, atol=1e-6)


def test_the_trend_ignores_what_stands_on_the_ground__truth():
    rng = np.random.default_rng(4)
    plan = rng.uniform((0, 0), (2000, 1000), (5000, 2))
    x, y = plan[:, 0] / 1000 - 1, (plan[:, 1] - 500) / 1000
    systematic = 0.4 - 0.3 * x + 0.2 * y + 0.5 * (x**2 + y**2)
    away = systematic + rng.normal(0, 0.2, 5000)
    away[rng.random(5000) < 0.15] += 12.0
    trend = fit_trend(plan, away, (0.0, 0.0, 2000.0, 1000.0))
    np.testing.assert_allclose(trend.at(plan), systematic, atol=0.08)
    assert trend.nmad_m == pytest.approx(0.23, abs=0.04)


def test_smooth_heights_of_tiles_are_those_of_the_whole__law(tmp_path):
    rng = np.random.default_rng(7)
    heights = (300 + rng.normal(0, 1, (90, 120))).astype(np.float32)
    heights[40:60, 50:80] = NODATA_M
    path = write_raster(tmp_path / "s.tif", heights, place(1.0), nodata=NODATA_M)
    with rasterio.open(path) as file:
        whole = read_smooth(file, (0, 0, 120, 90), 1)
        part = read_smooth(file, (30, 20, 40, 50), 1)
    np.testing.assert_allclose(part, whole[20:72, 30:72], atol=1e-9)
    assert np.isnan(whole[0]).all()
    assert np.isnan(whole[51, 61:71]).all()
    # A bell of three cells averages some 113 of them.
    assert np.nanstd(whole) < 0.2


def test_slopes_to_the_light_are_bright__truth():
    east, north = np.meshgrid(np.arange(20.0), np.arange(20.0)[::-1])
    towards = hillshade((300 + 0.5 * (east - north)).astype(np.float32), 1.0)
    away = hillshade((300 - 0.5 * (east - north)).astype(np.float32), 1.0)
    level_ground = hillshade(np.full((20, 20), 300, np.float32), 1.0)
    # Ground that falls to the north-west looks into the light.
    assert towards[5, 5] > level_ground[5, 5] > away[5, 5]
    hole = np.full((20, 20), 300, np.float32)
    hole[10, 10] = np.nan
    assert hillshade(hole, 1.0)[10, 10] == 0
