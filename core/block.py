"""The block: cameras, photos, surveyed points, their measurements and the tie points, as values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from shapely import Polygon

from core.arrays import (
    FilmPoints,
    Flags,
    Indices,
    ObjectPoints,
    PixelPoints,
    Position,
    Scalars,
    locked,
)
from core.formats.listed_point import ListedPoint
from core.geometry.camera import Camera
from core.geometry.collinearity import (
    CORRECTIONS,
    Atmosphere,
    atmosphere_of,
    film_from_object,
    object_from_film,
)
from core.geometry.crs import Bounds
from core.geometry.drawn_mask import DrawnMask
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

Status = Literal["auto", "accepted", "rejected", "dubious", "unused"]
"""auto: used, no human has looked; unused: proposed and filtered out by the engine."""
Role = Literal["control", "check", "new"]
"""Control steers, check only judges; a new point is known by its measurements alone."""
Source = Literal["junction", "salient", "surveyed", "hand"]
# design: at least ten thousand times what any coordinate is known to.
UNKNOWN_M = 1e4
"""Standard deviation of a coordinate that is not known at all, metres: it has no weight."""
REFERENCE = "[reference]"
"""What the report calls the reference of that section of `block.toml`."""
# source: three points hold a plane; as many unknowns has the shift and slope of one coordinate.
LEAST_SURVEYED = 3
"""So many surveyed control points in use say where the block lies."""
USED: tuple[Status, ...] = ("auto", "accepted")
# design: half a pixel is what a hand points to.
HAND_SIGMA_PX = 0.5
"""Standard deviation per axis of a measurement made by hand, scan pixels."""
# design: one photo in four hundred lies further off.
SEARCH_SIGMAS = 3.0
"""So many standard deviations of what is known of a photo are searched."""
# design: 17 degrees; an aerial photo that is called vertical stays within 5.
MOST_TILT = 0.3
"""Photos are not taken to be tilted further than this, radians."""


@dataclass(frozen=True, slots=True, eq=False)
class ExteriorPrior:
    """How well the exterior orientation is known beforehand."""

    sigma_centre_m: Position
    """Standard deviations of the perspective centre (E, N, H), metres."""
    sigma_angles: Position
    """Standard deviations of omega, phi, kappa, radians."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma_centre_m", locked(self.sigma_centre_m))
        object.__setattr__(self, "sigma_angles", locked(self.sigma_angles))


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """One exposure: a scan, its camera, and its orientations."""

    photo_id: str
    """The scan's file name without folder and extension."""
    scan: Path
    """Path of the scan file."""
    size_px: tuple[int, int]
    """Columns and rows of the scan."""
    camera: str
    """Name of the camera."""
    interior: InteriorOrientation
    """Pixel <-> film."""
    exterior: ExteriorOrientation
    """The best orientation known now."""
    approximate: ExteriorOrientation
    """Where the block began from (world file, footprint, EO list): the mean of the prior."""
    prior: ExteriorPrior
    """How far `approximate` can be trusted."""
    ground_height_m: float
    """Mean height of the ground under the photo, metres."""
    oriented: bool = False
    """True once the exterior orientation rests on measurements that could not be chance."""
    mask: DrawnMask = field(default_factory=DrawnMask)
    """What a hand drew on the scan."""
    corrections: tuple[str, ...] = CORRECTIONS
    """What its rays are corrected for; not what the program it came from knew nothing of."""

    @property
    def atmosphere(self) -> Atmosphere:
        """Refraction and curvature, from the approximate height so that they stay constants."""
        air = atmosphere_of(float(self.approximate.centre[2]), self.ground_height_m)
        return Atmosphere(
            air.refraction if "refraction" in self.corrections else 0.0,
            air.curvature_per_m if "curvature" in self.corrections else 0.0,
        )

    def ground_pixel_m(self, camera: Camera) -> float:
        """Size of a scan pixel on the ground under the photo, metres."""
        above_ground = float(self.exterior.centre[2]) - self.ground_height_m
        return self.interior.pixel_size_mm / camera.principal_distance_mm * above_ground

    def width_m(self, camera: Camera) -> float:
        """Shorter side of the picture on level ground, metres."""
        above_ground = float(self.exterior.centre[2]) - self.ground_height_m
        return min(camera.frame_mm) / camera.principal_distance_mm * above_ground

    def with_exterior(self, exterior: ExteriorOrientation, oriented: bool) -> "Photo":
        """The same photo, elsewhere."""
        return replace(self, exterior=exterior, oriented=oriented)

    def pixel_from_object(self, points: ObjectPoints, camera: Camera) -> PixelPoints:
        """Scan pixels of object points, all corrections applied; NaN behind the camera."""
        return self.interior.pixel_from_film(
            film_from_object(points, self.exterior, camera, self.atmosphere)
        )

    def object_from_pixel(
        self, pixels: PixelPoints, heights: Scalars, camera: Camera
    ) -> ObjectPoints:
        """Object points at given heights (metres) on the rays of scan pixels."""
        film: FilmPoints = self.interior.film_from_pixel(pixels)
        return object_from_film(film, heights, self.exterior, camera, self.atmosphere)


@dataclass(frozen=True, slots=True)
class ShiftedReference:
    """A reference whose points lie off together: the adjustment estimates its shift and slope."""

    name: str
    """What the report calls it."""
    sigma_m: tuple[float, float, float]
    """What shift and slope may make up together (E, N, H): RMS over its area, metres; 0 for axes
    without any."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveyedPoint:
    """A point of the ground whose coordinates are known from elsewhere."""

    point_id: str
    """Unique name."""
    position: Position
    """Easting, northing, height, metres."""
    sigma_m: Position
    """A-priori standard deviations of the three, metres."""
    role: Role
    """What it is for."""
    source: Source
    """Road junction, salient ortho point, surveyed by the user, or chosen at the desk."""
    description: str = ""
    """What it is, in the surveyor's words."""
    sketch: str = ""
    """Name of the file with its sketch or photograph."""
    shifted: ShiftedReference | None = field(default=None, metadata={"later": True})
    """The reference it shares a shift with; None for what defines the datum."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", locked(self.position))
        object.__setattr__(self, "sigma_m", locked(self.sigma_m))


def surveyed_point(point: ListedPoint) -> SurveyedPoint:
    """A point of the user's list; what its role says is not known gets no weight."""
    east, north, height = point.sigma_m
    plan = point.role == "height"
    return SurveyedPoint(
        point.point_id,
        np.array([point.easting, point.northing, point.height]),
        np.array(
            [
                UNKNOWN_M if plan else east,
                UNKNOWN_M if plan else north,
                UNKNOWN_M if point.role == "plan" else height,
            ]
        ),
        "check" if point.role == "check" else "control",
        "surveyed",
        point.description,
        point.sketch,
    )


@dataclass(frozen=True, slots=True)
class Peak:
    """One place in a scan where a reference patch may lie."""

    column: float
    """Pixels."""
    row: float
    """Pixels."""
    sigma_px: float
    """Standard deviation per axis, scan pixels."""
    score: float
    """Height of the peak in its operator's own measure."""
    operator: str
    """Names of the operators that see it, joined by `+`, or `operator` for a hand placed one."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Where one operator measured a point in a photo."""

    operator: str
    """Who."""
    column: float
    """Pixels, corner origin."""
    row: float
    """Pixels, corner origin."""
    when: str
    """UTC, ISO 8601."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One surveyed point in one photo."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""
    column: float
    """Pixels, corner origin."""
    row: float
    """Pixels, corner origin."""
    sigma_px: float
    """Standard deviation per axis, pixels."""
    score: float = 1.0
    """How alike, 0 to 1."""
    status: Status = "auto"
    """What the engine or the operator said of it."""
    reason: str = ""
    """Why it is not used, or who placed it, in words."""
    peaks: tuple[Peak, ...] = ()
    """Every candidate that was found, best first."""
    readings: tuple[Reading, ...] = ()
    """Each operator's latest, newest last, where hands placed it."""
    seen: bool = True
    """False where a proposal was accepted with others, and nobody looked at it here."""

    @property
    def key(self) -> tuple[str, str]:
        """Point and photo: what names a measurement."""
        return self.point_id, self.photo_id

    @property
    def pixel(self) -> PixelPoints:
        """The place as a (1, 2) array of pixels."""
        return np.array([[self.column, self.row]])

    @property
    def used(self) -> bool:
        """True when the adjustment may use it."""
        return self.status in USED


@dataclass(frozen=True, slots=True, eq=False)
class TiePoints:
    """Ground details measured in two or more photos, as parallel arrays of rays."""

    photo_ids: tuple[str, ...]
    """Photos that `photo` counts through."""
    point: Indices
    """Tie point of each ray, 0 to number of points - 1."""
    photo: Indices
    """Index into `photo_ids` of each ray."""
    pixels: PixelPoints
    """Scan pixel of each ray."""
    sigma_px: Scalars
    """Standard deviation per axis of each ray, pixels."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", locked(self.point, np.int64))
        object.__setattr__(self, "photo", locked(self.photo, np.int64))
        object.__setattr__(self, "pixels", locked(np.reshape(self.pixels, (-1, 2))))
        object.__setattr__(self, "sigma_px", locked(self.sigma_px))

    @property
    def count(self) -> int:
        """Number of tie points."""
        return int(self.point.max()) + 1 if len(self.point) else 0

    def kept(self, rays: Flags) -> "TiePoints":
        """The same with some of the rays; tie points keep their numbers."""
        return TiePoints(
            self.photo_ids, self.point[rays], self.photo[rays], self.pixels[rays],
            self.sigma_px[rays],
        )  # fmt: skip

    @staticmethod
    def none() -> "TiePoints":
        """No tie points at all."""
        empty = np.zeros(0, dtype=np.int64)
        return TiePoints((), empty, empty, np.zeros((0, 2)), np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """All photos that are adjusted together, and everything measured in them."""

    crs: str
    """The block's CRS, such as `EPSG:5514`."""
    cameras: Mapping[str, Camera]
    """Cameras by name."""
    photos: Mapping[str, Photo]
    """Photos by name, in the order of their names."""
    surveyed: Mapping[str, SurveyedPoint] = field(default_factory=dict[str, SurveyedPoint])
    """Surveyed points by name."""
    measurements: Mapping[tuple[str, str], Measurement] = field(
        default_factory=dict[tuple[str, str], Measurement]
    )
    """Measurements of surveyed points by (point, photo)."""
    ties: TiePoints = field(default_factory=TiePoints.none)
    """Tie points."""
    fixed_origin: Position | None = None
    """Origin of the local frame whatever becomes of the photos; None where it is their middle."""
    reference: ShiftedReference | None = field(default=None, metadata={"later": True})
    """What the reference that gave control may be off as a whole; None without one."""

    def camera_of(self, photo_id: str) -> Camera:
        """The camera of a photo."""
        return self.cameras[self.photos[photo_id].camera]

    def with_certificates(self) -> "Block":
        """The same block with every camera as its certificate has it, nothing estimated."""
        return replace(self, cameras={n: c.certificate for n, c in self.cameras.items()})

    @property
    def origin(self) -> Position:
        """Origin of the local frame: middle of the photos' approximate centres, height nought."""
        if self.fixed_origin is not None:
            return self.fixed_origin
        centres = np.array([photo.approximate.centre for photo in self.photos.values()])
        east, north = float(centres[:, 0].mean()), float(centres[:, 1].mean())
        return np.array([round(east, -1), round(north, -1), 0.0])

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north of all footprints, metres."""
        areas = [footprint(p, self.cameras[p.camera]).bounds for p in self.photos.values()]
        low, high = np.min(areas, axis=0), np.max(areas, axis=0)
        return float(low[0]), float(low[1]), float(high[2]), float(high[3])

    @property
    def search_bounds(self) -> Bounds:
        """The bounds with room for what the approximate orientations may be off, metres."""
        west, south, east, north = self.bounds
        room = max(
            SEARCH_SIGMAS * float(np.max(photo.prior.sigma_centre_m[:2]))
            + float(photo.approximate.centre[2] - photo.ground_height_m)
            * float(np.tan(min(SEARCH_SIGMAS * np.max(photo.prior.sigma_angles[:2]), MOST_TILT)))
            for photo in self.photos.values()
        )
        return west - room, south - room, east + room, north + room

    def steers(self, measurement: Measurement) -> bool:
        """True when a measurement takes part: it is used, and its point is control."""
        point = self.surveyed.get(measurement.point_id)
        return measurement.used and point is not None and point.role == "control"

    @property
    def surveyed_datum(self) -> bool:
        """Whether surveyed points say where the block lies, and not the reference it has."""
        if self.reference is None:
            return False
        own = {
            name
            for name, point in self.surveyed.items()
            if point.source == "surveyed"
            and point.role == "control"
            and np.all(point.sigma_m < UNKNOWN_M)
        }
        if len(own) < LEAST_SURVEYED:
            return False
        measured = {
            name
            for (name, photo), item in self.measurements.items()
            if name in own and item.used and self.photos[photo].oriented
        }
        return len(measured) >= LEAST_SURVEYED

    def reference_error_m(self, ortho_sigma_m: float) -> float:
        """What the reference adds per axis to what is predicted on the ground, metres.

        Nothing where surveyed points say where the block lies: the adjustment knows how well they
        tell what the reference is off.
        """
        return 0.0 if self.surveyed_datum else ortho_sigma_m

    @property
    def independent_checks(self) -> frozenset[str]:
        """Check points that the user brought and somebody saw: the reference says nothing of them.

        In one photo at least the place is a hand's, or was looked at when it was accepted.
        """
        own = {
            name
            for name, point in self.surveyed.items()
            if point.role == "check" and point.source == "surveyed"
        }
        measured = self.measurements.items() if own else ()
        return frozenset(
            name for (name, _), item in measured if name in own and item.used and item.seen
        )

    def with_fixed_origin(self) -> "Block":
        """The same block, whose local frame stays where it is when photos are placed anew."""
        return replace(self, fixed_origin=locked(self.origin))

    def with_photos(self, photos: Mapping[str, Photo]) -> "Block":
        """The same block with other photos."""
        return replace(self, photos=dict(sorted(photos.items())))

    def with_measurement(self, measurement: Measurement) -> "Block":
        """The same block with one measurement added or replaced."""
        return replace(self, measurements={**self.measurements, measurement.key: measurement})


def footprint(photo: Photo, camera: Camera) -> Polygon:
    """Ground of a photo's picture area at its mean height, easting and northing, metres."""
    corners = photo.interior.pixel_from_film(camera.frame_corners_mm)
    return Polygon(ground_of(photo, camera, corners)[:, :2])


def ground_of(photo: Photo, camera: Camera, pixels: PixelPoints) -> ObjectPoints:
    """Scan pixels on the mean ground, along the orientation that is the best known now."""
    heights = np.full(len(pixels), photo.ground_height_m)
    return photo.object_from_pixel(pixels, heights, camera)


def position_sigma_m(photo: Photo) -> float:
    """Standard deviation of a footprint's place on the ground, metres: position and tilt."""
    height = abs(float(photo.exterior.centre[2]) - photo.ground_height_m)
    plane = float(np.max(photo.prior.sigma_centre_m[:2]))
    tilt = height * float(np.max(photo.prior.sigma_angles[:2]))
    return float(np.hypot(plane, tilt))
