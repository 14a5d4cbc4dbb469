"""Which places in a scan are the camera's fiducials: candidates for each, and the set that fits.

Every kind of mark in the library is correlated with windows about the expected places; of all
peaks the set is taken that lies as the certificate says, turned by about none to three quarter
circles and scaled by the scan pixel size. One peak alone proves nothing, four in the right shape
do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from jaxtyping import Complex128, Float32, Float64

from core.arrays import FilmPoints, PixelPoints, Scalars, locked
from core.doubts import Failure
from core.geometry.camera import Camera
from core.scan.film_area import FilmArea
from core.scan.marks import Mark, draw_mark, library
from core.scan.raster import ScanFile, read_window

FilmComplex = Complex128[np.ndarray, "n"]
PeakComplex = Complex128[np.ndarray, "n peaks"]
PeakValues = Float64[np.ndarray, "n peaks"]
MERGE_MM = 2.0
"""Expected places closer than this share one window."""
FLAT = 1.5
"""Local standard deviation (of 255) below which a correlation says nothing."""


@dataclass(frozen=True, slots=True)
class ConstellationOptions:
    """How the marks are looked for before they are measured."""

    search_pixel_mm: float = 0.075
    """Size of a pixel of the reduced windows, millimetres."""
    reach_seen_mm: float = 7.0
    """Half width of a window where the picture's border was seen, millimetres."""
    reach_unseen_mm: float = 16.0
    """The same where it was not."""
    peaks: int = 4
    """Candidates kept for each window, kind and polarity."""
    kinds: int = 24
    """Kinds and polarities, best first, for which sets are formed."""
    scale_tolerance: float = 0.015
    """How far the scale may differ from the nominal scan pixel size, as a share."""
    turn_tolerance_deg: float = 4.0
    """How far the film may be turned from a quarter circle, degrees."""
    fit_tolerance_mm: float = 0.35
    """How far a mark may lie from where two others put it, millimetres: scanners shear, film
    shrinks."""
    min_correlation: float = 0.5
    """Mean correlation of the found marks with the drawn kind below which nothing was found."""
    upright_bonus: float = 0.05
    """Advantage of an upright scan over a turned one that fits as well, as a share of the score:
    the certificate of symmetric marks cannot tell them apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Constellation:
    """The set of places that lies as the certificate says."""

    names: tuple[str, ...]
    """Fiducials that were found."""
    pixels: PixelPoints
    """Where, to about a tenth of a millimetre, scan pixels."""
    correlations: Scalars
    """Correlation of each with the drawn mark."""
    predicted: Mapping[str, tuple[float, float]]
    """Where every fiducial should be, found or not, scan pixels."""
    mark: Mark
    """Kind and size that fits best."""
    bright: bool
    """True when the mark is brighter than its surroundings."""
    turn: float
    """Rotation of the film's x axis against the scan's columns, radians, counter-clockwise."""
    score: float
    """Sum of the marks' significances times their correlations."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", locked(self.pixels))
        object.__setattr__(self, "correlations", locked(self.correlations))


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """A reduced part of the scan in which marks are expected."""

    corner: tuple[int, int]
    reduction: int
    outward: tuple[float, float]
    gray: Float32[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True, eq=False)
class _Peaks:
    """Candidates of one kind and polarity, a row per window; NaN where there are fewer."""

    mark: Mark
    bright: bool
    places: Complex128[np.ndarray, "windows peaks"]
    """Column - i row in the scan: complex numbers turn and scale by one product."""
    correlations: Float64[np.ndarray, "windows peaks"]
    significances: Float64[np.ndarray, "windows peaks"]


def find_constellation(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
    area: FilmArea,
    options: ConstellationOptions | None = None,
) -> Constellation | Failure:
    """Find the camera's fiducials in a scan to about a tenth of a millimetre.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        options: How they are looked for.
    """
    options = options or ConstellationOptions()
    names = tuple(camera.fiducials_mm)
    film = np.array([camera.fiducials_mm[name] for name in names], dtype=np.float64)
    expected = {q: _expected(film, area, scan_pixel_mm, q) for q in _quarters(camera, area)}
    windows, owners = _windows(scan, expected, scan_pixel_mm, area, options)
    kinds = [
        peaks
        for mark in library()
        for peaks in _peaks_of_kind(windows, mark, scan_pixel_mm, options)
    ]
    kinds.sort(key=_promise, reverse=True)
    best: Constellation | None = None
    for peaks in kinds[: options.kinds]:
        for quarter, owner in owners.items():
            found = _best_set(names, film, peaks, owner, quarter, scan_pixel_mm, options)
            if found is not None and (best is None or found.score > best.score):
                best = found
    if best is None or float(best.correlations.mean()) < options.min_correlation:
        return Failure("No set of marks lies as the certificate says.", {"fiducials": len(names)})
    return best


def _quarters(camera: Camera, area: FilmArea) -> tuple[int, ...]:
    """Quarter turns the frame's shape allows: all four when it is square."""
    width, height = camera.frame_mm
    if abs(width - height) < 0.02 * width:
        return (0, 1, 2, 3)
    spans = np.ptp(area.corners, axis=0)
    return (0, 2) if (spans[0] - spans[1]) * (width - height) > 0 else (1, 3)


def _expected(film: FilmPoints, area: FilmArea, scan_pixel_mm: float, quarter: int) -> PixelPoints:
    """Where the marks should be for one way the film may lie, scan pixels."""
    bottom = area.corners[1] - area.corners[0]
    turn = np.arctan2(-bottom[1], bottom[0]) + quarter * np.pi / 2
    cosine, sine = np.cos(turn), np.sin(turn)
    turned = film @ np.array([[cosine, -sine], [sine, cosine]]).T
    return area.centre + turned * np.array([1.0, -1.0]) / scan_pixel_mm


def _windows(
    scan: ScanFile,
    expected: Mapping[int, PixelPoints],
    scan_pixel_mm: float,
    area: FilmArea,
    options: ConstellationOptions,
) -> tuple[list[_Window], dict[int, list[int]]]:
    """The windows to search, and for each quarter turn which window each mark belongs to."""
    reduction = max(1, round(options.search_pixel_mm / scan_pixel_mm))
    reach_mm = options.reach_seen_mm if area.trusted else options.reach_unseen_mm
    reach = round(reach_mm / scan_pixel_mm)
    middle = area.centre[0]
    centres: list[np.ndarray] = []
    owners: dict[int, list[int]] = {}
    for quarter, places in expected.items():
        owners[quarter] = []
        for place in places:
            near = [float(np.linalg.norm(place - other)) for other in centres]
            if not near or min(near) > MERGE_MM / scan_pixel_mm:
                centres.append(place)
                near.append(0.0)
            owners[quarter].append(int(np.argmin(near)))
    windows: list[_Window] = []
    for centre in centres:
        corner = (round(float(centre[0])) - reach, round(float(centre[1])) - reach)
        gray = read_window(scan, *corner, 2 * reach, 2 * reach, reduction)
        right, down = (centre - middle).tolist()
        windows.append(_Window(corner, reduction, (right, down), _filled(gray)))
    return windows, owners


def _filled(gray: Float32[np.ndarray, "rows columns"]) -> Float32[np.ndarray, "rows columns"]:
    """No NaN, and bright end at 255."""
    inside = np.isfinite(gray)
    if not inside.any():
        return np.zeros_like(gray)
    top = max(float(np.percentile(gray[inside], 99.5)), 1.0)
    filled = np.where(inside, gray, np.float32(np.median(gray[inside])))
    return filled * np.float32(255.0 / top)


def _peaks_of_kind(
    windows: Sequence[_Window], mark: Mark, scan_pixel_mm: float, options: ConstellationOptions
) -> tuple[_Peaks, _Peaks]:
    """Bright and dark candidates of one kind in all windows."""
    found: dict[bool, list[list[tuple[complex, float, float]]]] = {True: [], False: []}
    cell_mm = scan_pixel_mm * windows[0].reduction
    template = draw_mark(mark, cell_mm).astype(np.float32)
    for window in windows:
        if not mark.symmetric:
            pointing = replace(mark, outward=window.outward)
            template = draw_mark(pointing, cell_mm).astype(np.float32)
        field = _correlate(window.gray, template)
        for bright in (True, False):
            signed = field if bright else -field
            found[bright].append(_peaks(signed, window, template.shape[0] // 2, options.peaks))
    both = [_stacked(mark, bright, found[bright], options.peaks) for bright in (True, False)]
    return both[0], both[1]


def _correlate(
    gray: Float32[np.ndarray, "rows columns"], template: Float32[np.ndarray, "side side"]
) -> Float32[np.ndarray, "rows_inside columns_inside"]:
    """Normalised correlation wherever the template lies inside; nought on flat ground."""
    side = template.shape[0]
    if min(gray.shape) <= side:
        return np.zeros((1, 1), dtype=np.float32)
    field = cv2.matchTemplate(gray, template, cv2.TM_CCOEFF_NORMED)
    mean = cv2.blur(gray, (side, side))
    square = cv2.blur(gray * gray, (side, side))
    half = side // 2
    inner = (slice(half, half + field.shape[0]), slice(half, half + field.shape[1]))
    flat = (square - mean * mean)[inner] < FLAT**2
    return np.where(flat | ~np.isfinite(field), np.float32(0), field)


def _peaks(
    field: Float32[np.ndarray, "rows columns"], window: _Window, half: int, count: int
) -> list[tuple[complex, float, float]]:
    """The highest separate maxima: place in the scan, correlation, significance."""
    top = cv2.dilate(field, np.ones((5, 5), dtype=np.uint8))
    rows, columns = np.nonzero((field == top) & (field > 0.2))
    order = np.argsort(-field[rows, columns], kind="stable")[:count]
    middle = float(np.median(field))
    spread = 1.4826 * float(np.median(np.abs(field - middle))) + 0.02
    peaks: list[tuple[complex, float, float]] = []
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        value = float(field[row, column])
        down = row + _vertex(field[:, column], row) + half + 0.5
        right = column + _vertex(field[row], column) + half + 0.5
        place = complex(
            window.corner[0] + right * window.reduction, -window.corner[1] - down * window.reduction
        )
        peaks.append((place, value, (value - middle) / spread))
    return peaks


def _vertex(profile: Float32[np.ndarray, "n"], index: int) -> float:
    """Offset of the parabola's vertex through a maximum and its two neighbours."""
    if not 0 < index < len(profile) - 1:
        return 0.0
    before, here, after = (float(profile[index + k]) for k in (-1, 0, 1))
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def _stacked(
    mark: Mark, bright: bool, found: Sequence[Sequence[tuple[complex, float, float]]], count: int
) -> _Peaks:
    """Peaks as arrays of equal length."""
    places = np.full((len(found), count), complex(np.nan, np.nan))
    values = np.zeros((2, len(found), count))
    for i, peaks in enumerate(found):
        for k, (place, correlation, significance) in enumerate(peaks):
            places[i, k] = place
            values[:, i, k] = correlation, significance
    return _Peaks(mark, bright, places, values[0], values[1])


def _promise(peaks: _Peaks) -> float:
    """Sum over the windows of what their best peak is worth: an upper bound for any set."""
    return float((peaks.correlations * peaks.significances).max(axis=1).sum())


def _best_set(
    names: tuple[str, ...],
    film: FilmPoints,
    peaks: _Peaks,
    owner: Sequence[int],
    quarter: int,
    scan_pixel_mm: float,
    options: ConstellationOptions,
) -> Constellation | None:
    """The set of one kind that fits the certificate best, every pair of peaks tried as its base."""
    where = film[:, 0] + 1j * film[:, 1]
    places = peaks.places[list(owner)]
    worth = (peaks.correlations * peaks.significances)[list(owner)]
    starts, factors = _bases(where, places, quarter, scan_pixel_mm, options)
    if not len(starts):
        return None
    put = starts[:, None] + factors[:, None] * where[None, :]
    distance = np.abs(put[:, :, None] - places[None, :, :])
    fits = distance < options.fit_tolerance_mm / scan_pixel_mm
    value = np.where(fits, worth[None] * (1 - 0.3 * (distance * scan_pixel_mm) ** 2), 0.0)
    total = value.max(axis=2).sum(axis=1)
    base = int(np.argmax(total))
    chosen = value[base].argmax(axis=1)
    found = np.nonzero(value[base].max(axis=1) > 0)[0]
    at = np.asarray(places[found, chosen[found]])
    correlations = peaks.correlations[list(owner)][found, chosen[found]]
    predicted = {
        name: (float(place.real), float(-place.imag))
        for name, place in zip(names, put[base], strict=True)
    }
    bonus = 1 + options.upright_bonus * (quarter == 0)
    return Constellation(
        tuple(names[int(i)] for i in found),
        np.column_stack([np.real(at), -np.imag(at)]),
        correlations,
        predicted,
        peaks.mark,
        peaks.bright,
        float(np.angle(factors[base])),
        float(total[base]) * bonus,
    )


def _bases(
    where: FilmComplex,
    places: PeakComplex,
    quarter: int,
    scan_pixel_mm: float,
    options: ConstellationOptions,
) -> tuple[Complex128[np.ndarray, "bases"], Complex128[np.ndarray, "bases"]]:
    """Similarities pixel = start + factor * film through two peaks, of the right scale and turn."""
    starts: list[np.ndarray] = []
    factors: list[np.ndarray] = []
    longest = np.abs(where[:, None] - where[None, :]).max()
    for i, j in combinations(range(len(where)), 2):
        apart = where[j] - where[i]
        if abs(apart) < 0.3 * longest:
            continue
        factor = (places[j][None, :] - places[i][:, None]) / apart
        start = places[i][:, None] - factor * where[i]
        good = np.abs(np.abs(factor) * scan_pixel_mm - 1) < options.scale_tolerance
        away = np.angle(factor * np.exp(-0.5j * np.pi * quarter))
        good &= np.abs(away) < np.radians(options.turn_tolerance_deg)
        starts.append(start[good])
        factors.append(factor[good])
    if not starts:
        return np.zeros(0, dtype=np.complex128), np.zeros(0, dtype=np.complex128)
    return np.concatenate(starts), np.concatenate(factors)
