"""A block in a local tangent frame: east, north, up at its middle, metres, Euclidean.

Projected coordinates are none of Euclid's: the map stretches the plan and not the heights, and the
Earth falls away. Programs that know neither adjust rightly in this frame alone. Measurements must
be as the scan shows them, with the Earth's curvature in them.
"""

from dataclasses import dataclass, replace

import numpy as np
from pyproj import CRS, Transformer
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation as Turn

from core.arrays import ObjectPoints, Position, Rotation
from core.errors import CrsError
from core.formats.exchange import ExchangeBlock, ExchangePhoto, Triple
from core.geometry.crs import horizontal, read_crs, short_name
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.said import say

# source: mean radius of the Earth (IUGG), metres.
EARTH_RADIUS_M = 6_371_000.0
"""By what the ground falls away below a plane."""
# design: rays to the corners of any film camera, and what lies between.
FIELD = (-0.8, -0.4, 0.0, 0.4, 0.8)
"""Image coordinates (without unit) of the rays by which an orientation is carried over."""
# design: rounds of the search for curved ground; each leaves a thousandth of the error.
ROUNDS = 5
"""Rounds."""
# design: a ray flatter than one in ten meets no ground that anybody measures.
FLATTEST = 0.1
"""Steepness below which a ray is not followed to the ground."""
# source: three turns and three shifts.
UNKNOWNS = 6
"""Of an exterior orientation."""
# design: rounding of doubles.
SETTLED = 1e-14
"""Relative change at which an orientation rests."""
# design: a step over which the frame's axes are straight to a micrometre.
STEP_M = 1.0
"""Length of the axes whose direction is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class TangentFrame:
    """East, north, up at one place of the ellipsoid."""

    crs: str
    """CRS of the coordinates outside."""
    origin: tuple[float, float, float]
    """Longitude, latitude (degrees) and height (metres) of its origin."""
    pipeline: str
    """PROJ's way from longitude, latitude, height to it."""

    def from_object(self, points: ObjectPoints) -> ObjectPoints:
        """Points of the CRS in the frame, metres; heights are taken as ellipsoidal."""
        lon, lat = self._geographic().transform(points[:, 0], points[:, 1])
        return np.column_stack(_local(self.pipeline).transform(lon, lat, points[:, 2]))

    def to_object(self, points: ObjectPoints) -> ObjectPoints:
        """Points of the frame in the CRS."""
        lon, lat, height = _local(self.pipeline).transform(*points.T, direction="INVERSE")
        east, north = self._geographic().transform(lon, lat, direction="INVERSE")
        return np.column_stack([east, north, height])

    def _geographic(self) -> Transformer:
        """From the plane to longitude and latitude on the same ellipsoid."""
        plane = horizontal(CRS(self.crs))
        return Transformer.from_crs(plane, plane.geodetic_crs, always_xy=True)


def _local(pipeline: str) -> Transformer:
    """PROJ's operation by its description."""
    return Transformer.from_pipeline(pipeline)


def tangent_frame(crs: str, middle: Position) -> TangentFrame:
    """The frame at a place.

    Args:
        crs: A projected CRS in metres.
        middle: Easting, northing, height of its origin.

    Raises:
        CrsError: No CRS, or one that PROJ does not know or that is not projected.
    """
    plane = horizontal(read_crs(crs, "[block] crs"))
    if not plane.is_projected or plane.geodetic_crs is None:
        raise CrsError(
            "[block] crs",
            say("{name} does not count in metres on a map plane.", name=short_name(plane)),
            "Give a projected CRS in metres, such as EPSG:5514 or EPSG:32633.",
        )
    there = Transformer.from_crs(plane, plane.geodetic_crs, always_xy=True)
    lon, lat = there.transform(float(middle[0]), float(middle[1]))
    ellipsoid = plane.geodetic_crs.ellipsoid
    assert ellipsoid is not None, "a geodetic CRS has an ellipsoid"
    shape = f"+a={ellipsoid.semi_major_metre!r} +rf={ellipsoid.inverse_flattening!r}"
    height = float(middle[2])
    pipeline = (
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        f"+step +proj=cart {shape} "
        f"+step +proj=topocentric {shape} +lon_0={lon!r} +lat_0={lat!r} +h_0={height!r}"
    )
    return TangentFrame(crs, (float(lon), float(lat), height), pipeline)


def in_tangent_frame(block: ExchangeBlock) -> tuple[ExchangeBlock, TangentFrame]:
    """A block with all its coordinates and orientations in a tangent frame at its middle.

    Args:
        block: Its CRS must be projected; its measurements as the scans show them.

    Raises:
        CrsError: No CRS, or one that is not projected.
    """
    ground = _ground(block)
    centres = [p.exterior.centre for p in block.photos.values() if p.exterior is not None]
    places = np.array([*ground, *centres]).reshape(-1, 3)
    middle = places.mean(axis=0) if len(places) else np.zeros(3)
    level = float(np.mean([point[2] for point in ground])) if ground else None
    middle[2] = 0.0 if level is None else level
    frame = tangent_frame(block.crs, middle)
    photos: dict[str, ExchangePhoto] = {}
    left = 0.0
    for name, photo in block.photos.items():
        photos[name], off = _carried(photo, frame, level)
        left = max(left, off)
    points = {
        name: replace(
            point,
            position=_triple(frame.from_object(np.array([point.position]))[0]),
            sigma_m=_turned(point.sigma_m, _axes(frame, np.array(point.position))),
        )
        for name, point in block.points.items()
    }
    ties = block.ties
    if ties.positions is not None:
        known = np.isfinite(ties.positions).all(axis=1)
        moved = np.array(ties.positions)
        moved[known] = frame.from_object(moved[known])
        ties = replace(ties, positions=moved)
    lon, lat, height = frame.origin
    note = say(
        "Coordinates are east, north and up of a tangent frame at longitude {lon:.9f}, latitude "
        "{lat:.9f}, height {height:.3f} m; heights count as ellipsoidal. Orientations see the "
        "ground within {left:.2g} px of where they saw it.",
        lon=lon, lat=lat, height=height, left=left,
    )  # fmt: skip
    made = replace(
        block, crs="", photos=photos, points=points, ties=ties, notes=(*block.notes, note)
    )
    return made, frame


def _ground(block: ExchangeBlock) -> list[Position]:
    """All points of the ground that are known."""
    found = [np.array(point.position) for point in block.points.values()]
    if block.ties.positions is not None:
        found += [place for place in block.ties.positions if np.isfinite(place).all()]
    return found


def _carried(
    photo: ExchangePhoto, frame: TangentFrame, level: float | None
) -> tuple[ExchangePhoto, float]:
    """A photo in the frame, and how far its rays to the ground are off at most, pixels.

    Turned with the map's axes at its centre. Where the ground is known, centre and rotation then
    take up what the map stretches, so that the rays meet the same places.
    """
    exterior = photo.exterior
    if exterior is None:
        return photo, 0.0
    axes = _axes(frame, exterior.centre)
    rotation = axes @ exterior.object_from_image
    centre = frame.from_object(exterior.centre[None])[0]
    seen = None if level is None else _seen(exterior, level)
    off = 0.0
    if seen is not None:
        image, places = seen
        rotation, centre, rest = _resected(image, frame.from_object(places), rotation, centre)
        scale = 1.0
        if photo.pixel_from_image is not None:
            scale = float(np.sqrt(abs(np.linalg.det(photo.pixel_from_image[:, :2]))))
        off = rest * scale
    carried = replace(
        photo,
        exterior=ExteriorOrientation(centre, *angles_from_rotation(rotation)),
        sigma_centre_m=_turned(photo.sigma_centre_m, axes),
        sigma_angles=_turned(photo.sigma_angles, axes),
    )
    return carried, off


def _seen(exterior: ExteriorOrientation, level: float) -> tuple[np.ndarray, ObjectPoints] | None:
    """Rays of a photo (ideal image coordinates), and where they meet the curved ground.

    None where a ray does not look down. A place at the distance d lies d^2 / 2 R lower in space
    than its height says.
    """
    x, y = (grid.ravel() for grid in np.meshgrid(FIELD, FIELD))
    image = np.column_stack([x, y])
    rays = np.column_stack([x, y, -np.ones_like(x)]) @ exterior.object_from_image.T
    steep = rays[:, 2] < -FLATTEST * np.hypot(rays[:, 0], rays[:, 1])
    if not steep.all() or exterior.centre[2] <= level:
        return None
    drop = np.zeros(len(rays))
    places = np.zeros((len(rays), 3))
    for _ in range(ROUNDS):
        reach = (level - drop - exterior.centre[2]) / rays[:, 2]
        places = exterior.centre + reach[:, None] * rays
        drop = np.sum((places - exterior.centre)[:, :2] ** 2, axis=1) / (2 * EARTH_RADIUS_M)
    places[:, 2] = level
    return image, places


def _resected(
    image: np.ndarray, places: ObjectPoints, rotation: Rotation, centre: Position
) -> tuple[Rotation, Position, float]:
    """Rotation and centre that see places at their image coordinates, and how far off at most."""
    height = float(np.linalg.norm(places.mean(axis=0) - centre))

    def rest(step: np.ndarray) -> np.ndarray:
        turned = rotation @ Turn.from_rotvec(step[:3]).as_matrix()
        space = (places - (centre + height * step[3:])) @ turned
        return (space[:, :2] / -space[:, 2:] - image).ravel()

    found = least_squares(
        rest, np.zeros(UNKNOWNS), method="lm", xtol=SETTLED, ftol=SETTLED, gtol=SETTLED
    )
    turned = rotation @ Turn.from_rotvec(found.x[:3]).as_matrix()
    off = np.hypot(*rest(found.x).reshape(-1, 2).T).max()
    return turned, centre + height * found.x[3:], float(off)


def _axes(frame: TangentFrame, place: Position) -> Rotation:
    """Directions of the map's east, north and up at a place, as columns in the frame."""
    ends = place + STEP_M * np.vstack([np.eye(3), -np.eye(3)])
    moved = frame.from_object(ends)
    left, _, right = np.linalg.svd((moved[:3] - moved[3:]).T)
    return left @ right


def _turned(sigma: Triple | None, axes: Rotation) -> Triple | None:
    """Standard deviations along the frame's axes, as far as they are independent."""
    return None if sigma is None else _triple(np.sqrt(axes**2 @ np.array(sigma) ** 2))


def _triple(values: np.ndarray) -> Triple:
    """Three floats."""
    first, second, third = (float(value) for value in values)
    return first, second, third
