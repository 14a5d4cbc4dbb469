"""Places that look like a mark: correlation peaks of drawn marks in windows of a reduced scan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Complex128, Float32, Float64

from core.arrays import PixelPoints
from core.raster.scan_file import ScanFile, read_window
from core.scans.centring import border_axis, without_border
from core.scans.marks import Mark, draw_mark

Field = Float32[np.ndarray, "rows columns"]
Template = Float32[np.ndarray, "side side"]
Correlations = Float32[np.ndarray, "places_down places_across"]
Spectrum = Float32[np.ndarray, "lines cells"]
Peak = tuple[complex, float, float]
"""Column - i row in the scan, correlation, significance."""
MERGE_MM = 2.0  # design: windows are seven times as wide; memory and time
"""Expected places closer than this share one window."""
FLAT = 1.5  # design: twice the steps of 8 bit
"""Local standard deviation (of 255) below which a correlation says nothing."""
LEAST_PEAK = 0.2  # design: texture reaches more
"""Correlation below which a maximum is no candidate."""
APART_CELLS = 5  # design: as wide as the peak of a thin line
"""Side of the square in which a candidate is the highest."""
EVEN_MM = 2.0  # design: the housing of a mark; wider, the light of the picture beside it remains
"""Side of the surroundings whose mean and spread are taken away from a window."""
KEPT_DRAWN = 1024  # design: the library at a few scales, a few megabytes
"""Drawn marks that are kept."""
LEAST_SPREAD = 0.02  # design: an even window would make any peak significant
"""Spread of correlations that is always reckoned with."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchWindow:
    """A reduced part of the scan in which marks are expected."""

    corner: tuple[int, int]
    """First column and row, scan pixels."""
    reduction: int
    """Scan pixels a side that became one cell."""
    outward: tuple[float, float]
    """Direction from the middle of the picture (right, down)."""
    gray: Field
    """Gray values, bright end 255, without NaN."""

    @property
    def middle(self) -> tuple[float, float]:
        """Middle column and row, scan pixels."""
        half = self.reduction / 2
        return (
            self.corner[0] + self.gray.shape[1] * half,
            self.corner[1] + self.gray.shape[0] * half,
        )

    def at(self, column: int, row: int) -> tuple[float, float]:
        """Middle of a cell, scan pixels."""
        return self.place(column + 0.5, row + 0.5)

    def place(self, column: float, row: float) -> tuple[float, float]:
        """A place counted in cells, scan pixels."""
        return self.corner[0] + column * self.reduction, self.corner[1] + row * self.reduction


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Peaks of one kind and polarity, a row per window; NaN where there are fewer."""

    mark: Mark
    """The kind of mark."""
    bright: bool
    """True when it is brighter than its surroundings."""
    places: Complex128[np.ndarray, "windows peaks"]
    """Column - i row in the scan: complex numbers turn and scale by one product."""
    correlations: Float64[np.ndarray, "windows peaks"]
    """Correlation with the drawn mark."""
    significances: Float64[np.ndarray, "windows peaks"]
    """How far above the window's mean, in its standard deviations."""

    @property
    def worth(self) -> Float64[np.ndarray, "windows peaks"]:
        """What each peak counts in the choice of a set."""
        return self.correlations * self.significances

    @property
    def promise(self) -> float:
        """Sum of the best peaks of all windows: an upper bound for any set."""
        return float(self.worth.max(axis=1).sum())


def open_windows(
    scan: ScanFile,
    expected: Mapping[int, PixelPoints],
    middle: tuple[float, float],
    reaches_px: Float64[np.ndarray, "marks 2"],
    merge_px: float,
    reduction: int,
) -> tuple[list[SearchWindow], dict[int, list[int]]]:
    """Windows about all expected places, those close together shared.

    Args:
        scan: The scan.
        expected: Expected places of all marks, by the way the film may lie.
        middle: Middle of the picture, pixels.
        reaches_px: Half width and half height of the window of each mark, scan pixels.
        merge_px: Places closer than this share a window.
        reduction: Scan pixels a side that become one cell.

    Returns:
        The windows, and by the way the film may lie the window of each mark.
    """
    centres: list[np.ndarray] = []
    reaches: list[list[int]] = []
    owners: dict[int, list[int]] = {}
    whole = np.rint(reaches_px).astype(int).tolist()
    for way, places in expected.items():
        owners[way] = []
        for place, reach in zip(places, whole, strict=True):
            near = [float(np.linalg.norm(place - other)) for other in centres]
            if not near or min(near) > merge_px:
                centres.append(place)
                reaches.append(reach)
                near.append(0.0)
            owners[way].append(int(np.argmin(near)))
    windows: list[SearchWindow] = []
    for (column, row), (across, down) in zip(np.array(centres).tolist(), reaches, strict=True):
        corner = (round(column) - across, round(row) - down)
        gray = read_window(scan, *corner, 2 * across, 2 * down, reduction)
        outward = (column - middle[0], row - middle[1])
        windows.append(SearchWindow(corner, reduction, outward, fill_window(gray)))
    return windows, owners


def all_candidates(
    windows: Sequence[SearchWindow],
    cell_mm: float,
    count: int,
    marks: tuple[Mark, ...],
    turn: float,
) -> list[Candidates]:
    """The best `count` peaks of every kind, size and polarity in every window.

    Args:
        windows: Where marks are expected.
        cell_mm: Size of their cells on the film, millimetres.
        count: How many peaks of each are kept.
        marks: Kinds and sizes.
        turn: Rotation of the film in the scan, radians, counter-clockwise.
    """
    result: list[Candidates] = []
    plain = [Sought(window.gray) for window in windows]
    for mark in marks:
        drawn = _drawn(mark, round(cell_mm, 6))
        found: dict[bool, list[list[Peak]]] = {True: [], False: []}
        upright = Wanted(drawn)
        for window, whole in zip(windows, plain, strict=True):
            templates = [upright]
            if mark.turns:
                pointing = replace(mark, outward=eighth(window.outward, turn))
                lies = [draw_mark(one, cell_mm, -turn) for one in pointing.variants]
                templates = [Wanted(one.astype(np.float32)) for one in lies]
            sought, side = whole, drawn.shape[0]
            if mark.picture is not None:
                along = border_axis(window.outward)
                sought = Sought(without_border(window.gray, side, along))
                templates = [Wanted(without_border(one.gray, side, along)) for one in templates]
            field = np.maximum.reduce([sought.correlated(template) for template in templates])
            bright, dark = _peaks(field, window, side // 2, count, mark.picture is None)
            found[True].append(bright)
            found[False].append(dark)
        result += [
            _stacked(mark, bright, peaks, count)
            for bright, peaks in found.items()
            if bright or mark.picture is None
        ]
    return result


def candidates_at(
    place: tuple[float, float], found: Candidates, windows: Sequence[SearchWindow]
) -> Candidates:
    """The candidates where one mark is known to be: nothing else is one in its window."""
    column, row = place
    apart = [abs(w.middle[0] - column) + abs(w.middle[1] - row) for w in windows]
    own = int(np.argmin(apart))
    places, correlations = found.places.copy(), found.correlations.copy()
    places[own] = complex(np.nan, np.nan)
    places[own, 0] = complex(column, -row)
    correlations[own], significances = 0.0, found.significances.copy()
    correlations[own, 0] = float(found.correlations[own].max())
    significances[own, 0] = float(found.significances[own].max())
    return replace(found, places=places, correlations=correlations, significances=significances)


@lru_cache(maxsize=KEPT_DRAWN)
def _drawn(mark: Mark, cell_mm: float) -> Template:
    """A mark drawn at one scale; the searches of a scan and the scans of a block share it."""
    return draw_mark(mark, cell_mm).astype(np.float32)


def eighth(outward: tuple[float, float], turn: float) -> tuple[float, float]:
    """The nearest of the film's eight main directions to one in the scan (right, down).

    Args:
        outward: Direction in the scan.
        turn: Rotation of the film in the scan, radians, counter-clockwise; with any quarter turns.
    """
    angle = np.arctan2(outward[1], outward[0]) + turn
    snapped = np.rint(angle / (np.pi / 4)) * (np.pi / 4)
    return float(np.cos(snapped)), float(np.sin(snapped))


def fill_window(gray: Field) -> Field:
    """No NaN, and the bright end at 255."""
    inside = np.isfinite(gray)
    if not inside.any():
        return np.zeros_like(gray)
    # design: dust and scratches cover less than one in two hundred cells
    top = max(float(np.percentile(gray[inside], 99.5)), 1.0)
    filled = np.where(inside, gray, np.float32(np.median(gray[inside])))
    return filled * np.float32(255.0 / top)


def evened(window: SearchWindow, cell_mm: float) -> SearchWindow:
    """A window in which dim places have as much contrast as bright ones (Wallis 1976).

    Marks a few grays lighter than their dark housing lie beside picture a hundred grays brighter,
    whose fall of light is all that a template sees.
    """
    side = 2 * int(EVEN_MM / cell_mm / 2) + 1
    above = without_border(window.gray, side, None)
    square = cv2.blur(above * above, (side, side), borderType=cv2.BORDER_REFLECT)
    spread = np.sqrt(np.maximum(square, 0.0)) + np.float32(FLAT)
    # A usual spread keeps grays grays: what is flat stays flat.
    return replace(window, gray=above * (np.float32(np.median(spread)) / spread))


def _spectrum_of(field: Field, size: tuple[int, int]) -> Spectrum:
    """Of a field continued by nought: what wraps around lies where no template fits."""
    padded = np.zeros(size, dtype=np.float32)
    padded[: field.shape[0], : field.shape[1]] = field
    # Told which rows are nought, OpenCV 4 takes half as long again.
    return np.asarray(cv2.dft(padded), dtype=np.float32)


class Wanted:
    """A template ready for many windows: its spectrum is taken once for those of one size."""

    def __init__(self, gray: Template) -> None:
        self.gray: Template = gray
        self._even: Template = gray - np.float32(gray.mean())
        self.power: float = float(np.linalg.norm(self._even))
        self._spectra: dict[tuple[int, int], Spectrum] = {}

    def spectrum(self, size: tuple[int, int]) -> Spectrum:
        """Its spectrum in a window of a size."""
        if size not in self._spectra:
            self._spectra[size] = _spectrum_of(self._even, size)
        return self._spectra[size]


class Sought:
    """A window ready for many templates: its spectrum is taken once, its spread once a size."""

    def __init__(self, gray: Field) -> None:
        self.gray: Field = gray - np.float32(gray.mean())
        self.size: tuple[int, int] = (
            cv2.getOptimalDFTSize(gray.shape[0]),
            cv2.getOptimalDFTSize(gray.shape[1]),
        )
        self.spectrum: Spectrum = _spectrum_of(self.gray, self.size)
        self._spreads: dict[int, Correlations] = {}

    def correlated(self, wanted: Wanted) -> Correlations:
        """Normalised correlation wherever a template lies inside; nought on flat ground."""
        side = wanted.gray.shape[0]
        if min(self.gray.shape) <= side:
            return np.zeros((1, 1), dtype=np.float32)
        if wanted.power == 0:
            return np.zeros_like(self._spread(side))
        both = cv2.mulSpectrums(self.spectrum, wanted.spectrum(self.size), 0, conjB=True)
        spread = self._spread(side)
        rows, columns = spread.shape
        products = cv2.idft(both, flags=cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT)
        return products[:rows, :columns] / (np.float32(wanted.power) * spread)

    def _spread(self, side: int) -> Correlations:
        """Root of the sum of squares about the mean under each template; infinite where flat."""
        if side not in self._spreads:
            half = side // 2
            mean = cv2.boxFilter(self.gray, cv2.CV_64F, (side, side))
            square = cv2.sqrBoxFilter(self.gray, cv2.CV_64F, (side, side))
            rows, columns = (size - side + 1 for size in self.gray.shape)
            variance = (square - mean * mean)[half : half + rows, half : half + columns]
            root = np.sqrt(np.maximum(variance, 0.0)) * side
            self._spreads[side] = np.where(variance < FLAT**2, np.inf, root).astype(np.float32)
        return self._spreads[side]


def _peaks(
    field: Correlations, window: SearchWindow, half: int, count: int, both: bool
) -> tuple[list[Peak], list[Peak]]:
    """The highest separate maxima; where both are wanted, the lowest minima as of its negative."""
    middle, spread = (float(value[0, 0]) for value in cv2.meanStdDev(field))
    around = np.ones((APART_CELLS, APART_CELLS), dtype=np.uint8)
    found: tuple[list[Peak], list[Peak]] = ([], [])
    for sign, peaks in zip((1.0, -1.0)[: 1 + both], found, strict=False):
        limit = cv2.dilate(field, around) if sign > 0 else cv2.erode(field, around)
        high = field > LEAST_PEAK if sign > 0 else field < -LEAST_PEAK
        at = np.flatnonzero(high & (field == limit))
        order = np.argsort(-sign * field.ravel()[at], kind="stable")[:count]
        for row, column in (divmod(int(one), field.shape[1]) for one in at[order]):
            value = sign * float(field[row, column])
            down = row + _vertex(sign * field[:, column], row) + half + 0.5
            right = column + _vertex(sign * field[row], column) + half + 0.5
            place = complex(
                window.corner[0] + right * window.reduction,
                -window.corner[1] - down * window.reduction,
            )
            above = (value - sign * middle) / (spread + LEAST_SPREAD)
            peaks.append((place, value, above))
    return found


def _vertex(profile: Float32[np.ndarray, "n"], index: int) -> float:
    """Offset of the parabola's vertex through a maximum and its two neighbours."""
    if not 0 < index < len(profile) - 1:
        return 0.0
    before, here, after = (float(profile[index + k]) for k in (-1, 0, 1))
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def _stacked(mark: Mark, bright: bool, found: Sequence[Sequence[Peak]], count: int) -> Candidates:
    """Peaks as arrays of equal length."""
    places = np.full((len(found), count), complex(np.nan, np.nan))
    values = np.zeros((2, len(found), count))
    for i, peaks in enumerate(found):
        for k, (place, correlation, significance) in enumerate(peaks):
            places[i, k] = place
            values[:, i, k] = correlation, significance
    return Candidates(mark, bright, places, values[0], values[1])
