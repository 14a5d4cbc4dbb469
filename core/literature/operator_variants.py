"""The ways in which the thesis pairs points by an operator (its Table 2): D, DD, VD and VDD.

D detects in the scan and describes every place of a window in the ortho; DD detects in both; VD
describes a junction's patch and every place of a window in the scan; VDD describes the patch and
detects in the scan. Scan and ortho lie on one grid, and a pair is two places of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from jaxtyping import Float64, UInt8

from core.frames import HALF_PIXEL
from core.literature.baselines import OPERATORS
from core.literature.common_grid import GridPair, Places
from core.matching.peaks import Image

# source: Lowe 2004, section 6.1, as OpenCV has it: four bins a side, each three scales wide, a
# scale being half a keypoint's size.
SIFT_SIDE = 6.0
"""A SIFT descriptor spans so many sizes of its keypoint."""
# design: as many as a photo has junctions, spread over all of it.
DETECTED = 150
"""So many of the strongest points detected in a scan are sought in the ortho."""
Pairs = Float64[np.ndarray, "n 2 2"]
"""For each pair its place in the scan, then that in the ortho, grid points."""
Grey8 = UInt8[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True)
class Sizes:
    """How far is searched, and with what, pixels of the grid."""

    inner: int
    """Half the patch of a junction."""
    half: int
    """How far a point may lie from where it is expected, per axis."""


def paired(variant: str, pair: GridPair, junctions: Places, sizes: Sizes) -> Pairs:
    """Pairs of one variant, one for each point that has any.

    Args:
        variant: Operator and way, such as `sift-vdd`; `ncc-vd` correlates.
        pair: Scan and ortho.
        junctions: The junctions on the grid, all of them far enough from the rim.
        sizes: Patch and search.
    """
    name, way = variant.split("-")
    if way == "vd":
        return _patch_everywhere(name, pair, junctions, sizes)
    made = _library(name)
    scan, ortho = _eight_bits(pair.archival), _eight_bits(pair.reference)
    if way == "vdd":
        return _patch_on_detected(made, name, (scan, ortho), junctions, sizes)
    strong = _strongest(made, scan, pair, sizes)
    if way == "dd":
        return _detected_on_detected(made, (scan, ortho), strong, sizes)
    return _detected_everywhere(made, (scan, ortho), strong, sizes)


def _library(name: str) -> Any:
    """OpenCV's operator; its ORB keeps 500 points unless told otherwise."""
    library = cast("Any", cv2)
    # design: no limit that would count.
    return library.SIFT_create() if name == "sift" else library.ORB_create(nfeatures=100_000)


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
    made: Any, name: str, images: tuple[Grey8, Grey8], junctions: Places, sizes: Sizes
) -> Pairs:
    """Both described upright and as large as the patch: the georeference tells how they lie."""
    scan, ortho = images
    size = (2 * sizes.inner + 1) / (SIFT_SIDE if name == "sift" else 1.0)
    spots = _places(made.detect(scan, None))
    known, wanted = _described(made, ortho, junctions, size)
    spots, offered = _described(made, scan, spots, size)
    return _nearest(spots, offered, known, wanted, sizes)


def _strongest(made: Any, scan: Grey8, pair: GridPair, sizes: Sizes) -> list[Any]:
    """The strongest points of the scan far from its rim, the best one of each place."""
    reach = sizes.inner + sizes.half
    inside = cv2.erode(pair.seen.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=reach)
    inside[:reach], inside[-reach:], inside[:, :reach], inside[:, -reach:] = 0, 0, 0, 0
    points = sorted(made.detect(scan, inside), key=lambda point: -point.response)
    kept: dict[tuple[int, int], Any] = {}
    for point in points:
        kept.setdefault((int(point.pt[0]) // reach, int(point.pt[1]) // reach), point)
    return list(kept.values())[:DETECTED]


def _detected_on_detected(
    made: Any, images: tuple[Grey8, Grey8], strong: Sequence[Any], sizes: Sizes
) -> Pairs:
    ours, wanted = made.compute(images[0], list(strong))
    theirs, offered = made.compute(images[1], made.detect(images[1], None))
    pairs = _nearest(_places(theirs), offered, _places(ours), wanted, sizes)
    return pairs[:, ::-1]


def _detected_everywhere(
    made: Any, images: tuple[Grey8, Grey8], strong: Sequence[Any], sizes: Sizes
) -> Pairs:
    """Every place of the ortho's window described in the size and direction of the point."""
    steps = np.arange(-sizes.half, sizes.half + 1, dtype=np.float64)
    offsets = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2)
    found: list[np.ndarray] = []
    ours, wanted = made.compute(images[0], list(strong))
    for point, own in zip(ours, wanted, strict=True):
        middle = np.array(point.pt, np.float64)
        # Beyond the window the descriptors of its rim reach, and the blur of their octaves.
        room = sizes.half + round(SIFT_SIDE * point.size)
        low = np.maximum(np.floor(middle).astype(int) - room, 0)
        part = images[1][low[1] : low[1] + 2 * room + 2, low[0] : low[0] + 2 * room + 2]
        every = [
            cv2.KeyPoint(across, down, point.size, point.angle, 0, point.octave)
            for across, down in (middle - low + offsets).tolist()
        ]
        kept, offered = made.compute(np.ascontiguousarray(part), every)
        best = int(np.argmin(_distances(own, offered)))
        found.append(np.array([middle, low + np.array(kept[best].pt)]) + HALF_PIXEL)
    return np.array(found).reshape(-1, 2, 2)


def _described(made: Any, image: Grey8, places: Places, size: float) -> tuple[Places, np.ndarray]:
    """Upright descriptors of one size, and the places that have one."""
    points = [cv2.KeyPoint(x, y, size, 0.0) for x, y in (places - HALF_PIXEL).tolist()]
    kept, descriptors = made.compute(image, points)
    return _places(kept), np.zeros((0, 1)) if descriptors is None else descriptors


def _places(points: Sequence[Any]) -> Places:
    """Grid points of keypoints, which OpenCV counts from the middle of the first pixel."""
    return np.array([point.pt for point in points], np.float64).reshape(-1, 2) + HALF_PIXEL


def _nearest(
    spots: Places, offered: np.ndarray, known: Places, wanted: np.ndarray, sizes: Sizes
) -> Pairs:
    """For each known place the spot in its window whose descriptor is nearest."""
    found: list[np.ndarray] = []
    for place, own in zip(known, wanted, strict=True):
        near = np.flatnonzero((np.abs(spots - place) <= sizes.half + HALF_PIXEL).all(axis=1))
        if len(near):
            best = near[int(np.argmin(_distances(own, offered[near])))]
            found.append(np.array([spots[best], place]))
    return np.array(found).reshape(-1, 2, 2)


def _distances(own: np.ndarray, offered: np.ndarray) -> np.ndarray:
    """Euclidean distances of SIFT, Hamming distances of ORB."""
    if own.dtype == np.uint8:
        return np.unpackbits(np.bitwise_xor(own, offered).view(np.uint8), axis=1).sum(axis=1)
    return np.linalg.norm(offered - own, axis=1)


def _eight_bits(image: Image) -> Grey8:
    """Grey values as OpenCV's operators take them."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
