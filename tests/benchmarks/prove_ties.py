"""What the tie points promise, on synthetic blocks with known truth and on real ones.

`python -m tests.benchmarks.prove_ties [BLOCKS] [--size tiny|small] [--seed N] [--keep FOLDER]`,
from the project's folder; real blocks are read from `GRUBER_DATA`, or left out when it is not set.
Ends with 1 when a promise is broken.
"""

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import Block, TiePoints, ground_of
from core.synthetic.options import Size, SyntheticOptions
from core.ties.chains import rays_per_point, with_rays
from core.ties.thinning import GRUBER_SIDE, frame_cells
from core.ties.tie_report import PairReport, connected_parts
from tests.benchmarks.tie_blocks import (
    TieCase,
    canberra,
    known,
    strasbourg,
    synthetic,
    true_block,
    with_control,
    wrong_points,
)
from tests.core.ties.judging import match_ties

MOST_WRONG = 0.01
LEAST_AREAS = 6
SEEN = 0.1
"""An area counts when another photo sees this share of it."""
PUBLISHED_CHECK_M = 0.421
CHANGES = (0.5, 0.33, 0.1)


def main() -> int:
    """Print the tables, and say whether every promise was kept."""
    parser = argparse.ArgumentParser()
    parser.add_argument("blocks", nargs="?", type=int, default=12)
    parser.add_argument("--size", choices=("tiny", "small"), default="tiny")
    parser.add_argument("--seed", type=int, default=7100)
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    home = asked.keep or Path(tempfile.mkdtemp())
    say("| block | ties | of three rays or more | wrong, measured | wrong, adjusted | ", "")
    say("rms px | sigma nought | areas filled / seen, least | |")
    say("|---|---|---|---|---|---|---|---|---|")
    kept = [
        judged(synthetic(home / f"{asked.size}-{options.seed}", options))
        for options in plans(asked.size, asked.seed)[: asked.blocks]
    ]
    data = Path(os.environ.get("GRUBER_DATA", ""))
    if "GRUBER_DATA" in os.environ:
        kept.append(judged(known("vovcha-film", data / "vovcha-film")))
        kept.append(strasbourg_kept(strasbourg(data)))
        kept.append(decades(canberra(data)))
    return int(not all(kept))


def plans(size: Size, first_seed: int) -> list[SyntheticOptions]:
    """Twelve blocks: two epochs, three levels of change, flat and hilly."""
    kinds = product(CHANGES, (1938, 1984), (20.0, 200.0))
    return [
        SyntheticOptions(size, epoch, relief, first_seed + number, change=change)
        for number, (change, epoch, relief) in enumerate(kinds)
    ]


def say(line: str, end: str = "\n") -> None:
    """Words at once, also into a pipe."""
    sys.stdout.write(line + end)
    sys.stdout.flush()


def judged(case: TieCase) -> bool:
    """One block with truth: wrong points before and after the adjustment, and where they lie."""
    ties, _, _ = match_ties(case.block, rng=np.random.default_rng(1), usable=case.usable)
    measured = float(np.mean(wrong_points(case, ties)))
    block = with_control(case, ties, np.random.default_rng(2))
    report = adjust_block(block, AdjustmentOptions())
    left = np.isfinite(report.tie_residuals_px[:, 0])
    standing = with_rays(ties, left)
    wrong = float(np.mean(wrong_points(case, standing)))
    filled, seen = areas(true_block(case), standing)
    short = [(a, b) for a, b in zip(filled, seen, strict=True) if a < min(LEAST_AREAS, b)]
    worst = min(zip(filled, seen, strict=True), key=lambda pair: (pair[0] - pair[1], pair[0]))
    good = wrong <= MOST_WRONG and not short
    many = int(np.sum(rays_per_point(standing) >= 3))
    say(
        f"| {case.name} | {standing.count} | {many} | {100 * measured:.2f} % | {100 * wrong:.2f} % "
        f"| {report.rms_px['tie']:.3f} | {report.sigma_nought:.2f} | {worst[0]} / {worst[1]} "
        f"| {'kept' if good else 'BROKEN'} |"
    )
    return good


def areas(true: Block, ties: TiePoints) -> tuple[list[int], list[int]]:
    """Gruber areas of each photo that hold a tie point; and those another photo sees enough of."""
    cells = frame_cells(true, ties, GRUBER_SIDE)
    filled, seen = [], []
    for name in true.photos:
        number = ties.photo_ids.index(name)
        held = set(cells[ties.photo == number].tolist())
        open_to = set(np.flatnonzero(seen_share(true, name) >= SEEN).tolist())
        filled.append(len(held & open_to))
        seen.append(len(open_to))
    return filled, seen


def seen_share(block: Block, name: str) -> np.ndarray:
    """Share of each Gruber area of a photo that another photo sees."""
    photo, camera = block.photos[name], block.camera_of(name)
    half = 0.48 * np.array(camera.frame_mm)
    line = np.linspace(-1, 1, 43)
    film = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2) * half
    ground = ground_of(photo, camera, photo.interior.pixel_from_film(film))
    seen = np.zeros(len(film), dtype=np.bool_)
    for other, another in block.photos.items():
        if other != name:
            there = another.interior.film_from_pixel(another.pixel_from_object(ground, camera))
            seen |= np.all(np.abs(there) < half, axis=1)
    share = film / np.array(camera.frame_mm) * [1, -1] + 0.5
    place = np.floor(share * GRUBER_SIDE).astype(int)
    cell = place[:, 1] * GRUBER_SIDE + place[:, 0]
    return np.bincount(cell, seen, minlength=9) / np.bincount(cell, minlength=9)


def strasbourg_kept(case: TieCase) -> bool:
    """All five frames tied, and the check points of the adjustment from our own tie points."""
    ties, reports, _ = match_ties(case.block, rng=np.random.default_rng(1))
    block = replace(case.block, ties=ties)
    report = adjust_block(block, AdjustmentOptions(estimate_cameras=False))
    off = np.array([check.difference_m for check in report.checks])
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    tied = len(connected_parts(block, reports)[0])
    filled, _ = areas(report.block, ties)
    good = tied == len(block.photos) and rms <= PUBLISHED_CHECK_M
    say(
        f"\nsxb-strasbourg: {tied} of {len(block.photos)} frames tied by {ties.count} points, "
        f"areas filled {filled}; check points {rms:.3f} m (published {PUBLISHED_CHECK_M} m), "
        f"ties {report.rms_px['tie']:.2f} px rms: {'kept' if good else 'BROKEN'}"
    )
    return good


def decades(case: TieCase) -> bool:
    """Pairs of prints of two decades: those that overlap by the index must tie, no other may."""
    ties, reports, _ = match_ties(case.block, rng=np.random.default_rng(1), usable=case.usable)
    say(f"\n{case.name}: {len(reports)} pairs tried without any positions, {ties.count} points\n")
    say("| pair | alike | agreeing | log10 of false alarms | ties |\n|---|---|---|---|---|")
    for report in reports:
        if report.tied or overlapping(report):
            say(
                f"| {report.first}, {report.second} | {report.matches} | {report.agreeing} | "
                f"{report.log10_nfa:.0f} | {report.ties} {report.reason} |"
            )
    good = all(overlapping(report) for report in reports if report.tied)
    good &= any(report.tied and same_year(report) for report in reports)
    say(f"{'kept' if good else 'BROKEN'}")
    return good


def overlapping(report: PairReport) -> bool:
    """True for the pairs of which the index says that they overlap."""
    shown = {"1985_r12_f30", "1985_r13_f44", "1968_r07_f8617"}
    return {report.first, report.second} <= shown


def same_year(report: PairReport) -> bool:
    """True for photos of one flight."""
    return report.first[:4] == report.second[:4]


if __name__ == "__main__":
    sys.exit(main())
