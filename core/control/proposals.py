"""Control proposals: which candidates of a search are used.

Peaks far from the prediction, and those of a mirrored template, are certainly wrong. They show how
high chance peaks are in these photos, which gives the probability of each candidate
(`core.matching.probability`).
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.arrays import Scalars
from core.block import Block, Measurement, Source, SurveyedPoint
from core.control.calibration_check import Sightings, sightings
from core.control.search import Search
from core.matching.probability import (
    DISPLACED_M,
    Calibration,
    Searches,
    displaced,
    probabilities,
)
from core.reference.stage import ReferencePoints
from core.said import say

Kind = tuple[Source, bool]
"""Where a point comes from, and whether roads say where it is: peaks of one kind look alike."""
# design: one in ten may be wrong by its own word; the adjustment finds those.
ACCEPT = 0.9
"""A candidate as probable as this is used."""
# design: the larger half.
EVEN = 0.5
"""Below this probability a candidate is not preferred for being near."""
PROPOSED = "-ref"
"""Ends the name of a proposal whose own the user gave to a point; the order of names stays."""


def judge_searches(
    searches: Sequence[Search], sources: Mapping[str, Source]
) -> tuple[tuple[Measurement, ...], Mapping[Kind, Calibration | None]]:
    """One measurement of every search that found anything, with the probability that it is right.

    Args:
        searches: All searches of a block.
        sources: Where the points come from.

    Returns:
        The measurements, used or with the reason why not, and what the probabilities of searches
        of each kind rest on.
    """
    kinds: list[Kind] = [
        (sources.get(search.point_id, "surveyed"), search.roads) for search in searches
    ]
    photos = Counter(search.point_id for search in searches)
    measured: dict[int, Measurement] = {}
    resting: dict[Kind, Calibration | None] = {}
    for kind in sorted(set(kinds)):
        rows = [row for row, other in enumerate(kinds) if other == kind]
        chosen = [searches[row] for row in rows]
        together = pool_searches(chosen)
        right, found = probabilities(together, mapped=kind[0] == "junction")
        resting[kind] = found
        aside = np.zeros(len(right)) if found is None else displaced(together, found)
        first = np.cumsum([0, *(len(search.peaks) for search in chosen)])
        for row, search, start, end in zip(rows, chosen, first[:-1], first[1:], strict=True):
            if search.peaks:
                shared = aside[start:end] * photos[search.point_id]
                measured[row] = measurement_of(search, right[start:end], shared)
    return tuple(measured[row] for row in sorted(measured)), resting


def sightings_of(
    searches: Sequence[Search],
    sources: Mapping[str, Source],
    resting: Mapping[Kind, Calibration | None],
) -> list[Sightings]:
    """What tells how far the probabilities of proposals are borne out by where they lie.

    Args:
        searches: All searches of a block.
        sources: Where the points come from.
        resting: What the probabilities of each kind rest on, as `judged` tells.
    """
    every: list[Sightings] = []
    for kind, found in sorted(resting.items()):
        chosen = [
            search
            for search in searches
            if (sources.get(search.point_id, "surveyed"), search.roads) == kind
        ]
        if found is not None:
            window_m2 = float(np.median([search.chance.inner_m2 for search in chosen]))
            every.append(sightings(pool_searches(chosen), found, window_m2))
    return every


def pool_searches(searches: Sequence[Search]) -> Searches:
    """Searches of one kind as parallel arrays."""
    return Searches(
        np.repeat(np.arange(len(searches)), [len(search.peaks) for search in searches]),
        np.array([peak.score for search in searches for peak in search.peaks], dtype=np.float64),
        np.concatenate([np.zeros(0), *(search.distance_m for search in searches)]),
        np.concatenate([np.zeros(0), *(search.sigma_m for search in searches)]),
        len(searches),
        np.array(
            [height for search in searches for height in search.chance.heights], dtype=np.float64
        ),
        float(sum(search.chance.area_m2 for search in searches)),
    )


def measurement_of(search: Search, right: Scalars, aside: Scalars) -> Measurement:
    """The most probable candidate, used when it is probable enough; if none is, the highest.

    Where it may stand aside of its place, its standard deviation says so: else the adjustment would
    take it for a gross error, or follow it. It stands aside in all its photos alike, so that as
    many times the variance goes to each: together they know no more of it than one. One that is
    hardly probable enough counts for little.

    Args:
        search: The search.
        right: Probability of each candidate.
        aside: Probability that each stands aside, times the photos that were searched for it.
    """
    best = int(np.argmax(right)) if right.max() >= EVEN else 0
    peak, probability = search.peaks[best], float(right[best])
    others = tuple(other for index, other in enumerate(search.peaks) if index != best)
    aside_px = np.sqrt(aside[best]) * DISPLACED_M / search.pixel_m
    reason = (
        ""
        if probability >= ACCEPT
        else say("right with probability {probability:.2f}", probability=probability)
    )
    doubted = 1.0 if reason else weight_of(probability) ** -0.5
    return Measurement(
        search.point_id,
        search.photo_id,
        peak.column,
        peak.row,
        float(np.hypot(peak.sigma_px, aside_px)) * doubted,
        probability,
        "unused" if reason else "auto",
        reason,
        (peak, *others),
    )


def weight_of(probability: float) -> float:
    """What a used candidate counts for, 1 where it is certain and nearly nothing at `ACCEPT`.

    Else a candidate that crosses the threshold by a hair would move the block all at once, which
    then would move the next one across.
    """
    # design: the least is a standard deviation of four and a half times its own.
    return float(np.clip((probability - ACCEPT) / (1.0 - ACCEPT), 0.05, 1.0))


def surveyed_of(points: ReferencePoints, sources: Mapping[str, Source]) -> dict[str, SurveyedPoint]:
    """Reference points as control points."""
    return {
        point_id: SurveyedPoint(
            point_id, position, sigma, "control", sources[point_id], shifted=points.shifted
        )
        for point_id, position, sigma in zip(
            points.ids, points.positions, points.sigma_m, strict=True
        )
    }


def with_proposals(
    block: Block, points: Mapping[str, SurveyedPoint], measurements: Sequence[Measurement]
) -> Block:
    """The block with newly proposed control in place of all that was proposed before.

    Surveyed points of the user stay, and so does whatever was measured of them. A proposal that
    has the name of one of them gets another: what the user brought must not take its place.
    """
    kept = {name: point for name, point in block.surveyed.items() if point.source == "surveyed"}
    measured = {key: value for key, value in block.measurements.items() if key[0] in kept}
    proposed = dict(points)
    for name in kept.keys() & proposed.keys():
        other = name + PROPOSED
        proposed[other] = replace(proposed.pop(name), point_id=other)
    for value in measurements:
        own = value
        if value.point_id in kept:
            own = replace(value, point_id=value.point_id + PROPOSED)
        measured[own.key] = own
    named = {key[0] for key in measured}
    surveyed = {
        name: point for name, point in {**proposed, **kept}.items() if name in named or name in kept
    }
    return replace(block, surveyed=surveyed, measurements=dict(sorted(measured.items())))
