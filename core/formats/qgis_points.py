"""QGIS georeferencer points (.points), in every variant met (FORMATS 4.5).

`#CRS: ...` may come first; then a header with `mapX,mapY` and `sourceX,sourceY` (or the older
`pixelX,pixelY`), comma or tab between the columns. Source coordinates count from the outer corner
of the first pixel with y upwards, so rows are negative there; a file with positive y is taken to
count downwards. Of a scan that has a georeference itself, they are map units.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from core.arrays import Flags, PixelPoints, locked
from core.errors import ScanError
from core.formats.records import plain_bytes
from core.formats.world_file import read_georeference

HEADER = ("mapX", "mapY", "sourceX", "sourceY", "enable", "dX", "dY", "residual")
COLUMNS = {
    "mapx": "east",
    "mapy": "north",
    "sourcex": "column",
    "sourcey": "row",
    "pixelx": "column",
    "pixely": "row",
    "enable": "enable",
}
NEEDED = ("east", "north", "column", "row")


@dataclass(frozen=True, slots=True, eq=False)
class QgisPoints:
    """Points clicked by hand in a scan and on the map."""

    path: Path
    """The file."""
    crs: str
    """CRS of the map side as written (EPSG code or WKT); empty when not written."""
    plane: Float64[np.ndarray, "n 2"]
    """Easting, northing, in that CRS."""
    pixels: PixelPoints
    """Column, row, outer corner of the first pixel (0, 0)."""
    enabled: Flags
    """False for points switched off in QGIS."""

    def __post_init__(self) -> None:
        for name in ("plane", "pixels"):
            object.__setattr__(self, name, locked(np.reshape(getattr(self, name), (-1, 2))))
        object.__setattr__(self, "enabled", locked(self.enabled, np.bool_))


def find_qgis_points(raster: Path) -> Path | None:
    """The .points file beside a raster: `scan.tif.points` or `scan.points`."""
    candidates = (raster.with_name(raster.name + ".points"), raster.with_suffix(".points"))
    return next((path for path in candidates if path.is_file()), None)


def read_qgis_points(path: Path) -> QgisPoints:
    """Read a .points file.

    Raises:
        ScanError: Missing, without the four coordinate columns, or with words for numbers.
    """
    crs, values = _read(path)
    return _points(path, crs, values)


def read_scan_points(path: Path, scan: Path, size_px: tuple[int, int]) -> QgisPoints:
    """Read the .points file of a scan; what lies outside it as pixels may lie on it as map units.

    Raises:
        ScanError: As for `read_qgis_points`, or a world file that cannot be read.
    """
    crs, values = _read(path)
    source = values[:, 2:4]
    world = None if _is_within(source, size_px) else read_georeference(scan)
    if world is not None:
        matrix = world.object_from_pixel
        pixels = np.linalg.solve(matrix[:, :2], (source - matrix[:, 2]).T).T
        if _is_within(pixels, size_px):
            return QgisPoints(path, crs, values[:, :2], pixels, values[:, 4] != 0)
    return _points(path, crs, values)


def _is_within(places: PixelPoints, size_px: tuple[int, int]) -> bool:
    """Whether most of these can be pixels of a scan, counted downwards or upwards."""
    return not len(places) or bool(np.all(np.abs(np.median(places, axis=0)) <= size_px))


def _read(path: Path) -> tuple[str, np.ndarray]:
    """CRS as written, and (n, 5) east, north, column, row as written, enable."""
    try:
        lines = plain_bytes(path).decode("utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise ScanError(
            path,
            "The points cannot be read ({strerror}).",
            "Check the file.",
            strerror=error.strerror,
        ) from error
    crs = next((line[5:].strip() for line in lines if line.upper().startswith("#CRS:")), "")
    body = [line for line in lines if line.strip() and not line.startswith("#")]
    if not body:
        raise ScanError(path, "It holds no points.", "Save the points again in QGIS.")
    rows = list(csv.reader(body, delimiter="\t" if "\t" in body[0] else ","))
    places, rows = _column_places(path, rows)
    return crs or _crs_of_rows(rows), _numbers(path, rows, places)


def _points(path: Path, crs: str, values: np.ndarray) -> QgisPoints:
    """Points whose sources are pixels."""
    downwards = len(values) > 0 and np.median(values[:, 3]) > 0
    row_down = values[:, 3] if downwards else -values[:, 3]
    return QgisPoints(
        path,
        crs,
        values[:, :2],
        np.column_stack([values[:, 2], row_down]),
        values[:, 4] != 0,
    )


def write_qgis_points(path: Path, points: QgisPoints) -> None:
    """Write the present QGIS form; differences are left nought, QGIS computes them anew."""
    with path.open("w", encoding="utf-8", newline="") as file:
        if points.crs:
            file.write(f"#CRS: {points.crs}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        for plane, pixel, enabled in zip(
            points.plane.tolist(), points.pixels.tolist(), points.enabled, strict=True
        ):
            writer.writerow([*plane, pixel[0], -pixel[1], int(enabled), 0, 0, 0])


def _column_places(path: Path, rows: list[list[str]]) -> tuple[dict[str, int], list[list[str]]]:
    """Where each column is, by the header; the oldest files have none and begin with numbers."""
    header = [COLUMNS.get(word.strip().lower(), "") for word in rows[0]]
    places = {name: header.index(name) for name in (*NEEDED, "enable") if name in header}
    if all(name in places for name in NEEDED):
        return places, rows[1:]
    if _is_number(rows[0][0]) and len(rows[0]) >= 4:
        return {name: i for i, name in enumerate((*NEEDED, "enable")) if i < len(rows[0])}, rows
    missing = [
        name
        for name in ("mapX", "mapY", "sourceX", "sourceY")
        if COLUMNS[name.lower()] not in places
    ]
    raise ScanError(
        path,
        "The column {missing} is missing.",
        "Save the points again in the QGIS georeferencer.",
        missing=", ".join(missing),
    )


def _numbers(path: Path, rows: list[list[str]], places: dict[str, int]) -> np.ndarray:
    """(n, 5) east, north, column, row as written, enable."""
    try:
        values = [
            [float(row[places[name]]) for name in NEEDED]
            + [float(row[places["enable"]]) if "enable" in places else 1.0]
            for row in rows
        ]
        if not np.isfinite(values).all():
            raise ValueError("a number is not finite")
    except (ValueError, IndexError) as error:
        raise ScanError(
            path, "A row is not of numbers: {error}.", "Save the points again in QGIS.", error=error
        ) from error
    return np.array(values, dtype=np.float64).reshape(-1, 5)


def _crs_of_rows(rows: list[list[str]]) -> str:
    """Some development builds wrote the CRS into every row's ninth column."""
    return "".join(rows[0][8:9]).strip() if rows else ""


def _is_number(word: str) -> bool:
    """True for anything float() reads."""
    try:
        float(word)
    except ValueError:
        return False
    return True
