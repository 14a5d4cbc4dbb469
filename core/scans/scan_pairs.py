"""Compare scans in pairs: two scans of one photo, and film scanned from the back.

Marks at the corners of a square look the same from behind, and so does a data strip; the ground
does not. Overlapping photos are matched as they are and mirrored; pairs that match only mirrored
have been scanned from different sides.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice, product
from typing import Any, cast

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from core.doubts import Doubt
from core.matching.peaks import correlation_scores
from core.raster.scan_file import ScanFile, read_overview
from core.said import say
from core.scans.film_area import FilmArea
from core.scans.naming import WAYS, Way

Look = UInt8[np.ndarray, "side side"]
Heart = Float32[np.ndarray, "heart heart"]
SIDE = 160  # design: cells of 1.7 mm; large enough for fields and woods, small to be stored
"""Cells along a side of the small picture of a scan."""
REACH = 1.22  # design: the frame and the film beyond it with the data strip
"""Width of what it shows, in frames."""
OVERVIEW_PX = 800  # design: five pixels for a cell's mean
HEART = 0.8  # design: neither the border nor marks and their housings
"""Share of the frame's width that is compared."""
FINE_CELLS, COARSE_CELLS = 0.8, 12  # design: fields stay; vignetting and single cells go
"""Blurs (Gaussian sigma) whose difference is compared."""
SAME = 0.80  # design: one photo scanned twice differs by grain and dust
"""Correlation of the pictures' hearts from which two scans show one photo."""
SHIFT_CELLS = 4  # design: 7 mm, for a frame whose border was not seen
"""How far the frames of two scans of one photo may have been found apart, cells."""
GLANCE_CELLS = 4  # design: a shift within reach is one of them at most
"""Cells that make one for a first glance at all pairs."""
# design: half of what one photo scanned twice reaches; hardly any two others do
GLANCE = 0.4
"""Correlation at a glance from which two scans are compared."""
MATCH_PX = 640  # design: details of 0.4 mm on the film, which neighbours show alike
"""Longer side of the scans that are matched as they are and mirrored."""
INSET = 0.06  # design: as far as soft borders and marks reach
"""Share of the frame along each side that is not matched."""
DETAILS = 700  # design: a few tens of them are in common at the least overlap
"""SIFT details kept of each scan."""
RATIO = 0.8  # source: Lowe 2004, section 7.1
"""Distance of the best match over that of the second best, at most."""
RELIEF_PX = 4.0  # design: relief of a hundredth of the flying height moves one about so far
"""How far a detail may lie from where a similarity of the others puts it."""
LEAST_ALIKE, LEAST_MATCHES = (
    14,
    6,
)  # design: a similarity through two matches takes up few others by chance
"""Matches that agree, from which a pair counts, and matches from which they are compared at all."""
AHEAD = 3.0  # design: of the wrong side only matches of chance agree
"""How many times more must agree mirrored than direct, or the other way round."""
NEIGHBOURS = 12  # design: three photos along the film, and what a strip of ten has beside it
"""Photos that follow in the order of names and are matched in any case."""
MOST_PAIRS = 24  # design: joins strips of up to 28 photos that follow the same direction
"""Pairs matched per photo at most, however many photos there are."""
Descriptors = Float32[np.ndarray, "_ _"]
Points = Float32[np.ndarray, "_ 2"]
Features = tuple[Points, Descriptors]


def look_of(scan: ScanFile, area: FilmArea) -> Look:
    """The frame and a margin about it as it lies in the scan, grays evened, 8 bit."""
    reduction = max(1, -(-max(scan.size_px) // OVERVIEW_PX))
    gray = np.nan_to_num(read_overview(scan, reduction))
    middle = area.corners.mean(axis=0)
    source = ((area.corners - middle) * REACH + middle) / reduction - 0.5
    target = np.array([[0, SIDE], [SIDE, SIDE], [SIDE, 0], [0, 0]]) - 0.5
    matrix = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    small = cv2.warpPerspective(gray, matrix, (SIDE, SIDE), flags=cv2.INTER_AREA)
    # design: dust covers less than one in two hundred cells.
    top = max(float(np.percentile(small, 99.5)), 1.0)
    return np.clip(small * (255 / top), 0, 255).astype(np.uint8)


def look_from(look: np.ndarray, way: Way) -> np.ndarray:
    """The look of an upright film as it would lie in a scan in another way."""
    quarter, back = way
    return np.rot90(look[:, ::-1] if back else look, quarter)


def same_photo(looks: Mapping[str, Look]) -> tuple[Doubt, ...]:
    """A doubt for every two scans that show one photo, however they lie."""
    hearts = {name: _high_pass(looks[name]) for name in sorted(looks)}
    doubts: list[Doubt] = []
    for first, second in _alike_at_a_glance(hearts):
        best = max(_alike(hearts[first], look_from(hearts[second], way)) for way in WAYS)
        if best > SAME:
            doubts.append(_same(first, second, best))
    return tuple(doubts)


def _alike_at_a_glance(hearts: Mapping[str, Heart]) -> Iterator[tuple[str, str]]:
    """Pairs that may show one photo: reduced, all are compared by a product of matrices."""
    if len(hearts) < 2:
        return
    names = list(hearts)
    side = next(iter(hearts.values())).shape[0] // GLANCE_CELLS
    small = [
        cv2.resize(heart, (side, side), interpolation=cv2.INTER_AREA) for heart in hearts.values()
    ]
    best = np.full((len(names), len(names)), -1.0, np.float32)
    still = _inner(small, (1, 1))
    for way in WAYS:
        turned = [look_from(one, way) for one in small]
        for shift in product(range(3), repeat=2):
            np.maximum(best, still @ _inner(turned, shift).T, out=best)
    for first, second in np.argwhere(np.triu(best > GLANCE, 1)).tolist():
        yield names[first], names[second]


def _inner(small: Sequence[np.ndarray], shift: tuple[int, ...]) -> Float32[np.ndarray, "_ _"]:
    """The insides of small pictures at a shift, a row each, of unit length."""
    row, column = shift
    high, wide = (side - 2 for side in small[0].shape)
    rows = np.stack([one[row : row + high, column : column + wide].ravel() for one in small])
    rows = rows - rows.mean(axis=1, keepdims=True)
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0)


def _high_pass(look: Look) -> Heart:
    """The inner four fifths of the frame, brightness of large parts taken out."""
    inset = round(SIDE * (1 - HEART / REACH) / 2)
    inner = look[inset:-inset, inset:-inset].astype(np.float32)
    calm = cast(np.ndarray, cv2.GaussianBlur(inner, (0, 0), COARSE_CELLS))
    high = cast(np.ndarray, cv2.GaussianBlur(inner, (0, 0), FINE_CELLS)) - calm
    return (high - high.mean()) / (high.std() + 0.5)


def _alike(first: np.ndarray, second: np.ndarray) -> float:
    """Greatest correlation within a few cells of shift."""
    inner = np.ascontiguousarray(second[SHIFT_CELLS:-SHIFT_CELLS, SHIFT_CELLS:-SHIFT_CELLS])
    return float(correlation_scores(np.ascontiguousarray(first), inner).max())


def _same(first: str, second: str, likeness: float) -> Doubt:
    """The doubt about two scans of one photo."""
    return Doubt(
        "same-photo",
        second,
        say(
            "{first} and {second} show the same photo: as two photos of a block they "
            "would seem to confirm each other. Exclude one in [[scans.override]] "
            "(exclude = true).",
            first=first,
            second=second,
        ),
        evidence={"other": first, "correlation": likeness},
    )


def sides_shown(scans: Mapping[str, tuple[ScanFile, FilmArea]]) -> list[dict[str, bool]]:
    """Which photos show their film from one side, and which from the other.

    Args:
        scans: File and picture area by photo, all read as they are.

    Returns:
        For every group of photos that hang together, two or more, the side of each; which of both
        sides is the front, the ground cannot say.
    """
    pictures = {name: _inside(*scan) for name, scan in scans.items()}
    direct = {name: _details(gray) for name, gray in pictures.items()}
    behind = {
        name: _details(np.ascontiguousarray(gray[:, ::-1])) for name, gray in pictures.items()
    }

    def matches(first: str, second: str) -> tuple[int, int]:
        one = direct[first]
        return _agreeing(one, direct[second]), _agreeing(one, behind[second])

    return sides_of(sorted(scans), matches)


def sides_of(
    names: Sequence[str], matches: Callable[[str, str], tuple[int, int]]
) -> list[dict[str, bool]]:
    """As `sides_shown`, of photos that are matched when they are asked for.

    Args:
        names: The photos, those that follow each other on the film side by side.
        matches: How many matches of two photos agree as they are, and with the second mirrored.
    """
    pairs = list[tuple[int, str, str, bool]]()
    group = {name: name for name in names}
    for first, second in islice(_by_distance(names, group), MOST_PAIRS * len(names)):
        as_is, turned = matches(first, second)
        more, fewer = max(as_is, turned), min(as_is, turned)
        if more >= LEAST_ALIKE and more >= AHEAD * fewer:
            pairs.append((more, first, second, turned > as_is))
            moved = group[second]
            group |= {name: group[first] for name in names if group[name] == moved}
    return _groups(names, pairs)


def _by_distance(names: Sequence[str], group: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Pairs of photos, those first whose names follow each other.

    Farther ones only if they do not hang together when their turn comes: strips that follow the
    same direction are joined so, and all pairs of a roll of hundreds need not be matched.
    """
    for apart in range(1, len(names)):
        for first, second in zip(names, names[apart:], strict=False):
            if apart <= NEIGHBOURS or group[first] != group[second]:
                yield first, second


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


def _inside(scan: ScanFile, area: FilmArea) -> UInt8[np.ndarray, "rows columns"]:
    """The inside of the picture, reduced, its grays spread out."""
    low, high = area.corners.min(axis=0), area.corners.max(axis=0)
    reduction = max(1, round(float((high - low).max()) / MATCH_PX))
    gray = np.nan_to_num(read_overview(scan, reduction))
    inset = INSET * (high - low)
    left, top = np.maximum((low + inset) / reduction, 0).astype(int).tolist()
    right, bottom = ((high - inset) / reduction).astype(int).tolist()
    part = gray[top:bottom, left:right]
    # design: dust and marks cover less than one per cent.
    dark, bright = np.percentile(part, [1, 99]) if part.size else (0.0, 1.0)
    even = np.clip((part - dark) * (255 / max(float(bright - dark), 1.0)), 0, 255)
    return even.astype(np.uint8)


def _details(gray: UInt8[np.ndarray, "rows columns"]) -> Features:
    """SIFT details of a reduced scan."""
    # The stub of this class lacks its methods.
    maker: Any = cv2
    sift = maker.SIFT_create(nfeatures=DETAILS)
    keypoints, descriptors = sift.detectAndCompute(gray, None)
    if descriptors is None or len(keypoints) < 2:
        return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
    return np.array([point.pt for point in keypoints], np.float32), descriptors


def _agreeing(first: Features, second: Features) -> int:
    """How many matches agree in one affine transform."""
    if min(len(first[0]), len(second[0])) < LEAST_MATCHES:
        return 0
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first[1], second[1], k=2)
    good = [m for m, n in matches if m.distance < RATIO * n.distance]
    if len(good) < LEAST_MATCHES:
        return 0
    source = first[0][[m.queryIdx for m in good]]
    target = second[0][[m.trainIdx for m in good]]
    cv2.setRNGSeed(1)
    estimated: Any = cv2.estimateAffinePartial2D(source, target, ransacReprojThreshold=RELIEF_PX)
    matrix, inside = estimated
    if matrix is None or not 0.5 < float(np.hypot(matrix[0, 0], matrix[1, 0])) < 2.0:
        return 0
    return int(np.sum(inside))
