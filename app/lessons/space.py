"""What drawings in space share: photos above the ground, their rays, the ground itself."""

from collections.abc import Callable, Iterable

import numpy as np

from app.lessons import sheet
from app.lessons.photo import HALF_MM
from core.arrays import FilmPoints, Matrix, ObjectPoints, Position, Scalars
from core.geometry.exterior import ExteriorOrientation

LINES = 13
"""Lines of the ground each way."""


def in_space(
    film: FilmPoints, exterior: ExteriorOrientation, c_mm: float, times: float
) -> ObjectPoints:
    """Where film points lie in space, metres: a positive, enlarged about the perspective centre."""
    image = np.column_stack([film, np.full(len(film), -c_mm)]) / 1000 * times
    return exterior.centre + image @ exterior.object_from_image.T


def photo(
    exterior: ExteriorOrientation, c_mm: float, times: float, name: str = ""
) -> list[sheet.Shape]:
    """Frame and perspective centre of a photo, its film enlarged so many times."""
    corners = in_space(np.array(sheet.frame_of(HALF_MM)), exterior, c_mm, times)
    edges = rays(exterior.centre, corners, "faint")
    return [
        *edges,
        sheet.shape("area", corners, "film"),
        sheet.shape("dots", exterior.centre[None], "given", name),
    ]


def rays(centre: Position, ends: Iterable[Position], look: sheet.Look = "ray") -> list[sheet.Shape]:
    """Lines from a perspective centre."""
    return [sheet.shape("line", [centre, end], look) for end in ends]


def flat(plan: Matrix) -> Scalars:
    """The height of level ground: nought."""
    return np.zeros(len(plan))


def ground(
    west: float,
    south: float,
    east: float,
    north: float,
    height: Callable[[Matrix], Scalars] = flat,
    look: sheet.Look = "faint",
) -> list[sheet.Shape]:
    """Lines on the ground; height takes places in plan."""
    across, up = np.linspace(west, east, LINES), np.linspace(south, north, LINES)
    east_of, north_of = np.meshgrid(across, up)
    plan = np.column_stack([east_of.ravel(), north_of.ravel()])
    places = np.column_stack([plan, height(plan)]).reshape(LINES, LINES, 3)
    grids = (places, places.swapaxes(0, 1))
    # A level line is straight: its ends are enough.
    step = LINES - 1 if height is flat else 1
    return [sheet.shape("line", line[::step], look) for grid in grids for line in grid]
