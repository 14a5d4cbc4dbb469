"""Interior orientation: fiducials tell what film and scanner did to the frame."""

from dataclasses import replace

import numpy as np

from app.lessons import sheet
from app.lessons.photo import PIXEL_MM, camera_with, on_film, vertical_at
from core.arrays import FilmPoints, PixelPoints
from core.doubts import Failure
from core.geometry.collinearity import object_from_film
from core.geometry.interior import InteriorOrientation, film_shape
from core.geometry.interior_models import FilmFit, FilmModel, fit_film, warp_film

MODELS: tuple[FilmModel, ...] = ("similarity", "affine", "projective")
NEAR, FAR = 0.0, 106.0
MARKS = np.array([(x, y) for x in (-FAR, NEAR, FAR) for y in (-FAR, NEAR, FAR) if (x, y) != (0, 0)])
"""Eight fiducials: corners and middles of the sides."""
HALF = 115.0
TIMES = (400, 300, 200, 100, 50, 20, 10)
"""Residuals and principal point are drawn so many times: the most that leaves them in view."""
EDGE = 1.16 * HALF
PRINCIPAL_MM, HEIGHT_M, HILL_M = 152.0, 1500.0, 100.0
"""The photo in which the principal point is forgotten, and a hill in it."""


def scanned(state: sheet.State) -> PixelPoints:
    """Where the marks lie in the scan of a film that shrank and was bent."""
    along = np.array([1 - state["shrink_x"] / 1000, 1 - state["shrink_y"] / 1000])
    sheared = MARKS * along + np.column_stack(
        [state["shear"] / 1000 * MARKS[:, 1], np.zeros(len(MARKS))]
    )
    bent = warp_film(sheared, np.array([state["bend"] * 1e-6, 0.0]), "projective")
    rng = np.random.default_rng(int(state["seed"]))
    noisy = bent + rng.normal(0, state["noise"] / 1000, bent.shape)
    return np.column_stack([noisy[:, 0] + HALF, HALF - noisy[:, 1]]) / PIXEL_MM


def fitted(model: FilmModel, pixels: PixelPoints) -> FilmFit:
    """One model on all marks."""
    fit = fit_film(model, pixels, MARKS, np.full(len(MARKS), 0.005))
    assert not isinstance(fit, Failure), fit.reason
    return fit


def view(state: sheet.State) -> sheet.View:
    """Residuals of the chosen model at the marks, and what it found of the film."""
    pixels = scanned(state)
    fits = [fitted(model, pixels) for model in MODELS]
    fit = fits[int(state["model"])]
    interior = InteriorOrientation(
        fit.model,
        fit.matrix,
        tuple(str(i) for i in range(len(MARKS))),
        pixels,
        fit.residuals * 1000,
        fit.sigma,
        fit.warp,
    )
    found = film_shape(interior, PIXEL_MM)
    figures = {
        "rms": sheet.Number(1000 * fit.rms, 1, "µm"),
        "sigma": sheet.Number(1000 * fit.sigma, 1, "µm"),
        "shrink_x": sheet.Number(1000 * (1 - found.scale_x), 2, "‰", state["shrink_x"]),
        "shrink_y": sheet.Number(1000 * (1 - found.scale_y), 2, "‰", state["shrink_y"]),
        "shear": sheet.Number(found.shear_mrad, 2, "mrad", state["shear"]),
    }
    principal = (state["x0"], state["y0"])
    aside, on_hill = forgotten(principal)
    figures["aside"] = sheet.Number(float(np.hypot(*aside)), 2, "m")
    figures["hill"] = sheet.Number(float(np.hypot(*(aside - on_hill))), 2, "m")
    sigmas = sheet.curve("sigma", range(3), [1000 * one.sigma for one in fits])
    plot = sheet.Plot("model", "sigma", (sigmas,), (state["model"], 1000 * fit.sigma), "model")
    symbols = {
        "r": sheet.Number(fit.redundancy, 0),
        "m": sheet.Number(len(MARKS), 0),
        "u": sheet.Number(2 * len(MARKS) - fit.redundancy, 0),
    } | last_mark(fit, pixels[-1], state["x0"])
    shown = (REDUNDANCY, *(PROJECTED if fit.model == "projective" else (LAID,)), REDUCED)
    times = enlarged(fit.residuals, principal)
    figures["times"] = sheet.Number(times, 0)
    frame = film(fit.residuals, principal, times)
    return sheet.View(figures, (frame,), symbols, plot, equations=shown)


def last_mark(fit: FilmFit, pixel: np.ndarray, x0_mm: float) -> dict[str, sheet.Number]:
    """The way of the mark in the upper right corner from scan to film along x."""
    (a_1, a_2, a_3), (w_1, w_2) = fit.matrix[0].tolist(), fit.warp.tolist()
    flat = fit.matrix @ np.append(pixel, 1.0)
    x_mm = float(MARKS[-1, 0] + fit.residuals[-1, 0])
    return {
        "a_1": sheet.Number(1000 * a_1, 4, "µm"),
        "a_2": sheet.Number(1000 * a_2, 4, "µm"),
        "a_3": sheet.Number(a_3, 3, "mm"),
        "w_1": sheet.Number(1e6 * w_1, 2, "·10⁻⁶/mm"),
        "w_2": sheet.Number(1e6 * w_2, 2, "·10⁻⁶/mm"),
        "k": sheet.Number(float(pixel[0]), 1),
        "l": sheet.Number(float(pixel[1]), 1),
        "x_A": sheet.Number(float(flat[0]), 3, "mm"),
        "y_A": sheet.Number(float(flat[1]), 3, "mm"),
        "x_F": sheet.Number(x_mm, 3, "mm"),
        "x": sheet.Number(x_mm - x0_mm, 3, "mm"),
    }


def forgotten(principal_mm: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """How far aside a photo shows the ground, and a hill, counted from its fiducial centre, m."""
    exterior, middle = vertical_at(0.0, HEIGHT_M), on_film((0.0, 0.0))
    camera = camera_with(PRINCIPAL_MM)
    true = replace(camera, principal_point_mm=principal_mm)
    ground, hill = (
        object_from_film(middle, np.array([level]), exterior, camera)[0, :2]
        - object_from_film(middle, np.array([level]), exterior, true)[0, :2]
        for level in (0.0, HILL_M)
    )
    return ground, hill


def enlarged(residuals: FilmPoints, principal_mm: tuple[float, float]) -> int:
    """How many times their size arrows are drawn so that all of them end within the drawing."""

    def within(times: int) -> bool:
        ends = np.vstack([MARKS + times * residuals, times * np.array(principal_mm)])
        return bool(np.abs(ends).max() < EDGE)

    return next((times for times in TIMES if within(times)), 1)


def film(residuals: FilmPoints, principal_mm: tuple[float, float], times: int) -> sheet.Canvas:
    """The frame with its marks, their residuals and its principal point, so many times."""
    ends = MARKS + times * residuals
    lengths = 1000 * np.hypot(*residuals.T)
    return sheet.Canvas(
        "film",
        (-EDGE, -EDGE, EDGE, EDGE),
        (
            sheet.shape("area", sheet.frame_of(HALF), "film"),
            sheet.shape("line", [(-FAR, 0), (FAR, 0)], "faint"),
            sheet.shape("line", [(0, -FAR), (0, FAR)], "faint"),
            sheet.shape("crosses", MARKS, "given"),
            sheet.shape("text", [(0, 0)], "axis", "centre"),
            sheet.shape(
                "arrow",
                [(0.0, 0.0), (times * principal_mm[0], times * principal_mm[1])],
                "estimate",
                "principal",
                number=sheet.Number(1000 * float(np.hypot(*principal_mm)), 0, "µm"),
                below=True,
            ),
            *(
                sheet.shape(
                    "arrow", [mark, end], "bad", number=sheet.Number(float(length), 0, "µm")
                )
                for mark, end, length in zip(MARKS.tolist(), ends.tolist(), lengths, strict=True)
            ),
        ),
        "mm",
    )


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How far uneven shrinkage moves a corner when it is not corrected."""
    shrink = float(rng.integers(2, 11)) / 10
    side = float(rng.choice([180, 230]))
    flat = np.array([[side / 2, side / 2]])
    moved = flat - flat * (1 - shrink / 1000)
    return sheet.Asked({"shrink": shrink, "side": side}, 1000 * float(moved[0, 0]))


REDUNDANCY = sheet.Equation("r", sheet.row("2", "*", "m", "−", "u"))
ON_FILM = sheet.row("a_1", "*", "k", "+", "a_2", "*", "l", "+", "a_3")
LAID = sheet.Equation("x_F", ON_FILM)
PROJECTED = (
    sheet.Equation("x_A", ON_FILM),
    sheet.Equation(
        "x_F",
        sheet.over("x_A", sheet.row("1", "+", "w_1", "*", "x_A", "+", "w_2", "*", "y_A")),
    ),
)
"""A projective model goes on from an affine one."""
REDUCED = sheet.Equation("x", sheet.row("x_F", "−", "x_0"))
LESSON = sheet.Lesson(
    "interior",
    "a",
    (
        sheet.Slider("model", 0, 2, 0, 1),
        sheet.Slider("shrink_x", -1, 3, 1.2, 0.05, "‰"),
        sheet.Slider("shrink_y", -1, 3, 0.6, 0.05, "‰"),
        sheet.Slider("shear", -1, 1, 0.2, 0.02, "mrad"),
        sheet.Slider("bend", -5, 5, 0, 0.1, "·10⁻⁶/mm"),
        sheet.Slider("x0", -0.25, 0.25, 0.08, 0.005, "mm", "x_0"),
        sheet.Slider("y0", -0.25, 0.25, -0.05, 0.005, "mm"),
        sheet.NOISE,
        sheet.SEED,
    ),
    view,
    (REDUNDANCY, LAID, REDUCED),
    (sheet.Question("shrink", "µm", 2.0, ask, 0),),
    hides_truth=True,
)
