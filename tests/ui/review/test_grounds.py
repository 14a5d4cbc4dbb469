"""Reasons for doubt: each speaks where it should and is silent elsewhere."""

import math

import pytest

from core.block import Measurement, Peak, Reading
from ui.review.grounds import grounds_of
from ui.review.misfit import Misfit

GOOD = Measurement("P", "photo", 100.0, 100.0, 0.4, 0.9)
NEAR = Misfit((0.1, 0.1), (0.05, 0.05), 0.3)


def texts(measurement, misfit=NEAR, controlled=0.8, disputed=math.nan):
    return [ground.text for ground in grounds_of(measurement, misfit, controlled, disputed)]


def test_a_good_measurement_has_no_reason__law():
    assert texts(GOOD) == []


@pytest.mark.parametrize(("beside", "doubted"), [(0.5, False), (3.0, True)])
def test_readings_of_different_details_are_a_doubt__law(beside, doubted):
    readings = (Reading("anna", 100.0, 100.0, ""), Reading("berta", 100.0 + beside, 100.0, ""))
    item = Measurement("P", "photo", 100.0, 100.0, 0.4, 0.9, readings=readings)
    assert texts(item) == (["doubt.readings"] if doubted else [])


def test_the_heaviest_reason_comes_first__law():
    peaks = (Peak(0, 0, 0.4, 1.0, "ncc"), Peak(9, 9, 0.4, 0.95, "ncc"))
    item = Measurement("P", "photo", 100.0, 100.0, 0.4, 0.3, peaks=peaks)
    grounds = grounds_of(item, Misfit((9.0, 9.0), (4.0, 4.0), 9.0), 0.05, 12.0)
    assert grounds[0].text == "doubt.disputed"
    weights = [ground.weight for ground in grounds]
    assert weights == sorted(weights, reverse=True)
    assert len(grounds) == 5
