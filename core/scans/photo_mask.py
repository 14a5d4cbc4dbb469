"""Which pixels of a scan are photograph: no margin, housings, data strip, writing or scratches.

Scratches are those that the film got on its way through camera, dryer and projector. They are thin,
straight, and run along the film for centimetres, over road and wood alike. Means of short pieces of
every row (and column) of pixels are looked at: a scratch is a row that is brighter, or darker, than
those on both sides of it in nearly every piece, along one side of the picture. A lane may be as
thin; none is as straight for so long, in so much of its length, and just in the direction in which
most such lines run.
"""

from collections.abc import Iterable, Iterator

import cv2
import numpy as np
import shapely
from jaxtyping import Float32
from rasterio.features import geometry_mask
from rasterio.transform import Affine

from core.arrays import Flags, Indices, Mask, PixelPoints
from core.frames import HALF_PIXEL
from core.geometry.drawn_mask import Area, DrawnMask
from core.geometry.robust import robust_sigma
from core.raster.scan_file import ScanFile, Scratch, UsableArea, read_overview, read_window
from core.scans.film_area import FilmArea, eight_bit

BORDER_MM = 1.0  # design: the picture's border is soft, and found to a fifth of a millimetre
"""Strip along the border of the picture that is left out."""
MARK_MM = 2.5  # design: the largest mark of the library, and a little
"""Radius of the disc that is left out about every fiducial."""
HOUSING_MM = 16.0  # design: as far as housings of marks and data strips of old cameras reach
"""How far from the border housings, data strips and notes may reach into the picture."""
RING_MM = 3.0  # design: film there always is about a frame, and enough cells to tell its gray
"""Width of the ring of film about the picture whose look is taken for the margin's."""
MIN_MARGIN = 0.005  # design: a tenth of the ring about a whole frame
"""Share of the scan in that ring from which its look can be told."""
MAX_SPREAD = 5.0  # design: with more, a margin holds writing or dirt, and its spread is no noise
"""Greatest spread of the margin's gray, of 255."""
LEAST_SPREAD = 1.5  # design: steps of 8 bit and the compression of the file
"""Spread of the margin's gray that is always reckoned with."""
MIN_HEART = 0.1  # design: enough cells for the percentile below
"""Share of the scan that the picture's heart must be to tell what ink is."""
# design: one cell in two thousand may be a roof in the sun; ink is whiter still.
INK_PERCENTILE, INK_BEYOND = 99.95, 0.2
"""Ink is whiter than this share of the heart's cells, and by so much of what sets those apart from
the middle."""
BROAD_MM, APART_MM, LEAST_INK_MM2 = 1.0, 2.0, 3.0  # design: pens and digits of archivists
"""Strokes are narrower than the first, nearer to each other than the second, and together at least
as large as the third."""
ABOUT_MM = 10.0  # design: light falls off over centimetres, notes are millimetres
"""Width of the surroundings whose mean gray dark ink is compared with."""
WIDE_CELLS = 3  # design: the cell a scratch runs through, and its neighbours
LEAST_PART = 0.1  # design: with less of them inside the picture their mean is that of a few cells
"""Share of those surroundings that is taken to lie inside the picture at least."""
CLOSED_MM = 0.6  # design: strokes of lettering on housings are about so wide
"""Gaps of the margin that are closed, and islands that are dropped."""
MAX_ALIKE = 0.05  # design: ground is hardly ever as even and as dark as film
"""When more of the picture's heart looks like the margin, likeness proves nothing."""
STRIP_PX = 1024  # design: memory; 50 MB of a scan of 12,000 columns
"""Rows of pixels that are read at a time, about."""
PIECE_MM, PIECE_PX = 0.64, (8, 32)  # design: grain is averaged out, bends and gaps are not
"""Length of a piece, and its bounds."""
ROW_MM = 0.04  # design: scratches are twenty to sixty micrometres wide
"""Rows of pixels are put together to about this width."""
BESIDE = 3  # design: beyond the blur of a scratch of a row or two
"""Rows at this distance on both sides are what a scratch is compared with."""
BEYOND = 6.0  # design: with 3 roads stand out as well, with 12 only the strongest scratches
"""A piece stands out when it does so this many times as much as is usual about it."""
ABOUT = (9, 101)  # design: 6 mm along and 4 mm across: one field, and no scratch fills it
"""How many pieces and rows that is."""
LEAST_MM, WHOLE, TURN_DEG = 22.0, 0.85, 2.0  # design: lanes are shorter, have gaps, or are aslant
"""Length from which scratches are told from what lies on the ground, share of its pieces in which
a scratch stands out, and how far both its ends may be turned against the side of the picture."""
OFF = 1.5  # design: the row and its neighbours
"""How far from its curve a piece of a scratch may lie, rows."""
FAINT = 0.3  # design: a scratch is about as strong everywhere
"""A piece that stands out less than this share of the usual piece is not of the same scratch."""
ROUNDS = 4  # design: what is off a parabola no longer changes then
Profile = Float32[np.ndarray, "rows pieces"]
"""Mean gray of the pieces of every row."""


def find_usable_area(
    scan: ScanFile,
    area: FilmArea,
    pixel_mm: float,
    marks: Iterable[tuple[float, float]],
    reduction: int,
) -> UsableArea:
    """What of a scan is photograph: no margin, marks, data strip, notes or scratches.

    Args:
        scan: The scan.
        area: The exposed picture.
        pixel_mm: Size of a scan pixel on the film, millimetres.
        marks: Fiducials, (column, row) pixels.
        reduction: How many pixels a side become one cell.

    Raises:
        ScanError: The scan cannot be read.
    """
    gray = eight_bit(read_overview(scan, reduction))
    cell_mm = pixel_mm * reduction
    inside = _inside(area.corners / reduction, gray.shape)
    depth_mm = (
        cv2.distanceTransform(_framed(inside), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1] * cell_mm
    )
    usable = depth_mm > BORDER_MM
    usable &= ~_margin_like(gray, inside, depth_mm, cell_mm)
    discs = np.zeros(gray.shape, dtype=np.uint8)
    for column, row in marks:
        place = (round(column / reduction - 0.5), round(row / reduction - 0.5))
        cv2.circle(discs, place, int(np.ceil(MARK_MM / cell_mm)), 1, -1)
    usable &= discs == 0
    scratches = find_scratches(scan, area.corners, usable, pixel_mm)
    usable &= ~_written(gray, depth_mm, cell_mm, _drawn(scratches, gray.shape, reduction))
    return UsableArea.of(np.asarray(usable), scan.size_px, scratches)


def _drawn(scratches: Iterable[Scratch], shape: tuple[int, ...], reduction: int) -> Mask:
    """Cells that scratches run through, and those beside them, which are blurred."""
    lines = np.zeros(shape, dtype=np.uint8)
    for scratch in scratches:
        along = np.append(np.arange(scratch.first, scratch.last, reduction), scratch.last)
        places = np.column_stack([along, np.polyval(scratch.course, along)])
        cells = (places[:, ::-1] if scratch.axis else places) / reduction - HALF_PIXEL
        cv2.polylines(lines, [np.rint(cells).astype(np.int32)], False, 1, WIDE_CELLS)
    return lines > 0


def _written(gray: np.ndarray, depth_mm: np.ndarray, cell_mm: float, scratched: Mask) -> Mask:
    """Cells of the picture's rim on which somebody has written, and what lies between strokes.

    Ink is clearly whiter than the whitest of the picture's heart, or darker than its darkest, and
    thin. What is as white and broad is a field or a cloud, what is as dark a wood; scratches, as
    white as ink, are none of the heart. Lenses darken the rim: dark ink is sought in grays over
    those about them, which that leaves as they are.
    """
    rim = (depth_mm > 0) & (depth_mm <= HOUSING_MM)
    heart = (depth_mm > HOUSING_MM) & ~scratched
    if heart.mean() < MIN_HEART:
        return np.zeros(gray.shape, dtype=bool)
    inside = (depth_mm > 0).astype(np.float32)
    about = _square(0.5 * ABOUT_MM / cell_mm).shape
    level = cv2.blur(gray * inside, about) / np.maximum(cv2.blur(inside, about), LEAST_PART)
    relative = gray / np.maximum(level, 1.0)
    strokes = _strokes(rim & _beyond(gray, heart), cell_mm)
    strokes |= _strokes(rim & _beyond(-relative, heart), cell_mm)
    between = cv2.morphologyEx(strokes, cv2.MORPH_CLOSE, _square(0.5 * APART_MM / cell_mm))
    count, labels = cv2.connectedComponents(between)
    area_mm2 = np.bincount(labels[strokes > 0], minlength=count) * cell_mm**2
    large = np.flatnonzero(area_mm2 >= LEAST_INK_MM2)
    notes = np.isin(labels, large[large > 0])
    return np.asarray(cv2.dilate(notes.astype(np.uint8), _square(0.5 / cell_mm)) > 0)


def _beyond(tone: np.ndarray, heart: Mask) -> Mask:
    """Cells of a higher tone than any of the heart has."""
    usual, most = np.median(tone[heart]), np.percentile(tone[heart], INK_PERCENTILE)
    return np.asarray(tone > most + INK_BEYOND * (most - usual))


def _strokes(ink: Mask, cell_mm: float) -> np.ndarray:
    """The thin ones of cells that may be ink, as bytes."""
    cells = ink.astype(np.uint8)
    broad = cv2.morphologyEx(cells, cv2.MORPH_OPEN, _square(0.5 * BROAD_MM / cell_mm))
    return cells & (1 - cv2.dilate(broad, _square(BROAD_MM / cell_mm)))


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


def _margin_like(gray: np.ndarray, inside: Mask, depth_mm: np.ndarray, cell_mm: float) -> Mask:
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
    spread = min(robust_sigma(gray[ring] - level), MAX_SPREAD) + LEAST_SPREAD
    near = cv2.blur(np.abs(gray - level), (3, 3)) < 3 * spread
    heart = depth_mm > HOUSING_MM
    if heart.any() and near[heart].mean() > MAX_ALIKE:
        return nobody
    near &= depth_mm < HOUSING_MM
    kernel = _square(CLOSED_MM / cell_mm)
    closed = cv2.morphologyEx((near | outside).astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, kernel)
    _, labels = cv2.connectedComponents(opened)
    touching = np.unique(labels[outside | (depth_mm < 2 * cell_mm)])
    margin = np.isin(labels, touching[touching > 0])
    return np.asarray(cv2.dilate(margin.astype(np.uint8), kernel) > 0)


def find_scratches(
    scan: ScanFile,
    corners: PixelPoints,
    photograph: Mask,
    pixel_mm: float,
) -> tuple[Scratch, ...]:
    """Scratches of one scan, all of one way: that in which more of them was found.

    Args:
        scan: The scan; read by strips.
        corners: Of the picture, pixels, as `FilmArea` has them.
        photograph: True where the scan is photograph, cells that cover it whole.
        pixel_mm: Size of a scan pixel on the film, millimetres.

    Raises:
        ScanError: The scan cannot be read.
    """
    piece = int(np.clip(round(PIECE_MM / pixel_mm), *PIECE_PX))
    step = max(round(ROW_MM / pixel_mm), 1)
    least = int(np.ceil(LEAST_MM / (pixel_mm * piece)))
    if min(scan.size_px) < max(least, step) * piece:
        return ()
    profiles = _profiles(scan, piece, step)
    sides = np.roll(corners, -1, axis=0) - corners
    tilts = (_tilt(sides[[0, 2]]), _tilt(sides[[1, 3], ::-1]))
    limit = float(np.tan(np.radians(TURN_DEG)))
    ways: list[list[Scratch]] = []
    for axis, (profile, tilt) in enumerate(zip(profiles, tilts, strict=True)):
        cells = (photograph if axis == 0 else photograph.T).astype(np.uint8)
        may = cv2.resize(cells, profile.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        curves = _along(profile, may, least)
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


def _along(profile: Profile, may: Mask, least: int) -> Iterator[tuple[np.ndarray, int, int]]:
    """Curves of bright and dark scratches along the rows of a profile."""
    for sign in (1, -1):
        strength = _standing_out(np.float32(sign) * profile)
        for rows, pieces in _chains(strength, may, WHOLE * least):
            curve = _curve(rows, pieces, least, WHOLE)
            if curve is not None:
                yield curve


def _standing_out(profile: Profile) -> Profile:
    """By how much a piece is brighter than both neighbours, in limits; from 1 on it stands out."""
    thin = np.zeros_like(profile)
    middle = profile[BESIDE:-BESIDE]
    thin[BESIDE:-BESIDE] = middle - np.maximum(profile[: -2 * BESIDE], profile[2 * BESIDE :])
    np.maximum(thin, 0, out=thin)
    usual = cv2.blur(thin, ABOUT)
    # design: a floor only where a scan is one even gray.
    return thin / (BEYOND * np.maximum(usual, max(float(np.median(usual[::8])), 1e-3)))


def _chains(strength: Profile, may: Mask, least: float) -> Iterator[tuple[Indices, Indices]]:
    """Rows and pieces of what stands out and hangs together, one row for each piece.

    Chains of fewer pieces than the least are left out.
    """
    peaks = (strength > 1) & may
    peaks[1:] &= strength[1:] >= strength[:-1]
    peaks[:-1] &= strength[:-1] >= strength[1:]
    linked = cv2.dilate(peaks.astype(np.uint8), np.ones((3, 5), np.uint8))
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(linked)
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


def with_drawn(
    usable: UsableArea | None,
    drawn: DrawnMask,
    size_px: tuple[int, int],
    picture: PixelPoints | None = None,
) -> UsableArea:
    """What may be used of a scan: every cell that is touched by what was hidden is left out.

    Args:
        usable: What the program found; None where it did not look: all of the scan.
        drawn: What a hand drew.
        size_px: Columns and rows of the scan.
        picture: Corners of the exposed picture, pixels: nothing beyond it is given back.
    """
    # design: cells of 8 pixels, the largest that the program makes itself.
    known = usable or UsableArea.of(
        np.ones((-(-size_px[1] // 8), -(-size_px[0] // 8)), bool), size_px
    )
    cells, freed = known.mask.copy(), drawn.freed
    if picture is not None:
        freed &= shapely.Polygon(picture).buffer(0)
    cells |= _cells_in(freed, known, whole=True)
    cells &= ~_cells_in(drawn.hidden, known, whole=False)
    return UsableArea.of(cells, size_px, known.scratches)


def _cells_in(area: Area, known: UsableArea, whole: bool) -> Mask:
    """Cells whose middle lies in an area, or that the area touches."""
    if area.is_empty:
        return np.zeros(known.shape, dtype=np.bool_)
    (columns, rows), (down, across) = known.size_px, known.shape
    pixel_from_cell = Affine.scale(columns / across, rows / down)
    outside = geometry_mask([area], known.shape, pixel_from_cell, all_touched=not whole)
    return np.asarray(~outside)
