"""Find the exposed picture in a scan, and the side on which the camera wrote.

The border is searched as four straight steps of grey, at right angles and as far apart as the
camera's frame is wide, from the picture onto the film's rim: all up or all down. The edge of the
film steps the other way, from the rim onto the scanner's bed. A side that cannot be seen (dark
ground against dark film, or cut off by the scanner) is derived from the others and the frame.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float32

from core.arrays import Matrix, PixelPoints, Scalars, locked
from core.errors import ScanError
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation
from core.raster.scan_file import ScanFile, read_overview, read_window
from core.said import say

Side = Literal["left", "right", "top", "bottom"]
SIDES: tuple[Side, Side, Side, Side] = ("left", "right", "top", "bottom")
OPPOSITE = (SIDES[:2], SIDES[2:])
"""Those across, and those down."""
# design: a border is blurred over less than three cells of a third of a millimetre.
STEP_CELLS = 3
"""Cells on either side of a boundary whose means are compared."""
# design: about what steps of chance reach; half of it lets chance sides outbid unseen ones.
UNSEEN = 0.3
"""Score that a side which cannot be seen is given."""
BLANK = 3.0  # design: one in a hundred; even fog and snow differ by more
"""Grays (of 255, noise averaged out) that differ by less show nothing."""
MARGIN = 0.1  # design: film beyond the frame, with the data strip, is about as wide
"""Share of the frame that is looked at about it once its place is roughly known."""
MOST = 0.7  # design: a second look then has less than 1.2 times the resolution of the first
"""Share of the scan from which looking again would show nothing new."""
OVERVIEW_PX = 1200  # design: cells of a fifth of a millimetre for film of 23 cm; memory and time
"""The longer side of the reduced scan in which the border is looked for, pixels."""
STRIPS = 48  # design: strips of 5 mm: a bright field spoils the votes of few
"""Each side is cut into this many strips, each with one vote."""
MOST_TURN_DEG = 2.5  # design: film laid on a scanner by hand lies straighter
"""How far the film may be turned in the scanner, degrees."""
TURNS = 51  # design: steps of 0.1 degrees, 0.4 mm from end to end of a side of 23 cm
"""Rotations that are tried."""
SIZE_TOLERANCE = 0.02  # design: prints and shrunk film differ by up to 0.7 per cent
"""How far the picture may differ from `frame_mm`, as a share of it."""
OFF_MIDDLE_MM = 1.0  # design: cameras centre their marks to tenths of a millimetre
"""How far the middle of the picture may be from the middle of its marks, millimetres."""
LEAST_SCORE = (
    0.45  # design: half way between chance (UNSEEN) and a border seen in six of ten strips
)
"""Mean vote of the strips (0 to 1) from which a side counts as seen."""
REACH = 0.15  # design: a frame that is cut off by more cannot be used
"""Share of the frame that one of its sides may lie outside the scan."""
RIMS = (1, -1)  # source: a rim of unexposed film is clear, or black in prints
"""Brighter than the picture on all sides, or darker on all."""
PREFERRED = 0.02  # design: less than one of 48 votes: it decides between equals only
"""What nominal size and the middle of the scan count at most, in votes."""
# design: clocks, levels and counters lie so far beyond the frame; nearer are soft edges and
# notches, and the ends of a side belong to housings of corner marks and to notes.
STRIP_MM, CORNER_MM = (1.5, 22.0), 18.0
"""From where to where beyond the border writing is looked for, and ends that are left out."""
STRIP_CELL_MM = 0.25  # design: strokes of writing are about as wide
"""Size of a cell in which writing is told from film, millimetres."""
WRITING = 25.0  # design: a tenth of the range; grain of cells this large is far less
"""Difference from the film's own gray, of 255, that counts as writing."""
LEAST_WRITING_MM2 = 60.0  # design: one dial of 9 mm; a handwritten number covers less
"""Area of writing below which there is no strip."""
AHEAD = 2.0  # design: notes on another side cover less than half of a strip
"""How many times more the strip must hold than any other side."""
STRIP_SIDES: tuple[Side, ...] = ("left", "top", "right", "bottom")


@dataclass(frozen=True, slots=True, eq=False)
class FilmArea:
    """The exposed picture in one scan."""

    corners: PixelPoints
    """Four corners as they lie in the scan, in the order of `camera.frame_corners_mm` (lower
    left, lower right, upper right, upper left of the upright scan); may lie outside it."""
    seen: tuple[Side, ...]
    """Sides whose border was seen; the others follow from the camera's frame."""
    scores: Scalars
    """Mean vote of left, right, top, bottom, 0 to 1."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", locked(self.corners))
        object.__setattr__(self, "scores", locked(self.scores))

    @property
    def trusted(self) -> bool:
        """True when position and rotation of the frame were seen in both directions."""
        return _trusted(self.seen)

    @property
    def turn(self) -> float:
        """Rotation of the lower border in the scan, radians, counter-clockwise."""
        bottom = self.corners[1] - self.corners[0]
        return float(np.arctan2(-bottom[1], bottom[0]))

    @property
    def centre(self) -> PixelPoints:
        """Middle of the picture, (1, 2) pixels."""
        return self.corners.mean(axis=0, keepdims=True)


def _trusted(seen: tuple[Side, ...]) -> bool:
    return len(seen) >= 3


def detect_film_area(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
) -> FilmArea:
    """Find the border of the exposed picture.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
    """
    frame_mm = _frame_as_it_lies(scan, camera)
    columns, rows = scan.size_px
    area = _area_in(scan, (0, 0, columns, rows), frame_mm / scan_pixel_mm)
    low = area.corners.min(axis=0) - MARGIN * frame_mm / scan_pixel_mm
    high = area.corners.max(axis=0) + MARGIN * frame_mm / scan_pixel_mm
    left, top = np.maximum(low, 0).astype(int).tolist()
    right, bottom = np.minimum(high, scan.size_px).astype(int).tolist()
    if (right - left) * (bottom - top) > MOST * columns * rows:
        return area
    # A page with the photo in one corner: looked at again without the rest of the page.
    window = (left, top, right - left, bottom - top)
    return _area_in(scan, window, frame_mm / scan_pixel_mm)


def refine_film_area(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
    area: FilmArea,
    middle: tuple[float, float],
) -> FilmArea:
    """The border once the middle of the fiducials is known, which is that of the picture.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The border as it was found without the marks.
        middle: Column and row of the middle of the marks.
    """
    away_mm = np.abs(area.centre[0] - np.array(middle)) * scan_pixel_mm
    if float(away_mm.max()) < OFF_MIDDLE_MM:
        return area
    frame = _frame_as_it_lies(scan, camera) / scan_pixel_mm
    low = np.maximum(np.array(middle) - (0.5 + MARGIN) * frame, 0).astype(int)
    high = np.minimum(np.array(middle) + (0.5 + MARGIN) * frame, scan.size_px).astype(int)
    (left, top), (width, height) = low.tolist(), (high - low).tolist()
    reach = OFF_MIDDLE_MM / scan_pixel_mm
    return _area_in(scan, (left, top, width, height), frame, (middle, reach))


def _area_in(
    scan: ScanFile,
    window: tuple[int, int, int, int],
    frame_px: np.ndarray,
    known: tuple[tuple[float, float], float] | None = None,
) -> FilmArea:
    """The border of the picture in a window (column, row, columns, rows) of the scan.

    `known` is its middle and how far it may be from there, pixels.
    """
    reduction = max(1, -(-max(window[2:]) // OVERVIEW_PX))
    gray = eight_bit(read_window(scan, *window, reduction))
    frame = frame_px / reduction
    near: list[tuple[float, float] | None] = [None, None]
    if known is not None:
        (column, row), reach = known
        near = [
            ((column - window[0]) / reduction, reach / reduction),
            ((row - window[1]) / reduction, reach / reduction),
        ]
    across, down = _votes(gray), _votes(gray.T)
    best: dict[int, _Rectangle] = {}
    for turn in np.tan(np.radians(np.linspace(-MOST_TURN_DEG, MOST_TURN_DEG, TURNS))):
        steps = _along(across, turn, gray.shape[0]), _along(down, -turn, gray.shape[1])
        for rim in RIMS:
            columns = _best_pair(rim * steps[0], float(frame[0]), near[0])
            rows = _best_pair(rim * steps[1], float(frame[1]), near[1])
            found = _Rectangle(columns, rows, float(turn))
            if rim not in best or found.total > best[rim].total:
                best[rim] = found
    likely = _likely(*best.values())
    corners = _corners(likely, gray.shape) * reduction + np.array(window[:2])
    return FilmArea(corners, likely.seen, likely.scores)


def check_not_blank(scan: ScanFile, area: FilmArea) -> None:
    """Refuse a scan that shows nothing: unexposed film, an empty bed, a closed lid.

    Raises:
        ScanError: The heart of the picture is even, but for noise.
    """
    # design: cells of 0.4 mm, whose means over 9 x 9 leave nothing of the grain.
    overview_px, calm_cells = 600, 9
    reduction = max(1, -(-max(scan.size_px) // overview_px))
    low, high = area.corners.min(axis=0), area.corners.max(axis=0)
    left, top = np.maximum(low + MARGIN * (high - low), 0).astype(int).tolist()
    right, bottom = np.minimum(high - MARGIN * (high - low), scan.size_px).astype(int).tolist()
    gray = read_window(scan, left, top, right - left, bottom - top, reduction)
    # design: the brightest pixels may be dust; 16 bit scans hold at least 10 bits of film.
    top_gray = 255.0 if scan.dtype == "uint8" else max(float(np.nanpercentile(gray, 99.9)), 1024.0)
    calm = cv2.blur(np.nan_to_num(gray), (calm_cells, calm_cells))[4:-4, 4:-4] * (255.0 / top_gray)
    # design: a hair or a spot on a blank film covers less than one per cent.
    spread = float(np.ptp(np.percentile(calm, [1, 99]))) if calm.size else 0.0
    if spread < BLANK:
        raise ScanError(
            scan.path,
            say(
                "The scan is blank: grays of the picture differ by {spread:.1f} of 255.",
                spread=spread,
            ),
            "Scan the photo again, or take the file out of [scans] files.",
        )


def area_from_interior(interior: InteriorOrientation, camera: Camera) -> FilmArea:
    """The camera's frame through the interior orientation: where the border cannot be seen."""
    corners = interior.pixel_from_film(camera.frame_corners_mm)
    return FilmArea(corners, (), np.zeros(4))


def _frame_as_it_lies(scan: ScanFile, camera: Camera) -> np.ndarray:
    """Width and height of the frame in the scan, millimetres; an oblong frame may lie across."""
    width, height = camera.frame_mm
    lies_across = (scan.size_px[0] - scan.size_px[1]) * (width - height) < 0
    return np.array((height, width) if lies_across else (width, height))


def _votes(gray: np.ndarray) -> Matrix:
    """(STRIPS, columns + 1) steps of gray across each column boundary, squashed to -1 .. 1.

    Squashing gives every strip one vote, so that one bright field does not pass for a border.
    """
    height = gray.shape[0] // STRIPS
    means = gray[: height * STRIPS].reshape(STRIPS, height, -1).mean(axis=1, dtype=np.float64)
    sums = np.cumsum(np.pad(means, ((0, 0), (1, 0))), axis=1)
    step = np.zeros_like(sums)
    half = STEP_CELLS
    step[:, half:-half] = (
        sums[:, 2 * half :] - 2 * sums[:, half:-half] + sums[:, : -2 * half]
    ) / half
    noise = np.median(np.abs(step)) + 1.0
    return step / (np.abs(step) + noise)


def _along(votes: Matrix, slope: float, length: int) -> Scalars:
    """Mean vote along lines of a slope, by their column in the middle row; positive upwards."""
    strips, columns = votes.shape
    offsets = slope * ((np.arange(strips) + 0.5) / strips - 0.5) * length
    place = np.arange(columns)
    shifted = [
        np.interp(place + offset, place, vote, left=0.0, right=0.0)
        for offset, vote in zip(offsets, votes, strict=True)
    ]
    return np.mean(shifted, axis=0)


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two opposite sides in one direction: places in cells, and their mean votes."""

    first: float
    second: float
    scores: tuple[float, float]
    total: float


@dataclass(frozen=True, slots=True)
class _Rectangle:
    """Four sides that step alike, out of it, and its turn."""

    columns: _Pair
    rows: _Pair
    slope: float

    @property
    def total(self) -> float:
        return self.columns.total + self.rows.total

    @property
    def scores(self) -> Scalars:
        return np.array([*self.columns.scores, *self.rows.scores])

    @property
    def seen(self) -> tuple[Side, ...]:
        """Sides whose border is seen."""
        scored = zip(SIDES, self.scores, strict=True)
        return tuple(side for side, score in scored if score >= LEAST_SCORE)

    @property
    def area(self) -> float:
        """Square cells."""
        columns, rows = self.columns, self.rows
        return (columns.second - columns.first) * (rows.second - rows.first)

    def inside(self, other: "_Rectangle") -> bool:
        """Whether no side of it lies beyond that of another, but for what sizes differ by."""
        pairs = (self.columns, other.columns), (self.rows, other.rows)
        return all(
            outer.first - _slack(inner) <= inner.first
            and inner.second <= outer.second + _slack(inner)
            for inner, outer in pairs
        )


def _slack(pair: _Pair) -> float:
    """Cells by which a picture of this width may differ from its frame."""
    return round((pair.second - pair.first) * SIZE_TOLERANCE) + 1.0


def _likely(one: _Rectangle, other: _Rectangle) -> _Rectangle:
    """The picture, of a rectangle that steps up and one that steps down.

    Where both are there and one lies inside the other, the outer one is the edge of the film, which
    often stands out more. Sides of two that cross are those of chance, such as scratches.
    """
    best, second = sorted((one, other), key=lambda found: (_trusted(found.seen), found.total))[::-1]
    if _trusted(second.seen) and second.inside(best):
        return min(best, second, key=lambda found: found.area)
    return best


def _best_pair(
    steps: Scalars,
    size: float,
    near: tuple[float, float] | None = None,
) -> _Pair:
    """The two boundaries with the best votes that are as far apart as the frame is wide.

    `steps` go down over the first and up over the second: out of the picture, onto a brighter rim.

    A side that is not seen counts as UNSEEN wherever it is, also outside the scan; the two small
    penalties decide between equals: nominal size, then the middle of the scan.
    """
    slack = round(size * SIZE_TOLERANCE) + 1
    reach = round(REACH * size) + slack
    firsts, seconds = np.full((2, len(steps) + 2 * reach), UNSEEN)
    firsts[reach : reach + len(steps)] = np.maximum(-steps, UNSEEN)
    seconds[reach : reach + len(steps)] = np.maximum(steps, UNSEEN)
    best: tuple[float, int, int] | None = None
    for width in range(round(size) - slack, round(size) + slack + 1):
        if width >= len(firsts):
            continue
        total = firsts[:-width] + seconds[width:]
        middle = np.arange(len(total)) + width / 2 - reach
        total -= PREFERRED * np.abs(width - size) / slack
        total -= PREFERRED * np.abs(middle - len(steps) / 2) / len(steps)
        if near is not None:
            total[np.abs(middle - near[0]) > near[1] + 0.5] = -np.inf
        first = int(np.argmax(total))
        if best is None or total[first] > best[0]:
            best = (float(total[first]), first - reach, width)
    if best is None:
        best = (0.0, round((len(steps) - size) / 2), round(size))
    total, first, width = best
    ends = (first, first + width)
    scores = [
        max(float(sign * steps[end]), 0.0) if 0 <= end < len(steps) else 0.0
        for sign, end in zip((-1, 1), ends, strict=True)
    ]
    return _Pair(float(ends[0]), float(ends[1]), (scores[0], scores[1]), total)


def _corners(found: _Rectangle, shape: tuple[int, ...]) -> PixelPoints:
    """Lower left, lower right, upper right, upper left corner from the four border lines."""
    columns, rows, slope = found.columns, found.rows, found.slope
    middle_row, middle_column = shape[0] / 2, shape[1] / 2
    lines = np.array([[1.0, -slope], [slope, 1.0]])
    ends = (
        (columns.first, rows.second),
        (columns.second, rows.second),
        (columns.second, rows.first),
        (columns.first, rows.first),
    )
    right = [[c - slope * middle_row, r + slope * middle_column] for c, r in ends]
    return np.linalg.solve(lines, np.array(right).T).T


def eight_bit(gray: np.ndarray) -> np.ndarray:
    """Gray values stretched so that the bright end is 255, whatever the depth of the scan."""
    # design: dust and scratches cover less than one in two hundred pixels.
    return gray * np.float32(255.0 / max(float(np.percentile(gray, 99.5)), 1.0))


def find_data_strip(scan: ScanFile, pixel_mm: float, area: FilmArea) -> Side | None:
    """The side of the picture, as it lies in the scan, with the data strip; None if no side leads.

    Args:
        scan: The scan.
        pixel_mm: Size of a scan pixel on the film, millimetres.
        area: The exposed picture.
    """
    reduction = max(1, round(STRIP_CELL_MM / pixel_mm))
    low, high = area.corners.min(axis=0), area.corners.max(axis=0)
    gap, reach, ends = (mm / pixel_mm for mm in (*STRIP_MM, CORNER_MM))
    boxes = {
        "left": (low[0] - reach, low[1] + ends, low[0] - gap, high[1] - ends),
        "right": (high[0] + gap, low[1] + ends, high[0] + reach, high[1] - ends),
        "top": (low[0] + ends, low[1] - reach, high[0] - ends, low[1] - gap),
        "bottom": (low[0] + ends, high[1] + gap, high[0] - ends, high[1] + reach),
    }
    least = WRITING * _white(scan) / 255.0
    written = {
        side: _written_mm2(scan, boxes[side], reduction, pixel_mm, least) for side in STRIP_SIDES
    }
    order = sorted(STRIP_SIDES, key=lambda side: written[side], reverse=True)
    first, second = written[order[0]], written[order[1]]
    if first < LEAST_WRITING_MM2 or first < AHEAD * second:
        return None
    return order[0]


def _white(scan: ScanFile) -> float:
    """Largest gray value of the depth that a scan has; many of 16 bit hold only 10 or 12."""
    if scan.dtype == "uint8":
        return 255.0
    reduction = max(1, -(-max(scan.size_px) // OVERVIEW_PX))
    brightest = max(float(read_overview(scan, reduction).max()), 255.0)
    return 2.0 ** np.ceil(np.log2(brightest + 1)) - 1


def _written_mm2(
    scan: ScanFile,
    box: tuple[float, float, float, float],
    reduction: int,
    pixel_mm: float,
    least: float,
) -> float:
    """Area of what differs by `least` from the film in the part of a box that lies in the scan."""
    columns, rows = scan.size_px
    left, top = max(round(box[0]), 0), max(round(box[1]), 0)
    right, bottom = min(round(box[2]), columns), min(round(box[3]), rows)
    if min(right - left, bottom - top) < 8 * reduction:  # design: less holds no figure
        return 0.0
    gray = read_window(scan, left, top, right - left, bottom - top, reduction)
    if right - left < bottom - top:
        gray = gray.T
    cell_mm = pixel_mm * reduction
    return float(_differs(gray, least).sum()) * cell_mm**2


def _differs(gray: Float32[np.ndarray, "across along"], least: float) -> np.ndarray:
    """Cells unlike the film in their row; rows run along the border of the picture.

    A row of scanner bed or of paper is even and holds nothing; the film's own gray is the row's
    median, so that a dark film on a white bed is no writing.
    """
    level = np.median(gray, axis=1, keepdims=True)
    step = np.abs(gray - level) > least
    busy = step.mean(axis=1, keepdims=True) < 0.5
    cleaned = cv2.morphologyEx((step & busy).astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2)))
    return np.asarray(cleaned)
