"""Predicted places of points nobody has measured: errors are as large as is said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.block import SurveyedPoint
from core.control.prediction import (
    EDGE_MM,
    covariances_of,
    predict_points,
    shown_in,
)
from tests.flights import FlightPlan, fly

OPTIONS = AdjustmentOptions(robust=False)
SIGMA_M = np.array([0.05, 0.05, 0.1])
SEEDS = range(12)


def user_points(flight, rng, count=30):
    """Points that nobody measured: true places, and what a list says of them."""
    places = flight.ties[rng.choice(len(flight.ties), count, replace=False)]
    known = places + rng.normal(size=places.shape) * SIGMA_M
    names = [f"P{number}" for number in range(count)]
    points = [
        SurveyedPoint(name, place, SIGMA_M, "control", "surveyed")
        for name, place in zip(names, known, strict=True)
    ]
    return points, dict(zip(names, places, strict=True))


def squares(flight, found, places):
    """Squared normalised errors of predictions, one row each."""
    errors = []
    for (point, name), one in found.items():
        photo, camera = flight.truth.photos[name], flight.truth.camera_of(name)
        true = photo.pixel_from_object(places[point][None], camera)[0]
        away = np.array([one.column, one.row]) - true
        errors.append(away @ np.linalg.solve(one.covariance, away))
    return np.array(errors)


def test_errors_are_as_large_as_the_ellipses_of_the_adjusted_block__truth():
    every = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        flight = fly(FlightPlan(ties=300, control=14, check=0), rng)
        report = adjust_block(flight.block, OPTIONS)
        known = covariances_of(influence_of(report, OPTIONS))
        assert next(iter(known.values())).shape == (11, 11)
        points, places = user_points(flight, rng)
        found = predict_points(report.block, points, known)
        every.append(squares(flight, found, places))
    joined = np.concatenate(every)
    # Points share photos, so errors of one flight go together: twelve flights average them out.
    assert 0.75 < joined.mean() / 2 < 1.3
    inside = np.mean(joined < stats.chi2.ppf(0.95, 2))
    assert 0.88 < inside <= 1.0


def test_errors_are_as_large_as_the_priors_say_without_an_adjustment__truth():
    every = []
    for seed in SEEDS:
        rng = np.random.default_rng(100 + seed)
        flight = fly(FlightPlan(ties=120, control=4, check=0, camera_errors=False), rng)
        points, places = user_points(flight, rng, 20)
        found = predict_points(flight.block, points, {})
        every.append(squares(flight, found, places))
    assert 0.75 < np.concatenate(every).mean() / 2 < 1.3


def test_a_block_that_fits_worse_has_larger_ellipses__law():
    rng = np.random.default_rng(1)
    flight = fly(FlightPlan(ties=100, control=10, check=0), rng)
    points, _ = user_points(flight, rng, 5)
    known = {name: np.eye(6) * 1e-6 for name in flight.block.photos}
    plain, worse = (predict_points(flight.block, points, known, unit) for unit in (0.7, 3.0))
    best = predict_points(flight.block, points, known, 1.0)
    for key, one in plain.items():
        np.testing.assert_allclose(one.covariance, best[key].covariance)
        assert np.linalg.det(worse[key].covariance) > np.linalg.det(one.covariance)


def test_the_best_view_comes_first_and_the_border_last__law():
    flight = fly(FlightPlan(), np.random.default_rng(2))
    points, _ = user_points(flight, np.random.default_rng(2), 40)
    found = list(predict_points(flight.block, points, {}).values())
    by_point = {}
    for one in found:
        by_point.setdefault(one.point_id, []).append(one)
    assert any(len(views) > 2 for views in by_point.values())
    for views in by_point.values():
        inner = [one.nadir_angle for one in views if one.margin_mm >= EDGE_MM]
        assert inner == sorted(inner)
        assert [one.margin_mm < EDGE_MM for one in views] == sorted(
            one.margin_mm < EDGE_MM for one in views
        )


@pytest.mark.parametrize("beside", [(0.0, 0.0, 4000.0), (9e4, 0.0, 0.0)])
def test_what_a_photo_does_not_show_is_not_predicted_there__law(beside):
    flight = fly(FlightPlan(), np.random.default_rng(3))
    name, photo = next(iter(flight.block.photos.items()))
    place = np.array([*photo.exterior.centre[:2], 300.0]) + np.array(beside)
    point = SurveyedPoint("far", place, SIGMA_M, "control", "surveyed")
    assert ("far", name) not in predict_points(flight.block, [point], {})
    _, margins = shown_in(photo, flight.block.camera_of(name), place[None])
    assert not margins[0] > 0


def test_a_place_is_as_far_off_as_its_ellipse_says__law():
    flight = fly(FlightPlan(), np.random.default_rng(5))
    points, _ = user_points(flight, np.random.default_rng(5), 4)
    one = next(iter(predict_points(flight.block, points, {}).values()))
    wide = replace(one, covariance=np.diag([9.0, 1.0]))
    across = wide.sigmas_away(wide.column + 3, wide.row, 0.0)
    along = wide.sigmas_away(wide.column, wide.row + 3, 0.0)
    assert along == pytest.approx(3 * across)
    assert wide.sigmas_away(wide.column + 3, wide.row, 4.0) < across
