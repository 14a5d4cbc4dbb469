"""How far a measurement is checked by all others."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.quality.assessment import assess_block
from core.quality.controllability import UNCHECKED, controllability, unchecked_control
from core.quality.rules import judge_block
from tests.flights import FlightPlan, fly

PLAIN = AdjustmentOptions(estimate_cameras=False, robust=False)
ERROR_PX = 5.0


@pytest.fixture(scope="module")
def adjusted():
    """A block whose control gives way to its measurements."""
    plan = FlightPlan(ties=60, control=8, check=0, camera_errors=False)
    block = fly(plan, np.random.default_rng(41)).block
    weak = {
        name: replace(point, sigma_m=point.sigma_m * 10) for name, point in block.surveyed.items()
    }
    block = replace(block, surveyed=weak)
    return block, adjust_block(block, PLAIN)


def expected(report, key):
    photo = report.block.photos[key[1]]
    position = report.block.surveyed[key[0]].position
    return photo.pixel_from_object(position[None], report.block.camera_of(key[1]))[0]


def test_no_less_of_an_error_shows_than_is_told__truth(adjusted):
    """The residual shows little of it: the coordinates follow."""
    block, report = adjusted
    told = controllability(report)
    for key in list(told)[::4]:
        place, shown = block.measurements[key], []
        for shift in np.eye(2) * ERROR_PX:
            moved = replace(place, column=place.column + shift[0], row=place.row + shift[1])
            follows = expected(adjust_block(block.with_measurement(moved), PLAIN), key)
            shown.append(1 - (follows - expected(report, key)) @ shift / ERROR_PX**2)
        assert np.mean(shown) > told[key] - 0.05
        assert np.mean(shown) > 2 * report.redundancy_numbers[key]


def test_it_lies_between_the_redundancy_number_and_all__law(adjusted):
    report = adjusted[1]
    found = controllability(report)
    assert set(found) == set(report.redundancy_numbers)
    assert all(report.redundancy_numbers[key] <= value <= 1 for key, value in found.items())


def test_the_least_checked_comes_first__law(adjusted):
    report = adjusted[1]
    numbers = dict.fromkeys(report.redundancy_numbers, 1.0)
    first, second, *_ = numbers
    # Coordinates that nothing adds to do not check their measurement.
    bare = replace(
        report,
        surveyed_sigmas_m={},
        redundancy_numbers={
            **numbers,
            first: UNCHECKED / 2,
            second: UNCHECKED / 4,
        },
    )
    assert unchecked_control(bare) == [second, first]


def test_where_nothing_is_redundant_everything_is_unchecked__law():
    """One photo on three points: sigma nought is not known, and its NaN hid that."""
    plan = FlightPlan(strips=1, photos_per_strip=1, ties=0, control=3, check=0, camera_errors=False)
    report = adjust_block(fly(plan, np.random.default_rng(2)).block, PLAIN)
    assert np.isnan(report.sigma_nought)
    assert report.unit == 1.0
    assert report.redundancy_numbers
    assert set(unchecked_control(report)) == set(report.redundancy_numbers)
    assert "sigma-none" in {found.kind for found in judge_block(assess_block(report), report)}
