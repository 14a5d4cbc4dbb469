"""The ways in which the thesis pairs points by an operator (its Table 2): D, DD, VD and VDD.

D detects in the scan and describes every place of a window in the ortho; DD detects in both; VD
describes a junction's patch and every place of a window in the scan; VDD describes the patch and
detects in the scan. K is its proposal (6.2): SIFT detects in the ortho, and that patch is compared
with every place of a window in the scan. Scan and ortho lie on one grid, and a pair is two places
of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from core.frames import HALF_PIXEL
from core.literature.baselines import OPERATORS
from core.literature.common_grid import GridPair, Places
from core.literature.detectors import (
    SIDES,
    Detector,
    Grey8,
    described,
    described_everywhere,
    detector_named,
    distances_to,
    eight_bits,
    places_of,
)

# design: as many as a photo has junctions, spread over all of it.
DETECTED = 150
"""So many of the strongest points detected in a picture are sought in the other."""
Pairs = Float64[np.ndarray, "n 2 2"]
"""For each pair its place in the scan, then that in the ortho, grid points."""
Land = Bool[np.ndarray, "rows columns"]
"""Part of a grid."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """How far is searched, and with what, pixels of the grid."""

    inner: int
    """Half the patch of a junction."""
    half: int
    """How far a point may lie from where it is expected, per axis."""


def paired(
    variant: str, pair: GridPair, junctions: Places, sizes: Sizes, within: Land | None = None
) -> Pairs:
    """Pairs of one variant, one for each point that has any.

    Args:
        variant: Operator and way, such as `sift-vdd`; `ncc-vd` correlates.
        pair: Scan and ortho.
        junctions: The junctions on the grid, all of them far enough from the rim.
        sizes: Patch and search.
        within: Where points may be detected, such as built-up land; everywhere without it.
    """
    name, way = variant.split("-")
    if way == "vd":
        return _patch_everywhere(name, pair, junctions, sizes)
    scan, ortho = eight_bits(pair.archival), eight_bits(pair.reference)
    if way == "k":
        strong = _strongest(detector_named("sift"), ortho, (pair.seen, within), sizes)
        return _patch_everywhere(name, pair, places_of(strong), sizes)
    made = detector_named(name)
    if way == "vdd":
        return _patch_on_detected(made, name, (scan, ortho), junctions, sizes)
    strong = _strongest(made, scan, (pair.seen, within), sizes)
    if not strong:
        return np.zeros((0, 2, 2))
    if way == "dd":
        land = None if within is None else within.astype(np.uint8)
        offered = made.detect(ortho, land)
        return _detected_on_detected(made, (scan, ortho), strong, offered, sizes=sizes)
    return _detected_everywhere(made, (scan, ortho), strong, sizes)


def _patch_everywhere(name: str, pair: GridPair, junctions: Places, sizes: Sizes) -> Pairs:
    operator, found = OPERATORS[name], list[np.ndarray]()
    nothing = np.zeros_like(pair.reference)
    reach = sizes.inner + sizes.half
    scan = operator.of_scan(pair.archival, sizes.inner)
    ortho = operator.of_reference(pair.reference, nothing, sizes.inner)
    for place in junctions:
        column, row = np.floor(place).astype(int).tolist()
        around, patch = (
            np.s_[row - size : row + size + 1, column - size : column + size + 1]
            for size in (reach, sizes.inner)
        )
        scores = operator.scores(
            tuple(np.ascontiguousarray(layer[around]) for layer in scan),
            tuple(np.ascontiguousarray(layer[patch]) for layer in ortho),
        )
        down, across = np.unravel_index(int(np.argmax(scores)), scores.shape)
        moved = np.array([across, down]) - sizes.half
        found.append(np.array([place + moved, place]))
    return np.array(found).reshape(-1, 2, 2)


def _patch_on_detected(
    made: Detector, name: str, images: tuple[Grey8, Grey8], junctions: Places, sizes: Sizes
) -> Pairs:
    """Both described upright and as large as the patch: the georeference tells how they lie."""
    scan, ortho = images
    size = (2 * sizes.inner + 1) / SIDES[name]
    spots = places_of(made.detect(scan, None))
    known, wanted = described(made, ortho, junctions, size)
    spots, offered = described(made, scan, spots, size)
    return _nearest(spots, offered, known, wanted, sizes)


def _strongest(
    made: Detector, image: Grey8, land: tuple[Land, Land | None], sizes: Sizes
) -> list[Any]:
    """The strongest points of what is seen, far from its rim, the best one of each place."""
    seen, within = land
    reach = sizes.inner + sizes.half
    inside = cv2.erode(seen.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=reach)
    inside[:reach], inside[-reach:], inside[:, :reach], inside[:, -reach:] = 0, 0, 0, 0
    if within is not None:
        inside[~within] = 0
    points = sorted(made.detect(image, inside), key=lambda point: -point.response)
    kept: dict[tuple[int, int], Any] = {}
    for point in points:
        kept.setdefault((int(point.pt[0]) // reach, int(point.pt[1]) // reach), point)
    return list(kept.values())[:DETECTED]


def _detected_on_detected(
    made: Detector,
    images: tuple[Grey8, Grey8],
    strong: Sequence[Any],
    detected: Sequence[Any],
    *,
    sizes: Sizes,
) -> Pairs:
    ours, wanted = made.compute(images[0], list(strong))
    theirs, offered = made.compute(images[1], detected)
    pairs = _nearest(places_of(theirs), offered, places_of(ours), wanted, sizes)
    return pairs[:, ::-1]


def _detected_everywhere(
    made: Detector, images: tuple[Grey8, Grey8], strong: Sequence[Any], sizes: Sizes
) -> Pairs:
    found: list[np.ndarray] = []
    ours, wanted = made.compute(images[0], list(strong))
    for point, own in zip(ours, wanted, strict=True):
        middle = np.array([point.pt], np.float64)
        spots, offered = described_everywhere(made, images[1], point, middle, sizes.half)
        if len(spots):
            best = int(np.argmin(distances_to(own, offered)))
            found.append(np.array([middle[0] + HALF_PIXEL, spots[best]]))
    return np.array(found).reshape(-1, 2, 2)


def _nearest(
    spots: Places, offered: np.ndarray, known: Places, wanted: np.ndarray, sizes: Sizes
) -> Pairs:
    """For each known place the spot in its window whose descriptor is nearest."""
    found: list[np.ndarray] = []
    for place, own in zip(known, wanted, strict=True):
        near = np.flatnonzero((np.abs(spots - place) <= sizes.half + HALF_PIXEL).all(axis=1))
        if len(near):
            best = near[int(np.argmin(distances_to(own, offered[near])))]
            found.append(np.array([spots[best], place]))
    return np.array(found).reshape(-1, 2, 2)
