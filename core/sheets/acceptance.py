"""Map sheets accepted by samples: how many of a lot are judged, and what follows for all of them.

A lot is accepted where no more sheets of its sample are bad than the acceptance number. Sheets are
drawn without replacement from a lot of known size, so the number of bad ones among them has the
hypergeometric distribution (ISO 2859-2, isolated lots), which is taken as it is. ISO 2859-1 tables
plans for series of lots by its limits, the binomial and the Poisson distribution.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, comb, floor
from typing import Literal

import numpy as np
from shapely.geometry import MultiPolygon, Polygon

from core.quality.job_rules import JobRules
from core.quality.readings import PlanFigures
from core.quality.rules import DOUBTFUL, POOR, SOUND, Finding
from core.sheets.map_sheets import MapSheet

SheetState = Literal["good", "bad", "open"]
"""What a drawn sheet is; open: nothing decides yet."""
LotState = Literal["accepted", "rejected", "open"]
"""What follows for the lot; open: sheets wait that may still decide it."""
# design: far above the rounding of per cents times counts, far below a sheet.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class SamplingPlan:
    """How many sheets of a lot are judged, and how many of them may be bad."""

    lot: int
    """Sheets of the lot."""
    sample: int
    """Sheets that are drawn from it."""
    accepted: int
    """Acceptance number: with more bad sheets in the sample the lot is rejected."""

    def acceptance(self, bad: int) -> float:
        """Operating characteristic: how often a lot with so many bad sheets is accepted, 0 to 1."""
        return _acceptance(self.lot, self.sample, self.accepted, bad)


@dataclass(frozen=True, slots=True)
class DrawnSheet:
    """A sheet that was drawn."""

    name: str
    """As the index has it."""
    area: Polygon | MultiPolygon
    """What it showed when it was drawn, in the block's CRS."""


@dataclass(frozen=True, slots=True)
class JudgedSheet:
    """A drawn sheet, and what decides whether it is good."""

    sheet: DrawnSheet
    """The sheet."""
    faults: int
    """Faults marked on it that are open."""
    read: PlanFigures
    """What readings of places on it say together."""
    said: bool | None
    """False where anybody's last word on it, as the mosaic is now, is that it is bad; None where
    nobody said anything."""
    limit_m: float
    """Position error up to which it is good, metres."""

    @property
    def by_readings(self) -> SheetState:
        """What readings alone decide: their whole 95 % interval lies on one side of the limit."""
        low, high = self.read.m_p_interval
        return "bad" if low > self.limit_m else "good" if high <= self.limit_m else "open"

    @property
    def state(self) -> SheetState:
        """Bad by any evidence; else good by readings or because somebody said so."""
        if self.faults or self.by_readings == "bad" or self.said is False:
            return "bad"
        return "good" if self.said or self.by_readings == "good" else "open"


@dataclass(frozen=True, slots=True)
class JudgedLot:
    """The sample that was drawn last, and what it says of its lot."""

    plan: SamplingPlan
    """How it was drawn."""
    sheets: tuple[JudgedSheet, ...]
    """Its sheets, in the order of their names."""
    changed: bool
    """The sheets of the block, or the limits of the job, are others than when it was drawn."""
    replaced: int = 0
    """Sheets of earlier samples of the same lot that are judged as the mosaic is now."""
    rejected: int = 0
    """Earlier samples of the same lot by which it is rejected as all is now."""

    def count(self, state: SheetState) -> int:
        """Sheets of a state."""
        return sum(one.state == state for one in self.sheets)

    @property
    def state(self) -> LotState:
        """Rejected as soon as too many are bad, accepted once none waits."""
        if self.count("bad") > self.plan.accepted:
            return "rejected"
        return "open" if self.count("open") else "accepted"


@cache
def smallest_plan(lot: int, rules: JobRules) -> SamplingPlan:
    """The smallest sample that keeps both risks of a job.

    Args:
        lot: Sheets of the lot, one at least.
        rules: Shares of bad sheets that are to be accepted and rejected, and both risks.
    """
    good, bad = bad_sheets(lot, rules)
    sure, risk = 1 - rules.producer_risk_percent / 100, rules.consumer_risk_percent / 100
    for accepted in range(good + 1):
        # The more sheets are drawn, the rarer either lot is accepted.
        low, high = accepted + 1, lot
        while low < high:
            middle = (low + high) // 2
            kept = _acceptance(lot, middle, accepted, bad) <= risk + ROUNDING
            low, high = (low, middle) if kept else (middle + 1, high)
        if _acceptance(lot, low, accepted, good) >= sure - ROUNDING:
            return SamplingPlan(lot, low, accepted)
    raise AssertionError("a lot with as many bad sheets as are accepted is always accepted")


def bad_sheets(lot: int, rules: JobRules) -> tuple[int, int]:
    """Most bad sheets of a lot that is to be accepted, and fewest of one that is to be rejected."""
    bad = min(lot, max(1, ceil(lot * rules.sheets_bad_percent / 100 - ROUNDING)))
    good = floor(lot * rules.sheets_good_percent / 100 + ROUNDING)
    good = min(good, lot - 1)
    return good, max(bad, good + 1)


def draw_sheets(lot: Sequence[MapSheet], plan: SamplingPlan, seed: int) -> tuple[DrawnSheet, ...]:
    """The sheets of a sample, each as likely as any other, in the order of their names.

    Args:
        lot: Every sheet; their order does not matter.
        plan: How many are drawn.
        seed: What they are drawn with: the same sheets for the same seed.
    """
    ordered = sorted(lot, key=lambda sheet: sheet.name)
    chosen = np.random.default_rng(seed).permutation(len(ordered))[: plan.sample]
    drawn = (ordered[number] for number in sorted(chosen.tolist()))
    return tuple(DrawnSheet(sheet.name, sheet.area) for sheet in drawn)


def lot_findings(lot: JudgedLot, rules: JobRules) -> tuple[Finding, ...]:
    """What a sample says of the block's sheets.

    Args:
        lot: The sample that was drawn last.
        rules: Limits of the job.
    """
    plan = lot.plan
    good, bad = bad_sheets(plan.lot, rules)
    told = {
        "lot": str(plan.lot),
        "sample": str(plan.sample),
        "accepted": str(plan.accepted),
        "bad": str(lot.count("bad")),
        "open": str(lot.count("open")),
        "producer": f"{100 * (1 - plan.acceptance(good)):.1f}",
        "consumer": f"{100 * plan.acceptance(bad):.1f}",
        "good_percent": f"{rules.sheets_good_percent:g}",
        "bad_percent": f"{rules.sheets_bad_percent:g}",
    }
    grave = {"accepted": SOUND, "open": DOUBTFUL, "rejected": POOR}[lot.state]
    found = [Finding(f"sheets-{lot.state}", grave, told)]
    if lot.changed:
        found = [Finding("sheets-changed", POOR if lot.state == "rejected" else DOUBTFUL, told)]
    if lot.rejected:
        found.insert(0, Finding("sheets-rejected-before", POOR, {"count": str(lot.rejected)}))
    if lot.replaced:
        found.append(Finding("sheets-replaced", DOUBTFUL, {"count": str(lot.replaced)}))
    return tuple(found)


@cache
def _acceptance(lot: int, sample: int, accepted: int, bad: int) -> float:
    """How often at most so many of a sample are bad: a hypergeometric sum, in whole numbers."""
    most = min(accepted, bad, sample)
    ways = sum(comb(bad, k) * comb(lot - bad, sample - k) for k in range(most + 1))
    return ways / comb(lot, sample)
