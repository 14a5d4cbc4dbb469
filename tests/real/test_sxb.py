"""SXB Strasbourg, five digital frames: our adjustment against the published DBAT report."""

from pathlib import Path

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from tests.real.readers import (
    SXB,
    SXB_MARK_SIGMA_PX,
    read_sxb,
    read_sxb_report,
    with_checks_as_ties,
)

# DBAT: camera held, no blunder detection.
AS_DBAT = AdjustmentOptions(estimate_cameras=False, robust=False)
SIGMA_NOUGHT_PX = 0.589299
CHECK_RMS_M = 0.421


@pytest.fixture(scope="module")
def report(shared_data: Path) -> AdjustmentReport:
    return adjust_block(read_sxb(shared_data / SXB), AS_DBAT)


def test_sigma_nought_as_published__real(report):
    # Within 5 %: our check points take no part, DBAT's do; the run gives 0.5826 px (-1.1 %).
    ours = report.sigma_nought * SXB_MARK_SIGMA_PX
    assert ours == pytest.approx(SIGMA_NOUGHT_PX, rel=0.05)


def test_check_points_no_worse_than_published__real(report):
    differences = np.array([check.difference_m for check in report.checks])
    assert [check.used_scans for check in report.checks] == [4, 3]
    # The run gives 0.417 m.
    assert np.sqrt(np.mean(np.sum(differences**2, axis=1))) <= CHECK_RMS_M


def test_snooping_finds_nothing_to_drop__real(report, shared_data):
    options = AdjustmentOptions(estimate_cameras=False, robust=True)
    robust = adjust_block(read_sxb(shared_data / SXB), options)
    assert not robust.rejected
    assert robust.sigma_nought == pytest.approx(report.sigma_nought, rel=1e-6)


def test_same_observations_give_the_published_orientations__real(shared_data):
    block = with_checks_as_ties(read_sxb(shared_data / SXB))
    report = adjust_block(block, AS_DBAT)
    # Published to six digits.
    assert report.sigma_nought * SXB_MARK_SIGMA_PX == pytest.approx(SIGMA_NOUGHT_PX, abs=1e-6)
    assert report.redundancy == 1261
    for name, known in read_sxb_report(shared_data / SXB).items():
        ours = report.block.photos[name].exterior
        # DBAT stops at a relative change of 1e-6: a thousandth of the centres' sigmas (0.4-0.9 m).
        assert np.abs(ours.centre - known.centre).max() < 1e-3
        # Published to 1e-6 degrees.
        assert np.degrees(abs(ours.omega - known.omega)) < 5e-5
        assert np.degrees(abs(ours.phi - known.phi)) < 5e-5
        assert np.degrees(abs(ours.kappa - known.kappa)) < 5e-5


def test_standard_deviations_as_published__real(shared_data):
    report = adjust_block(with_checks_as_ties(read_sxb(shared_data / SXB)), AS_DBAT)
    # Published to three digits.
    sigmas = report.exterior_sigmas["8937"]
    assert sigmas.centre_m == pytest.approx([0.343, 0.565, 0.0567], rel=2e-3)
    assert np.degrees(sigmas.angles) == pytest.approx([0.0181, 0.0108, 0.00166], rel=4e-3)
    assert report.surveyed_sigmas_m["403"] == pytest.approx([0.023, 0.0227, 0.0469], rel=4e-3)
