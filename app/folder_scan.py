"""Find the rasters and vector layers of a folder and guess what each of them is."""

import csv
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

import numpy as np
import pyogrio.raw
from pyproj import CRS
from pyproj.exceptions import CRSError
from rasterio.errors import RasterioIOError

from app.block_toml import BATCH_TABLE, FILE, RASTERS
from core.errors import ReferenceDataError, ScanError
from core.formats.vectors import GDAL_ERRORS, check_files, no_remarks
from core.geometry.crs import horizontal
from core.raster.files import open_plain
from core.raster.scan_file import open_scan

Kind = Literal["scan", "ortho", "dem", "other"]
"""What a raster probably is."""
Corners = tuple[tuple[float, float], ...]
"""Places in a CRS, x and y."""
VECTORS = frozenset({".shp", ".gpkg", ".geojson", ".fgb", ".gml", ".tab", ".dxf"})
"""Suffixes of vector files that are looked into."""
TABLES = frozenset({".csv", ".txt", ".points"})
"""Suffixes of lists; what those of the first two hold, their header tells."""
OWN = frozenset({"results", "truth", "session.gpkg", "seams.gpkg", BATCH_TABLE})
"""Names that Gruber itself writes."""
DEPTH = 4
"""How many folders deep to look."""
FEW = 5
"""Rasters of a folder that are looked at to see whether it holds scans."""
SMALLEST_SIDE_PX = 400
"""Scans smaller than this are previews."""
_ORTHO_WORDS = ("orto", "ortho", "ofoto", "dop")
_DEM_WORDS = ("dem", "dtm", "dmr", "dmt", "dgm", "srtm", "terrain", "height")
T = TypeVar("T")
_MILLIMETRES = {"2": 25.4, "3": 10.0}
"""Millimetres of TIFF's units of resolution: inch and centimetre."""


@dataclass(frozen=True, slots=True)
class FoundRaster:
    """A raster file, without its pixels."""

    path: Path
    """The file."""
    size_px: tuple[int, int]
    """Columns and rows."""
    bands: int
    """Number of bands."""
    dtype: np.dtype[Any]
    """Type of a pixel."""
    crs: CRS | None
    """CRS, where the file tells it."""
    placed: bool
    """True with a world file or a georeference of its own."""
    straight: bool
    """True when it is placed and not turned; rows may run to the north."""
    scan_pixel_um: float | None
    """Size of a scan pixel on the film by the resolution the scanner wrote, micrometres."""
    corners: Corners = ()
    """Where its four corners lie, in its CRS; empty where it is not placed."""

    @property
    def kind(self) -> Kind:
        """What it probably is, by CRS, rotation, bands and name."""
        heights = self.bands == 1 and self.dtype.kind in "fi"
        if self.crs is None:
            if self._named(_ORTHO_WORDS) and self.placed:
                return "ortho"
            return "dem" if heights and self.placed else "scan"
        if not self.straight:
            return "scan"
        if heights or (self.bands == 1 and self.dtype == np.uint16 and self._named(_DEM_WORDS)):
            return "dem"
        pictured = self.dtype.kind == "u" or (self.dtype.kind == "f" and self.bands > 2)
        return "ortho" if self.bands <= 4 and pictured else "other"

    @property
    def pixel_m(self) -> float | None:
        """Size of a pixel on the ground, metres; None where its file does not tell it."""
        if self.crs is None or not self.corners:
            return None
        (x, y), _, (right, below), _ = self.corners
        if self.crs.is_geographic:
            geod = self.crs.get_geod()
            assert geod is not None, "degrees without an ellipsoid"
            apart_m = geod.inv(x, y, right, below)[2]
        else:
            apart_m = np.hypot(right - x, below - y) * self.crs.axis_info[0].unit_conversion_factor
        return float(apart_m / np.hypot(*self.size_px))

    @property
    def is_preview(self) -> bool:
        """True for a small copy of a scan."""
        return self.kind == "scan" and min(self.size_px) < SMALLEST_SIDE_PX

    def _named(self, words: tuple[str, ...]) -> bool:
        name = f"{self.path.parent.name}/{self.path.name}".lower()
        return any(word in name for word in words)


@dataclass(frozen=True, slots=True)
class FoundLayer:
    """A vector layer, without its features."""

    path: Path
    """The file."""
    name: str
    """Name of the layer in it."""
    geometry: Literal["line", "polygon", "point", "other"]
    """Kind of its geometries."""
    crs: CRS | None
    """CRS, where the file tells it."""
    fields: tuple[str, ...]
    """Attributes."""
    corners: Corners = ()
    """Corners of the box around its features, in its CRS."""

    def named(self, *words: str) -> bool:
        """True when the file or layer is called by one of the words."""
        name = f"{self.path.stem} {self.name}".lower()
        return any(word in name for word in words)

    def values(self, field: str) -> set[str]:
        """All values of an attribute, as text."""
        with no_remarks():
            found = pyogrio.raw.read(
                self.path, layer=self.name, columns=[field], read_geometry=False
            )
        return {str(value) for value in cast("list[np.ndarray]", found[3])[0]}


@dataclass(frozen=True, slots=True)
class Findings:
    """Everything in a folder that may belong to a block."""

    rasters: tuple[FoundRaster, ...]
    """Rasters by path."""
    layers: tuple[FoundLayer, ...]
    """Vector layers by path."""
    points: tuple[Path, ...]
    """QGIS `.points` files."""
    tables: tuple[tuple[Path, tuple[str, ...]], ...]
    """CSV files with their header."""
    unreadable: tuple[Path, ...]
    """Files with a fitting suffix that could not be opened, or whose pixels cannot be read."""
    unused: tuple[Path, ...] = ()
    """Files of no kind that is known, and that belong to none of the others."""


def find(folder: Path) -> Findings:
    """Look through a folder; what Gruber wrote there, and blocks of their own, are passed over."""
    return look_at(list(_files(folder)))


def folders_of_scans(folder: Path) -> list[str]:
    """Folders in a folder that hold scans; of many rasters the first few tell."""
    found: list[str] = []
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        rasters = (path for path in _files(place) if path.suffix.lower() in RASTERS)
        looked = () if _passed_over(place) else look_at(list(islice(rasters, FEW))).rasters
        if any(raster.kind == "scan" for raster in looked):
            found.append(place.name)
    return found


def look_at(files: list[Path]) -> Findings:
    """Look into files."""
    unreadable: list[Path] = []
    opened = _each(files, RASTERS, _raster, unreadable)
    rasters = [
        raster for raster in opened if raster.kind != "scan" or not why_unreadable(raster.path)
    ]
    unreadable += [raster.path for raster in opened if raster not in rasters]
    layers = _each(files, VECTORS, _layers, unreadable)
    tables = _each(files, TABLES - {".points"}, _header, unreadable=[])
    return Findings(
        tuple(raster for raster in rasters if not raster.is_preview),
        tuple(layer for found in layers for layer in found),
        tuple(path for path in files if path.suffix.lower() == ".points"),
        tuple(tables),
        tuple(unreadable),
        tuple(_unused(files)),
    )


def why_unreadable(path: Path) -> str:
    """Why a scan cannot be read, such as one that was cut off; empty where it can."""
    try:
        stat = path.stat()
    except OSError:
        return _why(path, 0, 0)
    return _why(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4096)
def _why(path: Path, _size: int, _changed_ns: int) -> str:
    """As a file was when it was last written: a form that is typed in asks again and again."""
    try:
        open_scan(path)
    except ScanError as error:
        return error.cause
    return ""


def _unused(files: list[Path]) -> Iterator[Path]:
    """What is neither data nor belongs to a file of data, as `a.tfw` and `a.tif.ovr` to `a.tif`."""
    known = {path for path in files if path.suffix.lower() in RASTERS | VECTORS}
    stems = {(path.parent, path.stem) for path in known}
    for path in files:
        parts = path.name.split(".")
        starts = ((path.parent, ".".join(parts[:end])) for end in range(1, len(parts)))
        if path.name == FILE or path.name.partition("-")[0] in OWN:  # also GeoPackage's own `-wal`
            continue
        if path not in known and path.suffix.lower() not in TABLES and not stems & {*starts}:
            yield path


def with_named(found: Findings, files: Iterable[Path]) -> Findings:
    """What a folder holds, and what `block.toml` names elsewhere."""
    known = {item.path for item in (*found.rasters, *found.layers)}
    more = look_at([path for path in files if path not in known])
    return replace(
        found, rasters=(*found.rasters, *more.rasters), layers=(*found.layers, *more.layers)
    )


def is_plain(name: str) -> bool:
    """True for the name of a file or folder that is one, shows, and can be written anywhere."""
    return (
        0 < len(name.encode()) <= 200
        and not name.startswith(".")
        and not any(letter in '/\\:*?"<>|' or not letter.isprintable() for letter in name)
    )


def _files(folder: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(folder, followlinks=True):
        here = Path(place)
        deep = len(here.relative_to(folder).parts) >= DEPTH
        kept = [] if deep else [name for name in folders if not _passed_over(here / name)]
        folders[:] = sorted(kept)
        yield from (here / name for name in sorted(names) if not _passed_over(here / name))


def _passed_over(place: Path) -> bool:
    return place.name.startswith(".") or place.name in OWN or os.path.isfile(place / FILE)


def _each(
    files: list[Path],
    suffixes: frozenset[str],
    look: Callable[[Path], T],
    unreadable: list[Path],
) -> list[T]:
    """What is found in each file of some suffixes; those that cannot be opened are noted."""
    found: list[T] = []
    for path in files:
        if path.suffix.lower() not in suffixes:
            continue
        try:
            check_files(path)
            with no_remarks():
                found.append(look(path))
        except (
            RasterioIOError,
            *GDAL_ERRORS,
            OSError,
            ReferenceDataError,
        ):
            unreadable.append(path)
    return found


def _raster(path: Path) -> FoundRaster:
    with open_plain(path, {}) as raster:
        transform = raster.transform
        placed = not transform.is_identity or bool(raster.gcps[0])
        turned = max(abs(transform.b), abs(transform.d)) > 1e-6 * abs(transform.a)
        return FoundRaster(
            path,
            (raster.width, raster.height),
            raster.count,
            np.dtype(raster.dtypes[0]),
            _map_part(raster.crs),
            placed,
            placed and not turned and transform.a > 0,
            _scan_pixel_um(raster.tags(), max(raster.width, raster.height)),
            _corners(transform, raster.width, raster.height) if placed else (),
        )


def _corners(transform: Any, width: int, height: int) -> Corners:
    pixels = ((0, 0), (width, 0), (width, height), (0, height))
    places = [transform @ pixel for pixel in pixels]
    return tuple((float(x), float(y)) for x, y in places)


def _scan_pixel_um(tags: dict[str, str], side_px: int) -> float | None:
    """Scan pixel by the resolution tag; None where film of that size does not exist.

    Most programs write 72 or 96 dots per inch when they know nothing.
    """
    unit = _MILLIMETRES.get(tags.get("TIFFTAG_RESOLUTIONUNIT", "")[:1])
    try:
        per_unit = float(tags.get("TIFFTAG_XRESOLUTION", ""))
    except ValueError:
        return None
    if unit is None or per_unit <= 0:
        return None
    pixel_mm = unit / per_unit
    return round(pixel_mm * 1000, 3) if 80 <= side_px * pixel_mm <= 500 else None


def _layers(path: Path) -> list[FoundLayer]:
    layers = cast("list[tuple[str, str | None]]", pyogrio.list_layers(path).tolist())
    return [_layer(path, name) for name, geometry in layers if geometry is not None]


def _layer(path: Path, name: str) -> FoundLayer:
    info = pyogrio.read_info(path, layer=name)
    geometry = str(info["geometry_type"]).lower()
    kinds = {"line": "line", "polygon": "polygon", "point": "point"}
    kind = next((kind for word, kind in kinds.items() if word in geometry), "other")
    fields = tuple(str(field) for field in info["fields"])
    box = [] if info["total_bounds"] is None else [float(value) for value in info["total_bounds"]]
    corners: Corners = ()
    if len(box) == 4 and np.isfinite(box).all():
        west, south, east, north = box
        corners = ((west, north), (east, north), (east, south), (west, south))
    return FoundLayer(path, name, cast("Any", kind), _map_part(info["crs"]), fields, corners)


def _header(path: Path) -> tuple[Path, tuple[str, ...]]:
    """First row of a table."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        first = next(csv.reader([file.readline(2000)]), [])
    return path, tuple(name.strip() for name in first)


def _map_part(crs: Any) -> CRS | None:
    """The map part of a CRS as GDAL tells it."""
    try:
        return horizontal(CRS(crs)) if crs else None
    except CRSError:
        return None
