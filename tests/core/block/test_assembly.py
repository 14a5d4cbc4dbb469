"""The block stands up: photos on the reference, photos carried by ties, gross control left out."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.adjusted import AdjustmentOptions
from core.block.adjustment import adjust_block
from core.block.assembly import (
    MIN_TIES,
    AssemblyOptions,
    Site,
    adjusted_without_gross,
    agreed_measurement,
    carried_by_ties,
    held_together,
    proposals,
    stood_up,
)
from core.block.block import Block, Measurement, Peak, TiePoints
from core.block.matching import Found
from core.block.orientation import OrientationOptions, OrientedPhoto, ReferencePoints
from core.block.patches import object_on_ground
from core.doubts import Failure
from core.errors import OrientationError
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import moved
from core.synthetic.truth import judge_orientations
from tests.flights import FlightPlan, fly

NONE = ReferencePoints((), np.zeros((0, 3)), np.zeros((0, 3)))
FALLEN = Failure("3 of 40 points agree, which chance alone could bring about")


def ground_over(tiny, count=24) -> np.ndarray:
    """True ground on a lattice over the whole block."""
    centres = np.array([photo.exterior.centre[:2] for photo in tiny.photos.values()])
    low, high = centres.min(axis=0) - 300, centres.max(axis=0) + 300
    plan = np.stack(np.meshgrid(*np.linspace(low, high, count).T), axis=-1).reshape(-1, 2)
    flat = np.column_stack([plan, np.full(len(plan), 0.0)])
    flat[:, 2] = tiny.truth.heights_at(flat)
    return flat


def true_ties(tiny, noise_px=0.3) -> TiePoints:
    """Ground seen by two photos or more, measured where it truly shows."""
    ground, rng = ground_over(tiny), np.random.default_rng(0)
    rays = []
    for index, name in enumerate(tiny.names):
        photo = tiny.photos[name]
        pixels = photo.pixel_from_object(ground, tiny.truth.camera)
        inside = ((pixels > 60) & (pixels < np.array(photo.size_px) - 60)).all(axis=1)
        rays += [(int(point), index, *pixels[point]) for point in np.flatnonzero(inside)]
    rays = np.array(sorted(rays))
    points, inverse, seen = np.unique(rays[:, 0], return_inverse=True, return_counts=True)
    rays = rays[seen[inverse] >= 2]
    point = np.unique(rays[:, 0], return_inverse=True)[1]
    pixels = rays[:, 2:] + rng.normal(size=(len(rays), 2)) * noise_px
    return TiePoints(
        tuple(tiny.names), point, rays[:, 1].astype(int), pixels, np.full(len(rays), 0.5)
    )


@pytest.fixture(scope="module")
def site(tiny) -> Site:
    return Site(tiny.reference, tiny.scans, NONE, {})


@pytest.fixture(scope="module")
def tied(tiny) -> Block:
    """The tiny block with true ties, every photo where its archive would put it."""
    rng = np.random.default_rng(2)
    photos = {}
    for name, photo in tiny.photos.items():
        start = moved(photo.exterior, rng.normal(size=6) * [8, 8, 8, 0.01, 0.01, 0.004])
        photos[name] = replace(photo, exterior=start, approximate=start, oriented=False)
    return replace(tiny.block.with_photos(photos), ties=true_ties(tiny))


def standing(tiny, *fallen: str):
    """What single photos found: the truth, but for those that did not stand."""
    return {
        name: FALLEN
        if name in fallen
        else OrientedPhoto(
            tiny.photos[name].exterior, np.eye(6) * 1e-4, (), np.zeros(0, np.int64), -9.0
        )
        for name in tiny.names
    }


def test_a_photo_that_did_not_stand_is_carried_by_its_ties__truth(tiny, tied, site):
    name = tiny.names[1]
    block, doubts = stood_up(tied, site, standing(tiny, name), np.random.default_rng(0))
    assert all(photo.oriented for photo in block.photos.values())
    astray = judge_orientations(tiny.truth, block)
    assert astray.ground_m[astray.photo_ids.index(name)] < 0.5
    (doubt,) = doubts
    assert (doubt.kind, doubt.subject, doubt.gravity) == ("photo-orientation", name, 0.5)
    assert "carried by tie points" in doubt.message
    assert FALLEN.reason in doubt.message


def test_one_photo_carries_the_next__truth(tiny, tied, site):
    """A photo that ties reach only through one that was carried itself."""
    outer, inner = tiny.names[0], tiny.names[1]
    block, doubts = stood_up(tied, site, standing(tiny, outer, inner), np.random.default_rng(0))
    assert all(photo.oriented for photo in block.photos.values())
    assert {doubt.subject for doubt in doubts} == {outer, inner}


def test_wrong_ties_carry_nobody_astray__truth(tiny, tied, site):
    """A third of its rays anywhere in the photo."""
    name = tiny.names[1]
    ties, rng = tied.ties, np.random.default_rng(1)
    mine = np.flatnonzero(ties.photo == ties.photo_ids.index(name))
    gross = rng.choice(mine, len(mine) // 3, replace=False)
    pixels = ties.pixels.copy()
    pixels[gross] = rng.uniform(80, 1000, (len(gross), 2))
    block, _ = stood_up(
        replace(tied, ties=replace(ties, pixels=pixels)),
        site,
        standing(tiny, name),
        np.random.default_rng(0),
    )
    astray = judge_orientations(tiny.truth, block)
    assert astray.ground_m[astray.photo_ids.index(name)] < 1.0


def test_a_photo_with_neither_is_left_out_with_a_doubt__truth(tiny, tied, site):
    name = tiny.names[2]
    ties = tied.ties
    others = ties.photo != ties.photo_ids.index(name)
    alone = replace(
        ties,
        point=np.unique(ties.point[others], return_inverse=True)[1],
        photo=ties.photo[others],
        pixels=ties.pixels[others],
        sigma_px=ties.sigma_px[others],
    )
    block, doubts = stood_up(
        replace(tied, ties=alone), site, standing(tiny, name), np.random.default_rng(0)
    )
    assert not block.photos[name].oriented
    assert sum(photo.oriented for photo in block.photos.values()) == 5
    (doubt,) = doubts
    assert doubt.gravity > 0.8
    assert "left out: only 0 tie points" in doubt.message
    untied, (doubt,) = stood_up(
        replace(tied, ties=TiePoints.none()), site, standing(tiny, name), np.random.default_rng(0)
    )
    assert not untied.photos[name].oriented
    assert "no tie points" in doubt.message


def test_a_block_of_which_nothing_stands_is_an_error_with_a_remedy__truth(tiny, tied, site):
    with pytest.raises(OrientationError, match="none of the photos") as told:
        stood_up(tied, site, standing(tiny, *tiny.names), np.random.default_rng(0))
    assert "principal distance" in told.value.remedy


def test_too_few_ties_carry_nothing__law(tiny, tied, site):
    name = tiny.names[0]
    ties = tied.ties
    mine = np.flatnonzero(ties.photo == ties.photo_ids.index(name))[MIN_TIES - 1 :]
    keep = np.setdiff1d(np.arange(len(ties.point)), mine)
    few = replace(
        ties,
        point=ties.point[keep],
        photo=ties.photo[keep],
        pixels=ties.pixels[keep],
        sigma_px=ties.sigma_px[keep],
    )
    block, _ = stood_up(
        replace(tied, ties=few), site, standing(tiny, name), np.random.default_rng(0)
    )
    assert not block.photos[name].oriented
    assert isinstance(carried_by_ties(block, name, site, np.random.default_rng(0)), Failure)


def test_ties_pull_a_leaning_photo_into_line__truth(tiny, tied):
    """Woods moved all that one photo agreed on; the others hold it by their ties."""
    name = tiny.names[1]
    photos = {n: replace(p, oriented=True) for n, p in tiny.photos.items()}
    photos[name] = photos[name].with_exterior(
        moved(photos[name].exterior, np.array([6.0, -4.0, 0.0, 0.0, 0.0, 0.0])), True
    )
    block = replace(tied, photos=photos)
    ground = ground_over(tiny, 9)
    ids = tuple(f"P{i}" for i in range(len(ground)))
    points = ReferencePoints(ids, ground, np.full(ground.shape, 0.4))
    oriented = {}
    for n, photo in photos.items():
        pixels = photo.pixel_from_object(ground, tiny.truth.camera)
        seen = np.flatnonzero(((pixels > 60) & (pixels < 1018)).all(axis=1))
        found = tuple(
            Found(int(i), (Peak(*map(float, pixels[i]), 0.5, 9.0, "gradient"),), 400.0)
            for i in seen
        )
        oriented[n] = OrientedPhoto(photo.exterior, np.eye(6) * 1e-4, found, seen, -9.0)
    site = Site(tiny.reference, tiny.scans, points, dict.fromkeys(ids, "salient"))
    before = judge_orientations(tiny.truth, block).ground_m
    after = judge_orientations(tiny.truth, held_together(block, site, oriented, AssemblyOptions()))
    assert before.max() > 5
    # The six carry the one: its error is shared out.
    assert after.ground_m.max() < 0.5 * before.max()


def test_without_ties_photos_stay_as_they_are__law(tiny, site):
    block = tiny.block
    assert held_together(block, site, {}, AssemblyOptions()) is block


def test_of_an_agreeing_point_the_best_candidate_is_taken__law():
    points = ReferencePoints(("A", "B"), np.zeros((2, 3)), np.ones((2, 3)))
    peaks = (Peak(5.0, 6.0, 0.4, 9.0, "gradient"), Peak(9.0, 9.0, 0.4, 8.0, "ncc"))
    exterior = ExteriorOrientation(np.zeros(3), 0.0, 0.0, 0.0)
    found = OrientedPhoto(exterior, np.eye(6), (Found(1, peaks, 400.0),), np.array([1]), -5.0)
    assert agreed_measurement("p", points, found, 1) == Measurement("B", "p", 5.0, 6.0, 0.8)


def test_only_photos_that_stand_are_searched_for_control__truth(tiny):
    name = tiny.names[0]
    photo = tiny.photos[name]
    pixels = np.array([[400.0, 500.0], [600.0, 500.0]])
    ground = object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)
    points = ReferencePoints(("A", "B"), ground, np.full((2, 3), 0.3))
    site = Site(tiny.archival(), tiny.scans, points, {"A": "salient", "B": "salient"})
    block = tiny.block.with_photos(
        {n: replace(p, oriented=n == name) for n, p in tiny.photos.items()}
    )
    options = AssemblyOptions(orientation=OrientationOptions(template_half_px=30))
    found = proposals(block, site, options, map)
    assert {value.photo_id for value in found} == {name}


def gross_flight():
    """A good block, and the same with one control point fifteen metres off in the field."""
    flight = fly(
        FlightPlan(ties=200, control=24, check=6, camera_errors=False, start_m=5.0),
        np.random.default_rng(5),
    )
    seen = [key[0] for key in flight.block.measurements]
    name = max((n for n, p in flight.block.surveyed.items() if p.role == "control"), key=seen.count)
    point = flight.block.surveyed[name]
    wrong = replace(point, position=point.position + np.array([9.0, -12.0, 0.0]))
    return flight, replace(flight.block, surveyed={**flight.block.surveyed, name: wrong}), name


def test_gross_control_is_left_out_and_the_rest_does_not_move__truth():
    flight, spoilt, name = gross_flight()
    options = AdjustmentOptions(estimate_cameras=False)
    without = replace(
        flight.block,
        measurements={k: m for k, m in flight.block.measurements.items() if k[0] != name},
    )
    clean = adjusted_without_gross(without, options)
    found = adjusted_without_gross(spoilt, options)
    mine = [m for key, m in found.block.measurements.items() if key[0] == name]
    assert mine
    assert all(m.status == "unused" and m.reason for m in mine)
    others = [m for key, m in found.block.measurements.items() if key[0] != name]
    assert np.mean([m.used for m in others]) > 0.97
    for photo in found.block.photos:
        apart = (
            found.block.photos[photo].exterior.centre - clean.block.photos[photo].exterior.centre
        )
        sigma = clean.exterior_sigmas[photo].centre_m
        assert (np.abs(apart) < 0.5 * sigma).all()
    assert 0.8 < found.sigma_nought < 1.2


def test_what_an_operator_accepted_is_never_left_out__law():
    """The engine may doubt it; it does not overrule a human."""
    _, spoilt, name = gross_flight()
    accepted = {
        key: replace(m, status="accepted") if key[0] == name else m
        for key, m in spoilt.measurements.items()
    }
    found = adjusted_without_gross(
        replace(spoilt, measurements=accepted), AdjustmentOptions(estimate_cameras=False)
    )
    kept = [m.status for key, m in found.block.measurements.items() if key[0] == name]
    assert set(kept) == {"accepted"}


def test_good_control_stays__law():
    flight, _, _ = gross_flight()
    options = AdjustmentOptions(estimate_cameras=False)
    found = adjusted_without_gross(flight.block, options)
    plain = adjust_block(flight.block, options)
    left_out = [k for k, m in found.block.measurements.items() if not m.used]
    assert len(left_out) <= 0.03 * len(found.block.measurements)
    for photo in found.block.photos:
        apart = (
            found.block.photos[photo].exterior.centre - plain.block.photos[photo].exterior.centre
        )
        assert (np.abs(apart) < plain.exterior_sigmas[photo].centre_m).all()
