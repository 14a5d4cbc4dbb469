"""Least squares: residuals, redundancy, and a gross error that hides where nothing checks it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.lessons import sheet
from app.lessons.photo import HALF_MM, PIXEL_MM, photo_model, vertical_at
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.adjustment.reliability import NONCENTRALITY
from core.block import Block, ExteriorPrior, Measurement, Photo, SurveyedPoint
from core.geometry.collinearity import object_from_film

C_MM, ABOVE_M = 152.0, 1500.0
PLACES = ((-80, 75), (85, 70), (75, -85), (-80, -80), (0, 60), (70, 0), (0, -70), (-65, 5))
"""Where the points lie on the film, millimetres."""
LIFTS_M = np.array([0, 60, -30, 20, 40, -50, 10, -20], dtype=np.float64)
MOST = len(PLACES)
LOOSE = ExteriorPrior(np.full(3, 1e5), np.full(3, 1e2))
"""So weak that points alone decide, whatever they are: 100 km, 100 rad."""
HELD = AdjustmentOptions(estimate_cameras=False, robust=False)
UNKNOWNS = 6
TRUTH = vertical_at(0.0, ABOVE_M)
SHOWN = 0.005
"""A redundancy number, or a residual in pixels, below this is shown as nought."""
EQUATIONS = (
    sheet.Equation("r", sheet.row("2", "*", "n", "−", "6")),
    sheet.Equation("∇", sheet.over(sheet.row("δ", "*", "σ"), sheet.root("r_i"))),
)
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
    pixels[wrong_point(state) - 1, 0] += state["error"]
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


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A photo on its points."""

    report: AdjustmentReport
    """Its adjustment."""
    shares: dict[str, float]
    """Redundancy numbers of the columns; of points left out, those from before."""
    redundancy: int
    """Observations that took part, minus unknowns."""
    stands: bool
    """Whether there is a place from which the photo sees these points so."""


def found_in(state: sheet.State) -> Found:
    """The adjustment, with or without data snooping."""
    block = block_of(state)
    report = adjust_block(block, HELD)
    shares = column_shares(report)
    if state["snoop"]:
        report = adjust_block(block, AdjustmentOptions(estimate_cameras=False))
        shares |= column_shares(report)
    used = [report.residuals_px[key] for key in report.redundancy_numbers]
    redundancy = 2 * len(used) - UNKNOWNS
    # Three points leave no residual, unless no camera sees them so.
    stands = redundancy > 0 or (redundancy == 0 and float(np.abs(used).max()) < SHOWN)
    return Found(report, shares, redundancy, stands)


def column_shares(report: AdjustmentReport) -> dict[str, float]:
    """Redundancy number of the column of every measurement that took part, by point."""
    keys = report.redundancy_numbers
    if 2 * len(keys) <= UNKNOWNS:
        return {point: 0.0 for point, _ in keys}
    influence = influence_of(report, HELD)
    assert influence is not None, "the photo takes part"
    network, computed = influence.solution.network, influence.solution.precision.rays[0]
    return {
        network.measurements[network.rays.measurement[ray]].point_id: 1 - float(computed[ray])
        for ray in influence.control_rays
    }


def wrong_point(state: sheet.State) -> int:
    """Number of the point with the gross error: the last one where there are fewer."""
    return min(int(state["which"]), int(state["count"]))


def view(state: sheet.State) -> sheet.View:
    """Residuals at the points, circles as large as what is controlled of them."""
    found, wrong = found_in(state), wrong_point(state)
    report, key = found.report, (f"{wrong}", "photo")
    out = key in report.rejected
    exterior = report.block.photos["photo"].exterior
    moved = float(np.linalg.norm(exterior.centre - TRUTH.centre))
    # The error is one of columns: so are what is left of it, and what controls it.
    residual = abs(report.residuals_px[key][0])
    if found.redundancy == 0 and not out:
        residual = 0.0
    figures = {
        "wrong": sheet.Number(wrong, 0),
        "residual": sheet.Number(residual if found.stands else np.nan, 2, "px"),
        "redundancy": sheet.Number(found.shares[key[0]], 2),
        "sigma_nought": sheet.Number(
            report.sigma_nought if found.redundancy > 0 else np.nan, 2, "", 1.0
        ),
        "moved": sheet.Number(moved if found.stands else np.nan, 2, "m"),
        "left_out": sheet.Number(len(report.rejected), 0),
    }
    symbols = {
        "r": sheet.Number(found.redundancy, 0),
        "n": sheet.Number((found.redundancy + UNKNOWNS) / 2, 0),
        "δ": sheet.Number(NONCENTRALITY, 2),
    }
    # Of a measurement that nothing controls no error is found, however large.
    if found.shares[key[0]] > SHOWN:
        share = found.shares[key[0]]
        least = sheet.Number(NONCENTRALITY * state["sigma"] / float(np.sqrt(share)), 1, "px")
        figures["least"] = symbols["∇"] = least
        symbols["r_i"] = sheet.Number(share, 2)
    warning = "nowhere" if not found.stands else "left_out" if out else ""
    plot = plot_of(state, found.shares[key[0]], residual) if found.stands else None
    return sheet.View(
        figures,
        (drawing(state, found),),
        symbols,
        plot,
        # Without a redundancy number the second has nothing to say.
        equations=EQUATIONS[: 2 if "least" in figures else 1],
        warning=warning,
    )


def plot_of(state: sheet.State, share: float, residual: float) -> sheet.Plot:
    """What an error leaves in the residual, and what this one does."""
    errors = np.array([-40.0, 0.0, 40.0])
    lines = (
        sheet.curve("expected", errors, share * np.abs(errors)),
        # Of a point left out the residual is this; and the axis is the same in every state.
        sheet.curve("whole", errors, np.abs(errors), "second"),
    )
    return sheet.Plot("error", "residual", lines, (state["error"], residual))


def drawing(state: sheet.State, found: Found) -> sheet.Canvas:
    """The film: points with the residual of each, and with what was put in."""
    report = found.report
    edge, shapes = 1.12 * HALF_MM, list[sheet.Shape]()
    for (name, _), (column, row) in report.residuals_px.items():
        item = report.block.measurements[name, "photo"]
        spot = report.block.photos["photo"].interior.film_from_pixel(item.pixel)[0]
        ring = sheet.ellipse(spot, np.eye(2) * (3 + 9 * found.shares[name]) ** 2)
        out = (name, "photo") in report.rejected
        shapes.append(sheet.shape("line", ring, "faint"))
        if found.stands:
            # A residual is computed minus measured; rows count downwards.
            end = spot + TIMES * np.array([column, -row])
            shapes.append(sheet.shape("arrow", [spot, end], "faint" if out else "bad"))
        label, number = name, sheet.Number(found.shares[name], 2)
        if out:
            label, number = "out", sheet.Number(float(name), 0)
        shapes.append(sheet.shape("dots", [spot], "bad" if out else "given", label, number=number))
    spots = [(state["x1"], state["y1"]), *PLACES[1:]]
    spot = np.array(spots, dtype=np.float64)[wrong_point(state) - 1]
    put = sheet.shape("arrow", [spot, spot - [TIMES * state["error"], 0.0]], "truth")
    knob = sheet.shape("dots", [(state["x1"], state["y1"])], "ray", handle=("x1", "y1"))
    area = sheet.shape("area", sheet.frame_of(HALF_MM), "film")
    return sheet.Canvas("film", (-edge, -edge, edge, edge), (area, put, *shapes, knob), "mm")


def ask(rng: np.random.Generator) -> sheet.Asked:
    """What is seen of an error."""
    state = dict(LESSON.start) | {"error": 0.0, "sigma": 0.1, "count": float(rng.integers(4, 9))}
    error = float(rng.integers(10, 31))
    share = found_in(state).shares["1"]
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
    EQUATIONS,
    (sheet.Question("seen", "px", 0.3, ask),),
    hides_truth=True,
)
