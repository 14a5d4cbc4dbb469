"""Which places in a scan are the camera's fiducials: the set of candidates that fits best.

Every kind of mark in the library is correlated with windows about the expected places; of all
peaks the set is taken that lies as the certificate says, turned by about none to three quarter
circles and scaled by the scan pixel size. A set stands only if it could not be chance: the marks
that did not determine it lie too near to where they should, or look too much like marks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Complex128, Float64
from scipy.stats import norm

from core.arrays import FilmPoints, PixelPoints, Scalars, locked
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, fit_similarity
from core.scan.candidates import (
    MERGE_MM,
    Candidates,
    SearchWindow,
    all_candidates,
    open_windows,
)
from core.scan.centring import Centre, centre_by_symmetry, disc_weights
from core.scan.film_area import FilmArea
from core.scan.marks import Mark
from core.scan.raster import ScanFile

Complexes = Complex128[np.ndarray, "n"]
PeakComplex = Complex128[np.ndarray, "n peaks"]
PeakValues = Float64[np.ndarray, "n peaks"]
ASYMMETRIC_WORTH = 0.5
"""Symmetry that a kind of mark without any is credited with."""


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
    fit_tolerance_mm: float = 1.0
    """How far a mark may lie from where two others put it, millimetres: scanners shear, film
    shrinks."""
    rivals: int = 8
    """Sets at different places that are compared by their symmetry."""
    symmetry_mm: float = 1.5
    """Radius within which a mark and its housing should be symmetric, millimetres."""
    min_symmetry: float = 0.45
    """Mean symmetry, 0 to 1, below which a set is refused."""
    max_log_false_alarms: float = -4.0
    """log10 of the number of sets as good that chance would give; a greater number is refused."""
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
    log_false_alarms: float
    """log10 of the number of sets as good that chance would give."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", locked(self.pixels))
        object.__setattr__(self, "correlations", locked(self.correlations))


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """What stays the same while kinds and ways to lie are tried."""

    names: tuple[str, ...]
    film: FilmPoints
    scan_pixel_mm: float
    window_mm2: float
    options: ConstellationOptions


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
    reach_mm = options.reach_seen_mm if area.trusted else options.reach_unseen_mm
    search = _Search(names, film, scan_pixel_mm, (2 * reach_mm) ** 2, options)
    expected = {q: _expected(film, area, scan_pixel_mm, q) for q in _quarters(camera, area)}
    column, row = area.centre[0].tolist()
    windows, owners = open_windows(
        scan, expected, (column, row), round(reach_mm / scan_pixel_mm), MERGE_MM / scan_pixel_mm,
        max(1, round(options.search_pixel_mm / scan_pixel_mm)),
    )  # fmt: skip
    kinds = all_candidates(windows, scan_pixel_mm * windows[0].reduction, options.peaks)
    kinds.sort(key=lambda kind: kind.promise, reverse=True)
    sets = [
        _best_set(search, kind, owner, quarter)
        for kind in kinds[: options.kinds]
        for quarter, owner in owners.items()
    ]
    found = [chosen for chosen in sets if chosen is not None]
    sound = [c for c in found if c.log_false_alarms < options.max_log_false_alarms]
    sound.sort(key=lambda chosen: chosen.score, reverse=True)
    rivals = _rivals(sound, 0.15 / scan_pixel_mm)[: options.rivals]
    symmetries = [_symmetry(rival, windows, search) for rival in rivals]
    if max(symmetries, default=0.0) < options.min_symmetry:
        return Failure(
            "No set of marks lies as the certificate says.",
            {
                "log_false_alarms": min((c.log_false_alarms for c in found), default=None),
                "symmetry": max(symmetries, default=None),
            },
        )
    worth = [rival.score * value for rival, value in zip(rivals, symmetries, strict=True)]
    return rivals[int(np.argmax(worth))]


def _rivals(sets: Sequence[Constellation], apart_px: float) -> list[Constellation]:
    """The best set of each place: sets whose marks lie together are one, whatever their names."""
    kept: list[Constellation] = []
    for candidate in sets:
        gaps = (
            np.linalg.norm(candidate.pixels[:, None] - other.pixels[None], axis=2).min(axis=1)
            for other in kept
        )
        if all(float(np.mean(gap)) > apart_px for gap in gaps):
            kept.append(candidate)
    return kept


def _symmetry(chosen: Constellation, windows: Sequence[SearchWindow], search: _Search) -> float:
    """How symmetric the set's places are, 0 to 1, near and farther about them.

    The end of a ray or the crossing of a ray and a ring can look like a mark on its own; the middle
    of the mark is the point about which all that belongs to it is symmetric.
    """
    if not chosen.mark.symmetric:
        return ASYMMETRIC_WORTH
    cell_px = windows[0].reduction
    cell_mm = search.scan_pixel_mm * cell_px
    found: list[float] = []
    for column, row in chosen.pixels.tolist():
        window = min(windows, key=lambda w: abs(w.middle[0] - column) + abs(w.middle[1] - row))
        start = ((column - window.corner[0]) / cell_px, (row - window.corner[1]) / cell_px)
        for radius_mm in (1.15 * chosen.mark.reach_mm, search.options.symmetry_mm):
            radius = max(radius_mm / cell_mm, 3.0)
            weights = disc_weights(2 * int(np.ceil(radius)) + 3, radius)
            centre = centre_by_symmetry(window.gray, weights, start, limit_px=0.3 / cell_mm + 1)
            found.append(max(centre.correlation, 0.0) if isinstance(centre, Centre) else 0.0)
    return float(np.mean(found))


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


def _best_set(
    search: _Search, kind: Candidates, owner: Sequence[int], quarter: int
) -> Constellation | None:
    """The set of one kind that fits the certificate best, every pair of peaks tried as its base."""
    where = search.film[:, 0] + 1j * search.film[:, 1]
    places, worth = kind.places[list(owner)], kind.worth[list(owner)]
    starts, factors = _bases(search, where, places, quarter)
    if not len(starts):
        return None
    put = starts[:, None] + factors[:, None] * where[None, :]
    distance_mm = np.abs(put[:, :, None] - places[None, :, :]) * search.scan_pixel_mm
    tolerance = search.options.fit_tolerance_mm
    fits = distance_mm < tolerance
    value = np.where(fits, worth[None] * (1 - 0.7 * (distance_mm / tolerance) ** 2), 0.0)
    total = value.max(axis=2).sum(axis=1)
    base = int(np.argmax(total))
    chosen = value[base].argmax(axis=1)
    found = np.nonzero(value[base].max(axis=1) > 0)[0]
    at = np.asarray(places[found, chosen[found]])
    pixels = np.column_stack([np.real(at), -np.imag(at)])
    correlations = kind.correlations[list(owner)]
    predicted = {
        name: (float(place.real), float(-place.imag))
        for name, place in zip(search.names, put[base], strict=True)
    }
    chance = _log_chance_of_shape(search, search.film[found], pixels)
    chance += _log_chance_of_looks(correlations, chosen, found)
    bonus = 1 + search.options.upright_bonus * (quarter == 0)
    return Constellation(
        tuple(search.names[int(i)] for i in found), pixels, correlations[found, chosen[found]],
        predicted, kind.mark, kind.bright, float(np.angle(factors[base])),
        float(total[base]) * bonus, chance,
    )  # fmt: skip


def _bases(
    search: _Search, where: Complexes, places: PeakComplex, quarter: int
) -> tuple[Complex128[np.ndarray, "bases"], Complex128[np.ndarray, "bases"]]:
    """Similarities pixel = start + factor * film through two peaks, of the right scale and turn."""
    starts: list[np.ndarray] = []
    factors: list[np.ndarray] = []
    longest = np.abs(where[:, None] - where[None, :]).max()
    tolerance = np.radians(search.options.turn_tolerance_deg)
    for i, j in combinations(range(len(where)), 2):
        apart = where[j] - where[i]
        if abs(apart) < 0.3 * longest:
            continue
        factor = (places[j][None, :] - places[i][:, None]) / apart
        start = places[i][:, None] - factor * where[i]
        scale = np.abs(factor) * search.scan_pixel_mm
        good = np.abs(scale - 1) < search.options.scale_tolerance
        good &= np.abs(np.angle(factor * np.exp(-0.5j * np.pi * quarter))) < tolerance
        starts.append(start[good])
        factors.append(factor[good])
    if not starts:
        return np.zeros(0, dtype=np.complex128), np.zeros(0, dtype=np.complex128)
    return np.concatenate(starts), np.concatenate(factors)


def _log_chance_of_shape(search: _Search, film: FilmPoints, pixels: PixelPoints) -> float:
    """log10 of how many sets this near to the certificate random peaks would give.

    All pairs of peaks of all kinds are tried as bases; each further mark has its peaks spread at
    random over its window and hits a disc of twice the RMS residual.
    """
    options, marks = search.options, len(search.names)
    tried = options.kinds * options.peaks**2 * marks * (marks - 1) / 2
    # Of random pairs, about one in ten has the right scale and turn.
    tried *= 0.1
    fit = fit_similarity(film, pixels, mirrored=True)
    residual_mm = 0.0
    if isinstance(fit, PlaneTransform):
        residual_mm = np.hypot(fit.rms * search.scan_pixel_mm, options.search_pixel_mm / 4)
    hit = options.peaks * np.pi * (2 * residual_mm) ** 2 / search.window_mm2
    return float(np.log10(tried) + (len(film) - 2) * np.log10(min(1.0, max(hit, 1e-12))))


def _log_chance_of_looks(correlations: PeakValues, chosen: np.ndarray, found: np.ndarray) -> float:
    """log10 of the chance that mere texture looks as much like marks as the set does.

    Texture is what else was found in the windows: the best peak of each that is not in the set.
    """
    others = correlations.copy()
    others[found, chosen[found]] = -1.0
    texture = np.arctanh(np.clip(others.max(axis=1), 0.0, 0.999))
    looks = np.arctanh(np.clip(correlations[found, chosen[found]], 0.0, 0.999))
    deviate = (looks - texture.mean()) / max(float(texture.std()), 0.15)
    return float(np.log10(np.clip(norm.sf(deviate), 1e-4, 1.0)).sum())
