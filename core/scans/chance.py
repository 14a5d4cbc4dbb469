"""How many sets of marks as good as one would be found among peaks that lie at random."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex128, Float64
from scipy.special import ndtr

from core.arrays import FilmPoints, PixelPoints
from core.scans.candidates import Candidates
from core.scans.film_area import FilmArea

Complexes = Complex128[np.ndarray, "n"]
SEARCH_PIXEL_MM = 0.075  # design: the thinnest lines of the library are a cell and a third wide
"""Size of a pixel of the reduced windows."""
PEAKS = 4  # design: the mark, and a number, a ray or dirt beside it that look more like marks
"""Candidates kept for each window, kind and polarity."""
KINDS = 24  # design: a third of the library in both polarities: the time that sets take
"""Kinds and polarities, best first, for which sets are formed, besides the best size of each
shape: texture is full of dots."""
LARGEST_TURN_DEG = 4.0  # design: film laid on a scanner by hand lies straighter
"""How far the film may be turned from a quarter circle."""
# measured: prove_fiducials --seed 173 and 211; sets are chosen by the border too, and pure texture
# then reaches -4.9. Without a certificate hundreds of layouts are tried.
MOST_CHANCE, MOST_CHANCE_BORDER, MOST_CHANCE_UNKNOWN = -4.0, -5.5, -6.0
"""log10 of the number of sets as good that chance may give: for certified marks without and with
the word of the border, and for marks of which nobody knows where they lie."""
BORDER_TURN_DEG, BORDER_BESIDE_MM = 0.7, 0.5  # design: as well as borders are found on old film
"""How far a set may usually be turned and lie beside against the picture's border."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What stays the same while kinds, layouts and ways to lie are tried."""

    scan_pixel_mm: float
    size_px: tuple[int, int]
    window_mm2: float
    tries: int
    certified: bool
    border: FilmArea | None
    """The picture's border where it was seen and the marks are certified: it says how they lie."""
    kinds: int = KINDS
    """Kinds and polarities for which sets are formed."""
    anchored: bool = False
    """True where one mark is known: it belongs to every set."""
    evened: bool = False
    """True where windows have the same contrast all over."""

    @property
    def most_chance(self) -> float:
        """log10 of the number of sets as good that chance may give."""
        if not self.certified:
            return MOST_CHANCE_UNKNOWN
        return MOST_CHANCE_BORDER if self.border else MOST_CHANCE


def log_chance_of_shape(search: Search, marks: int, film: FilmPoints, pixels: PixelPoints) -> float:
    """log10 of how many sets this near to the certificate random peaks would give.

    All pairs of peaks of all kinds are tried as bases; each further mark has its peaks spread at
    random over its window and hits a disc of twice the RMS residual.
    """
    bases = PEAKS * (marks - 1) if search.anchored else PEAKS**2 * marks * (marks - 1) / 2
    tried = search.kinds * search.tries * bases
    # design: of random pairs, about one in ten has the right scale and turn.
    tried *= 0.1
    # As `fit_similarity` has it, for thousands of sets: a similarity is one complex product.
    here, there = film[:, 0] + 1j * film[:, 1], pixels[:, 0] - 1j * pixels[:, 1]
    here, there = here - here.mean(), there - there.mean()
    left = there - here * (np.vdot(here, there) / np.vdot(here, here))
    rms_px = np.sqrt(np.vdot(left, left).real / (2 * len(film)))
    residual_mm = np.hypot(rms_px * search.scan_pixel_mm, SEARCH_PIXEL_MM / 4)
    hit = PEAKS * np.pi * (2 * residual_mm) ** 2 / search.window_mm2
    # design: keeps the logarithm finite; no set of eight marks comes near.
    return float(np.log10(tried) + (len(film) - 2) * np.log10(min(1.0, max(hit, 1e-12))))


def log_chance_of_rectangle(search: Search, residual_px: float, marks: int) -> float:
    """log10 of how many rectangles this near to their peaks random peaks would give.

    Two marks are opposite or neighbours anywhere, a third must make a right angle, and a fourth
    hits a disc of twice the RMS residual.
    """
    residual_mm = np.hypot(residual_px * search.scan_pixel_mm, SEARCH_PIXEL_MM / 4)
    tried = search.kinds * PEAKS ** (2 if search.anchored else 3) * (4 if marks < 4 else 1)
    square = min(1.0, 4 * residual_mm / np.sqrt(search.window_mm2))
    hit = min(1.0, PEAKS * np.pi * (2 * residual_mm) ** 2 / search.window_mm2)
    return float(np.log10(tried) + np.log10(square) + (marks - 3) * np.log10(hit))


def along_border(search: Search, factors: Complexes) -> Float64[np.ndarray, "bases"]:
    """What sets are worth by their turn against the picture's border, a half to one."""
    if search.border is None:
        return np.ones(len(factors))
    beside = np.angle(factors) - search.border.turn
    usual = np.radians(BORDER_TURN_DEG)
    return 0.5 + 0.5 * np.exp(-0.5 * (beside / usual) ** 2)


def log_chance_of_border(search: Search, start: complex, factor: complex) -> float:
    """log10 of the chance that a random set lies as straight and as central in the picture."""
    if search.border is None:
        return 0.0
    column, row = search.border.centre[0].tolist()
    beside_mm = abs(start - complex(column, -row)) * search.scan_pixel_mm
    turned = abs(float(np.degrees(np.angle(factor) - search.border.turn)))
    place = np.pi * max(beside_mm, BORDER_BESIDE_MM) ** 2 / search.window_mm2
    turn = max(turned, BORDER_TURN_DEG) / LARGEST_TURN_DEG
    return float(np.log10(min(place, 1.0)) + np.log10(min(turn, 1.0)))


def log_chance_of_looks(
    search: Search, kind: Candidates, owner: Sequence[int], chosen: np.ndarray, found: np.ndarray
) -> float:
    """log10 of the chance that mere texture looks as much like marks as the set does.

    Texture is what else was found in the windows: the best peak of each that is not in the set.
    """
    # design: Fisher's transform, kept finite; no window's texture spreads by less than 0.15, and
    # no mark counts more than 10^4, as the tails of texture are not normal.
    most, least_spread, rarest = 0.999, 0.15, 1e-4
    if search.evened:
        # Texture is the same all over such a window: a peak's height above it says most.
        # design: heights of highest peaks of a normal field spread by half a standard deviation
        values, least_spread = kind.significances[list(owner)], 0.5
    else:
        values = np.arctanh(np.clip(kind.correlations[list(owner)], 0.0, most))
    others = values.copy()
    others[found, chosen[found]] = 0.0
    texture, looks = others.max(axis=1), values[found, chosen[found]]
    deviate = (looks - texture.mean()) / max(float(texture.std()), least_spread)
    return float(np.log10(np.clip(ndtr(-deviate), rarest, 1.0)).sum())
