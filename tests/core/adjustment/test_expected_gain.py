"""Wrong control is found although it bends what it is judged by; gains are in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block, adjust_with_solution
from core.adjustment.expected_gain import expected_gains, measuring_gains
from core.adjustment.influence import influence_of
from core.block import HAND_SIGMA_PX, Measurement, SurveyedPoint
from tests.core.adjustment.test_influence import step_between
from tests.flights import FlightPlan, fly
from tests.ui.desk_block import tiny_block

OPTIONS = AdjustmentOptions(estimate_cameras=False, robust=False)


@pytest.fixture(scope="module")
def report():
    return adjust_block(tiny_block().block, OPTIONS)


@pytest.fixture(scope="module")
def ahead(report):
    return influence_of(report, OPTIONS)


def test_the_wrong_ones_are_told_from_the_right_ones__truth(report, ahead):
    gains = expected_gains(ahead)
    blunders = {key for key in tiny_block().blunders if key in gains}
    assert len(blunders) > 5
    wrong = {key for key, gain in gains.items() if gain.wrong > 0.5}
    assert len(blunders & wrong) >= 0.9 * len(blunders)
    assert len(wrong - blunders) <= 0.05 * len(gains)
    first = sorted(gains, key=lambda key: -gains[key].expected_m)[: len(blunders)]
    assert len(blunders & set(first)) >= 0.8 * len(blunders)


def test_without_weights_lost_it_is_the_shift_by_rejecting__oracle(report, ahead):
    """Nobody doubts the others: then it is what the adjustment does without the measurement."""
    none = expected_gains(ahead, set())
    for key in list(none)[:4]:
        out = replace(report.block.measurements[key], status="rejected")
        _, solution = adjust_with_solution(report.block.with_measurement(out), OPTIONS)
        moved = ahead.ground.of(step_between(ahead, solution))
        assert none[key].shift_m == pytest.approx(np.sqrt(2 * np.mean(moved**2)), rel=0.03)


def test_what_somebody_accepted_is_not_asked_for__law(report):
    block = tiny_block().block
    key = next(key for key, item in block.measurements.items() if item.used)
    accepted = block.with_measurement(replace(block.measurements[key], status="accepted"))
    ahead = influence_of(adjust_block(accepted, OPTIONS), OPTIONS)
    assert key not in expected_gains(ahead)


def test_batches_change_nothing__law(ahead, monkeypatch):
    whole = expected_gains(ahead)
    monkeypatch.setattr("core.adjustment.expected_gain.BATCH", 7)
    parts = expected_gains(ahead)
    assert list(parts) == list(whole)
    for key, gain in whole.items():
        assert parts[key].shift_m == pytest.approx(gain.shift_m, rel=1e-9)
        assert parts[key].wrong == pytest.approx(gain.wrong, rel=1e-9)


def test_weights_lost_are_those_of_the_whole_hat_matrix__oracle(ahead):
    """The same formulas with every matrix whole; two of the wrong ones are of one point."""
    network, rays = ahead.solution.network, ahead.control_rays
    keys = [network.measurements[row].key for row in network.rays.measurement[rays].tolist()]
    twice = next(key for key in keys if sum(other[0] == key[0] for other in keys) > 1)
    wrong = {key for key in keys if key[0] == twice[0]} | set(keys[::9])
    down = np.repeat([float(key in wrong) for key in keys], 2)
    rows, whitened = ahead.equations.of_rays(rays)
    columns, point = ahead.equations.cofactors(rows), np.repeat(network.rays.point[rays], 2)
    hat = rows @ columns + np.where(point[:, None] == point, whitened @ whitened.T, 0.0)
    inner = np.eye(len(hat)) - hat * down
    residuals = np.linalg.solve(inner, ahead.solution.fit.lin.residuals[:, rays].T.ravel())
    weighed = np.linalg.solve(inner, hat)
    gains = expected_gains(ahead, wrong)
    for number, key in enumerate(keys):
        pair = slice(2 * number, 2 * number + 2)
        own = np.eye(2) - (1 - down[pair]) * weighed[pair, pair]
        moved = ahead.ground.of(columns[:, pair] @ np.linalg.solve(own, residuals[pair])[:, None])
        assert gains[key].shift_m == pytest.approx(np.sqrt(2 * np.mean(moved**2)), rel=1e-6)


OPTIONS_OF_MEASURING_GAIN = AdjustmentOptions(robust=False)


@pytest.fixture(scope="module")
def block():
    return fly(FlightPlan(ties=400, control=12, check=6), np.random.default_rng(4)).block


@pytest.fixture(scope="module")
def influence(block):
    return influence_of(adjust_block(block, OPTIONS_OF_MEASURING_GAIN), OPTIONS_OF_MEASURING_GAIN)


def ground_variance(influence):
    return 2 * np.mean(np.array(list(influence.corner_sigmas().values())) ** 2)


def test_it_is_what_m_p_squared_becomes_less__oracle(block, influence):
    where = next(iter(block.measurements.values()))
    known = block.surveyed[where.point_id]
    sigma = np.array([0.05, 0.05, 0.1])
    point = SurveyedPoint("P1", known.position, sigma, "control", "surveyed")
    gain = measuring_gains(influence, [(point, where.photo_id)], 0)["P1", where.photo_id]
    seen = influence.block.photos[where.photo_id]
    camera = influence.block.camera_of(where.photo_id)
    pixel = seen.pixel_from_object(point.position[None], camera)[0]
    measured = Measurement("P1", where.photo_id, *pixel.tolist(), HAND_SIGMA_PX, status="accepted")
    with_it = replace(block.with_measurement(measured), surveyed={**block.surveyed, "P1": point})
    after = influence_of(
        adjust_block(with_it, OPTIONS_OF_MEASURING_GAIN), OPTIONS_OF_MEASURING_GAIN
    )
    less = ground_variance(influence) - ground_variance(after)
    assert gain == pytest.approx(np.sqrt(less), rel=0.05)


def test_the_first_checks_tell_most__law(influence):
    known = next(p for p in influence.block.surveyed.values() if p.role == "check")
    name = next(iter(influence.block.photos))
    gains = [measuring_gains(influence, [(known, name)], n)[known.point_id, name] for n in range(9)]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 5 * gains[4] > 0


def test_a_photo_that_lies_nowhere_is_oriented_first__law(block):
    name = sorted(block.photos)[0]
    lost = block.with_photos({**block.photos, name: replace(block.photos[name], oriented=False)})
    influence = influence_of(
        adjust_block(lost, OPTIONS_OF_MEASURING_GAIN), OPTIONS_OF_MEASURING_GAIN
    )
    point = next(p for p in block.surveyed.values() if p.role == "control")
    others = [(point, other) for other in block.photos]
    gains = measuring_gains(influence, others, 0)
    assert max(gains, key=lambda key: gains[key]) == (point.point_id, name)
