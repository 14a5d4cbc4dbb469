"""Robust resection from few right candidates of ninety, ours beside PoseLib's LO-RANSAC."""

import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from core.block import Photo
from core.doubts import Failure
from core.geometry.consensus import Candidates, ConsensusOptions
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import PhotoModel, moved, resect_photo
from core.localisation.photo_orientation import OrientationOptions
from tests.benchmarks.control_scene import (
    ABOVE_M,
    CAMERA,
    FOCAL_MM,
    HEIGHT_M,
    NORTH,
    PIXEL_MM,
    SCAN_PX,
    WEST,
    photo_at,
)

NEAR_M = 3.0
SIGMA_M, WINDOW_HALF_M = 0.7, 29.0


def guessed(right: int, rng: np.random.Generator) -> tuple[Photo, Photo, np.ndarray, Candidates]:
    """A photo, where it truly is, ninety points, and their candidates, few of them right."""
    middle = np.array([WEST, NORTH, HEIGHT_M + ABOVE_M])
    photo = photo_at(ExteriorOrientation(middle, 0.0, 0.0, 0.0), Path("none"))
    sigma = np.array([8.0, 8.0, 8.0, 0.003, 0.003, 0.002])
    true = photo.with_exterior(moved(photo.exterior, rng.normal(0, 0.6, 6) * sigma), True)
    places = rng.uniform(-0.46, 0.46, (90, 2)) * SCAN_PX + SCAN_PX / 2
    heights = HEIGHT_M + rng.uniform(-60, 60, 90)
    points = true.object_from_pixel(places, heights, CAMERA)
    pixel_m = PIXEL_MM / FOCAL_MM * ABOVE_M
    predicted = photo.pixel_from_object(points, CAMERA)
    pixels = predicted + rng.uniform(-1, 1, (90, 2)) * WINDOW_HALF_M / pixel_m
    own = rng.permutation(90)[:right]
    pixels[own] = places[own] + rng.normal(0, SIGMA_M / pixel_m, (right, 2))
    every, area = np.ones(90), (2 * WINDOW_HALF_M / pixel_m) ** 2
    known = Candidates(
        np.arange(90), pixels, np.full(90, SIGMA_M / pixel_m), every, every, every / area
    )
    return photo, true, points, known


def frame_error_m(one: Photo, other: Photo) -> float:
    """Root mean square distance on level ground over the frame."""
    line = np.linspace(0.05, 0.95, 7) * SCAN_PX
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    level = np.full(len(places), HEIGHT_M)
    off = one.object_from_pixel(places, level, CAMERA) - other.object_from_pixel(
        places, level, CAMERA
    )
    return float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))))


def resected(
    photo: Photo, points: np.ndarray, known: Candidates, seed: int, options: ConsensusOptions
) -> Photo | None:
    """Our resection; None where it is refused."""
    sigma = np.array([8.0, 8.0, 8.0, 0.003, 0.003, 0.002])
    model = PhotoModel(photo.interior, CAMERA, photo.atmosphere)
    rng = np.random.default_rng(seed)
    found = resect_photo(
        model, photo.exterior, np.diag(sigma**2), points, candidates=known, options=options, rng=rng
    )
    return None if isinstance(found, Failure) else photo.with_exterior(found.exterior, True)


def ours(photo: Photo, points: np.ndarray, known: Candidates, seed: int) -> Photo | None:
    """What our resection finds, whether it would be accepted or not, as PoseLib does."""
    return resected(photo, points, known, seed, ConsensusOptions(least_log10_e_value=-np.inf))


def accepted(photo: Photo, points: np.ndarray, known: Candidates, seed: int) -> Photo | None:
    """What it also accepts, as the program does: agreement that chance could bring is refused."""
    return resected(photo, points, known, seed, OrientationOptions().resection)


def theirs(photo: Photo, points: np.ndarray, known: Candidates, seed: int) -> Photo | None:
    """PoseLib's LO-RANSAC with its local optimisation and a threshold of three deviations."""
    library: Any = import_module("poselib")
    focal = FOCAL_MM / PIXEL_MM
    camera = {"model": "PINHOLE", "width": SCAN_PX, "height": SCAN_PX,
              "params": [focal, focal, SCAN_PX / 2, SCAN_PX / 2]}  # fmt: skip
    options = {
        "max_reproj_error": 3 * float(known.sigma_px[0]),
        "seed": seed,
        "max_iterations": 100_000,
        "min_iterations": 1000,
        "success_prob": 0.9999,
    }
    local = points - photo.exterior.centre
    pose, _ = library.estimate_absolute_pose(known.pixels, local, camera, options, {})
    # PoseLib's camera looks along +z with y down: omega, phi, kappa from image = R object.
    turned = np.diag([1.0, -1.0, -1.0]) @ np.asarray(pose.R)
    centre = -np.asarray(pose.R).T @ np.asarray(pose.t)
    object_from_image = turned.T
    phi = float(np.arcsin(np.clip(object_from_image[0, 2], -1, 1)))
    omega = float(np.arctan2(-object_from_image[1, 2], object_from_image[2, 2]))
    kappa = float(np.arctan2(-object_from_image[0, 1], object_from_image[0, 0]))
    return photo.with_exterior(
        ExteriorOrientation(centre + photo.exterior.centre, omega, phi, kappa), True
    )


def resections(
    cases: int, first_seed: int, say: Callable[[str], None]
) -> dict[tuple[str, int], tuple[float, float]]:
    """Share that succeeds, and milliseconds each, by estimator and number of right candidates."""
    ways: dict[str, Callable[..., Photo | None]] = {"gruber": ours, "accepted": accepted}
    if find_spec("poselib"):
        ways["PoseLib"] = theirs
    table: dict[tuple[str, int], tuple[float, float]] = {}
    for right in (8, 11, 15, 20):
        for name, way in ways.items():
            good, seconds = 0, []
            for case in range(cases):
                photo, true, points, known = guessed(
                    right, np.random.default_rng([first_seed, right, case])
                )
                started = time.process_time()
                found = way(photo, points, known, case)
                seconds.append(time.process_time() - started)
                good += found is not None and frame_error_m(found, true) < NEAR_M
            table[name, right] = good / cases, 1000 * float(np.median(seconds))
            say(f"  {name:8s} {right:2d} right of 90: {good / cases:6.1%} within {NEAR_M:.0f} m, "
                f"{table[name, right][1]:6.1f} ms")  # fmt: skip
    return table
