"""The whole block found on the reference, from sources that are far off."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.arrays import locked
from core.block import Block, ExteriorPrior, TiePoints
from core.doubts import Failure
from core.geometry.exterior import ExteriorOrientation
from core.georeference.approximation import Ground, approximate_in_area
from core.localisation.block_placement import BlockPlacementOptions, laid_block, place_block
from core.localisation.free_block import FreeBlock, free_blocks
from core.matching.global_search import angle_field
from core.matching.patches import OpenPhoto
from tests.core.localisation.test_photo_placement import astray_m

OPTIONS = BlockPlacementOptions(block_px=300, most_work=1e8)


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
    placed = place_block(free, tiny.scans, tiny.reference, OPTIONS)
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
    assert len(set(places)) == len(places) == options.hypotheses


def test_nothing_but_the_scale_is_enough__truth(tiny):
    """No position and no kappa: the whole ortho is searched, a thirtieth off in scale."""
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
    placed = place_block(free, tiny.scans, tiny.reference, BlockPlacementOptions())
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
