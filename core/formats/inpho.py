"""Inpho's project file (.prj): cameras, photos with orientation and image points, control.

By what public generators of such files write: blocks that begin with `$NAME` and end with `$END`;
image points in millimetres from the principal point, interior orientation of the camera as an
affine transform from millimetres to pixels that count from the centre of the first pixel. The
matrix of `$EXT_ORI` turns object space into image space, row by row. The film variant was not seen.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
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
    ExchangePoint,
)
from core.formats.film_rays import (
    FilmRay,
    block_of_rays,
    film_rays,
    principal_distance_mm,
    refuse_twice,
    untested,
    with_interiors,
    without_sigmas,
)
from core.formats.records import Record, one_word, read_records, write_lines
from core.formats.words import in_words
from core.frames import HALF_PIXEL
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation

ROUND = 1e-6  # design: twelve digits of a matrix leave far less.
"""How far a matrix may be from a rotation."""
CONTROL_CODE, CHECK_CODE = "3", "5"
"""Codes of a point: 3 is control in plan and height; 5 is ours for checks."""


AFTER_CODE = 5  # source: public generators; name, three coordinates and a code come before.
"""Index of the standard deviations of a point in `$CONTROL_POINTS`."""


def write_inpho(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write a project file.

    Returns:
        What was left out.
    """
    block, renamed = in_words(block, scans=False)
    rays, notes = film_rays(block)
    lines = ["$PROJECT 5.0.0", "  $LINEAR_UNITS_OF_OBJECT : m", "  $LINEAR_UNITS_OF_IMAGE : mm"]
    lines += ["  $ANGULAR_UNITS : deg", "  $COORDINATE_SYSTEM :", f"     {block.crs}", "$END"]
    for name, photo in block.photos.items():
        if photo.pixel_from_image is not None and photo.camera in block.cameras:
            lines += _camera_lines(block, photo)
        lines += _photo_lines(block, photo, [ray for ray in rays if ray.photo_id == name])
    lines += ["$CONTROL_POINTS"]
    for point in block.points.values():
        code = CONTROL_CODE if point.role == "control" else CHECK_CODE
        cells = [*map(repr, point.position), code, *map(repr, point.sigma_m or (0, 0, 0))]
        lines.append(" ".join(["  " + point.point_id, *cells]))
    lines += ["$END_POINTS"]
    write_lines(path, lines)
    return (*renamed, *notes, *without_sigmas(block.photos.values()), untested())


def _camera_lines(block: ExchangeBlock, photo: ExchangePhoto) -> Iterator[str]:
    """A camera for every photo, since every scan lies in its own way."""
    assert photo.pixel_from_image is not None
    camera = block.cameras[photo.camera]
    distance = principal_distance_mm(block, photo.photo_id)
    linear = (photo.pixel_from_image[:, :2] / distance).tolist()
    shift = (photo.pixel_from_image[:, 2] - HALF_PIXEL).tolist()
    columns, rows = camera.size_px or (0, 0)
    yield "$CAMERA_DEFINITION"
    yield f"  $ID : {one_word(photo.camera)}-{photo.photo_id}"
    yield f"  $CCD_COLUMNS : {columns}"
    yield f"  $CCD_ROWS : {rows}"
    yield "  $PIXEL_REFERENCE : CenterTopLeft"
    yield "  $CCD_INTERIOR_ORIENTATION :"
    for (a, b), c in zip(linear, shift, strict=True):
        yield f"    {a!r} {b!r} {c!r}"
    yield f"  $FOCAL_LENGTH : {distance!r}"
    yield "  $PRINCIPAL_POINT_PPA : 0.0 0.0"
    yield "$END"


def _photo_lines(
    block: ExchangeBlock, photo: ExchangePhoto, rays: Sequence[FilmRay]
) -> Iterator[str]:
    yield "$PHOTO"
    yield f"  $PHOTO_NUM : {photo.photo_id}"
    yield f"  $PHOTO_FILE : {photo.file}"
    oriented = photo.camera in block.cameras and photo.pixel_from_image is not None
    if oriented:
        yield f"  $CAMERA_ID : {one_word(photo.camera)}-{photo.photo_id}"
    if photo.exterior is not None:
        distance = principal_distance_mm(block, photo.photo_id) if oriented else 0.0
        yield "  $EXT_ORI : "
        yield "    " + " ".join(map(repr, (distance, *photo.exterior.centre.tolist())))
        for row in photo.exterior.object_from_image.T.tolist():
            yield "    " + " ".join(map(repr, row))
    if rays:
        controls = set(block.points)
        yield "  $PHOTO_POINTS :"
        for ray in rays:
            code = "2" if ray.point_id in controls else "1"
            sigma = 0.0 if ray.sigma_mm is None else ray.sigma_mm
            cells = (ray.point_id, repr(ray.x_mm), repr(ray.y_mm), repr(sigma), code)
            yield "    " + " ".join([*cells, "{ * }"])
        yield "  $END_POINTS"
    yield "$END"


def read_inpho(path: Path) -> ExchangeBlock:
    """A project file.

    Raises:
        ProjectError: It is none, was cut off, or holds a camera, photo or point that cannot be.
    """
    records = read_records(path, comment="")
    if not records or not records[0].text(0).startswith("$PROJECT"):
        raise ProjectError(path, "is no project of Inpho.", "Its first line begins with $PROJECT.")
    found = _Project(path)
    at = 0
    while at < len(records):
        at = found.take(records, at)
    return found.block()


class _Project:
    """What was read so far."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.crs = ""
        self.cameras: dict[str, tuple[float, Affine2 | None, tuple[int, int] | None]] = {}
        self.photos: dict[str, tuple[ExchangePhoto, float]] = {}
        self.points: dict[str, ExchangePoint] = {}
        self.rays: list[FilmRay] = []

    def take(self, records: Sequence[Record], at: int) -> int:
        """One block of lines; where the next one begins."""
        head = records[at].text(0)
        if head == "$CONTROL_POINTS":
            return self._control(records, at + 1)
        if head not in ("$PHOTO", "$CAMERA_DEFINITION", "$CAMERA", "$PROJECT"):
            return at + 1
        end = self._end(records, at + 1, "$END")
        inside = records[at + 1 : end]
        if head == "$PHOTO":
            self._photo(records[at], inside)
        elif head != "$PROJECT":
            self._camera(records[at], inside)
        else:
            for one, after in pairwise(inside):
                if one.text(0) == "$COORDINATE_SYSTEM" and not after.text(0).startswith("$"):
                    self.crs = " ".join(after.cells)
        return end + 1

    def _end(self, records: Sequence[Record], at: int, word: str) -> int:
        """Index of the line that ends a block; sets within a camera have ends of their own."""
        depth = 0
        for index in range(at, len(records)):
            head = records[index].text(0)
            if head == "$CALIBRATION_SET":
                depth += 1
            elif head == word:
                if depth == 0:
                    return index
                depth -= 1
        raise ProjectError(
            self.path,
            "line {line}: the block that begins here does not end.",
            "The file was cut off: give all of it.",
            line=records[at - 1].number,
        )

    def _control(self, records: Sequence[Record], at: int) -> int:
        end = self._end(records, at, "$END_POINTS")
        for record in records[at:end]:
            name = record.text(0)
            record.refuse_again(name, self.points)
            sigma = record.triple(AFTER_CODE) if len(record.cells) > AFTER_CODE else (0.0, 0.0, 0.0)
            role = "check" if record.text(4) == CHECK_CODE else "control"
            self.points[name] = ExchangePoint(
                name, record.triple(1), sigma if any(sigma) else None, role
            )
        return end + 1

    def _camera(self, head: Record, inside: Sequence[Record]) -> None:
        values = _values(inside)
        name = values["$ID"].cells[-1] if "$ID" in values else head.text(0)
        if "$FOCAL_LENGTH" not in values:
            raise head.refused(
                "Line {number}: the camera has no $FOCAL_LENGTH.",
                "Give the principal distance in millimetres.",
            )
        distance = values["$FOCAL_LENGTH"].value(len(values["$FOCAL_LENGTH"].cells) - 1)
        affine = None
        for index, record in enumerate(inside):
            if record.text(0) == "$CCD_INTERIOR_ORIENTATION":
                numbers = [one for row in inside[index + 1 : index + 3] for one in _numbers(row)]
                affine = np.array(numbers).reshape(2, 3)
                affine[:, :2] *= distance
                affine[:, 2] += HALF_PIXEL
        size = None
        if "$CCD_COLUMNS" in values and "$CCD_ROWS" in values:
            size = (int(values["$CCD_COLUMNS"].value(2)), int(values["$CCD_ROWS"].value(2)))
        self.cameras[name] = (distance, affine, size)

    def _photo(self, head: Record, inside: Sequence[Record]) -> None:
        values = _values(inside)
        if "$PHOTO_NUM" not in values:
            raise head.refused(
                "Line {number}: the photo has no $PHOTO_NUM.", "Give every photo a name."
            )
        name = values["$PHOTO_NUM"].text(2)
        head.refuse_again(name, self.photos)
        file = " ".join(values["$PHOTO_FILE"].cells[2:]) if "$PHOTO_FILE" in values else ""
        camera = values["$CAMERA_ID"].cells[-1] if "$CAMERA_ID" in values else ""
        exterior, distance, inner = None, 1.0, False
        for index, record in enumerate(inside):
            word = record.text(0)
            if word == "$EXT_ORI":
                exterior, distance = self._exterior(inside[index + 1 : index + 5], record)
            elif word == "$PHOTO_POINTS":
                inner = True
            elif word.startswith("$"):
                inner = False
            elif inner:
                sigma = record.value(3) or None
                self.rays.append(FilmRay(word, name, record.value(1), record.value(2), sigma))
        file = file.replace("\\", "/").rsplit("/", 1)[-1] or f"{name}.tif"
        self.photos[name] = ExchangePhoto(name, file, camera, exterior=exterior), distance

    def _exterior(self, rows: Sequence[Record], head: Record) -> tuple[ExteriorOrientation, float]:
        first, *turn = [_numbers(row, 4 if index == 0 else 3) for index, row in enumerate(rows)]
        matrix = np.array(turn).reshape(-1, 3)
        square = matrix.shape == np.eye(3).shape
        if not square or np.abs(matrix @ matrix.T - np.eye(3)).max() > ROUND:
            raise head.refused(
                "Line {number}: $EXT_ORI holds no rotation.",
                "Focal length and position, then three rows of three numbers.",
            )
        left, _, right = np.linalg.svd(matrix)
        angles = angles_from_rotation((left @ right).T)
        return ExteriorOrientation(np.array(first[1:]), *angles), first[0]

    def block(self) -> ExchangeBlock:
        """All of it: with pixels where every camera says its own, else with micrometres."""
        refuse_twice(self.path, self.rays)
        photos = [photo for photo, _ in self.photos.values()]
        known = [self.cameras.get(photo.camera) for photo in photos]
        if not photos or any(one is None or one[1] is None for one in known):
            every = [
                (photo, self.cameras[photo.camera][0] if photo.camera in self.cameras else c or 1.0)
                for photo, c in self.photos.values()
            ]
            return block_of_rays(every, self.points, self.rays, self.crs)
        return self._with_pixels()

    def _with_pixels(self) -> ExchangeBlock:
        """Measurements in pixels, through the interior orientations of the cameras."""
        every = [(photo, self.cameras[photo.camera][0]) for photo, _ in self.photos.values()]
        given = block_of_rays(every, self.points, self.rays, self.crs)
        cameras: dict[str, ExchangeCamera] = {}
        photos: dict[str, ExchangePhoto] = {}
        for name, (photo, _) in self.photos.items():
            distance, affine, size = self.cameras[photo.camera]
            cameras[photo.camera] = ExchangeCamera(
                photo.camera, size_px=size, principal_distance_mm=distance
            )
            photos[name] = ExchangePhoto(name, photo.file, photo.camera, affine, photo.exterior)
        return with_interiors(given, cameras, photos)


def _values(inside: Sequence[Record]) -> dict[str, Record]:
    """Lines `$KEY : value` by key; the first of each."""
    found: dict[str, Record] = {}
    for record in inside:
        if record.text(0).startswith("$") and len(record.cells) > 2:
            found.setdefault(record.text(0), record)
    return found


def _numbers(record: Record, count: int = 3) -> list[float]:
    return [record.value(index) for index in range(count)]


INPHO_FORMAT = ExchangeFormat(
    name="inpho",
    title="Inpho: project file",
    conventions=Conventions(
        pixels="interior orientation of a camera: column right, row down, centre of the first "
        "pixel; image points in millimetres from the principal point, x right, y up",
        object_space="easting, northing, height, metres; the CRS as text",
        rotation="matrix of `$EXT_ORI`, row by row, turns object space into image space",
        camera="principal distance in millimetres, affine transform from millimetres to pixels, "
        "one camera a photo; distortion and refraction are taken out",
        sigmas="control, metres; measurements, millimetres",
        lost="lens distortion, fiducials, standard deviations of orientations, object points of "
        "ties; blanks in names",
    ),
    holds="film",
    write=write_inpho,
    read=read_inpho,
    default_name="block.prj",
    folder=False,
)
"""Inpho's project file, by what public generators write."""
