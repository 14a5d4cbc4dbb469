"""A whole block shifted, turned and scaled: photos and ground go together."""

import numpy as np

from core.geometry.camera import Camera
from core.geometry.collinearity import film_from_object
from core.geometry.exterior import ExteriorOrientation, SimilarityInSpace

ABOUT = np.array([-580_000.0, -1_190_000.0, 3300.0])
CAMERA = Camera("wide", 210.0, (180.0, 180.0), (0.02, 0.01), (1e-8, 0.0, 0.0))


def carried(similarity: SimilarityInSpace, points: np.ndarray) -> np.ndarray:
    """Ground points under the same similarity."""
    scale = 1 + similarity.step[6]
    turned = (points - similarity.about) @ similarity.rotation.T
    return similarity.about + similarity.step[:3] + scale * turned


def test_photos_and_ground_moved_together_show_the_same__law():
    rng = np.random.default_rng(0)
    step = np.array([12.0, -30.0, 7.0, 0.02, -0.01, 0.4, 0.03])
    similarity = SimilarityInSpace(ABOUT, step)
    exterior = ExteriorOrientation(ABOUT + np.array([600.0, -400.0, 20.0]), 0.03, -0.02, 2.9)
    points = ABOUT + np.column_stack(
        [rng.uniform(-900, 900, (40, 2)), rng.uniform(-3200, -2900, 40)]
    )
    np.testing.assert_allclose(
        film_from_object(carried(similarity, points), similarity.moved(exterior), CAMERA),
        film_from_object(points, exterior, CAMERA),
        atol=1e-9,
    )


def test_no_step_moves_nothing__law():
    exterior = ExteriorOrientation(ABOUT + np.array([1.0, 2.0, 3.0]), 0.03, -0.02, 2.9)
    same = SimilarityInSpace(ABOUT, np.zeros(7)).moved(exterior)
    np.testing.assert_allclose(same.centre, exterior.centre, atol=1e-9)
    np.testing.assert_allclose([same.omega, same.phi, same.kappa], [0.03, -0.02, 2.9], atol=1e-12)


def test_the_point_it_turns_about_is_only_shifted__law():
    step = np.array([5.0, 6.0, 7.0, 0.1, 0.2, 0.3, 0.5])
    there = SimilarityInSpace(ABOUT, step).moved(ExteriorOrientation(ABOUT, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(there.centre, ABOUT + np.array([5.0, 6.0, 7.0]))
