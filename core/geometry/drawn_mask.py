"""A mask drawn by hand on a scan: areas to hide, and areas to use after all."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import cast

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from core.arrays import Flags, PixelPoints
from core.geometry.transforms import PlanePoints

Area = BaseGeometry
"""Polygons in pixels of the scan, corner origin."""
# design: a hundredth of a pen stroke; corners of an outline follow the film's distortion.
STEP_SHARE = 0.01
"""Longest side of an outline that is carried from film to scan, as a share of its extent."""

# design: far less than is drawn; without a grid GEOS now and then takes a sliver for an area.
GRID_PX = 1e-3
"""Corners of a mask lie on multiples of this, pixels of the scan."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """One outline, or one stroke of a brush."""

    outline: tuple[tuple[float, float], ...]
    """Corners of the outline, or the middle line of the stroke: pixels, or film millimetres."""
    width: float
    """Of the brush, in the same unit; 0 for an outline that is filled."""
    hides: bool
    """False for the eraser: what it covers is photograph."""

    def area(self) -> Area:
        """What it covers, in its own frame; empty where it covers nothing."""
        points = np.array(self.outline, dtype=np.float64).reshape(-1, 2)
        if self.width > 0:
            line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
            return line.buffer(self.width / 2)
        if len(points) < 3:
            return shapely.Polygon()
        return shapely.make_valid(shapely.Polygon(points)).buffer(0)


@dataclass(frozen=True, slots=True)
class DrawnMask:
    """All that was drawn on one scan, laid one over the other."""

    hidden: Area = field(default_factory=shapely.Polygon)
    """No photograph."""
    freed: Area = field(default_factory=shapely.Polygon)
    """Photograph, whatever the program took it for."""

    def __bool__(self) -> bool:
        return not (self.hidden.is_empty and self.freed.is_empty)

    def over(self, area: Area, hides: bool) -> "DrawnMask":
        """The same with one more drawn over it."""
        more, less = (self.hidden, self.freed) if hides else (self.freed, self.hidden)
        more = shapely.union(more, area, grid_size=GRID_PX)
        less = shapely.difference(less, area, grid_size=GRID_PX)
        # Over lines that slivers end as, GEOS lays nothing more.
        more, less = (shapely.MultiPolygon(outlines(one)) for one in (more, less))
        return DrawnMask(more, less) if hides else DrawnMask(less, more)

    def hides(self, pixels: PixelPoints) -> Flags:
        """Which pixels of the scan lie in what was hidden."""
        return np.asarray(shapely.contains_xy(self.hidden, pixels[:, 0], pixels[:, 1]), np.bool_)


def drawn_mask(
    strokes: Iterable[tuple[Stroke, bool]],
    pixel_from_film: Callable[[PlanePoints], PlanePoints],
) -> DrawnMask:
    """What strokes come to on one scan, in the order they were drawn.

    Args:
        strokes: Each with whether it was drawn in film millimetres.
        pixel_from_film: The scan's interior orientation.
    """
    mask = DrawnMask()
    for stroke, on_film in strokes:
        area = stroke.area()
        if on_film and not area.is_empty:
            west, south, east, north = area.bounds
            dense = shapely.segmentize(area, STEP_SHARE * max(east - west, north - south))
            area = cast("Area", shapely.transform(dense, pixel_from_film)).buffer(0)
        mask = mask.over(area, stroke.hides)
    return mask


def outlines(area: Area) -> list[shapely.Polygon]:
    """The polygons that an area is made of; lines and points that clipping left are none."""
    parts = [one for one in shapely.get_parts(area) if isinstance(one, shapely.Polygon)]
    return [one for one in parts if not one.is_empty]
