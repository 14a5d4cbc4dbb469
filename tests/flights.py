"""Synthetic flights in memory: photos over hilly ground with everything known."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from core.block import Block, ExteriorPrior, Measurement, Photo, SurveyedPoint, TiePoints
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

ORIGIN = np.array([-545_000.0, -1_160_000.0, 0.0])
PIXEL_MM = 0.015
EXACT_M = np.full(3, 0.001)
"""What check points are known to, whose places are the truth."""


@dataclass(frozen=True)
class FlightPlan:
    """Archival film by default: 18 x 18 cm, 1 : 15 000, 60 % and 25 % overlap."""

    strips: int = 2
    photos_per_strip: int = 3
    ties: int = 300
    control: int = 30
    check: int = 10
    principal_distance_mm: float = 211.59
    frame_mm: float = 180.0
    flying_height_m: float = 3170.0
    relief_m: float = 60.0
    forward: float = 0.6
    side: float = 0.25
    tie_sigma_px: float = 0.5
    control_sigma_px: float = 1.0
    control_sigma_m: tuple[float, float, float] = (0.4, 0.4, 0.6)
    start_m: float = 20.0
    start_rad: float = 0.01
    camera_errors: bool = True
    most_rays: int = 99


@dataclass(frozen=True)
class Flight:
    """A measured block whose first orientations are off, and the truth about it."""

    block: Block
    truth: Block
    ties: np.ndarray


def fly(plan: FlightPlan, rng: np.random.Generator) -> Flight:
    """A block with normal noise of exactly the stated standard deviations."""
    camera, true_camera = _cameras(plan, rng)
    photos, true_photos = _photos(plan, rng)
    truth = Block("EPSG:5514", {"wide": true_camera}, true_photos)
    ties, grounds = _ties(plan, truth, rng)
    surveyed, true_surveyed, measurements = _surveyed(plan, truth, rng)
    block = Block("EPSG:5514", {"wide": camera}, photos, surveyed, measurements, ties)
    return Flight(block, replace(truth, surveyed=true_surveyed), grounds)


def _cameras(plan, rng):
    half = plan.frame_mm / 2
    certified = Camera(
        "wide",
        plan.principal_distance_mm,
        (plan.frame_mm, plan.frame_mm),
        (0.02, -0.03),
        (2e-8, -1e-12, 0.0),
    )
    if not plan.camera_errors:
        return certified, certified
    corner = half * np.sqrt(2)
    c, x, y, k1, k2 = rng.normal(size=5) * [
        0.05,
        0.1,
        0.1,
        0.05 / corner**3,
        0.05 / corner**5,
    ]
    true = replace(
        certified,
        principal_distance_mm=certified.principal_distance_mm + c,
        principal_point_mm=(0.02 + x, -0.03 + y),
        radial_distortion=(2e-8 + k1, -1e-12 + k2, 0.0),
    )
    return certified, true


def _photos(plan, rng):
    size = round(plan.frame_mm / PIXEL_MM)
    side_m = plan.frame_mm * plan.flying_height_m / plan.principal_distance_mm
    photos, true_photos = {}, {}
    for strip in range(plan.strips):
        for row in range(plan.photos_per_strip):
            name = f"{strip:02d}_{row:03d}"
            along, across = row * side_m * (1 - plan.forward), strip * side_m * (1 - plan.side)
            centre = ORIGIN + np.array([along, across, plan.flying_height_m + 300.0])
            centre = centre + rng.normal(size=3) * [20, 20, 10]
            kappa = np.pi * (strip % 2)
            true = ExteriorOrientation(centre, *(rng.normal(size=3) * 0.02 + [0.0, 0.0, kappa]))
            start = ExteriorOrientation(
                centre + rng.normal(size=3) * plan.start_m,
                *(
                    np.array([true.omega, true.phi, true.kappa])
                    + rng.normal(size=3) * plan.start_rad
                ),
            )
            prior = ExteriorPrior(
                np.full(3, max(plan.start_m, 0.01)), np.full(3, max(plan.start_rad, 1e-5))
            )
            interior = _interior(size, rng)
            photo = Photo(
                name,
                Path(f"{name}.tif"),
                (size, size),
                "wide",
                interior,
                start,
                start,
                prior,
                300.0,
                oriented=True,
            )
            photos[name] = photo
            true_photos[name] = replace(photo, exterior=true)
    return photos, true_photos


def _interior(size, rng):
    """A scan laid a little askew, as an affine transform."""
    turn, shear = rng.normal(size=2) * [0.01, 1e-4]
    linear = PIXEL_MM * np.array(
        [[np.cos(turn), np.sin(turn) + shear], [np.sin(turn), -np.cos(turn)]]
    )
    shift = -linear @ np.array([size / 2, size / 2])
    matrix = np.column_stack([linear, shift])
    return InteriorOrientation("affine", matrix, (), np.zeros((0, 2)), np.zeros((0, 2)), np.nan)


def _ground(plan, truth, count, rng):
    """Points on hills, spread over all that is photographed."""
    centres = np.array([photo.exterior.centre for photo in truth.photos.values()])
    reach = 0.45 * plan.frame_mm * plan.flying_height_m / plan.principal_distance_mm
    low, high = centres[:, :2].min(axis=0) - reach, centres[:, :2].max(axis=0) + reach
    plane = rng.uniform(low, high, size=(count, 2))
    local = plane - ORIGIN[:2]
    height = 300 + plan.relief_m / 2 * np.sin(local[:, 0] / 700) * np.cos(local[:, 1] / 900)
    return np.column_stack([plane, height + rng.normal(size=count) * 2])


def _seen(photo, truth, points):
    """Pixels of points, and which lie inside the frame (5 mm of margin)."""
    near = np.linalg.norm(points[:, :2] - photo.exterior.centre[:2], axis=1) < 4000
    pixels = np.full((len(points), 2), np.nan)
    if near.any():
        pixels[near] = photo.pixel_from_object(points[near], truth.camera_of(photo.photo_id))
    margin, size = 330, photo.size_px[0]
    with np.errstate(invalid="ignore"):
        inside = ((pixels > margin) & (pixels < size - margin)).all(axis=1)
    return pixels, inside


def _ties(plan, truth, rng):
    grounds = _ground(plan, truth, plan.ties, rng)
    point, photo, pixels = [], [], []
    for index, value in enumerate(truth.photos.values()):
        projected, inside = _seen(value, truth, grounds)
        numbers = np.flatnonzero(inside)
        point.append(numbers)
        photo.append(np.full(len(numbers), index))
        pixels.append(projected[numbers])
    point, photo, pixels = map(np.concatenate, (point, photo, pixels))
    pixels = pixels + rng.normal(size=pixels.shape) * plan.tie_sigma_px
    keep = rng.permutation(len(point))
    order = keep[np.argsort(point[keep], kind="stable")]
    rank = np.arange(len(order)) - np.searchsorted(point[order], point[order])
    order = order[rank < plan.most_rays]
    sigma = np.full(len(order), plan.tie_sigma_px)
    return (
        TiePoints(tuple(truth.photos), point[order], photo[order], pixels[order], sigma),
        grounds,
    )


def _surveyed(plan, truth, rng):
    grounds = _ground(plan, truth, plan.control + plan.check, rng)
    sigma = np.array(plan.control_sigma_m)
    surveyed, true_surveyed, measurements = {}, {}, {}
    for number, ground in enumerate(grounds):
        role = "control" if number < plan.control else "check"
        name = f"{role}{number:03d}"
        control = role == "control"
        known = ground + rng.normal(size=3) * sigma if control else ground
        stated = sigma if control else EXACT_M
        source = "junction" if control else "surveyed"
        surveyed[name] = SurveyedPoint(name, known, stated, role, source)
        true_surveyed[name] = SurveyedPoint(name, ground, sigma, role, "junction")
    for photo_id, photo in truth.photos.items():
        projected, inside = _seen(photo, truth, grounds)
        noisy = projected + rng.normal(size=projected.shape) * plan.control_sigma_px
        for name, pixel, seen in zip(surveyed, noisy, inside, strict=True):
            if seen:
                key = (name, photo_id)
                measurements[key] = Measurement(
                    name, photo_id, float(pixel[0]), float(pixel[1]), plan.control_sigma_px
                )
    return surveyed, true_surveyed, measurements
