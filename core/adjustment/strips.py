"""Flight strips: photos one after the other on a line, found from where they were taken."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int

from core.block import Photo
from core.geometry.robust import TINY

# design: crab differs by a few degrees within a strip, strips by 180 or 90.
TURNED = np.radians(20.0)
"""Photos whose kappa differs by more than this are not of one strip."""
# design: half of what lies between strips at 30 % side overlap.
ACROSS = 0.35
"""A photo further off a strip's line than this share of the photo's side is not of it."""
# design: photos that overlap are less than one side apart; a fifth for tilt.
GAP = 1.2
"""Nor one further along it than this many sides from its neighbour: there is no overlap."""


def strips_of(photos: Sequence[Photo], sides_m: Sequence[float]) -> Int[np.ndarray, "photos"]:
    """Number of the strip of each photo, counted from 0 in the order of first photos.

    Args:
        photos: Photos with their orientations.
        sides_m: Side of the ground each photo shows, metres.
    """
    centres = np.array([photo.exterior.centre[:2] for photo in photos]).reshape(-1, 2)
    kappas = np.array([photo.exterior.kappa for photo in photos])
    sides = np.asarray(sides_m, dtype=np.float64)
    numbers = np.full(len(photos), -1, dtype=np.int64)
    headings = kappas + _strip_axis(centres, kappas)
    for index in range(len(photos)):
        if numbers[index] < 0:
            number = int(numbers.max()) + 1
            _grow(index, number, numbers, centres, headings, sides)
    return numbers


def _strip_axis(
    centres: Float64[np.ndarray, "photos 2"], kappas: Float64[np.ndarray, "photos"]
) -> float:
    """0 where strips run along the film's x axis, a quarter turn where along y.

    Scans may lie a quarter turned; most photos' next neighbour tells.
    """
    votes = 0
    for here in range(len(centres)):
        turn = np.abs(np.remainder(kappas - kappas[here] + np.pi, 2 * np.pi) - np.pi)
        offset = centres - centres[here]
        distance = np.where(turn < TURNED, np.linalg.norm(offset, axis=1), np.inf)
        distance[here] = np.inf
        if not np.isfinite(distance).any():
            continue
        towards = offset[int(np.argmin(distance))]
        along = towards @ [np.cos(kappas[here]), np.sin(kappas[here])]
        across = towards @ [-np.sin(kappas[here]), np.cos(kappas[here])]
        votes += 1 if abs(along) >= abs(across) else -1
    return 0.0 if votes >= 0 else float(np.pi / 2)


def _grow(
    start: int,
    number: int,
    numbers: Int[np.ndarray, "photos"],
    centres: Float64[np.ndarray, "photos 2"],
    headings: Float64[np.ndarray, "photos"],
    sides: Float64[np.ndarray, "photos"],
) -> None:
    """Give the strip's number to all photos that follow one another in its direction."""
    waiting = [start]
    numbers[start] = number
    while waiting:
        here = waiting.pop()
        offset = centres - centres[here]
        turn = np.abs(np.remainder(headings - headings[here] + np.pi, 2 * np.pi) - np.pi)
        along = offset @ [np.cos(headings[here]), np.sin(headings[here])]
        across = offset @ [-np.sin(headings[here]), np.cos(headings[here])]
        follows = (np.abs(along) < GAP * sides[here]) & (np.abs(across) < ACROSS * sides[here])
        for other in np.flatnonzero((turn < TURNED) & (numbers < 0) & follows).tolist():
            numbers[other] = number
            waiting.append(other)


def places_along(
    photos: Sequence[Photo], strips: Int[np.ndarray, "photos"]
) -> Float64[np.ndarray, "photos"]:
    """Place of each photo along its strip, -1 at the first to +1 at the last; 0 when alone."""
    centres = np.array([photo.exterior.centre[:2] for photo in photos]).reshape(-1, 2)
    places = np.zeros(len(photos))
    for number in np.unique(strips).tolist():
        members = np.flatnonzero(strips == number)
        if len(members) < 2:
            continue
        offset = centres[members] - centres[members].mean(axis=0)
        direction = np.linalg.svd(offset, full_matrices=False)[2][0]
        along = offset @ direction
        half = (along.max() - along.min()) / 2
        places[members] = (along - along.min()) / max(half, TINY) - 1
    return places
