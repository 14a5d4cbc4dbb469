"""Map coordinates and rotations in a spatial frame: geocentric, or east, north, up at a place.

The scale of the map and heights above the geoid are kept: heights are used as if ellipsoidal.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from pyproj import CRS, Transformer
from pyproj.crs import GeographicCRS

from core.arrays import ObjectPoints, Position, Rotation
from core.doubts import Doubt
from core.errors import CrsError
from core.geometry.crs import (
    Bounds,
    PlanePoints,
    degrees_of,
    horizontal,
    operation_between,
    read_crs,
    short_name,
)
from core.said import say

# design: curvature of the third order over it is 1e-10; coordinates round at 1e-9 m.
STEP_M = 50.0
"""Half of the way along which the map's directions are taken, metres."""
# design: PROJ undoes a projection to 1e-10 rad and a shift of datum to millimetres; one round
# leaves a millionth of it.
ROUNDS = 4
"""Rounds that bring the way from the map to the ellipsoid to the last digit."""
FAR_M = 1e6  # design: rounding of geocentric metres over it is 1e-15.
# source: polar radius of WGS 84, less the depth of the sea.
EARTH_M = 6.3e6
"""What lies further from the origin than this may be a point of the Earth, metres."""
# source: limits of UTM.
POLAR, SOUTH_POLAR = 84.0, -80.0
# source: codes of EPSG.
WGS84, UTM_NORTH, UTM_SOUTH = 4326, 32600, 32700
# source: relief displacement is r dh / h, on a map of scale k r dh / (k h). Relief of a tenth of
# the flying height, half of it above the mean, is then off by six pixels of 20 µm at the rim of a
# film of 23 cm. EPSG:3035 stays below all over Europe, Web Mercator only within 11 degrees of the
# equator.
MOST_SCALE = 0.02
"""A block whose map is further from scale 1 in any direction is refused."""
RIM_UM, RELIEF = 115_000.0, 0.05  # source: half a film of 23 cm, micrometres; and that relief.
MOST_UM = 20.0  # source: a usual scan pixel.
"""What a map may displace details on the film before it is doubted, micrometres."""
CRS_KEY = "block.toml [block] crs"
"""Where a block's CRS stands, for messages."""
Degrees = Float64[np.ndarray, "n 3"]
"""Longitude and latitude in degrees, height in metres."""
Origin = tuple[float, float, float]
"""Longitude, latitude (degrees), height (metres)."""


@dataclass(frozen=True, slots=True, eq=False)
class MapInSpace:
    """A frame in space that belongs to a map."""

    plane: Transformer
    """From longitude and latitude (degrees) to the map: this way every projection is closed."""
    space: Transformer
    """From longitude, latitude, height to the frame."""
    origin: Origin | None
    """Where east, north, up are taken; None for geocentric axes."""

    def from_object(self, points: ObjectPoints) -> ObjectPoints:
        """The frame's coordinates (metres) of easting, northing, height."""
        return np.column_stack(self.space.transform(*self.degrees(points).T))

    def to_object(self, points: ObjectPoints) -> ObjectPoints:
        """Easting, northing, height of the frame's coordinates (metres)."""
        return self.from_degrees(self.space_degrees(points))

    def space_degrees(self, points: ObjectPoints) -> Degrees:
        """Longitude, latitude, height of the frame's coordinates (metres)."""
        return np.column_stack(self.space.transform(*points.T, direction="INVERSE"))

    def degrees(self, points: ObjectPoints) -> Degrees:
        """Longitude, latitude, height of easting, northing, height."""
        plan = points[:, :2]
        degrees = self._degrees(plan)
        for _ in range(ROUNDS):
            degrees = degrees + self._degrees(plan) - self._degrees(self._plan(degrees))
        return np.column_stack([degrees, points[:, 2]])

    def from_degrees(self, places: Degrees) -> ObjectPoints:
        """Easting, northing, height of longitude, latitude, height."""
        return np.column_stack([self._plan(places), places[:, 2]])

    def _degrees(self, plan: PlanePoints) -> PlanePoints:
        return np.column_stack(self.plane.transform(*plan.T, direction="INVERSE"))

    def _plan(self, degrees: np.ndarray) -> PlanePoints:
        return np.column_stack(self.plane.transform(degrees[:, 0], degrees[:, 1]))

    def turn_at(self, place: Position) -> Rotation:
        """The frame's axes from east, north, up of the map at a place, without any scale."""
        left, _, right = np.linalg.svd(self._axes(place))
        return left @ right

    def scales_at(self, place: Position) -> tuple[float, float]:
        """Least and largest scale of the map at a place: metres on it that are one in space."""
        lengths = np.linalg.svd(self._axes(place)[:, :2], compute_uv=False)
        return float(1 / lengths[0]), float(1 / lengths[1])

    def _axes(self, place: Position) -> Float64[np.ndarray, "3 3"]:
        """What a metre to the east, to the north and up on the map is in the frame: columns."""
        steps = np.vstack([np.eye(3), -np.eye(3)]) * STEP_M
        ends = self.from_object(place + steps)
        return (ends[:3] - ends[3:]).T / (2 * STEP_M)


def map_in_space(
    crs: CRS,
    datum: CRS | None = None,
    origin: Origin | None = None,
    near: PlanePoints | None = None,
) -> MapInSpace:
    """A frame in space.

    Args:
        crs: Of the map; projected, metres.
        datum: Geographic CRS in whose datum the frame is; WGS 84 where it is None.
        origin: Where east, north, up are taken; None for geocentric axes.
        near: Points of the map, about which PROJ's best way between the datums is taken; the origin
            where nobody gives any. Without both PROJ chooses, a metre beside it for S-JTSK.

    Raises:
        CrsError: PROJ has no way there.
    """
    datum = datum or CRS.from_epsg(WGS84)
    steps = "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
    steps += f" +step +proj=cart {_shape(datum)}"
    if origin is not None:
        steps += f" +step {_topocentric(datum, origin)}"
    plane = Transformer.from_crs(datum, crs, always_xy=True)
    place = np.array([origin[:2]]) if origin is not None else None
    if near is not None:
        place = degrees_of(crs.to_wkt(), near)
    if place is not None and np.isfinite(place).any():
        best = operation_between(datum.to_wkt(), crs.to_wkt(), place, CRS_KEY)
        plane = Transformer.from_pipeline(best.pipeline)
    return MapInSpace(plane, Transformer.from_pipeline(steps), origin)


def tangent_frame(crs: str, middle: Position) -> MapInSpace:
    """East, north, up on the map's own ellipsoid at a place (easting, northing, height).

    Raises:
        CrsError: No CRS, or one that PROJ does not know or that is not projected.
    """
    plane = map_crs(crs, CRS_KEY)
    datum = geographic_of(plane)
    return map_in_space(plane, datum, origin_of(plane, datum, middle))


def check_scale(crs: str, bounds: Bounds) -> tuple[Doubt, ...]:
    """Whether photos fit a map at a block: to them all three coordinates are of one length.

    Args:
        crs: Of the block.
        bounds: West, south, east, north of its ground, metres.

    Raises:
        CrsError: The map's scale is far from 1 there.
    """
    west, south, east, north = bounds
    place = np.array([(west + east) / 2, (south + north) / 2, 0.0])
    plane = map_crs(crs, CRS_KEY)
    scales = np.array(tangent_frame(crs, place).scales_at(place))
    told = {
        "name": short_name(plane),
        "scale": float(scales[np.argmax(np.abs(scales - 1))]),
        "zone": zone_of(map_in_space(plane).degrees(place[None])),
    }
    if np.abs(scales - 1).max() > MOST_SCALE:
        raise CrsError(
            CRS_KEY,
            "{name} draws a metre of ground as {scale:.3f} m where the block lies: photos do not "
            "fit such a map.",
            "Give the block its UTM zone ({zone}) or a national CRS, as `crs` in [block]. Bring "
            "lists of points and orientations to it; ortho, DEM and vector files may stay.",
            **told,
        )
    # A stretched square fits no photo; flying heights take up a scale that is the same all round.
    film = RIM_UM * max(np.ptp(scales) / 2, RELIEF * abs(scales.mean() - 1))
    if film <= MOST_UM:
        return ()
    text = (
        "{name} draws a metre of ground as {scale:.4f} m where the block lies, which photos cannot "
        "follow: details are off by up to {film:.0f} µm of film at the rims. Its UTM zone ({zone}) "
        "or a national CRS, as `crs` in [block], fits better."
    )
    return (Doubt("map-scale", "block", say(text, film=film, **told)),)


def origin_of(crs: CRS, datum: CRS, place: Position) -> Origin:
    """Longitude, latitude, height of a place on the map."""
    ways = Transformer.from_crs(crs, datum, always_xy=True)
    longitude, latitude = ways.transform(float(place[0]), float(place[1]))
    return float(longitude), float(latitude), float(place[2])


def geocentric_axes(datum: CRS, origin: Origin) -> tuple[Rotation, Position]:
    """Geocentric coordinates (metres) of east, north, up at a place, and of the place."""
    ways = Transformer.from_pipeline(f"+proj=pipeline +step {_topocentric(datum, origin)}")
    # Both frames have straight axes: far points give the turn to the last digit.
    far = np.vstack([np.zeros(3), np.eye(3) * FAR_M])
    ends = np.column_stack(ways.transform(*far.T, direction="INVERSE"))
    return (ends[1:] - ends[0]).T / FAR_M, ends[0]


def _shape(datum: CRS) -> str:
    """An ellipsoid in PROJ's words."""
    ellipsoid = datum.ellipsoid
    assert ellipsoid is not None, "a geographic CRS has an ellipsoid"
    return f"+a={ellipsoid.semi_major_metre!r} +b={ellipsoid.semi_minor_metre!r}"


def _topocentric(datum: CRS, origin: Origin) -> str:
    """The step from geocentric axes to east, north, up."""
    longitude, latitude, height = origin
    place = f"+lon_0={longitude!r} +lat_0={latitude!r} +h_0={height!r}"
    return f"+proj=topocentric {_shape(datum)} {place}"


def map_crs(text: str, where: str | Path) -> CRS:
    """The map of a block: projected, without heights.

    Raises:
        CrsError: It is none.
    """
    crs = horizontal(read_crs(text, where))
    if not crs.is_projected or crs.geodetic_crs is None:
        raise CrsError(
            where, "{crs} is no map in metres.", "Give the block a projected CRS.", crs=crs.name
        )
    return crs


def geographic_of(crs: CRS) -> CRS:
    """The geographic CRS whose datum a map has, in degrees: France counts some in gons."""
    geographic = crs.geodetic_crs
    assert geographic is not None, "a map is made from one"
    if all(axis.unit_name == "degree" for axis in geographic.axis_info[:2]):
        return geographic
    return GeographicCRS(f"{geographic.name} in degrees", geographic.datum)


def crs_text(crs: CRS) -> str:
    """A code where there is one, else WKT."""
    authority = crs.to_authority()
    return crs.to_wkt() if authority is None else ":".join(authority)


def zone_of(place: Degrees) -> str:
    """A projected CRS for points of the Earth: UTM, or stereographic about the poles."""
    longitude, latitude = place[0, 0], place[0, 1]
    if latitude > POLAR:
        return "EPSG:3995"
    if latitude < SOUTH_POLAR:
        return "EPSG:3031"
    zone = int((longitude + 180) // 6) % 60 + 1  # source: zones of UTM are six degrees wide.
    return f"EPSG:{(UTM_NORTH if latitude >= 0 else UTM_SOUTH) + zone}"
