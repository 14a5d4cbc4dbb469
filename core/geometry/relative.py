"""Relative orientation of two photos with known cameras, from rays in image space.

A ray is the direction (x, y, -c) / c of an ideal film point: image space, x right, y up, z out of
the film towards the sky. Coplanarity: u . (b x R v) = 0 for the ray u of the first photo, v of the
second, the base b and the rotation R, both in the image space of the first photo.
"""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from jaxtyping import Float64

from core.arrays import FilmPoints, Flags, Position, Rotation, Scalars, locked
from core.doubts import Failure
from core.geometry.exterior import ExteriorOrientation
from core.geometry.robust import TINY, log10_nfa
from core.said import say

Rays = Float64[np.ndarray, "n 3"]
"""Directions in image space with z = -1."""
# source: OpenCV's camera axes.
OPENCV_FROM_IMAGE = np.diag([1.0, -1.0, -1.0])
"""OpenCV looks along +z with y down: half a turn about the x axis."""
# source: five correspondences fix five unknowns.
MINIMAL = 5
"""Correspondences that fix a relative orientation."""


# design: one failure in ten thousand pairs.
CONFIDENCE = 0.9999
"""Probability that the random search sees a sample of right matches."""
# design: a share of right matches of a fifth has six good samples then.
MOST_SAMPLES = 20_000
"""Random samples at most."""
# design: one pair in a million by chance.
MOST_LOG10_NFA = -6.0
"""Number of false alarms at most, log10."""


@dataclass(frozen=True, slots=True)
class RelativeOptions:
    """How a relative orientation is looked for and when it stands."""

    # design: matches of features are good to a pixel.
    tolerance_px: float = 2.0
    """A match belongs when its y-parallax is below this, in pixels of the matched scale."""
    # design: four times what fixes the orientation.
    min_inliers: int = 20
    """Fewer matches that agree are never believed."""


@dataclass(frozen=True, slots=True, eq=False)
class RayPairs:
    """Rays of two photos to the same points, row by row."""

    first: Rays
    """Rays of the first photo, in its image space."""
    second: Rays
    """Rays of the second photo, in its image space."""
    pixel_angles: tuple[float, float]
    """Size of a pixel over the principal distance, first and second photo."""


@dataclass(frozen=True, slots=True, eq=False)
class RelativeOrientation:
    """The second photo of a pair in the image space of the first, base of unit length."""

    base: Position
    """From the first perspective centre to the second, unit length."""
    rotation: Rotation
    """Turns the second image space into the first."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", locked(self.base))
        object.__setattr__(self, "rotation", locked(self.rotation))


@dataclass(frozen=True, slots=True, eq=False)
class OrientedPair:
    """A relative orientation with the matches that agree with it."""

    orientation: RelativeOrientation
    """The orientation, least squares over the agreeing matches."""
    agrees: Flags
    """Which of the matches agree."""
    parallax_px: Scalars
    """y-parallax of every match, scaled so that noise of 1 px in each coordinate gives 1 px."""
    log10_nfa: float
    """log10 of the expected number of such agreements by chance."""


def rays_from_ideal(ideal: FilmPoints, principal_distance_mm: float) -> Rays:
    """Directions in image space of ideal film points (mm from the principal point)."""
    return np.column_stack([ideal / principal_distance_mm, np.full(len(ideal), -1.0)])


def relative_from_exteriors(
    first: ExteriorOrientation, second: ExteriorOrientation
) -> RelativeOrientation:
    """The relative orientation that two exterior orientations imply."""
    turn = first.object_from_image.T
    base = turn @ (second.centre - first.centre)
    length = float(np.linalg.norm(base))
    unit = base / length if length > 0 else np.array([1.0, 0.0, 0.0])
    return RelativeOrientation(unit, turn @ second.object_from_image)


def parallax(rays: RayPairs, orientation: RelativeOrientation) -> Scalars:
    """y-parallax of matches in pixels: coplanarity over its own gradient (Sampson's distance).

    It is signed; its deviation is 1 when that of every coordinate is 1 px.
    """
    return coplanarity(rays, orientation) / coplanarity_sigma(rays, orientation)


def orient_relative(
    rays: RayPairs,
    window_px: tuple[float, float],
    approximate: RelativeOrientation,
    options: RelativeOptions,
    *,
    rng: np.random.Generator,
) -> OrientedPair | Failure:
    """Find the relative orientation most matches agree with, or say why none stands.

    Candidates come from random samples of five (MAGSAC), from a projectivity (flat ground leaves
    the five-point solution undetermined, not the agreement), and from the approximate exterior
    orientations; each is adjusted robustly and the one with the best truncated cost wins.

    Args:
        rays: Rays of matches, of which many may be wrong.
        window_px: Sides of the area of the second photo where matches were looked for.
        approximate: What the approximate exterior orientations imply.
        options: Tolerances.
        rng: Seeds the random search.
    """
    count = len(rays.first)
    if count < options.min_inliers:
        return Failure(
            say("Only {count} matches.", count=count),
            {"matches": count},
        )
    starts = [approximate, *_sample(rays, options, rng)]
    best, best_cost = approximate, np.inf
    for start in starts:
        found = adjust_relative(rays, start, options.tolerance_px)
        residual = parallax(rays, found)
        # Flat ground allows a second orientation, which sees half of it behind the photos.
        residual[~in_front(rays, found)] = np.inf
        cost = float(np.minimum(residual**2, options.tolerance_px**2).sum())
        if cost < best_cost:
            best, best_cost = found, cost
    return _judge(rays, window_px, best, options)


def _judge(
    rays: RayPairs,
    window_px: tuple[float, float],
    orientation: RelativeOrientation,
    options: RelativeOptions,
) -> OrientedPair | Failure:
    """Accept the orientation only if the agreement could not be chance."""
    residual = parallax(rays, orientation)
    agrees = (np.abs(residual) <= options.tolerance_px) & in_front(rays, orientation)
    count = int(agrees.sum())
    total = len(rays.first)
    nfa = log10_false_alarms(total, count, options.tolerance_px, window_px)
    evidence = {"matches": total, "agreeing": count, "log10_nfa": nfa}
    if count < options.min_inliers or nfa > MOST_LOG10_NFA:
        return Failure(
            say(
                "Only {count} of {total} matches agree with one relative orientation.",
                count=count,
                total=total,
            ),
            evidence,
        )
    return OrientedPair(orientation, agrees, residual, nfa)


def log10_false_alarms(
    matches: int, agreeing: int, tolerance_px: float, window_px: tuple[float, float]
) -> float:
    """log10 of the number of false alarms: how often chance would give such an agreement.

    Chance is the share of the search window (pixels) within the tolerance of an epipolar line.
    """
    width, height = window_px
    # The parallax has the noise of both photos in it, hence the root of two.
    band = 2.0 * np.sqrt(2.0) * tolerance_px * float(np.hypot(width, height))
    alpha = min(0.5, band / max(width * height, 1.0))
    return log10_nfa(matches, agreeing, MINIMAL, alpha)


def in_front(rays: RayPairs, orientation: RelativeOrientation) -> Flags:
    """True where the rays meet on the ground side of both photos (parallel rays count too)."""
    along_first, along_second = model_depths(rays, orientation)
    return (along_first > 0) & (along_second > 0)


def model_depths(rays: RayPairs, orientation: RelativeOrientation) -> tuple[Scalars, Scalars]:
    """Depth of each point below both photos, in units of the base, where its rays are nearest."""
    first, turned = rays.first, rays.second @ orientation.rotation.T
    uu, vv = np.sum(first * first, axis=1), np.sum(turned * turned, axis=1)
    uv = np.sum(first * turned, axis=1)
    ub, vb = first @ orientation.base, turned @ orientation.base
    determinant = np.maximum(uu * vv - uv * uv, TINY)  # of parallel rays
    return (vv * ub - uv * vb) / determinant, (uv * ub - uu * vb) / determinant


def coplanarity(rays: RayPairs, orientation: RelativeOrientation) -> Scalars:
    """The product u . (b x R v) of every match: nought where its rays meet."""
    turned = rays.second @ orientation.rotation.T
    return np.sum(np.cross(turned, rays.first) * orientation.base, axis=1)


def coplanarity_sigma(rays: RayPairs, orientation: RelativeOrientation) -> Scalars:
    """Standard deviation of the coplanarity when every coordinate's is one pixel."""
    essential = _skew(orientation.base) @ orientation.rotation
    by_first = (rays.second @ essential.T)[:, :2] * rays.pixel_angles[0]
    by_second = (rays.first @ essential)[:, :2] * rays.pixel_angles[1]
    squared = np.sum(by_first**2, axis=1) + np.sum(by_second**2, axis=1)
    return np.sqrt(np.maximum(squared, TINY**2))


def adjust_relative(
    rays: RayPairs, start: RelativeOrientation, tolerance_px: float
) -> RelativeOrientation:
    """Least squares on the y-parallaxes, with weights that shrink from coarse to the tolerance.

    Gauss-Newton with Geman-McClure's weights: matches far beyond the tolerance do not count.
    """
    orientation = start
    residual = parallax(rays, orientation)
    scale = max(tolerance_px, float(np.median(np.abs(residual))))
    for _ in range(30):
        weights = 1.0 / (1.0 + (residual / scale) ** 2) ** 2
        orientation, step = _step(rays, orientation, weights)
        residual = parallax(rays, orientation)
        # A hundredth of a second of arc: a ten thousandth of a pixel.
        # design: in the words above.
        if scale <= tolerance_px / 2 and step < 5e-8:
            break
        scale = max(tolerance_px / 2, scale / 2)
    return orientation


def _step(
    rays: RayPairs, orientation: RelativeOrientation, weights: Scalars
) -> tuple[RelativeOrientation, float]:
    """One step in the three rotations and the two directions of the base."""
    gradient = coplanarity_sigma(rays, orientation)
    turned = rays.second @ orientation.rotation.T
    by_base = np.cross(turned, rays.first) @ _tangents(orientation.base)
    by_angles = np.cross(rays.second, np.cross(rays.first, orientation.base) @ orientation.rotation)
    design = np.hstack([by_angles, by_base]) / gradient[:, None]
    misclosure = coplanarity(rays, orientation) / gradient
    normal = design.T @ (design * weights[:, None])
    # A whisper of damping: flat ground leaves one direction all but undetermined.
    # design: far below what any match says.
    normal += np.eye(5) * 1e-9 * max(float(np.trace(normal)), TINY**2)
    change = -np.linalg.solve(normal, design.T @ (weights * misclosure))
    # design: a step of more than eleven degrees leaves what was linearised.
    change *= min(1.0, 0.2 / max(float(np.linalg.norm(change)), TINY))
    turn = cast(np.ndarray, cv2.Rodrigues(change[:3])[0])
    base = orientation.base + _tangents(orientation.base) @ change[3:]
    moved = RelativeOrientation(base / np.linalg.norm(base), orientation.rotation @ turn)
    return moved, float(np.linalg.norm(change))


def _sample(
    rays: RayPairs, options: RelativeOptions, rng: np.random.Generator
) -> list[RelativeOrientation]:
    """Orientations from random samples of five matches, and from a projectivity of four."""
    ours = np.ascontiguousarray((rays.first @ OPENCV_FROM_IMAGE)[:, :2])
    theirs = np.ascontiguousarray((rays.second @ OPENCV_FROM_IMAGE)[:, :2])
    scale = float(np.hypot(*rays.pixel_angles)) * options.tolerance_px
    params = cv2.UsacParams()
    params.confidence, params.maxIterations = CONFIDENCE, MOST_SAMPLES
    params.threshold, params.randomGeneratorState = scale, int(rng.integers(1, 2**31 - 1))
    params.score, params.sampler = cv2.SCORE_METHOD_MAGSAC, cv2.SAMPLING_UNIFORM
    # source: OpenCV's own defaults.
    params.loMethod, params.loIterations, params.loSampleSize = cv2.LOCAL_OPTIM_SIGMA, 10, 50
    found: list[RelativeOrientation] = []
    eye, none = np.eye(3), np.zeros(5)
    essential, _ = cv2.findEssentialMat(ours, theirs, eye, eye, none, none, params)
    if np.shape(essential) == (3, 3):
        found += _decompose(np.asarray(essential, dtype=np.float64), rays)
    # A flat scene allows four times the scatter about its plane.
    plane, _ = cv2.findHomography(ours, theirs, params=_with_threshold(params, 4 * scale))
    if np.shape(plane) == (3, 3):
        found += _from_plane(np.asarray(plane, dtype=np.float64), rays)
    return found


def _with_threshold(params: cv2.UsacParams, threshold: float) -> cv2.UsacParams:
    """The same search with another tolerance."""
    params.threshold = threshold
    return params


def _decompose(essential: Rotation, rays: RayPairs) -> list[RelativeOrientation]:
    """The one of four orientations of an essential matrix that has most points in front."""
    ours = (OPENCV_FROM_IMAGE @ essential @ OPENCV_FROM_IMAGE).T
    left, _, right = np.linalg.svd(ours)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    choices: list[RelativeOrientation] = []
    for turn in (quarter, quarter.T):
        rotation = left @ turn @ right
        rotation = rotation * np.sign(np.linalg.det(rotation))
        choices += [RelativeOrientation(sign * left[:, 2], rotation) for sign in (1.0, -1.0)]
    return [max(choices, key=lambda choice: int(in_front(rays, choice).sum()))]


def _from_plane(plane: Rotation, rays: RayPairs) -> list[RelativeOrientation]:
    """Orientations of a projectivity (second from first, OpenCV's axes) with points in front."""
    _, rotations, bases, _ = cv2.decomposeHomographyMat(plane, np.eye(3))
    choices: list[RelativeOrientation] = []
    for turn, shift in zip(rotations, bases, strict=True):
        # OpenCV: p2 ~ R p1 + t, so the second centre in the first space is -R^T t.
        rotation = OPENCV_FROM_IMAGE @ np.asarray(turn).T @ OPENCV_FROM_IMAGE
        base = -OPENCV_FROM_IMAGE @ np.asarray(turn).T @ np.asarray(shift).ravel()
        length = float(np.linalg.norm(base))
        if length > 0:
            choices.append(RelativeOrientation(base / length, rotation))
    enough = len(rays.first) // 4
    return [choice for choice in choices if int(in_front(rays, choice).sum()) > enough]


def _skew(vector: Position) -> Rotation:
    """The matrix that multiplies a vector crosswise from the left."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _tangents(direction: Position) -> Float64[np.ndarray, "3 2"]:
    """Two unit vectors at right angles to a direction."""
    _, _, right = np.linalg.svd(direction[None, :])
    return right[1:].T
