"""The block is brought together by its ties, searched for control, and rid of gross errors."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from core.block.adjusted import AdjustmentOptions
from core.block.adjustment import adjust_block
from core.block.assembly import (
    AssemblyOptions,
    adjusted_without_gross,
    held_together,
    searched,
)
from core.block.block import Peak
from core.block.registration.matching import Found
from core.block.registration.orientation import OrientationOptions, OrientedPhoto, ReferencePoints
from core.block.registration.patches import object_on_ground
from core.block.registration.standing import Site
from core.geometry.resection import moved
from core.synthetic.truth import judge_orientations
from tests.flights import FlightPlan, fly
from tests.tiny import ground_over, true_ties

NONE = ReferencePoints((), np.zeros((0, 3)), np.zeros((0, 3)))


def test_ties_pull_a_leaning_photo_into_line__truth(tiny):
    """Woods moved all that one photo agreed on; the others hold it by their ties."""
    name = tiny.names[1]
    photos = {n: replace(p, oriented=True) for n, p in tiny.photos.items()}
    photos[name] = photos[name].with_exterior(
        moved(photos[name].exterior, np.array([6.0, -4.0, 0.0, 0.0, 0.0, 0.0])), True
    )
    block = replace(tiny.block.with_photos(photos), ties=true_ties(tiny))
    ground = ground_over(tiny, 9)
    ids = tuple(f"P{i}" for i in range(len(ground)))
    points = ReferencePoints(ids, ground, np.full(ground.shape, 0.4))
    oriented = {}
    for n, photo in photos.items():
        pixels = photo.pixel_from_object(ground, tiny.truth.camera)
        seen = np.flatnonzero(((pixels > 60) & (pixels < 1018)).all(axis=1))
        peaks = tuple(Peak(*map(float, pixels[i]), 0.5, 9.0, "gradient") for i in seen)
        # The best candidate of every point lies elsewhere; it is the second that agreed.
        best = Peak(300.0, 300.0, 0.5, 20.0, "ncc")
        found = tuple(
            Found(int(i), (best, peak), 400.0) for i, peak in zip(seen, peaks, strict=True)
        )
        oriented[n] = OrientedPhoto(photo.exterior, np.eye(6) * 1e-4, found, seen, peaks, -9.0)
    site = Site(tiny.reference, tiny.scans, points, dict.fromkeys(ids, "salient"))
    before = judge_orientations(tiny.truth, block).ground_m
    after = judge_orientations(tiny.truth, held_together(block, site, oriented, AssemblyOptions()))
    assert before.max() > 5
    # The six carry the one: its error is shared out.
    assert after.ground_m.max() < 0.5 * before.max()


def test_without_ties_photos_stay_as_they_are__law(tiny):
    block = tiny.block
    site = Site(tiny.reference, tiny.scans, NONE, {})
    assert held_together(block, site, {}, AssemblyOptions()) is block


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
    found = searched(block, site, options, map)
    assert {value.photo_id for value in found} == {name}


def test_one_worker_and_two_propose_the_same__law(tiny):
    """To the last digit, whichever photo is done first."""
    ground = ground_over(tiny, 5)
    ids = tuple(f"P{i:02d}" for i in range(len(ground)))
    points = ReferencePoints(ids, ground, np.full(ground.shape, 0.4))
    site = Site(tiny.reference, tiny.scans, points, dict.fromkeys(ids, "salient"))
    block = tiny.block.with_photos({n: replace(p, oriented=True) for n, p in tiny.photos.items()})
    options = AssemblyOptions(orientation=OrientationOptions(template_half_px=30))
    alone = searched(block, site, options, map)
    with ThreadPoolExecutor(2) as pool:
        together = searched(block, site, options, pool.map)
    assert len(alone) > 20
    assert repr(alone) == repr(together)


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
