"""Wrong control is found although it bends what it is judged by; gains are in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.adjusted import AdjustmentOptions
from core.block.adjustment import adjust_block
from core.block.expected_gain import expected_gains, known_gains
from core.block.foresight import foresee
from tests.ui.desk_block import tiny_block

OPTIONS = AdjustmentOptions(estimate_cameras=False, robust=False)


@pytest.fixture(scope="module")
def report():
    return adjust_block(tiny_block().block, OPTIONS)


@pytest.fixture(scope="module")
def ahead(report):
    return foresee(report, OPTIONS)


def test_the_wrong_ones_are_told_from_the_right_ones__truth(report, ahead):
    gains = expected_gains(ahead)
    blunders = {key for key in tiny_block().blunders if key in gains}
    assert len(blunders) > 5
    wrong = {key for key, gain in gains.items() if gain.wrong > 0.5}
    assert len(blunders & wrong) >= 0.9 * len(blunders)
    assert len(wrong - blunders) <= 0.05 * len(gains)
    first = sorted(gains, key=lambda key: -gains[key].expected_m)[: len(blunders)]
    assert len(blunders & set(first)) >= 0.8 * len(blunders)


def test_without_weights_lost_it_is_the_effect_of_rejecting__oracle(ahead):
    system = ahead.control_system()
    none = known_gains(ahead, set())
    rejected = ahead.effects([item.key for item in system.measurements[:12]])
    for key, effect in rejected.items():
        moved = ahead.ground_shifts(effect.step[:, None])
        assert none[key].shift_m == pytest.approx(np.sqrt(2 * np.mean(moved**2)), rel=1e-6)


def test_what_somebody_accepted_is_not_asked_for__law(report):
    block = tiny_block().block
    key = next(key for key, item in block.measurements.items() if item.used)
    accepted = block.with_measurement(replace(block.measurements[key], status="accepted"))
    ahead = foresee(adjust_block(accepted, OPTIONS), OPTIONS)
    assert key not in expected_gains(ahead)


def test_hat_rows_are_those_of_the_whole_matrix__law(ahead):
    system = ahead.control_system()
    some = np.array([0, 5, 17])
    whole = system.hat(np.arange(len(system.measurements)))
    assert system.hat(some) == pytest.approx(
        whole.reshape(-1, 2, whole.shape[1])[some].reshape(6, -1)
    )
    own = whole.reshape(len(system.measurements), 2, -1, 2)
    assert system.own()[5] == pytest.approx(own[5, :, 5])
    assert np.trace(whole) < whole.shape[0]
