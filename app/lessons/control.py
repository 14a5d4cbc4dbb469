"""Control and its distribution: how far from the nearest point a block is still known."""

from functools import lru_cache

import numpy as np

from app.lessons import sheet
from app.lessons.flight import Flight, Plan, fly
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.arrays import Matrix
from core.block import footprint

STRIPS, PHOTOS, TIES = 2, 3, 90
EXTENT = Plan(STRIPS, PHOTOS, TIES, 0.5, 1).extent
TIMES = 300.0
"""Standard deviations are drawn so many times their size."""
HELD = AdjustmentOptions(estimate_cameras=False, robust=False)


def places(count: int, centre: tuple[float, float], spread: float) -> Matrix:
    """Control spread evenly over a part of the block, pushed inwards at its edges."""
    golden = 0.5 + 0.5 * np.sqrt(5)
    steps = np.arange(count)
    unit = np.column_stack([(steps + 0.5) / count, (steps / golden) % 1.0])
    size = np.array(EXTENT) * spread
    middle = np.clip(centre, size / 2, np.array(EXTENT) - size / 2)
    return middle + (unit - 0.5) * size * 0.94


@lru_cache(maxsize=64)
def adjusted(
    noise_px: float, seed: int, count: int, where: tuple[float, float, float], sigma_m: float
) -> tuple[Flight, AdjustmentReport]:
    """The block of a state, adjusted; `where` is the middle of the control and its spread."""
    flight = fly(
        Plan(STRIPS, PHOTOS, TIES, noise_px, seed), places(count, where[:2], where[2]), sigma_m
    )
    return flight, adjust_block(flight.block, HELD)


def view(state: sheet.State) -> sheet.View:
    """Tie points with the standard deviations of their places, and control."""
    where = (state["x"], state["y"], state["spread"] / 100)
    flight, report = adjusted(
        max(state["ties"], 0.05), int(state["seed"]), int(state["count"]), where, state["sigma"]
    )
    sigmas = report.tie_sigmas_m
    plan = np.hypot(sigmas[:, 0], sigmas[:, 1])
    known = np.isfinite(plan)
    off = np.hypot(*(report.tie_positions - flight.ties)[:, :2].T)
    axis = float(np.sqrt(np.mean(sigmas[known, :2] ** 2)))
    figures = {
        "rms": sheet.Number(axis, 2, "m"),
        "worst": sheet.Number(float(plan[known].max()), 2, "m"),
        "height": sheet.Number(float(np.sqrt(np.mean(sigmas[known, 2] ** 2))), 2, "m"),
        "error": sheet.Number(float(np.sqrt(np.mean(off[known] ** 2 / 2))), 2, "m", secret=True),
        "sigma_nought": sheet.Number(report.sigma_nought, 2),
    }
    middle = places(int(state["count"]), where[:2], where[2])
    away = np.array([np.min(np.hypot(*(middle - tie[:2]).T)) for tie in flight.ties[known]])
    order = np.argsort(away)
    parts = np.array_split(order, 9)
    curve = sheet.curve(
        "sigma", [away[p].mean() for p in parts], [plan[known][p].mean() for p in parts]
    )
    plot = sheet.Plot("away", "sigma", (curve,))
    symbols = {
        "n": sheet.Number(int(state["count"]), 0),
        "r": sheet.Number(report.redundancy, 0),
        "σ_0": figures["sigma_nought"],
    }
    canvas = drawing(flight, middle, plan, off, where)
    return sheet.View(figures, (canvas,), symbols, plot)


def drawing(
    flight: Flight,
    control: Matrix,
    plan: np.ndarray,
    off: np.ndarray,
    where: tuple[float, float, float],
) -> sheet.Canvas:
    """The block in plan."""
    frames = [
        np.array(footprint(photo, flight.block.cameras["lesson"]).exterior.coords)
        for photo in flight.photos.values()
    ]
    rings = [
        part
        for tie, sigma, error in zip(flight.ties[:, :2], plan, off, strict=True)
        if np.isfinite(sigma)
        for part in (
            sheet.shape("line", sheet.ellipse(tie, np.eye(2) * sigma**2 / 2, TIMES), "error"),
            sheet.shape("line", [tie, (tie[0], tie[1] + TIMES * error / np.sqrt(2))], "truth"),
        )
    ]
    shapes = (
        *(sheet.shape("line", frame, "faint") for frame in frames),
        *rings,
        sheet.shape("crosses", control, "estimate"),
        sheet.shape("dots", [where[:2]], "ray", "control", handle=("x", "y")),
    )
    length, width = EXTENT
    room = 0.04 * length
    return sheet.Canvas("plan", (-room, -room, length + room, width + room), shapes)


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How much worse one ninth of the block is than all of it."""
    middle = (EXTENT[0] / 2, EXTENT[1] / 2)
    sigma, seed = float(rng.integers(5, 16)) / 10, int(rng.integers(1, 100))
    spread, ninth = (
        adjusted(0.5, seed, 20, where, sigma)[1].tie_sigmas_m[:, :2]
        for where in ((*middle, 1.0), (0.0, 0.0, 1 / 3))
    )
    ratio = np.sqrt(np.nanmean(ninth**2) / np.nanmean(spread**2))
    return sheet.Asked({"sigma": sigma, "n": 20}, float(ratio))


LESSON = sheet.Lesson(
    "control",
    "k",
    (
        sheet.Slider("spread", 15, 100, 100, 1, "%"),
        sheet.Slider("x", 0, round(EXTENT[0]), round(EXTENT[0] / 2), 1, "m", moved_in="plan"),
        sheet.Slider("y", 0, round(EXTENT[1]), round(EXTENT[1] / 2), 1, "m", moved_in="plan"),
        sheet.Slider("count", 4, 60, 20, 1, "", "n"),
        sheet.Slider("sigma", 0.1, 3, 1, 0.1, "m"),
        sheet.Slider("ties", 0.1, 2, 0.5, 0.1, "px"),
        sheet.SEED,
    ),
    view,
    (
        sheet.Equation(
            "Σ",
            sheet.row(
                sheet.power("σ", "2"),
                "*",
                sheet.power(["fence", sheet.row(sheet.power("A", "T"), "*", "P", "*", "A")], "−1"),
            ),
        ),
    ),
    (sheet.Question("ninth", "", 1.0, ask),),
    hides_truth=True,
)
