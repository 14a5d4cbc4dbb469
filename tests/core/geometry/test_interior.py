"""Interior orientation from fiducials with put in film deformation and mistakes."""

import numpy as np
import pytest

from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation, fit_interior, nominal_interior

FILM = np.array(
    [[-106.0, 106], [106, 106], [106, -106], [-106, -106], [0, 110], [110, 0], [0, -110], [-110, 0]]
)
NAMES = [str(i) for i in range(1, 9)]


def scanned(
    film: np.ndarray, pixel_mm: float = 0.015, turn_deg: float = 1.0, shear: float = 0.0
) -> np.ndarray:
    turn = np.radians(turn_deg)
    x, y = film.T
    x = x * 1.0004 + shear * y
    right = x * np.cos(turn) - y * np.sin(turn)
    up = x * np.sin(turn) + y * np.cos(turn)
    return np.column_stack([right / pixel_mm + 8000, 8100 - up / pixel_mm])


@pytest.mark.parametrize("turn_deg", [-2.0, 0.5, 91.0, 180.0, 269.0])
def test_residuals_are_the_noise_put_in__truth(turn_deg: float) -> None:
    rng = np.random.default_rng(3)
    sigmas = []
    for _ in range(60):
        pixels = scanned(FILM, turn_deg=turn_deg, shear=3e-4) + rng.normal(0, 0.2, FILM.shape)
        interior = fit_interior(NAMES, pixels, FILM)
        assert isinstance(interior, InteriorOrientation)
        sigmas.append(interior.sigma_um)
    assert np.sqrt(np.mean(np.square(sigmas))) == pytest.approx(3.0, rel=0.1)


def test_pixel_and_film_there_and_back__law() -> None:
    interior = fit_interior(NAMES, scanned(FILM, shear=1e-3), FILM)
    assert isinstance(interior, InteriorOrientation)
    assert interior.model == "affine"
    np.testing.assert_allclose(interior.pixel_from_film(FILM), scanned(FILM, shear=1e-3), atol=1e-6)
    np.testing.assert_allclose(interior.film_from_pixel(scanned(FILM, shear=1e-3)), FILM, atol=1e-9)


@pytest.mark.parametrize("marks", [4, 5, 8])
def test_one_wrong_mark_is_left_out__truth(marks: int) -> None:
    rng = np.random.default_rng(4)
    pixels = scanned(FILM[:marks], shear=2e-4) + rng.normal(0, 0.1, (marks, 2))
    pixels[2] += [40.0, -25.0]
    interior = fit_interior(NAMES[:marks], pixels, FILM[:marks])
    assert isinstance(interior, InteriorOrientation)
    assert "3" not in interior.names
    assert len(interior.names) == marks - 1


def test_marks_of_another_camera_are_a_failure__truth() -> None:
    pixels = scanned(FILM * np.array([1.0, 0.97]) + np.array([[0, 1.0]] * 4 + [[0, -1.5]] * 4))
    result = fit_interior(NAMES, pixels, FILM)
    assert isinstance(result, Failure)
    assert "RMS" in result.reason


def test_three_marks_make_a_similarity__law() -> None:
    interior = fit_interior(NAMES[:3], scanned(FILM[:3]), FILM[:3])
    assert isinstance(interior, InteriorOrientation)
    assert interior.model == "similarity"


def test_limit_grows_with_the_scan_pixel__law() -> None:
    rng = np.random.default_rng(5)
    noise = rng.normal(0, 1.0, FILM.shape)
    coarse = fit_interior(NAMES, scanned(FILM, 0.045) + noise, FILM)
    assert isinstance(coarse, InteriorOrientation)
    fine = fit_interior(NAMES, scanned(FILM, 0.015) + 3 * noise, FILM)
    assert isinstance(fine, Failure)


def test_nominal_lies_in_the_middle__law() -> None:
    camera = Camera("wide", 152.0, (230.0, 230.0))
    interior = nominal_interior((16000, 15800), camera, 0.015)
    np.testing.assert_allclose(interior.film_from_pixel(np.array([[8000.0, 7900.0]])), 0, atol=1e-9)
    np.testing.assert_allclose(
        interior.film_from_pixel(np.array([[8100.0, 7800.0]])), [[1.5, 1.5]], atol=1e-9
    )
    assert interior.model == "nominal"
    assert interior.rms_um == 0


def test_nominal_follows_the_frame__truth() -> None:
    camera = Camera("oblong", 120.0, (92.16, 165.888))
    corners = scanned(camera.frame_corners_mm, 0.02, turn_deg=1.5)
    interior = nominal_interior((5000, 8600), camera, 0.02, corners)
    np.testing.assert_allclose(
        interior.film_from_pixel(corners), camera.frame_corners_mm, atol=0.05
    )
    across = nominal_interior((8600, 5000), camera, 0.02)
    spans = np.ptp(across.film_from_pixel(np.array([[0.0, 0.0], [8600.0, 5000.0]])), axis=0)
    np.testing.assert_allclose(spans, [100.0, 172.0])
