"""What a measurement to come brings is what the adjustment gains by it."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.adjustment.measuring_gain import measuring_gains
from core.block import HAND_SIGMA_PX, Measurement, SurveyedPoint
from tests.flights import FlightPlan, fly

OPTIONS = AdjustmentOptions(robust=False)


@pytest.fixture(scope="module")
def block():
    return fly(FlightPlan(ties=400, control=12, check=6), np.random.default_rng(4)).block


@pytest.fixture(scope="module")
def influence(block):
    return influence_of(adjust_block(block, OPTIONS), OPTIONS)


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
    after = influence_of(adjust_block(with_it, OPTIONS), OPTIONS)
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
    influence = influence_of(adjust_block(lost, OPTIONS), OPTIONS)
    point = next(p for p in block.surveyed.values() if p.role == "control")
    others = [(point, other) for other in block.photos]
    gains = measuring_gains(influence, others, 0)
    assert max(gains, key=lambda key: gains[key]) == (point.point_id, name)
