"""Which scans show their film from the back: neighbours match them only in a mirror.

Marks at the corners of a square look the same from behind, and so does a data strip; the ground
does not. Overlapping photos are matched as they are and mirrored; those that match only mirrored
have been scanned from different sides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from core.raster.scan_file import ScanFile, read_overview
from core.scans.film_area import FilmArea

Descriptors = Float32[np.ndarray, "_ _"]
Points = Float32[np.ndarray, "_ 2"]
Features = tuple[Points, Descriptors]


@dataclass(frozen=True, slots=True)
class HandednessOptions:
    """How neighbours are compared."""

    side_px: int = 640
    """Longer side of the reduced scans."""
    features: int = 700
    """Details kept of each."""
    ratio: float = 0.8
    """Distance of the best match over that of the second best, at most."""
    tolerance_px: float = 4.0
    """How far a detail may lie from where a plane transform of the others puts it: relief."""
    least: int = 14
    """Matches that agree, from which a pair counts."""
    ahead: float = 3.0
    """How many times more must agree mirrored than direct, or the other way round."""


def sides_shown(
    scans: Mapping[str, tuple[ScanFile, FilmArea]], options: HandednessOptions | None = None
) -> list[dict[str, bool]]:
    """Which photos show their film from one side, and which from the other.

    Args:
        scans: File and picture area by photo, all read as they are.
        options: How they are compared.

    Returns:
        For every group of photos that hang together, two or more, the side of each; which of both
        sides is the front, the ground cannot say.
    """
    options = options or HandednessOptions()
    pictures = {name: _heart(*scan, options.side_px) for name, scan in scans.items()}
    direct = {name: _details(gray, options) for name, gray in pictures.items()}
    behind = {
        name: _details(np.ascontiguousarray(gray[:, ::-1]), options)
        for name, gray in pictures.items()
    }
    pairs: list[tuple[int, str, str, bool]] = []
    for first, second in combinations(sorted(scans), 2):
        as_is = _agreeing(direct[first], direct[second], options)
        turned = _agreeing(direct[first], behind[second], options)
        more, fewer = max(as_is, turned), min(as_is, turned)
        if more >= options.least and more >= options.ahead * fewer:
            pairs.append((more, first, second, turned > as_is))
    return _groups(tuple(scans), pairs)


def front_is(sides: Mapping[str, bool], known: Mapping[str, bool]) -> bool | None:
    """The side of a group that is the film's front; None where halves stand against each other.

    Args:
        sides: The side of each photo of the group.
        known: Whether a photo is mirrored, of those whose marks tell; the rest are outvoted by
            them, and where no marks tell, the fewer are taken to be mirrored.
    """
    votes = [sides[name] ^ mirrored for name, mirrored in known.items() if name in sides]
    votes = votes or list(sides.values())
    ahead = 2 * sum(votes) - len(votes)
    return ahead > 0 if ahead else None


def _groups(names: Sequence[str], pairs: list[tuple[int, str, str, bool]]) -> list[dict[str, bool]]:
    """Photos that hang together and the side of each, strongest pairs first."""
    group = {name: name for name in names}
    side = dict.fromkeys(names, False)
    for _, first, second, other in sorted(pairs, reverse=True):
        if group[first] == group[second]:
            continue
        flip = side[first] ^ side[second] ^ other
        moved = group[second]
        for name in names:
            if group[name] == moved:
                group[name], side[name] = group[first], side[name] ^ flip
    members = [
        [name for name in names if group[name] == root] for root in sorted(set(group.values()))
    ]
    return [{name: side[name] for name in some} for some in members if len(some) > 1]


def _heart(scan: ScanFile, area: FilmArea, side_px: int) -> UInt8[np.ndarray, "rows columns"]:
    """The inside of the picture, reduced, its grays spread out."""
    low, high = area.corners.min(axis=0), area.corners.max(axis=0)
    reduction = max(1, round(float((high - low).max()) / side_px))
    gray = np.nan_to_num(read_overview(scan, reduction))
    inset = 0.06 * (high - low)
    left, top = np.maximum((low + inset) / reduction, 0).astype(int).tolist()
    right, bottom = ((high - inset) / reduction).astype(int).tolist()
    part = gray[top:bottom, left:right]
    dark, bright = np.percentile(part, [1, 99]) if part.size else (0.0, 1.0)
    even = np.clip((part - dark) * (255 / max(float(bright - dark), 1.0)), 0, 255)
    return even.astype(np.uint8)


def _details(gray: UInt8[np.ndarray, "rows columns"], options: HandednessOptions) -> Features:
    """SIFT details of a reduced scan."""
    # The stub of this class lacks its methods.
    maker: Any = cv2
    sift = maker.SIFT_create(nfeatures=options.features)
    keypoints, descriptors = sift.detectAndCompute(gray, None)
    if descriptors is None or len(keypoints) < 2:
        return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
    return np.array([point.pt for point in keypoints], np.float32), descriptors


def _agreeing(first: Features, second: Features, options: HandednessOptions) -> int:
    """How many matches agree in one affine transform."""
    if min(len(first[0]), len(second[0])) < 8:
        return 0
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first[1], second[1], k=2)
    good = [m for m, n in matches if m.distance < options.ratio * n.distance]
    if len(good) < 6:
        return 0
    source = first[0][[m.queryIdx for m in good]]
    target = second[0][[m.trainIdx for m in good]]
    cv2.setRNGSeed(1)
    estimated: Any = cv2.estimateAffinePartial2D(
        source, target, ransacReprojThreshold=options.tolerance_px
    )
    matrix, inside = estimated
    if matrix is None or not 0.5 < float(np.hypot(matrix[0, 0], matrix[1, 0])) < 2.0:
        return 0
    return int(np.sum(inside))
