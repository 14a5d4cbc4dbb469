"""Areas of the ground, as shapes cut from each other leave them."""

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

Area = Polygon | MultiPolygon
"""Ground, flat, in the block's CRS."""


def only_areas(geometry: BaseGeometry) -> Polygon | MultiPolygon:
    """The polygons of a geometry, without the lines and points that cutting may leave."""
    parts = shapely.get_parts(geometry)
    found = shapely.union_all(parts[shapely.get_dimensions(parts) == 2])
    return found if isinstance(found, Polygon | MultiPolygon) else Polygon()
