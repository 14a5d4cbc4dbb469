"""Where a camera's marks may lie: as certified or guessed from the frame, in eight ways to lie."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import FilmPoints, locked
from core.geometry.camera import Camera

Way = tuple[int, bool]
"""Quarter turns counter-clockwise in the scan, and whether the film shows its back."""
UPRIGHT: Way = (0, False)
WAYS: tuple[Way, ...] = tuple((quarter, back) for back in (False, True) for quarter in range(4))
ALIKE_MM = 0.6
"""Layouts whose marks all lie this near to each other are searched for only once."""
ASIDE = 0.55
"""Share of half the frame beyond which a mark in both directions belongs to a corner."""
INSETS_MM = (-4.5, 15.0)
"""How far inside the border of the frame unknown marks are looked for, from and to."""
INSET_STEP_MM = 1.5
INSET_STEP_SHARE = 0.025
"""Step between the distances tried, at most this share of half the frame: sets are sought whose
scale is right to 1.5 per cent, and between two steps no place may be left out."""
CORNERS = {"UL": (-1.0, 1.0), "UR": (1.0, 1.0), "LR": (1.0, -1.0), "LL": (-1.0, -1.0)}
SIDES = {"T": (0.0, 1.0), "R": (1.0, 0.0), "B": (0.0, -1.0), "L": (-1.0, 0.0)}


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


def guessed_layouts(camera: Camera) -> Mapping[str, tuple[Layout, ...]]:
    """Corner marks and marks of the sides at many distances from the frame's border."""
    half = np.array(camera.frame_mm) / 2
    step = min(INSET_STEP_MM, INSET_STEP_SHARE * float(half.min()))
    insets = np.arange(INSETS_MM[0], INSETS_MM[1] + step / 2, step).tolist()
    return {
        group: tuple(
            Layout(
                tuple(places),
                np.array(list(places.values())) * (half - inset),
                (UPRIGHT,),
            )
            for inset in insets
        )
        for group, places in (("corners", CORNERS), ("sides", SIDES))
    }


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
