"""Scratches that the film got on its way through camera, dryer and projector.

They are thin, straight, and run along the film for centimetres, over road and wood alike. Means of
short pieces of every row (and column) of pixels are looked at: a scratch is a row that is brighter,
or darker, than those on both sides of it in nearly every piece, along one side of the picture. A
lane may be as thin; none is as straight for so long, in so much of its length, and just in the
direction in which most such lines run.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from core.arrays import Flags, Indices, Mask, PixelPoints
from core.raster.scan_file import ScanFile, Scratch, read_window

STRIP_PX = 1024
"""Rows of pixels that are read at a time, about."""
PIECE_PX = (8, 32)
"""Bounds of the length of a piece, pixels."""
OFF = 1.5
"""How far from its curve a piece of a scratch may lie, rows."""
FAINT = 0.3
"""A piece that stands out less than this share of the usual piece is not of the same scratch."""
ROUNDS = 4
Profile = Float32[np.ndarray, "rows pieces"]
"""Mean gray of the pieces of every row."""


@dataclass(frozen=True, slots=True)
class ScratchOptions:
    """What counts as a scratch."""

    piece_mm: float = 0.64
    """Length of a piece, millimetres."""
    row_mm: float = 0.04
    """Rows of pixels are put together to about this width, millimetres."""
    beside: int = 3
    """Rows at this distance on both sides are what a scratch is compared with."""
    beyond: float = 6.0
    """A piece stands out when it does so this many times as much as is usual about it."""
    about: tuple[int, int] = (9, 101)
    """How many pieces and rows that is."""
    least_mm: float = 22.0
    """Shorter ones are not told from what lies on the ground, millimetres."""
    whole: float = 0.85
    """Share of its pieces in which a scratch stands out."""
    turn_deg: float = 2.0
    """How far both its ends may be turned against the side of the picture, degrees."""


def find_scratches(
    scan: ScanFile,
    corners: PixelPoints,
    photograph: Mask,
    pixel_mm: float,
    options: ScratchOptions | None = None,
) -> tuple[Scratch, ...]:
    """Scratches of one scan, all of one way: that in which more of them was found.

    Args:
        scan: The scan; read by strips.
        corners: Of the picture, pixels, as `FilmArea` has them.
        photograph: True where the scan is photograph, cells that cover it whole.
        pixel_mm: Size of a scan pixel on the film, millimetres.
        options: What counts as a scratch.

    Raises:
        ScanError: The scan cannot be read.
    """
    options = options or ScratchOptions()
    piece = int(np.clip(round(options.piece_mm / pixel_mm), *PIECE_PX))
    step = max(round(options.row_mm / pixel_mm), 1)
    least = int(np.ceil(options.least_mm / (pixel_mm * piece)))
    if min(scan.size_px) < max(least, step) * piece:
        return ()
    profiles = _profiles(scan, piece, step)
    sides = np.roll(corners, -1, axis=0) - corners
    tilts = (_tilt(sides[[0, 2]]), _tilt(sides[[1, 3], ::-1]))
    limit = float(np.tan(np.radians(options.turn_deg)))
    ways: list[list[Scratch]] = []
    for axis, (profile, tilt) in enumerate(zip(profiles, tilts, strict=True)):
        cells = (photograph if axis == 0 else photograph.T).astype(np.uint8)
        may = cv2.resize(cells, profile.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        curves = _along(profile, may, least, options)
        found = (_scratch(axis, *curve, piece, step) for curve in curves)
        ways.append([scratch for scratch in found if _turn(scratch, tilt) <= limit])
    return tuple(max(ways, key=lambda found: sum(each.last - each.first for each in found)))


def _turn(scratch: Scratch, tilt: float) -> float:
    """Greatest difference of its rise from that of the picture's sides."""
    square, rise, _ = scratch.course
    return max(abs(2 * square * end + rise - tilt) for end in (scratch.first, scratch.last))


def _tilt(sides: PixelPoints) -> float:
    """Rise of two opposite sides of the picture for one pixel along them."""
    return float(np.mean(sides[:, 1] / sides[:, 0]))


def _profiles(scan: ScanFile, piece: int, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Means (`Profile`) of the pieces of rows, and of columns, `step` of which make one."""
    unit = piece * step
    columns, rows = (side // unit * unit for side in scan.size_px)
    along_rows = np.empty((rows // step, columns // piece), np.float32)
    along_columns = np.empty((rows // piece, columns // step), np.float32)
    high = max(STRIP_PX // unit, 1) * unit
    for top in range(0, rows, high):
        strip = read_window(scan, 0, top, columns, min(high, rows - top))
        for means, down in ((along_rows, step), (along_columns, piece)):
            part = means[top // down : (top + len(strip)) // down]
            part[:] = cv2.resize(strip, part.shape[::-1], interpolation=cv2.INTER_AREA)
    return along_rows, np.ascontiguousarray(along_columns.T)


def _along(
    profile: Profile, may: Mask, least: int, options: ScratchOptions
) -> Iterator[tuple[np.ndarray, int, int]]:
    """Curves of bright and dark scratches along the rows of a profile."""
    for sign in (1, -1):
        strength = _standing_out(np.float32(sign) * profile, options)
        for rows, pieces in _chains(strength, may, options.whole * least):
            curve = _curve(rows, pieces, least, options.whole)
            if curve is not None:
                yield curve


def _standing_out(profile: Profile, options: ScratchOptions) -> Profile:
    """By how much a piece is brighter than both neighbours, in limits; from 1 on it stands out."""
    beside = options.beside
    thin = np.zeros_like(profile)
    middle = profile[beside:-beside]
    thin[beside:-beside] = middle - np.maximum(profile[: -2 * beside], profile[2 * beside :])
    np.maximum(thin, 0, out=thin)
    usual = cv2.blur(thin, options.about)
    return thin / (options.beyond * np.maximum(usual, max(float(np.median(usual[::8])), 1e-3)))


def _chains(strength: Profile, may: Mask, least: float) -> Iterator[tuple[Indices, Indices]]:
    """Rows and pieces of what stands out and hangs together, one row for each piece.

    Chains of fewer pieces than the least are left out.
    """
    peaks = (strength > 1) & may
    peaks[1:] &= strength[1:] >= strength[:-1]
    peaks[:-1] &= strength[:-1] >= strength[1:]
    linked = cv2.dilate(peaks.astype(np.uint8), np.ones((3, 5), np.uint8))
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(linked, connectivity=8)
    enough = np.bincount(labels[peaks], minlength=len(boxes)) >= least
    for label in np.flatnonzero(enough & (boxes[:, cv2.CC_STAT_WIDTH] >= least)):
        left, top, wide, high = boxes[label, :4]
        box = np.s_[top : top + high, left : left + wide]
        mine = np.where((labels[box] == label) & peaks[box], strength[box], 0)
        best = mine.max(axis=0)
        # A scratch is about as strong everywhere: what is much weaker only happens to lie there.
        pieces = np.flatnonzero(best > FAINT * np.median(best[best > 0]))
        yield mine[:, pieces].argmax(axis=0) + top, pieces + left


def _curve(
    rows: Indices, pieces: Indices, least: int, whole: float
) -> tuple[np.ndarray, int, int] | None:
    """A parabola through nearly all rows of a chain, with its first and last piece."""
    near: Flags = np.ones(len(rows), bool)
    fitted = np.zeros(3)
    for _ in range(ROUNDS):
        if near.sum() < max(whole * least, 4):
            return None
        fitted = np.polyfit(pieces[near], rows[near], 2)
        near = np.abs(np.polyval(fitted, pieces) - rows) <= OFF
    first, last = int(pieces[near][0]), int(pieces[near][-1])
    span = last - first + 1
    return (fitted, first, last) if span >= least and near.sum() >= whole * span else None


def _scratch(
    axis: int, fitted: np.ndarray, first: int, last: int, piece: int, step: int
) -> Scratch:
    """The same curve in pixels; the middle of the first piece is at half a piece."""
    ends = np.array([first, (first + last) / 2, last])
    course = np.polyfit((ends + 0.5) * piece, (np.polyval(fitted, ends) + 0.5) * step, 2)
    return Scratch(axis, float(first * piece), float((last + 1) * piece), tuple(course.tolist()))
