"""Read the print in the margins of scans and propose its values; a person has to accept them."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from core.doubts import Failure
from core.errors import ProjectError
from core.geometry.camera import Camera
from core.raster.scan_file import open_scan
from core.scans.film_area import detect_film_area
from core.scans.margin import FieldName, MarginField, fields_of, read_margin
from core.scans.text_reader import REMEDY, TextReader, installed_reader

KEYS: Mapping[FieldName, str] = {
    "date": "scans.taken",
    "altitude": "scans.flying_height_m",
    "scale": "scans.scale_number",
    "distance": "camera.principal_distance_mm",
}
"""Where in `block.toml` a value goes; the other fields are told and go nowhere."""
ALIKE = 0.05
"""Flying heights of one camera's scans differ by less, as a share, where both are read right."""
# design: any lens; only the frame matters where the picture is looked for.
SOME_DISTANCE_MM = 152.0


@dataclass(frozen=True, slots=True)
class ReadScan:
    """What was read beside the picture of one scan."""

    path: Path
    """The scan."""
    fields: tuple[MarginField, ...]
    """What it tells, surest first within each kind."""

    def first(self, name: FieldName) -> str:
        """The surest value of a kind; empty where there is none."""
        return next((field.value for field in self.fields if field.name == name), "")

    def part(self) -> list[dict[str, Any]]:
        """The fields as the start page has them, each with the key that it would fill in."""
        return [
            {
                "name": field.name,
                "value": field.value,
                "text": field.line.text,
                "probability": round(field.line.probability, 2),
                "corners": [[round(x, 1), round(y, 1)] for x, y in field.line.corners],
                "key": KEYS.get(field.name, ""),
            }
            for field in self.fields
        ]


def margin_reader() -> TextReader:
    """What reads print.

    Raises:
        ProjectError: It is not installed.
    """
    reader = installed_reader()
    if isinstance(reader, Failure):
        raise ProjectError(Path("gruber"), reader.reason, REMEDY)
    return reader


def read_scan(
    path: Path, reader: TextReader, frame_mm: Sequence[float] | None, scan_pixel_um: float | None
) -> ReadScan:
    """Read the margins of a scan.

    Args:
        path: The scan.
        reader: What reads print.
        frame_mm: Width and height of the picture, where they are known.
        scan_pixel_um: Size of a scan pixel, where it is known.

    Raises:
        ScanError: The scan cannot be read.
        ProjectError: The networks cannot be run.
    """
    scan, area = open_scan(path), None
    if frame_mm and scan_pixel_um:
        width, height = frame_mm
        camera = Camera("", SOME_DISTANCE_MM, (width, height))
        area = detect_film_area(scan, camera, scan_pixel_um / 1000)
    return ReadScan(path, fields_of(read_margin(scan, reader, area)))


def accepted_values(scans: Sequence[ReadScan]) -> dict[str, Any]:
    """What all scans together say, by key of `block.toml`; nothing on which they differ.

    A principal distance and a scale must be read alike in two scans, where there are two; flying
    heights must lie together. Days may differ: they go to their scans.
    """
    values: dict[str, Any] = {}
    for name in ("distance", "scale"):
        counted = Counter(value for scan in scans if (value := scan.first(name)))
        if counted and (len(scans) == 1 or counted.most_common(1)[0][1] > 1):
            values[KEYS[name]] = float(counted.most_common(1)[0][0])
    heights = [float(value) for scan in scans if (value := scan.first("altitude"))]
    if heights and max(heights) - min(heights) < ALIKE * median(heights):
        values[KEYS["altitude"]] = median(heights)
    days = {scan.path.name: day for scan in scans if (day := scan.first("date"))}
    if len(set(days.values())) == 1 and len(days) == len(scans):
        values[KEYS["date"]] = next(iter(days.values()))
    elif days:
        values["scans.override"] = dict(_by_day(days))
    return values


def _by_day(days: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Scans with their day of exposure, in order of their names."""
    yield from sorted(days.items())
