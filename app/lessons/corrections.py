"""Image coordinates: refraction, Earth curvature and lens move an image point along its radius."""

from dataclasses import replace

import numpy as np

from app.lessons import sheet
from app.lessons.photo import HALF_MM, camera_with
from core.arrays import Scalars
from core.geometry.camera import radial_factor
from core.geometry.collinearity import BERTRAM, EARTH_RADIUS_M, refraction_constant
from core.geometry.image_corrections import curvature_um, photo_scale, refraction_um

TABLE_MM = 129.0
"""Radius that all rows of table 4.2 fit, which names none."""
LOOKS: dict[str, sheet.Look] = {"refraction": "estimate", "curvature": "bad", "lens": "second"}
GRID = np.linspace(-0.9 * HALF_MM, 0.9 * HALF_MM, 7)


def lens_k1(state: sheet.State) -> float:
    """The lens's k1, per square millimetre."""
    return state["lens"] / 1000 / 100.0**3


def moves_um(radius_mm: Scalars, state: sheet.State) -> dict[str, Scalars]:
    """Refraction and lens outwards, curvature inwards, micrometres; below the ground the lens."""
    camera = camera_with(state["c"], lens_k1(state))
    lens = radius_mm * (radial_factor(radius_mm**2, camera) - 1) * 1000
    above = state["H"] - state["h"]
    if above <= 0:
        return {"lens": lens}
    refraction = refraction_um(radius_mm, state["c"], refraction_constant(state["H"], state["h"]))
    earth = -curvature_um(radius_mm, state["c"], above)
    return {"refraction": refraction, "curvature": earth, "lens": lens}


def view(state: sheet.State) -> sheet.View:
    """Three curves over the radius, and their sum as arrows on the film."""
    radii = np.linspace(0, 160, 41)
    parts = moves_um(radii, state)
    here = {name: float(p[0]) for name, p in moves_um(np.array([state["r"]]), state).items()}
    total = sum(here.values())
    x, y = (axis.ravel() for axis in np.meshgrid(GRID, GRID))
    away = np.hypot(x, y)
    sums = np.sum(list(moves_um(away, state).values()), axis=0)
    share = state["times"] * sums / 1000 / np.maximum(away, 1e-9)
    arrows = [
        sheet.shape("arrow", [(a, b), (a * (1 + s), b * (1 + s))], "bad" if s < 0 else "estimate")
        for a, b, s in zip(x, y, share, strict=True)
    ]
    curves = [sheet.curve(name, radii, part, LOOKS[name]) for name, part in parts.items()]
    plot = sheet.Plot("r", "moves", tuple(curves), (state["r"], total))
    figures = {name: sheet.Number(value, 1, "µm") for name, value in here.items()}
    canvases = (film(state, arrows),)
    lens = sheet.Number(1e8 * lens_k1(state), 1, "·10⁻⁸/mm²")
    symbols = heights(state) | {"Δr_l": figures["lens"], "k_1": lens}
    if "curvature" not in figures:
        return sheet.View(figures, canvases, symbols, plot, warning="below")
    whole = sheet.curve("sum", radii, np.sum(list(parts.values()), axis=0), "given")
    plot = replace(plot, curves=(*curves, whole))
    scale = photo_scale(state["c"], state["H"], state["h"])
    figures |= {
        "sum": sheet.Number(total, 1, "µm"),
        "ground": sheet.Number(total / 1e6 / scale, 2, "m"),
        "scale": sheet.Number(1 / scale, 0),
    }
    symbols |= {
        "Δr_e": figures["curvature"],
        "K": sheet.Number(1e6 * refraction_constant(state["H"], state["h"]), 1, "·10⁻⁶"),
        "Δr_a": figures["refraction"],
    }
    # Four of the five find room: without a lens that of the air, with one that of the lens.
    equations = (LENS, *BOTH) if state["lens"] else (BELOW, *BOTH)
    return sheet.View(figures, canvases, symbols, plot, equations=equations)


def heights(state: sheet.State) -> dict[str, sheet.Number]:
    """What the formulas have in kilometres, and the air below both heights."""
    return {
        "H": sheet.Number(state["H"] / 1000, 1, "km"),
        "h": sheet.Number(state["h"] / 1000, 2, "km"),
        "R": sheet.Number(EARTH_RADIUS_M / 1000, 0, "km"),
        "K_H": air_below(state["H"]),
        "K_h": air_below(state["h"]),
    }


def air_below(height_m: float) -> sheet.Number:
    """The constant of refraction of a photo of ground at the sea."""
    return sheet.Number(1e6 * refraction_constant(height_m, 0.0), 1, "·10⁻⁶")


def film(state: sheet.State, arrows: list[sheet.Shape]) -> sheet.Canvas:
    """The frame with what moves its points, and the radius that the figures are told for."""
    edge = 1.12 * HALF_MM
    turn = np.linspace(0, 2 * np.pi, 73)
    ring = state["r"] * np.column_stack([np.cos(turn), np.sin(turn)])
    shapes = (
        sheet.shape("area", sheet.frame_of(HALF_MM), "film"),
        *arrows,
        sheet.shape("line", ring, "axis", "radius"),
        sheet.shape("crosses", [(0, 0)], "axis", "point"),
    )
    return sheet.Canvas("film", (-edge, -edge, edge, edge), shapes, "mm")


def ask_curvature(rng: np.random.Generator) -> sheet.Asked:
    """A row of table 4.2, inwards."""
    c = float(rng.choice([85, 150, 210, 300]))
    scale = float(rng.choice([5000, 10000, 20000, 30000]))
    moved = curvature_um(np.array([TABLE_MM]), c, scale * c / 1000)
    return sheet.Asked({"c": c, "scale": scale, "r": TABLE_MM}, -float(moved[0]))


FACTOR, LINEAR, CONSTANT = (f"{number:g}" for number in BERTRAM)
AIR = sheet.row(
    sheet.over(
        sheet.row(FACTOR, "*", "H"),
        sheet.row(sheet.power("H", "2"), "−", LINEAR, "*", "H", "+", CONSTANT),
    ),
    "*", sheet.power("10", "−6"),
)  # fmt: skip
"""The air below the aircraft, as `refraction_constant` has it; below the ground it is the same."""
RADIAL = sheet.fence(sheet.row("r", "+", sheet.over(sheet.power("r", "3"), sheet.power("c", "2"))))
EARTH = sheet.over(
    sheet.row(sheet.fence(sheet.row("H", "−", "h")), "*", sheet.power("r", "3")),
    sheet.row("2", "*", "R", "*", sheet.power("c", "2")),
)
BELOW, LENS = (
    sheet.Equation("K_H", AIR),
    sheet.Equation("Δr_l", sheet.row("k_1", "*", sheet.power("r", "3"))),
)
BOTH = (
    sheet.Equation("K", sheet.row("K_H", "−", "K_h", "*", sheet.over("h", "H"))),
    sheet.Equation("Δr_a", sheet.row("K", "*", RADIAL)),
    sheet.Equation("Δr_e", sheet.row("−", EARTH)),
)
LESSON = sheet.Lesson(
    "corrections",
    "b",
    (
        sheet.Slider("H", 600, 16000, 4500, 100, "m", "H"),
        sheet.Slider("h", 0, 2000, 300, 50, "m", "h"),
        sheet.Slider("c", 85, 310, 152, 1, "mm", "c"),
        sheet.Slider("r", 0, 160, 130, 1, "mm", "r"),
        sheet.Slider("lens", -30, 30, 0, 1, "µm"),
        sheet.Slider("times", 100, 2000, 500, 100),
    ),
    view,
    (BELOW, *BOTH),
    (sheet.Question("curvature", "µm", 2.0, ask_curvature, 0, signed=True),),
)
