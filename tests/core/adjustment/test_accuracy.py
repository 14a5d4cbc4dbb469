"""Check points and residuals by class."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.accuracy import (
    intersect_checks,
    known_differences,
    predicted_residuals,
    rms_by_class,
)
from tests.flights import FlightPlan, fly


@pytest.fixture(scope="module")
def exact():
    """The true orientations with the noisy measurements, and with exact ones."""
    plan = FlightPlan(control=5, check=10, control_sigma_px=1.0)
    flight = fly(plan, np.random.default_rng(0))
    noisy = replace(flight.truth, measurements=flight.block.measurements)
    residuals = predicted_residuals(noisy)
    sharp = {
        key: replace(m, column=m.column + residuals[key][0], row=m.row + residuals[key][1])
        for key, m in noisy.measurements.items()
    }
    return noisy, replace(noisy, measurements=sharp)


def test_exact_measurements_give_back_the_check_points__truth(exact):
    checks = intersect_checks(exact[1])
    assert len(checks) > 5
    for check in checks:
        np.testing.assert_allclose(check.difference_m, 0, atol=1e-5)
        np.testing.assert_allclose(
            check.position, exact[1].surveyed[check.point_id].position, atol=1e-5
        )


def test_residuals_are_the_noise_put_in__truth(exact):
    residuals = np.array(list(predicted_residuals(exact[0]).values()))
    # About 70 coordinates of 1 px.
    assert np.sqrt(np.mean(residuals**2)) == pytest.approx(1.0, abs=0.25)
    assert np.abs(np.array(list(predicted_residuals(exact[1]).values()))).max() < 1e-8


def test_one_photo_takes_the_known_height__law(exact):
    block = exact[1]
    photos = {
        name: replace(photo, oriented=name == "00_001") for name, photo in block.photos.items()
    }
    checks = intersect_checks(replace(block, photos=photos))
    assert checks
    for check in checks:
        assert check.used_scans == 1
        assert check.difference_m[2] == 0
        # Three steps of the curvature correction leave less than a tenth of a millimetre.
        np.testing.assert_allclose(check.difference_m, 0, atol=1e-4)
    # A height taken from the point itself is not a check of heights.
    table = known_differences(block, {}, checks)
    assert np.isnan(table["check_Z"])
    assert table["check_X"] < 1e-4


def test_unused_measurements_are_no_check__law(exact):
    block = exact[1]
    rejected = {key: replace(m, status="rejected") for key, m in block.measurements.items()}
    assert intersect_checks(replace(block, measurements=rejected)) == ()


def test_nothing_measured_gives_nan__law(exact):
    empty = replace(exact[1], measurements={})
    table = rms_by_class(empty, {}, frozenset(), np.full((4, 2), np.nan))
    assert set(table) == {"tie", "control", "check"}
    assert np.isnan(list(table.values())).all()
