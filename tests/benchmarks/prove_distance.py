"""Blocks of whose camera nobody knows the principal distance, beside the same with a certificate.

Run: python -m tests.benchmarks.prove_distance [--seed 801] [--blocks 40] [--reliefs 0 60 200]
     python -m tests.benchmarks.prove_distance --scans tiny [--blocks 2]

Each flight of six photos is adjusted twice: with the principal distance of its certificate, and
with the usual lens next to it as a proposal. Printed, over all blocks of a relief: how far the
estimate is off in its own standard deviations, how well it is known, how often the verdict calls
it unknown, and how far check points are off beside the certificate. With `--scans` blocks of
synthetic scans are run instead, from block.toml without the key to the adjustment: which lens it is
is found there too. Ends with 1 when an estimate over hilly ground is off by more than three of its
standard deviations, an unknown distance leaves a block more than 1.3 times as far off, or a level
block passes for one that knows.
"""

import argparse
import contextlib
import io
import re
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from app.cli import main as gruber
from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.georeference.principal_distance import proposed_distances
from core.quality.assessment import assess_block
from core.quality.rules import judge_block
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import judge_orientations, read_truth
from sessions.session import Session
from tests.flights import FlightPlan, fly
from tests.forgotten_camera import forget_distance

SIGMAS, WORSE = 3.0, 1.3
CHECKS = 40
"""Check points of each flight."""
LEVEL_M = 10.0
"""Below this relief a block is level: it must not say that it knows."""


@dataclass(frozen=True)
class Outcome:
    """One run: what is known of the camera, and how far photos are off on the ground."""

    distance_mm: float
    sigma_mm: float
    verdict: str
    m_p: float


def outcome_of(report: AdjustmentReport, m_p: float) -> Outcome:
    """What an adjustment says of its one camera."""
    told = next(one for one in report.parameters if one.name == "principal_distance_mm")
    (camera,) = report.block.cameras.values()
    kinds = [finding.kind for finding in judge_block(assess_block(report), report)]
    verdict = next((kind for kind in kinds if kind.startswith("distance")), "certificate")
    return Outcome(camera.principal_distance_mm, told.sigma, verdict, m_p)


def flown(relief_m: float, seed: int) -> tuple[float, Outcome, Outcome]:
    """True distance, and one flight adjusted with its certificate and without."""
    plan = FlightPlan(relief_m=relief_m, check=CHECKS)
    flight = fly(plan, np.random.default_rng(seed))
    (camera,) = flight.block.cameras.values()
    usual = proposed_distances("", "", camera.frame_mm)
    nearest = min(usual, key=lambda lens: abs(lens[0] - camera.principal_distance_mm))
    forgotten = forget_distance(flight.block, *nearest)
    known, unknown = (adjust_block(block) for block in (flight.block, forgotten))
    true = flight.truth.cameras["wide"].principal_distance_mm
    return true, outcome_of(known, check_m(known)), outcome_of(unknown, check_m(unknown))


def check_m(report: AdjustmentReport) -> float:
    """RMSE of check points in plan, metres."""
    plan = np.array([check.difference_m[:2] for check in report.checks])
    return float(np.sqrt(np.mean(np.sum(plan**2, axis=1))))


def prove_flights(relief_m: float, seed: int, blocks: int) -> tuple[str, bool]:
    """One line of the table, and whether it is as it must be."""
    flights = [flown(relief_m, seed + number) for number in range(blocks)]
    away = np.array([(one.distance_mm - true) / one.sigma_mm for true, _, one in flights])
    share = np.array([one.sigma_mm / true for true, _, one in flights])
    ratio = np.array([one.m_p / known.m_p for _, known, one in flights])
    unknown = sum(one.verdict == "distance-unknown" for *_, one in flights)
    level = relief_m <= LEVEL_M
    good = bool((ratio <= WORSE).all())
    good &= unknown == blocks if level else bool((np.abs(away) <= SIGMAS).all())
    cells = (
        f"{relief_m:g} m", f"{blocks}", f"{100 * np.median(share):.2f} %",
        f"{np.sqrt(np.mean(away**2)):.2f}", f"{np.abs(away).max():.1f}", f"{unknown}",
        f"{np.median(ratio):.2f}", f"{ratio.max():.2f}",
    )  # fmt: skip
    return "| " + " | ".join(cells) + " |", good


def run(folder: Path) -> Outcome:
    """Run a block up to the adjustment and judge it."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        code = gruber(["run", str(folder), "--until", "adjustment"])
    if code:
        return Outcome(np.nan, np.nan, "the run failed", np.nan)
    with Session.open(folder, "prover") as session:
        report = cast("AdjustmentReport", session.products.latest_value("adjustment"))
    ground = judge_orientations(read_truth(folder), report.block).ground_m
    return outcome_of(report, float(np.sqrt(np.mean(np.square(ground)))))


def without_certificate(folder: Path, made: Path) -> Path:
    """The same block with nothing said of its principal distance."""
    shutil.copytree(made, folder, ignore=shutil.ignore_patterns(".gruber", "results", "*.lock"))
    file = folder / "block.toml"
    text = re.sub("principal_distance_mm.*\n", "", file.read_text(encoding="utf-8"))
    file.write_text(text, encoding="utf-8")
    return folder


def prove_scans(relief_m: float, epoch: int, seed: int, size: str) -> tuple[str, bool]:
    """One line of the table, and whether it is as it must be."""
    options = SyntheticOptions(
        size=size,  # type: ignore[arg-type]
        epoch=epoch,
        relief_m=relief_m,
        seed=seed,
    )
    with tempfile.TemporaryDirectory(prefix="distance-") as place:
        made = Path(place) / "made"
        make_block(made, options)
        true = read_truth(made).camera.principal_distance_mm
        unknown = run(without_certificate(Path(place) / "unknown", made))
        known = run(made)
    away = abs(unknown.distance_mm - true) / unknown.sigma_mm
    ratio = unknown.m_p / known.m_p
    said = unknown.verdict == "distance-unknown"
    good = ratio <= WORSE and (said if relief_m <= LEVEL_M else away <= SIGMAS)
    cells = (
        f"{relief_m:g} m, {epoch}, seed {seed}", f"{true:.2f} mm",
        f"{unknown.distance_mm:.2f} ± {unknown.sigma_mm:.2f} mm", f"{away:.1f}",
        "unknown" if said else "told", f"{known.m_p:.2f} m", f"{unknown.m_p:.2f} m", f"{ratio:.2f}",
    )  # fmt: skip
    return "| " + " | ".join(cells) + " |", good


FLIGHTS = (
    "relief", "blocks", "sigma, median", "off in sigmas, RMS", "at most", "called unknown",
    "m_p / certificate, median", "m_p ratio at most",
)  # fmt: skip
SCANS = (
    "scans", "true", "estimated", "off in sigmas", "verdict", "m_p, certificate", "m_p, unknown",
    "ratio",
)  # fmt: skip


def main() -> int:
    """Prove it on some seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=801)
    parser.add_argument("--blocks", type=int, default=40, help="of each relief")
    parser.add_argument("--scans", default="", metavar="SIZE", help="tiny, small or full")
    parser.add_argument("--reliefs", type=float, nargs="+", default=[0.0, 60.0, 200.0])
    given = parser.parse_args()
    columns = SCANS if given.scans else FLIGHTS
    say("| " + " | ".join(columns) + " |")
    say("|" + "---|" * len(columns))
    sound = True
    for relief in given.reliefs:
        lines = (
            [
                prove_scans(relief, (1938, 1984)[number % 2], given.seed + number, given.scans)
                for number in range(given.blocks)
            ]
            if given.scans
            else [prove_flights(relief, given.seed, given.blocks)]
        )
        for line, good in lines:
            say(line)
            sound = sound and good
    return 0 if sound else 1


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
