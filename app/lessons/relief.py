"""Relief displacement: the top of a tower leans away from the nadir."""

from itertools import pairwise

import numpy as np

from app.lessons import sheet, space
from app.lessons.photo import HALF_MM, camera_with, on_film, on_ground, vertical_at
from core.arrays import FilmPoints
from core.geometry.collinearity import film_from_object, object_from_film
from core.geometry.exterior import ExteriorOrientation
from core.geometry.image_corrections import relief_displacement_mm

SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
"""Plan of the tower."""


def view(state: sheet.State) -> sheet.View:
    """The tower in space and on the film."""
    r, h, above = state["r"], state["h"], state["H"]
    camera, exterior = camera_with(state["c"]), vertical_at(0.0, above)
    top, flat = (
        float(object_from_film(on_film((r, 0)), np.array([level]), exterior, camera)[0, 0])
        for level in (h, 0.0)
    )
    foot = float(film_from_object(on_ground((top, 0, 0)), exterior, camera)[0, 0])
    leans = float(relief_displacement_mm(np.array([r]), np.array([h]), above)[0])
    radii = np.linspace(0, HALF_MM, 24)
    lean = relief_displacement_mm(radii, np.full(24, h), above)
    shown = top if state["roof"] else flat
    shift, error = sheet.Number(leans, 2, "mm"), sheet.Number(shown - top, 1, "m")
    film = sheet.Canvas(
        "film",
        (-HALF_MM * 1.06, -HALF_MM * 1.06, HALF_MM * 1.06, HALF_MM * 1.06),
        (
            sheet.shape("area", sheet.frame_of(HALF_MM), "film"),
            sheet.shape("line", [(0, 0), (foot, 0)], "faint"),
            sheet.shape("arrow", [(foot, 0), (r, 0)], "bad", "leans", number=shift),
            sheet.shape("crosses", [(0, 0)], "axis", "nadir"),
            sheet.shape("dots", [(foot, 0)], "given", "foot", below=True),
        ),
        "mm",
    )
    figures = {
        "leans": shift,
        "foot": sheet.Number(foot, 2, "mm"),
        "ground": error,
        "distance": sheet.Number(top, 0, "m"),
    }
    scene = tower_in_space(
        exterior, state["c"], np.array([[foot, 0.0], [r, 0.0]]), h, bool(state["roof"])
    )
    plot = sheet.Plot("r", "leans", (sheet.curve("leans", radii, lean),), (r, leans))
    return sheet.View(figures, (scene, film), {"Δr": shift}, plot)


def tower_in_space(
    exterior: ExteriorOrientation, c: float, film: FilmPoints, h: float, roof: bool
) -> sheet.Canvas:
    """The tower, the rays to its foot and top, and where an ortho puts the top."""
    centre, camera = exterior.centre, camera_with(c)
    above = float(centre[2])
    levels = np.array([0.0, h if roof else 0.0])
    foot, shown = object_from_film(film, levels, exterior, camera)
    shown[2] = 0.0
    top = foot + np.array([0.0, 0.0, h])
    edge = HALF_MM / c * above
    times = 0.2 * edge / HALF_MM * 1000
    marks = space.in_space(film, exterior, c, times)
    half = 0.03 * edge
    walls = [
        sheet.shape("area", [foot + a, foot + b, top + b, top + a], "given")
        for a, b in pairwise(half * np.array([[*at, 0.0] for at in (*SQUARE, SQUARE[0])]))
    ]
    error = sheet.Number(float(shown[0] - foot[0]), 1, "m")
    shapes = (
        *space.ground(-0.4 * edge, -0.5 * edge, edge, 0.5 * edge),
        *space.photo(exterior, c, times, "O"),
        sheet.shape("line", [centre, np.zeros(3)], "axis"),
        sheet.shape("text", [np.zeros(3)], "axis", "nadir"),
        *walls,
        sheet.shape("text", [top], "given", "tower"),
        *space.rays(centre, [foot], "faint"),
        *space.rays(centre, [top if roof else shown]),
        sheet.shape("arrow", marks, "bad"),
        sheet.shape("arrow", [foot, shown], "bad", number=error, below=True),
    )
    return sheet.Canvas("scene", (-0.4 * edge, -0.5 * edge, 0.0, edge, 0.5 * edge, above), shapes)


def ask(rng: np.random.Generator) -> sheet.Asked:
    """A chimney whose lean was measured."""
    r, above = float(rng.integers(60, 111)), float(rng.integers(10, 31) * 100)
    height = float(rng.integers(20, 121))
    lean = relief_displacement_mm(np.array([r]), np.array([height]), above)
    return sheet.Asked({"r": r, "H": above, "dr": float(lean[0])}, height)


LESSON = sheet.Lesson(
    "relief",
    "d",
    (
        sheet.Slider("h", 0, 300, 150, 1, "m", "h"),
        sheet.Slider("H", 600, 6000, 1500, 10, "m", "H"),
        sheet.Slider("r", 5, 115, 90, 1, "mm", "r"),
        sheet.Slider("c", 85, 300, 152, 1, "mm"),
        sheet.Slider("roof", 0, 1, 0, 1),
    ),
    view,
    (sheet.Equation("Δr", sheet.over(sheet.row("r", "*", "h"), "H")),),
    (sheet.Question("height", "m", 2.0, ask, 0),),
)
