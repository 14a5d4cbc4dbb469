"""A fiducial that a person pointed at, centred: by an example of the same mark, or its symmetry."""

from dataclasses import dataclass

import cv2
import numpy as np

from core.doubts import Failure
from core.raster.scan_file import ScanFile, read_window
from core.scans.centring import (
    Centre,
    Gray,
    Weights,
    centre_by_symmetry,
    correlation,
    disc_weights,
    match_mark,
    sample_about,
)

RADII_MM = (0.5, 0.8, 1.3)
"""Radii about the middle that are tried, millimetres: marks are of different sizes."""
REACH_MM = 0.5
"""How far the middle may lie from where somebody pointed, millimetres."""
SEARCH_STEPS = 8
"""Steps to either side in which the middle of a symmetric mark is sought."""
LEAST_ALIKE = 0.6
"""Likeness below which the place is no mark."""


@dataclass(frozen=True, slots=True)
class Example:
    """The same mark where it was measured well."""

    scan: ScanFile
    """The scan."""
    place: tuple[float, float]
    """Column and row of its middle."""


def snap_mark(
    scan: ScanFile, place: tuple[float, float], pixel_mm: float, example: Example | None = None
) -> Centre | Failure:
    """The middle of the mark beside a place, scan pixels.

    Args:
        scan: The scan.
        place: Column and row where somebody pointed.
        pixel_mm: Size of a scan pixel on the film, millimetres.
        example: The same mark in another scan of the camera, that lies the same way and has
            pixels of the same size; without one, or where it is unlike, the mark's own symmetry.
    """
    window, corner = _window(scan, place, pixel_mm)
    start = (place[0] - corner[0], place[1] - corner[1])
    reach_px = REACH_MM / pixel_mm + 2
    tried: list[Centre] = []
    if example is not None:
        other, beside = _window(example.scan, example.place, pixel_mm)
        middle = np.array(example.place) - np.array(beside)
        for radius in RADII_MM:
            weights = _disc(radius, pixel_mm)
            template = sample_about(other, middle, weights.shape[0])
            near = _likest(window, template, start, reach_px)
            _keep(tried, match_mark(window, template, weights, near, 3.0))
    if not tried:
        for radius in RADII_MM:
            weights = _disc(radius, pixel_mm)
            near = _most_symmetric(window, weights, start, reach_px)
            _keep(tried, centre_by_symmetry(window, weights, near, 3.0))
    if not tried:
        return Failure("there is nothing like the mark beside that place")
    best = max(tried, key=lambda centre: centre.correlation)
    return Centre(best.column + corner[0], best.row + corner[1], best.sigma_px, best.correlation)


def _likest(
    window: Gray, template: Weights, start: tuple[float, float], reach_px: float
) -> tuple[float, float]:
    """The place within reach at which the window is most like a template, to a pixel."""
    surface = cv2.matchTemplate(window, template.astype(np.float32), cv2.TM_CCOEFF_NORMED)
    half = template.shape[0] // 2
    columns, rows = np.meshgrid(*(np.arange(n) + half + 0.5 for n in surface.shape[::-1]))
    away = np.hypot(columns - start[0], rows - start[1])
    best = int(np.argmax(np.where(away <= reach_px, surface, -2.0)))
    return float(columns.flat[best]), float(rows.flat[best])


def _most_symmetric(
    window: Gray, weights: Weights, start: tuple[float, float], reach_px: float
) -> tuple[float, float]:
    """The place within reach about which the window looks most like itself after half a turn."""
    step = max(1.0, reach_px / SEARCH_STEPS)
    offsets = np.arange(-reach_px, reach_px + step / 2, step)
    best, place = -2.0, start
    for right in offsets:
        for down in offsets:
            here = np.array([start[0] + right, start[1] + down])
            patch = sample_about(window, here, weights.shape[0])
            alike = correlation(patch, patch[::-1, ::-1], weights)
            if alike > best:
                best, place = alike, (float(here[0]), float(here[1]))
    return place


def _keep(tried: list[Centre], found: Centre | Failure) -> None:
    """Remember what looks like the mark."""
    if isinstance(found, Centre) and found.correlation >= LEAST_ALIKE:
        tried.append(found)


def _disc(radius_mm: float, pixel_mm: float) -> Weights:
    radius = max(radius_mm / pixel_mm, 3.0)
    return disc_weights(2 * int(np.ceil(radius)) + 3, radius)


def _window(
    scan: ScanFile, place: tuple[float, float], pixel_mm: float
) -> tuple[Gray, tuple[int, int]]:
    """Grays about a place, and the first column and row."""
    half = int(np.ceil((RADII_MM[-1] + REACH_MM) / pixel_mm)) + 8
    corner = (round(place[0]) - half, round(place[1]) - half)
    return read_window(scan, *corner, 2 * half, 2 * half, outside="edge"), corner
