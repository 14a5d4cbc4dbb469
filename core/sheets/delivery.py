"""What was delivered: one entry for each file, an index map, check sums, and STAC items."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon, mapping

from core.doubts import Failure
from core.formats.stac import EXTENSIONS, FILM, ROOT, VERSION, day_span, time_span, write_catalog
from core.formats.vectors import write_polygons
from core.geometry.map_in_space import map_crs, map_in_space
from core.sheets.cutting import Form

INDEX = "index.gpkg"
"""The index map, in the folder of the delivery."""
CHECK_SUMS = "sha256.txt"
"""Check sums of all files, as `sha256sum -c` reads them."""
STAC = "stac"
"""Folder of the STAC items."""
LAYER = "sheets"
"""Layer of the index map."""
READ_BYTES = 1 << 22  # design: four megabytes at a time.
MEDIA: Mapping[Form, str] = {
    "geotiff": "image/tiff; application=geotiff",
    "cog": "image/tiff; application=geotiff; profile=cloud-optimized",
    "jp2": "image/jp2",
    "jp2-lossy": "image/jp2",
}
"""Media types as STAC names them."""
SHA256_MULTIHASH = "1220"  # source: multihash: function 0x12, length 0x20.


@dataclass(frozen=True, slots=True, eq=False)
class SheetFile:
    """One file of a delivery."""

    name: str
    """Name of the sheet, as the index has it."""
    file: str
    """Path from the folder of the delivery."""
    form: Form
    """Format."""
    crs: str
    """Its CRS."""
    area: Polygon | MultiPolygon
    """What the sheet shows, in the block's CRS."""
    photos: tuple[str, ...]
    """Photos that it shows."""
    dates: tuple[str, ...]
    """Days, months or years of their exposure, as far as known, earliest first."""
    covered_share: float
    """Share of the sheet that shows the ground, 0 to 1."""
    size_px: tuple[int, int]
    """Columns and rows."""
    transform: tuple[float, ...]
    """Coordinates from (column, row), a, b, c, d, e, f; outer corner of the first pixel (0, 0)."""
    sha256: str
    """Check sum of the file."""
    size_bytes: int
    """Its size."""
    companions: tuple[str, ...]
    """Files beside it that belong to it: world file, mask, statistics."""

    @property
    def every_file(self) -> tuple[str, ...]:
        """The file and what belongs to it."""
        return (self.file, *self.companions)


@dataclass(frozen=True, slots=True, eq=False)
class Delivery:
    """The sheets of a block on disk."""

    files: tuple[SheetFile, ...]
    """Every file, by sheet."""
    outside: int
    """Sheets of the index that the mosaic shows nothing of."""
    made: int = 0
    """Files that were made now; the others were fresh."""
    mosaic: str = ""
    """Version of the mosaic that was cut."""

    @property
    def sheets(self) -> tuple[str, ...]:
        """Names of the sheets."""
        return tuple(dict.fromkeys(file.name for file in self.files))


def sheet_figures(files: Sequence[SheetFile]) -> list[dict[str, Any]]:
    """What a report tells of each file."""
    return [
        {
            "name": one.name,
            "file": one.file,
            "format": one.form,
            "crs": one.crs,
            "photos": list(one.photos),
            "dates": list(one.dates),
            "covered_share": one.covered_share,
            "bytes": one.size_bytes,
            "sha256": one.sha256,
        }
        for one in files
    ]


def check_sum(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    total = sha256()
    with path.open("rb") as file:
        while piece := file.read(READ_BYTES):
            total.update(piece)
    return total.hexdigest()


def write_index(path: Path, files: Sequence[SheetFile], crs: str) -> None:
    """The index map: a polygon for every file, in the block's CRS.

    Raises:
        OSError: The disk is full.
    """
    fields: dict[str, list[Any]] = {
        "name": [one.name for one in files],
        "file": [one.file for one in files],
        "format": [one.form for one in files],
        "crs": [one.crs for one in files],
        "photos": [", ".join(one.photos) for one in files],
        "dates": [", ".join(one.dates) for one in files],
        "covered": [one.covered_share for one in files],
        "columns": [one.size_px[0] for one in files],
        "rows": [one.size_px[1] for one in files],
        "bytes": [one.size_bytes for one in files],
        "sha256": [one.sha256 for one in files],
    }
    numbers = {"covered": np.float64, "columns": np.int64, "rows": np.int64, "bytes": np.int64}
    columns = {
        name: np.array(values, dtype=numbers.get(name, object)) for name, values in fields.items()
    }
    write_polygons(path, LAYER, [one.area for one in files], columns, crs=crs)


def write_check_sums(path: Path, folder: Path, files: Sequence[SheetFile]) -> None:
    """Check sums of everything in a delivery but the list itself."""
    sums = {one.file: one.sha256 for one in files}
    others = [name for one in files for name in one.companions]
    others += [INDEX, *(f"{STAC}/{item.name}" for item in (folder / STAC).glob("*.json"))]
    sums |= {name: check_sum(folder / name) for name in others}
    lines = [f"{sums[name]}  {name}\n" for name in sorted(sums)]
    path.write_text("".join(lines), encoding="utf-8")


def write_items(path: Path, files: Sequence[SheetFile], crs: str) -> None:
    """A STAC item for every sheet, its files as assets, and a catalogue of them."""
    near = shapely.get_coordinates([one.area for one in files])
    earth = map_in_space(map_crs(crs, path), near=near)
    of_sheet: dict[str, list[SheetFile]] = {}
    for one in files:
        of_sheet.setdefault(one.name, []).append(one)

    def degrees(points: np.ndarray) -> np.ndarray:
        return earth.degrees(np.column_stack([points, np.zeros(len(points))]))[:, :2]

    items: list[dict[str, Any]] = []
    for several in of_sheet.values():
        first = several[0]
        ground = shapely.transform(first.area, degrees)
        items.append(
            {
                "type": "Feature",
                "stac_version": VERSION,
                "stac_extensions": [EXTENSIONS["proj"], EXTENSIONS["file"]],
                "id": Path(first.file).stem,
                "geometry": mapping(ground),
                "bbox": list(ground.bounds),
                "properties": {
                    "title": first.name,
                    **_time(first.dates),
                    "gruber:photos": list(first.photos),
                    "gruber:covered_share": first.covered_share,
                },
                "links": [ROOT],
                "assets": {_asset_name(one): _asset(one) for one in several},
            }
        )
    write_catalog(path, "Map sheets of a mosaic of archival aerial photos", items)


def _time(dates: Sequence[str]) -> dict[str, Any]:
    """From the first to the last day of exposure; the time of film where no date is known."""
    spans = [span for span in map(time_span, dates) if not isinstance(span, Failure)]
    spans = spans or [FILM]
    return day_span(min(first for first, _ in spans), max(last for _, last in spans))


def _asset_name(one: SheetFile) -> str:
    folder = Path(one.file).parent.as_posix()
    return one.form if folder == "." else f"{folder}-{one.form}"


def _asset(one: SheetFile) -> dict[str, Any]:
    columns, rows = one.size_px
    fields = {
        "href": f"../{one.file}",
        "type": MEDIA[one.form],
        "roles": ["data"],
        "proj:shape": [rows, columns],
        "proj:transform": list(one.transform),
        "file:size": one.size_bytes,
        "file:checksum": SHA256_MULTIHASH + one.sha256,
    }
    # Only a code of an authority may stand there.
    return fields | ({"proj:code": one.crs.upper()} if ":" in one.crs[:12] else {})
