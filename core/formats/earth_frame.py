"""Map coordinates as points of the Earth (EPSG:4978), for programs that know no map.

Heights go as they stand, as if above the ellipsoid of WGS 84.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from pyproj import CRS, Transformer

from core.arrays import ObjectPoints, Position, Rotation
from core.geometry.crs import read_crs

# design: steps to both sides cancel the Earth's curve; doubles of 6 000 km are left 1e-12.
STEP_M = 1000.0
"""Step to either side from which the map's axes are taken, metres."""
# source: polar radius of WGS 84, less the depth of the sea.
EARTH_M = 6.3e6
"""What lies further from the origin than this may be a point of the Earth, metres."""
# source: limits of UTM.
POLAR, SOUTH_POLAR = 84.0, -80.0
# source: codes of EPSG.
WGS84, WGS84_HEIGHTS, GEOCENTRIC, UTM_NORTH, UTM_SOUTH = 4326, 4979, 4978, 32600, 32700
Degrees = Float64[np.ndarray, "n 3"]
"""Longitude and latitude in degrees, height in metres."""


@dataclass(frozen=True, slots=True)
class EarthFrame:
    """A map and the Earth below it."""

    degrees_from_map: Transformer
    """Longitude and latitude of WGS 84."""
    earth_from_degrees: Transformer
    """Geocentric coordinates."""

    @staticmethod
    def of(crs: str, where: str) -> "EarthFrame":
        """The frame of a projected CRS.

        Raises:
            CrsError: There is none, or PROJ does not know it.
        """
        source = read_crs(crs, where)
        return EarthFrame(
            Transformer.from_crs(source, CRS.from_epsg(WGS84), always_xy=True),
            Transformer.from_crs(
                CRS.from_epsg(WGS84_HEIGHTS), CRS.from_epsg(GEOCENTRIC), always_xy=True
            ),
        )

    def degrees(self, points: ObjectPoints) -> Degrees:
        """Longitude, latitude, height of map points."""
        east, north = self.degrees_from_map.transform(points[:, 0], points[:, 1])
        return np.column_stack([east, north, points[:, 2]])

    def from_degrees(self, places: Degrees) -> ObjectPoints:
        """Map points from longitude, latitude, height."""
        east, north = self.degrees_from_map.transform(
            places[:, 0], places[:, 1], direction="INVERSE"
        )
        return np.column_stack([east, north, places[:, 2]])

    def earth(self, points: ObjectPoints) -> ObjectPoints:
        """Geocentric coordinates of map points."""
        there = self.degrees(points)
        return np.column_stack(self.earth_from_degrees.transform(*there.T))

    def from_earth(self, points: ObjectPoints) -> ObjectPoints:
        """Map points from geocentric coordinates."""
        there = np.column_stack(self.earth_from_degrees.transform(*points.T, direction="INVERSE"))
        return self.from_degrees(there)

    def axes(self, place: Position) -> Rotation:
        """The map's axes at a place as columns: turns map directions into geocentric ones."""
        ends = place + np.array([[STEP_M, 0, 0], [-STEP_M, 0, 0], [0, 0, STEP_M], [0, 0, -STEP_M]])
        one, other, above, below = self.earth(ends)
        up = (above - below) / np.linalg.norm(above - below)
        east = one - other
        east = east - up * (up @ east)
        east = east / np.linalg.norm(east)
        return np.column_stack([east, np.cross(up, east), up])


def zone_of(place: Degrees) -> str:
    """A projected CRS for points of the Earth: UTM, or stereographic about the poles."""
    longitude, latitude = place[0, 0], place[0, 1]
    if latitude > POLAR:
        return "EPSG:3995"
    if latitude < SOUTH_POLAR:
        return "EPSG:3031"
    zone = int((longitude + 180) // 6) % 60 + 1  # source: zones of UTM are six degrees wide.
    return f"EPSG:{(UTM_NORTH if latitude >= 0 else UTM_SOUTH) + zone}"
