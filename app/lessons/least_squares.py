"""Least squares: residuals, redundancy, and a gross error that hides where nothing checks it."""

from pathlib import Path

import numpy as np

from app.lessons import sheet
from app.lessons.photo import HALF_MM, PIXEL_MM, photo_model, vertical_at
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.reliability import NONCENTRALITY
from core.block import Block, ExteriorPrior, Measurement, Photo, SurveyedPoint
from core.geometry.collinearity import object_from_film

C_MM, ABOVE_M = 152.0, 1500.0
PLACES = ((-80, 75), (85, 70), (75, -85), (-80, -80), (0, 60), (70, 0), (0, -70), (-65, 5))
"""Where the points lie on the film, millimetres."""
LIFTS_M = np.array([0, 60, -30, 20, 40, -50, 10, -20], dtype=np.float64)
MOST = len(PLACES)
LOOSE = ExteriorPrior(np.full(3, 500.0), np.full(3, 0.5))
TRUTH = vertical_at(0.0, ABOVE_M)
UNCHECKED = 1e-4
"""Less redundancy than this is what rounding leaves of nought."""
TIMES = 5.0
"""Arrows are so many times as long as what they show, at 15 um a pixel."""


def block_of(state: sheet.State) -> Block:
    """One photo with as many points as are wanted, point 1 where the hand put it."""
    model, count = photo_model(C_MM), int(state["count"])
    spots = np.array([(state["x1"], state["y1"]), *PLACES[1:]], dtype=np.float64)[:count]
    ground = object_from_film(spots, LIFTS_M[:count], TRUTH, model.camera)
    rng = np.random.default_rng(int(state["seed"]))
    sigma = state["sigma"]
    pixels = model.pixels(ground, TRUTH) + rng.normal(0, sigma, (MOST, 2))[:count]
    wrong = min(int(state["which"]), count) - 1
    pixels[wrong, 0] += state["error"]
    side = round(2 * HALF_MM / PIXEL_MM)
    photo = Photo(
        "photo",
        Path("photo.tif"),
        (side, side),
        "lesson",
        model.interior,
        TRUTH,
        TRUTH,
        LOOSE,
        0.0,
        True,
        corrections=(),
    )
    surveyed = {
        f"{i}": SurveyedPoint(f"{i}", place, np.full(3, 0.001), "control", "surveyed")
        for i, place in enumerate(ground, 1)
    }
    measured = [
        Measurement(f"{i}", "photo", float(column), float(row), sigma)
        for i, (column, row) in enumerate(pixels, 1)
    ]
    return Block(
        "EPSG:5514",
        {"lesson": model.camera},
        {"photo": photo},
        surveyed,
        {one.key: one for one in measured},
    )


def adjusted(state: sheet.State) -> AdjustmentReport:
    """The adjustment, with or without data snooping."""
    snoop = bool(state["snoop"])
    return adjust_block(block_of(state), AdjustmentOptions(estimate_cameras=False, robust=snoop))


def view(state: sheet.State) -> sheet.View:
    """Residuals at the points, circles as large as what is controlled of them."""
    report, count = adjusted(state), int(state["count"])
    key = (f"{min(int(state['which']), count)}", "photo")
    redundancy = report.redundancy_numbers.get(key, 0.0)
    residual = float(np.hypot(*report.residuals_px[key]))
    sigma = state["sigma"]
    exterior = report.block.photos["photo"].exterior
    moved = float(np.linalg.norm(exterior.centre - TRUTH.centre))
    figures = {
        "residual": sheet.Number(residual, 2, "px"),
        "redundancy": sheet.Number(redundancy, 2),
        "sigma_nought": sheet.Number(report.sigma_nought, 2, "", 1.0),
        "moved": sheet.Number(moved, 2, "m"),
        "left_out": sheet.Number(len(report.rejected), 0),
    }
    errors = np.array([-40.0, 0.0, 40.0])
    line = sheet.curve("expected", errors, redundancy * np.abs(errors))
    plot = sheet.Plot("error", "residual", (line,), (state["error"], residual))
    symbols = {
        "r": sheet.Number(report.redundancy, 0),
        "n": sheet.Number(count - len(report.rejected), 0),
        "δ": sheet.Number(NONCENTRALITY, 2),
    }
    # Of a measurement that nothing controls no error is found, however large.
    if redundancy > UNCHECKED:
        least = sheet.Number(NONCENTRALITY * sigma / float(np.sqrt(redundancy)), 1, "px")
        figures["least"] = symbols["∇"] = least
        symbols["r_i"] = sheet.Number(redundancy, 2)
    return sheet.View(figures, (drawing(state, report),), symbols, plot)


def drawing(state: sheet.State, report: AdjustmentReport) -> sheet.Canvas:
    """The film: points with the residual of each, and with what was put in."""
    edge, shapes = 1.12 * HALF_MM, list[sheet.Shape]()
    for (name, _), (column, row) in report.residuals_px.items():
        item = report.block.measurements[name, "photo"]
        spot = report.block.photos["photo"].interior.film_from_pixel(item.pixel)[0]
        share = report.redundancy_numbers.get((name, "photo"), 0.0)
        ring = sheet.ellipse(spot, np.eye(2) * (3 + 9 * share) ** 2)
        out = (name, "photo") in report.rejected
        # A residual is computed minus measured; rows count downwards.
        end = spot + TIMES * np.array([column, -row])
        shapes += [
            sheet.shape("line", ring, "faint"),
            sheet.shape("arrow", [spot, end], "faint" if out else "bad"),
            sheet.shape(
                "dots", [spot], "bad" if out else "given", name, number=sheet.Number(share, 2)
            ),
        ]
    wrong = min(int(state["which"]), int(state["count"])) - 1
    spot = np.array([(state["x1"], state["y1"]), *PLACES[1:]], dtype=np.float64)[wrong]
    put = sheet.shape("arrow", [spot, spot - [TIMES * state["error"], 0.0]], "truth")
    knob = sheet.shape("dots", [(state["x1"], state["y1"])], "ray", handle=("x1", "y1"))
    area = sheet.shape("area", sheet.frame_of(HALF_MM), "film")
    return sheet.Canvas("film", (-edge, -edge, edge, edge), (area, put, *shapes, knob), "mm")


def ask(rng: np.random.Generator) -> sheet.Asked:
    """What is seen of an error."""
    state = dict(LESSON.start) | {"error": 0.0, "sigma": 0.1, "count": float(rng.integers(4, 9))}
    error = float(rng.integers(10, 31))
    share = adjusted(state).redundancy_numbers["1", "photo"]
    return sheet.Asked({"error": error, "r": round(share, 2)}, round(share, 2) * error)


LESSON = sheet.Lesson(
    "least_squares",
    "h",
    (
        sheet.Slider("x1", -105, 105, -80, 1, "mm", moved_in="film"),
        sheet.Slider("y1", -105, 105, 75, 1, "mm", moved_in="film"),
        sheet.Slider("count", 3, 8, 6, 1),
        sheet.Slider("which", 1, 8, 1, 1),
        sheet.Slider("error", -40, 40, 15, 0.5, "px"),
        sheet.Slider("sigma", 0.1, 5, 1, 0.1, "px", "σ"),
        sheet.Slider("snoop", 0, 1, 0, 1),
        sheet.SEED,
    ),
    view,
    (
        sheet.Equation("r", sheet.row("2", "*", "n", "−", "6")),
        sheet.Equation("∇", sheet.over(sheet.row("δ", "*", "σ"), sheet.root("r_i"))),
    ),
    (sheet.Question("seen", "px", 0.3, ask),),
    hides_truth=True,
)
