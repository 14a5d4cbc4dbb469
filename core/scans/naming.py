"""Name the marks: of the eight orientations of a film, choose the one the certificate supports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float64

from core.arrays import FilmPoints, PixelPoints, Scalars, locked
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.scans.film_area import FilmArea, Side

Group = Literal["corners", "sides"]
Way = tuple[int, bool]
"""Quarter turns counter-clockwise in the scan, and whether the film shows its back."""
UPRIGHT: Way = (0, False)  # design: no turn, not mirrored
WAYS: tuple[Way, ...] = tuple((quarter, back) for back in (False, True) for quarter in range(4))
ALIKE_MM = 0.6  # design: less than the fit of a set tolerates (FIT_MM of the constellation)
"""Layouts whose marks all lie this near to each other are searched for only once."""
ASIDE = 0.55  # design: about half way between the middle of a side (0) and a corner (1)
"""Share of half the frame beyond which a mark in both directions belongs to a corner."""
# design: from marks in the film's margin to those well inside the picture.
INSETS_MM = (-4.5, 15.0)
"""How far inside the border of the frame unknown marks are looked for, from and to."""
# design: directions from the middle of the film, x right and y up.
CORNERS = {"UL": (-1.0, 1.0), "UR": (1.0, 1.0), "LR": (1.0, -1.0), "LL": (-1.0, -1.0)}
# design: the same.
SIDES = {"T": (0.0, 1.0), "R": (1.0, 0.0), "B": (0.0, -1.0), "L": (-1.0, 0.0)}
GROUPS: Mapping[Group, Mapping[str, tuple[float, float]]] = {"corners": CORNERS, "sides": SIDES}
OPPOSITE_MARKS = (("UL", "LR"), ("UR", "LL"), ("T", "B"), ("L", "R"))
OUTWARD = {"left": SIDES["L"], "top": SIDES["T"], "right": SIDES["R"], "bottom": SIDES["B"]}
FILM_SIGMA_MM = 0.003  # design: certificates give the places of marks to a few micrometres
"""How well film and certificate usually agree once its even stretching is taken up, millimetres."""
STRETCH = 3e-4  # design: usual shrinkage of film base by age and processing
"""How much a film is usually longer along one side than along the other, or out of square."""
FREEDOM = 4.0  # source: Lange, Little & Taylor 1989 (robust modelling with the t distribution)
"""Some films are far worse than usual: the freedom of Student's distribution that allows for it."""
DECIDED = 12.0  # design: odds of four hundred to one
"""Twice the logarithm of the odds from which one way to lie is preferred to another."""
TURNED, MIRRORED = 2.0, 6.0  # design: odds of three and of twenty to one, as archives scan
"""Twice the logarithm of the odds against a turned and against a mirrored scan beforehand."""
BORDER_MM = 0.3  # design: the border is seen to a cell of a fifth of a millimetre
"""How well the middle of the certificate and that of the picture usually agree, millimetres."""
BORDER_TURN = 2e-3  # design: the step of 0.1 degrees with which the border's turn is found
"""The same of the certificate's axes and the picture's border, radians."""
NEAR_MM = 2.5  # design: no two marks lie so near; no certificate is wrong by so much
"""How near to its place a mark must lie to be taken for it."""
Certificate = Mapping[str, tuple[float, float]]
Halves = Float64[np.ndarray, "2"]


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Marks that are looked for together: of one kind, in one pattern."""

    names: tuple[str, ...]
    """Their names."""
    film: FilmPoints
    """Where they lie on the film, millimetres."""
    ways: tuple[Way, ...]
    """Ways to lie that differ and are tried."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "film", locked(self.film))

    def lying(self, way: Way) -> FilmPoints:
        """The marks as they lie in the scan, x right and y up, millimetres."""
        return lying(self.film, way)

    @property
    def reach_mm(self) -> float:
        """Distance of its outermost mark from the middle."""
        return float(np.linalg.norm(self.film, axis=1).max())


@dataclass(frozen=True, slots=True, eq=False)
class OpenLayout:
    """Four marks opposite to each other, upright, of which nobody knows how far out they lie."""

    names: tuple[str, ...]
    """Their names, clockwise."""
    directions: FilmPoints
    """Where they lie from the middle, halves of width and height."""
    least_mm: Halves
    """Least half width and half height, millimetres."""
    most_mm: Halves
    """Greatest."""
    frame_mm: Halves
    """Half width and half height of the frame."""

    @property
    def middle(self) -> Layout:
        """The marks half way between the least and the greatest distance."""
        film = self.directions * (self.least_mm + self.most_mm) / 2
        return Layout(self.names, film, (UPRIGHT,))

    @property
    def spread_mm(self) -> FilmPoints:
        """How far each mark may lie from there, across and down."""
        return np.abs(self.directions) * (self.most_mm - self.least_mm) / 2


def lying(film: FilmPoints, way: Way) -> FilmPoints:
    """Film points in the axes of a scan (x right, y up) on which the film lies in a way."""
    quarter, back = way
    turn = quarter * np.pi / 2
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    sides = np.array([-1.0, 1.0]) if back else np.array([1.0, 1.0])
    return (film * sides) @ np.rint(rotation).T


def certified_layouts(camera: Camera, quarters: Sequence[int]) -> tuple[Layout, ...]:
    """The certificate's marks; corners and sides apart where both are enough to stand alone.

    Args:
        camera: Camera with its certified fiducials.
        quarters: Quarter turns the frame's shape allows.
    """
    names = tuple(camera.fiducials_mm)
    film = np.array([camera.fiducials_mm[name] for name in names], dtype=np.float64)
    half = np.abs(film).max(axis=0)
    corner = (np.abs(film) > ASIDE * half).all(axis=1)
    parts = [corner, ~corner] if min(corner.sum(), (~corner).sum()) >= 3 else [corner | True]
    return tuple(
        Layout(
            tuple(name for name, inside in zip(names, part, strict=True) if inside),
            film[part],
            distinct_ways(film[part], quarters),
        )
        for part in parts
    )


def guessed_layouts(camera: Camera) -> tuple[OpenLayout, ...]:
    """Corner marks and marks of the sides at any usual distance from the frame's border."""
    half = np.array(camera.frame_mm) / 2
    return tuple(
        OpenLayout(
            tuple(places),
            np.array(list(places.values())),
            half - max(INSETS_MM),
            half - min(INSETS_MM),
            half,
        )
        for places in (CORNERS, SIDES)
    )


def distinct_ways(film: FilmPoints, quarters: Sequence[int]) -> tuple[Way, ...]:
    """Of the ways to lie those that put marks elsewhere than an earlier one, names aside."""
    kept: list[Way] = []
    for way in WAYS:
        here = lying(film, way)
        if way[0] in quarters and not any(_alike(here, lying(film, other)) for other in kept):
            kept.append(way)
    return tuple(kept)


def _alike(first: FilmPoints, second: FilmPoints) -> bool:
    """True when every mark of one lies near one of the other."""
    apart = np.linalg.norm(first[:, None] - second[None], axis=2)
    return bool(max(apart.min(axis=0).max(), apart.min(axis=1).max()) < ALIKE_MM)


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
    return within_eighth(float(np.arctan2(put.matrix[1, 0], put.matrix[0, 0])))


def within_eighth(turn: float) -> float:
    """A rotation less its quarter turns, radians."""
    return float((turn + np.pi / 4) % (np.pi / 2) - np.pi / 4)


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
    turn = np.arctan2(put.matrix[1, 0], put.matrix[0, 0]) + area.turn
    beside_mm = (put.matrix[:, 2] - area.centre[0]) / put.scale
    square_sum = float(np.sum((beside_mm / BORDER_MM) ** 2))
    square_sum += float(np.sin(turn) / BORDER_TURN) ** 2
    return (FREEDOM + 3) * float(np.log1p(square_sum / FREEDOM))


def ways_of_strip(certified: str, seen: Side | None) -> tuple[Way, ...]:
    """Ways the film may lie in, not mirrored first, when its data strip was seen on a side.

    Args:
        certified: Side of the strip in the film frame; empty when nobody knows.
        seen: Side of the strip in the scan.
    """
    if seen is None or not certified:
        return ()
    on_film = np.array([OUTWARD[certified]])
    in_scan = np.array([OUTWARD[seen]])
    return tuple(way for way in WAYS if np.allclose(lying(on_film, way), in_scan))


def strip_on_film(seen: Side, way: Way) -> str:
    """The side of the upright film that lies on a side of the scan."""
    in_scan = np.array([OUTWARD[seen]])
    return next(
        side
        for side, outward in OUTWARD.items()
        if np.allclose(lying(np.array([outward]), way), in_scan)
    )


# design: quarter turns as `Way` counts them
WAY_WORDS: Mapping[tuple[int, bool], str] = {
    (0, False): "upright",
    (1, False): "turned by 90 degrees counter-clockwise",
    (2, False): "turned by 180 degrees",
    (3, False): "turned by 90 degrees clockwise",
    (0, True): "mirrored",
    (1, True): "mirrored and turned by 90 degrees counter-clockwise",
    (2, True): "mirrored and turned by 180 degrees",
    (3, True): "mirrored and turned by 90 degrees clockwise",
}
"""The ways to lie in words."""


def turned_words(way: Way) -> str:
    """A way to lie in words."""
    return WAY_WORDS[way[0], bool(way[1])]
