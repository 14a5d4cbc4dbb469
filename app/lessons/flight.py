"""A small flight over gentle hills: photos, ties and control with known truth, in memory."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from app.lessons.photo import HALF_MM, PIXEL_MM, camera_with
from core.arrays import Matrix, ObjectPoints
from core.block import Block, ExteriorPrior, Measurement, Photo, SurveyedPoint, TiePoints
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import nominal_interior

C_MM, SCALE = 152.0, 15_000
ABOVE_M = C_MM / 1000 * SCALE
SIDE_M = 2 * HALF_MM / 1000 * SCALE
FORWARD, ACROSS = 0.6, 0.25
"""Overlaps along and across the strips."""
MARGIN_PX = 330.0
LOOSE = ExteriorPrior(np.full(3, 100.0), np.full(3, 0.1))
# design: a class of thirty, each with the flight it had before.
KEPT = 60
"""Flights of a lesson of which is kept what was found."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A measured block and the truth about it."""

    block: Block
    """Photos as they were flown, ties and control with noise."""
    ties: ObjectPoints
    """True places of the tie points, metres."""
    photos: dict[str, Photo]
    """Photos in their true orientations."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How a flight is laid out."""

    strips: int
    """Strips, flown to and fro."""
    photos: int
    """Photos of a strip."""
    ties: int
    """Tie points spread over the block."""
    noise_px: float
    """Of an image coordinate, pixels of 15 um."""
    seed: int
    """Of everything that is drawn."""
    relief_m: float = 40.0
    """Hills rise and fall by so much."""
    tilt: float = 0.015
    """Standard deviation of omega, phi and kappa, radians."""

    @property
    def extent(self) -> tuple[float, float]:
        """Length and width of what is photographed, metres; it begins at the origin."""
        along = SIDE_M * (1 + (self.photos - 1) * (1 - FORWARD))
        return along, SIDE_M * (1 + (self.strips - 1) * (1 - ACROSS))


def on_hills(plan: Matrix, relief_m: float = 40.0) -> ObjectPoints:
    """Places in plan on the ground."""
    east, north = plan.T
    return np.column_stack([plan, 300 + relief_m * np.sin(east / 900) * np.cos(north / 1100)])


@lru_cache(maxsize=KEPT)
def flown(plan: Plan) -> dict[str, Photo]:
    """The photos of a flight, tilted by a degree or so."""
    rng, side = np.random.default_rng(plan.seed), round(2 * HALF_MM / PIXEL_MM)
    interior = nominal_interior((side, side), camera_with(C_MM), PIXEL_MM)
    photos: dict[str, Photo] = {}
    for strip in range(plan.strips):
        for place in range(plan.photos):
            east = SIDE_M * (0.5 + place * (1 - FORWARD)) + rng.normal(0, 15)
            north = SIDE_M * (0.5 + strip * (1 - ACROSS)) + rng.normal(0, 15)
            omega, phi, kappa = rng.normal(0, 1, 3) * plan.tilt
            exterior = ExteriorOrientation(
                np.array([east, north, 300 + ABOVE_M]), omega, phi, kappa + np.pi * (strip % 2)
            )
            name = f"{strip}{place:02d}"
            photos[name] = Photo(
                name,
                Path(f"{name}.tif"),
                (side, side),
                "lesson",
                interior,
                exterior,
                exterior,
                LOOSE,
                300.0,
                True,
                corrections=(),
            )
    return photos


def fly(plan: Plan, control: Matrix, sigma_m: float, height_m: float | None = None) -> Flight:
    """A flight with control at places in plan, known to standard deviations per axis, metres.

    Args:
        plan: How it is flown.
        control: East and north of its control.
        sigma_m: Of control in plan.
        height_m: Of its heights; None for the same.
    """
    sigmas = np.array([sigma_m, sigma_m, sigma_m if height_m is None else height_m])
    return observed(flown(plan), camera_with(C_MM), plan, control, sigmas_m=sigmas)


def observed(
    photos: dict[str, Photo], camera: Camera, plan: Plan, control: Matrix, *, sigmas_m: np.ndarray
) -> Flight:
    """What is measured in photos that truly stand so."""
    rng = np.random.default_rng(1000 + plan.seed)
    ties = on_hills(rng.uniform([0, 0], plan.extent, (plan.ties, 2)), plan.relief_m)
    known = on_hills(control, plan.relief_m)
    rays: list[tuple[int, int, float, float]] = []
    measured: list[Measurement] = []
    for number, (name, photo) in enumerate(photos.items()):
        for row, (column, line) in seen(photo, camera, ties, plan.noise_px, rng):
            rays.append((row, number, column, line))
        for row, (column, line) in seen(photo, camera, known, plan.noise_px, rng):
            measured.append(Measurement(f"{row}", name, column, line, max(plan.noise_px, 0.02)))
    rays.sort()
    point, photo_number, columns, lines = np.array(rays).T
    tie_points = TiePoints(
        tuple(photos),
        point.astype(np.int64),
        photo_number.astype(np.int64),
        np.column_stack([columns, lines]),
        np.full(len(rays), max(plan.noise_px, 0.02)),
    )
    surveyed = {
        f"{row}": SurveyedPoint(
            f"{row}",
            place + rng.normal(0, 1, 3) * sigmas_m,
            np.maximum(sigmas_m, 0.001),
            "control",
            "surveyed",
        )
        for row, place in enumerate(known)
    }
    block = Block(
        "EPSG:5514",
        {"lesson": camera},
        photos,
        surveyed,
        {one.key: one for one in measured},
        tie_points,
    )
    # The last ones may lie in no photo.
    return Flight(block, ties[: tie_points.count], photos)


def seen(
    photo: Photo, camera: Camera, points: ObjectPoints, noise_px: float, rng: np.random.Generator
) -> list[tuple[int, tuple[float, float]]]:
    """Which points a photo shows, and where they are measured."""
    pixels = photo.pixel_from_object(points, camera)
    inside = ((pixels > MARGIN_PX) & (pixels < photo.size_px[0] - MARGIN_PX)).all(axis=1)
    noisy = pixels + rng.normal(0, noise_px, pixels.shape)
    return [
        (int(row), (float(noisy[row, 0]), float(noisy[row, 1]))) for row in np.flatnonzero(inside)
    ]
