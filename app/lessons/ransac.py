"""RANSAC: the best of many samples, and what pure chance brings together."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import cast

import numpy as np

from app.lessons import sheet
from core.arrays import Flags, ObjectPoints, PixelPoints, Scalars
from core.literature.published_chains import (
    AXES,
    BATCH,
    KOBYLI_1938,
    KOBYLI_1984,
    MILOVICE_1938,
    MILOVICE_1989,
    SAMPLES_OF,
    Models,
    Transform,
    conditioned,
    distances,
    solved,
)

SIDE_M = 3000.0
"""Ground that the photo shows."""
RELIEF_M = 60.0
SAMPLES = 20_000
"""So many samples are drawn at most; the thesis draws 100 000."""
BLOCKS = (MILOVICE_1938, MILOVICE_1989, KOBYLI_1938, KOBYLI_1984)
"""Settings by the number of the choice; nought are those of the sliders (thesis, Table 6)."""


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


@dataclass(frozen=True, slots=True)
class RansacSearch:
    """Candidates, and what is fitted to them."""

    count: int
    """Candidates."""
    share: float
    """Share of right ones."""
    half_m: float
    """How far from its place a wrong one may lie, per axis."""
    seed: int
    """Of candidates and samples."""
    transform: Transform
    """What a sample determines."""


@lru_cache(maxsize=64)
def solve_batch(search: RansacSearch, batch: int) -> Models:
    """Transformations of the samples of a batch, between conditioned points.

    These take the time. Distances of all candidates from all samples would take 2.5 MB a batch.
    """
    points, pixels, _ = candidates(search.count, search.share, search.half_m, search.seed)
    rng = np.random.default_rng((search.seed, batch))
    drawn = np.argsort(rng.random((BATCH, search.count)), axis=1)
    drawn = drawn[:, : SAMPLES_OF[search.transform]]
    ground, image = conditioned(points[:, : AXES[search.transform]]), conditioned(pixels)
    return solved(ground[drawn], image[drawn])


@lru_cache(maxsize=64)
def score_batch(
    search: RansacSearch, batch: int, limit_m: float, samples: int
) -> tuple[Scalars, Flags]:
    """How many candidates agree with each sample of a batch, and which with its best."""
    points, pixels, _ = candidates(search.count, search.share, search.half_m, search.seed)
    ground, image = conditioned(points[:, : AXES[search.transform]]), conditioned(pixels)
    scale = float(np.std(pixels - pixels.mean(axis=0)))
    found = solve_batch(search, batch)[:samples]
    near = distances(found, ground, image) * scale < limit_m
    counts = near.sum(axis=1)
    return counts.astype(np.float64), near[int(counts.argmax())].copy()


def search_best(search: RansacSearch, limit_m: float, samples: int) -> tuple[Scalars, Flags]:
    """Most agreeing candidates after each sample, and which agree with the best."""
    counts, best = list[Scalars](), np.zeros(search.count, dtype=np.bool_)
    for batch in range(-(-samples // BATCH)):
        own, agrees = score_batch(search, batch, limit_m, min(samples - batch * BATCH, BATCH))
        if own.max() > best.sum():
            best = agrees
        counts.append(own)
    return np.maximum.accumulate(np.concatenate(counts)), best


def search_of(state: sheet.State) -> tuple[RansacSearch, float]:
    """The search that the sliders or a block of the thesis make, and within what agrees, metres."""
    half, limit, transform = state["half"], state["limit"], cast("Transform", "dlt")
    if state["block"]:
        options = BLOCKS[int(state["block"]) - 1]
        half = (options.window - options.template) / 2
        limit, transform = options.ransac.threshold_px * options.gsd_m, options.transform
    share, seed = state["share"] / 100, int(state["seed"])
    return RansacSearch(int(state["N"]), share, half, seed, transform), limit


def view(state: sheet.State) -> sheet.View:
    """The candidates, the best sample, and the same search in nothing but chance."""
    search, limit = search_of(state)
    count, share, samples = search.count, search.share, int(state["samples"])
    points, _, right = candidates(count, share, search.half_m, search.seed)
    best, agrees = search_best(search, limit, samples)
    noise = replace(search, share=0.0, seed=search.seed + 500)
    chance, _ = search_best(noise, limit, samples)
    size = SAMPLES_OF[search.transform]
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
        "all_right": sheet.Number(all_right(share, samples, size), 1),
        "half": sheet.Number(search.half_m, 1, "m"),
        "limit": sheet.Number(limit, 1, "m"),
    }
    canvas = sheet.Canvas("plan", (-edge, -edge, SIDE_M + edge, SIDE_M + edge), tuple(shapes))
    symbols = {
        "w": sheet.Number(share, 2),
        "E": figures["all_right"],
        "k": sheet.Number(samples, 0),
        "m": sheet.Number(size, 0),
    }
    return sheet.View(figures, (canvas,), symbols, sheet.Plot("samples", "best", curves))


def all_right(share: float, samples: int, size: int) -> float:
    """So many samples are expected to hold right candidates alone."""
    return samples * share**size


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How many samples it takes to draw right candidates alone once."""
    share, size = float(rng.integers(6, 13) * 5), SAMPLES_OF["dlt"]
    return sheet.Asked({"w": share, "m": size}, 1 / all_right(share / 100, 1, size))


LESSON = sheet.Lesson(
    "ransac",
    "i",
    (
        sheet.Slider("block", 0, len(BLOCKS), 0, 1),
        sheet.Slider("N", 20, 160, 95, 5),
        sheet.Slider("share", 0, 60, 0, 2, "%"),
        sheet.Slider("half", 10, 60, 29, 1, "m"),
        sheet.Slider("limit", 1, 10, 4, 0.5, "m"),
        sheet.Slider("samples", 50, SAMPLES, BATCH, 50, "", "k"),
        sheet.SEED,
    ),
    view,
    (sheet.Equation("E", sheet.row("k", "*", sheet.power("w", "m"))),),
    (sheet.Question("samples", "", 1.0, ask, 0),),
    hides_truth=True,
)
