"""A block for exchange between programs: cameras, photos, points, measurements and ties.

Every foreign format is read into this value and written from it. Most programs hold only part of
it, so most fields may be empty.

Image coordinates are those of film divided by the principal distance: x right, y up, without unit,
from the principal point. The lens moves an ideal point to
(x, y) (1 + k1 r^2 + k2 r^4 + ...) + (p1 (r^2 + 2 x^2) + 2 p2 x y, p2 (r^2 + 2 y^2) + 2 p1 x y)
(Brown 1971), and an affine transform maps it into the scan.
"""

import csv
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float64
from pyproj.exceptions import ProjError

from core.arrays import (
    Affine2,
    FilmPoints,
    Indices,
    ObjectPoints,
    PixelPoints,
    Position,
    Rotation,
    Scalars,
    locked,
)
from core.errors import ExchangeError
from core.formats.rotations import Triple
from core.geometry.crs import PlanePoints
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation

Pair = tuple[float, float]
# design: distortion moves points by a hundredth, so a step leaves a hundredth of the error.
ROUNDS = 30
"""Steps of the iteration that undoes distortion, at most."""
# design: far below what a double of image coordinates near one can hold of a pixel.
SETTLED = 1e-15
"""Image coordinates that move less between two steps have settled."""
# source: definition of the two frames; half a turn about x.
FLIP = np.diag([1.0, -1.0, -1.0])
"""Image space (x right, y up, z backwards) from a camera's axes (x right, y down, z forwards)."""


@dataclass(frozen=True, slots=True)
class ExchangeCamera:
    """A camera: what its lens does, and what is known of it on film."""

    name: str
    """Its name in the block."""
    radial: tuple[float, ...] = ()
    """k1, k2, ... for image coordinates (without unit)."""
    tangential: Pair = (0.0, 0.0)
    """p1, p2 for image coordinates (without unit)."""
    size_px: tuple[int, int] | None = None
    """Columns and rows of its scans, where all have the same."""
    principal_distance_mm: float | None = None
    """Principal distance on film or sensor, where it is known."""
    principal_point_mm: Pair = (0.0, 0.0)
    """Principal point in the frame of the fiducials, x right, y up."""
    frame_mm: Pair | None = None
    """Width and height of the picture area."""
    fiducials_mm: Mapping[str, Pair] = field(default_factory=dict[str, Pair])
    """Certified fiducials, x right, y up."""


@dataclass(frozen=True, slots=True, eq=False)
class ExchangePhoto:
    """One exposure."""

    photo_id: str
    """File name of the scan without folder and extension."""
    file: str
    """File name of the scan with its extension, as the program gives it."""
    camera: str = ""
    """Name of its camera; empty when none is known."""
    pixel_from_image: Affine2 | None = None
    """2 x 3: pixel (column, row; outer corner) from distorted image coordinates."""
    exterior: ExteriorOrientation | None = None
    """Where it was taken and how it was turned."""
    sigma_centre_m: Triple | None = None
    """Standard deviations of the perspective centre, metres."""
    sigma_angles: Triple | None = None
    """Standard deviations of omega, phi, kappa, radians."""
    fiducials_px: Mapping[str, Pair] = field(default_factory=dict[str, Pair])
    """Measured fiducials: column, row."""
    taken: str = ""
    """Day, month or year of exposure as ISO has it; empty where nobody says."""
    position: Triple | None = None
    """Where it was taken, where nobody says how it was turned."""

    def __post_init__(self) -> None:
        if self.pixel_from_image is not None:
            object.__setattr__(self, "pixel_from_image", locked(self.pixel_from_image))

    @property
    def centre(self) -> Triple | None:
        """Where it was taken, as far as that is known."""
        if self.exterior is None:
            return self.position
        east, north, height = self.exterior.centre.tolist()
        return east, north, height

    @property
    def orientation(self) -> ExteriorOrientation:
        """The exterior orientation of a photo that has one."""
        assert self.exterior is not None, "only an oriented photo lies anywhere"
        return self.exterior

    @property
    def interior(self) -> Affine2:
        """pixel_from_image of a photo that has one."""
        assert self.pixel_from_image is not None, "only then its pixels are known"
        return self.pixel_from_image

    @property
    def focal_px(self) -> float:
        """Principal distance in rows, pixels, of a photo that has an interior."""
        return float(np.hypot(*self.interior[1, :2]))


@dataclass(frozen=True, slots=True)
class ExchangePoint:
    """A surveyed point."""

    point_id: str
    """Name."""
    position: Triple
    """Easting, northing, height, metres."""
    sigma_m: Triple | None = None
    """Standard deviations, metres; None where the format has none."""
    role: Literal["control", "check"] = "control"
    """Control steers, check only judges."""


@dataclass(frozen=True, slots=True)
class ExchangeMeasurement:
    """A surveyed point in a photo."""

    point_id: str
    """The point."""
    photo_id: str
    """The photo."""
    column: float
    """Pixels, outer corner."""
    row: float
    """Pixels, outer corner."""
    sigma_px: float | None = None
    """Standard deviation per axis, pixels; None where the format has none."""


@dataclass(frozen=True, slots=True, eq=False)
class ExchangeTies:
    """Tie points as parallel arrays of rays."""

    photo_ids: tuple[str, ...]
    """Photos that `photo` counts through."""
    point: Indices
    """Tie point of each ray, 0 to number of points - 1."""
    photo: Indices
    """Index into `photo_ids` of each ray."""
    pixels: PixelPoints
    """Column and row of each ray."""
    names: tuple[str, ...] = ()
    """Names of the points; empty when they have none."""
    positions: Float64[np.ndarray, "points 3"] | None = None
    """Object points, metres, one a tie point, NaN where unknown; None when no point is known."""
    sigma_px: Scalars | None = None
    """Standard deviation per axis of each ray, pixels."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", locked(self.point, np.int64))
        object.__setattr__(self, "photo", locked(self.photo, np.int64))
        object.__setattr__(self, "pixels", locked(np.reshape(self.pixels, (-1, 2))))
        for name in ("positions", "sigma_px"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, locked(getattr(self, name)))

    @staticmethod
    def none() -> "ExchangeTies":
        """No tie points."""
        empty = np.zeros(0, dtype=np.int64)
        return ExchangeTies((), empty, empty, np.zeros((0, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class ExchangeBlock:
    """All that went out or came in."""

    crs: str = ""
    """CRS of all coordinates as a code or WKT; empty for a local frame, or when nobody said."""
    cameras: Mapping[str, ExchangeCamera] = field(default_factory=dict[str, ExchangeCamera])
    """Cameras by name."""
    photos: Mapping[str, ExchangePhoto] = field(default_factory=dict[str, ExchangePhoto])
    """Photos by name."""
    points: Mapping[str, ExchangePoint] = field(default_factory=dict[str, ExchangePoint])
    """Surveyed points by name."""
    measurements: tuple[ExchangeMeasurement, ...] = ()
    """Measurements of surveyed points."""
    ties: ExchangeTies = field(default_factory=ExchangeTies.none)
    """Tie points."""
    notes: tuple[str, ...] = ()
    """What could not be taken over, a sentence each."""
    from_middle: bool = False
    """Whether its pixels count from the middle of the scans, since nobody said their size."""
    on_film: bool = False
    """Whether its pixels are micrometres of film, since its program knows no scans."""

    def camera_of(self, photo_id: str) -> ExchangeCamera:
        """The camera of a photo that has one."""
        return self.cameras[self.photos[photo_id].camera]


def places_of(block: ExchangeBlock) -> PlanePoints:
    """Eastings and northings of perspective centres and points, (n, 2)."""
    centres = (p.exterior.centre for p in block.photos.values() if p.exterior is not None)
    places = [*centres, *(point.position for point in block.points.values())]
    return np.array(places, dtype=np.float64).reshape(-1, 3)[:, :2]


Holds = Literal["film", "frame", "upright", "nothing"]
"""Which interior a format can hold: `film`, any affine of a scan; `frame`, principal distance,
principal point, affinity and skew in pixels; `upright`, square pixels that are not turned;
`nothing` of the camera."""


@dataclass(frozen=True, slots=True)
class Conventions:
    """How a format counts, a short English phrase each; the page of conventions is made of them."""

    object_space: str
    """Axes, frame and unit of coordinates."""
    lost: str
    """What of a block it cannot hold."""
    pixels: str = "none"
    """Origin and axes of pixels."""
    rotation: str = "none"
    """Angles or matrix: order, unit, direction, axes of the camera."""
    camera: str = "none"
    """Principal distance, principal point, distortion: units and formula."""
    sigmas: str = "none"
    """Which standard deviations it holds."""
    tested: str = "untested on real files"
    """On which program's files it was tested."""


@dataclass(frozen=True, slots=True)
class ExchangeFormat:
    """One format both ways."""

    name: str
    """As `--to` and `--from` take it."""
    title: str
    """What a user calls it."""
    conventions: Conventions
    """How it counts."""
    holds: Holds
    """Which interior it can hold."""
    write: Callable[[Path, ExchangeBlock], tuple[str, ...]] | None = None
    """Writes a block to a file or into a folder (as `folder` says); returns what was left out."""
    read: Callable[[Path], ExchangeBlock] | None = None
    """Reads a file or folder; raises a PhotogrammetryError that names file, cause, remedy."""
    default_name: str = ""
    """Name of the file or folder it writes, where nobody gave one."""
    folder: bool = True
    """Whether it is a folder of several files."""
    curved: bool = True
    """Whether it leaves the Earth's curvature to whoever reads it; else measurements are given
    as a flat Earth would show them."""
    refracts: bool = False
    """Whether whoever reads it corrects refraction himself; else the camera takes it up."""


# What a reader stumbles over in a file that is damaged or of another program.
DAMAGE = (
    ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError,
    StopIteration, OSError, ProjError, csv.Error,
)  # fmt: skip


@contextmanager
def understood(path: Path) -> Generator[None]:
    """Around the reading of a foreign file: whatever damage does there is one error of ours.

    Raises:
        ExchangeError: The file cannot be understood.
    """
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            yield
    except DAMAGE as error:
        raise ExchangeError(
            path,
            "It is damaged, or of another program ({error}).",
            "Export it again from the program that wrote it, or name its format.",
            error=f"{type(error).__name__}: {error}",
        ) from error


def read_format(form: ExchangeFormat, path: Path) -> ExchangeBlock:
    """A foreign file or folder; its numbers are numbers and its names are text.

    Raises:
        PhotogrammetryError: It cannot be read or understood.
    """
    assert form.read is not None
    with understood(path):
        block = form.read(path)
        _check_numbers(block)
        _check_names(block)
    return block


def _check_names(block: ExchangeBlock) -> None:
    """Refuse names that cannot be written anywhere: halves of a sign, as broken JSON has them."""
    measured = (one.point_id for one in block.measurements)
    files = (photo.file for photo in block.photos.values())
    "".join((*block.cameras, *block.photos, *block.points, *files, *measured, block.crs)).encode()


def _check_numbers(block: ExchangeBlock) -> None:
    """Refuse what is too large for any place on the Earth or in a scan."""
    places: list[tuple[str, Sequence[float]]] = [
        (name, (*p.position, *(p.sigma_m or ()))) for name, p in block.points.items()
    ]
    for name, photo in block.photos.items():
        if photo.exterior is not None:
            places.append((name, (*photo.exterior.centre, *photo.exterior.angles)))
        if photo.pixel_from_image is not None:
            places.append((name, photo.pixel_from_image.ravel().tolist()))
    places += [(one.point_id, (one.column, one.row)) for one in block.measurements]
    for name, values in places:
        if not all(abs(value) < FARTHEST for value in values):
            raise ValueError(f"{name}: {[float(value) for value in values]}")
    if not (np.abs(block.ties.pixels) < FARTHEST).all():
        raise ValueError("a tie point lies nowhere")


# design: metres or pixels that no map and no scan has; the Sun is farther, the Moon is not.
FARTHEST = 1e10


def image_from_ideal(ideal: FilmPoints, camera: ExchangeCamera) -> FilmPoints:
    """Image coordinates as the lens gives them, from ideal ones."""
    x, y = ideal[:, 0], ideal[:, 1]
    square = x * x + y * y
    factor = np.ones_like(square)
    for power, value in enumerate(camera.radial, start=1):
        factor = factor + value * square**power
    p1, p2 = camera.tangential
    return np.column_stack(
        [
            x * factor + p1 * (square + 2 * x * x) + 2 * p2 * x * y,
            y * factor + p2 * (square + 2 * y * y) + 2 * p1 * x * y,
        ]
    )


def ideal_from_image(image: FilmPoints, camera: ExchangeCamera) -> FilmPoints:
    """Ideal image coordinates, by iteration."""
    ideal = np.array(image)
    for _ in range(ROUNDS):
        step = image - image_from_ideal(ideal, camera)
        ideal = ideal + step
        if not np.any(np.abs(step) > SETTLED):
            break
    return ideal


def pixels_of(points: ObjectPoints, photo: ExchangePhoto, camera: ExchangeCamera) -> PixelPoints:
    """Pixels of object points (metres) in an oriented photo; NaN behind the camera."""
    if photo.exterior is None or photo.pixel_from_image is None:
        raise ValueError(f"{photo.photo_id} has no orientation")
    space = (points - photo.exterior.centre) @ photo.exterior.object_from_image
    depth = np.where(space[:, 2] < 0, -space[:, 2], np.nan)
    image = image_from_ideal(space[:, :2] / depth[:, None], camera)
    return image @ photo.pixel_from_image[:, :2].T + photo.pixel_from_image[:, 2]


@dataclass(frozen=True, slots=True)
class FrameInterior:
    """A camera as most programs hold it, without its place: axes x right, y down, z forwards.

    With u = X / Z, v = Y / Z of the camera's axes, distorted by OpenCV's formula:
    column = c_x + (focal + affinity) u + skew v, row = c_y + focal v.
    """

    size_px: tuple[int, int] | None
    """Columns and rows, where they are known."""
    focal_px: float
    """Principal distance in rows, pixels."""
    principal_point_px: Pair
    """Column and row, outer corner."""
    affinity_px: float = 0.0
    """b1: how much longer it is in columns, pixels."""
    skew_px: float = 0.0
    """b2, pixels."""
    radial: tuple[float, ...] = ()
    """k1, k2, ..."""
    tangential: Pair = (0.0, 0.0)
    """p1, p2 as OpenCV has them: du = 2 p1 u v + p2 (r^2 + 2 u^2), dv = p1 (r^2 + 2 v^2) + ..."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameCamera(FrameInterior):
    """A photo as most programs hold it: its camera, and its place where it is oriented."""

    camera_from_object: Rotation | None = None
    """Rotation into the camera's axes; None where the photo is not oriented."""
    centre: Position | None = None
    """Perspective centre, metres."""

    def with_rotation_and_centre(self) -> tuple[Rotation, Position]:
        """Both, of an oriented photo."""
        if self.camera_from_object is None or self.centre is None:
            raise ValueError("the photo has no orientation")
        return self.camera_from_object, self.centre


def frame_camera(photo: ExchangePhoto, camera: ExchangeCamera) -> FrameCamera:
    """The same photo with its scan's turn put into its orientation: exact for any affine.

    Raises:
        ValueError: The photo has no interior, or was scanned from its back.
    """
    if photo.pixel_from_image is None:
        raise ValueError(f"{photo.photo_id} has no interior orientation")
    # In camera axes y points down, so the second column changes its sign.
    matrix = photo.pixel_from_image[:, :2] @ np.diag([1.0, -1.0])
    if np.linalg.det(matrix) <= 0:
        raise ValueError(f"{photo.photo_id} was scanned from its back")
    # matrix = upper @ turn, with the row's principal distance in the lower right.
    focal = photo.focal_px
    sine, cosine = matrix[1] / focal
    turn = np.array([[cosine, -sine], [sine, cosine]])
    upper = matrix @ turn.T
    p1, p2 = camera.tangential
    # (p1, p2) of image space is a vector; in OpenCV's naming its x is p2 and its y is p1.
    vector = turn @ np.array([p1, -p2])
    exterior = photo.exterior
    rotation = None
    if exterior is not None:
        rotation = _spatial(turn) @ FLIP @ exterior.object_from_image.T
    return FrameCamera(
        camera.size_px,
        focal,
        (float(photo.pixel_from_image[0, 2]), float(photo.pixel_from_image[1, 2])),
        float(upper[0, 0]) - focal,
        float(upper[0, 1]),
        camera.radial,
        (float(vector[1]), float(vector[0])),
        rotation,
        None if exterior is None else exterior.centre,
    )


def upright_camera(photo: ExchangePhoto, camera: ExchangeCamera) -> FrameCamera | None:
    """As `frame_camera`; None for a photo without interior, or scanned from its back."""
    try:
        return frame_camera(photo, camera)
    except ValueError:
        return None


def placed(
    interior: FrameInterior, rotation: Rotation | None = None, centre: Position | None = None
) -> FrameCamera:
    """A camera with its place: rotation into its axes, perspective centre in metres."""
    point, tangential = interior.principal_point_px, interior.tangential
    own = interior.focal_px, point, interior.affinity_px, interior.skew_px, interior.radial
    return FrameCamera(interior.size_px, *own, tangential, rotation, centre)


def from_frame_camera(frame: FrameCamera) -> tuple[Affine2, Pair, ExteriorOrientation | None]:
    """pixel_from_image, tangential and exterior of a photo that a program holds in this way."""
    matrix = np.array(
        [
            [frame.focal_px + frame.affinity_px, -frame.skew_px, frame.principal_point_px[0]],
            [0.0, -frame.focal_px, frame.principal_point_px[1]],
        ]
    )
    exterior = None
    if frame.camera_from_object is not None and frame.centre is not None:
        rotation = frame.camera_from_object.T @ FLIP
        exterior = ExteriorOrientation(frame.centre, *angles_from_rotation(rotation))
    return matrix, (frame.tangential[1], -frame.tangential[0]), exterior


def _spatial(turn: Float64[np.ndarray, "2 2"]) -> Rotation:
    """A turn about the viewing axis."""
    whole = np.eye(3)
    whole[:2, :2] = turn
    return whole
