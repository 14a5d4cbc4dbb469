"""Misfits: how far measurements lie from where the block expects their points."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from ui.review.misfit import misfits
from ui.review.state import DeskState


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def test_misfits_on_the_ground_are_pixels_times_pixel_size__law(state):
    pixel_m = 0.15 * 1650 / 210
    for misfit in misfits(state).values():
        pixels = np.hypot(*misfit.pixels)
        assert np.hypot(*misfit.metres) == pytest.approx(pixels * pixel_m, rel=0.12, abs=0.02)


def test_misfits_do_not_shrink_when_a_point_gives_way__law(state):
    """Residuals do: with weak coordinates the point follows its measurement."""
    away = misfits(state)
    for key in tiny_block().blunders:
        assert np.hypot(*away[key].pixels) > 0.9 * np.hypot(*state.report.residuals_px[key])
    points = {name: replace(p, sigma_m=p.sigma_m * 20) for name, p in state.block.surveyed.items()}
    weak = adjust(replace(state.block, surveyed=points))
    loose = misfits(replace(state, report=weak))
    sums = [
        sum(np.hypot(*weak.residuals_px[key]) for key in tiny_block().blunders),
        sum(np.hypot(*loose[key].pixels) for key in tiny_block().blunders),
    ]
    assert sums[0] < 0.5 * sums[1]


def test_a_measurement_moved_by_ten_pixels_misfits_by_ten_more__law(state):
    key = next(iter(state.block.measurements))
    here = state.block.measurements[key]
    moved = replace(here, column=here.column + 10)
    before = misfits(state, [key])[key]
    after = misfits(replace(state, block=state.block.with_measurement(moved)), [key])[key]
    assert after.pixels == pytest.approx((before.pixels[0] - 10, before.pixels[1]))


def test_ratios_are_lengths_in_standard_deviations__truth(state):
    """All but the blunders come from the noise put in, whatever the weights."""
    blunders = tiny_block().blunders
    ratios = {key: one.ratio for key, one in misfits(state).items()}
    good = [ratio for key, ratio in ratios.items() if key not in blunders]
    assert np.median(good) < 1.2
    assert np.median([ratios[key] for key in blunders]) > 4 * np.median(good)
