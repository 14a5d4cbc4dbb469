"""Photos brought into each other's right place by ties alone, against flights that are known."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.block import ExteriorPrior
from core.geometry.exterior import ExteriorOrientation
from core.geometry.transforms import fit_similarity
from core.georeference.approximation import Ground, approximate_in_area
from core.localisation.free_block import (
    connected_photos,
    free_blocks,
    part,
    plane_block,
)
from tests.flights import FlightPlan, fly

OPTIONS = AdjustmentOptions()
LOST = ExteriorPrior(np.array([400.0, 400.0, 150.0]), np.radians([3.0, 3.0, 10.0]))


def scattered(flight, rng, sigma_m=300.0, turn=0.0, quarters=False):
    """The flight's block as poor footprints would have it, and what they leave open."""
    photos, hypotheses = {}, {}
    middle = np.mean([p.exterior.centre for p in flight.truth.photos.values()], axis=0)
    about = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for name, photo in flight.block.photos.items():
        true = flight.truth.photos[name].exterior
        plan = about @ (true.centre - middle)[:2] + middle[:2] + rng.normal(size=2) * sigma_m
        centre = np.array([*plan, true.centre[2] + rng.normal() * 100])
        kappa = true.kappa + turn + rng.normal() * np.radians(5)
        kappas = kappa + np.arange(4) * np.pi / 2 if quarters else [kappa]
        kappas = rng.permutation(kappas)
        hypotheses[name] = tuple(ExteriorOrientation(centre, 0.0, 0.0, float(k)) for k in kappas)
        first = hypotheses[name][0]
        photos[name] = replace(photo, exterior=first, approximate=first, prior=LOST, oriented=False)
    return flight.block.with_photos(photos), hypotheses


def shape_error_m(free, truth):
    """RMS of places under the photos after one similarity onto the true ones, in plan."""

    def places(photos):
        found = []
        for name in free.block.photos:
            size = np.array(photos[name].size_px)
            pixels = size * np.array([[0.2, 0.2], [0.5, 0.5], [0.8, 0.3], [0.3, 0.8]])
            heights = np.full(4, 300.0)
            found.append(photos[name].object_from_pixel(pixels, heights, truth.cameras["wide"]))
        return np.concatenate(found)[:, :2]

    return fit_similarity(places(free.block.photos), places(truth.photos)).rms


@pytest.mark.parametrize("quarters", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_ties_alone_give_the_block_its_shape__truth(seed, quarters):
    """Footprints hundreds of metres off, kappa open by quarters: a stiff block all the same."""
    rng = np.random.default_rng(seed)
    flight = fly(FlightPlan(control=0, check=0), rng)
    block, hypotheses = scattered(flight, rng, quarters=quarters)
    (free,) = free_blocks(block, hypotheses, OPTIONS)
    assert free.tied
    assert set(free.block.photos) == set(block.photos)
    assert shape_error_m(free, flight.truth) < 12.0


def test_a_block_turned_as_a_whole_leaves_its_turn_open__truth():
    """Kappas by quarters and positions agree: the true turn is among those that are left."""
    rng = np.random.default_rng(5)
    flight = fly(FlightPlan(control=0, check=0), rng)
    block, hypotheses = scattered(flight, rng, turn=np.radians(9), quarters=True)
    (free,) = free_blocks(block, hypotheses, OPTIONS)
    kappa = {n: p.exterior.kappa for n, p in free.block.photos.items()}
    off = np.angle(
        np.mean(
            [np.exp(1j * (p.exterior.kappa - kappa[n])) for n, p in flight.truth.photos.items()]
        )
    )
    away = np.abs(np.angle(np.exp(1j * (free.turns - off))))
    assert away.min() < np.radians(1.0)
    assert len(free.turns) < 120
    assert free.turn_sigmas[0] == 0
    assert (np.diff(free.turn_sigmas) >= 0).all()
    assert free.turn_sigmas[np.argmin(away)] < 1.5


def test_sources_that_name_one_place_for_all_do_not_draw_the_block_together__truth():
    """Nothing but the scale is known, a twentieth too large."""
    rng = np.random.default_rng(6)
    flight = fly(FlightPlan(control=0, check=0), rng)
    scale_number = 1050 * np.mean(
        [
            (p.exterior.centre[2] - p.ground_height_m)
            / flight.truth.camera_of(n).principal_distance_mm
            for n, p in flight.truth.photos.items()
        ]
    )
    photos, hypotheses = {}, {}
    for name, photo in flight.block.photos.items():
        camera = flight.block.camera_of(name)
        ground = Ground("EPSG:5514", photo.ground_height_m)
        found = approximate_in_area((-9000, -9000, 9000, 9000), scale_number, camera, ground)
        hypotheses[name] = found.hypotheses
        photos[name] = replace(
            photo, exterior=found.exterior, approximate=found.exterior, prior=found.prior
        )
    (free,) = free_blocks(flight.block.with_photos(photos), hypotheses, OPTIONS)
    assert shape_error_m(free, flight.truth) < 12.0
    found, true = (
        np.linalg.norm(np.ptp([p.exterior.centre[:2] for p in photos.values()], axis=0))
        for photos in (free.block.photos, flight.truth.photos)
    )
    assert found / true == pytest.approx(1.05, abs=0.04)
    turns = np.sort(free.turns)
    assert np.max(np.diff(turns)) < np.radians(1.5)
    assert np.ptp(turns) > np.radians(355)


def test_wrong_rays_do_not_bend_the_plane_block__truth():
    """One ray in twenty points somewhere else."""
    rng = np.random.default_rng(1)
    flight = fly(FlightPlan(control=0, check=0, relief_m=0.0), rng)
    ties = flight.block.ties
    pixels = ties.pixels.copy()
    wrong = rng.random(len(pixels)) < 0.05
    pixels[wrong] = rng.uniform(500, 11000, (int(wrong.sum()), 2))

    def places(block):
        values = plane_block(block)
        true = np.array([p.exterior.centre[:2] for p in flight.truth.photos.values()])
        return fit_similarity(np.ascontiguousarray(values[:, 2:]), true).rms

    whole = places(flight.block)
    assert places(replace(flight.block, ties=replace(ties, pixels=pixels))) < whole + 20.0


def test_photos_without_common_ties_stay_apart__law():
    rng = np.random.default_rng(2)
    block = fly(FlightPlan(control=0, check=0), rng).block
    names = sorted(block.photos)
    lonely = names[2]
    others = part(block, [name for name in names if name != lonely])
    cut = replace(block, ties=others.ties)
    assert connected_photos(cut) == [tuple(n for n in names if n != lonely), (lonely,)]
    hypotheses = {name: (photo.exterior,) for name, photo in cut.photos.items()}
    together, alone = free_blocks(cut, hypotheses, OPTIONS)
    assert together.tied
    assert not alone.tied
    assert list(alone.block.photos) == [lonely]
    assert alone.block.ties.count == 0
