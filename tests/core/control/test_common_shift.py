"""Salient points that all lean one way, told by the junctions."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.control.common_shift import common_shifts, weigh_salient_points
from core.quality.residuals import displacement
from tests.flights import FlightPlan, fly

PLAIN = AdjustmentOptions(estimate_cameras=False)
PLAN = FlightPlan(strips=2, photos_per_strip=4, ties=600, control=90, check=0, camera_errors=False)


def leaning(seed, shift, salient=30):
    """A flight whose last control points are salient ones, said to lie where they do not."""
    flight = fly(PLAN, np.random.default_rng(seed))
    control = sorted(flight.block.surveyed)
    surveyed = {
        name: replace(
            point,
            source="salient" if number < salient else "junction",
            position=point.position + (np.append(shift, 0.0) if number < salient else 0.0),
        )
        for number, (name, point) in enumerate((n, flight.block.surveyed[n]) for n in control)
    }
    return replace(flight.block, surveyed=surveyed), flight.truth


def error_m(report, truth):
    """RMS displacement of the ground under the frames, metres."""
    off = [
        displacement(
            replace(report.block.photos[name], approximate=photo.exterior), truth.cameras["wide"]
        ).rms_m
        for name, photo in truth.photos.items()
    ]
    return float(np.sqrt(np.mean(np.square(off))))


def test_the_shift_that_was_put_in_comes_out_with_its_sigma__truth():
    found = [common_shifts(leaning(seed, (0.5, -1.2))[0], PLAIN)[0] for seed in range(8)]
    off = np.array([(f.shift_m - (-0.5, 1.2)) / f.sigma_m for f in found])
    assert np.abs(off.mean()) < 0.6
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.4


def test_what_leans_weighs_less_and_the_block_stands_better__truth():
    worse, better = [], []
    for seed in range(4):
        block, truth = leaning(seed, (0.5, -1.2))
        (shift,) = common_shifts(block, PLAIN)
        lesser, told = weigh_salient_points(block, shift)
        worse.append(error_m(adjust_block(block, PLAIN), truth))
        better.append(error_m(adjust_block(lesser, PLAIN), truth))
        assert [doubt.kind for doubt in told] == ["common-shift"]
    assert np.mean(better) < 0.8 * np.mean(worse)


def test_points_that_do_not_lean_keep_their_weight__truth():
    told = 0
    for seed in range(8):
        block, _ = leaning(seed, (0.0, 0.0))
        (shift,) = common_shifts(block, PLAIN)
        told += len(weigh_salient_points(block, shift)[1])
        assert np.all(shift.shared_m < 2 * shift.sigma_m)
    assert told <= 1


@pytest.mark.parametrize("salient", [5, 80])
def test_too_few_of_a_kind_are_not_judged__law(salient):
    assert common_shifts(leaning(3, (0.5, -1.2), salient)[0], PLAIN) == ()
