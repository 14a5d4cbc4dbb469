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
from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
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


@pytest.mark.parametrize("stated", [0.5, 1.0, 2.0])
def test_what_check_points_are_worth_follows_from_how_their_rays_meet__truth(stated):
    """Pointing better or worse than is stated of hands: prediction and figure agree all the same,
    and a point whose rays do not meet at all changes nothing."""
    plan = FlightPlan(ties=120, control=20, check=40, camera_errors=False)
    ratios, told = [], []
    for seed in range(4):
        block = fly(plan, np.random.default_rng(seed)).block
        measured = {
            key: replace(item, sigma_px=stated) if block.surveyed[key[0]].role == "check" else item
            for key, item in block.measurements.items()
        }
        report = adjust_block(replace(block, measurements=measured), AdjustmentOptions())
        sigmas = np.array([check.sigma_m for check in report.checks])
        off = np.array([check.difference_m for check in report.checks])
        ratios.append(np.sqrt(np.mean(off[:, :2] ** 2) / np.mean(sigmas[:, :2] ** 2)))
        told.append(sigmas)
    # Ratios of one flight lie between 0.75 and 1.05; its points share what the block is off.
    assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.25
    check = next(c for c in report.checks if c.used_scans > 2)
    key = next(key for key in measured if key[0] == check.point_id)
    measured[key] = replace(measured[key], column=measured[key].column + 60)
    again = adjust_block(replace(block, measurements=measured), AdjustmentOptions())
    np.testing.assert_allclose([c.sigma_m for c in again.checks], told[-1], rtol=0.1)
