"""Independent models on flights that are known."""

from dataclasses import replace

import numpy as np

from core.doubts import Failure
from core.literature.independent_models import (
    Sights,
    StereoModel,
    Triangulated,
    form_model,
    form_models,
    triangulate_models,
)
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=400, control=20, check=12, camera_errors=False)
EXACT = replace(
    PLAN,
    start_m=0.1,
    start_rad=1e-5,
    tie_sigma_px=1e-4,
    control_sigma_px=1e-4,
    control_sigma_m=(1e-4, 1e-4, 1e-4),
)


def astray_m(block, truth):
    """Largest difference of a perspective centre from the true one, metres."""
    return max(
        float(np.abs(photo.exterior.centre - truth.photos[name].exterior.centre).max())
        for name, photo in block.photos.items()
    )


def test_without_noise_models_find_the_truth__truth():
    """Relief and Earth curvature included."""
    rng = np.random.default_rng(1)
    flight = fly(EXACT, rng)
    models = form_models(flight.block, rng)
    found = triangulate_models(flight.block, models, Sights.of(flight.block))
    assert isinstance(found, Triangulated)
    assert astray_m(found.block, flight.truth) < 0.01
    assert found.joint_m.max() < 0.001


def test_a_model_is_the_ground_but_for_its_size_and_place__truth():
    """The angle between both axes and the ratio of distances are those of the flight."""
    flight = fly(EXACT, np.random.default_rng(2))
    sights = Sights.of(flight.block)
    first, second = sorted(flight.block.photos)[:2]
    model = form_model(flight.block, sights, (first, second), np.random.default_rng(0))
    assert isinstance(model, StereoModel)
    assert model.numbers[-2:].tolist() == [sights.centres[first], sights.centres[second]]
    true = [flight.truth.photos[name].exterior for name in (first, second)]
    turn = true[0].object_from_image.T @ true[1].object_from_image
    np.testing.assert_allclose(model.rotations[1], turn, atol=1e-5)
    base = true[0].object_from_image.T @ (true[1].centre - true[0].centre)
    np.testing.assert_allclose(model.positions[-1], base / np.linalg.norm(base), atol=1e-5)
    assert (model.positions[:-2, 2] < 0).all()  # below the camera


def test_photos_without_common_points_make_no_model__law():
    flight = fly(replace(PLAN, ties=0), np.random.default_rng(3))
    first, second = sorted(flight.block.photos)[:2]
    sights = Sights.of(replace(flight.block, measurements={}))
    found = form_model(flight.block, sights, (first, second), np.random.default_rng(0))
    assert isinstance(found, Failure)
