"""Control beside that of published chains and other operators, on blocks with known truth.

Two tables. Operators: share of true junctions whose highest peak lies within 3 m, in windows of
29 m to either side of where the georeference expects them, template 51 m, the reference warped into
the scan for all alike. Chains: control in use against the truth, recall of junctions that stood
then and stand now, ground error of the photos (RMS over the frames; the mosaic's m_p is of the same
size), time. Ends with 1 when a promise is broken.
"""

import argparse
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.stats import ncx2

from core.adjustment.adjusted import AdjustmentReport
from core.control.search import PREDICTION_SIGMA_M
from core.literature.baselines import OPERATORS
from core.literature.dense_descriptors import has_akaze
from core.literature.published_chains import CHAINS, Preset, assemble_published
from core.matching.local_search import MatchingOptions, looked_at, predict_pixels
from core.matching.local_search import reduction_for as reduced
from core.pipeline import STAGES, made
from core.progress import Work
from core.reference.stage import ReferencePoints
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import WRONG_M, judge_control, judge_orientations
from tests.benchmarks.control_blocks import Case, plans, prepared, strong_plans, true_pixel

SLOW = ("akaze",)
"""Described place by place: it sees a sample of the junctions."""
SAMPLE = 12
STRONG_M = 0.8
"""What nine of ten blocks keep even where change is strong, metres."""


@dataclass(frozen=True)
class Row:
    """One chain on one block."""

    used: int
    wrong: int
    recall: float
    ground_m: float
    seconds: float
    photos: int
    probabilities: np.ndarray
    within: np.ndarray
    came: np.ndarray


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def hits(case: Case, names: list[str]) -> dict[str, tuple[int, int, float]]:
    """Hits, junctions and seconds by operator."""
    ids = [i for i, name in enumerate(case.site.points.ids) if name in case.lasting]
    points = ReferencePoints(
        tuple(case.site.points.ids[i] for i in ids),
        case.site.points.positions[ids],
        case.site.points.sigma_m[ids],
    )
    found = {name: [0, 0, 0.0] for name in names}
    for number, photo_id in enumerate(case.block.photos):
        opened = case.opened(photo_id)
        reduction = reduced(opened, 1.0)
        pixel_m = opened.ground_pixel_m * reduction
        inner, half = round(25.0 / pixel_m), round(29.5 / pixel_m)
        prediction = predict_pixels(opened, np.zeros((6, 6)), points.positions, points.sigma_m)
        quick = [name for name in names if name not in SLOW]
        for group in (quick, [name for name in names if name in SLOW]):
            operators = tuple(OPERATORS[name] for name in group)
            matching = MatchingOptions(
                reduction, inner, min_search_px=half, max_search_px=half, operators=operators
            )
            seen = 0
            halves = np.full(len(ids), half)
            for view, point in looked_at(opened, case.reference, prediction, halves, matching):
                if group != quick and (seen >= SAMPLE // 6 or number > 5):
                    break
                pixel = prediction.pixels[point]
                place = points.positions[point : point + 1]
                true = true_pixel(case.truth, photo_id, pixel[None], place)
                if np.abs(true - pixel).max() > (half - 4) * reduction:
                    continue
                seen += 1
                for name in group:
                    started = time.perf_counter()
                    surface = view.scores(name)
                    found[name][2] += time.perf_counter() - started
                    row, column = np.unravel_index(int(np.argmax(surface)), surface.shape)
                    best = view.centre[0] + (np.array([column, row]) - half) * reduction
                    away = float(np.hypot(*(best - true))) * opened.ground_pixel_m
                    found[name][0] += away <= WRONG_M
                    found[name][1] += 1
    return {name: (int(a), int(b), c) for name, (a, b, c) in found.items()}


def judged(case: Case, report: AdjustmentReport, seconds: float) -> Row:
    """One result against the truth."""
    control = judge_control(case.truth, report.block)
    ground = judge_orientations(case.truth, report.block).ground_m
    seen = right = 0
    place = dict(zip(case.site.points.ids, case.site.points.positions, strict=True))
    for point_id in case.lasting:
        for photo_id, exposure in case.truth.photos.items():
            photo = case.block.photos[photo_id].with_exterior(exposure.exterior, True)
            pixel = photo.pixel_from_object(place[point_id][None], case.truth.camera)
            film = photo.interior.film_from_pixel(pixel)
            if np.all(np.abs(film) < 0.48 * np.array(case.truth.camera.frame_mm)):
                seen += 1
                right += control.distances_m.get((point_id, photo_id), np.inf) <= WRONG_M
    told, within, came = [], [], []
    for key, value in report.block.measurements.items():
        point = report.block.surveyed[value.point_id]
        if value.photo_id in case.truth.photos and point.source != "surveyed":
            true = true_pixel(case.truth, value.photo_id, value.pixel, point.position[None])
            pixel_m = case.opened(value.photo_id).ground_pixel_m
            away_m = float(np.hypot(*report.residuals_px[key])) * pixel_m
            told.append(value.score)
            within.append(near_anyway(value.score, away_m, float(point.sigma_m[0])))
            came.append(float(np.hypot(*(true - value.pixel[0]))) * pixel_m <= WRONG_M)
    return Row(
        control.used,
        control.wrong,
        right / max(seen, 1),
        float(np.sqrt(np.mean(ground**2))) if len(ground) else float("nan"),
        seconds,
        len(ground),
        np.array(told),
        np.array(within),
        np.array(came, dtype=bool),
    )


def near_anyway(probability: float, away_m: float, sigma_m: float) -> float:
    """Stated probability to lie within 3 m of the true place: as the right peak, or by accident.

    A wrong peak close to the prediction is close to the truth, for the block knows the place to
    half a metre: judged by distance it counts as right. So what is stated of the distance is
    p + (1 - p) a, with a the probability that the true place, normal about the prediction, is
    within 3 m of a peak so far from it.
    """
    sigma = float(np.hypot(sigma_m, PREDICTION_SIGMA_M))
    accident = ncx2.cdf((WRONG_M / sigma) ** 2, 2, max((away_m / sigma) ** 2, 1e-9))
    return probability + (1.0 - probability) * float(accident)


def ours(case: Case) -> Row:
    """Control as the program finds it, in passes until the block has settled."""
    started = time.process_time()
    results, work = case.results, Work(seed=case.given.name)
    repeated = [stage for stage in STAGES if stage.repeated]
    while results.control is None or not results.control.final:
        begun = results.control is not None
        for stage in repeated if begun else repeated[-1:]:
            results = replace(results, **{stage.name: stage.run(case.given, results, work)})
    report = made(results.control).report
    return judged(case, report, time.process_time() - started)


def theirs(case: Case, preset: Preset) -> Row:
    """One published chain, begun at the georeference, with the same adjustment."""
    started = time.process_time()
    report, _ = assemble_published(
        case.block, case.site, CHAINS[preset], case.given.adjustment, np.random.default_rng(0)
    )
    return judged(case, report, time.process_time() - started)


def calibration(
    told: np.ndarray, within: np.ndarray, came: np.ndarray
) -> tuple[float, float, float]:
    """Expected calibration errors in ten bins, and precision from 0.9; prints the diagram.

    Returns:
        The error of what is stated to lie within 3 m, the same of p itself, and the precision.
    """
    say("\n| p | proposals | mean p | stated within 3 m | within 3 m |\n|---|---|---|---|---|")
    for b in range(10):
        own = np.clip((told * 10).astype(int), 0, 9) == b
        if own.any():
            say(
                f"| {b / 10:.1f} to {b / 10 + 0.1:.1f} | {own.sum()} | {told[own].mean():.2f} | "
                f"{within[own].mean():.2f} | {came[own].mean():.2f} |"
            )
    sure = told >= 0.9
    precision = float(came[sure].mean()) if sure.any() else float("nan")
    return expected_error(within, came), expected_error(told, came), precision


def expected_error(told: np.ndarray, came: np.ndarray) -> float:
    """Mean difference of stated and true share, in ten bins."""
    bins = np.clip((told * 10).astype(int), 0, 9)
    return sum(
        float((bins == b).mean() * abs(told[bins == b].mean() - came[bins == b].mean()))
        for b in np.unique(bins)
    )


def arguments() -> argparse.Namespace:
    """What is to be proved."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="small", choices=("tiny", "small"))
    parser.add_argument("--blocks", default="0-11", help="which of the twelve: 0-11, or 0,3,5")
    parser.add_argument("--strong", type=int, default=0, help="so many of 1938, half new, instead")
    parser.add_argument("--seed", type=int, default=301, help="seed of the first")
    parser.add_argument("--folder", type=Path, help="where blocks are kept")
    parser.add_argument("--real", type=Path, help="a copy of vovcha-film")
    parser.add_argument("--no-operators", action="store_true")
    parser.add_argument("--no-chains", action="store_true")
    return parser.parse_args()


@dataclass
class Proof:
    """What was found so far, and which promises it breaks."""

    hits: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    told: list[np.ndarray] = field(default_factory=list)
    within: list[np.ndarray] = field(default_factory=list)
    came: list[np.ndarray] = field(default_factory=list)
    used: int = 0
    wrong: int = 0
    grounds: list[float] = field(default_factory=list)
    recalls: list[float] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)

    def operators(self, case: Case) -> None:
        """The first table, of one block."""
        names = [name for name in OPERATORS if name != "akaze" or has_akaze()]
        for operator, result in hits(case, names).items():
            key = (operator, case.level)
            self.hits[key] = self.hits.get(key, np.zeros(3)) + np.array(result)
            share, each = result[0] / max(result[1], 1), 1000 * result[2] / max(result[1], 1)
            say(f"  {operator:14s} {share:6.1%} of {result[1]:4d}  {each:7.1f} ms each")

    def chains(self, case: Case) -> None:
        """The second table, of one block."""
        thesis: Preset = "thesis-2024" if "1938" in case.name else "thesis-2024-1980s"
        rows = {"gruber": ours(case)}
        for chain in (thesis, "hoehle-2001"):
            rows[chain] = theirs(case, chain)
        say("\n| block | chain | control used | wrong | recall | ground error | photos | CPU |")
        say("|---|---|---|---|---|---|---|---|")
        seed = "" if case.level == "real" else case.folder.name.replace("p", ", ")
        for chain, row in rows.items():
            say(
                f"| {case.name}{seed} | {chain} | {row.used} | "
                f"{row.wrong / max(row.used, 1):.1%} | {row.recall:.1%} | {row.ground_m:.2f} m | "
                f"{row.photos} | {row.seconds:.0f} s |"
            )
        own, other = rows["gruber"], rows[thesis]
        self.used, self.wrong = self.used + own.used, self.wrong + own.wrong
        self.grounds.append(own.ground_m)
        if case.level != "real":
            self.told.append(own.probabilities)
            self.within.append(own.within)
            self.came.append(own.came)
            self.recalls.append(own.recall)
            if own.recall < 0.8:
                self.broken.append(f"{case.name}: recall {own.recall:.1%}")
        if not own.ground_m <= 0.5 * (other.ground_m if other.photos else np.inf):
            self.broken.append(f"{case.name}: ground error not half of the thesis's")


def planned(given: argparse.Namespace) -> list[tuple[str, str, SyntheticOptions]]:
    """The blocks that are asked for."""
    if given.strong:
        return strong_plans(given.size, given.seed, given.strong)
    first, _, last = given.blocks.partition("-")
    chosen = range(int(first), int(last) + 1) if last else [int(n) for n in first.split(",") if n]
    return [plans(given.size, given.seed)[n] for n in chosen]


def main() -> int:
    """Print both tables."""
    given = arguments()
    cv2.setNumThreads(1)
    root = given.folder or Path(tempfile.mkdtemp(prefix="control-"))
    cases = [
        (name, level, root / f"p{options.seed}", options) for name, level, options in planned(given)
    ]
    if given.real:
        cases.append(("vovcha-film", "real", given.real, None))
    proof = Proof()
    for name, level, folder, options in cases:
        case = prepared(name, level, folder, options)
        say(f"\n{name} ({folder.name}): {len(case.lasting)} junctions that stood and stand")
        if not given.no_operators:
            proof.operators(case)
        if not given.no_chains:
            proof.chains(case)
        if given.folder is None and options:
            shutil.rmtree(folder)
    summary(proof)
    for line in proof.broken:
        say(f"BROKEN {line}")
    return 1 if proof.broken else 0


def summary(proof: Proof) -> None:
    """Totals over all blocks; adds the promises they break."""
    total, used, wrong, broken = proof.hits, proof.used, proof.wrong, proof.broken
    levels = sorted({level for _, level in total})
    if total:
        say("\nhit rate within 3 m\n\n| operator | " + " | ".join(levels) + " |")
        say("|" + "---|" * (1 + len(levels)))
        for operator in dict.fromkeys(name for name, _ in total):
            cells = [total.get((operator, level), np.zeros(3)) for level in levels]
            say(f"| {operator} | " + " | ".join(f"{c[0] / max(c[1], 1):.1%}" for c in cells) + " |")
        if "strong" in levels:
            own, ncc = (total[name, "strong"] for name in ("fused", "ncc"))
            ratio = (own[0] / own[1]) / max(ncc[0] / ncc[1], 1e-9)
            say(f"fused / ncc where change is strong: {ratio:.2f}")
            if ratio < 1.6:
                broken.append(f"top-1 hit rate {ratio:.2f} times that of NCC")
    if used:
        say(f"\nwrong control among used: {wrong} of {used} ({wrong / used:.2%})")
        if wrong > 0.01 * used:
            broken.append(f"wrong control {wrong / used:.2%}")
        near = sum(ground <= STRONG_M for ground in proof.grounds)
        say(
            f"ground error at most {STRONG_M} m on {near} of {len(proof.grounds)} blocks; "
            f"mean recall {np.mean(proof.recalls or [np.nan]):.1%}"
        )
        if near < 0.9 * len(proof.grounds):
            broken.append("ground error")
    if proof.told:
        stated, plain, precision = calibration(
            *(np.concatenate(every) for every in (proof.told, proof.within, proof.came))
        )
        say(
            f"expected calibration error {stated:.3f} of what is stated to lie within 3 m, "
            f"{plain:.3f} of p itself; precision from p = 0.9 {precision:.1%}"
        )
        if stated > 0.05 or precision < 0.95:
            broken.append("calibration")


if __name__ == "__main__":
    sys.exit(main())
