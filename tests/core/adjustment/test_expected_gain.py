"""Wrong control is found although it bends what it is judged by; gains are in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block, adjust_with_solution
from core.adjustment.expected_gain import expected_gains
from core.adjustment.influence import influence_of
from tests.core.adjustment.test_influence import step_between
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
