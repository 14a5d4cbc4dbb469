"""Pairs of photos that may show the same ground, from their approximate orientation."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from shapely import Polygon, contains_xy, prepare

from core.arrays import Flags, ObjectPoints
from core.block import Block, footprint, position_sigma_m

# design: neighbouring strips overlap by 20 to 35 %; heights and tilts may leave a quarter of that
LEAST_OVERLAP = 0.05
"""Share of the smaller footprint that two footprints must have in common."""
# design: 95 of 100 good georeferences; photos left loose are tried everywhere later
GROWTH_SIGMAS = 2.0
"""Footprints grow by this many standard deviations of the photos' relative position."""
MOST_GROWTH = 0.5  # design: more would pair every photo with its neighbours' neighbours
"""Footprints never grow by more than this share of the smaller footprint's side."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePair:
    """Two photos that may overlap."""

    first: str
    """Photo whose name comes first."""
    second: str
    """The other photo."""
    overlap: float
    """Expected common share of the smaller footprint, 0 to 1, without any growth."""
    first_region: Polygon | None
    """Where the second photo may be seen on the ground of the first one, metres; None: anywhere."""
    second_region: Polygon | None
    """Where the first photo may be seen on the ground of the second one, metres; None: anywhere."""


def find_pairs(block: Block) -> tuple[CandidatePair, ...]:
    """All pairs of a block whose footprints may overlap, by name.

    Positions may be hundreds of metres off: a pair is tried when its footprints, grown by the
    standard deviations of the photos' positions, have the wanted share in common. Where positions
    are not known to a footprint every pair is tried, and no overlap is expected of it.
    """
    prints = {name: footprint(photo, block.camera_of(name)) for name, photo in block.photos.items()}
    found: list[CandidatePair] = []
    for first, second in combinations(sorted(block.photos), 2):
        ours, theirs = prints[first], prints[second]
        smaller = min(ours.area, theirs.area)
        if smaller <= 0:
            continue
        if _sigma_m(block, first, second) > np.sqrt(smaller):
            found.append(CandidatePair(first, second, 0.0, None, None))
            continue
        growth = _growth_m(block, first, second, float(np.sqrt(smaller)))
        if ours.distance(theirs) > growth:
            continue
        second_grown, first_grown = theirs.buffer(growth), ours.buffer(growth)
        if ours.intersection(second_grown).area / smaller < LEAST_OVERLAP:
            continue
        found.append(
            CandidatePair(
                first,
                second,
                float(ours.intersection(theirs).area / smaller),
                second_grown,
                first_grown,
            )
        )
    return tuple(found)


def within(region: Polygon, points: ObjectPoints) -> Flags:
    """True for ground points inside a region."""
    prepare(region)
    return np.asarray(contains_xy(region, points[:, 0], points[:, 1]), dtype=np.bool_)


def _growth_m(block: Block, first: str, second: str, side_m: float) -> float:
    """By how much footprints grow before they are compared."""
    return min(GROWTH_SIGMAS * _sigma_m(block, first, second), MOST_GROWTH * side_m)


def _sigma_m(block: Block, first: str, second: str) -> float:
    """Standard deviation of the relative position of two footprints, metres."""
    one, other = (position_sigma_m(block.photos[name]) for name in (first, second))
    return float(np.hypot(one, other))
