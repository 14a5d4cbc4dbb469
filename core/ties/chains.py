"""Matches of pairs chained into tie points: one ground detail, at most one place in each photo."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from core.arrays import Flags, Indices, PixelPoints, Scalars
from core.block import Block, TiePoints
from core.geometry.relative import RayPairs, RelativeOrientation, in_front, parallax
from core.ties.features import Features
from core.ties.matches import VerifiedMatches, ray_pairs

PairKey = tuple[str, str]
SIGMA_PER_RADIUS = 0.15  # design: only ranks features, and weighs them against each other
"""A feature's standard deviation over its radius, before it is measured finely."""
SAME_PLACE_PX = 1 / 20  # design: far below what a feature's place is worth
"""SIFT describes one place more than once: such features lie this close together."""


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """The distinct places of all features: SIFT describes some places more than once."""

    photo: Indices
    pixels: PixelPoints
    sigma_px: Scalars
    of_feature: Mapping[str, np.ndarray]
    """Place of each feature of a photo."""


def chain_matches(
    features: Mapping[str, Features], verified: Mapping[PairKey, VerifiedMatches]
) -> TiePoints:
    """Join the matches of all pairs into points with at most one place per photo.

    Matches are joined from the most to the least distinct; one that would give a point two places
    in one photo is left out, so that a wrong match does not take the right ones with it.
    """
    photo_ids = tuple(sorted(features))
    places = _places(photo_ids, features)
    edges = _edges(verified, places)
    used = np.unique(edges)
    roots = join_matches(edges, places.photo)[used]
    _, point = np.unique(roots, return_inverse=True)
    ties = TiePoints(
        photo_ids, point, places.photo[used], places.pixels[used], places.sigma_px[used]
    )
    return with_rays(ties, np.ones(len(used), dtype=np.bool_))


def join_matches(edges: np.ndarray, owner: Indices) -> Indices:
    """Root of every node after joining along edges, no two nodes of one owner in a group.

    Not the connected components of the graph: an edge that would break the rule joins nothing, so
    that which edge comes first matters.

    Args:
        edges: (n, 2) nodes to join, best first.
        owner: Photo of each node.

    Returns:
        The node that stands for the group of each node.
    """
    parent = list(range(len(owner)))
    owners: list[set[int]] = [{int(photo)} for photo in owner]

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    for one, other in edges.tolist():
        here, there = root(one), root(other)
        if here == there or not owners[here].isdisjoint(owners[there]):
            continue
        parent[there] = here
        owners[here] |= owners[there]
    return np.array([root(node) for node in range(len(owner))], dtype=np.int64)


def with_rays(ties: TiePoints, which: Flags) -> TiePoints:
    """Some rays, by point, then photo; points left with one ray go, the others are renumbered."""
    enough = np.bincount(ties.point[which], minlength=ties.count) >= 2
    kept = np.flatnonzero(which & enough[ties.point]) if len(which) else np.zeros(0, np.int64)
    number = np.cumsum(enough) - 1
    kept = kept[np.lexsort((ties.photo[kept], ties.point[kept]))]
    return TiePoints(
        ties.photo_ids,
        number[ties.point[kept]],
        ties.photo[kept],
        ties.pixels[kept],
        ties.sigma_px[kept],
    )


def rays_per_point(ties: TiePoints) -> Indices:
    """Number of rays of each tie point."""
    return np.bincount(ties.point, minlength=ties.count)


def common_rays(ties: TiePoints, first: int, second: int) -> tuple[Indices, Indices]:
    """Rays of two photos (numbers) to the points that both of them show, row by row."""
    ours, theirs = np.flatnonzero(ties.photo == first), np.flatnonzero(ties.photo == second)
    _, here, there = np.intersect1d(
        ties.point[ours], ties.point[theirs], assume_unique=True, return_indices=True
    )
    return ours[here], theirs[there]


def pair_parallax(
    block: Block, ties: TiePoints, pair: PairKey, orientation: RelativeOrientation
) -> tuple[Indices, Indices, Scalars]:
    """Rays of a pair's common points and their y-parallax, scan pixels; infinite behind a photo."""
    first, second = pair
    ours, theirs = common_rays(ties, ties.photo_ids.index(first), ties.photo_ids.index(second))
    rays = rays_of_pair(block, ties, pair, ours=ours, theirs=theirs)
    residual = parallax(rays, orientation)
    return ours, theirs, np.where(in_front(rays, orientation), residual, np.inf)


def rays_of_pair(
    block: Block, ties: TiePoints, pair: PairKey, *, ours: Indices, theirs: Indices
) -> RayPairs:
    """Rays in image space of two photos' rays of tie points."""
    first, second = pair
    return ray_pairs(
        (block.photos[first], block.photos[second]),
        (block.camera_of(first), block.camera_of(second)),
        ties.pixels[ours],
        ties.pixels[theirs],
    )


def drop_contradicted(
    block: Block,
    ties: TiePoints,
    orientations: Mapping[PairKey, RelativeOrientation],
    tolerance_px: Mapping[PairKey, float],
) -> TiePoints:
    """Points whose rays agree in every oriented pair, also those that were joined by way of others.

    A point of several rays that does not agree is a chain of matches with a wrong link: it goes.
    """
    wrong = np.zeros(ties.count, dtype=np.bool_)
    names = set(ties.photo_ids)
    for pair in combinations(sorted(names), 2):
        if pair not in orientations:
            continue
        ours, _, residual = pair_parallax(block, ties, pair, orientations[pair])
        wrong[ties.point[ours[np.abs(residual) > tolerance_px[pair]]]] = True
    return with_rays(ties, ~wrong[ties.point])


def _places(photo_ids: tuple[str, ...], features: Mapping[str, Features]) -> _Places:
    """Every place once, numbered through all photos."""
    photo: list[Indices] = [np.zeros(0, dtype=np.int64)]
    pixels, sigmas = [np.zeros((0, 2))], [np.zeros(0)]
    of_feature: dict[str, Indices] = {}
    total = 0
    for number, name in enumerate(photo_ids):
        rounded = np.rint(features[name].pixels / SAME_PLACE_PX)
        _, first, inverse = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
        of_feature[name] = np.asarray(inverse).reshape(-1) + total
        photo.append(np.full(len(first), number, dtype=np.int64))
        pixels.append(features[name].pixels[first])
        sigmas.append(features[name].radii_px[first] * SIGMA_PER_RADIUS)
        total += len(first)
    return _Places(np.concatenate(photo), np.vstack(pixels), np.concatenate(sigmas), of_feature)


def _edges(verified: Mapping[PairKey, VerifiedMatches], places: _Places) -> np.ndarray:
    """(n, 2) places that were matched, the most distinct first; ties in order of pair and place."""
    edges, ratios = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0)]
    for first, second in sorted(verified):
        matches = verified[first, second].matches
        ours = places.of_feature[first][matches.first]
        theirs = places.of_feature[second][matches.second]
        edges.append(np.column_stack([ours, theirs]))
        ratios.append(matches.ratio)
    order = np.argsort(np.concatenate(ratios), kind="stable")
    return np.vstack(edges)[order]
