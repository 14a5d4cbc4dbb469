"""On which side of the picture the camera wrote: clock, level, counter and lettering."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from core.geometry.camera import Camera
from core.raster.scan_file import ScanFile, read_window
from core.scans.film_area import FilmArea, Side
from core.scans.layouts import WAYS, Way, lying

OUTWARD = {"left": (-1.0, 0.0), "top": (0.0, 1.0), "right": (1.0, 0.0), "bottom": (0.0, -1.0)}
STRIP_SIDES: tuple[Side, ...] = ("left", "top", "right", "bottom")


@dataclass(frozen=True, slots=True)
class StripOptions:
    """How the margin is read."""

    cell_mm: float = 0.25
    """Size of a cell in which writing is told from film, millimetres."""
    from_mm: float = 1.5
    """Strip next to the border that is left out: soft edges, notches."""
    to_mm: float = 22.0
    """How far from the border is looked."""
    corner_mm: float = 18.0
    """Ends of each side that are left out: housings of corner marks, notes."""
    contrast: float = 25.0
    """Difference from the film's own gray, of 255, that counts as writing."""
    least_mm2: float = 60.0
    """Area of writing below which there is no strip."""
    ahead: float = 2.0
    """How much more the strip must hold than any other side."""


def find_data_strip(
    scan: ScanFile,
    camera: Camera,
    pixel_mm: float,
    area: FilmArea,
    options: StripOptions | None = None,
) -> Side | None:
    """The side of the picture, as it lies in the scan, with the data strip; None if no side leads.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        pixel_mm: Size of a scan pixel, millimetres.
        area: The exposed picture.
        options: How the margin is read.
    """
    options = options or StripOptions()
    reduction = max(1, round(options.cell_mm / pixel_mm))
    low, high = area.corners.min(axis=0), area.corners.max(axis=0)
    reach, ends = options.to_mm / pixel_mm, options.corner_mm / pixel_mm
    gap = options.from_mm / pixel_mm
    boxes = {
        "left": (low[0] - reach, low[1] + ends, low[0] - gap, high[1] - ends),
        "right": (high[0] + gap, low[1] + ends, high[0] + reach, high[1] - ends),
        "top": (low[0] + ends, low[1] - reach, high[0] - ends, low[1] - gap),
        "bottom": (low[0] + ends, high[1] + gap, high[0] - ends, high[1] + reach),
    }
    written = {
        side: _written_mm2(scan, boxes[side], reduction, pixel_mm, options) for side in STRIP_SIDES
    }
    order = sorted(STRIP_SIDES, key=lambda side: written[side], reverse=True)
    first, second = written[order[0]], written[order[1]]
    if first < options.least_mm2 or first < options.ahead * second:
        return None
    return order[0]


def ways_of_strip(certified: str, seen: Side | None) -> tuple[Way, ...]:
    """Ways the film may lie in, not mirrored first, when its data strip was seen on a side.

    Args:
        certified: Side of the strip in the film frame; empty when nobody knows.
        seen: Side of the strip in the scan.
    """
    if seen is None or not certified:
        return ()
    on_film = np.array([OUTWARD[certified]])
    in_scan = np.array([OUTWARD[seen]])
    return tuple(way for way in WAYS if np.allclose(lying(on_film, way), in_scan))


def strip_on_film(seen: Side, way: Way) -> str:
    """The side of the upright film that lies on a side of the scan."""
    in_scan = np.array([OUTWARD[seen]])
    return next(
        side
        for side, outward in OUTWARD.items()
        if np.allclose(lying(np.array([outward]), way), in_scan)
    )


def _written_mm2(
    scan: ScanFile,
    box: tuple[float, float, float, float],
    reduction: int,
    pixel_mm: float,
    options: StripOptions,
) -> float:
    """Area of what differs from the film in the part of a box that lies in the scan."""
    columns, rows = scan.size_px
    left, top = max(round(box[0]), 0), max(round(box[1]), 0)
    right, bottom = min(round(box[2]), columns), min(round(box[3]), rows)
    if min(right - left, bottom - top) < 8 * reduction:
        return 0.0
    gray = read_window(scan, left, top, right - left, bottom - top, reduction)
    if right - left < bottom - top:
        gray = gray.T
    cell_mm = pixel_mm * reduction
    return float(_differs(gray, options.contrast).sum()) * cell_mm**2


def _differs(gray: Float32[np.ndarray, "across along"], contrast: float) -> np.ndarray:
    """Cells unlike the film in their row; rows run along the border of the picture.

    A row of scanner bed or of paper is even and holds nothing; the film's own gray is the row's
    median, so that a dark film on a white bed is no writing.
    """
    level = np.median(gray, axis=1, keepdims=True)
    step = np.abs(gray - level) > contrast
    busy = step.mean(axis=1, keepdims=True) < 0.5
    cleaned = cv2.morphologyEx((step & busy).astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2)))
    return np.asarray(cleaned)
