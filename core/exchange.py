"""Convert the adjusted block for exchange with other programs, and exchanged blocks back.

On export, a photo's refraction is put into the camera exactly: K (1 + r^2 / c^2) is a scale and a
radial term. Curvature depends on the ground, so measurements are corrected for it if a format
assumes a flat Earth. A format that holds upright square pixels only gets those of the scan
resampled into the frame of its fiducials (`core.raster.upright`).
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import ObjectPoints, PixelPoints
from core.block import Block, Measurement, Photo, SurveyedPoint
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
)
from core.formats.records import scan_stem
from core.formats.rotations import triple_of
from core.geometry.camera import Camera, additional_set
from core.geometry.collinearity import Atmosphere, film_from_object
from core.said import say

# design: moves no point of a film by a hundredth of a pixel of seven micrometres.
SAME_REFRACTION = 3e-7
"""Photos whose refraction differs by less share one camera."""
# design: far below a thousandth of a pixel at the corner of any scan.
UPRIGHT = 1e-9
"""A scan that is turned and sheared by less than this counts as upright."""


UPRIGHT_SUFFIX = "_upright"
"""Ends the name of a photo whose pixels are those of its scan laid upright."""


@dataclass(frozen=True, slots=True, eq=False)
class UprightFrame:
    """Pixels of a photo laid upright: square, column along x, row against y of the film."""

    size_px: tuple[int, int]
    """Columns and rows."""
    pixel_mm: float
    """Side of a pixel on the film, millimetres."""
    corner_mm: tuple[float, float]
    """Film point of the outer corner of the first pixel, millimetres."""

    def pixel_from_film(self, film: PixelPoints) -> PixelPoints:
        """Columns and rows of film points."""
        return (film - self.corner_mm) / (self.pixel_mm * np.array([1.0, -1.0]))

    def film_from_pixel(self, pixels: PixelPoints) -> PixelPoints:
        """Film points of columns and rows."""
        return pixels * (self.pixel_mm * np.array([1.0, -1.0])) + self.corner_mm


def upright_frame(photo: Photo, camera: Camera) -> UprightFrame | None:
    """The frame a scan is laid upright in; None where the scan is upright as it is."""
    interior = photo.interior
    size = interior.pixel_size_mm
    linear = interior.film_from_pixel_matrix[:, :2] / size
    if not np.any(interior.warp) and np.allclose(linear, np.diag([1.0, -1.0]), atol=UPRIGHT):
        return None
    width, height = camera.frame_mm
    columns, rows = int(np.ceil(width / size)), int(np.ceil(height / size))
    return UprightFrame((columns, rows), size, (-width / 2, height / 2))


def upright_photos(block: Block) -> tuple[str, ...]:
    """Photos whose pixels a format that holds upright ones has otherwise than their scans."""
    return tuple(n for n, p in block.photos.items() if upright_frame(p, block.camera_of(n)))


def is_laid_upright(theirs: str, ours: str) -> bool:
    """Whether a foreign name is that of one of our scans laid upright, whose pixels are others."""
    foreign, own = (scan_stem(name).lower().endswith(UPRIGHT_SUFFIX) for name in (theirs, ours))
    return foreign and not own


def named_upright(block: ExchangeBlock, laid: Collection[str]) -> ExchangeBlock:
    """A block whose photos that were laid upright are called so: their pixels are no scan's.

    Args:
        block: As it goes out.
        laid: The photos whose pixels are those of the scan laid upright.
    """
    names = {name: f"{name}{UPRIGHT_SUFFIX}" if name in laid else name for name in block.photos}
    photos = {
        names[name]: replace(photo, photo_id=names[name], file=f"{names[name]}.tif")
        if name in laid
        else photo
        for name, photo in block.photos.items()
    }
    measured = tuple(replace(m, photo_id=names[m.photo_id]) for m in block.measurements)
    ties = replace(block.ties, photo_ids=tuple(names[name] for name in block.ties.photo_ids))
    return replace(block, photos=photos, measurements=measured, ties=ties)


def fit_to_format(
    block: Block, report: AdjustmentReport | None, form: ExchangeFormat
) -> ExchangeBlock:
    """A block as a format can hold it.

    Args:
        block: The block; photos that are not oriented go without an exterior orientation.
        report: Its adjustment, for standard deviations and tie points; None where there is none.
        form: The format, which says what of the interior orientation it holds.
    """
    groups = {} if form.refracts else _refractions(block)
    cameras: dict[str, ExchangeCamera] = {}
    photos: dict[str, ExchangePhoto] = {}
    for name, photo in block.photos.items():
        camera, bent = block.camera_of(name), groups.get(name, 0.0)
        frame = upright_frame(photo, camera) if form.holds == "upright" else None
        size = photo.size_px if frame is None else frame.size_px
        made = _camera(camera, bent, None if form.holds == "film" else size)
        if cameras.get(made.name, made) != made:
            made = replace(made, name=f"{photo.camera}-{name}")
        cameras[made.name] = made
        plain = _photo(photo, camera, frame, report)
        photos[name] = _with_refraction(plain, bent, made.name)
    out = _Out(block, form.holds == "upright", form.curved)
    return ExchangeBlock(
        block.crs,
        cameras,
        photos,
        {name: _point(one) for name, one in block.surveyed.items() if one.role != "new"},
        out.measurements(),
        out.ties(report),
        _notes(block, form),
    )


def _refractions(block: Block) -> dict[str, float]:
    """K of every photo; the mean of its camera where all photos flew equally high."""
    own = {name: photo.atmosphere.refraction for name, photo in block.photos.items()}
    for camera in block.cameras:
        names = [name for name, photo in block.photos.items() if photo.camera == camera]
        values = [own[name] for name in names]
        if values and max(values) - min(values) < SAME_REFRACTION:
            own |= dict.fromkeys(names, float(np.mean(values)))
    return own


def _camera(camera: Camera, refraction: float, size: tuple[int, int] | None) -> ExchangeCamera:
    """Constants without unit, refraction put in."""
    c = camera.principal_distance_mm
    k1, k2, k3 = camera.radial_distortion
    unit = 1 + refraction
    radial = ((k1 * c**2 + refraction) / unit, k2 * c**4 / unit, k3 * c**6 / unit)
    while radial and radial[-1] == 0.0:
        radial = radial[:-1]
    return ExchangeCamera(
        camera.name,
        radial,
        _tangential(camera, unit),
        size,
        c,
        camera.principal_point_mm,
        camera.frame_mm,
        camera.fiducials_mm,
    )


def _tangential(camera: Camera, unit: float) -> tuple[float, float]:
    """p1, p2 of a camera whose deformation has them; other terms are told in the notes."""
    if not camera.deformation_mm:
        return 0.0, 0.0
    basis = additional_set(("tangential",)).basis.reshape(2, -1)
    found = np.linalg.lstsq(basis.T, np.array(camera.deformation_mm), rcond=None)[0]
    # A parameter is millimetres at the edge: basis (3 xi^2 + eta^2) / 4 against c p (3 x^2 + y^2).
    c, half = camera.principal_distance_mm, camera.half_mm
    p1, p2 = found / 4 * c / half**2 / unit
    return float(p1), float(p2)


def _photo(
    photo: Photo, camera: Camera, frame: UprightFrame | None, report: AdjustmentReport | None
) -> ExchangePhoto:
    """A photo without refraction."""
    c, point = camera.principal_distance_mm, np.array(camera.principal_point_mm)
    if frame is None:
        inverse = np.linalg.inv(photo.interior.film_from_pixel_matrix[:, :2])
        matrix = np.column_stack(
            [inverse * c, inverse @ (point - photo.interior.film_from_pixel_matrix[:, 2])]
        )
    else:
        shift = frame.pixel_from_film(point[None])[0]
        matrix = np.column_stack([np.diag([c, -c]) / frame.pixel_mm, shift])
    sigmas = None if report is None else report.exterior_sigmas.get(photo.photo_id)
    interior = photo.interior
    marks = zip(interior.names, interior.pixels.tolist(), strict=True)
    return ExchangePhoto(
        photo.photo_id,
        photo.scan.name,
        photo.camera,
        matrix,
        photo.exterior if photo.oriented else None,
        None if sigmas is None else triple_of(sigmas.centre_m),
        None if sigmas is None else triple_of(sigmas.angles),
        {} if frame is not None else {name: (column, row) for name, (column, row) in marks},
    )


def _with_refraction(photo: ExchangePhoto, refraction: float, camera: str) -> ExchangePhoto:
    """Everything moved outwards by 1 + K; the rest is in the camera's radial term."""
    assert photo.pixel_from_image is not None
    scale = np.diag([1 + refraction, 1 + refraction, 1.0])
    return replace(photo, camera=camera, pixel_from_image=photo.pixel_from_image @ scale)


def _point(point: SurveyedPoint) -> ExchangePoint:
    """A surveyed point."""
    role = "check" if point.role == "check" else "control"
    return ExchangePoint(point.point_id, triple_of(point.position), triple_of(point.sigma_m), role)


@dataclass(frozen=True, slots=True, eq=False)
class _Out:
    """Places in scans on their way out."""

    block: Block
    upright: bool
    curved: bool

    def moved(self, photo_id: str, pixels: PixelPoints, points: ObjectPoints) -> PixelPoints:
        """Pixels as the format counts them; `points` may be NaN where they are unknown."""
        photo, camera = self.block.photos[photo_id], self.block.camera_of(photo_id)
        film = photo.interior.film_from_pixel(pixels)
        if not self.curved and photo.oriented:
            air = photo.atmosphere
            flat = Atmosphere(air.refraction, 0.0)
            own = film_from_object(points, photo.exterior, camera, flat)
            bent = film_from_object(points, photo.exterior, camera, air)
            film = film + np.nan_to_num(own - bent)
        frame = upright_frame(photo, camera) if self.upright else None
        laid = photo.interior if frame is None else frame
        return laid.pixel_from_film(film)

    def measurements(self) -> tuple[ExchangeMeasurement, ...]:
        """Measurements that are used, or would be were their point no check point."""
        return tuple(
            self.measured(one)
            for one in self.block.measurements.values()
            if one.used and self.block.surveyed[one.point_id].role != "new"
        )

    def measured(self, one: Measurement) -> ExchangeMeasurement:
        """One measurement."""
        position = self.block.surveyed[one.point_id].position
        column, row = self.moved(one.photo_id, one.pixel, position[None])[0].tolist()
        return ExchangeMeasurement(one.point_id, one.photo_id, column, row, one.sigma_px)

    def ties(self, report: AdjustmentReport | None) -> ExchangeTies:
        """Tie points, those without position left out where an adjustment knows it of others."""
        ties = self.block.ties
        if not len(ties.point):
            return ExchangeTies.none()
        unknown = np.full((ties.count, 3), np.nan)
        positions = unknown if report is None else np.array(report.tie_positions)
        stands = np.all(np.isfinite(positions), axis=1)
        kept = stands[ties.point] if stands.any() else np.ones(len(ties.point), bool)
        if report is not None:
            kept[list(report.tie_reasons)] = False
        pixels = np.array(ties.pixels)
        for number, name in enumerate(ties.photo_ids):
            rays = np.flatnonzero((ties.photo == number) & kept)
            pixels[rays] = self.moved(name, pixels[rays], positions[ties.point[rays]])
        names, point = np.unique(ties.point[kept], return_inverse=True)
        return ExchangeTies(
            ties.photo_ids,
            point,
            ties.photo[kept],
            pixels[kept],
            tuple(f"T{name}" for name in names),
            positions[names] if stands.any() else None,
            ties.sigma_px[kept],
        )


def _notes(block: Block, form: ExchangeFormat) -> tuple[str, ...]:
    """What a format cannot hold of this block, in words."""
    notes: list[str] = []
    warped = [name for name, photo in block.photos.items() if np.any(photo.interior.warp)]
    if warped and form.holds in ("film", "frame"):
        notes.append(
            say(
                "The interior orientation of {names} is more than affine; its affine part alone "
                "went out.",
                names=warped,
            )
        )
    deformed = [name for name, camera in block.cameras.items() if _beyond_tangential(camera)]
    if deformed and form.holds != "nothing":
        notes.append(
            say(
                "Additional parameters of {names} are not held by this format and were left out.",
                names=deformed,
            )
        )
    lost = [name for name, photo in block.photos.items() if not photo.oriented]
    if lost:
        notes.append(say("{names}: not oriented, went out without orientation.", names=lost))
    new = [name for name, point in block.surveyed.items() if point.role == "new"]
    if new:
        notes.append(
            say(
                "{names}: no surveyed points, left out; points_from_photos.csv has their "
                "coordinates.",
                names=new,
            )
        )
    return tuple(notes)


def _beyond_tangential(camera: Camera) -> bool:
    """Whether a camera's deformation is more than tangential terms."""
    if not camera.deformation_mm:
        return False
    basis = additional_set(("tangential",)).basis.reshape(2, -1).T
    values = np.array(camera.deformation_mm)
    left = values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
    # design: a tenth of a micrometre at the edge of the frame is no deformation.
    return bool(np.any(np.abs(left) > 1e-4))
