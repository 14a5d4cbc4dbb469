"""RANSAC: the best of many samples, and what pure chance brings together."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from app.lessons import sheet
from app.lessons.photo import HALF_MM, photo_model
from core.arrays import Flags, Indices, Matrix, ObjectPoints, PixelPoints, Scalars
from core.geometry.consensus import SAMPLE, Candidates, Consensus, ConsensusOptions
from core.geometry.exterior import ExteriorOrientation
from core.geometry.robust import log10_nfa
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
    places_by,
    solved,
)

SIDE_M = 3000.0
"""Ground that the photo shows."""
RELIEF_M = 6.0
"""Nearly level ground: a projective transformation of the plan is off by less than its limit."""
C_MM = 152.0
PHOTO = photo_model(C_MM, 2 * HALF_MM / SIDE_M)
"""At 1 m a pixel."""
TRUTH = ExteriorOrientation(
    np.array([SIDE_M / 2, SIDE_M / 2, SIDE_M / 2 * C_MM / HALF_MM]), 0.0, 0.0, 0.0
)
LOOSE = np.diag(np.repeat([1e4, 10.0], 3) ** 2)
"""Known beforehand to 10 km and 10 rad: samples alone decide; those in a line are solved too."""
SAMPLES = 20_000
"""So many samples are drawn at most; the thesis draws 100 000."""
BLOCKS = (MILOVICE_1938, MILOVICE_1989, KOBYLI_1938, KOBYLI_1984)
"""Settings by the number of the choice; nought are those of the sliders (thesis, Table 6)."""
Model = Transform | Literal["resection"]
"""What a sample determines; a resection knows the camera."""
MODELS: tuple[Model, ...] = ("dlt", "projective", "resection")
PHASES = ("sample", "model", "agreeing", "best")
"""What one step after the other shows of each sample."""
STEPPED = 50
"""So many samples can be gone through."""
RIGHT_SAMPLES = sheet.Equation("E", sheet.row("s", "*", sheet.power("w", "m")))
RIGHT_SAMPLE = sheet.Equation("p", sheet.power("w", "m"))
FALSE_ALARMS = sheet.Equation(
    "NFA",
    sheet.row(
        ["fence", sheet.row("N", "−", "m")], "*",
        "C", ["fence", sheet.row("N", ",", "k")], "*",
        "C", ["fence", sheet.row("k", ",", "m")], "*",
        sheet.power("α", sheet.row("k", "−", "m")),
    ),
)  # fmt: skip
TIMES = 8.0
"""Shifts are drawn so many times their length."""


@lru_cache(maxsize=64)
def candidates(
    count: int, share: float, half_m: float, seed: int
) -> tuple[ObjectPoints, PixelPoints, Flags]:
    """Known points, where each was found at 1 m a pixel, and which of them are right."""
    rng = np.random.default_rng(seed)
    plan = rng.uniform(0, SIDE_M, (count, 2))
    heights = RELIEF_M * np.sin(plan[:, 0] / 500) * np.cos(plan[:, 1] / 700)
    points = np.column_stack([plan, heights])
    right = np.arange(count) < round(share * count)
    # What is right is off by a metre, what is wrong lies anywhere in its search window.
    off = np.where(
        right[:, None], rng.normal(0, 1, (count, 2)), rng.uniform(-half_m, half_m, (count, 2))
    )
    return points, expected(points) + off, np.asarray(right)


def expected(points: ObjectPoints) -> PixelPoints:
    """Where the photo truly shows known points."""
    return PHOTO.pixels(points, TRUTH)


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
    model: Model
    """What a sample determines."""

    @property
    def size(self) -> int:
        """Points in a sample."""
        return SAMPLE if self.model == "resection" else SAMPLES_OF[self.model]

    @property
    def candidates(self) -> tuple[ObjectPoints, PixelPoints, Flags]:
        """Those that it searches."""
        return candidates(self.count, self.share, self.half_m, self.seed)

    def log10_nfa(self, agreeing: int, limit_m: float) -> float:
        """How often chance would make so many agree: the window is as wide as it is high."""
        chance = min(1.0, self.chance(limit_m))
        return log10_nfa(self.count, agreeing, self.size, chance)

    def chance(self, limit_m: float) -> float:
        """The circle within which a candidate agrees, over its search window."""
        return float(np.pi * limit_m**2 / (2 * self.half_m) ** 2)


def samples_of(search: RansacSearch, batch: int) -> Indices:
    """The candidates of each sample of a batch."""
    rng = np.random.default_rng((search.seed, batch))
    drawn = np.argsort(rng.random((BATCH, search.count)), axis=1)
    return drawn[:, : search.size]


@lru_cache(maxsize=64)
def solve_batch(search: RansacSearch, batch: int) -> Models:
    """Models of the samples of a batch: between conditioned points, or changes of the photo.

    These take the time. Distances of all candidates from all samples would take 2.5 MB a batch.
    """
    drawn = samples_of(search, batch)
    if search.model == "resection":
        return consensus_of(search).from_samples(drawn)
    ground, image = conditioned_points(search, search.model)
    return solved(ground[drawn], image[drawn])


def conditioned_points(search: RansacSearch, transform: Transform) -> tuple[Matrix, Matrix]:
    """Known points with the axes that the transformation takes, and their candidates."""
    points, pixels, _ = search.candidates
    return conditioned(points[:, : AXES[transform]]), conditioned(pixels)


@lru_cache(maxsize=64)
def consensus_of(search: RansacSearch) -> Consensus:
    """The candidates about the place of the photo where they are expected.

    As where the engine makes its hypotheses, the photo is linearised there; nothing but that is
    taken from it, as the prior is loose.
    """
    points, pixels, _ = search.candidates
    predicted, design = PHOTO.linearised(points, TRUTH)
    alike = np.ones(search.count)
    known = Candidates(
        np.arange(search.count), pixels, alike, alike, alike, alike / (2 * search.half_m) ** 2
    )
    return Consensus(known, pixels - predicted, design, LOOSE, options=ConsensusOptions())


def distances_m(search: RansacSearch, models: Models) -> Matrix:
    """Distance of every candidate (columns) from every model; a pixel is a metre."""
    if search.model == "resection":
        return np.sqrt(consensus_of(search).squared(models))
    ground, image = conditioned_points(search, search.model)
    return distances(models, ground, image) * spread_of(search.candidates[1])


def places_of(search: RansacSearch, model: Models) -> PixelPoints:
    """Where one model puts all known points."""
    pixels = search.candidates[1]
    if search.model == "resection":
        consensus = consensus_of(search)
        return pixels - consensus.offset + consensus.design @ model[0]
    ground, _ = conditioned_points(search, search.model)
    computed = np.column_stack([part[0] for part in places_by(model, ground)])
    return computed * spread_of(pixels) + pixels.mean(axis=0)


def spread_of(pixels: PixelPoints) -> float:
    """Unit of conditioned candidates, pixels."""
    return float(np.std(pixels - pixels.mean(axis=0)))


@lru_cache(maxsize=64)
def score_batch(
    search: RansacSearch, batch: int, limit_m: float, samples: int
) -> tuple[Scalars, Flags]:
    """How many candidates agree with each sample of a batch, and which with its best."""
    near = distances_m(search, solve_batch(search, batch)[:samples]) < limit_m
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
    half, limit, model = state["half"], state["limit"], MODELS[int(state["model"]) - 1]
    if state["block"]:
        options = BLOCKS[int(state["block"]) - 1]
        half = (options.window - options.template) / 2
        limit, model = options.ransac.threshold_px * options.gsd_m, options.transform
    share, seed = state["share"] / 100, int(state["seed"])
    return RansacSearch(int(state["N"]), share, half, seed, model), limit


def view(state: sheet.State) -> sheet.View:
    """The whole search beside one in nothing but chance, or one of its samples."""
    search, limit = search_of(state)
    step = int(state["step"])
    idle = dict[str, str]()
    in_force = dict[str, float]()
    if state["block"]:
        idle = dict.fromkeys(("model", "half", "limit"), f"block_{search.model}")
        in_force = {"model": MODELS.index(search.model) + 1, "half": search.half_m, "limit": limit}
    if step:
        sample, phase = divmod(step - 1, len(PHASES))
        found, idle = one_sample(search, limit, sample, PHASES[phase]), idle | {"samples": "steps"}
    else:
        found = whole_search(search, limit, int(state["samples"]))
    return replace(found, idle=idle, in_force=in_force)


def whole_search(search: RansacSearch, limit: float, samples: int) -> sheet.View:
    """The candidates, the best sample, and the same search in nothing but chance."""
    points, _, right = search.candidates
    best, agrees = search_best(search, limit, samples)
    noise = replace(search, share=0.0, seed=search.seed + 500)
    chance, _ = search_best(noise, limit, samples)
    plan = points[:, :2]
    shapes = [
        sheet.shape("dots", plan[~agrees], "faint"),
        sheet.shape("dots", plan[agrees], "estimate"),
        *rings_of(plan[right]),
    ]
    steps = np.arange(1, samples + 1)
    kept = np.unique(np.geomspace(1, samples, 80).astype(int)) - 1
    curves = (
        sheet.curve("best", np.log10(steps[kept]), best[kept]),
        sheet.curve("chance", np.log10(steps[kept]), chance[kept], "bad"),
    )
    most = int(best[-1])
    figures = {
        "best": sheet.Number(most, 0, "", round(search.share * search.count)),
        **alarms_of(search, limit, most),
        "chance": sheet.Number(float(chance[-1]), 0),
        "right": sheet.Number(float((agrees & right).sum()), 0, secret=True),
        "all_right": sheet.Number(all_right(search.share, samples, search.size), 1),
    }
    symbols = symbols_of(search, limit, most) | {
        "E": figures["all_right"],
        "s": sheet.Number(samples, 0),
    }
    plot = sheet.Plot("samples", "best", curves)
    return sheet.View(figures, (canvas_of("plan", shapes),), symbols, plot)


def alarms_of(search: RansacSearch, limit: float, agreeing: int) -> dict[str, sheet.Number]:
    """The number of false alarms; of no more than a sample there is nothing to say."""
    if agreeing <= search.size:
        return {}
    return {"nfa": sheet.Number(search.log10_nfa(agreeing, limit), 1)}


def symbols_of(search: RansacSearch, limit: float, agreeing: int) -> dict[str, sheet.Number]:
    """Numbers of the formulas."""
    symbols = {
        "w": sheet.Number(search.share, 2),
        "m": sheet.Number(search.size, 0),
        "k": sheet.Number(agreeing, 0),
        "α": in_tens(np.log10(search.chance(limit))),
    }
    if agreeing > search.size:
        symbols["NFA"] = in_tens(search.log10_nfa(agreeing, limit))
    return symbols


def in_tens(logarithm: float) -> sheet.Number:
    """A number of two digits and a power of ten."""
    power = int(np.floor(logarithm))
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return sheet.Number(10 ** (logarithm - power), 1, f"·10{raised}")


def canvas_of(name: str, shapes: list[sheet.Shape]) -> sheet.Canvas:
    """The ground of the photo."""
    edge = 0.03 * SIDE_M
    return sheet.Canvas(name, (-edge, -edge, SIDE_M + edge, SIDE_M + edge), tuple(shapes))


def rings_of(plan: Matrix) -> list[sheet.Shape]:
    """Rings about what is right."""
    return [sheet.shape("line", sheet.ellipse(at, np.eye(2) * 45**2), "truth") for at in plan]


def one_sample(search: RansacSearch, limit: float, sample: int, phase: str) -> sheet.View:
    """One sample, its model, what agrees with it, and the best so far.

    Args:
        search: The search.
        limit: Within what a candidate agrees, metres.
        sample: Its place in the search, from nought.
        phase: One of `PHASES`.
    """
    points, pixels, right = search.candidates
    told, is_best = phase in ("agreeing", "best"), phase == "best"
    counts = score_batch(search, 0, limit, sample + 1)[0]
    drawn = int(np.argmax(counts)) if is_best else sample
    model = solve_batch(search, 0)[drawn : drawn + 1]
    agrees = distances_m(search, model)[0] < limit
    figures = {"sample": sheet.Number(sample + 1, 0), "size": sheet.Number(search.size, 0)}
    own, most = float(counts[sample]), int(agrees.sum())
    if told:
        figures["agree"] = sheet.Number(own, 0)
    if is_best:
        figures["best"] = sheet.Number(most, 0)
        figures |= alarms_of(search, limit, most)
    computed = None if phase == "sample" else places_of(search, model)
    shapes = shifts_shown(points, pixels, samples_of(search, 0)[drawn], computed)
    if told:
        shapes.append(sheet.shape("dots", points[agrees, :2], "estimate"))
    steps, at = np.arange(1, sample + 2), (float(sample + 1), own)
    curves = (
        sheet.curve("each", steps, counts, "second"),
        sheet.curve("best", steps, np.maximum.accumulate(counts)),
    )
    plot = sheet.Plot("sample", "best", curves, at) if told and sample else None
    symbols = symbols_of(search, limit, most)
    symbols["p"] = sheet.Number(all_right(search.share, 1, search.size), 4)
    return sheet.View(
        figures,
        (canvas_of("shifts", [*shapes, *rings_of(points[right, :2])]),),
        symbols,
        plot,
        step=phase,
        equations=(FALSE_ALARMS if "nfa" in figures else RIGHT_SAMPLE,),
    )


def shifts_shown(
    points: ObjectPoints, pixels: PixelPoints, drawn: Indices, computed: PixelPoints | None
) -> list[sheet.Shape]:
    """Where candidates were found and where a model puts them, from where they are expected.

    Args:
        points: Known points.
        pixels: Their candidates.
        drawn: The candidates of the sample.
        computed: Where its model puts all of them; None before it is solved.
    """
    plan, middle = points[:, :2], expected(points)
    found = plan + TIMES * (pixels - middle) * [1, -1]
    shapes = [sheet.shape("arrow", ends, "faint") for ends in np.stack([plan, found], axis=1)]
    if computed is not None:
        shift = TIMES * (computed - middle) * [1, -1]
        # What a bad model throws out of the picture points there, no further.
        length = np.linalg.norm(shift, axis=1, keepdims=True)
        shift *= np.minimum(1.0, 0.12 * SIDE_M / np.maximum(length, 1e-9))
        shapes += [
            sheet.shape("arrow", ends, "second") for ends in np.stack([plan, plan + shift], axis=1)
        ]
    shapes += [sheet.shape("arrow", [plan[i], found[i]], "bad") for i in drawn]
    shapes.append(sheet.shape("crosses", plan[drawn], "bad"))
    return shapes


def all_right(share: float, samples: int, size: int) -> float:
    """So many samples are expected to hold right candidates alone."""
    return samples * share**size


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How many samples it takes to draw right candidates alone once."""
    share, size = float(rng.integers(6, 13) * 5), SAMPLES_OF["dlt"]
    answer = 1 / all_right(share / 100, 1, size)
    # From 21 samples to 1372: a twentieth, and what rounding to whole ones takes.
    return sheet.Asked({"w": share, "m": size}, answer, max(0.5, 0.05 * answer))


LESSON = sheet.Lesson(
    "ransac",
    "i",
    (
        sheet.Slider("step", 0, STEPPED * len(PHASES), 0, 1),
        sheet.Slider("block", 0, len(BLOCKS), 0, 1),
        sheet.Slider("model", 1, len(MODELS), 2, 1),
        sheet.Slider("N", 20, 160, 95, 5, "", "N"),
        sheet.Slider("share", 0, 60, 0, 2, "%"),
        sheet.Slider("half", 10, 60, 29, 1, "m"),
        sheet.Slider("limit", 1, 10, 4, 0.5, "m"),
        sheet.Slider("samples", 50, SAMPLES, BATCH, 50, "", "s"),
        sheet.SEED,
    ),
    view,
    (RIGHT_SAMPLES, FALSE_ALARMS),
    (sheet.Question("samples", "", 0.5, ask, 0),),
    hides_truth=True,
)
