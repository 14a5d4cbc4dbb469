"""RANSAC: the best of many samples, and what pure chance brings together."""

from functools import lru_cache

import numpy as np

from app.lessons import sheet
from core.arrays import Flags, Matrix, ObjectPoints, PixelPoints, Scalars
from core.literature.published_chains import SAMPLE, conditioned, distances, solved

SIDE_M = 3000.0
"""Ground that the photo shows."""
RELIEF_M = 60.0
SAMPLES = 2000
"""So many samples are drawn; the thesis draws 100 000."""


@lru_cache(maxsize=64)
def candidates(
    count: int, share: float, half_m: float, seed: int
) -> tuple[ObjectPoints, PixelPoints, Flags]:
    """Known points, where each was found at 1 m a pixel, and which of them are right."""
    rng = np.random.default_rng(seed)
    plan = rng.uniform(0, SIDE_M, (count, 2))
    heights = RELIEF_M * np.sin(plan[:, 0] / 500) * np.cos(plan[:, 1] / 700)
    right = np.arange(count) < round(share * count)
    places = np.column_stack([plan[:, 0], SIDE_M - plan[:, 1]])
    # What is right is off by a metre, what is wrong lies anywhere in its search window.
    off = np.where(
        right[:, None], rng.normal(0, 1, (count, 2)), rng.uniform(-half_m, half_m, (count, 2))
    )
    lean = 0.15 * heights[:, None] * (places / SIDE_M - 0.5)
    return np.column_stack([plan, heights]), places + lean + off, np.asarray(right)


@lru_cache(maxsize=64)
def scored(count: int, share: float, half_m: float, seed: int) -> Matrix:
    """Distance of every candidate from where each sample's DLT puts it, metres."""
    points, pixels, _ = candidates(count, share, half_m, seed)
    rng = np.random.default_rng(10_000 + seed)
    drawn = np.argsort(rng.random((SAMPLES, count)), axis=1)[:, :SAMPLE]
    ground, image = conditioned(points), conditioned(pixels)
    scale = float(np.std(pixels - pixels.mean(axis=0)))
    return (distances(solved(ground[drawn], image[drawn]), ground, image) * scale).astype(
        np.float64
    )


def best_so_far(away: Matrix, limit_m: float) -> tuple[Scalars, int]:
    """Most agreeing candidates after each sample, and which sample has them."""
    counts = (away < limit_m).sum(axis=1)
    return np.maximum.accumulate(counts).astype(np.float64), int(counts.argmax())


def view(state: sheet.State) -> sheet.View:
    """The candidates, the best sample, and the same search in nothing but chance."""
    count, share, half = int(state["N"]), state["share"] / 100, state["half"]
    seed, samples = int(state["seed"]), int(state["samples"])
    points, _, right = candidates(count, share, half, seed)
    away = scored(count, share, half, seed)[:samples]
    best, which = best_so_far(away, state["limit"])
    chance, _ = best_so_far(scored(count, 0.0, half, seed + 500)[:samples], state["limit"])
    agrees = away[which] < state["limit"]
    plan = points[:, :2]
    edge = 0.03 * SIDE_M
    shapes = [
        sheet.shape("dots", plan[~agrees], "faint"),
        sheet.shape("dots", plan[agrees], "estimate"),
        *(
            sheet.shape("line", sheet.ellipse(place, np.eye(2) * 45**2), "truth")
            for place in plan[right]
        ),
    ]
    steps = np.arange(1, samples + 1)
    kept = np.unique(np.geomspace(1, samples, 80).astype(int)) - 1
    curves = (
        sheet.curve("best", np.log10(steps[kept]), best[kept]),
        sheet.curve("chance", np.log10(steps[kept]), chance[kept], "bad"),
    )
    figures = {
        "best": sheet.Number(float(best[-1]), 0, "", round(share * count)),
        "chance": sheet.Number(float(chance[-1]), 0),
        "right": sheet.Number(float((agrees & right).sum()), 0, secret=True),
        "all_right": sheet.Number(all_right(share, samples), 1),
    }
    canvas = sheet.Canvas("plan", (-edge, -edge, SIDE_M + edge, SIDE_M + edge), tuple(shapes))
    symbols = {
        "w": sheet.Number(share, 2),
        "E": figures["all_right"],
        "k": sheet.Number(samples, 0),
        "m": sheet.Number(SAMPLE, 0),
    }
    return sheet.View(figures, (canvas,), symbols, sheet.Plot("samples", "best", curves))


def all_right(share: float, samples: int) -> float:
    """So many samples are expected to hold right candidates alone."""
    return samples * share**SAMPLE


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How many samples it takes to draw right candidates alone once."""
    share = float(rng.integers(6, 13) * 5)
    return sheet.Asked({"w": share, "m": SAMPLE}, 1 / all_right(share / 100, 1))


LESSON = sheet.Lesson(
    "ransac",
    "i",
    (
        sheet.Slider("N", 20, 160, 95, 5),
        sheet.Slider("share", 0, 60, 0, 2, "%"),
        sheet.Slider("half", 10, 60, 29, 1, "m"),
        sheet.Slider("limit", 1, 10, 4, 0.5, "m"),
        sheet.Slider("samples", 50, SAMPLES, SAMPLES, 50, "", "k"),
        sheet.SEED,
    ),
    view,
    (sheet.Equation("E", sheet.row("k", "*", sheet.power("w", "m"))),),
    (sheet.Question("samples", "", 1.0, ask, 0),),
    hides_truth=True,
)
