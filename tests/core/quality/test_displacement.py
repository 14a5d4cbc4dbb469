"""How far a georeference was off, against what was put in."""

from dataclasses import replace

import numpy as np
import pytest

from core.geometry.exterior import ExteriorOrientation
from core.quality.displacement import displacement
from tests.flights import FlightPlan, fly


def test_a_shift_turn_and_scale_put_in_are_told__truth():
    flight = fly(FlightPlan(ties=10, camera_errors=False), np.random.default_rng(0))
    name, photo = next(iter(flight.truth.photos.items()))
    camera, true = (
        flight.truth.camera_of(name),
        ExteriorOrientation(photo.exterior.centre, 0.0, 0.0, photo.exterior.kappa),
    )
    above = true.centre[2] - photo.ground_height_m
    off = ExteriorOrientation(
        true.centre + np.array([120.0, -80.0, 0.05 * above]), 0.0, 0.0, true.kappa + 0.1
    )
    found = displacement(replace(photo, exterior=true, approximate=off), camera)
    np.testing.assert_allclose(found.shift_m, [-120.0, 80.0], atol=3.0)
    assert found.turn == pytest.approx(-0.1, abs=1e-3)
    assert found.scale == pytest.approx(1 / 1.05, abs=1e-3)
    assert found.rms_m > 144.0
    same = displacement(replace(photo, exterior=true, approximate=true), camera)
    assert (same.rms_m, same.turn, same.scale) == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
