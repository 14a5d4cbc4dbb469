"""Which photos are matched with which: pairs whose rays meet well and that share ground."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from shapely import Polygon
from shapely.geometry import box

from core.block import Block, footprint
from core.geometry.crs import Bounds
from core.raster.grid import Grid

# source: METHODS 8 asks for 0.25 to 0.7; wide angles with a quarter of overlap have 0.9, and better
# pairs go first.
BASE_TO_HEIGHT = (0.2, 1.0)
"""Below, heights are not fixed; above, slopes and houses look too different."""
# design: less is a strip in which the frame's edges and marks take most.
LEAST_OVERLAP = 0.1
"""Share of the smaller footprint that both photos show, at least."""
# design: a window of one photo is then at most half as fine again in the other.
MOST_SCALE_RATIO = 1.5
"""Ground pixels of the two photos differ by this factor at most."""
# design: METHODS 8, 60 per cent overlap gives 0.34 and 80 per cent two bases of it; in the middle.
BEST_RATIO = 0.45
"""Base to height that is taken first where many pairs see a place."""
# design: a tenth of the flying height of relief, seen at 40 degrees.
RELIEF = 0.05
"""Footprints at mean height are wider or narrower by this share of their side."""
# design: memory and time; the median of six leaves two wrong ones behind.
MOST_PAIRS = 6
"""Pairs that are matched at one place at most."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two photos that are matched with each other."""

    left: str
    """Photo with the smaller name."""
    right: str
    """The other one."""
    base_to_height: float
    """Length of the base over the height above ground."""
    shared: Polygon
    """Ground that both may show, whatever the relief."""


def sound_pairs(block: Block) -> tuple[Pair, ...]:
    """All pairs of oriented photos whose base, scale and overlap allow heights, by name."""
    photos = {name: photo for name, photo in block.photos.items() if photo.oriented}
    areas = {name: footprint(photo, block.camera_of(name)) for name, photo in photos.items()}
    pixels = {name: photo.ground_pixel_m(block.camera_of(name)) for name, photo in photos.items()}
    found: list[Pair] = []
    for left, right in combinations(sorted(photos), 2):
        one, other = photos[left].exterior.centre, photos[right].exterior.centre
        ground = (photos[left].ground_height_m + photos[right].ground_height_m) / 2
        above = float(one[2] + other[2]) / 2 - ground
        ratio = float(np.hypot(*(one - other)[:2])) / above
        scale = pixels[left] / pixels[right]
        if not BASE_TO_HEIGHT[0] <= ratio <= BASE_TO_HEIGHT[1]:
            continue
        if max(scale, 1 / scale) > MOST_SCALE_RATIO:
            continue
        shared = areas[left].intersection(areas[right])
        smaller = min(areas[left].area, areas[right].area)
        if isinstance(shared, Polygon) and shared.area >= LEAST_OVERLAP * smaller:
            room = RELIEF * float(np.sqrt(smaller))
            found.append(Pair(left, right, ratio, shared.buffer(room, join_style="mitre")))
    return tuple(found)


def part_of(pair: Pair, cells: Grid) -> Grid:
    """The part of a grid that a pair may show; it shows some of it."""
    return cells.covering(pair.shared.intersection(box(*cells.bounds)).bounds)


def pairs_over(pairs: tuple[Pair, ...], bounds: Bounds) -> tuple[Pair, ...]:
    """The pairs to match over a part of the ground, those with the best rays first."""
    part = box(*bounds)
    seen = [pair for pair in pairs if pair.shared.intersection(part).area > 0]
    # Near one another in ratio, the one that shows more of the part goes first.
    seen.sort(
        key=lambda pair: (
            abs(np.log(pair.base_to_height / BEST_RATIO))
            - pair.shared.intersection(part).area / part.area
        )
    )
    return tuple(seen[:MOST_PAIRS])
