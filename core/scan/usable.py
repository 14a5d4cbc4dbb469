"""Which pixels of a scan are photograph: no margin, no housings of marks, no data strip."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from core.arrays import Mask, PixelPoints
from core.scan.film_area import FilmArea, eight_bit
from core.scan.raster import ScanFile, read_overview

RING_MM = 3.0
"""Width of the ring of film about the picture whose look is taken for the margin's."""
MIN_MARGIN = 0.005
"""Share of the scan in that ring from which its look can be told."""
MAX_SPREAD = 5.0
"""Greatest spread of the margin's gray, of 255."""
MAX_ALIKE = 0.05
"""When more of the picture's heart looks like the margin, likeness proves nothing."""


@dataclass(frozen=True, slots=True)
class UsableOptions:
    """What of the picture is left out."""

    border_mm: float = 1.0
    """Strip along the border of the picture, millimetres."""
    mark_radius_mm: float = 2.5
    """Disc about every fiducial, millimetres."""
    housing_mm: float = 16.0
    """How far the dark housings of marks and data strips may reach into the picture."""


def usable_mask(
    scan: ScanFile,
    area: FilmArea,
    pixel_mm: float,
    marks: Iterable[tuple[float, float]] = (),
    reduction: int = 8,
    options: UsableOptions | None = None,
) -> Mask:
    """Which cells of the reduced scan are photograph: no margin, marks, data strip or notes.

    Args:
        scan: The scan.
        area: The exposed picture.
        pixel_mm: Size of a scan pixel on the film, millimetres.
        marks: Fiducials, (column, row) pixels.
        reduction: How many pixels a side become one.
        options: What is left out.

    Returns:
        (rows // reduction, columns // reduction), True where the scan may be used.
    """
    options = options or UsableOptions()
    gray = eight_bit(read_overview(scan, reduction))
    cell_mm = pixel_mm * reduction
    inside = _inside(area.corners / reduction, gray.shape)
    depth_mm = cv2.distanceTransform(_framed(inside), cv2.DIST_L2, 5)[1:-1, 1:-1] * cell_mm
    usable = depth_mm > options.border_mm
    usable &= ~_margin_like(gray, inside, depth_mm, cell_mm, options)
    discs = np.zeros(gray.shape, dtype=np.uint8)
    for column, row in marks:
        place = (round(column / reduction - 0.5), round(row / reduction - 0.5))
        cv2.circle(discs, place, int(np.ceil(options.mark_radius_mm / cell_mm)), 1, -1)
    return np.asarray(usable & (discs == 0))


def _inside(corners: PixelPoints, shape: tuple[int, ...]) -> Mask:
    """Cells inside the picture."""
    filled = np.zeros(shape, dtype=np.uint8)
    cv2.fillPoly(filled, [np.rint(corners - 0.5).astype(np.int32)], 1)
    return filled > 0


def _square(radius: float) -> np.ndarray:
    """A square structuring element of a radius in cells."""
    return np.ones((2 * max(1, round(radius)) + 1,) * 2, dtype=np.uint8)


def _framed(inside: Mask) -> np.ndarray:
    """As bytes, with a ring of nought about it, so that the scan's edge is a border too."""
    return np.pad(inside.astype(np.uint8), 1)


def _margin_like(
    gray: np.ndarray, inside: Mask, depth_mm: np.ndarray, cell_mm: float, options: UsableOptions
) -> Mask:
    """Cells of the picture that look like the margin and hang together with it.

    The housings of the marks, rounded corners and data strips are cut out of the exposed picture:
    as smooth and as dark (or bright) as the film about it. Lettering on them is closed over.
    """
    outside = ~inside
    ring = outside & (cv2.dilate(inside.astype(np.uint8), _square(RING_MM / cell_mm)) > 0)
    nobody = np.zeros(gray.shape, dtype=bool)
    if ring.mean() < MIN_MARGIN:
        return nobody
    level = float(np.median(gray[ring]))
    spread = min(1.4826 * float(np.median(np.abs(gray[ring] - level))), MAX_SPREAD) + 1.5
    near = cv2.blur(np.abs(gray - level), (3, 3)) < 3 * spread
    heart = depth_mm > options.housing_mm
    if heart.any() and near[heart].mean() > MAX_ALIKE:
        return nobody
    near &= depth_mm < options.housing_mm
    kernel = _square(0.6 / cell_mm)
    closed = cv2.morphologyEx((near | outside).astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, kernel)
    _, labels = cv2.connectedComponents(opened)
    touching = np.unique(labels[outside | (depth_mm < 2 * cell_mm)])
    margin = np.isin(labels, touching[touching > 0])
    return np.asarray(cv2.dilate(margin.astype(np.uint8), kernel) > 0)
