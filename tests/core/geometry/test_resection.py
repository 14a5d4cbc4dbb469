"""Resection: a photo's orientation from known points most of which are found in wrong places."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from core.doubts import Failure
from core.frames import opencv_from_pixel
from core.geometry.camera import Camera
from core.geometry.collinearity import Atmosphere
from core.geometry.consensus import Candidates, ConsensusOptions
from core.geometry.exterior import rotation_from_angles
from core.geometry.interior import InteriorOrientation
from core.geometry.resection import PhotoModel, Resection, difference, moved, resect_photo
from tests.core.geometry.planted import (
    CAMERA,
    PIXEL_MM,
    PRIOR_SIGMA,
    SIDE_PX,
    START,
    model_of,
    planted,
)

QUICK = ConsensusOptions(refined=4)


def resected(case, seed=0, options=QUICK, start=START):
    rng = np.random.default_rng(seed)
    return resect_photo(
        case.model,
        start,
        case.prior,
        case.points,
        candidates=case.candidates,
        options=options,
        rng=rng,
    )


def test_eleven_right_of_ninety_are_found_to_their_covariance__truth():
    """An eighth of the points right; errors squared by the covariance are chi-squared of six."""
    seeds, good, sizes = 40, 0, []
    for seed in range(seeds):
        case = planted(seed, 90, 11)
        found = resected(case, seed)
        if not isinstance(found, Resection):
            continue
        error = difference(found.exterior, case.truth)
        sizes.append(float(error @ np.linalg.solve(found.covariance, error)))
        good += sizes[-1] < chi2.ppf(0.99, 6)
    assert good >= 0.95 * seeds
    # ... neither too proud nor too modest.
    assert 0.6 < np.mean(sizes) / 6 < 1.5


def test_nearly_all_right_candidates_are_found_and_few_wrong_ones__truth():
    recall, wrong = [], []
    for seed in range(10):
        case = planted(100 + seed, 90, 20, each=2)
        found = resected(case, seed)
        assert isinstance(found, Resection)
        chosen = set(found.chosen.tolist())
        recall.append(len(chosen & set(case.right)) / 20)
        wrong.append(len(chosen - set(case.right)))
    assert np.mean(recall) > 0.98
    assert np.mean(wrong) < 1.0


def test_eleven_right_of_ninety_are_accepted_where_the_prior_is_tight__truth():
    """The room that the prior leaves to chance is what counts, not where a photo could be."""
    accepted = [isinstance(resected(planted(seed, 90, 11), seed), Resection) for seed in range(12)]
    assert all(accepted)


def test_pure_noise_gives_no_orientation__truth():
    for seed in range(6):
        found = resected(planted(seed, 90, 0, sigma_px=3.0), seed)
        assert isinstance(found, Failure)
        assert found.evidence["log10_e_value"] < 3.0
        assert "chance" in found.reason


def test_clean_points_give_opencv_s_orientation__oracle():
    linear = PIXEL_MM * np.array([[1.0, 0.0], [0.0, -1.0]])
    middle = SIDE_PX / 2
    matrix = np.column_stack([linear, -linear @ np.full(2, middle)])
    none = np.zeros((0, 2))
    interior = InteriorOrientation("similarity", matrix, (), none, none, np.nan)
    plain = PhotoModel(interior, Camera("wide", 211.59, (180.0, 180.0)), Atmosphere())
    case = planted(7, 40, 40, sigma_px=0.3, model=plain)
    found = resected(case)
    assert isinstance(found, Resection)
    assert len(found.chosen) == 40

    focal = 211.59 / PIXEL_MM
    centre = opencv_from_pixel(np.array([[middle, middle]]))[0]
    inner = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])
    flip = np.diag([1.0, -1.0, -1.0])
    local = case.points - START.centre
    turn = flip @ START.object_from_image.T
    _, rodrigues, shift = cv2.solvePnP(
        local,
        opencv_from_pixel(case.candidates.pixels),
        inner,
        None,
        cv2.Rodrigues(turn)[0],
        np.zeros((3, 1)),
        useExtrinsicGuess=True,
        flags=cv2.SOLVEPNP_ITERATIVE,
    )
    camera_from_object = cv2.Rodrigues(rodrigues)[0]
    theirs = START.centre - (camera_from_object.T @ shift)[:, 0]
    turned = (flip @ camera_from_object).T @ found.exterior.object_from_image.T
    # Within a tenth of the standard deviations: they have no prior.
    sigma = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.exterior.centre - theirs) < 0.1 * sigma[:3]).all()
    assert np.abs(turned - np.eye(3)).max() < 0.1 * sigma[3:].max()


def test_the_prior_pulls_only_weakly__truth():
    """A start three of its standard deviations away shifts the result by less than its own."""
    case = planted(11, 60, 60, sigma_px=1.0)
    case.candidates.pixels[:] = case.model.pixels(case.points, case.truth)
    start = moved(case.truth, 3 * PRIOR_SIGMA * np.array([1, -1, 1, 1, -1, -1]))
    found = resected(case, start=start)
    assert isinstance(found, Resection)
    pull = np.abs(difference(found.exterior, case.truth))
    assert (pull < np.sqrt(np.diag(found.covariance))).all()
    # It is the pull of least squares: prior and measurements each by their weight.
    expected = found.covariance @ (difference(start, case.truth) / PRIOR_SIGMA**2)
    np.testing.assert_allclose(difference(found.exterior, case.truth), expected, rtol=0.05)


def test_the_same_seed_gives_the_same_bytes_and_another_the_same_place__law():
    case = planted(13)
    one, again, other = resected(case, 1), resected(case, 1), resected(case, 2)
    assert isinstance(one, Resection)
    assert isinstance(other, Resection)
    assert one.exterior.centre.tobytes() == again.exterior.centre.tobytes()
    assert (one.exterior.omega, one.log10_e_value) == (again.exterior.omega, again.log10_e_value)
    np.testing.assert_array_equal(one.chosen, other.chosen)
    np.testing.assert_allclose(one.exterior.centre, other.exterior.centre, atol=1e-3)


def test_too_few_points_are_a_failure_that_says_so__law():
    case = planted(1, 4, 4)
    found = resected(case)
    assert isinstance(found, Failure)
    assert "4 known points" in found.reason
    none = Candidates(np.zeros(0, np.int64), np.zeros((0, 2)), *(np.zeros(0) for _ in range(4)))
    empty = resect_photo(
        case.model, START, case.prior, case.points, candidates=none, options=ConsensusOptions(),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert isinstance(empty, Failure)


def test_points_behind_the_camera_break_nothing__truth():
    case = planted(17, 90, 20)
    case.points[60:70, 2] = START.centre[2] + 100.0
    found = resected(case)
    assert isinstance(found, Resection)
    assert not set(range(60, 70)) & set(case.candidates.point[found.chosen].tolist())


def test_residuals_are_computed_minus_measured__law():
    case = planted(19, 60, 30)
    found = resected(case)
    assert isinstance(found, Resection)
    seen = case.candidates.point[found.chosen]
    computed = case.model.pixels(case.points[seen], found.exterior)
    np.testing.assert_allclose(
        found.residuals_px, computed - case.candidates.pixels[found.chosen], atol=1e-9
    )


def test_kappa_differs_by_half_a_turn_at_most__law():
    one = moved(START, np.array([0, 0, 0, 0, 0, np.pi - START.kappa - 0.01]))
    other = moved(START, np.array([0, 0, 0, 0, 0, -np.pi - START.kappa + 0.01]))
    assert difference(one, other)[5] == pytest.approx(-0.02)
    np.testing.assert_allclose(
        rotation_from_angles(one.omega, one.phi, one.kappa),
        rotation_from_angles(
            other.omega, other.phi, other.kappa + float(difference(one, other)[5])
        ),
        atol=1e-12,
    )


BENT = Camera(
    "bent", 211.59, (180.0, 180.0), (0.02, -0.03), (2e-8, -1e-12, 0.0),
    deformation_mm=tuple((np.random.default_rng(1).normal(size=50) * 0.01).tolist()),
)  # fmt: skip


@pytest.mark.parametrize("camera", [CAMERA, BENT])
@pytest.mark.parametrize("model", ["affine", "bilinear", "projective"])
def test_derivatives_are_those_of_differences__oracle(camera, model):
    """Central differences of the collinearity, lens, air, film warp and deformation included."""
    photo = model_of(camera)
    warped = replace(photo.interior, model=model, warp=np.array([2e-5, -1e-5]))
    photo = replace(photo, interior=warped)
    points = planted(23, 12, 6, model=photo).points
    pixels, slope = photo.linearised(points, START)
    np.testing.assert_allclose(pixels, photo.pixels(points, START), atol=1e-9)
    for column, size in enumerate([0.1] * 3 + [1e-5] * 3):
        step = size * np.eye(6)[column]
        ahead, behind = (photo.pixels(points, moved(START, s)) for s in (step, -step))
        theirs = (ahead - behind) / (2 * size)
        np.testing.assert_allclose(slope[:, :, column], theirs, rtol=1e-5, atol=1e-5)


def test_derivatives_are_opencv_s__oracle():
    linear = PIXEL_MM * np.array([[1.0, 0.0], [0.0, -1.0]])
    matrix = np.column_stack([linear, -linear @ np.full(2, SIDE_PX / 2)])
    none = np.zeros((0, 2))
    interior = InteriorOrientation("similarity", matrix, (), none, none, np.nan)
    photo = PhotoModel(interior, Camera("wide", 211.59, (180.0, 180.0)), Atmosphere())
    points = planted(24, 12, 6, model=photo).points
    pixels, slope = photo.linearised(points, START)
    # OpenCV looks along +z with y downwards.
    turned = np.diag([1.0, -1.0, -1.0]) @ START.object_from_image.T
    shift = -turned @ START.centre
    distance, middle = 211.59 / PIXEL_MM, SIDE_PX / 2
    lens = np.array([[distance, 0, middle], [0, distance, middle], [0, 0, 1]])
    theirs, jacobian = cv2.projectPoints(points, cv2.Rodrigues(turned)[0], shift, lens, None)
    np.testing.assert_allclose(pixels, theirs[:, 0], atol=1e-5)
    by_shift = jacobian[:, 3:6].reshape(-1, 2, 3)
    np.testing.assert_allclose(slope[:, :, :3], -by_shift @ turned, rtol=1e-6, atol=1e-6)


def test_a_point_behind_the_camera_has_no_derivatives__law():
    photo, above = model_of(), np.array([[0.0, 0.0, 5000.0]]) + START.centre
    pixels, slope = photo.linearised(above, START)
    assert np.isnan(pixels).all()
    assert np.isnan(slope).all()
