"""Coordinates and rotations of a map taken into space: geocentric, or east, north, up somewhere.

A map's scale and its heights above the geoid stay: heights go as if above the ellipsoid.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from core.arrays import ObjectPoints, Position, Rotation
from core.errors import CrsError
from core.said import say

# design: curvature of the third order over it is 1e-10; coordinates round at 1e-9 m.
STEP_M = 50.0
"""Half of the way along which the map's directions are taken, metres."""
# design: PROJ undoes a projection to 1e-10 rad and a shift of datum to millimetres; one round
# leaves a millionth of it.
ROUNDS = 4
"""Rounds that bring the way from the map to the ellipsoid to the last digit."""


PlanPoints = Float64[np.ndarray, "n 2"]
"""Easting and northing, or longitude and latitude."""
Origin = tuple[float, float, float]
"""Longitude, latitude (degrees), height (metres)."""


@dataclass(frozen=True, slots=True, eq=False)
class MapInSpace:
    """A frame in space that belongs to a map."""

    plane: Transformer
    """From longitude and latitude (degrees) to the map: this way every projection is closed."""
    space: Transformer
    """From longitude, latitude, height to the frame."""

    def from_object(self, points: ObjectPoints) -> ObjectPoints:
        """The frame's coordinates (metres) of easting, northing, height."""
        degrees = self.degrees(points[:, :2])
        return np.column_stack(self.space.transform(degrees[:, 0], degrees[:, 1], points[:, 2]))

    def to_object(self, points: ObjectPoints) -> ObjectPoints:
        """Easting, northing, height of the frame's coordinates (metres)."""
        longitude, latitude, height = self.space.transform(*points.T, direction="INVERSE")
        return np.column_stack([self.plan(np.column_stack([longitude, latitude])), height])

    def degrees(self, plan: PlanPoints) -> PlanPoints:
        """Longitude and latitude, degrees, of easting and northing."""
        degrees = self._degrees(plan)
        for _ in range(ROUNDS):
            degrees = degrees + self._degrees(plan) - self._degrees(self.plan(degrees))
        return degrees

    def _degrees(self, plan: np.ndarray) -> np.ndarray:
        return np.column_stack(self.plane.transform(*plan.T, direction="INVERSE"))

    def plan(self, degrees: PlanPoints) -> PlanPoints:
        """Easting and northing of longitude and latitude, degrees."""
        return np.column_stack(self.plane.transform(*degrees.T))

    def turn_at(self, place: Position) -> Rotation:
        """The frame's axes from east, north, up of the map at a place, without any scale."""
        steps = np.vstack([np.eye(3), -np.eye(3)]) * STEP_M
        ends = self.from_object(place + steps)
        left, _, right = np.linalg.svd((ends[:3] - ends[3:]).T)
        return left @ right


def map_in_space(crs: CRS, datum: CRS, origin: Origin | None = None) -> MapInSpace:
    """A frame in space.

    Args:
        crs: Of the map; projected, metres.
        datum: Geographic CRS in whose datum the frame is.
        origin: Where east, north, up are taken; None for geocentric axes.
    """
    steps = "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
    steps += f" +step +proj=cart {_shape(datum)}"
    if origin is not None:
        steps += f" +step {_topocentric(datum, origin)}"
    return MapInSpace(
        Transformer.from_crs(datum, crs, always_xy=True), Transformer.from_pipeline(steps)
    )


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


FAR_M = 1e6  # design: rounding of geocentric metres over it is 1e-15.


def _shape(datum: CRS) -> str:
    """An ellipsoid in PROJ's words."""
    ellipsoid = datum.ellipsoid
    assert ellipsoid is not None
    return f"+a={ellipsoid.semi_major_metre!r} +b={ellipsoid.semi_minor_metre!r}"


def _topocentric(datum: CRS, origin: Origin) -> str:
    """The step from geocentric axes to east, north, up."""
    longitude, latitude, height = origin
    place = f"+lon_0={longitude!r} +lat_0={latitude!r} +h_0={height!r}"
    return f"+proj=topocentric {_shape(datum)} {place}"


def map_crs(text: str, file: Path) -> CRS:
    """The map of a block: projected, metres, without heights.

    Raises:
        CrsError: It is none.
    """
    try:
        crs = CRS.from_user_input(text)
    except (CRSError, ProjError) as error:
        raise CrsError(
            file,
            say("Its CRS is not known ({crs}).", crs=text[:60]),
            "State it as a code such as EPSG:5514.",
        ) from error
    crs = plain_crs(crs)
    if not crs.is_projected or crs.geodetic_crs is None:
        raise CrsError(
            file,
            say("{crs} is no map in metres.", crs=crs.name),
            "Give the block a projected CRS.",
        )
    return crs


def plain_crs(crs: CRS) -> CRS:
    """A CRS without heights and without a shift of datum bound to it."""
    while crs.is_compound or crs.is_bound:
        source = crs.sub_crs_list[0] if crs.is_compound else crs.source_crs
        assert source is not None
        crs = source
    return crs


def geographic_of(crs: CRS) -> CRS:
    """The geographic CRS whose datum a map has."""
    assert crs.geodetic_crs is not None
    return crs.geodetic_crs


def crs_text(crs: CRS) -> str:
    """A code where there is one, else WKT."""
    authority = crs.to_authority(min_confidence=SURE)
    return crs.to_wkt() if authority is None else ":".join(authority)


SURE = 70  # source: pyproj's own default for an equivalent CRS that is named otherwise.
