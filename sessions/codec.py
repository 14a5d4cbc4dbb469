"""Values to bytes and back, exactly: JSON with arrays as base64, over a list of known dataclasses.

JSON objects that are not plain mappings carry their kind under a key that begins with `@`:
`{"@": "Peak", ...}` a dataclass, `@array`, `@tuple`, `@map` (keys that are not words), `@float`
(NaN and infinities), `@path`, `@here` (a path inside the block's folder), `@said` (a
sentence with its figures), `@wkb` (a shapely geometry).
"""

import base64
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from core.adjustment.adjusted import (
    AdjustmentOptions,
    AdjustmentReport,
    CheckResult,
    ClassFigures,
    Contradiction,
    ExteriorSigmas,
    NewPoint,
    SharedParameter,
)
from core.block import (
    Block,
    ExteriorPrior,
    Measurement,
    Peak,
    Photo,
    Reading,
    ShiftedReference,
    SurveyedPoint,
    TiePoints,
)
from core.control.calibration_check import Bin
from core.control.stage import ControlFound
from core.doubts import Doubt, Failure
from core.formats.listed_point import ListedPoint
from core.geometry.camera import Camera
from core.geometry.collinearity import Atmosphere
from core.geometry.drawn_mask import DrawnMask
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.georeference.approximation import Approximation
from core.georeference.stage import Georeferenced
from core.localisation.initial_orientation import WeakControl
from core.localisation.stage import Localised
from core.mosaic.comparison import ComparedPlaces, MosaicAccuracy
from core.mosaic.composition import MosaicProduct
from core.mosaic.fault_places import FaultPlace
from core.mosaic.misfit import MisfitVectors
from core.mosaic.misfit_places import Misfit, MisfitPlace, SystematicMisfit
from core.mosaic.radiometry import Balance, FilmPlane
from core.mosaic.seam_fit import SeamFit
from core.mosaic.seams import Seam
from core.orthos.rectification import OrthoProduct
from core.quality.check_plan import CheckPlace
from core.raster.grid import Grid
from core.raster.holes import Hole
from core.raster.scan_file import ScanFile, Scratch, UsableArea
from core.reference.stage import ReferenceFeatures, ReferencePoints
from core.said import Said
from core.scans.film_area import FilmArea
from core.scans.interior_orientation import ScanOrientation
from core.scans.judging import FiducialMeasurement
from core.scans.stage import ScanSet
from core.sheets.acceptance import DrawnSheet, SamplingPlan
from core.sheets.delivery import Delivery, SheetFile
from core.surface.ground import GroundProduct, SystematicPart
from core.surface.stage import SurfaceFiles, SurfaceProduct
from core.ties.stage import Tied
from sessions.decisions import DECISIONS, Recorded

FORMAT = 1
"""Version of the encoding; a file with a higher one was written by a newer Gruber."""
LARGEST = 1e9
"""No coordinate, and nothing else that a decision says, reaches this in its unit."""

REGISTERED: tuple[type, ...] = (
    *DECISIONS,
    AdjustmentOptions,
    AdjustmentReport,
    Approximation,
    Atmosphere,
    Balance,
    Bin,
    Block,
    Camera,
    CheckPlace,
    CheckResult,
    ClassFigures,
    ComparedPlaces,
    Contradiction,
    ControlFound,
    Delivery,
    Doubt,
    DrawnMask,
    DrawnSheet,
    ExteriorOrientation,
    ExteriorPrior,
    ExteriorSigmas,
    Failure,
    FaultPlace,
    FiducialMeasurement,
    FilmArea,
    FilmPlane,
    Georeferenced,
    Grid,
    GroundProduct,
    Hole,
    InteriorOrientation,
    ListedPoint,
    Localised,
    Measurement,
    Misfit,
    MisfitPlace,
    MisfitVectors,
    MosaicAccuracy,
    MosaicProduct,
    NewPoint,
    OrthoProduct,
    Peak,
    Photo,
    Reading,
    Recorded,
    ReferenceFeatures,
    ReferencePoints,
    SamplingPlan,
    ScanFile,
    ScanOrientation,
    ScanSet,
    Scratch,
    Seam,
    SeamFit,
    SharedParameter,
    SheetFile,
    ShiftedReference,
    SurfaceFiles,
    SurfaceProduct,
    SurveyedPoint,
    SystematicMisfit,
    SystematicPart,
    TiePoints,
    Tied,
    UsableArea,
    WeakControl,
)
"""Every dataclass that may be stored; a new one is added here and nowhere else."""

_TYPES = {kind.__name__: kind for kind in REGISTERED}
assert len(_TYPES) == len(REGISTERED), "two registered dataclasses share a name"
_FORMER = {"Assembly": ControlFound}
"""Names under which earlier versions wrote what is called otherwise now."""


class CodecError(ValueError):
    """Bytes that are no stored value, or a value that cannot be stored."""


def encode(value: Any, here: Path | None = None) -> bytes:
    """A value as UTF-8 JSON with the version of the encoding.

    Args:
        value: As for `to_json`.
        here: Paths inside this folder are kept relative to it, so that it may be moved.
    """
    return _dumps({"gruber": FORMAT, "value": to_json(value, here)})


def decode(data: bytes, here: Path | None = None) -> Any:
    """The value that `encode` was given; arrays come back read-only.

    Args:
        data: What `encode` returned.
        here: Where the folder is now that paths are relative to.

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
    return from_json(envelope["value"], here)


def canonical(value: Any, path_form: Callable[[Path], Any]) -> bytes:
    """Bytes that are equal for equal values, whatever the order of their mappings; not decodable.

    Args:
        value: As for `encode`; dataclasses need not be registered.
        path_form: What stands for a path.
    """
    form = _Form(lambda kind: kind.__name__, path_form, in_order=False)
    return _dumps(_to_json(value, form), sort_keys=True)


def to_json(value: Any, here: Path | None = None) -> Any:
    """A value as what JSON can hold.

    Args:
        value: Scalars, arrays, tuples, lists, mappings, paths, geometries, registered dataclasses.
        here: As for `encode`.
    """
    return _to_json(value, _Form(_registered, lambda path: path_to_json(path, here), in_order=True))


def path_to_json(path: Path, here: Path | None) -> dict[str, str]:
    """A path, relative to a folder where it lies inside."""
    if here is not None and path.is_relative_to(here):
        return {"@here": path.relative_to(here).as_posix()}
    return {"@path": str(path)}


def from_json(data: Any, here: Path | None = None) -> Any:
    """The value that `to_json` was given."""

    def read(item: Any) -> Any:
        return from_json(item, here)

    if isinstance(data, list):
        return [read(item) for item in cast("list[Any]", data)]
    if not isinstance(data, dict):
        return data
    held = cast("dict[str, Any]", data)
    kind = next((key for key in held if key.startswith("@")), None)
    if kind is None:
        return {key: read(item) for key, item in held.items()}
    if kind == "@here":
        return (here or Path()) / held[kind]
    if kind not in _READERS:
        raise CodecError(f"unknown kind {kind}")
    try:
        return _READERS[kind](held, read)
    except CodecError:
        raise
    except (KeyError, TypeError, ValueError, shapely.GEOSException) as error:
        raise CodecError(f"damaged {held[kind] if kind == '@' else kind} ({error})") from error


def unfit_field(value: Any, *, finite: bool = True) -> str:
    """The first field of a dataclass that holds what its type does not allow; empty without one.

    Args:
        value: A dataclass of scalars, tuples, mappings and other dataclasses.
        finite: Whether its own numbers must be below `LARGEST`; those of dataclasses within it need
            not.
    """
    for name, hint in _hints(type(value)).items():
        if not _fits(getattr(value, name), hint, finite):
            return name
    return ""


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    """Types of the fields of a dataclass."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


def _fits(value: Any, hint: Any, finite: bool) -> bool:
    inside = get_args(hint)
    match get_origin(hint):
        case origin if origin is Literal:
            return value in inside
        case origin if origin in (Union, UnionType):
            return any(_fits(value, one, finite) for one in inside)
        case origin if origin is tuple:
            hints = inside[:1] * len(value) if inside[-1] is ... else inside
            return isinstance(value, tuple) and (
                len(value) == len(hints)
                and all(_fits(one, own, finite) for one, own in zip(value, hints, strict=True))
            )
        case None if hint is float:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            return number and (abs(value) < LARGEST or not finite)
        case None:
            within = is_dataclass(value)
            return isinstance(value, hint) and not (within and unfit_field(value, finite=False))
        case origin:
            return isinstance(value, cast("type", origin)) and all(
                _fits(key, inside[0], finite) and _fits(one, inside[1], finite)
                for key, one in value.items()
            )


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
    path_form: Callable[[Path], Any]
    in_order: bool


def _to_json(value: Any, form: _Form) -> Any:
    match value:
        case np.generic():
            return _to_json(value.item(), form)
        case Said() if form.in_order:
            return {"@said": value.template, "values": _to_json(value.values, form)}
        case str():
            return str(value)
        case None | bool() | int():
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
        return form.path_form(value)
    if isinstance(value, BaseGeometry):
        return {"@wkb": shapely.to_wkb(value, hex=True, byte_order=1, include_srid=True)}
    if is_dataclass(value) and not isinstance(value, type):
        stored = [field for field in fields(value) if _is_stored(field)]
        kept = {field.name: getattr(value, field.name) for field in stored}
        # A field that came later does not change the digest of what says nothing in it.
        for later in (field for field in stored if field.metadata.get("later")):
            if kept[later.name] == later.default:
                del kept[later.name]
        name = {"@": form.name_of(type(value))}
        return name | {key: _to_json(item, form) for key, item in kept.items()}
    raise CodecError(f"a {type(value).__name__} cannot be stored")


def _is_stored(field: Field[Any]) -> bool:
    """False for what is computed from other fields, or too large to be kept."""
    return field.init and bool(field.metadata.get("stored", True))


_Read = Callable[[Any], Any]
"""Reads what is inside."""


def _dataclass_from_json(data: dict[str, Any], read: _Read) -> Any:
    kind = (_TYPES | _FORMER).get(data["@"])
    if kind is None:
        raise CodecError(f"unknown type {data['@']}: written by a newer Gruber?")
    given = {key: read(item) for key, item in data.items() if key != "@"}
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


def _map_from_json(data: dict[str, Any], read: _Read) -> dict[Any, Any]:
    return {read(key): read(item) for key, item in data["@map"]}


def _wkb_from_json(data: dict[str, Any]) -> BaseGeometry:
    return cast("BaseGeometry", shapely.from_wkb(data["@wkb"]))


_READERS: dict[str, Callable[[dict[str, Any], _Read], Any]] = {
    "@": _dataclass_from_json,
    "@array": lambda data, _: _array_from_json(data),
    "@float": lambda data, _: float(data["@float"]),
    "@map": _map_from_json,
    "@path": lambda data, _: Path(data["@path"]),
    "@said": lambda data, read: Said(data["@said"], read(data["values"])),
    "@tuple": lambda data, read: tuple(read(item) for item in data["@tuple"]),
    "@wkb": lambda data, _: _wkb_from_json(data),
}
