"""Places from rays, and how surely other photos show them: errors are as large as is said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.block import Measurement, SurveyedPoint
from core.control.located import Located, Surroundings, expected_spread, locate_point
from core.control.prediction import JointErrors
from tests.flights import FlightPlan, fly

OPTIONS = AdjustmentOptions(robust=False)
POINTING_PX = 0.4
HEIGHT_M = 0.3


def misses(seed: int, rays: int, joint: bool) -> np.ndarray:
    """Squared normalised errors of places transferred from some photos to one more."""
    rng = np.random.default_rng(seed)
    # Control so loose that the block as a whole is off by far more than photos against each other.
    plan = FlightPlan(ties=300, control=8, check=0, control_sigma_m=(3.0, 3.0, 3.0))
    flight = fly(plan, rng)
    report = adjust_block(flight.block, OPTIONS)
    photos = report.block.photos
    around = Surroundings(report.block, {}, report.exterior_sigmas)
    if joint:
        equations = influence_of(report, OPTIONS)
        assert equations is not None
        around = replace(around, joint=JointErrors(equations, report.sigma_nought))
    errors = []
    for place in flight.ties[rng.choice(len(flight.ties), 25, replace=False)]:
        known = place + np.array([0.0, 0.0, rng.normal(0, HEIGHT_M)])
        point = SurveyedPoint("P", known, np.array([9.0, 9.0, HEIGHT_M]), "control", "surveyed")
        pixels = {
            name: photo.pixel_from_object(place[None], flight.truth.camera_of(name))[0]
            for name, photo in flight.truth.photos.items()
        }
        seen = [n for n, p in pixels.items() if ((p > 0) & (p < photos[n].size_px)).all()]
        if len(seen) <= rays:
            continue
        measured = [
            Measurement("P", n, *(pixels[n] + rng.normal(0, POINTING_PX, 2)).tolist(), POINTING_PX)
            for n in seen[:rays]
        ]
        where = locate_point(around, measured, point)
        assert isinstance(where, Located)
        target = photos[seen[-1]]
        found = target.pixel_from_object(
            where.position[None], report.block.camera_of(target.photo_id)
        )[0]
        away = found - pixels[target.photo_id]
        spread = expected_spread(around, where, target)
        errors.append([away @ np.linalg.solve(spread, away), np.sqrt(np.trace(spread) / 2)])
    return np.array(errors)


@pytest.mark.parametrize("rays", [1, 2])
def test_errors_of_a_transfer_are_as_large_as_all_photos_together_say__truth(rays):
    squares, sizes = np.concatenate([misses(seed, rays, True) for seed in range(8)]).T
    # Points share photos: eight flights average that out.
    assert 0.7 < squares.mean() / 2 < 1.4
    assert np.mean(squares < stats.chi2.ppf(0.95, 2)) > 0.87
    # Photos each by themselves know nothing of what they share.
    _, alone = misses(0, rays, False).T
    assert np.median(alone) > 2 * np.median(sizes)
