"""ArcGIS frames and cameras tables: two CSV files with the columns of Esri's table schemas.

A frame bears its own affine transform, since every scan lies in its own way; what stands in the
frames table comes before the same entry in the cameras table. Film is in micrometres.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.arrays import Affine2
from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
)
from core.formats.film_rays import MICROMETRES, principal_distance_mm, untested
from core.formats.records import Record, read_text
from core.formats.scan_names import scan_stem
from core.geometry.exterior import ExteriorOrientation
from core.said import say

FRAMES, CAMERAS = "frames.csv", "cameras.csv"
AFFINE = ("A0", "A1", "A2", "B0", "B1", "B2")
"""Film (micrometres, fiducial frame) = A0 + A1 column + A2 row; the same with B."""
NEEDED = ("Raster", "CameraID", "PerspectiveX", "PerspectiveY", "PerspectiveZ")
"""Columns that the frames table must have."""
ANGLES = ("Omega", "Phi", "Kappa")
TURN = 360.0  # source: degrees of a whole turn.
REMEDY = "The columns are those of Esri's frames and cameras table schemas."


def write_arcgis(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write both tables into a folder.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    rows: list[list[str]] = []
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
        angles = np.degrees([turned.omega, turned.phi, turned.kappa])
        film = _film_from_pixel(photo.pixel_from_image, distance, camera.principal_point_mm)
        numbers = [*turned.centre.tolist(), *angles.tolist(), *film]
        rows.append([str(len(rows) + 1), photo.file, camera.name, *map(repr, numbers), block.crs])
    head = ["ObjectID", *NEEDED, *ANGLES, *AFFINE, "SRS"]
    _write(path / FRAMES, [head, *rows])
    cameras = [["ObjectID", "CameraID", "FocalLength", "PrincipalX", "PrincipalY"]]
    for name, distance in seen.items():
        point = [value * MICROMETRES for value in block.cameras[name].principal_point_mm]
        numbers = [repr(value) for value in (distance * MICROMETRES, *point)]
        cameras.append([str(len(cameras)), name, *numbers])
    _write(path / CAMERAS, cameras)
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


def _write(path: Path, rows: list[list[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)


def read_arcgis(path: Path) -> ExchangeBlock:
    """A folder with `frames.csv` and `cameras.csv`.

    Raises:
        ProjectError: A table is missing or damaged, or a frame names a camera that is none.
    """
    frames, cameras = _rows(path / FRAMES, NEEDED), _rows(path / CAMERAS, ("CameraID",))
    held: dict[str, tuple[ExchangeCamera, _Row]] = {}
    for row in cameras:
        name = row.text("CameraID")
        point = (row.number("PrincipalX", 0.0), row.number("PrincipalY", 0.0))
        held[name] = (
            ExchangeCamera(
                name,
                principal_distance_mm=row.number("FocalLength") / MICROMETRES,
                principal_point_mm=(point[0] / MICROMETRES, point[1] / MICROMETRES),
            ),
            row,
        )
    photos: dict[str, ExchangePhoto] = {}
    crs = ""
    for row in frames:
        file = row.text("Raster").replace("\\", "/").rsplit("/", 1)[-1]
        name = scan_stem(file)
        if name in photos:
            raise row.refused(
                say("Line {number}: the photo {photo} stands twice.",
                    number=row.line, photo=name), "Leave one row for every photo."
            )  # fmt: skip
        camera = row.text("CameraID")
        if camera not in held:
            raise row.refused(
                say("Line {number}: the camera {camera!r} is unknown.",
                    number=row.line, camera=camera), "Give it a row in cameras.csv."
            )  # fmt: skip
        crs = row.cells.get("SRS", "") or crs
        photos[name] = _photo(name, file, row, *held[camera])
    return ExchangeBlock(crs, {name: one for name, (one, _) in held.items()}, photos)


def _photo(
    name: str, file: str, row: "_Row", camera: ExchangeCamera, of_camera: "_Row"
) -> ExchangePhoto:
    centre = np.array([row.number(f"Perspective{axis}") for axis in "XYZ"])
    written = [row.number(angle) for angle in ANGLES]
    if any(abs(value) > TURN for value in written):
        raise row.refused(
            say("Line {number}: an angle of {value} degrees is more than a whole turn.",
                number=row.line, value=max(written, key=abs)),
            "Omega, Phi, Kappa are in degrees.",
        )  # fmt: skip
    omega, phi, kappa = np.radians(written).tolist()
    source = row if row.cells.get("A0") else of_camera
    affine = None
    if source.cells.get("A0"):
        values = np.array([source.number(key) for key in AFFINE]).reshape(2, 3)
        affine = _pixel_from_image(values, camera)
        if float(source.cells.get("AffineDirection") or 1) < 0:
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


@dataclass(frozen=True, slots=True)
class _Row:
    """One row, by the heads of its table."""

    path: Path
    line: int
    cells: Mapping[str, str]

    def text(self, key: str) -> str:
        """A cell that must hold something."""
        value = self.cells.get(key, "").strip()
        if not value:
            raise self.refused(
                say("Line {number}: the column {column} is empty.", number=self.line, column=key),
                REMEDY,
            )
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """A cell as a number."""
        if default is not None and not self.cells.get(key, "").strip():
            return default
        return Record(self.path, self.line, (self.text(key),)).value(0)

    def refused(self, cause: str, remedy: str) -> ProjectError:
        """An error about this row."""
        return ProjectError(self.path, cause, remedy)


def _rows(path: Path, needed: tuple[str, ...]) -> list[_Row]:
    table = csv.DictReader(read_text(path).splitlines())
    heads = [head.strip() for head in table.fieldnames or ()]
    for name in needed:
        if name not in heads:
            raise ProjectError(path, say("The column {missing} is missing.", missing=name), REMEDY)
    rows = [
        _Row(path, number, {str(k).strip(): v or "" for k, v in row.items() if k is not None})
        for number, row in enumerate(table, 2)
    ]
    if not rows:
        raise ProjectError(path, "The list holds no rows.", REMEDY)
    return rows


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
        sigmas="none",
        lost="lens distortion, points, measurements, ties, fiducials, standard deviations",
        tested="untested on real files",
    ),
    holds="film",
    write=write_arcgis,
    read=read_arcgis,
    default_name="arcgis",
)
"""Esri's tables, by their schemas."""
