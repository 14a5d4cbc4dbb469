"""Signalised points: a cross or plate measured once is the template for all others of its kind.

Such points look alike, so that the surveyed coordinates say where to look, and the example what
for. The middle of a signal is the point about which it looks like itself after half a turn
(`core/scans/centring.py`, as of camera marks).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from core.arrays import PixelPoints
from core.block import UNKNOWN_M, Measurement
from core.control.located import (
    Located,
    Surroundings,
    locate_point,
    pointing_px,
    slope_at,
    usable,
)
from core.control.transfer import Transferred, proposed, shown
from core.doubts import Failure
from core.raster.scan_file import ScanFile, read_window
from core.scans.centring import Centre, centre_by_symmetry, disc_weights

# design: a hand is within a third of a signal of its middle.
REACH = 0.5
"""The middle lies no further from where it was pointed at than this share of the radius."""
# design: half of its variance explained; less is no signal.
LEAST_ALIKE = 0.7
"""A signal is at least so much like itself after half a turn."""


def transfer_example(
    around: Surroundings,
    point_id: str,
    example: Measurement,
    radius_px: float,
    measured: Sequence[Measurement] = (),
) -> Transferred | Failure:
    """Propose a signalised point wherever photos should show it, by the example of another one.

    Args:
        around: The block and its scans.
        point_id: A surveyed point whose coordinates are known.
        example: A signal of the same kind, of any point, measured in one photo.
        radius_px: How far the signal reaches about its middle, scan pixels; what lies beyond is
            ground, and elsewhere another.
        measured: Where the point is measured already.

    Returns:
        The proposals, or why the point cannot be looked for at all.
    """
    point, other = (around.block.surveyed.get(name) for name in (point_id, example.point_id))
    if point is None or bool((point.sigma_m >= UNKNOWN_M).any()):
        return Failure("its coordinates are not known, so nobody can say where to look")
    if not usable(around, example.photo_id):
        return Failure("the photo of the example is not oriented")
    there = locate_point(around, [example], other)
    if isinstance(there, Failure):
        return there
    slope = slope_at(around, point.position)
    where = Located(point.position, np.diag(point.sigma_m**2), slope)
    done = {item.photo_id for item in measured}
    template = [replace(shown(around, there, example), half_px=int(np.ceil(radius_px)))]
    return proposed(around, point_id, where, template, done, pointing_px([example]))


def centre_of_signal(scan: ScanFile, pixel: PixelPoints, radius_px: float) -> Centre | Failure:
    """The middle of a cross or plate to a part of a pixel.

    Args:
        scan: The scan.
        pixel: Where it was pointed at, (1, 2).
        radius_px: How far the signal reaches about its middle, scan pixels.

    Returns:
        The middle in scan pixels with its standard deviation, or why there is none.
    """
    side = 2 * int(np.ceil(radius_px)) + 1
    half = side + 2
    corner = np.floor(pixel[0]).astype(np.int64) - half
    left, top = corner.tolist()
    window = read_window(scan, left, top, 2 * half + 1, 2 * half + 1, outside="edge")
    start = (float(pixel[0, 0]) - left, float(pixel[0, 1]) - top)
    found = centre_by_symmetry(window, start, REACH * radius_px, disc_weights(side, radius_px))
    if isinstance(found, Failure):
        return found
    if found.correlation < LEAST_ALIKE:
        return Failure("what lies there does not look like a signal")
    return Centre(found.column + left, found.row + top, found.sigma_px, found.correlation)
