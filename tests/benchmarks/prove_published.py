"""The adjustment against what other programs published of the same observations.

`python -m tests.benchmarks.prove_published`, from the project's folder; the blocks are read from
`GRUBER_DATA`. Ends with 1 when a promise is broken.
"""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.block import Block
from tests.real.readers import (
    ADDIS,
    RC30,
    SXB,
    SXB_MARK_SIGMA_PX,
    read_addis,
    read_addis_orientation,
    read_rc30,
    read_rc30_orientation,
    read_sxb,
    read_sxb_report,
    with_checks_as_ties,
)

PLAIN = AdjustmentOptions(estimate_cameras=False, robust=False)
SNOOPING = AdjustmentOptions(estimate_cameras=False)
DBAT_SIGMA_PX, DBAT_CHECK_M = 0.589299, 0.421
ERDAS_BAD_PX = float(np.hypot(-7.479, -3.472))
BAD_PICKS = {"Addis Ababa": ("2", "4093"), "RC30": ("20501", "63")}


def main() -> int:
    """Print the table, and say whether every promise was kept."""
    data = Path(os.environ["GRUBER_DATA"])
    say("| figure | found | promised | |\n|---|---|---|---|")
    kept = [*strasbourg(data / SXB), *addis(data / ADDIS), *resections(data / RC30)]
    return int(not all(kept))


def say(line: str) -> None:
    """One line at once, also into a pipe."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def promise(what: str, value: float, limit: float, unit: str = "") -> bool:
    """One line of the table."""
    good = value <= limit
    mark = "kept" if good else "BROKEN"
    say(f"| {what} | {value:.3g}{unit} | at most {limit:g}{unit} | {mark} |")
    return good


def strasbourg(folder: Path) -> list[bool]:
    """DBAT's report of SXB: its check points take part as unknown points."""
    block = read_sxb(folder)
    same = adjust_block(with_checks_as_ties(block), PLAIN)
    sigma = same.sigma_nought * SXB_MARK_SIGMA_PX
    off = [
        np.abs(same.block.photos[name].exterior.centre - known.centre).max()
        for name, known in read_sxb_report(folder).items()
    ]
    theirs = deviations(folder / "result/report.txt")
    ratios = []
    for name, known in theirs.items():
        ours = same.exterior_sigmas[name]
        mine = np.concatenate([np.degrees(ours.angles), ours.centre_m])
        ratios += list(np.abs(mine / known - 1))
    checks = np.array([check.difference_m for check in adjust_block(block, PLAIN).checks])
    rms = float(np.sqrt(np.mean(np.sum(checks**2, axis=1))))
    return [
        promise("SXB, sigma nought against DBAT", 100 * abs(sigma / DBAT_SIGMA_PX - 1), 2, " %"),
        promise("SXB, centres against DBAT", 1000 * max(off), 1, " mm"),
        promise(
            f"SXB, {len(ratios)} standard deviations of orientations against DBAT, largest",
            100 * max(ratios),
            2,
            " %",
        ),
        promise("SXB, check points", rms, DBAT_CHECK_M, " m"),
    ]


def deviations(report: Path) -> dict[str, np.ndarray]:
    """Standard deviations of each photo: omega, phi, kappa in degrees, X, Y, Z in metres."""
    found: dict[str, list[float]] = {}
    photo = ""
    for line in report.read_text().splitlines():
        words = line.replace(":", " ").split()
        if words[:1] == ["Photo"] and words[-1].endswith(".jpg"):
            photo = words[-1].removesuffix(".jpg")
        elif photo and words[:1] == ["Deviation"] and len(found.get(photo, [])) < 6:
            found.setdefault(photo, []).append(float(words[1]))
    return {name: np.array(values) for name, values in found.items()}


def addis(folder: Path) -> list[bool]:
    """The result of ERDAS with the same weights, and the bad pick in it."""
    block = read_addis(folder)
    report = adjust_block(block, PLAIN)
    off = [
        np.abs(report.block.photos[name].exterior.centre - known.centre).max()
        for name, known in read_addis_orientation(folder).items()
    ]
    bad = float(np.hypot(*report.residuals_px[BAD_PICKS["Addis Ababa"]]))
    return [
        promise("Addis Ababa, centres against ERDAS", 1000 * max(off), 20, " mm"),
        promise(
            "Addis Ababa, residual of point 2 on 4093 against ERDAS",
            abs(bad - ERDAS_BAD_PX),
            0.05,
            " px",
        ),
        found_alone("Addis Ababa", block),
    ]


def found_alone(name: str, block: Block) -> bool:
    """True when snooping leaves out the known bad pick."""
    free = {key: replace(m, status="auto") for key, m in block.measurements.items()}
    report: AdjustmentReport = adjust_block(replace(block, measurements=free), SNOOPING)
    good = BAD_PICKS[name] in report.rejected
    told = ", ".join(f"{point} on {photo}" for point, photo in sorted(report.rejected))
    say(
        f"| {name}, left out | {told} | {' on '.join(BAD_PICKS[name])} among them | "
        f"{'kept' if good else 'BROKEN'} |"
    )
    return good


def resections(folder: Path) -> list[bool]:
    """Two published resections, and the bad pick in one of them."""
    block = read_rc30(folder)
    report = adjust_block(block, PLAIN)
    places, turns = [], []
    for name, known in read_rc30_orientation(folder).items():
        ours = report.block.photos[name].exterior
        places.append(np.abs(ours.centre - known.centre).max())
        turns += [abs(getattr(ours, a) - getattr(known, a)) for a in ("omega", "phi", "kappa")]
    return [
        promise("RC30, centres against the resections", 1000 * max(places), 1, " mm"),
        promise("RC30, angles against the resections", float(np.degrees(max(turns))), 1e-4, "°"),
        found_alone("RC30", block),
    ]


if __name__ == "__main__":
    sys.exit(main())
