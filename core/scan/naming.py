"""Which mark is which: of the eight ways a film can lie, the one the certificate speaks for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import FilmPoints, PixelPoints, Scalars
from core.geometry.interior_models import FilmFit, fit_film
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.scan.layouts import UPRIGHT, WAYS, Way, lying

FILM_SIGMA_MM = 0.01
"""How well film and certificate usually agree, millimetres: smaller differences decide nothing."""
DECIDED = 25.0
"""Difference of weighted square sums from which one way to lie is preferred to another."""
NEAR_MM = 2.5
"""How near to its place a mark must lie to be taken for it."""
Certificate = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Naming:
    """How the film lies in the scan, and what its marks are then called."""

    names: tuple[str, ...]
    """New names, in the order of the marks."""
    way: Way
    """How the film lies."""
    rivals: tuple[Way, ...]
    """Other ways that fit as well: the certificate cannot tell them apart."""


def name_marks(
    names: Sequence[str],
    pixels: PixelPoints,
    sigmas_px: Scalars,
    way: Way,
    certificate: Certificate,
    preferred: Sequence[Way] = (),
) -> Naming:
    """Name measured marks anew where another way to lie fits the certificate clearly better.

    Args:
        names: Names they were given while they were found.
        pixels: Where they were measured.
        sigmas_px: Standard deviation of each per axis, pixels.
        way: The way to lie that belongs to those names.
        certificate: The camera's marks, millimetres.
        preferred: Ways to take, best first, where the certificate cannot tell; upright otherwise.
    """
    film = np.array([certificate[name] for name in names], dtype=np.float64)
    base = fit_similarity(lying(film, way), pixels, mirrored=True)
    fits: dict[Way, tuple[float, tuple[str, ...]]] = {}
    if isinstance(base, PlaneTransform) and len(names) >= 3:
        for other in WAYS:
            renamed = _renamed(pixels, other, certificate, base)
            if renamed is not None:
                fits[other] = (_square_sum(renamed, pixels, sigmas_px, other, certificate), renamed)
    if way not in fits:
        return Naming(tuple(names), way, ())
    least = min(value for value, _ in fits.values())
    equal = [other for other, (value, _) in fits.items() if value < least + DECIDED]
    wanted = [other for other in (*preferred, UPRIGHT, way) if other in equal]
    best = wanted[0] if wanted else equal[0]
    return Naming(fits[best][1], best, tuple(other for other in equal if other != best))


def _renamed(
    pixels: PixelPoints, way: Way, certificate: Certificate, base: PlaneTransform
) -> tuple[str, ...] | None:
    """Names of the marks if the film lay in a way; None when a mark lies where none should."""
    names = tuple(certificate)
    film = lying(np.array(list(certificate.values()), dtype=np.float64), way)
    put = apply_affine(base.matrix, film)
    apart = np.linalg.norm(pixels[:, None] - put[None], axis=2)
    nearest = apart.argmin(axis=1)
    if apart.min(axis=1).max() > NEAR_MM * base.scale or len(set(nearest.tolist())) < len(pixels):
        return None
    return tuple(names[int(i)] for i in nearest)


def _square_sum(
    names: Sequence[str],
    pixels: PixelPoints,
    sigmas_px: Scalars,
    way: Way,
    certificate: Certificate,
) -> float:
    """Weighted square sum of the residuals with these names, film deformation allowed for."""
    film: FilmPoints = np.array([certificate[name] for name in names], dtype=np.float64)
    rough = fit_similarity(pixels, film, mirrored=not way[1])
    if not isinstance(rough, PlaneTransform):
        return np.inf
    sigmas = np.hypot(sigmas_px * rough.scale, FILM_SIGMA_MM)
    fit = fit_film("similarity" if len(names) < 4 else "affine", pixels, film, sigmas, way[1])
    if not isinstance(fit, FilmFit):
        return np.inf
    # An affine hides that x and y were exchanged: film shrinks by a thousandth, not by more.
    similar = fit_film("similarity", pixels, film, np.hypot(sigmas, 0.05), way[1])
    extra = similar.weighted_square_sum if isinstance(similar, FilmFit) else np.inf
    return fit.weighted_square_sum + extra
