"""ArcGIS frames and cameras tables: two CSV files with the columns of Esri's table schemas.

Each frame has its own affine transform, because every scan lies differently; a value in the frames
table overrides the same one in the cameras table. Film is in micrometres.
"""

from pathlib import Path

import numpy as np

from core.arrays import Affine2
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
)
from core.formats.film_rays import MICROMETRES, principal_distance_mm, untested
from core.formats.records import Row, read_rows, scan_stem, write_rows
from core.geometry.exterior import ExteriorOrientation
from core.said import say

FRAMES, CAMERAS = "frames.csv", "cameras.csv"
AFFINE = ("A0", "A1", "A2", "B0", "B1", "B2")
"""Film (micrometres, fiducial frame) = A0 + A1 column + A2 row; the same with B."""
NEEDED = ("Raster", "CameraID", "PerspectiveX", "PerspectiveY", "PerspectiveZ")
"""Columns that the frames table must have."""
ANGLES = ("Omega", "Phi", "Kappa")
TURN = 360.0  # source: degrees of a whole turn.


def write_arcgis(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write both tables into a folder.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    rows: list[list[object]] = []
    seen: dict[str, float] = {}
    missing: list[str] = []
    for name, photo in block.photos.items():
        camera = block.cameras.get(photo.camera)
        if photo.exterior is None or photo.pixel_from_image is None or camera is None:
            missing.append(name)
            continue
        distance = principal_distance_mm(block, name)
        seen.setdefault(camera.name, distance)
        turned = photo.exterior
        angles = np.degrees(turned.angles)
        film = _film_from_pixel(photo.pixel_from_image, distance, camera.principal_point_mm)
        numbers = [*turned.centre.tolist(), *angles.tolist(), *film]
        rows.append([len(rows) + 1, photo.file, camera.name, *numbers, block.crs])
    head = ["ObjectID", *NEEDED, *ANGLES, *AFFINE, "SRS"]
    write_rows(path / FRAMES, [head, *rows])
    cameras: list[list[object]] = [
        ["ObjectID", "CameraID", "FocalLength", "PrincipalX", "PrincipalY"]
    ]
    for name, distance in seen.items():
        point = [value * MICROMETRES for value in block.cameras[name].principal_point_mm]
        cameras.append([len(cameras), name, distance * MICROMETRES, *point])
    write_rows(path / CAMERAS, cameras)
    return (*_lost(block, missing), untested())


def _lost(block: ExchangeBlock, missing: list[str]) -> list[str]:
    notes: list[str] = []
    if missing:
        notes.append(
            say("{count:# photo has|# photos have} no orientation: left out.", count=len(missing))
        )
    bent = [c.name for c in block.cameras.values() if any(c.radial) or any(c.tangential)]
    notes += [say("The lens distortion of {camera} is left out.", camera=name) for name in bent]
    if block.points or block.measurements or len(block.ties.point):
        notes.append(say("The tables hold no points and no measurements."))
    return notes


def _film_from_pixel(
    affine: Affine2, distance: float, principal: tuple[float, float]
) -> list[float]:
    """A0, A1, A2, B0, B1, B2: micrometres in the fiducial frame."""
    linear = np.linalg.inv(affine[:, :2]) * distance * MICROMETRES
    shift = np.array(principal) * MICROMETRES - linear @ affine[:, 2]
    return [
        float(value)
        for row, constant in zip(linear, shift, strict=True)
        for value in (constant, *row)
    ]


def read_arcgis(path: Path) -> ExchangeBlock:
    """A folder with `frames.csv` and `cameras.csv`.

    Raises:
        ProjectError: A table is missing or damaged, or a frame names a camera that is none.
    """
    frames, cameras = read_rows(path / FRAMES, NEEDED), read_rows(path / CAMERAS, ("CameraID",))
    held: dict[str, tuple[ExchangeCamera, Row]] = {}
    for row in cameras:
        name = row.filled("CameraID")
        keys = ("PrincipalX", "PrincipalY")
        x, y = (row.number_in(key) if row.cell(key) else 0.0 for key in keys)
        held[name] = (
            ExchangeCamera(
                name,
                principal_distance_mm=row.number_in("FocalLength") / MICROMETRES,
                principal_point_mm=(x / MICROMETRES, y / MICROMETRES),
            ),
            row,
        )
    photos: dict[str, ExchangePhoto] = {}
    crs = ""
    for row in frames:
        file = row.filled("Raster").replace("\\", "/").rsplit("/", 1)[-1]
        name = scan_stem(file)
        row.refuse_again(name, photos)
        camera = row.filled("CameraID")
        if camera not in held:
            raise row.refused(
                "Line {number}: the camera {camera!r} is unknown.",
                "Give it a row in cameras.csv.",
                camera=camera,
            )
        crs = row.cell("SRS") or crs
        photos[name] = _photo(name, file, row, *held[camera])
    return ExchangeBlock(crs, {name: one for name, (one, _) in held.items()}, photos)


def _photo(name: str, file: str, row: Row, camera: ExchangeCamera, of_camera: Row) -> ExchangePhoto:
    centre = np.array(row.triple_in(NEEDED[2:]))
    written = row.triple_in(ANGLES)
    if any(abs(value) > TURN for value in written):
        raise row.refused(
            "Line {number}: an angle of {value} degrees is more than a whole turn.",
            "Omega, Phi, Kappa are in degrees.",
            value=max(written, key=abs),
        )
    omega, phi, kappa = np.radians(written).tolist()
    source = row if row.cell("A0") else of_camera
    affine = None
    if source.cell("A0"):
        values = np.array([source.number_in(key) for key in AFFINE]).reshape(2, 3)
        affine = _pixel_from_image(values, camera)
        if float(source.cell("AffineDirection") or 1) < 0:
            raise row.refused(
                "AffineDirection turns from film to image.",
                "Give the transform from image to film (AffineDirection 1).",
            )
    return ExchangePhoto(
        name, file, camera.name, affine, ExteriorOrientation(centre, omega, phi, kappa)
    )


def _pixel_from_image(values: Affine2, camera: ExchangeCamera) -> Affine2:
    """pixel_from_image from A0, A1, A2 and B0, B1, B2."""
    assert camera.principal_distance_mm is not None
    inverse = np.linalg.inv(values[:, 1:])
    point = np.array(camera.principal_point_mm) * MICROMETRES
    linear = inverse * camera.principal_distance_mm * MICROMETRES
    return np.column_stack([linear, inverse @ (point - values[:, 0])])


ARCGIS_FORMAT = ExchangeFormat(
    name="arcgis",
    title="ArcGIS: frames and cameras tables",
    conventions=Conventions(
        pixels="column right, row down, taken from the outer corner of the first pixel (the "
        "description does not say)",
        object_space="easting, northing, height, metres; the CRS in the column SRS",
        rotation="Omega, Phi, Kappa, degrees: R = R_x R_y R_z turns image space into object space",
        camera="focal length and principal point in micrometres; A0 to B2 from pixels to "
        "micrometres in the fiducial frame, for every frame; no distortion",
        lost="lens distortion, points, measurements, ties, fiducials, standard deviations",
    ),
    holds="film",
    write=write_arcgis,
    read=read_arcgis,
    default_name="arcgis",
)
"""Esri's tables, by their schemas."""
