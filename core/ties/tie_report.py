"""Summary of the tie points of a block: a report for each pair, and doubts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.block import Block, TiePoints
from core.doubts import Doubt, Failure
from core.said import say
from core.ties.chains import common_rays
from core.ties.matches import SAME_PHOTO
from core.ties.pair_search import PairResult


@dataclass(frozen=True, slots=True)
class PairReport:
    """How the matching of one pair went."""

    first: str
    """Photo whose name comes first."""
    second: str
    """The other photo."""
    overlap: float
    """Expected common share of the smaller footprint, 0 to 1."""
    matches: int
    """Features that look alike."""
    agreeing: int
    """Those that agree with one relative orientation."""
    log10_nfa: float
    """log10 of how many such agreements chance would give; nought when refused."""
    parallax_rms_px: float
    """RMS y-parallax of the agreeing matches before fine measurement, pixels; NaN if refused."""
    ties: int
    """Tie points kept between the two photos."""
    unexpected: bool = False
    """True when the approximate positions, within their deviations, exclude any overlap."""
    reason: str = ""
    """Why the pair was refused; empty when it was not."""
    same_photo: bool = False
    """True when both are scans of one photo."""

    @property
    def tied(self) -> bool:
        """True when the pair was accepted."""
        return not self.reason


def report_pair(result: PairResult, ties: TiePoints) -> PairReport:
    """The figures of one pair."""
    pair, found = result.pair, result.found
    if isinstance(found, Failure):
        agreeing = int(found.evidence.get("agreeing", 0))
        refused = (0.0, float("nan"), 0, False, found.reason)
        shown = (pair.first, pair.second, pair.overlap, result.matches, agreeing)
        return PairReport(*shown, *refused, same_photo=SAME_PHOTO in found.evidence)
    numbers = ties.photo_ids.index(pair.first), ties.photo_ids.index(pair.second)
    return PairReport(
        pair.first,
        pair.second,
        pair.overlap,
        result.matches,
        len(found.matches.first),
        found.pair.log10_nfa,
        found.parallax_rms_px,
        len(common_rays(ties, *numbers)[0]),
        result.unexpected,
    )


FEW_TIES = 20  # design: four to each unknown of a relative orientation
"""A photo or pair with fewer points is a doubt."""
SHOULD_TIE = 0.15  # design: less than this may be water, clouds or wood from rim to rim
"""Two photos whose footprints overlap by this share should tie."""


def assess_ties(
    block: Block, ties: TiePoints, reports: tuple[PairReport, ...]
) -> tuple[Doubt, ...]:
    """What is doubtful about the tie points: loose photos, few ties, a block in parts."""
    doubts = [
        *_photo_doubts(block, ties, reports),
        *misplaced_photos(reports),
        *_pair_doubts(reports),
    ]
    parts = connected_parts(block, reports)
    if len(parts) > 1:
        sizes = ", ".join(str(len(part)) for part in parts)
        doubts.append(
            Doubt(
                "block-in-parts",
                "block",
                say(
                    "The tie points leave the block in {count} parts ({sizes} photos): each part "
                    "must be oriented by control of its own.",
                    count=len(parts),
                    sizes=sizes,
                ),
                evidence={"parts": [list(part) for part in parts]},
            )
        )
    return tuple(doubts)


def connected_parts(block: Block, reports: tuple[PairReport, ...]) -> tuple[tuple[str, ...], ...]:
    """Groups of photos that tie points hold together, the largest first."""
    names = sorted(block.photos)
    edges = [(r.first, r.second) for r in reports if r.tied and r.ties]
    ends = np.array([[names.index(name) for name in edge] for edge in edges], dtype=np.int64)
    first, second = ends.reshape(-1, 2).T
    graph = coo_array((np.ones(len(edges)), (first, second)), shape=(len(names), len(names)))
    count, part = connected_components(graph, directed=False)
    groups = [tuple(names[i] for i in np.flatnonzero(part == number)) for number in range(count)]
    return tuple(sorted(groups, key=lambda group: (-len(group), group)))


def _photo_doubts(block: Block, ties: TiePoints, reports: tuple[PairReport, ...]) -> list[Doubt]:
    """Photos without ties, or with few."""
    doubts: list[Doubt] = []
    for name in sorted(block.photos):
        number = ties.photo_ids.index(name) if name in ties.photo_ids else -1
        count = int(np.sum(ties.photo == number))
        if count >= FEW_TIES:
            continue
        tried = [report for report in reports if name in (report.first, report.second)]
        evidence = {
            "ties": count,
            "pairs": [[r.first, r.second, r.overlap, r.matches, r.agreeing] for r in tried],
        }
        if count:
            message = say(
                "Only {count} tie points hold {name} to its neighbours.", count=count, name=name
            )
            doubts.append(Doubt("few-ties", name, message, evidence=evidence))
            continue
        why = "no other photo seems to overlap it" if not tried else "no overlap could be matched"
        message = say(
            "{name} is not tied to the block: {why}. It can only be oriented by control.",
            name=name,
            why=why,
        )
        doubts.append(Doubt("photo-not-tied", name, message, evidence=evidence))
    return doubts


def _pair_doubts(reports: tuple[PairReport, ...]) -> list[Doubt]:
    """Pairs that should have tied and did not, or hardly did."""
    doubts: list[Doubt] = []
    for report in reports:
        subject = f"{report.first} {report.second}"
        evidence = {
            "overlap": report.overlap,
            "matches": report.matches,
            "agreeing": report.agreeing,
            "ties": report.ties,
        }
        share = f"{100 * report.overlap:.0f} %"
        if report.same_photo:
            message = say(
                "{first} and {second} are scans of one photo: together they say nothing of "
                "heights, and count twice. Take one of them out of the block.",
                first=report.first,
                second=report.second,
            )
            # design: graver than likeness alone, which the scans told of: ties prove it.
            doubts.append(Doubt("same-photo", subject, message, 0.8, evidence))
        elif not report.tied and report.overlap >= SHOULD_TIE:
            message = say(
                "The photos should overlap by {share}, but did not tie. {reason}",
                share=share,
                reason=report.reason,
            )
            doubts.append(Doubt("pair-not-tied", subject, message, evidence=evidence))
        elif report.tied and report.ties < FEW_TIES:
            message = say(
                "Only {ties} tie points; the expected overlap is {share}.",
                ties=report.ties,
                share=share,
            )
            doubts.append(Doubt("pair-few-ties", subject, message, evidence=evidence))
    return doubts


def misplaced_photos(reports: Sequence[PairReport]) -> tuple[Doubt, ...]:
    """Pairs that tie although their sources put them apart."""
    return tuple(_misplaced(report) for report in reports if report.unexpected and report.tied)


def _misplaced(report: PairReport) -> Doubt:
    """A pair that ties although it should not overlap."""
    return Doubt(
        "photo-misplaced",
        f"{report.first} {report.second}",
        say(
            "The photos show the same ground in {ties} tie points, but lie side by side "
            "by their approximate positions: one of these is wrong.",
            ties=report.ties,
        ),
        evidence={"ties": report.ties, "agreeing": report.agreeing, "log10_nfa": report.log10_nfa},
    )
