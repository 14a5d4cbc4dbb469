"""Values to bytes and back, exactly: JSON with arrays as base64, over a list of known dataclasses.

JSON objects that are not plain mappings carry their kind under a key that begins with `@`:
`{"@": "Peak", ...}` a dataclass, `@array`, `@tuple`, `@map` (keys that are not words), `@float`
(NaN and infinities), `@path`, `@wkb` (a shapely geometry).
"""

import base64
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from core.block.adjusted import (
    AdjustmentOptions,
    AdjustmentReport,
    CheckResult,
    ClassFigures,
    ExteriorSigmas,
    SharedParameter,
)
from core.block.approximation import Approximation
from core.block.assembly import Assembly
from core.block.block import (
    Block,
    ExteriorPrior,
    Measurement,
    Peak,
    Photo,
    SurveyedPoint,
    TiePoints,
)
from core.block.block_placement import PlacedBlock
from core.block.registration.ground_search import Turn
from core.block.registration.matching import Found
from core.block.registration.orientation import OrientedPhoto, ReferencePoints
from core.block.registration.placement import Placement
from core.block.registration.reference_points import ReferenceFeatures
from core.doubts import Doubt, Failure
from core.geometry.atmosphere import Atmosphere
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.grid import Grid
from core.geometry.interior import InteriorOrientation
from core.ground.mosaic import MosaicProduct
from core.ground.ortho import OrthoProduct
from core.ground.radiometry import Balance
from core.ground.seams import Seam
from core.scan.fiducials import FiducialMeasurement
from core.scan.film_area import FilmArea
from core.scan.orientation import ScanOrientation
from core.scan.raster import ScanFile
from core.stages import Georeferenced, PlacedBlocks, ScanSet, Tied
from sessions.decisions import DECISIONS, Recorded

FORMAT = 1
"""Version of the encoding; a file with a higher one was written by a newer Gruber."""

REGISTERED: tuple[type, ...] = (
    *DECISIONS,
    AdjustmentOptions,
    AdjustmentReport,
    Approximation,
    Assembly,
    Atmosphere,
    Block,
    Camera,
    CheckResult,
    ClassFigures,
    Doubt,
    ExteriorOrientation,
    ExteriorPrior,
    ExteriorSigmas,
    Failure,
    FiducialMeasurement,
    FilmArea,
    Found,
    Georeferenced,
    Grid,
    InteriorOrientation,
    Measurement,
    MosaicProduct,
    OrientedPhoto,
    OrthoProduct,
    Peak,
    Photo,
    PlacedBlock,
    PlacedBlocks,
    Placement,
    Recorded,
    ReferenceFeatures,
    ReferencePoints,
    ScanFile,
    ScanOrientation,
    ScanSet,
    Balance,
    Seam,
    SharedParameter,
    SurveyedPoint,
    Tied,
    TiePoints,
    Turn,
)
"""Every dataclass that may be stored; a new one is added here and nowhere else."""

_TYPES = {kind.__name__: kind for kind in REGISTERED}
assert len(_TYPES) == len(REGISTERED), "two registered dataclasses share a name"


class CodecError(ValueError):
    """Bytes that are no stored value, or a value that cannot be stored."""


def encode(value: Any) -> bytes:
    """A value as UTF-8 JSON with the version of the encoding."""
    return _dumps({"gruber": FORMAT, "value": to_json(value)})


def decode(data: bytes) -> Any:
    """The value that `encode` was given; arrays come back read-only.

    Raises:
        CodecError: Not an encoded value, a newer version, or an unknown type.
    """
    try:
        read = json.loads(data)
    except ValueError as error:
        raise CodecError(f"not a stored value ({error})") from error
    envelope = cast("dict[str, Any]", read) if isinstance(read, dict) else {}
    if not {"gruber", "value"} <= envelope.keys():
        raise CodecError("not a stored value (no version)")
    version = envelope["gruber"]
    if version != FORMAT:
        raise CodecError(f"version {version} of the encoding; this Gruber knows version {FORMAT}")
    return from_json(envelope["value"])


def canonical(value: Any, path_to_json: Callable[[Path], Any]) -> bytes:
    """Bytes that are equal for equal values, whatever the order of their mappings; not decodable.

    Args:
        value: As for `encode`; dataclasses need not be registered.
        path_to_json: What stands for a path.
    """
    form = _Form(lambda kind: kind.__name__, path_to_json, in_order=False)
    return _dumps(_to_json(value, form), sort_keys=True)


def to_json(value: Any) -> Any:
    """A value as what JSON can hold.

    Args:
        value: Scalars, arrays, tuples, lists, mappings, paths, geometries, registered dataclasses.
    """
    return _to_json(value, _EXACT)


def from_json(data: Any) -> Any:
    """The value that `to_json` was given."""
    if isinstance(data, list):
        return [from_json(item) for item in cast("list[Any]", data)]
    if not isinstance(data, dict):
        return data
    held = cast("dict[str, Any]", data)
    kind = next((key for key in held if key.startswith("@")), None)
    if kind is None:
        return {key: from_json(item) for key, item in held.items()}
    if kind not in _READERS:
        raise CodecError(f"unknown kind {kind}")
    try:
        return _READERS[kind](held)
    except CodecError:
        raise
    except (KeyError, TypeError, ValueError, shapely.GEOSException) as error:
        raise CodecError(f"damaged {held[kind] if kind == '@' else kind} ({error})") from error


def _dumps(data: Any, sort_keys: bool = False) -> bytes:
    text = json.dumps(
        data, allow_nan=False, ensure_ascii=False, separators=(",", ":"), sort_keys=sort_keys
    )
    return text.encode("utf-8", "surrogatepass")


def _registered(kind: type) -> str:
    if _TYPES.get(kind.__name__) is not kind:
        raise CodecError(f"{kind.__name__} is not in sessions.codec.REGISTERED")
    return kind.__name__


@dataclass(frozen=True, slots=True)
class _Form:
    """How the two encodings differ: the exact one and the canonical one."""

    name_of: Callable[[type], str]
    path_to_json: Callable[[Path], Any]
    in_order: bool


_EXACT = _Form(_registered, lambda path: {"@path": str(path)}, in_order=True)


def _to_json(value: Any, form: _Form) -> Any:
    match value:
        case np.generic():
            return _to_json(value.item(), form)
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else {"@float": repr(value)}
        case np.ndarray():
            return _array_to_json(cast("np.ndarray", value))
        case tuple():
            return {"@tuple": [_to_json(item, form) for item in cast("tuple[Any]", value)]}
        case list():
            return [_to_json(item, form) for item in cast("list[Any]", value)]
        case Mapping():
            return _mapping_to_json(cast("Mapping[Any, Any]", value), form)
        case _:
            return _object_to_json(value, form)


def _array_to_json(array: np.ndarray) -> dict[str, Any]:
    """An array by its bytes, little-endian, row by row."""
    if array.dtype.kind not in "biufc":
        raise CodecError(f"an array of {array.dtype} cannot be stored")
    dtype = array.dtype.newbyteorder("<")
    data = np.ascontiguousarray(array, dtype=dtype).tobytes()
    return {
        "@array": dtype.str,
        "shape": list(array.shape),
        "data": base64.b64encode(data).decode("ascii"),
    }


def _mapping_to_json(mapping: Mapping[Any, Any], form: _Form) -> dict[str, Any]:
    """A mapping as an object where its keys are words, else as pairs; in its own order."""
    if all(isinstance(key, str) and not key.startswith("@") for key in mapping):
        return {key: _to_json(item, form) for key, item in mapping.items()}
    pairs = [[_to_json(key, form), _to_json(item, form)] for key, item in mapping.items()]
    return {"@map": pairs if form.in_order else sorted(pairs, key=_dumps)}


def _object_to_json(value: Any, form: _Form) -> Any:
    if isinstance(value, Path):
        return form.path_to_json(value)
    if isinstance(value, BaseGeometry):
        return {"@wkb": shapely.to_wkb(value, hex=True, byte_order=1, include_srid=True)}
    if is_dataclass(value) and not isinstance(value, type):
        kept = {field.name: getattr(value, field.name) for field in fields(value) if field.init}
        name = {"@": form.name_of(type(value))}
        return name | {key: _to_json(item, form) for key, item in kept.items()}
    raise CodecError(f"a {type(value).__name__} cannot be stored")


def _dataclass_from_json(data: dict[str, Any]) -> Any:
    kind = _TYPES.get(data["@"])
    if kind is None:
        raise CodecError(f"unknown type {data['@']}: written by a newer Gruber?")
    given = {key: from_json(item) for key, item in data.items() if key != "@"}
    expected = {field.name: field for field in fields(kind) if field.init}
    unknown = given.keys() - expected.keys()
    missing = {key for key in expected.keys() - given.keys() if not _optional(expected[key])}
    if unknown or missing:
        wrong = ", ".join(sorted(unknown | missing))
        raise CodecError(f"{data['@']} has other fields in this version: {wrong}")
    return kind(**given)


def _optional(field: Field[Any]) -> bool:
    """True for a field with a default, which an older file may lack."""
    return field.default is not MISSING or field.default_factory is not MISSING


def _array_from_json(data: dict[str, Any]) -> np.ndarray:
    """A read-only array in the machine's own byte order."""
    dtype = np.dtype(data["@array"])
    array = np.frombuffer(base64.b64decode(data["data"]), dtype).reshape(data["shape"])
    array = array.astype(dtype.newbyteorder("="), copy=False)
    array.setflags(write=False)
    return array


def _map_from_json(data: dict[str, Any]) -> dict[Any, Any]:
    return {from_json(key): from_json(item) for key, item in data["@map"]}


def _wkb_from_json(data: dict[str, Any]) -> BaseGeometry:
    return cast("BaseGeometry", shapely.from_wkb(data["@wkb"]))


_READERS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "@": _dataclass_from_json,
    "@array": _array_from_json,
    "@float": lambda data: float(data["@float"]),
    "@map": _map_from_json,
    "@path": lambda data: Path(data["@path"]),
    "@tuple": lambda data: tuple(from_json(item) for item in data["@tuple"]),
    "@wkb": _wkb_from_json,
}
