"""Which mark is which: of the eight ways a film can lie, the one the certificate speaks for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import FilmPoints, PixelPoints, Scalars
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.scans.film_area import FilmArea
from core.scans.layouts import UPRIGHT, WAYS, Way, lying

FILM_SIGMA_MM = 0.003
"""How well film and certificate usually agree once its even stretching is taken up, millimetres."""
STRETCH = 3e-4
"""How much a film is usually longer along one side than along the other, or out of square."""
FREEDOM = 4.0
"""Some films are far worse than usual: the freedom of Student's distribution that allows for it."""
DECIDED = 12.0
"""Twice the logarithm of the odds from which one way to lie is preferred to another."""
TURNED = 2.0
MIRRORED = 6.0
"""Twice the logarithm of the odds against a turned and against a mirrored scan beforehand."""
BORDER_MM = 0.3
"""How well the middle of the certificate and that of the picture usually agree, millimetres."""
BORDER_TURN = 2e-3
"""The same of the certificate's axes and the picture's border, radians."""
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
    guessed: bool = False
    """True where one of them was taken that is not what an archive usually holds."""


def name_marks(
    names: Sequence[str],
    pixels: PixelPoints,
    sigmas_px: Scalars,
    way: Way,
    certificate: Certificate,
    preferred: Sequence[Way] = (),
    area: FilmArea | None = None,
) -> Naming:
    """Name measured marks anew where another way to lie fits the certificate clearly better.

    Args:
        names: Names they were given while they were found.
        pixels: Where they were measured.
        sigmas_px: Standard deviation of each per axis, pixels.
        way: The way to lie that belongs to those names.
        certificate: The camera's marks, millimetres.
        preferred: Ways to take, best first, where the certificate cannot tell.
        area: The picture, whose border may tell what the marks alone do not: three marks of four
            often lie as well when seen in a mirror, but then aslant in the frame.
    """
    film = np.array([certificate[name] for name in names], dtype=np.float64)
    base = fit_similarity(lying(film, way), pixels, mirrored=True)
    fits: dict[Way, tuple[float, tuple[str, ...]]] = {}
    if isinstance(base, PlaneTransform) and len(names) >= 3:
        for other in WAYS:
            renamed = _renamed(pixels, other, certificate, base)
            if renamed is not None:
                misfit = _misfit(renamed, pixels, sigmas_px, other, certificate)
                if area is not None and area.trusted:
                    misfit += _aslant(renamed, pixels, other, certificate, area)
                fits[other] = (misfit, renamed)
    if way not in fits:
        return Naming(tuple(names), way, ())
    least = min(value for value, _ in fits.values())
    equal = [other for other, (value, _) in fits.items() if value < least + DECIDED]
    wanted = [other for other in preferred if other in equal]
    best = wanted[0] if wanted else min(equal, key=lambda one: fits[one][0] + _unlikely(one))
    guessed = not wanted and (best != UPRIGHT or fits[best][0] > least + TURNED)
    rivals = tuple(other for other in equal if other != best)
    return Naming(fits[best][1], best, rivals, bool(rivals) and guessed)


def small_turn(put: PlaneTransform) -> float:
    """Rotation of the film in the scan (clockwise) less its quarter turns, radians.

    Args:
        put: The similarity scan from film.
    """
    clockwise = float(np.arctan2(put.matrix[1, 0], put.matrix[0, 0]))
    return float((clockwise + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def _unlikely(way: Way) -> float:
    """Twice the logarithm of the odds against a way beforehand."""
    return (TURNED if way[0] else 0.0) + (MIRRORED if way[1] else 0.0)


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


def _misfit(
    names: Sequence[str],
    pixels: PixelPoints,
    sigmas_px: Scalars,
    way: Way,
    certificate: Certificate,
) -> float:
    """Twice the logarithm of how unlikely the marks are under these names.

    A similarity is free; the film's stretching and its bends are as films usually have them, with
    Student's long tails for those that are worse.
    """
    film: FilmPoints = np.array([certificate[name] for name in names], dtype=np.float64)
    rough = fit_similarity(pixels, film, mirrored=not way[1])
    if not isinstance(rough, PlaneTransform):
        return np.inf
    sigmas = np.repeat(np.hypot(sigmas_px * rough.scale, FILM_SIGMA_MM), 2)
    left = film - apply_affine(rough.matrix, pixels)
    x, y = (film - film.mean(axis=0)).T
    one, none = np.ones(len(film)), np.zeros(len(film))
    rows = np.array([[one, none, x, -y, x, y], [none, one, y, x, -y, x]])
    design = rows.transpose(2, 0, 1).reshape(-1, 6) / sigmas[:, None]
    usual = np.zeros((2, 6))
    usual[0, 4] = usual[1, 5] = 1 / STRETCH
    design = np.vstack([design, usual])
    wanted = np.concatenate([left.ravel() / sigmas, np.zeros(2)])
    solution = np.linalg.lstsq(design, wanted, rcond=None)[0]
    square_sum = float(np.sum((wanted - design @ solution) ** 2))
    return (FREEDOM + left.size - 4) * float(np.log1p(square_sum / FREEDOM))


def _aslant(
    names: Sequence[str], pixels: PixelPoints, way: Way, certificate: Certificate, area: FilmArea
) -> float:
    """Twice the logarithm of how unlikely the certificate lies so in the picture's border."""
    film = lying(np.array([certificate[name] for name in names], dtype=np.float64), way)
    put = fit_similarity(film, pixels, mirrored=True)
    if not isinstance(put, PlaneTransform):
        return np.inf
    bottom = area.corners[1] - area.corners[0]
    turn = np.arctan2(put.matrix[1, 0], put.matrix[0, 0]) - np.arctan2(bottom[1], bottom[0])
    beside_mm = (put.matrix[:, 2] - area.centre[0]) / put.scale
    square_sum = float(np.sum((beside_mm / BORDER_MM) ** 2))
    square_sum += float(np.sin(turn) / BORDER_TURN) ** 2
    return (FREEDOM + 3) * float(np.log1p(square_sum / FREEDOM))
