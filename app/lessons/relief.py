"""Relief displacement: the top of a tower leans away from the nadir."""

import numpy as np

from app.lessons import sheet
from app.lessons.photo import HALF_MM, camera_with, on_film, on_ground, vertical_at
from core.geometry.collinearity import film_from_object, object_from_film
from core.geometry.image_corrections import relief_displacement_mm


def view(state: sheet.State) -> sheet.View:
    """The tower in a section and on the film."""
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
    shift, error = sheet.Number(leans, 2, "mm"), sheet.Number(flat - top, 1, "m")
    reach = max(1.15 * flat, 0.5 * above)
    section = sheet.Canvas(
        "section",
        (-0.12 * reach, -0.1 * above, reach, 1.06 * above),
        (
            sheet.shape("line", [(-reach, 0), (2 * reach, 0)], "ground"),
            sheet.shape("line", [(0, above), (0, 0)], "axis", "plumb"),
            sheet.shape("line", [(0, above), (flat, 0)], "ray"),
            sheet.shape("line", [(0, above), (top, 0)], "faint"),
            sheet.shape("line", [(top, 0), (top, h)], "given", "tower"),
            sheet.shape("arrow", [(top, 0), (flat, 0)], "bad", number=error, below=True),
            sheet.shape("dots", [(0, above)], "estimate", "O"),
            sheet.shape("text", [(0, 0)], "axis", "nadir"),
        ),
    )
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
    plot = sheet.Plot("r", "leans", (sheet.curve("leans", radii, lean),), (r, leans))
    return sheet.View(figures, (section, film), {"Δr": shift}, plot)


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
    ),
    view,
    (sheet.Equation("Δr", sheet.over(sheet.row("r", "*", "h"), "H")),),
    (sheet.Question("height", "m", 2.0, ask, 0),),
)
