"""How likely chance would bring forth a set of marks that lies, and looks, as well as one found."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex128, Float64
from scipy.stats import norm

from core.arrays import FilmPoints, PixelPoints
from core.geometry.transforms import PlaneTransform, fit_similarity
from core.scans.film_area import FilmArea
from core.scans.marks import Mark, library

Complexes = Complex128[np.ndarray, "n"]
PeakValues = Float64[np.ndarray, "n peaks"]


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
    """Kinds and polarities, best first, for which sets are formed, besides the best size of each
    shape: texture is full of dots."""
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
    max_log_with_border: float = -5.5
    """The same where the border's word is counted: sets are chosen by it too, and pure texture then
    reaches -4.9."""
    marks: tuple[Mark, ...] = library()
    """Kinds and sizes of marks that are looked for."""
    beware_of_border: bool = False
    """Refuse notches that are the frame's own corners: for marks without a certificate."""
    border_turn_deg: float = 0.7
    """How far a set may usually be turned against the picture's border, degrees."""
    border_mm: float = 0.5
    """How far the middle of the certificate may usually lie beside that of the picture."""
    upright_bonus: float = 0.05
    """Advantage of an upright scan over a turned one that fits as well, as a share of the score:
    the certificate of symmetric marks cannot tell them apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What stays the same while kinds, layouts and ways to lie are tried."""

    scan_pixel_mm: float
    window_mm2: float
    tries: int
    options: ConstellationOptions
    border: FilmArea | None
    """The picture's border where it was seen and the marks are certified: it says how they lie."""


def area_turn(area: FilmArea) -> float:
    """Rotation of the picture's lower border in the scan, radians, counter-clockwise."""
    bottom = area.corners[1] - area.corners[0]
    return float(np.arctan2(-bottom[1], bottom[0]))


def log_chance_of_shape(search: Search, marks: int, film: FilmPoints, pixels: PixelPoints) -> float:
    """log10 of how many sets this near to the certificate random peaks would give.

    All pairs of peaks of all kinds are tried as bases; each further mark has its peaks spread at
    random over its window and hits a disc of twice the RMS residual.
    """
    options = search.options
    tried = options.kinds * search.tries * options.peaks**2 * marks * (marks - 1) / 2
    # Of random pairs, about one in ten has the right scale and turn.
    tried *= 0.1
    fit = fit_similarity(film, pixels, mirrored=True)
    residual_mm = 0.0
    if isinstance(fit, PlaneTransform):
        residual_mm = np.hypot(fit.rms * search.scan_pixel_mm, options.search_pixel_mm / 4)
    hit = options.peaks * np.pi * (2 * residual_mm) ** 2 / search.window_mm2
    return float(np.log10(tried) + (len(film) - 2) * np.log10(min(1.0, max(hit, 1e-12))))


def along_border(search: Search, factors: Complexes) -> Float64[np.ndarray, "bases"]:
    """What sets are worth by their turn against the picture's border, a half to one."""
    if search.border is None:
        return np.ones(len(factors))
    beside = np.angle(factors) - area_turn(search.border)
    usual = np.radians(search.options.border_turn_deg)
    return 0.5 + 0.5 * np.exp(-0.5 * (beside / usual) ** 2)


def log_chance_of_border(search: Search, start: complex, factor: complex) -> float:
    """log10 of the chance that a random set lies as straight and as central in the picture."""
    if search.border is None:
        return 0.0
    options = search.options
    column, row = search.border.centre[0].tolist()
    beside_mm = abs(start - complex(column, -row)) * search.scan_pixel_mm
    turned = abs(float(np.degrees(np.angle(factor) - area_turn(search.border))))
    place = np.pi * max(beside_mm, options.border_mm) ** 2 / search.window_mm2
    turn = max(turned, options.border_turn_deg) / options.turn_tolerance_deg
    return float(np.log10(min(place, 1.0)) + np.log10(min(turn, 1.0)))


def log_chance_of_looks(correlations: PeakValues, chosen: np.ndarray, found: np.ndarray) -> float:
    """log10 of the chance that mere texture looks as much like marks as the set does.

    Texture is what else was found in the windows: the best peak of each that is not in the set.
    """
    others = correlations.copy()
    others[found, chosen[found]] = -1.0
    texture = np.arctanh(np.clip(others.max(axis=1), 0.0, 0.999))
    looks = np.arctanh(np.clip(correlations[found, chosen[found]], 0.0, 0.999))
    deviate = (looks - texture.mean()) / max(float(texture.std()), 0.15)
    return float(np.log10(np.clip(norm.sf(deviate), 1e-4, 1.0)).sum())
