"""Places of a reference that last for decades and that a human reads well.

Well-defined points are right-angle intersections of roads and other linear features (FGDC, National
Standard for Spatial Data Accuracy, 1998, appendix 3-C). So a place is a junction of the road
network, or a point through which lines of several directions run: roads, banks, borders of fields,
ridges. Where grain prevails, as in a wood, lines are chance (`core.reference.salient`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32
from scipy.spatial import KDTree

from core.arrays import Flags, Mask, Scalars
from core.geometry.crs import PlanePoints
from core.matching.peaks import local_maxima
from core.raster.grid import Grid
from core.raster.ortho import Ortho
from core.reference.junctions import Junction
from core.reference.salient import directions_of_lines, line_structure

Gray = Float32[np.ndarray, "rows columns"]
"""Gray values, or a measure of every pixel."""
# design: a road is three of these wide; single leaves, ruts and cars are lost.
FINEST_M = 1.0
"""Nothing finer is looked at, metres."""
# design: with twice as many pixels on either side, about as far as a person looks.
AROUND_PX = 8.0
"""Standard deviation of the window in which lines must run through a place, pixels."""
# source: squared sine of 60 degrees; 4 det / trace^2 of two equal lines that cross so.
ROUNDNESS = 0.75
"""Lines of a place differ at least as much in direction."""


@dataclass(frozen=True, slots=True, eq=False)
class LastingPlaces:
    """Places of the ortho."""

    places: PlanePoints
    """Where they are, metres."""
    clearness: Scalars
    """How strongly lines stand out, 0 to 0.5, times the share of them that runs through a place."""
    junction: Flags
    """True where roads meet."""

    def chosen(self, rows: np.ndarray) -> "LastingPlaces":
        """Some of them."""
        return LastingPlaces(self.places[rows], self.clearness[rows], self.junction[rows])


NO_PLACES = LastingPlaces(np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=bool))
"""Where nothing lasts."""


def lasting_places(ortho: Ortho, grid: Grid, junctions: Sequence[Junction]) -> LastingPlaces:
    """Places that the ortho shows in a part.

    Args:
        ortho: The reference.
        grid: The part, at the pixel it is looked at.
        junctions: Of the road network.
    """
    patch = ortho.read(grid)
    if not patch.mask.any():
        return NO_PLACES
    gray = np.where(patch.mask, patch.values, np.float32(patch.values[patch.mask].mean()))
    strength, _ = line_structure(gray, patch.mask)
    through = lines_through(gray, patch.mask)
    clear = strength * through
    peak = (clear > 0) & local_maxima(clear, int(2 * AROUND_PX))
    row, column = np.nonzero(peak)
    roads = np.array([one.position[:2] for one in junctions]).reshape(-1, 2)
    at = np.floor(grid.grid_from_object(roads)).astype(int)
    inside = ((at >= 0) & (at < (grid.columns, grid.rows))).all(axis=1)
    # The map tells that the lines run through a junction.
    shown = strength[at[inside, 1], at[inside, 0]]
    crossings = grid.object_from_grid(np.column_stack([column, row]) + 0.5)
    return LastingPlaces(
        np.vstack([roads[inside], crossings]),
        np.concatenate([shown, clear[row, column]]).astype(np.float64),
        np.arange(inside.sum() + len(crossings)) < inside.sum(),
    )


def best_first(parts: Sequence[LastingPlaces], apart_m: float) -> LastingPlaces:
    """All places together: junctions before others, the clearer first, one of each detail.

    Args:
        parts: What was found.
        apart_m: Nearer ones are of the same detail, metres.
    """
    every = [NO_PLACES, *parts]
    places = np.concatenate([part.places for part in every])
    clear = np.concatenate([part.clearness for part in every])
    junction = np.concatenate([part.junction for part in every])
    found = LastingPlaces(places, clear, junction).chosen(np.lexsort((-clear, ~junction)))
    kept = np.zeros(len(places), dtype=bool)
    if len(places):
        for number, near in enumerate(KDTree(found.places).query_ball_point(found.places, apart_m)):
            kept[number] = not kept[near].any()
    return found.chosen(kept)


def lines_through(gray: Gray, usable: Mask) -> Gray:
    """The share of lines around every pixel that runs through it: 1 all, 0 as if they lay anywhere.

    The intersection of lines of Förstner and Gülch (1987): the mean square distance of a pixel from
    all lines around it, by their gradients, over that of the lines' points on one axis. 0 where
    the lines are of one direction, or fewer than in most places.
    """
    xx, xy, yy = directions_of_lines(gray, usable)
    reach = int(3 * AROUND_PX)  # design: what is left of the window there is a hundredth.
    steps = np.arange(-reach, reach + 1, dtype=np.float32)
    flat = np.exp(-(steps**2) / 2 / AROUND_PX**2)
    flat /= flat.sum()
    first, second = flat * steps, flat * steps**2

    def summed(part: Gray, across: np.ndarray, down: np.ndarray) -> Gray:
        return cv2.sepFilter2D(part, cv2.CV_32F, across, down)

    a, b, c = (summed(part, flat, flat) for part in (xx, xy, yy))
    square = summed(xx, second, flat) + 2 * summed(xy, first, first) + summed(yy, flat, second)
    trace = np.maximum(a + c, np.finfo(np.float32).tiny)
    lesser = (trace - np.sqrt((a - c) ** 2 + 4 * b**2)) / 2
    several = (4 * (a * c - b * b) >= ROUNDNESS * trace**2) & (lesser > np.median(lesser[usable]))
    return np.where(several & usable, np.maximum(1 - square / trace / AROUND_PX**2, 0), 0).astype(
        np.float32
    )
