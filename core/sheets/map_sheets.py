"""Map sheets to cut: a name and an area each, in the block's CRS.

They come from the user's index layer, or from the rule by which the sheets of the Czechoslovak
State Map 1:5000 (SM5) are numbered.

A sheet of the map 1:50 000 (SM50) measures 25 km by 20 km and has its corners on multiples of these
in S-JTSK. It holds ten columns, counted from its EAST edge, and ten layers, counted from its NORTH
edge: HUST25 is column 2, layer 5 of the sheet whose four letters are HUST (METHODS 10).
Coordinates are those of EPSG:5514, both negative. The rule knows no letters: they come with the
north-east corner of a sheet, from the table here or from the user.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS
from shapely.geometry import MultiPolygon, Polygon, box

from core.errors import CrsError, ReferenceDataError
from core.formats.vectors import VectorLayer, read_layers
from core.geometry.areas import only_areas
from core.geometry.crs import (
    KROVAK,
    Bounds,
    Operation,
    check_range,
    operation_between,
    parse_crs,
    same_coordinates,
    short_name,
)

NAME = "name"
"""Attribute of the index that holds the name of a sheet."""
SHOWN_NAMES = 5  # design: as many as a line holds.
"""Names that a message lists."""


@dataclass(frozen=True, slots=True, eq=False)
class MapSheet:
    """One sheet of a map."""

    name: str
    """As the index has it."""
    area: Polygon | MultiPolygon
    """What it shows, in the block's CRS, metres."""


S_JTSK = f"EPSG:{KROVAK}"
"""CRS of the rule."""
# source: METHODS 10, from the two signalled points of the technical report of the orthophoto.
SM50_M = (25_000.0, 20_000.0)
"""Width and height of a sheet of the map 1:50 000, metres."""
SM5_M = (2_500.0, 2_000.0)  # source: the technical report of the orthophoto of Czechia, 2.5 x 2 km.
"""Width and height of a sheet of the map 1:5000, metres."""
PER_SIDE = 10  # source: SM50_M over SM5_M.
"""Columns, and layers, of a sheet of the map 1:50 000."""
Corner = tuple[float, float]
"""Easting and northing of the north-east corner of a sheet of the map 1:50 000, EPSG:5514."""
SM50_CORNERS: Mapping[str, Corner] = {
    "OSTR": (-450_000.0, -1_100_000.0),  # source: the agency's index, thirteen sheets compared.
    "BOHU": (-450_000.0, -1_080_000.0),  # source: as above.
    "CTES": (-425_000.0, -1_100_000.0),  # source: as above.
    "DMAR": (-425_000.0, -1_080_000.0),  # source: as above.
    "VBRO": (-750_000.0, -1_200_000.0),  # source: sheets of orthophotos delivered by the agency.
    "KRAV": (-725_000.0, -1_020_000.0),  # source: as above.
    "HUST": (-575_000.0, -1_180_000.0),  # source: METHODS 10, a signalled point of the report.
}
"""Corners of the sheets whose letters are known."""
LETTERS = re.compile(r"[A-Z]{4}")
NOT_IN_FILES = re.compile(r"[^\w.-]+")
"""What names of files do without, on any disk."""
ROUNDING_M = 1e-6  # design: metres of a million in double precision.
"""A place nearer than this to an edge lies on it."""


def read_sheet_index(path: Path, crs: str) -> tuple[MapSheet, ...]:
    """The sheets of an index layer, brought into the block's CRS, in the order of their names.

    Args:
        path: Any vector file that GDAL reads; one of its layers by `|layername=`.
        crs: The block's CRS.

    Raises:
        ReferenceDataError: It cannot be read, has no polygons, or names are missing or stand twice.
        CrsError: It lies in a CRS that PROJ cannot bring to the block's.
    """
    layers = read_layers(path, parse_crs(crs, "block.toml [block] crs"))
    layer = _index_layer(path, [one for one in layers if len(one.geometries)])
    sheets: list[MapSheet] = []
    nameless = 0
    for area, given in zip(layer.geometries, layer.columns[NAME], strict=True):
        name = "" if given is None or given != given else str(given).strip()
        nameless += not name
        sheets.append(MapSheet(name, only_areas(shapely.make_valid(area))))
    if nameless:
        raise ReferenceDataError(
            path,
            "{nameless} of its {count} sheets have no `name`.",
            "Fill in the attribute: files of sheets are named by it.",
            nameless=nameless,
            count=len(sheets),
        )
    refuse_twins(path, [sheet.name for sheet in sheets])
    return tuple(sorted(sheets, key=lambda sheet: sheet.name))


def _index_layer(path: Path, layers: list[VectorLayer]) -> VectorLayer:
    """The one layer of polygons with names."""
    areal = [one for one in layers if (shapely.get_dimensions(one.geometries) == 2).all()]
    if not areal:
        raise ReferenceDataError(
            path, "it has no layer of polygons.", "Give the areas of the map sheets as polygons."
        )
    named = [one for one in areal if NAME in one.columns]
    if not named:
        raise ReferenceDataError(
            path,
            "it has no attribute `name`, only {names}.",
            "Rename the attribute that holds the names of the sheets to `name`.",
            names=list(areal[0].columns) or "none",
        )
    if len(named) > 1:
        raise ReferenceDataError(
            path,
            "{count} of its layers may be the index: {names}.",
            "Name the one that is meant: FILE|layername=LAYER.",
            count=len(named),
            names=[one.name for one in named],
        )
    return named[0]


def file_stem(name: str) -> str:
    """A name as files bear it: without accents, other scripts as they are, no blank or stroke."""
    plain = "".join(
        unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode() or sign
        for sign in unicodedata.normalize("NFC", name)
    )
    return NOT_IN_FILES.sub("_", plain).strip("._") or "sheet"


def refuse_twins(path: Path, names: Sequence[str]) -> None:
    """Raise where two sheets would have one file, letters of either case being one to a disk.

    Raises:
        ReferenceDataError: Names are one as names of files.
    """
    stems = [file_stem(name).casefold() for name in names]
    counts = Counter(stems)
    twins = [name for name, stem in zip(names, stems, strict=True) if counts[stem] > 1]
    if twins:
        raise ReferenceDataError(
            path,
            "sheets would have the same file, because their names are alike: {names}.",
            "Give every sheet a name of its own, or join its parts into one polygon.",
            names=sorted(twins)[:SHOWN_NAMES],
        )


def corner_of(east: float, north: float) -> Corner:
    """North-east corner of the SM50 sheet over a place; on an edge, the sheet west or south."""
    width, height = SM50_M
    return (
        float(np.ceil((east - ROUNDING_M) / width) * width),
        float(np.ceil((north - ROUNDING_M) / height) * height),
    )


def state_map_name(east: float, north: float, corners: Mapping[str, Corner]) -> str | None:
    """Name of the SM5 sheet over a place, such as `HUST25`; None where its letters are unknown."""
    corner = corner_of(east, north)
    letters = next((name for name, known in corners.items() if known == corner), None)
    if letters is None:
        return None
    column = int((corner[0] - east + ROUNDING_M) // SM5_M[0])
    layer = int((corner[1] - north + ROUNDING_M) // SM5_M[1])
    return f"{letters}{column}{layer}"


def state_map_bounds(name: str, corners: Mapping[str, Corner]) -> Bounds:
    """West, south, east, north of an SM5 sheet whose letters are known, metres in EPSG:5514."""
    east, north = corners[name[:-2]]
    column, layer = int(name[-2]), int(name[-1])
    width, height = SM5_M
    return (
        east - width * (column + 1),
        north - height * (layer + 1),
        east - width * column,
        north - height * layer,
    )


def check_corners(corners: Mapping[str, Corner], where: str | Path) -> None:
    """Make sure that corners a user gives may be corners of SM50 sheets.

    Raises:
        ReferenceDataError: Letters or coordinates cannot be.
    """
    for letters, corner in corners.items():
        if not LETTERS.fullmatch(letters):
            raise ReferenceDataError(
                where,
                "{letters!r} is no code of a sheet 1:50 000.",
                "Write its four capital letters, such as HUST.",
                letters=letters,
            )
        if corner_of(*corner) != corner or max(corner) >= 0:
            raise ReferenceDataError(
                where,
                "{letters} cannot have its north-east corner at {corner}.",
                "Give multiples of 25 km and 20 km as EPSG:5514 counts them, both negative: "
                "HUST = [-575000, -1180000].",
                letters=letters,
                corner=f"[{corner[0]:.12g}, {corner[1]:.12g}]",
            )


def state_map_sheets(
    shown: Polygon | MultiPolygon, crs: str, given: Mapping[str, Corner], where: str | Path
) -> tuple[MapSheet, ...]:
    """The SM5 sheets over what is shown, in the block's CRS, in the order of their names.

    Args:
        shown: Ground that the mosaic shows, in the block's CRS.
        crs: The block's CRS.
        given: Corners by their letters, beside those that are known.
        where: File and key of them, for the message.

    Raises:
        ReferenceDataError: The letters of a sheet are not known.
        CrsError: The block does not lie in Czechia or Slovakia.
    """
    sheets, unknown = _sheets_over(shown, crs, given, where)
    if unknown:
        raise _unknown_letters(unknown[0], where)
    return sheets


def unknown_corners(
    ground: Polygon | MultiPolygon, crs: str, given: Mapping[str, Corner], where: str | Path
) -> tuple[Corner, ...]:
    """Corners of the SM50 sheets over ground that may be shown whose letters are not known.

    Raises:
        ReferenceDataError: Those of no sheet are known.
        CrsError: The ground does not lie in Czechia or Slovakia.
    """
    sheets, unknown = _sheets_over(ground, crs, given, where)
    if unknown and not sheets:
        raise _unknown_letters(unknown[0], where)
    return unknown


def _sheets_over(
    ground: Polygon | MultiPolygon, crs: str, given: Mapping[str, Corner], where: str | Path
) -> tuple[tuple[MapSheet, ...], tuple[Corner, ...]]:
    """The SM5 sheets over ground in the block's CRS, and corners whose letters nobody knows."""
    check_corners(given, where)
    corners = {**SM50_CORNERS, **given}
    to_block = _to_block(ground, crs, where)
    if to_block is not None:
        ground = shapely.transform(ground, to_block.backward)
    sheets: dict[str, MapSheet] = {}
    unknown: dict[Corner, None] = {}
    for cell in _cells(ground.bounds):
        area = box(*cell)
        if not shapely.relate_pattern(area, ground, "T********"):
            continue
        east, north = (cell[0] + cell[2]) / 2, (cell[1] + cell[3]) / 2
        name = state_map_name(east, north, corners)
        if name is None:
            unknown[corner_of(east, north)] = None
            continue
        # Neighbours share their corners: drawn straight between them, they still meet.
        moved = area if to_block is None else shapely.transform(area, to_block.forward)
        sheets[name] = MapSheet(name, moved)
    return tuple(sheets[name] for name in sorted(sheets)), tuple(unknown)


def corner_line(corner: Corner) -> str:
    """How `[sheets]` names the letters of a corner."""
    return f"sm50 = {{ ABCD = [{corner[0]:.0f}, {corner[1]:.0f}] }}"


def _unknown_letters(corner: Corner, where: str | Path) -> ReferenceDataError:
    return ReferenceDataError(
        where,
        "nobody knows the four letters of the sheet 1:50 000 with its north-east corner at "
        "{corner} (EPSG:5514).",
        "Give them in [sheets], {line}, or an index layer, [ortho] sheets.",
        corner=f"[{corner[0]:.0f}, {corner[1]:.0f}]",
        line=corner_line(corner),
    )


def _cells(bounds: Bounds) -> Iterator[Bounds]:
    """SM5 sheets that bounds touch, from the north-west."""
    width, height = SM5_M
    west, south = np.floor(bounds[0] / width), np.floor(bounds[1] / height)
    east, north = np.ceil(bounds[2] / width), np.ceil(bounds[3] / height)
    for row in np.arange(north, south, -1.0):
        for column in np.arange(west, east):
            yield (
                float(column * width),
                float((row - 1) * height),
                float((column + 1) * width),
                float(row * height),
            )


def _to_block(shown: Polygon | MultiPolygon, crs: str, where: str | Path) -> Operation | None:
    """The operation from S-JTSK to the block's CRS; None where they agree."""
    block, own = parse_crs(crs, where), CRS(S_JTSK)
    places = shapely.get_coordinates(shown)
    if same_coordinates(own.to_wkt(), block.to_wkt(), places):
        return None
    try:
        there = operation_between(block.to_wkt(), own.to_wkt(), places, where).forward(places)
        check_range(own, there, where)
        return operation_between(own.to_wkt(), block.to_wkt(), there, where)
    except CrsError as error:
        raise CrsError(
            where,
            "the State Map is one of Czechia and Slovakia, and PROJ takes no place of this block "
            "there from {crs}.",
            "Give an index layer instead: [ortho] sheets.",
            crs=short_name(block),
        ) from error
