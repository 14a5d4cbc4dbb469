"""A block in a local tangent frame: east, north, up at its middle, metres, Euclidean.

Projected coordinates are not Euclidean: the map stretches the plan but not the heights, and the
Earth curves. Programs that model neither adjust correctly only in this frame. Measurements must
be as the scan shows them, with the Earth's curvature in them.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation as Turn

from core.arrays import ObjectPoints, Position, Rotation
from core.formats.exchange import ExchangeBlock, ExchangePhoto, Triple
from core.formats.rotations import triple_of
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.geometry.map_in_space import MapInSpace, tangent_frame
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


def in_tangent_frame(block: ExchangeBlock) -> tuple[ExchangeBlock, MapInSpace]:
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
            position=triple_of(frame.from_object(np.array([point.position]))[0]),
            sigma_m=_turned(point.sigma_m, frame.turn_at(np.array(point.position))),
        )
        for name, point in block.points.items()
    }
    ties = block.ties
    if ties.positions is not None:
        known = np.isfinite(ties.positions).all(axis=1)
        moved = np.array(ties.positions)
        moved[known] = frame.from_object(moved[known])
        ties = replace(ties, positions=moved)
    assert frame.origin is not None, "a tangent frame touches the Earth somewhere"
    lon, lat, height = frame.origin
    note = say(
        "Coordinates are east, north and up of a tangent frame at longitude {lon:.9f}, latitude "
        "{lat:.9f}, height {height:.3f} m; heights count as ellipsoidal. Orientations see the "
        "ground within {left:.2g} px of where they saw it.",
        lon=lon,
        lat=lat,
        height=height,
        left=left,
    )
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
    photo: ExchangePhoto, frame: MapInSpace, level: float | None
) -> tuple[ExchangePhoto, float]:
    """A photo in the frame, and how far its rays to the ground are off at most, pixels.

    Turned with the map's axes at its centre. Where the ground is known, centre and rotation then
    take up what the map stretches, so that the rays meet the same places.
    """
    exterior = photo.exterior
    if exterior is None:
        return photo, 0.0
    axes = frame.turn_at(exterior.centre)
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


def _turned(sigma: Triple | None, axes: Rotation) -> Triple | None:
    """Standard deviations along the frame's axes, as far as they are independent."""
    return None if sigma is None else triple_of(np.sqrt(axes**2 @ np.array(sigma) ** 2))
