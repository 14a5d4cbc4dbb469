"""A photo with known points of which few are found in their right place, the others anywhere."""

from dataclasses import dataclass, replace

import numpy as np

from core.geometry.camera import Camera
from core.geometry.collinearity import Atmosphere, atmosphere_of
from core.geometry.consensus import Candidates
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.geometry.resection import PhotoModel, moved

PIXEL_MM, SIDE_PX = 0.015, 12_000
CAMERA = Camera("wide", 211.59, (180.0, 180.0), (0.02, -0.03), (2e-8, -1e-12, 0.0))
START = ExteriorOrientation(np.array([-580_000.0, -1_190_000.0, 3470.0]), 0.01, -0.02, 3.1)
PRIOR_SIGMA = np.array([4.0, 4.0, 4.0, 1e-3, 1e-3, 1e-3])
HALF_PX = 100.0
"""Half-width of every search window: about three standard deviations of the prior."""


@dataclass(frozen=True)
class Planted:
    """What a resection is given, and the orientation that was put in."""

    model: PhotoModel
    points: np.ndarray
    candidates: Candidates
    truth: ExteriorOrientation
    right: np.ndarray

    @property
    def prior(self) -> np.ndarray:
        return np.diag(PRIOR_SIGMA**2)


def model_of(camera: Camera = CAMERA, atmosphere: Atmosphere | None = None) -> PhotoModel:
    linear = PIXEL_MM * np.array([[1.0, 0.004], [0.004, -1.0]])
    matrix = np.column_stack([linear, -linear @ np.full(2, SIDE_PX / 2)])
    none = np.zeros((0, 2))
    interior = InteriorOrientation("affine", matrix, (), none, none, np.nan)
    return PhotoModel(interior, camera, atmosphere or atmosphere_of(3470.0, 300.0))


def ground(count: int, rng: np.random.Generator, relief_m: float = 60.0) -> np.ndarray:
    """Points over what the photo shows."""
    plane = START.centre[:2] + rng.uniform(-1200, 1200, (count, 2))
    return np.column_stack([plane, 300 + rng.uniform(-relief_m / 2, relief_m / 2, count)])


def planted(
    seed: int,
    count: int = 90,
    right: int = 11,
    sigma_px: float = 1.0,
    each: int = 1,
    model: PhotoModel | None = None,
) -> Planted:
    """Points with `each` candidates, the first `right` points with one in its true place.

    The truth is drawn from the prior; every other candidate lies anywhere in its window.
    """
    rng = np.random.default_rng(seed)
    model = model or model_of()
    truth = moved(START, rng.normal(size=6) * PRIOR_SIGMA)
    points = ground(count, rng)
    point = np.repeat(np.arange(count), each)
    predicted = model.pixels(points, START)[point]
    pixels = predicted + rng.uniform(-HALF_PX, HALF_PX, predicted.shape)
    first = np.flatnonzero(np.diff(point, prepend=-1))[:right]
    pixels[first] = model.pixels(points[:right], truth) + rng.normal(size=(right, 2)) * sigma_px
    total = len(point)
    candidates = Candidates(
        point,
        pixels,
        np.full(total, sigma_px),
        np.ones(total),
        np.ones(total),
        np.full(total, 1 / (2 * HALF_PX + 1) ** 2),
    )
    return Planted(model, points, candidates, truth, first)


def with_idle(case: Planted, count: int, seed: int = 99) -> Planted:
    """Further points whose gate fills their search window: wherever they lie, they agree."""
    rng = np.random.default_rng(seed)
    extra = ground(count, rng)
    known = case.candidates
    pixels = case.model.pixels(extra, START) + rng.uniform(-3, 3, (count, 2))
    return replace(
        case,
        points=np.vstack([case.points, extra]),
        candidates=Candidates(
            np.concatenate([known.point, len(case.points) + np.arange(count)]),
            np.vstack([known.pixels, pixels]),
            np.concatenate([known.sigma_px, np.full(count, 60.0)]),
            np.concatenate([known.weight, np.full(count, 1e-3)]),
            np.concatenate([known.trust, np.ones(count)]),
            np.concatenate([known.chance, np.full(count, 1 / 49.0)]),
        ),
    )
