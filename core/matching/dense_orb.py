"""Upright ORB at every place of a window at once.

256 pairs of smoothed grey values about a place are compared, and the comparisons that differ are
counted (Rublee et al. 2011, doi:10.1109/ICCV.2011.6126544). Where the pairs lie is OpenCV's; it is
asked for them once. At every place of a window each pair is two shifted copies of the whole
window, compared in one stroke.
"""

from functools import cache

import cv2
import numpy as np
from jaxtyping import Float32, Int, UInt8

from core.matching.peaks import ScoreMap
from core.matching.template_search import Image, Template

Pairs = Int[np.ndarray, "256 2 2"]
"""Offsets (right, down) of the first and the second value of each comparison, pixels."""
Steps = UInt8[np.ndarray, "thresholds 256"]
ORB_SIDE_PX = 31
"""The pattern spans so many pixels; it is stretched over the template."""
SMOOTHED_SIDE_PX, SMOOTHED_PX = 7, 2.0
"""Smoothing of ORB: side and standard deviation of its Gaussian, stretched with the pattern."""
BITS = 256
REACH_PX = 32
"""No pixel of the pattern lies so far along the lines it is asked along."""


def smoothed_for_orb(image: Image, half_px: int) -> Image:
    """Grey values smoothed to the scale of a pattern that spans 2 n + 1 pixels."""
    scale = (2 * half_px + 1) / ORB_SIDE_PX
    side = 2 * round(SMOOTHED_SIDE_PX * scale / 2 - 0.5) + 1
    return np.asarray(cv2.GaussianBlur(image, (side, side), SMOOTHED_PX * scale), np.float32)


def orb_surface(window: Image, template: Template) -> ScoreMap:
    """Less the share of comparisons in which a template differs from every place of a window.

    Args:
        window: Smoothed grey values of the scan.
        template: Those of the reference, square, with an odd number of rows.
    """
    half_px = template.shape[0] // 2
    pairs = stretched_pairs(half_px) + half_px
    values = template[pairs[:, :, 1], pairs[:, :, 0]]
    return differing(window, half_px, pairs, values[:, 0] < values[:, 1]) / np.float32(-BITS)


def differing(
    window: Image, half_px: int, pairs: Pairs, wanted: np.ndarray
) -> Float32[np.ndarray, "shifts_down shifts_right"]:
    """In how many comparisons each place differs from the wanted ones.

    Args:
        window: Smoothed grey values.
        half_px: Half the square about each place.
        pairs: Columns and rows from the corner of the square.
        wanted: Which comparisons should be true.
    """
    columns = window.shape[1]
    rows, across = (side - 2 * half_px for side in window.shape)
    # One line for the whole window: a shift is then an offset, and nothing is copied.
    line = np.ascontiguousarray(window).reshape(-1)
    length = (rows - 1) * columns + across
    starts = (pairs[:, :, 1] * columns + pairs[:, :, 0]).tolist()
    counts = np.zeros((2, length), np.uint8)
    differs = np.empty(length, np.bool_)
    for bit, (first, second) in enumerate(starts):
        compare = np.greater_equal if wanted[bit] else np.less
        compare(line[first : first + length], line[second : second + length], out=differs)
        count = counts[2 * bit // BITS]
        np.add(count, differs.view(np.uint8), out=count)
    padded = np.zeros(rows * columns, np.float32)
    padded[:length] = counts.sum(axis=0, dtype=np.float32)
    return padded.reshape(rows, columns)[:, :across]


def stretched_pairs(half_px: int) -> Pairs:
    """The pattern laid over 2 n + 1 pixels."""
    scale = (2 * half_px + 1) / ORB_SIDE_PX
    return np.rint(orb_pairs() * scale).astype(np.int64)


@cache
def orb_pairs() -> Pairs:
    """Where OpenCV's pattern lies, read off steps of grey that are moved across a keypoint.

    A comparison of two pixels is true for just those steps whose smoothed edge lies between them:
    the first and the last that is seen tell where both are along the line. Pixels that are level
    with each other along one line are told by the diagonal.
    """
    line = np.arange(-2 * REACH_PX, 2 * REACH_PX + 1)
    right, down = np.meshgrid(line, line)
    edge = SMOOTHED_SIDE_PX // 2
    columns, upright = told_along(right, edge)
    rows, level = told_along(down, edge)
    sums, _ = told_along(right + down, 2 * edge)
    columns = np.where(upright[:, None], sums - rows, columns)
    rows = np.where(level[:, None], sums - columns, rows)
    return np.stack([columns, rows], axis=2)


def told_along(
    places: Int[np.ndarray, "rows columns"], edge: int
) -> tuple[Int[np.ndarray, "256 2"], np.ndarray]:
    """Where both pixels of each comparison lie along a line, and which of them are level.

    Args:
        places: Place of every pixel along the line.
        edge: Half-width of a smoothed step along it.
    """
    steps = range(-REACH_PX, REACH_PX + 1)
    rising = np.array([bits_of(places >= step) for step in steps])
    falling = np.array([bits_of(places < step) for step in steps])
    first_lower = rising.any(axis=0)
    level = np.asarray(~(first_lower | falling.any(axis=0)))
    seen = np.where(first_lower, rising, falling)
    low = np.argmax(seen, axis=0) - REACH_PX + edge - 1
    high = REACH_PX - np.argmax(seen[::-1], axis=0) - edge
    both = np.where(first_lower, (low, high), (high, low))
    return both.T.astype(np.int64), level


def bits_of(bright: np.ndarray) -> UInt8[np.ndarray, "256"]:
    """ORB of OpenCV in the middle of a picture."""
    made = cv2.ORB.create(edgeThreshold=0, nlevels=1, patchSize=ORB_SIDE_PX)
    middle = float(bright.shape[0] // 2)
    point = cv2.KeyPoint(middle, middle, ORB_SIDE_PX, 0.0, 0.0, 0, 0)
    _, found = made.compute((bright * np.uint8(255)).astype(np.uint8), [point])
    return np.unpackbits(np.asarray(found, np.uint8)[0], bitorder="little")
