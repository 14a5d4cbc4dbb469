"""Where two straight edges of a frame meet: the point of notches, teeth and wings.

Pictures beside such marks differ from side to side, and so do their figures, each of which was
filed by itself. What they share is the corner that one lays two rulers along: both edges are
sought as steps of gray and drawn out as lines. Film on one side of an edge is even, picture on the
other is not; so the step is taken where it is steepest and where it is half way, and both must
agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import cv2
import numpy as np
from jaxtyping import Float64

from core.doubts import Failure
from core.geometry.robust import TINY, cauchy_weights, robust_sigma
from core.scans.centring import (
    FAR,
    SPLINE_PX,
    Centre,
    Gray,
    Spline,
    Weights,
    blur_as_scanned,
    correlation,
    disc_weights,
    sample_about,
    spline_of,
)
from core.scans.outlines import (
    CORRELATED,
    REACH_PX,
    REWEIGHTED,
    ROUGHEST_PX,
    steps_of_gray,
)

NEAREST_MM, FARTHEST_MM, LEAST_MM = 0.2, 1.5, 0.35  # design: tips are rounded; steps of wings 0.6
"""From where to where an edge is followed from its corner, and how long it is seen at least."""
NEAREST_PX, LEAST_PX = 3.0, 6.0  # design: the blur of the other edge; a line by three independent
"""The same in pixels, of coarse scans."""
FINE_MM = 0.08  # design: a step is looked at for ten pixels, edges of marks are a millimetre
"""Largest pixel in which edges are lines that go before what else is known of a mark."""
COARSEST_MM = FARTHEST_MM / (NEAREST_PX + LEAST_PX)  # design: an edge shorter is none
"""Largest pixel in which edges are lines at all."""
DIRECTIONS = 90  # design: edges a millimetre long are as wide as four degrees
"""Directions in which edges are sought about a point."""
BENT_PX, GAP_MM = 1.5, 0.15  # design: the blur of a step; a scratch across an edge
"""How far from its line an edge still is straight, and how much of it may be missing."""
FEW_DIRECTIONS = 45  # design: the same half a millimetre long, for every pixel of a window
ALONG = 0.65  # design: within 45 degrees: noise and blur turn slopes of weak edges
"""Share of a slope of gray that lies across a direction where an edge runs along it."""
WEAK, STEEPEST = 0.1, 99  # design: grain and texture beside a frame; all but dust and scratches
"""Slope that counts half, as a share of the steepest, and per cent of slopes below that."""
LEAST_EDGE = 0.6  # design: more than half of its shortest length
"""How much of its shortest length an edge must be seen."""
STRAIGHT_DEG, SHARP_DEG = 25.0, 20.0  # design: a bend of an edge; the thinnest tooth
"""Two edges that are nearly one, or nearly fold up, make no corner."""
TURNED_DEG, FOUND_DEG = 6.0, 15.0  # design: teeth are filed by hand; as edges are looked for
"""How much an edge may be turned against the same edge of another mark, and as it was found."""
BESIDE_MM = (0.0, -0.1, 0.1)  # design: half of what is left out about a corner
"""How far beside a place edges that meet are looked for, along and across."""
LEAST_ALIKE = 0.5  # design: thin lines 0.3, corners in texture 0.8
"""Likeness to two even grays below which edges by a first look are no corner."""
PLACES, TRIED_PLACES = 250, 3  # design: time; texture is full of corners that are none
"""Places of a window at which corners are looked for, and those measured for each that is kept."""
LIKE_CORNER = 0.8  # design: corners in texture reach less, those of frames 0.85 and more
"""Likeness to two even grays from which there is a corner."""
TRIED_PAIRS = 3  # design: time
"""Pairs of edges about a place that are tried, best seen first."""
MEDIAN_LOSS = np.pi / 2  # source: variance of a median of normal values over that of their mean
FOLLOWED = 4  # design: twice what edges of usual length take
"""How often an edge is followed further."""
LOOKED_MM = 0.6  # design: steps of wings are as long
"""Radius about a corner within which the grays on both sides of its edges are compared."""
ROUNDS = 8  # design: twice what clean corners take
CONVERGED_PX = 0.01  # design: a tenth of the goal of the centring


@dataclass(frozen=True, slots=True)
class Edge:
    """A straight edge that runs from a corner."""

    angle: float
    """Its direction, radians, column towards row."""
    rises: bool
    """True where it brightens clockwise (column towards row) across it."""


Edges = tuple[Edge, Edge]
_Pair = tuple[float, float, float]
"""How well two edges that may meet are seen, and their directions: rising and falling."""


def turned_edges(edges: Edges, was: float, points: float, mirrored: bool) -> Edges:
    """The edges of a corner as they lie elsewhere.

    Args:
        edges: Where they were seen.
        was: Direction there from the middle of the photo, radians.
        points: Direction here.
        mirrored: Seen as in a mirror along that direction.
    """
    sign = -1.0 if mirrored else 1.0
    first, second = (
        Edge(points + sign * (one.angle - was), one.rises != mirrored) for one in edges
    )
    return first, second


def edges_about(
    gray: Gray, place: tuple[float, float], limit_px: float, cell_mm: float
) -> tuple[Centre, Edges] | None:
    """The corner at a place, and the two edges that meet in it; None where there are not two.

    Args:
        gray: A window, without NaN.
        place: Column and row, a little beside the corner where somebody pointed.
        limit_px: How far from there the corner may be.
        cell_mm: Size of a pixel, millimetres.
    """
    if cell_mm > COARSEST_MM:
        return None
    soft, slopes = _softened(gray)
    beside = np.array(BESIDE_MM) / cell_mm
    starts = [
        (float(place[0] + right), float(place[1] + down)) for right, down in product(beside, beside)
    ]
    for start, pairs in zip(starts, _pairs(slopes, starts, cell_mm), strict=True):
        for _, edges in _guesses(soft, pairs, start, cell_mm)[:TRIED_PAIRS]:
            met = _met(soft, start, limit_px, edges, cell_mm, half_way=True, turned_deg=FOUND_DEG)
            if isinstance(met, Failure) or likeness_of(soft, *met, cell_mm) < LIKE_CORNER:
                continue
            if np.hypot(met[0].column - place[0], met[0].row - place[1]) < limit_px:
                return met
    return None


def corners_in(
    gray: Gray, limit_px: float, cell_mm: float, count: int
) -> list[tuple[Centre, Edges, float]]:
    """The corners of a window with their edges and likeness, likest first.

    Args:
        gray: The window, without NaN.
        limit_px: How far beside a place at which edges seem to meet they may do so; half of it
            parts two corners.
        cell_mm: Size of a pixel, millimetres.
        count: How many are kept.
    """
    soft, slopes = _softened(gray)
    meeting = _meeting(slopes, cell_mm)
    guesses = [
        (like, place, edges)
        for place, pairs in zip(meeting, _pairs(slopes, meeting, cell_mm), strict=True)
        for like, edges in _guesses(soft, pairs, place, cell_mm)[:1]
    ]
    guesses.sort(key=lambda guess: -guess[0])
    apart: list[tuple[tuple[float, float], Edges]] = []
    for _, place, edges in guesses:
        if not any(_same(place, edges, *other, limit_px) for other in apart):
            apart.append((place, edges))
    found: list[tuple[Centre, Edges, float]] = []
    for place, edges in apart[: TRIED_PLACES * count]:
        met = _met(soft, place, limit_px, edges, cell_mm, half_way=True, turned_deg=FOUND_DEG)
        if not isinstance(met, Failure):
            found.append((*met, likeness_of(soft, *met, cell_mm)))
    kept: list[tuple[Centre, Edges, float]] = []
    for one in sorted(found, key=lambda one: -one[2]):
        away = [np.hypot(one[0].column - k[0].column, one[0].row - k[0].row) for k in kept]
        if one[2] > LIKE_CORNER and min(away, default=limit_px) > limit_px / 2:
            kept.append(one)
    return kept[:count]


def _same(
    place: tuple[float, float],
    edges: Edges,
    other: tuple[float, float],
    others: Edges,
    limit_px: float,
) -> bool:
    """True for two guesses of one corner."""
    turned = max(angle_between(a.angle, b.angle) for a, b in zip(edges, others, strict=True))
    near = np.hypot(place[0] - other[0], place[1] - other[1]) < limit_px
    return bool(near and turned < np.radians(2 * FOUND_DEG))


def _softened(gray: Gray) -> tuple[Gray, tuple[Gray, Gray]]:
    """A window under the blur of scans, and its slopes right and down."""
    soft = blur_as_scanned(gray).astype(np.float32)
    return soft, (np.gradient(soft, axis=1), np.gradient(soft, axis=0))


def _guesses(
    soft: Gray, pairs: Sequence[_Pair], place: tuple[float, float], cell_mm: float
) -> list[tuple[float, Edges]]:
    """Edges that may meet at a place and part two grays there, likest first."""
    guesses: list[tuple[float, Edges]] = []
    patch = _looked_at(soft, place, cell_mm) if pairs else soft
    for _, rise, fall in sorted(pairs, reverse=True)[:TRIED_PAIRS]:
        edges = Edge(rise, True), Edge(fall, False)
        like = _parted(patch, edges)
        if like > LEAST_ALIKE:
            guesses.append((like, edges))
    return sorted(guesses, key=lambda guess: -guess[0])


def _pairs(
    slopes: tuple[Gray, Gray], places: Sequence[tuple[float, float]], cell_mm: float
) -> list[list[_Pair]]:
    """Edges of both polarities that may meet at each place."""
    if not places:
        return []
    angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    away = np.arange(_nearest(cell_mm), _nearest(cell_mm) + _least(cell_mm))
    at, shape = np.array(places)[:, :, None, None], (len(places), -1)
    columns, rows = (
        (at[:, k] + along(angles)[:, None] * away - 0.5).astype(np.float32).reshape(shape)
        for k, along in enumerate((np.cos, np.sin))
    )
    right, down = (
        cv2.remap(one, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(
            len(places), len(angles), len(away)
        )
        for one in slopes
    )
    across = down * np.cos(angles)[:, None] - right * np.sin(angles)[:, None]
    steep = np.hypot(right, down)
    usual = np.percentile(steep.reshape(shape), STEEPEST, axis=1)[:, None, None]
    share = across / (steep + WEAK * usual + TINY)
    rising, falling = (_edges_of(sign * share, angles) for sign in (1.0, -1.0))
    least, most = np.radians(SHARP_DEG), np.pi - np.radians(STRAIGHT_DEG)
    return [
        [
            (min(rise[1], fall[1]), rise[0], fall[0])
            for rise, fall in product(*both)
            if least < angle_between(rise[0], fall[0]) < most
        ]
        for both in zip(rising, falling, strict=True)
    ]


def _meeting(slopes: tuple[Gray, Gray], cell_mm: float) -> list[tuple[float, float]]:
    """Where two edges may meet in a window, best seen first: column and row of a pixel's middle."""
    right, down = slopes
    steep = np.hypot(right, down)
    steep += np.float32(WEAK * np.percentile(steep, STEEPEST) + TINY)
    away = np.arange(_nearest(cell_mm), _nearest(cell_mm) + _least(cell_mm))
    angles = np.arange(FEW_DIRECTIONS) * (2 * np.pi / FEW_DIRECTIONS)
    seen = np.zeros((2, len(angles), len(away), *right.shape), dtype=bool)
    for k, angle in enumerate(angles):
        share = (down * np.float32(np.cos(angle)) - right * np.float32(np.sin(angle))) / steep
        for i, r in enumerate(away):
            move = np.array([[1, 0, r * np.cos(angle)], [0, 1, r * np.sin(angle)]])
            here = cv2.warpAffine(share, move, right.shape[::-1], flags=cv2.WARP_INVERSE_MAP)
            seen[0, k, i], seen[1, k, i] = here > ALONG, here < -ALONG
    edges = np.zeros((2, len(angles), *right.shape), dtype=np.float32)
    for k in range(len(angles)):
        near = seen[:, k] | seen[:, k - 1] | seen[:, (k + 1) % len(angles)]
        edges[:, k] = near.mean(axis=1)
    response = np.zeros_like(right)
    for turn in range(len(angles)):
        apart = angle_between(angles[turn], 0.0)
        if np.radians(SHARP_DEG) < apart < np.pi - np.radians(STRAIGHT_DEG):
            for k in range(len(angles)):
                both = np.minimum(edges[0, k], edges[1, (k + turn) % len(angles)])
                np.maximum(response, both, out=response)
    # Edges are seen from everywhere near their corner: the middle of that is where they meet.
    response = cv2.GaussianBlur(response, (0, 0), NEAREST_PX / 2)
    side = 2 * round(NEAREST_PX) + 1
    highest = (response == cv2.dilate(response, np.ones((side, side)))) & (
        response > LEAST_EDGE / 2
    )
    rows, columns = np.nonzero(highest)
    order = np.argsort(-response[rows, columns], kind="stable")[:PLACES]
    return [(float(columns[k]) + 0.5, float(rows[k]) + 0.5) for k in order]


def likeness_of(gray: Gray, centre: Centre, edges: Edges, cell_mm: float) -> float:
    """Correlation with two even grays parted by the edges, ups and downs beyond them cut off."""
    return _parted(_looked_at(gray, (centre.column, centre.row), cell_mm), edges)


def _looked_at(gray: Gray, place: tuple[float, float], cell_mm: float) -> Weights:
    """The grays about a corner."""
    return sample_about(gray, np.array(place), 2 * int(np.ceil(LOOKED_MM / cell_mm)) + 1)


@lru_cache
def _about(side: int) -> tuple[Weights, Weights]:
    """Directions from the middle of a patch, and the weights of its disc."""
    axis = np.arange(side) - side // 2
    right, down = np.meshgrid(axis, axis)
    return np.arctan2(down, right), disc_weights(side, side / 2 - 1)


def _parted(patch: Weights, edges: Edges) -> float:
    """Correlation of the grays about a corner with two even grays parted by edges."""
    start, end = sorted(edges, key=lambda one: not one.rises)
    directions, weights = _about(patch.shape[0])
    turn = (directions - start.angle) % (2 * np.pi)
    bright = turn < (end.angle - start.angle) % (2 * np.pi)
    low, high = (
        float(np.median(patch[(weights > 0) & (bright == side)])) for side in (False, True)
    )
    if high <= low:
        return 0.0
    return correlation(np.clip(patch, low, high), bright.astype(np.float64), weights)


def angle_between(first: float, second: float) -> float:
    """Angle between two directions, radians."""
    return abs((first - second + np.pi) % (2 * np.pi) - np.pi)


def _edges_of(share: np.ndarray, angles: np.ndarray) -> list[list[tuple[float, float]]]:
    """Directions in which an edge of one polarity runs from each place, and how much is seen."""
    # A corner pointed at beside its tip has its edges beside the direction at which they run.
    wide = np.maximum.reduce([share, np.roll(share, 1, axis=1), np.roll(share, -1, axis=1)])
    seen = (wide > ALONG).mean(axis=2)
    worth = np.where(seen > LEAST_EDGE, np.where(wide > ALONG, wide, 0.0).mean(axis=2), 0.0)
    highest = (worth > 0) & (worth >= np.roll(worth, 1, axis=1))
    highest &= worth >= np.roll(worth, -1, axis=1)
    found: list[list[tuple[float, float]]] = [[] for _ in share]
    for place, k in np.argwhere(highest).tolist():
        found[place].append((float(angles[k]), float(worth[place, k])))
    return found


def _nearest(cell_mm: float) -> float:
    """Where an edge is followed from, pixels from its corner."""
    return max(NEAREST_MM / cell_mm, NEAREST_PX)


def _least(cell_mm: float) -> int:
    """Length over which an edge is seen at least, pixels."""
    return int(np.ceil(max(LEAST_MM / cell_mm, LEAST_PX)))


def centre_by_corner(
    window: Gray, start: tuple[float, float], limit_px: float, edges: Edges, cell_mm: float
) -> tuple[Centre, Centre] | Failure:
    """Where both edges meet, by half of their steps and by where they are steepest.

    Args:
        window: Part of the scan, without NaN.
        start: Approximate corner (column, row) in the window, pixels.
        limit_px: How far from the start the corner may be.
        edges: As they lie in the window.
        cell_mm: Size of a pixel, millimetres.
    """
    soft = blur_as_scanned(window).astype(np.float32)
    found: list[Centre] = []
    for half_way in (True, False):
        one = _met(
            soft, start, limit_px if half_way else REACH_PX, edges, cell_mm, half_way=half_way
        )
        if isinstance(one, Failure):
            return one
        found.append(one[0])
        start, edges = (one[0].column, one[0].row), one[1]
    return found[0], found[1]


def _met(
    window: Gray,
    start: tuple[float, float],
    limit_px: float,
    edges: Edges,
    cell_mm: float,
    *,
    half_way: bool,
    turned_deg: float = TURNED_DEG,
) -> tuple[Centre, Edges] | Failure:
    """Where lines through the steps along two edges meet."""
    window, corner = _part(window, start, FARTHEST_MM / cell_mm + 2 * limit_px)
    spline = spline_of(window)
    start = (start[0] - corner[0], start[1] - corner[1])
    place, lines = np.array(start), list(edges)
    cofactors, normals, moved = np.zeros(2), np.zeros((2, 2)), np.zeros(2)
    before, share = np.zeros(2), 1.0
    for number in range(ROUNDS):
        reach = max(limit_px / 2**number, REACH_PX)
        for k, edge in enumerate(lines):
            line = _line(spline, place, edge, cell_mm, half_way=half_way, reach=reach)
            if line is None:
                return Failure("The mark's edges are not there.")
            turn, moved[k], cofactors[k] = share * line[0], line[1], line[2]
            turned, most = edge.angle + turn - edges[k].angle, np.radians(turned_deg)
            if reach == REACH_PX and abs(turned) > most:
                return Failure("The mark's edges run otherwise.")
            # From afar a line may begin on another edge.
            lines[k] = replace(edge, angle=edges[k].angle + float(np.clip(turned, -most, most)))
            normals[k] = _normal(lines[k])
        step = share * np.linalg.solve(normals, moved)
        # A rounded tip throws lines of few pixels from one side to the other: half way each time.
        if cell_mm > FINE_MM and step @ before < 0:
            share /= 2
        before = step
        place = place + np.clip(step, -limit_px, limit_px)
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("The mark's edges meet elsewhere.")
        if np.abs(step).max() < CONVERGED_PX and reach == REACH_PX:
            break
    back = np.linalg.inv(normals)
    covariance = back @ np.diag(cofactors) @ back.T
    sigma, worst = np.trace(covariance) / 2, np.linalg.eigvalsh(covariance)[1]
    column, row = (place + corner).tolist()
    centre = Centre(column, row, float(np.sqrt(sigma)), 1.0, float(np.sqrt(worst)))
    return centre, (lines[0], lines[1])


def _part(
    window: Gray, place: tuple[float, float], reach_px: float
) -> tuple[np.ndarray, tuple[int, int]]:
    """What a window shows about a place, and its first column and row."""
    half = int(np.ceil(reach_px)) + SPLINE_PX
    column, row = (max(0, int(at) - half) for at in place)
    return window[row : int(place[1]) + half + 1, column : int(place[0]) + half + 1], (column, row)


def _normal(edge: Edge) -> Float64[np.ndarray, "2"]:
    """Across an edge to where it is brighter."""
    sign = 1.0 if edge.rises else -1.0
    return sign * np.array([-np.sin(edge.angle), np.cos(edge.angle)])


def _line(
    spline: Spline, place: np.ndarray, edge: Edge, cell_mm: float, *, half_way: bool, reach: float
) -> tuple[float, float, float] | None:
    """How the line through the steps along an edge is turned and moved, and that move's variance.

    The edge is followed from the corner for as long as it is straight.
    """
    along = np.array([np.cos(edge.angle), np.sin(edge.angle)])
    columns, rows = (size - 2 * SPLINE_PX for size in spline.shape[::-1])
    ends = np.where(along > 0, (columns, rows) - place, place) / np.maximum(np.abs(along), TINY)
    least, first = _least(cell_mm), _nearest(cell_mm)
    farthest = min(FARTHEST_MM / cell_mm, float(ends.min()) - reach)
    away = np.arange(first, max(farthest, first + least))
    normals = np.repeat(_normal(edge)[None], len(away), axis=0)
    points = place + away[:, None] * along
    offsets, height = steps_of_gray(spline, points, normals, half_way, reach)
    sure, gap = height > 0, int(np.ceil(max(GAP_MM / cell_mm, LEAST_PX / 2)))
    if not half_way:
        # The line is known: where its steps are steepest only confirms where it lies.
        near = offsets[sure & (np.abs(offsets) < BENT_PX)]
        if len(near) < LEAST_EDGE * least:
            return None
        moved = float(np.median(near))
        spread = robust_sigma(near - moved) ** 2 + ROUGHEST_PX**2
        return 0.0, moved, MEDIAN_LOSS * spread * CORRELATED / len(near)
    used = sure & (np.arange(len(away)) < least)
    solution, variance = np.zeros(2), 0.0
    for _ in range(FOLLOWED):
        if used.sum() < LEAST_EDGE * least:
            return None
        solution, variance = _fitted(away[used], offsets[used])
        good = sure & (np.abs(offsets - solution[0] - solution[1] * away) < BENT_PX)
        held = np.convolve(good, np.ones(gap), mode="full")[: len(good)] > 0
        end = int(np.argmin(held[gap - 1 :])) if not held[gap - 1 :].all() else len(good)
        before, used = used, good & (np.arange(len(away)) < max(end, least))
        if np.array_equal(before, used):
            break
    turn = float(np.arctan(solution[1])) * (1.0 if edge.rises else -1.0)
    return turn, float(solution[0]), variance


@lru_cache
def _pairs_of(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Every pair of so many steps."""
    return np.triu_indices(count, 1)


def _fitted(
    away: Float64[np.ndarray, "n"], offsets: Float64[np.ndarray, "n"]
) -> tuple[Float64[np.ndarray, "2"], float]:
    """The straight line through offsets that most lie on, and the variance of its beginning."""
    design = np.column_stack([np.ones(len(away)), away])
    one, other = _pairs_of(len(away))
    # source: Theil 1950, Sen 1968: the median of the slopes of all pairs
    slope = float(np.median((offsets[other] - offsets[one]) / (away[other] - away[one])))
    solution = np.array([float(np.median(offsets - slope * away)), slope])
    weight, inverse = np.ones(len(away)), np.eye(2)
    for _ in range(REWEIGHTED):
        residual = offsets - design @ solution
        spread = robust_sigma(residual) + ROUGHEST_PX
        weight = cauchy_weights(np.abs(residual) / spread, FAR) ** 2
        inverse = np.linalg.inv((design * weight[:, None]).T @ design)
        solution = inverse @ (design * weight[:, None]).T @ offsets
    residual = offsets - design @ solution
    freedom = max(float(weight.sum()) / CORRELATED - 2, 1.0)
    variance = float(np.sum(weight * residual**2)) / CORRELATED / freedom + ROUGHEST_PX**2
    return solution, variance * float(inverse[0, 0]) * CORRELATED
