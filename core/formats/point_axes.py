"""Axis directions and CRS of a point list, found by comparison with the block."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

import numpy as np
from jaxtyping import Bool, Float64
from pyproj import CRS

from core.errors import CrsError
from core.formats.listed_point import (
    ABOVE_ELLIPSOID,
    EAST_NORTH,
    GEOGRAPHIC,
    Axes,
    Choice,
    PointList,
    PointListReading,
    Question,
    ReadRow,
    RefusedRow,
    Triple,
    plain_word,
)
from core.geometry.crs import (
    KROVAK,
    KROVAK_RANGE,
    Bounds,
    PlanePoints,
    operation_between,
    read_crs,
)
from core.geometry.heights import ELLIPSOIDAL, told_offset, vertical_of
from core.said import say

Heights = Float64[np.ndarray, "points"]
AXES: tuple[Axes, ...] = get_args(Axes)
AS_WRITTEN: Axes = "E N"
TURNED: tuple[Axes, ...] = ("-N -E", "-E -N")
"""S-JTSK as it is usually written, positive: a convention, not a slip."""
# source: S-JTSK, UTM 33 North and Web Mercator, in which Czech and Central European lists come.
USUAL_CRS = ("EPSG:4326", "EPSG:5514", "EPSG:32633", "EPSG:3857")
"""Other CRS that are tried on a list that does not lie in the block."""
# source: definition of longitude and latitude, degrees.
MOST_DEGREES = (180.0, 90.0)
# design: systems of heights differ by 110 m at most, and towers that are surveyed stand lower.
HIGHEST_OFF_M = 200.0
"""A height further off the DEM than this is not of a point that stands there."""
# design: tables are rounded to the centimetre, and a place beyond is another one.
SAME_M = 0.01
"""A point of the block that a list has within this is listed as it stands."""
WHOLE_OR_NOT = (
    Choice("leave out", say("leave them out")),
    Choice("keep", say("bring them all the same")),
)
"""What can be done with points that hardly are where the list has them."""


@dataclass(frozen=True, slots=True)
class Ground:
    """The heights of a block, with which those of a list are compared."""

    heights: Callable[[PlanePoints], Heights] | None = None
    """Of the DEM at places in the block's CRS, metres, NaN beside it; None without a DEM."""
    sigma_m: float = 0.0
    """Their standard deviation, metres."""
    system: str = ""
    """Height system of the block, as a code; empty where nobody says it."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Where the points of a list ought to lie."""

    crs: str
    """The block's CRS."""
    bounds: Bounds | None = None
    """Ground of the block's photos in that CRS, metres; None where it is not known yet."""
    taken: Mapping[str, Triple] = field(default_factory=dict[str, Triple])
    """Points of another kind by name, in that CRS: the block found them itself; metres."""
    ground: Ground = field(default_factory=Ground)
    """Its heights."""

    @property
    def reach(self) -> Bounds | None:
        """The bounds and as much again on every side: no photo sees a point beyond."""
        if self.bounds is None:
            if CRS(self.crs).to_epsg() != KROVAK:
                return None
            (least_e, most_e), (least_n, most_n) = KROVAK_RANGE
            return -most_e, -most_n, -least_e, -least_n
        west, south, east, north = self.bounds
        room = max(east - west, north - south)
        return west - room, south - room, east + room, north + room


@dataclass(frozen=True, slots=True)
class AxesFound:
    """How the plane coordinates are to be read."""

    axes: Axes
    """The way most points lie where the block does."""
    certain: bool
    """False where somebody should look."""
    inside: int
    """Points that lie where the block does, read so."""
    others: Mapping[Axes, int]
    """Other ways, with the points that lie there read so."""


def east_north(plane: Float64[np.ndarray, "n 2"], axes: Axes) -> PlanePoints:
    """Columns X and Y of a list as easting and northing."""
    sign = -1.0 if axes.startswith("-") else 1.0
    return sign * (plane[:, ::-1] if axes in ("N E", "-N -E") else plane)


def within(points: PlanePoints, bounds: Bounds | None) -> Bool[np.ndarray, " n"]:
    """Which points lie inside bounds; all where there are none."""
    if bounds is None:
        return np.ones(len(points), dtype=bool)
    west, south, east, north = bounds
    return np.all((points >= (west, south)) & (points <= (east, north)), axis=1)


def find_axes(
    plane: Float64[np.ndarray, "n 2"], around: Surroundings, named_east_north: bool
) -> AxesFound:
    """Which way the columns X and Y point.

    Args:
        plane: Columns X and Y as they are written.
        around: Where the points ought to lie.
        named_east_north: Whether the columns are called easting and northing.
    """
    counts: dict[Axes, int] = {
        axes: int(within(east_north(plane, axes), around.reach).sum()) for axes in AXES
    }
    if around.reach is None:
        return AxesFound(AS_WRITTEN, True, 0, {})
    best = max(AXES, key=lambda axes: counts[axes])  # as written, where two are alike
    others: dict[Axes, int] = {axes: counts[axes] for axes in AXES if axes != best and counts[axes]}
    customary = CRS(around.crs).to_epsg() == KROVAK and best in TURNED
    plain = best == AS_WRITTEN or (customary and not named_east_north)
    alone = not any(count == counts[best] for count in others.values())
    return AxesFound(best, plain and (alone or named_east_north), counts[best], others)


def suspected_crs(
    plane: Float64[np.ndarray, "n 2"], around: Surroundings
) -> tuple[tuple[str, Axes], ...]:
    """Other CRS in which at least half the points would lie in the block, with their axes."""
    return tuple(
        (name, axes)
        for name in USUAL_CRS
        if CRS(name) != CRS(around.crs)
        for axes in AXES
        if _half_inside(name, east_north(plane, axes), around)
    )


def are_degrees(plane: Float64[np.ndarray, "n 2"]) -> bool:
    """True when all coordinates may be longitudes and latitudes in either order."""
    high, low = np.abs(plane).max(axis=1), np.abs(plane).min(axis=1)
    return bool(np.all((high <= MOST_DEGREES[0]) & (low <= MOST_DEGREES[1])))


def _half_inside(name: str, points: PlanePoints, around: Surroundings) -> bool:
    if around.reach is None:
        return False
    if name == USUAL_CRS[0] and np.any(np.abs(points) > MOST_DEGREES):
        return False
    try:
        moved = operation_between(name, around.crs, points, name).forward(points)
    except CrsError:
        return False
    return 2 * int(within(moved, around.reach).sum()) >= len(points)


def mean_place(points: PlanePoints, bounds: Sequence[float]) -> tuple[float, float]:
    """Distances east and north from the middle of bounds to the middle of points, metres."""
    middle = np.array([(bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2])
    away = np.median(points, axis=0) - middle
    return float(away[0]), float(away[1])


AXES_WORDS: dict[Axes, str] = {
    "E N": say("X is easting, Y is northing"),
    "N E": say("X is northing, Y is easting"),
    "-E -N": say("X is westing, Y is southing (both signs turned)"),
    "-N -E": say("X is southing, Y is westing (positive S-JTSK)"),
}
"""What each way of reading the columns X and Y means."""


def settle_axes(
    found: PointList, rows: Sequence[ReadRow], around: Surroundings
) -> tuple[PointListReading, tuple[str, ...], tuple[Question, ...]]:
    """The reading with axes and CRS, the evidence for them, and what is left to ask of them."""
    reading, plane = found.reading, _plane(rows)
    words = [plain_word(name) for name in found.table.header]
    columns = reading.columns or ()
    named = {words[n] for n, q in enumerate(columns) if q in ("X", "Y") and n < len(words)}
    if not reading.crs and len(named & GEOGRAPHIC) > 1:
        reading = replace(reading, crs="EPSG:4326")
    if reading.axes is not None or reading.crs:
        axes = reading.axes or AS_WRITTEN
        return replace(reading, axes=axes), (AXES_WORDS[axes],), ()
    axes = find_axes(plane, around, named <= EAST_NORTH and len(named) > 1)
    reading = replace(reading, axes=axes.axes)
    if around.reach is None or (axes.certain and axes.inside):
        return reading, _evidence_of_axes(axes, len(rows), around), ()
    if axes.inside:
        return reading, (), (_asked_of_axes(axes, len(rows)),)
    return _elsewhere(reading, plane, around)


def _plane(rows: Sequence[ReadRow]) -> Float64[np.ndarray, "n 2"]:
    """The columns X and Y as they are written."""
    return np.array([(row.point.easting, row.point.northing) for row in rows]).reshape(-1, 2)


def _evidence_of_axes(axes: AxesFound, count: int, around: Surroundings) -> tuple[str, ...]:
    """Why the columns X and Y are read as they are."""
    words = AXES_WORDS[axes.axes]
    if around.reach is None:
        return (words,)
    if around.bounds is None:
        return (say("{axes}: so all of them lie in Czechia or Slovakia.", axes=words),)
    return (
        say(
            "{axes}: so {inside} of {count:# point|# points} lie in the block or near it.",
            axes=words,
            inside=axes.inside,
            count=count,
        ),
    )


def _asked_of_axes(axes: AxesFound, count: int) -> Question:
    """Which way the columns X and Y point, the likeliest first."""
    likeliest = sorted(axes.others, key=lambda way: -axes.others[way])
    ways: dict[Axes, int] = {axes.axes: axes.inside}
    ways |= {way: axes.others[way] for way in likeliest}
    ways.setdefault(AS_WRITTEN, 0)
    template = "{axes}: so {inside} of {count:# point|# points} lie in the block or near it."
    choices = tuple(
        Choice(way, say(template, axes=AXES_WORDS[way], inside=inside, count=count))
        for way, inside in ways.items()
    )
    return Question("axes", say("Which way do the columns X and Y point?"), choices)


def _elsewhere(
    reading: PointListReading, plane: Float64[np.ndarray, "n 2"], around: Surroundings
) -> tuple[PointListReading, tuple[str, ...], tuple[Question, ...]]:
    """What to ask where no point lies in the block whichever way the axes point."""
    suspects = suspected_crs(plane, around)
    # The axes are asked of the list once its CRS is named: one answer settles both.
    axes = suspects[0][1] if suspects else AS_WRITTEN
    reading = replace(reading, axes=axes)
    names = tuple(dict.fromkeys(name for name, _ in suspects))
    if names:
        words = say(
            "No point lies in the block in {crs}. Which CRS is the list in?", crs=around.crs
        )
        choices = tuple(
            Choice(name, say("{crs}: so the points lie in the block.", crs=name)) for name in names
        )
        return reading, (), (Question("crs", words, choices),)
    if are_degrees(plane):
        words = say("The coordinates look like degrees, which do not lie in the block either.")
        return reading, (), (Question("crs", words, (Choice("EPSG:4326", "EPSG:4326"),)),)
    return reading, (), ()


def placed_rows(
    rows: Sequence[ReadRow], reading: PointListReading, around: Surroundings, path: Path
) -> list[ReadRow]:
    """The rows with easting and northing in the block's CRS."""
    axes = reading.axes or AS_WRITTEN
    plane, loss = east_north(_plane(rows), axes), 0.0
    if reading.crs:
        operation = operation_between(reading.crs, around.crs, plane, path)
        plane = operation.forward(plane)
        loss = operation.accuracy_m if np.isfinite(operation.accuracy_m) else 0.0
    swapped = axes in ("N E", "-N -E")
    placed: list[ReadRow] = []
    for row, (east, north) in zip(rows, plane.tolist(), strict=True):
        first, second, height = row.point.sigma_m
        if swapped:
            first, second = second, first
        if loss:
            first, second = float(np.hypot(first, loss)), float(np.hypot(second, loss))
        point = replace(row.point, easting=east, northing=north, sigma_m=(first, second, height))
        placed.append(ReadRow(row.source, point))
    return placed


def evidence_of_crs(
    rows: Sequence[ReadRow], reading: PointListReading, around: Surroundings, path: Path
) -> str:
    """How the list comes into the block's CRS, and what that costs."""
    plane = east_north(_plane(rows), reading.axes or AS_WRITTEN)
    operation = operation_between(reading.crs, around.crs, plane, path)
    return say(
        "From {source} to {target} by {words}, accurate to {accuracy:.2f} m, which is added to the "
        "standard deviations; heights stay as they are.",
        source=reading.crs,
        target=around.crs,
        words=operation.words,
        accuracy=operation.accuracy_m,
    )


def within_reach(
    rows: list[ReadRow], reading: PointListReading, around: Surroundings
) -> tuple[list[ReadRow], list[RefusedRow], tuple[Question, ...]]:
    """The rows whose points a photo may see, those beyond, and a question about them."""
    if around.bounds is None or reading.outside == "keep":
        return rows, [], ()
    near = within(_plane(rows), around.reach)
    inside = [row for row, close in zip(rows, near, strict=True) if close]
    beyond = [row for row, close in zip(rows, near, strict=True) if not close]
    if not beyond:
        return rows, [], ()
    if reading.outside == "leave out":
        return inside, [_beyond(row, around) for row in beyond], ()
    east, north = mean_place(_plane(beyond), around.bounds)
    words = say(
        "{count:# point lies|# points lie} far outside the block, such as {name}, "
        "{east:+,.0f} m east and {north:+,.0f} m north of its middle.",
        count=len(beyond),
        name=beyond[0].point.point_id,
        east=east,
        north=north,
    )
    return rows, [], (Question("outside", words, WHOLE_OR_NOT),)


def _beyond(row: ReadRow, around: Surroundings) -> RefusedRow:
    """A point that no photo can see."""
    assert around.bounds is not None, "nothing lies outside a block without bounds"
    east, north = mean_place(_plane([row]), around.bounds)
    told = "{name} lies {east:+,.0f} m east and {north:+,.0f} m north of the block's middle."
    cause = say(told, name=row.point.point_id, east=east, north=north)
    return RefusedRow(
        row.source.number, row.source.text, cause, say("Check its digits and its CRS.")
    )


def on_the_ground(
    rows: list[ReadRow], reading: PointListReading, around: Surroundings, name: str
) -> tuple[list[ReadRow], list[RefusedRow], tuple[Question, ...]]:
    """The rows whose heights the ground may have, those that no ground has, and a question.

    Args:
        rows: Points of the list in the block's CRS.
        reading: How it is read.
        around: The ground.
        name: The list, as the user knows it.
    """
    if around.ground.heights is None or reading.heights == "keep" or not rows:
        return rows, [], ()
    heights = np.array([row.point.height for row in rows])
    ground = around.ground.heights(_plane(rows))
    known = np.array([row.point.role != "plan" for row in rows])
    off = known & (np.abs(heights - ground) > HIGHEST_OFF_M)
    if not off.any():
        return rows, [], ()
    sound = [row for row, is_off in zip(rows, off, strict=True) if not is_off]
    wrong = [(row, float(z)) for row, z, is_off in zip(rows, ground, off, strict=True) if is_off]
    if reading.heights == "leave out":
        return sound, [_above(row, level) for row, level in wrong], ()
    row, level = wrong[0]
    words = say(
        "{file}: {count:# height is|# heights are} far off the DEM, such as {name} at "
        "{height:.1f} m, where the DEM has {ground:.1f} m. Check digits, column and unit.",
        file=name,
        count=len(wrong),
        name=row.point.point_id,
        height=row.point.height,
        ground=level,
    )
    return rows, [], (Question("heights", words, WHOLE_OR_NOT),)


def asked_of_system(
    rows: Sequence[ReadRow], found: PointList, around: Surroundings, name: str
) -> tuple[Question, ...]:
    """Whether heights that seem to be of another system than the block's are its own all the same.

    Args:
        rows: Points of the list in the block's CRS.
        found: The list.
        around: The block's heights.
        name: The list, as the user knows it.
    """
    known = [row.point for row in rows if row.point.role != "plan"]
    if found.reading.height_system == "keep" or not known:
        return ()
    words = None
    if around.ground.heights is not None:
        places = np.array([(one.easting, one.northing) for one in known])
        sigma_m = np.hypot([one.sigma_m[2] for one in known], around.ground.sigma_m)
        heights = np.array([one.height for one in known])
        words = told_offset(name, heights, around.ground.heights(places), sigma_m)
    if words is None and around.ground.system != ELLIPSOIDAL and _above_ellipsoid(found):
        words = say(
            "{file}: the list says that its heights are ellipsoidal, and block.toml [block] "
            "heights does not say so of the block's. Ellipsoidal heights lie about 45 m above "
            "normal heights in Czechia. If the block has other heights, convert the list to them "
            "first.",
            file=name,
        )
    if words is None:
        return ()
    keep = Choice("keep", say("take them as they are: they are heights of the block's system"))
    return (Question("height_system", words, (keep,)),)


def _above_ellipsoid(found: PointList) -> bool:
    """Whether the name of the column of heights, or the CRS, says that they are ellipsoidal."""
    columns = zip(found.table.header, found.reading.columns or (), strict=False)
    named = any(plain_word(head) in ABOVE_ELLIPSOID for head, held in columns if held == "Z")
    crs = found.reading.crs
    return named or (bool(crs) and vertical_of(read_crs(crs, "")) == ELLIPSOIDAL)


def _above(row: ReadRow, ground_m: float) -> RefusedRow:
    """A point whose height no ground has."""
    told = "{name} has {height:.1f} m, where the DEM has {ground:.1f} m."
    cause = say(told, name=row.point.point_id, height=row.point.height, ground=ground_m)
    remedy = say("Check digits, column and unit of its height.")
    return RefusedRow(row.source.number, row.source.text, cause, remedy)


def without_own(
    rows: list[ReadRow], around: Surroundings
) -> tuple[list[ReadRow], list[RefusedRow], tuple[str, ...]]:
    """The rows of new points, those whose name the block gave to another place, and a word.

    An exported list also has points that the block found itself. Where they stand as they stood,
    they are the block's own and no surveyed points.
    """
    new = [row for row in rows if row.point.point_id not in around.taken]
    own: list[str] = []
    refused: list[RefusedRow] = []
    for row in rows:
        point = row.point
        known = around.taken.get(point.point_id)
        if known is None:
            continue
        place = np.array([point.easting, point.northing, point.height])
        if np.abs(place - known).max() <= SAME_M:
            own.append(point.point_id)
        else:
            refused.append(_clashing(row))
    if not own:
        return new, refused, ()
    evidence = say(
        "{count:# point is the block's own and stays|# points are the block's own and stay} as "
        "found, such as {name}.",
        count=len(own),
        name=own[0],
    )
    return new, refused, (evidence,)


def _clashing(row: ReadRow) -> RefusedRow:
    """A point with the name of another."""
    name = row.point.point_id
    cause = say("the block has a point of another kind that is called {name}.", name=name)
    remedy = say("Give the point another name.")
    return RefusedRow(row.source.number, row.source.text, cause, remedy)
