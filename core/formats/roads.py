"""Roads of any vector format: centre lines with what their attributes say of class and level."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int64

from core.arrays import locked
from core.doubts import Doubt
from core.formats.vectors import VectorLayer, read_layers
from core.geometry.crs import Bounds, parse_crs
from core.said import say

KIND_COLUMNS = (
    "typ_sil_k",
    "typ_cesty_k",
    "typ_cesty",
    "typsil",
    "typ",
    "highway",
    "fclass",
    "class",
    "objtype",
    "type",
    "kind",
)
"""Columns that tell the class of a road, in the order they are looked for (ZABAGED, OSM)."""
NAME_COLUMNS = ("name", "nazev", "jmeno", "ref", "cislo")
WIDTH_COLUMNS = ("width", "sirka", "est_width", "width_m")
LEVEL_COLUMNS = ("layer", "level", "uroven", "z_order_level")
YES = ("yes", "y", "true", "t", "1", "ano", "viaduct", "aqueduct", "covered", "culvert")


@dataclass(frozen=True, slots=True, eq=False)
class Roads:
    """Centre lines in the block's CRS with their attributes, as parallel arrays."""

    crs: str
    """The block's CRS."""
    lines: np.ndarray
    """Shapely LineStrings, flat."""
    layer: np.ndarray
    """Name of the layer each came from, str."""
    kind: np.ndarray
    """Class in the layer's own words, str; empty where unknown."""
    name: np.ndarray
    """Name or number, str; empty where unknown."""
    level: Int64[np.ndarray, "lines"]
    """0 on the ground, above 0 on a bridge, below 0 in a tunnel."""
    width_m: Float64[np.ndarray, "lines"]
    """Width, metres; NaN where unknown."""
    notes: tuple[Doubt, ...] = ()
    """Layers that hold no roads."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", locked(self.level, np.int64))
        object.__setattr__(self, "width_m", locked(self.width_m))

    def __len__(self) -> int:
        """Number of lines."""
        return len(self.lines)


def read_roads(
    paths: Sequence[str | Path] | str | Path, crs: str, bounds: Bounds | None = None
) -> Roads:
    """Read all road layers.

    Args:
        paths: Files of any GDAL vector format; `file.gpkg|layername=x` for one layer of many.
        crs: The block's CRS; layers in another are transformed.
        bounds: Read only roads that touch these, metres, in the block's CRS.

    Raises:
        ReferenceDataError: A file is missing or unreadable.
        CrsError: A layer's coordinates do not fit its CRS, or no CRS can be found for it.
    """
    block = parse_crs(crs, "block.toml [block] crs")
    files = [paths] if isinstance(paths, str | Path) else list(paths)
    layers = [layer for file in files for layer in read_layers(file, block, bounds)]
    pieces = [_roads_of(layer, crs) for layer in layers]
    joined = _concatenate([piece for piece in pieces if len(piece)], crs)
    notes = tuple(
        _no_roads(layer, bounds)
        for layer, piece in zip(layers, pieces, strict=True)
        if not len(piece)
    )
    return Roads(
        crs,
        joined.lines,
        joined.layer,
        joined.kind,
        joined.name,
        joined.level,
        joined.width_m,
        notes,
    )


def no_roads(crs: str) -> Roads:
    """A block without any road layer."""
    text = np.empty(0, dtype=object)
    return Roads(crs, text, text, text, text, np.empty(0, np.int64), np.empty(0))


def _concatenate(pieces: Sequence[Roads], crs: str) -> Roads:
    """Layers one after the other."""
    if not pieces:
        return no_roads(crs)
    return Roads(
        crs,
        np.concatenate([piece.lines for piece in pieces]),
        np.concatenate([piece.layer for piece in pieces]),
        np.concatenate([piece.kind for piece in pieces]),
        np.concatenate([piece.name for piece in pieces]),
        np.concatenate([piece.level for piece in pieces]),
        np.concatenate([piece.width_m for piece in pieces]),
    )


def _no_roads(layer: VectorLayer, bounds: Bounds | None) -> Doubt:
    """What is said of a layer without lines: a notice, since salient points serve instead."""
    what = "it is empty" if not len(layer.geometries) else "it holds no lines"
    where = " here" if bounds is not None and not len(layer.geometries) else ""
    return Doubt(
        kind="roads-empty",
        subject=layer.file,
        message=say(
            "Road layer {name} gives no roads: {what}{where}. Control is looked for at "
            "salient ortho points instead.",
            name=layer.name,
            what=what,
            where=where,
        ),
    )


def _roads_of(layer: VectorLayer, crs: str) -> Roads:
    """The lines of one layer; curves and collections are taken apart, other geometries left."""
    pieces, source = shapely.get_parts(layer.geometries, return_index=True)
    # A collection gives its members only at the second call.
    pieces, inner = shapely.get_parts(pieces, return_index=True)
    source = source[inner]
    kept = (shapely.get_dimensions(pieces) == 1) & (shapely.length(pieces) > 0)
    pieces, source = pieces[kept], source[kept]
    columns = {name.lower(): values for name, values in layer.columns.items()}
    count = len(layer.geometries)
    text = np.array([layer.name] * len(source), dtype=object)
    return Roads(
        crs,
        pieces,
        text,
        _texts(columns, KIND_COLUMNS, count)[source],
        _texts(columns, NAME_COLUMNS, count)[source],
        _levels(columns, count)[source],
        _numbers(columns, WIDTH_COLUMNS, count)[source],
    )


def _texts(columns: Mapping[str, np.ndarray], wanted: Sequence[str], count: int) -> np.ndarray:
    """The first of the wanted columns, as text."""
    found = next((columns[name] for name in wanted if name in columns), None)
    if found is None:
        return np.array([""] * count, dtype=object)
    return np.array(["" if value is None else str(value) for value in found], dtype=object)


def _numbers(
    columns: Mapping[str, np.ndarray], wanted: Sequence[str], count: int
) -> Float64[np.ndarray, "n"]:
    """The first of the wanted columns, as numbers; NaN where it holds none."""
    texts = _texts(columns, wanted, count)
    return np.array([_number(str(text)) for text in texts], dtype=np.float64).reshape(count)


def _number(text: str) -> float:
    """A number out of text such as `5.5`, `5,5 m`; NaN without one."""
    words = text.replace(",", ".").split()
    try:
        return float(words[0]) if words else float("nan")
    except ValueError:
        return float("nan")


def _levels(columns: Mapping[str, np.ndarray], count: int) -> Int64[np.ndarray, "n"]:
    """Level above ground: the number if one is given, else from bridge and tunnel."""
    level = np.nan_to_num(_numbers(columns, LEVEL_COLUMNS, count), nan=0.0, posinf=0, neginf=0)
    bridge, tunnel = _flags(columns, ("bridge", "most"), count), _flags(columns, ("tunnel",), count)
    level = np.where((level == 0) & bridge, 1, level)
    return np.where((level == 0) & tunnel, -1, level).astype(np.int64)


def _flags(
    columns: Mapping[str, np.ndarray], wanted: Sequence[str], count: int
) -> Bool[np.ndarray, "n"]:
    """Where a column says yes."""
    texts = _texts(columns, wanted, count)
    return np.array([str(text).strip().lower() in YES for text in texts], dtype=bool).reshape(count)
