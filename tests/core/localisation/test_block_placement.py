"""A block, or one photo, found on the reference from sources that are far off."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.arrays import locked
from core.block import Block, ExteriorPrior, TiePoints
from core.doubts import Failure
from core.geometry.exterior import ExteriorOrientation
from core.georeference.approximation import Ground, approximate_in_area
from core.localisation.block_placement import (
    NARROW,
    WIDE,
    PlacementOptions,
    laid_block,
    laid_on_ground,
    place_block,
    place_photo,
    placement_covariance,
)
from core.localisation.free_block import FreeBlock, free_blocks
from core.matching.global_search import Laid, Turn, angle_field, apart, distinct, turned
from core.matching.patches import OpenPhoto
from core.raster.grid import Grid

pytestmark = pytest.mark.slow

OPTIONS = PlacementOptions(block_px=300, most_work=1e8)
LESS = replace(OPTIONS, most_work=3e7, candidates=8, near_candidates=4)
"""Less time than a block is given: what is found in that, is found in all of it."""
QUICK = replace(WIDE, photo_px=100, fine_px=430)


def true_ties(tiny, rng, count=400) -> TiePoints:
    """Ground details where every photo that sees them truly shows them."""
    bounds = tiny.reference.ortho.bounds
    plan = rng.uniform(bounds[:2], bounds[2:], (count, 2))
    ground = np.column_stack([plan, tiny.reference.dem.heights(plan)])
    ground = ground[np.isfinite(ground[:, 2])]
    point, photo, pixels = [], [], []
    for number, name in enumerate(tiny.names):
        seen = tiny.photos[name].pixel_from_object(ground, tiny.truth.camera)
        size = np.array(tiny.photos[name].size_px)
        inside = np.flatnonzero(((seen > 0.1 * size) & (seen < 0.9 * size)).all(axis=1))
        point.append(inside)
        photo.append(np.full(len(inside), number))
        pixels.append(seen[inside] + rng.normal(size=(len(inside), 2)) * 0.5)
    point, photo = np.concatenate(point), np.concatenate(photo)
    several = np.bincount(point)[point] >= 2
    _, number = np.unique(point[several], return_inverse=True)
    rays = np.concatenate(pixels)[several]
    return TiePoints(tuple(tiny.names), number, photo[several], rays, np.full(len(rays), 0.5))


def lost(tiny, rng, sigma_m, kappa_deg, quarters) -> FreeBlock:
    """The tiny block from an archive that knows little."""
    photos, hypotheses = {}, {}
    prior = ExteriorPrior(
        locked([sigma_m, sigma_m, 60.0]), locked(np.radians([2.0, 2.0, kappa_deg]))
    )
    turn = rng.normal() * np.radians(kappa_deg)
    for name in tiny.names:
        true = tiny.photos[name].exterior
        centre = true.centre + rng.normal(size=3) * [sigma_m, sigma_m, 20.0]
        kappa = true.kappa + turn + np.pi / 2 * (rng.integers(4) if quarters else 0)
        kappas = kappa + np.pi / 2 * np.arange(4 if quarters else 1)
        hypotheses[name] = tuple(ExteriorOrientation(centre, 0.0, 0.0, float(k)) for k in kappas)
        first = hypotheses[name][0]
        photos[name] = replace(
            tiny.photos[name], exterior=first, approximate=first, prior=prior, oriented=False
        )
    camera = {next(iter(tiny.photos.values())).camera: tiny.truth.camera}
    block = Block("EPSG:5514", camera, photos, ties=true_ties(tiny, rng))
    (free,) = free_blocks(block, hypotheses, AdjustmentOptions())
    return free


@pytest.mark.parametrize(
    ("sigma_m", "kappa_deg", "quarters"), [(150.0, 4.0, False), (250.0, 8.0, True)]
)
def test_a_block_of_poor_sources_is_found_as_one_body__truth(tiny, sigma_m, kappa_deg, quarters):
    """World files two hundred metres off; footprints that leave the quarter open."""
    free = lost(tiny, np.random.default_rng(3), sigma_m, kappa_deg, quarters)
    placed = place_block(free, tiny.scans, tiny.reference, LESS)
    assert not isinstance(placed, Failure)
    away = [astray_m(tiny, name, placed.placements[name][0].exterior) for name in tiny.names]
    assert np.sqrt(np.mean(np.square(away))) < 20
    assert placed.turns[0].score > 1.5 * placed.turns[1].score
    for name in tiny.names:
        sigma = np.sqrt(np.diag(placed.placements[name][0].covariance))[:3]
        error = placed.placements[name][0].exterior.centre - tiny.photos[name].exterior.centre
        assert (np.abs(error) < 3.5 * sigma).all()


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_where_the_whole_room_is_too_wide_the_sources_are_looked_at_more_finely__truth(tiny, seed):
    """So little time that a first search finds another place; the sources are off by a sigma."""
    free = lost(tiny, np.random.default_rng(seed), 250.0, 8.0, True)
    hurried = replace(OPTIONS, most_work=3e6, candidates=1)
    away = {}
    for near in (0, hurried.near_candidates):
        options = replace(hurried, near_candidates=near)
        placed = place_block(free, tiny.scans, tiny.reference, options)
        assert not isinstance(placed, Failure)
        ends = [astray_m(tiny, name, placed.placements[name][0].exterior) for name in tiny.names]
        away[near] = np.sqrt(np.mean(np.square(ends)))
    # Another place altogether: ten times what a found block may be off.
    assert away[0] > 200
    assert away[hurried.near_candidates] < 20
    places = [(turn.east_m, turn.north_m, turn.kappa) for turn in placed.turns]
    assert len(set(places)) == len(places) <= options.hypotheses + options.in_reserve


def test_nothing_but_the_scale_is_enough__truth(tiny):
    """No position and no kappa: the whole ortho is searched, a thirtieth off in scale.

    In a quarter of the time that a block is given: what it finds in that, it finds in all of it.
    """
    camera, bounds = tiny.truth.camera, tiny.reference.ortho.bounds
    photos, hypotheses = {}, {}
    for name in tiny.names:
        photo = tiny.photos[name]
        above = photo.exterior.centre[2] - photo.ground_height_m
        scale_number = 1000 * above / camera.principal_distance_mm * 1.03
        ground = Ground("EPSG:5514", photo.ground_height_m)
        found = approximate_in_area(bounds, float(scale_number), camera, ground)
        hypotheses[name] = found.hypotheses
        photos[name] = replace(
            photo,
            exterior=found.exterior,
            approximate=found.exterior,
            prior=found.prior,
            oriented=False,
        )
    ties = true_ties(tiny, np.random.default_rng(8))
    block = Block("EPSG:5514", {photos[tiny.names[0]].camera: camera}, photos, ties=ties)
    (free,) = free_blocks(block, hypotheses, AdjustmentOptions())
    placed = place_block(free, tiny.scans, tiny.reference, OPTIONS)
    assert not isinstance(placed, Failure)
    away = [astray_m(tiny, name, placed.placements[name][0].exterior) for name in tiny.names]
    assert np.sqrt(np.mean(np.square(away))) < 25
    assert placed.turns[0].score > 1.3 * placed.turns[1].score


def test_blank_ground_places_nothing__law(tiny, monkeypatch):
    """A reference that shows nothing where the block lies: no place is better than another."""
    free = lost(tiny, np.random.default_rng(4), 50.0, 1.0, False)
    ortho = tiny.reference.ortho

    def blank(self, grid):
        patch = read(self, grid)
        return replace(patch, values=np.zeros_like(patch.values))

    read = type(ortho).read
    monkeypatch.setattr(type(ortho), "read", blank)
    placed = place_block(free, tiny.scans, tiny.reference, OPTIONS)
    assert isinstance(placed, Failure)


def test_the_laid_block_is_the_ground__truth(tiny):
    """At the true orientations it equals the ortho of its day, seams and all."""
    photos = {
        name: OpenPhoto(tiny.photos[name], tiny.truth.camera, tiny.scans[name])
        for name in tiny.names
    }
    about = np.mean([photo.exterior.centre[:2] for photo in tiny.photos.values()], axis=0)
    laid = laid_block(photos, tiny.reference, about, 900.0, 5.0)
    patch = tiny.archival().ortho.read(laid.grid)
    field = angle_field(patch.values, patch.mask)
    both = laid.mask & patch.mask
    assert both.mean() > 0.4
    same = np.sum((laid.field * np.conj(field))[both]).real
    whole = np.sqrt(np.sum(np.abs(laid.field[both]) ** 2) * np.sum(np.abs(field[both]) ** 2))
    assert same / whole > 0.45


@pytest.mark.parametrize("seed", range(3))
def test_a_shifted_turned_and_scaled_photo_is_found__truth(tiny, seed):
    """Two hundred metres, two degrees, two per cent: an old footprint."""
    rng = np.random.default_rng(seed)
    name = tiny.names[seed]
    way = rng.uniform(0, 2 * np.pi)
    shift = rng.uniform(100, 200) * np.array([np.cos(way), np.sin(way)])
    prior = (100.0, 40.0, np.radians(1.2))
    opened = displaced(
        tiny, name, shift, rng.normal(0, np.radians(1.2)), 1 + rng.normal(0, 0.015), prior
    )
    before = astray_m(tiny, name, opened.photo.exterior)
    best = place_photo(opened, tiny.reference, QUICK)[0]
    # It takes the photo as vertical: tilts of a degree remain, some ten metres in the corners.
    assert before > 90
    assert astray_m(tiny, name, best.exterior) < 15
    sigma = np.sqrt(np.diag(best.covariance))
    assert (np.abs(best.exterior.centre - tiny.photos[name].exterior.centre) < 4 * sigma[:3]).all()


@pytest.mark.parametrize(("number", "turn"), [(3, np.pi), (1, 2.0)])
def test_a_photo_of_unknown_turn_is_sought_round_the_circle__truth(tiny, number, turn):
    """A scan lying upside down, or anyhow, in the scanner.

    On the ground of its own epoch: on today's, so coarse a photo is as much like other places, and
    what is placed there has yet to prove itself by points.
    """
    name = tiny.names[number]
    shift = np.array([40.0, -60.0])
    opened = displaced(tiny, name, shift, turn, 1.0, (30.0, 5.0, np.pi))
    best = place_photo(opened, tiny.archival(), QUICK)[0]
    wrong = np.angle(np.exp(1j * (best.exterior.kappa - tiny.photos[name].exterior.kappa)))
    assert abs(wrong) < np.radians(1.5)
    assert astray_m(tiny, name, best.exterior) < 25


def test_the_trials_reach_round_the_circle_when_nothing_is_known__law(tiny, monkeypatch):
    """Turns and scales that are tried, and how far the photo may be shifted."""

    def reach(sigma_m, sigma_kappa, sigma_height, options):
        opened = displaced(
            tiny, tiny.names[0], np.zeros(2), 0.0, 1.0, (sigma_m, sigma_height, sigma_kappa)
        )
        tried = []

        def search(self, trials, *_):
            tried.append((np.array(trials), self.radius_px * self.gsd_m))
            return []

        monkeypatch.setattr("core.matching.global_search.Level.search", search)
        assert place_photo(opened, tiny.reference, options) == ()
        (trials, radius_m), *_ = tried
        return np.abs(trials[:, 0]).max(), np.abs(trials[:, 1] - 1).max(), radius_m

    turn, scale, _ = reach(10.0, np.pi, 1.0, QUICK)
    assert turn > np.pi - 0.04  # a step of the coarsest
    assert scale == 0.0
    turn, scale, near = reach(10.0, 1e-4, 1e-3, QUICK)
    # No more than half a step of turns to either side of the only one.
    assert (turn < np.radians(1.5), scale) == (True, 0.0)
    assert reach(10.0, np.pi, 1e4, NARROW)[0] <= NARROW.most_turn + np.radians(1.0)
    assert reach(10.0, np.pi, 1e4, NARROW)[1] <= NARROW.most_scale + 1e-6
    photo = tiny.photos[tiny.names[0]]
    tilt = 0.01 * (photo.exterior.centre[2] - photo.ground_height_m)
    far = reach(100.0, 1e-4, 1e-3, QUICK)[2]
    # To half a pixel of the first search.
    pixel_m = tiny.opened(tiny.names[0]).width_m / QUICK.photo_px
    assert near == pytest.approx(2.5 * np.hypot(10, tilt), abs=pixel_m)
    assert far == pytest.approx(2.5 * np.hypot(100, tilt), abs=pixel_m)


def displaced(tiny, name, shift_m, turn, scale, prior) -> OpenPhoto:
    """A photo as an archive would have it: vertical, shifted, turned and scaled."""
    photo = tiny.photos[name]
    true = photo.exterior
    above = (true.centre[2] - photo.ground_height_m) * scale
    under = photo.object_from_pixel(
        np.array([photo.size_px]) / 2, np.array([photo.ground_height_m]), tiny.truth.camera
    )[0]
    centre = np.array([*(under[:2] + shift_m), photo.ground_height_m + above])
    start = ExteriorOrientation(centre, 0.0, 0.0, true.kappa + turn)
    sigma_m, sigma_height_m, sigma_kappa = prior
    sigmas = ExteriorPrior(
        locked([sigma_m, sigma_m, sigma_height_m]), locked([0.01, 0.01, sigma_kappa])
    )
    moved = replace(photo, exterior=start, approximate=start, prior=sigmas)
    return OpenPhoto(moved, tiny.truth.camera, tiny.scans[name])


def astray_m(tiny, name, exterior) -> float:
    """RMS distance on the ground, over the photo, between a placement and the truth."""
    photo, camera = tiny.photos[name], tiny.truth.camera
    share = np.stack(np.meshgrid([0.2, 0.5, 0.8], [0.2, 0.5, 0.8]), axis=-1).reshape(-1, 2)
    pixels = share * np.array(photo.size_px)
    heights = np.full(len(pixels), photo.ground_height_m)
    true = photo.object_from_pixel(pixels, heights, camera)
    found = photo.with_exterior(exterior, False).object_from_pixel(pixels, heights, camera)
    return float(np.sqrt(np.mean(np.sum((found - true) ** 2, axis=1))))


def test_a_placement_is_the_turn_about_the_nadir_it_says__law(tiny):
    name = tiny.names[0]
    opened = tiny.opened(name)
    turn = Turn(0.5, 1.1, 30.0, -20.0, 0.4, 9.0)
    was = opened.photo.exterior
    ground = opened.photo.ground_height_m
    there = turn.moved(was, was.centre[:2], ground)
    np.testing.assert_allclose(there.centre[:2], was.centre[:2] + np.array([30.0, -20.0]))
    assert there.centre[2] - ground == pytest.approx(1.1 * (was.centre[2] - ground))
    about = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    share = np.array([[0.3, 0.4], [0.7, 0.6]]) * np.array(opened.photo.size_px)
    heights, camera = np.full(2, ground), tiny.truth.camera
    before = opened.photo.object_from_pixel(share, heights, camera)[:, :2] - was.centre[:2]
    after = opened.at(there).photo.object_from_pixel(share, heights, camera)[:, :2]
    np.testing.assert_allclose(
        after - there.centre[:2], 1.1 * before @ about.T, atol=0.2
    )  # curvature apart


def test_the_picture_turns_as_the_photo_does__law():
    """Counter-clockwise on the ground, about the middle."""
    side = 101
    field = np.zeros((side, side), np.complex64)
    field[50, 80] = 1.0  # east of the middle
    laid = Laid(Grid(0.0, 101.0, 1.0, side, side), field, np.ones((side, side), bool))
    there, mask = turned(laid, np.pi / 2, 1.0)
    assert np.unravel_index(np.abs(there).argmax(), there.shape) == (20, 50)  # north of it
    assert mask[50, 50]
    smaller, _ = turned(laid, 0.0, 0.5)
    assert np.unravel_index(np.abs(smaller).argmax(), smaller.shape) == (50, 65)


@pytest.mark.parametrize("kappa", [-2.0, 0.3, np.pi / 2])
def test_turned_angles_are_the_angles_of_the_turned_picture__law(kappa):
    """A disc of smooth waves, turned before and after the angles are taken."""
    side = 201
    down, right = np.mgrid[:side, :side] - side // 2
    disc = np.hypot(down, right) < 80

    def waves(turn):
        along = np.cos(turn) * right - np.sin(turn) * down
        across = np.sin(turn) * right + np.cos(turn) * down
        image = np.sin(along / 9) + np.cos(across / 6 + along / 15)
        return angle_field(np.asarray(image, np.float32), disc)

    laid = Laid(Grid(0.0, side, 1.0, side, side), waves(0.0), disc)
    there, mask = turned(laid, kappa, 1.0)
    # The picture turned by kappa shows at p what was at p turned back by kappa.
    expected = waves(kappa)
    inner = mask & (np.hypot(down, right) < 70)
    same = np.sum((there * np.conj(expected))[inner]).real
    whole = np.sqrt(np.sum(np.abs(there[inner]) ** 2) * np.sum(np.abs(expected[inner]) ** 2))
    assert same / whole > 0.98


def test_the_laid_photo_is_the_ground__truth(tiny):
    """At the true orientation it equals the ortho of its day."""
    opened = tiny.opened(tiny.names[0])
    east, north = (float(value) for value in opened.photo.exterior.centre[:2])
    half = 0.8 * opened.width_m
    grid = Grid.over((east - half, north - half, east + half, north + half), 4.0)
    laid = laid_on_ground(opened, tiny.reference, grid)
    patch = tiny.archival().ortho.read(laid.grid)
    both = laid.mask & patch.mask
    assert both.mean() > 0.3
    field = angle_field(patch.values, patch.mask)
    same = np.sum((laid.field * np.conj(field))[both]).real
    whole = np.sqrt(np.sum(np.abs(laid.field[both]) ** 2) * np.sum(np.abs(field[both]) ** 2))
    assert same / whole > 0.5


def test_the_best_turns_differ__law():
    turns = [
        Turn(0.0, 1.0, 0.0, 0.0, 0.5, 9.0),
        Turn(0.02, 1.0, 3.0, 0.0, 0.5, 8.0),
        Turn(np.pi, 1.0, 0.0, 0.0, 0.4, 7.0),
        Turn(-np.pi + 0.01, 1.0, 0.0, 0.0, 0.4, 6.5),
        Turn(0.0, 1.0, 200.0, 0.0, 0.4, 6.0),
    ]
    assert distinct(turns[::-1], 5, 1000.0) == [turns[0], turns[2], turns[4]]
    assert distinct(turns, 1, 1000.0) == [turns[0]]
    assert distinct([], 3, 1000.0) == []
    assert distinct(turns, 5, 1000.0, beside=turns[:1]) == [turns[2], turns[4]]
    assert apart([turns[4], *turns], 2, 1000.0) == [turns[4], turns[0]]


def test_a_placed_photo_knows_its_middle_better_than_its_corners__truth(tiny):
    opened = tiny.opened(tiny.names[0])
    covariance = placement_covariance(opened, 5.0)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    prior = np.concatenate([opened.photo.prior.sigma_centre_m, opened.photo.prior.sigma_angles])
    assert (np.sqrt(np.diag(covariance)) <= prior + 1e-9).all()
