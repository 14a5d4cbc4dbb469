"""ODM's gcp_list.txt: surveyed points with their measurements (FORMATS 4.6).

Pixels count from the centre of the first pixel, as OpenSfM has them; heights are always numbers.
"""

import re
from pathlib import Path

from core.errors import ExchangeError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
)
from core.formats.frame_interiors import exchange_photo, where_any
from core.formats.records import read_records
from core.formats.xml_files import digits
from core.frames import HALF_PIXEL
from core.geometry.map_in_space import crs_text, map_crs
from core.said import say

UTM = re.compile(r"WGS84\s+UTM\s+(\d{1,2})([NS])", re.IGNORECASE)
"""First line that names a zone."""
NAME = 6  # source: ODM's documentation; after three coordinates, two of the pixel, and the image.
ZONES = {"N": 32600, "S": 32700}  # source: codes of EPSG.


def write_odm(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write the list.

    Returns:
        What was left out, a sentence each.

    Raises:
        CrsError: The CRS is no map in metres.
        ExchangeError: Nothing is measured.
    """
    plane = map_crs(block.crs, path)
    authority = plane.to_authority()
    lines = [":".join(authority) if authority else plane.to_proj4()]
    for one in block.measurements:
        if one.point_id in block.points and one.photo_id in block.photos:
            place = digits(block.points[one.point_id].position)
            pixel = digits([one.column - HALF_PIXEL, one.row - HALF_PIXEL])
            lines.append(
                "\t".join(
                    [*place.split(), *pixel.split(), block.photos[one.photo_id].file, one.point_id]
                )
            )
    if len(lines) == 1:
        raise ExchangeError(
            path, "No surveyed point is measured in any photo.", "Measure some first."
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    seen = {one.point_id for one in block.measurements}
    without = [name for name in block.points if name not in seen]
    notes = where_any(without, say("Measured nowhere, and so left out: {names}.", names=without))
    checks = [name for name, point in block.points.items() if point.role == "check"]
    return notes + where_any(
        checks,
        say("ODM has control points alone; check points went out too: {names}.", names=checks),
    )


def read_odm(path: Path) -> ExchangeBlock:
    """Read a list.

    Raises:
        ProjectError: No text, or lines without numbers.
        ExchangeError: No CRS, no points, one name at two places.
    """
    records = read_records(path)
    if not records:
        raise ExchangeError(path, "It is empty.", "Export the list again.")
    crs = _crs(path, " ".join(records[0].cells))
    points: dict[str, ExchangePoint] = {}
    places: dict[tuple[float, float, float], str] = {}
    photos: dict[str, ExchangePhoto] = {}
    measurements: list[ExchangeMeasurement] = []
    for record in records[1:]:
        place = record.triple(0)
        photo = exchange_photo(record.text(NAME - 1), "", None)
        if photos.setdefault(photo.photo_id, photo).file != photo.file:
            raise record.refused(
                "{name} would be two scans.", "Rename one of the two scans.", name=photo.photo_id
            )
        unnamed = places.get(place, str(len(places) + 1))
        name = record.cells[NAME] if len(record.cells) > NAME else unnamed
        places.setdefault(place, name)
        if points.setdefault(name, ExchangePoint(name, place)).position != place:
            raise record.refused(
                "Line {number}: {name} has two places.",
                "Rename one of the two, or take it away.",
                name=name,
            )
        column, row = record.value(3) + HALF_PIXEL, record.value(4) + HALF_PIXEL
        measurements.append(ExchangeMeasurement(name, photo.photo_id, column, row))
    if not points:
        raise ExchangeError(path, "It holds no points.", "Export the list again.")
    return ExchangeBlock(crs, {}, photos, points, tuple(measurements))


def _crs(path: Path, text: str) -> str:
    """CRS of the first line: UTM in words, a code, or PROJ's parameters."""
    zone = UTM.fullmatch(text.strip())
    if zone is not None:
        text = f"EPSG:{ZONES[zone[2].upper()] + int(zone[1])}"
    return crs_text(map_crs(text, path))


ODM = ExchangeFormat(
    name="odm",
    title="ODM gcp_list.txt",
    conventions=Conventions(
        pixels="column right, row down, from the centre of the first pixel",
        object_space="easting, northing, height in the CRS of the first line, metres",
        lost="orientations, cameras, tie points, roles, standard deviations, points that are "
        "measured nowhere",
        tested="a list written for ODM; its pixels are whole, so the half pixel rests on the "
        "description",
    ),
    holds="upright",
    write=write_odm,
    read=read_odm,
    default_name="gcp_list.txt",
    folder=False,
)
"""ODM's list of control points."""
