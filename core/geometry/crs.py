"""Coordinate reference systems: what a block may use, and whether coordinates fit what they claim.

All coordinates in the project are east before north, whatever order a CRS officially has.
"""

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Num
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.exceptions import CRSError as ProjCrsError
from pyproj.exceptions import ProjError
from pyproj.transformer import TransformerGroup

from core.errors import CrsError
from core.said import say

Bounds = tuple[float, float, float, float]
"""West, south, east, north, metres."""
PlanePoints = Float64[np.ndarray, "n 2"]
"""Easting and northing, metres."""

# design: blocks are tens of kilometres wide and may lie across a border.
OUTSIDE_AREA_M = 100_000.0
"""Coordinates this far outside the area a CRS is made for are a mistake, not a large block."""
# design: below any accuracy asked for.
SAME_PLACE_M = 0.001
"""Two CRS whose coordinates agree to this are one and the same for us."""
CACHED = 64  # design: more operations than any block has.
"""Operations of PROJ kept ready."""
EARTH_M = 2.1e7  # source: half the Earth's circumference and a little, metres.
# source: EPSG code of S-JTSK / Krovak East North.
KROVAK = 5514
# source: extent of Czechia and Slovakia in S-JTSK.
KROVAK_RANGE = ((160e3, 910e3), (920e3, 1340e3))
"""|E| and |N| of Czechia and Slovakia in S-JTSK; they do not overlap, so the order shows."""
# source: the areas of use that PROJ lists.
KNOWN_RANGES: tuple[tuple[str, Bounds], ...] = (
    ("EPSG:5514", (-905e3, -1230e3, -430e3, -935e3)),
    ("EPSG:32633", (290e3, 5380e3, 790e3, 5660e3)),
)
"""Where archives of the Czech Office lie when a file does not say its CRS (METHODS 10)."""


def parse_crs(text: str, where: str | Path) -> CRS:
    """The horizontal CRS a block is computed in: projected, metres, axes east and north.

    Args:
        text: Anything PROJ understands: `EPSG:5514`, WKT, a PROJ string.
        where: The file and key it was read from, for the message.
    """
    crs = horizontal(read_crs(text, where))
    name = short_name(crs)
    if not crs.is_projected:
        raise CrsError(
            where,
            say("{name} does not count in metres on a map plane.", name=name),
            "Give a projected CRS in metres, such as EPSG:5514 or EPSG:32633.",
        )
    directions = {axis.direction for axis in crs.axis_info[:2]}
    if directions != {"east", "north"}:
        raise CrsError(
            where,
            say(
                "the axes of {name} point {names}, not east and north.",
                name=name,
                names=" and ".join(sorted(directions)),
            ),
            "Name its variant that counts east and north; for S-JTSK that is EPSG:5514, "
            "with coordinates E = -Y, N = -X (both negative).",
        )
    if not in_metres(crs):
        raise CrsError(
            where,
            say(
                "{name} counts in {unit_name}, not in metres.",
                name=name,
                unit_name=crs.axis_info[0].unit_name,
            ),
            "Give a projected CRS in metres and reproject the reference data to it.",
        )
    return crs


def in_metres(crs: CRS) -> bool:
    """Whether a map counts in metres along both axes."""
    # design: units that differ by less are metres.
    return all(abs(axis.unit_conversion_factor - 1) < 1e-9 for axis in crs.axis_info[:2])


def bounds_of(points: Num[np.ndarray, "n 2"]) -> Bounds:
    """The bounds of points; west lies beyond east where there are none."""
    west, south = points.min(axis=0, initial=np.inf).tolist()
    east, north = points.max(axis=0, initial=-np.inf).tolist()
    return west, south, east, north


def shared_bounds(one: Bounds, other: Bounds) -> Bounds:
    """What two bounds share; west lies beyond east, or south beyond north, where nothing."""
    (west, south), (east, north) = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    return float(west), float(south), float(east), float(north)


def distance_m(one: Bounds, other: Bounds) -> float:
    """How far two bounds lie apart; nought where they touch."""
    west, south, east, north = shared_bounds(one, other)
    return float(np.hypot(max(west - east, 0.0), max(south - north, 0.0)))


FARTHEST_M = 1e9  # design: metres that no map of the Earth has; what lies beyond is damage.
"""Coordinates are smaller."""


def read_crs(text: str, where: str | Path) -> CRS:
    """Any CRS PROJ knows; `CrsError` where there is none or it is unknown."""
    if not text.strip():
        raise CrsError(where, "no CRS is given.", 'Name it, such as crs = "EPSG:5514".')
    try:
        return CRS.from_user_input(text)
    except ProjCrsError as error:
        raise CrsError(
            where,
            say("PROJ does not know the CRS {text!r}.", text=text[:60]),
            'Give an EPSG code such as "EPSG:5514", WKT, or a PROJ string.',
        ) from error


def horizontal(crs: CRS) -> CRS:
    """The plane part of a CRS that also counts heights; a shift of its datum stays with it."""
    if crs.is_compound:
        return horizontal(crs.sub_crs_list[0])
    own = _unshifted(crs)
    # Of a CRS with a code PROJ knows better operations than the shift beside it.
    known = own.is_compound or own.to_authority(min_confidence=100)  # source: 100 is certainty.
    return horizontal(own) if own is not crs and known else crs


def _unshifted(crs: CRS) -> CRS:
    """A CRS without the shift to WGS 84 (TOWGS84) that its text gives beside it."""
    return crs.source_crs if crs.is_bound and crs.source_crs is not None else crs


def short_name(crs: CRS) -> str:
    """`EPSG:5514` where there is a code, the CRS's own name or its projection otherwise."""
    crs = _unshifted(crs)
    authority = crs.to_authority()
    if authority:
        return ":".join(authority)
    if crs.name.lower() not in ("unnamed", "unknown", ""):
        return crs.name
    method = crs.coordinate_operation.method_name if crs.coordinate_operation else say("geographic")
    return say("an unnamed CRS ({method})", method=method)


@dataclass(frozen=True, slots=True)
class Operation:
    """One way PROJ goes from a CRS to another, chosen once and then used for every point."""

    pipeline: str
    """PROJ's own description of it."""
    words: str
    """Its name, for the operator."""
    accuracy_m: float
    """Its accuracy, metres; NaN where PROJ knows none."""
    best: bool
    """False where a better one needs a grid that is not installed."""

    def forward(self, points: Num[np.ndarray, "n 2"]) -> PlanePoints:
        """Points of the source CRS in the target CRS; not finite where there is no way."""
        moved = _pipeline(self.pipeline).transform(points[:, 0], points[:, 1], errcheck=False)
        return np.column_stack(moved)

    def backward(self, points: Num[np.ndarray, "n 2"]) -> PlanePoints:
        """Points of the target CRS in the source CRS; not finite where there is no way."""
        moved = _pipeline(self.pipeline).transform(
            points[:, 0], points[:, 1], errcheck=False, direction="INVERSE"
        )
        return np.column_stack(moved)


def operation_between(
    source: str, target: str, points: Num[np.ndarray, "n 2"], where: str | Path
) -> Operation:
    """The best operation PROJ can do here from one CRS to another, east before north.

    Args:
        source: CRS of the points.
        target: CRS they are wanted in.
        points: Where it is needed. PROJ's choice depends on it: for S-JTSK the operation it
            prefers elsewhere is Slovak, and one that is national is passed over where the area
            reaches beyond the nation.
        where: The file, for the message.
    """
    west, south, east, north = _degrees_around(source, points)
    area: Any = AreaOfInterest(west, south, east, north)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a grid is missing is told by `best`
        try:
            group = TransformerGroup(
                source, target, always_xy=True, area_of_interest=area, allow_ballpark=False
            )
            lacking = sorted(
                {g.short_name for op in group.unavailable_operations for g in op.grids}
            )
            if not group.transformers and not lacking:
                # Nobody knows how the datums differ: told by an accuracy that is not known.
                group = TransformerGroup(source, target, always_xy=True, area_of_interest=area)
        except (IndexError, ProjError) as error:
            # A CRS that reads as one, and whose numbers PROJ cannot compute with.
            cause = say("PROJ cannot compute with its CRS {crs}.", crs=short_name(CRS(source)))
            raise CrsError(where, cause, "Give the file a valid CRS.") from error
    if not group.transformers and lacking:
        raise CrsError(
            where,
            "PROJ brings {source} to {target} only by a grid that is not installed: {grids}.",
            "Install it with `projsync --file {grid}`, or give the data in the block's CRS.",
            source=short_name(CRS(source)),
            target=short_name(CRS(target)),
            grids=lacking,
            grid=lacking[0],
        )
    for found in group.transformers:
        accuracy = float(found.accuracy) if found.accuracy >= 0 else float("nan")
        best = group.best_available and found is group.transformers[0]
        operation = Operation(found.definition, found.description, accuracy, best)
        if np.isfinite(operation.forward(points)).all():
            return operation
    raise CrsError(
        where,
        say(
            "PROJ cannot bring {source} to {target} at {points}.",
            source=short_name(CRS(source)),
            target=short_name(CRS(target)),
            points=_sample(points),
        ),
        "Check the CRS of the block and of this file; one of them is another one (or zone).",
    )


@lru_cache(maxsize=CACHED)
def _pipeline(text: str) -> Transformer:
    """PROJ's operation by its description; ours are all given east before north."""
    return Transformer.from_pipeline(text)


@lru_cache(maxsize=CACHED)
def _transformer(source: str, target: str) -> Transformer:
    """PROJ's own choice wherever a point lies: for judging coordinates, not for moving them."""
    return Transformer.from_crs(source, target, always_xy=True)


def degrees_of(crs: str, points: Num[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
    """Longitude and latitude of points, for judging and not for moving; NaN where nobody knows."""
    degrees = np.full(points.shape, np.nan)
    with suppress(ProjError):
        there = _transformer(crs, "EPSG:4326")
        degrees = np.column_stack(there.transform(points[:, 0], points[:, 1], errcheck=False))
    degrees[~np.isfinite(degrees)] = np.nan
    return degrees


def _degrees_around(source: str, points: Num[np.ndarray, "n 2"]) -> Bounds:
    """Longitudes and latitudes that points lie between; the whole Earth where nobody knows."""
    places = degrees_of(source, points)
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return -180.0, -90.0, 180.0, 90.0
    return bounds_of(places)


def same_coordinates(one: str, other: str, points: Num[np.ndarray, "n 2"]) -> bool:
    """Whether two CRS give these points the same coordinates, whatever they are called."""
    if one == other or CRS(one) == CRS(other):
        return True
    try:
        moved = np.column_stack(_transformer(one, other).transform(*points.T, errcheck=False))
    except ProjError:
        return False
    return bool(np.all(np.abs(moved - points) < SAME_PLACE_M))


def infer_crs(points: Num[np.ndarray, "n 2"], block_crs: CRS, where: str | Path) -> CRS:
    """The CRS of a file that names none: the block's where its coordinates fit, else by range."""
    finite = points[np.isfinite(points).all(axis=1)]
    if len(finite) and _outside_m(block_crs, finite) == 0 and not _is_degrees(finite):
        return block_crs
    for name, (west, south, east, north) in KNOWN_RANGES:
        if not _within(finite, (west, east), (south, north)):
            continue
        # The range is that of one country; a block elsewhere has nothing to do with it.
        moved = _transformer(name, block_crs.to_wkt()).transform(*finite.T, errcheck=False)
        if _outside_m(block_crs, np.column_stack(moved)) == 0:
            return CRS(name)
    _refuse_krovak_slips(block_crs, finite, where)
    raise CrsError(
        where,
        say(
            "the file names no CRS, and its coordinates {points} do not fit {block_crs}.",
            points=_sample(finite),
            block_crs=short_name(block_crs),
        ),
        "Assign its CRS (gdal_edit.py -a_srs, or a .prj file) and start again.",
    )


def check_range(crs: CRS, points: Num[np.ndarray, "n 2"], where: str | Path) -> None:
    """Refuse coordinates that cannot be in the CRS they claim, saying what is wrong with them.

    Args:
        crs: The CRS that is claimed.
        points: Easting, northing of the file, or the corners of its bounds.
        where: The file, for the message.
    """
    finite = np.asarray(points, dtype=np.float64)
    finite = finite[np.isfinite(finite).all(axis=1)]
    if not len(finite):
        return
    _refuse_krovak_slips(crs, finite, where)
    distance = _outside_m(crs, finite)
    if distance <= OUTSIDE_AREA_M:
        return
    raise CrsError(
        where,
        say(
            "coordinates such as {points} lie {distance} the area {crs} is made for.",
            points=_sample(finite),
            distance=_far(distance),
            crs=short_name(crs),
        ),
        _hint(crs, finite),
    )


def _refuse_krovak_slips(crs: CRS, points: PlanePoints, where: str | Path) -> None:
    """S-JTSK comes with either sign and in either order; the ranges tell which (FORMATS 2)."""
    if crs.to_epsg() != KROVAK:
        return
    if _within(points, *KROVAK_RANGE):
        told = "both coordinates are positive, first Y (west), then X (south)."
        remedy = "Give E = -Y and N = -X: put a minus before both."
    elif _within(points, *reversed(KROVAK_RANGE)):
        told = "both coordinates are positive, first X (south), then Y (west), as in EPSG:5513."
        remedy = "Give E = -Y and N = -X: swap the two and put a minus before both."
    elif _within(-points, *reversed(KROVAK_RANGE)):
        told = "easting and northing are swapped."
        remedy = "Swap the two: in EPSG:5514 E lies near -700 000 and N near -1 100 000."
    else:
        return
    raise CrsError(
        where,
        say(
            "coordinates such as {points} are S-JTSK, but {told}", points=_sample(points), told=told
        ),
        remedy,
    )


def _within(points: PlanePoints, first: Sequence[float], second: Sequence[float]) -> bool:
    """Whether all points lie in a range of the first and of the second coordinate."""
    low, high = np.array([first[0], second[0]]), np.array([first[1], second[1]])
    return len(points) > 0 and bool(np.all((points >= low) & (points <= high)))


def _outside_m(crs: CRS, points: PlanePoints) -> float:
    """How far the farthest point lies outside the area of use, metres; infinite if nowhere."""
    west, south, east, north = _area_bounds(crs.to_wkt())
    beyond_east = np.maximum(west - points[:, 0], points[:, 0] - east).clip(0)
    beyond_north = np.maximum(south - points[:, 1], points[:, 1] - north).clip(0)
    return float(np.hypot(beyond_east, beyond_north).max())


@lru_cache(maxsize=CACHED)
def _area_bounds(wkt: str) -> Bounds:
    """Bounds of the CRS's area of use in its own coordinates, metres."""
    crs = _unshifted(CRS(wkt))
    # The WKT that GDAL hands over names no area, but often the code under which PROJ lists one.
    authority = crs.to_authority()
    area = crs.area_of_use or (CRS.from_authority(*authority).area_of_use if authority else None)
    if area is None:
        # A CRS written out by hand names no area: whatever fits on the Earth is taken.
        return -EARTH_M, -EARTH_M, EARTH_M, EARTH_M
    # Areas of use are told in degrees from Greenwich, whatever the CRS itself counts in.
    own = _geodetic(crs)
    meridian, unit = own.prime_meridian, own.axis_info[0].unit_name
    usual = unit == "degree" and (meridian is None or meridian.longitude == 0)
    to_plane = _transformer((own if usual else CRS("EPSG:4326")).to_wkt(), crs.to_wkt())
    return to_plane.transform_bounds(*area.bounds, errcheck=False)


def _geodetic(crs: CRS) -> CRS:
    """The geographic CRS a projected one is made from."""
    return crs.geodetic_crs or CRS("EPSG:4326")


def _is_degrees(points: PlanePoints) -> bool:
    """Whether coordinates look like longitude and latitude."""
    return bool(np.all(np.abs(points) <= (180.0, 90.0)))


def _hint(crs: CRS, points: PlanePoints) -> str:
    """The likeliest slip behind coordinates that lie nowhere near."""
    name = short_name(crs)
    if _is_degrees(points):
        return say(
            "They look like degrees: reproject the file to {name}, or state its true CRS.",
            name=name,
        )
    for known, (west, south, east, north) in KNOWN_RANGES:
        if known != name and _within(points, (west, east), (south, north)):
            return say(
                "They look like {known}. Check the CRS of this file, and `crs` in [block].",
                known=known,
            )
    if _outside_m(crs, points[:, ::-1]) == 0:
        return say("They fit {name} when swapped: give easting first, then northing.", name=name)
    if _outside_m(crs, -points) == 0:
        return say("They fit {name} with the opposite sign: put a minus before both.", name=name)
    return "Check the CRS of the block and of this file; one of them is another one (or zone)."


def _far(distance_m: float) -> str:
    """The distance in words."""
    far = distance_m / 1000
    return say("{far:.0f} km outside", far=far) if np.isfinite(distance_m) else "outside"


def _sample(points: PlanePoints) -> str:
    """One of the points, for a message."""
    return f"({points[0, 0]:.10g}, {points[0, 1]:.10g})" if len(points) else "(none)"
