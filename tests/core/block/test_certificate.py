"""A block is certified only where what is predicted of it is good enough and can be believed."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.adjusted import AdjustmentOptions
from core.block.adjustment import adjust_block
from core.block.certificate import certify
from core.block.displacement import displacement
from core.block.foresight import foresee
from tests.flights import FlightPlan, fly

PLAIN = AdjustmentOptions(estimate_cameras=False)
PLAN = FlightPlan(ties=400, control=30, check=0, camera_errors=False)


@pytest.fixture(scope="module")
def flight():
    return fly(PLAN, np.random.default_rng(4))


def judged(block, ortho_sigma_m=0.0):
    report = adjust_block(block, PLAIN)
    return certify(report, foresee(report, PLAIN), ortho_sigma_m)


def test_what_is_predicted_is_what_the_ground_is_off__truth():
    """Over several flights the predicted error is the true one."""
    ratios = []
    for seed in range(6):
        flight = fly(PLAN, np.random.default_rng(100 + seed))
        report = adjust_block(flight.block, PLAIN)
        off = [
            displacement(
                replace(report.block.photos[name], approximate=photo.exterior),
                flight.truth.cameras["wide"],
            ).rms_m
            for name, photo in flight.truth.photos.items()
        ]
        found = certify(report, foresee(report, PLAIN), 0.0)
        assert found.reasons == ()
        ratios.append(np.mean(np.square(off)) / found.predicted_m**2)
    assert 0.7 < np.sqrt(np.mean(ratios)) < 1.3


def test_an_inexact_reference_is_not_certified__truth(flight):
    fine, coarse = judged(flight.block, 0.25), judged(flight.block, 0.7)
    assert fine.reasons == ()
    assert coarse.reasons == ("predicted",)
    assert coarse.predicted_m > coarse.limit_m == pytest.approx(0.8)
    assert fine.worst_photo in flight.block.photos
    assert fine.worst_m > fine.predicted_m


def test_too_little_control_and_a_loose_photo_are_reasons__truth(flight):
    few = dict(sorted(flight.block.surveyed.items())[:2])
    measured = {k: v for k, v in flight.block.measurements.items() if k[0] in few}
    poor = judged(replace(flight.block, surveyed=few, measurements=measured))
    assert {"control-few", "predicted"} <= set(poor.reasons)
    first = next(iter(flight.block.photos))
    photos = {n: replace(p, oriented=n != first) for n, p in flight.block.photos.items()}
    assert judged(flight.block.with_photos(photos)).reasons == ("loose",)


def test_nothing_adjusted_is_not_certified__law(flight):
    photos = {n: replace(p, oriented=False) for n, p in flight.block.photos.items()}
    nothing = judged(flight.block.with_photos(photos))
    assert {"loose", "control-few", "predicted"} <= set(nothing.reasons)
    assert np.isnan(nothing.predicted_m)
