"""Which pixels of a scan are photograph: no margin, no housings of marks, no data strip."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from core.arrays import Mask, PixelPoints
from core.geometry.robust import robust_sigma
from core.raster.scan_file import ScanFile, read_overview
from core.scans.film_area import FilmArea, eight_bit

RING_MM = 3.0
"""Width of the ring of film about the picture whose look is taken for the margin's."""
MIN_MARGIN = 0.005
"""Share of the scan in that ring from which its look can be told."""
MAX_SPREAD = 5.0
"""Greatest spread of the margin's gray, of 255."""
MIN_HEART = 0.1
"""Share of the scan that the picture's heart must be to tell what ink is."""
INK_PERCENTILE = 99.95
"""Ink is whiter than this share of the heart's cells,"""
INK_BEYOND = 0.2
"""and by so much of what sets those apart from the middle."""
BROAD_MM, APART_MM, LEAST_INK_MM2 = 1.0, 2.0, 3.0
"""Strokes are narrower than the first, nearer to each other than the second, and together at least
as large as the third."""
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
    usable &= ~_written(gray, depth_mm, cell_mm, options)
    discs = np.zeros(gray.shape, dtype=np.uint8)
    for column, row in marks:
        place = (round(column / reduction - 0.5), round(row / reduction - 0.5))
        cv2.circle(discs, place, int(np.ceil(options.mark_radius_mm / cell_mm)), 1, -1)
    return np.asarray(usable & (discs == 0))


def _written(
    gray: np.ndarray, depth_mm: np.ndarray, cell_mm: float, options: UsableOptions
) -> Mask:
    """Cells of the picture's rim on which somebody has written, and what lies between strokes.

    Archives write in white on dark film: ink is clearly whiter than the whitest of the picture's
    heart, and thin. What is as white and broad is a field or a cloud. Dark strokes are not told
    from woods, for the rim of a picture is darker than its heart.
    """
    heart = depth_mm > options.housing_mm
    rim = (depth_mm > 0) & ~heart
    nobody = np.zeros(gray.shape, dtype=bool)
    if heart.mean() < MIN_HEART:
        return nobody
    usual, white = np.percentile(gray[heart], (50.0, INK_PERCENTILE))
    ink = (rim & (gray > white + INK_BEYOND * (white - usual))).astype(np.uint8)
    broad = cv2.morphologyEx(ink, cv2.MORPH_OPEN, _square(0.5 * BROAD_MM / cell_mm))
    broad = cv2.dilate(broad, _square(BROAD_MM / cell_mm))
    strokes = ink & (1 - broad)
    between = cv2.morphologyEx(strokes, cv2.MORPH_CLOSE, _square(0.5 * APART_MM / cell_mm))
    count, labels = cv2.connectedComponents(between)
    area_mm2 = np.bincount(labels[strokes > 0], minlength=count) * cell_mm**2
    large = np.flatnonzero(area_mm2 >= LEAST_INK_MM2)
    notes = np.isin(labels, large[large > 0])
    return np.asarray(cv2.dilate(notes.astype(np.uint8), _square(0.5 / cell_mm)) > 0)


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
    spread = min(robust_sigma(gray[ring] - level), MAX_SPREAD) + 1.5
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
