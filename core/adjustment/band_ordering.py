"""An order of the photos in which those that share points stand near each other."""

import numpy as np
from jaxtyping import Float64, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

# design: every three degrees of half a turn.
DIRECTIONS = 60
"""Directions in plan, over half a turn, in which the block is swept."""

Ends = Int[np.ndarray, "pairs"]
"""One photo of each pair that shares points."""


def narrow_places(
    low: Ends, high: Ends, centres: Float64[np.ndarray, "photos 3"]
) -> Int[np.ndarray, "photos"]:
    """Where each photo stands, so that the farthest two that share points are near.

    Reverse Cuthill and McKee's order begins at a corner of the block and runs across it; photos one
    strip after the other, or swept in the best of some directions, often reach half as far.

    Args:
        low: One photo of each pair that shares points.
        high: The other.
        centres: Perspective centres, metres.

    Returns:
        Place of each photo.
    """
    photos = len(centres)
    ones = np.ones(len(low), dtype=np.int8)
    graph = csr_array((ones, (low, high)), shape=(photos, photos))
    best = np.arange(photos)
    farthest = _reach(best, low, high)
    angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    plan = centres[:, :2] - centres[:, :2].mean(axis=0)
    swept = plan @ np.stack([np.cos(angles), np.sin(angles)])
    sequences = [reverse_cuthill_mckee(csr_array(graph + graph.T), symmetric_mode=True)]
    sequences.extend(np.argsort(swept, axis=0, kind="stable").T)
    for sequence in sequences:
        place = np.empty(photos, dtype=np.int64)
        place[sequence] = np.arange(photos)
        reach = _reach(place, low, high)
        if reach < farthest:
            best, farthest = place, reach
    return best


def _reach(place: Int[np.ndarray, "photos"], low: Ends, high: Ends) -> int:
    return int(np.abs(place[low] - place[high]).max(initial=0))
