"""Seams changed by hand: a line that the seam of two photos follows, a photo for a drawn polygon.

Seams are a partition: no two overlap, and nothing that a photo shows is left out. Every edit moves
ground from one part to another, so a partition stays one and covers what it covered.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from core.doubts import Failure
from core.mosaic.seams import Area, Seam

Places = Sequence[tuple[float, float]]
"""Eastings and northings, metres."""
# design: far above the rounding of coordinates of seven digits, far below all that is drawn
ROUNDING_M = 1e-6
"""Where a new seam ends on an old one, its end lies within this beside it, metres."""
# design: far below a pixel, far above what double precision leaves of coordinates of a CRS
SAME_PLACE_M = 1e-3
"""What is narrower is rounding, metres."""
# design: less than any pixel
LEAST_BORDER_M = 0.01
"""A shorter border is a corner, metres."""
# design: less than any pixel
LEAST_M2 = 0.01
"""Less ground than this does not change hands, square metres."""


@dataclass(frozen=True, slots=True)
class SeamLine:
    """The seam between two photos follows a drawn line."""

    first: str
    """One of the photos."""
    second: str
    """The other one."""
    line: tuple[tuple[float, float], ...]
    """Corners of the line, easting and northing, metres."""
    replaces: int = 0
    """Number of the edit that is laid anew by this one; 0 for none."""


@dataclass(frozen=True, slots=True)
class SeamArea:
    """A photo shows what a drawn polygon holds."""

    photo_id: str
    """The photo."""
    outline: tuple[tuple[float, float], ...]
    """Corners of the polygon, easting and northing, metres."""
    replaces: int = 0
    """As of a line."""


SeamEdit = SeamLine | SeamArea
"""One change of the seams by hand."""


def with_edits(
    seams: Sequence[Seam], edits: Sequence[SeamEdit], shown: Mapping[str, Area] | None = None
) -> tuple[Seam, ...]:
    """The seams after some edits, one after the other; one that no longer applies changes nothing.

    Args:
        seams: A partition of what the photos show.
        edits: In the order they were made.
        shown: As for `apply_edit`.
    """
    changed = tuple(seams)
    for edit in edits:
        done = apply_edit(changed, edit, shown)
        changed = changed if isinstance(done, Failure) else done
    return changed


def apply_edit(
    seams: Sequence[Seam], edit: SeamEdit, shown: Mapping[str, Area] | None = None
) -> tuple[Seam, ...] | Failure:
    """The seams after one edit, or why it changes nothing.

    Args:
        seams: A partition.
        edit: The edit.
        shown: The ground that each photo shows, which alone it can be given; a photo that is not
            there shows all it is given.
    """
    if isinstance(edit, SeamLine):
        done = follow_line(seams, edit.first, edit.second, edit.line)
    else:
        done = give_area(seams, edit.photo_id, edit.outline)
    if isinstance(done, Failure):
        return done
    refused = [unshown_ground(old, new, shown or {}) for old, new in zip(seams, done, strict=True)]
    if sum(area.area for area in refused) <= LEAST_M2:
        return done
    kept = _given_back(seams, done, refused)
    if changed_ground(seams, kept).area <= LEAST_M2:
        return Failure("The photo shows nothing of that ground.")
    return kept


def refused_ground_m2(seams: Sequence[Seam], edit: SeamEdit, shown: Mapping[str, Area]) -> float:
    """How much ground an edit means to give to a photo that does not show it, square metres."""
    done = apply_edit(seams, edit)
    if isinstance(done, Failure):
        return 0.0
    refused = (unshown_ground(old, new, shown) for old, new in zip(seams, done, strict=True))
    return float(sum(area.area for area in refused))


def unshown_ground(old: Seam, new: Seam, shown: Mapping[str, Area]) -> Area:
    """What a photo won in its new part though it does not show it."""
    ground = shown.get(new.photo_id)
    if ground is None or new.area is old.area:
        return Polygon()
    return _polygons(new.area.difference(old.area).difference(ground))


def _given_back(
    before: Sequence[Seam], after: Sequence[Seam], refused: Sequence[Area]
) -> tuple[Seam, ...]:
    """The parts after an edit, with what each photo is refused back with whose it was."""
    total = shapely.union_all(refused)
    return tuple(
        replace(
            new,
            area=_polygons(_exchanged(new.area, lost, _polygons(old.area.intersection(total)))),
        )
        for old, new, lost in zip(before, after, refused, strict=True)
    )


def give_area(seams: Sequence[Seam], photo_id: str, outline: Places) -> tuple[Seam, ...] | Failure:
    """Give what a polygon holds of the parts to one photo.

    Args:
        seams: A partition.
        photo_id: The photo that shows it from now on; it must have a part.
        outline: At least three corners.
    """
    if photo_id not in {seam.photo_id for seam in seams}:
        return Failure("The photo has no part in the mosaic.")
    wanted = _polygons(shapely.make_valid(Polygon(outline)))
    taken = _polygons(wanted.intersection(shapely.union_all([seam.area for seam in seams])))
    if taken.area <= LEAST_M2:
        return Failure("The polygon holds nothing of the mosaic.")
    return tuple(
        replace(
            seam,
            area=_polygons(
                seam.area.union(taken) if seam.photo_id == photo_id else seam.area.difference(taken)
            ),
        )
        for seam in seams
    )


def follow_line(
    seams: Sequence[Seam], first: str, second: str, line: Places
) -> tuple[Seam, ...] | Failure:
    """Lay the seam between two photos along a line.

    The line parts what both show; an end inside of it is led to the seam on the shortest way.
    Of the two ways to lay the photos on its sides, that which moves less ground beside what line
    and seam enclose. An end that runs over the seam and would turn that inside out is cut where
    it does.

    Args:
        seams: A partition.
        first: One photo; it borders the other one.
        second: The other photo.
        line: At least two corners.
    """
    parts = {seam.photo_id: seam.area for seam in seams}
    if first not in parts or second not in parts or first == second:
        return Failure("The photos have no seam in common.")
    one, other = parts[first], parts[second]
    seam = _shared(one, other)
    if seam.length <= LEAST_BORDER_M:
        return Failure("The photos have no seam in common.")
    both = one.union(other)
    cost, lost, won = np.inf, Polygon(), Polygon()
    for left_out, kept in _with_ends_cut(LineString(line), both, seam):
        if left_out >= cost:
            break
        found = _moved(one, other, seam, _reaching(kept, both, seam))
        if found is not None and left_out + found[0] < cost:
            cost, lost, won = left_out + found[0], *found[1:]
    if not np.isfinite(cost):
        return Failure("The line does not part the two photos.")
    areas = {
        first: _exchanged(one, lost, won),
        second: _exchanged(other, won, lost),
    }
    return tuple(
        replace(seam, area=_polygons(areas[seam.photo_id])) if seam.photo_id in areas else seam
        for seam in seams
    )


def changed_ground(before: Sequence[Seam], after: Sequence[Seam]) -> Area:
    """Ground that another photo shows after than before."""
    known = {seam.photo_id: seam.area for seam in before}
    return _polygons(
        shapely.union_all(
            [
                seam.area.difference(known.get(seam.photo_id, Polygon()))
                for seam in after
                if not seam.area.equals(known.get(seam.photo_id, Polygon()))
            ]
        )
    )


def photos_along(seams: Sequence[Seam], line: Places) -> tuple[str, str] | None:
    """The two photos whose seam a line most likely means: the pair that it runs through furthest.

    None where it runs through fewer than two parts that border each other.
    """
    drawn = LineString(line)
    # Wide enough to meet the other photo where a line keeps to one side of the seam.
    reach = drawn.buffer(max(drawn.length / 4, SAME_PLACE_M))
    near = [
        (float(seam.area.intersection(drawn).length), seam)
        for seam in seams
        if seam.area.intersects(reach)
    ]
    best: tuple[float, float, tuple[str, str]] | None = None
    for number, (through, seam) in enumerate(near):
        for beyond, neighbour in near[number + 1 :]:
            common = _shared(seam.area, neighbour.area).intersection(reach)
            if through + beyond <= SAME_PLACE_M or common.length <= LEAST_BORDER_M:
                continue
            found = through + beyond, float(common.length), (seam.photo_id, neighbour.photo_id)
            if best is None or found[:2] > best[:2]:
                best = found
    return None if best is None else best[2]


def _with_ends_cut(
    line: LineString, both: BaseGeometry, seam: BaseGeometry
) -> Iterator[tuple[float, LineString]]:
    """The line, whole and cut where it crosses the seam or enters both, with what is left out, m2.

    An end left out counts as its square: no end encloses more with a straight seam.
    """
    crossed = line.intersection(seam.union(both.boundary))
    crossings = shapely.points(shapely.get_coordinates(crossed))
    marks = np.unique(shapely.line_locate_point(line, crossings))
    begins, ends = (
        [
            float(mark)
            for mark, place in zip(over, shapely.line_interpolate_point(line, over), strict=True)
            if place.distance(seam) <= 2 * SAME_PLACE_M or not both.contains(place)
        ]
        for over in (
            np.maximum(marks - SAME_PLACE_M, 0.0),
            np.minimum(marks + SAME_PLACE_M, line.length),
        )
    )
    cuts = sorted(
        (begin**2 + (line.length - end) ** 2, begin, end)
        for begin in (0.0, *begins)
        for end in (*ends, line.length)
        if end - begin > 3 * SAME_PLACE_M
    )
    for left_out, begin, end in cuts:
        yield left_out, LineString(substring(line, begin, end).coords)


def _moved(
    one: Area, other: Area, seam: BaseGeometry, drawn: LineString
) -> tuple[float, Area, Area] | None:
    """What each of two photos loses to the other along a line, and how much is not enclosed, m2."""
    enclosed = shapely.union_all(
        shapely.get_parts(shapely.polygonize(shapely.get_parts(seam.union(drawn))))
    )
    # Ground changes hands only between line and seam, so it borders who gets it.
    faces = [
        [(face, _side(face, drawn)) for face in _faces(area, drawn) if _border(face, goal)]
        for area, goal in ((one, other), (other, one))
    ]
    ways: list[tuple[float, float, Area, Area]] = []
    for left in (1, -1):
        given = [
            [face for face, side in own if side == turn * left]
            for own, turn in zip(faces, (1, -1), strict=True)
        ]
        beside = sum(
            face.area
            for face in chain(*given)
            if not enclosed.contains(face.representative_point())
        )
        lost, won = (_polygons(shapely.union_all(own)) for own in given)
        moved = float(lost.area + won.area)
        if moved > LEAST_M2:
            ways.append((beside, moved, lost, won))
    if not ways:
        return None
    beside, _, lost, won = min(ways, key=lambda way: way[:2])
    return beside, lost, won


def _exchanged(area: Area, lost: Area, won: Area) -> BaseGeometry:
    """An area less one part, with another: ends on its slanted border become corners of it."""
    cornered = shapely.snap(shapely.snap(area, lost, ROUNDING_M), won, ROUNDING_M)
    return cornered.difference(lost).union(won)


def _reaching(line: LineString, both: BaseGeometry, seam: BaseGeometry) -> LineString:
    """The line with ends that lie within both photos led to their seam, and a little over it."""
    corners = [tuple(corner) for corner in line.coords]
    for end, place in ((0, corners[0]), (-1, corners[-1])):
        if not both.contains(Point(place)):
            continue
        foot = shapely.shortest_line(Point(place), seam).coords[-1]
        way = np.subtract(foot, place)
        length = float(np.hypot(*way))
        # An end on the seam itself is led over it in the line's own direction.
        if length <= SAME_PLACE_M:
            inner = corners[1] if end == 0 else corners[-2]
            way = np.subtract(place, inner)
            length = max(float(np.hypot(*way)), SAME_PLACE_M)
        beyond = tuple((np.array(foot) + way / length * SAME_PLACE_M).tolist())
        corners = [beyond, *corners] if end == 0 else [*corners, beyond]
    return LineString(corners)


def _faces(area: Area, line: LineString) -> list[Polygon]:
    """The parts into which a line cuts an area."""
    edges = shapely.union_all([area.boundary, line])
    found = shapely.get_parts(shapely.polygonize(shapely.get_parts(edges)))
    return [face for face in found if area.covers(face.representative_point())]


def _shared(one: Area, other: Area) -> BaseGeometry:
    """The border that two parts have in common."""
    return one.boundary.intersection(other.buffer(SAME_PLACE_M))


def _border(face: Polygon, goal: Area) -> bool:
    """True where a face and a part have more of their borders in common than a corner."""
    return _shared(face, goal).length > LEAST_BORDER_M


def _side(face: Polygon, line: LineString) -> int:
    """On which side of a line a face borders it: 1 left, -1 right, 0 for none but a corner.

    A face that borders it on both sides, because the line ends in it, counts by the longer one.
    """
    ring = face.exterior if face.exterior.is_ccw else face.exterior.reverse()
    corners = shapely.get_coordinates(ring)
    begin, end = shapely.points(corners[:-1]), shapely.points(corners[1:])
    middle = shapely.points((corners[:-1] + corners[1:]) / 2)
    on_line = np.all([shapely.distance(p, line) < SAME_PLACE_M for p in (begin, middle, end)], 0)
    along = shapely.line_locate_point(line, end) - shapely.line_locate_point(line, begin)
    # A ring counterclockwise has its face on the left.
    border = float(np.where(on_line, along, 0.0).sum())
    return 0 if abs(border) <= LEAST_BORDER_M else int(np.sign(border))


def _polygons(geometry: BaseGeometry) -> Area:
    """Only the areas of a geometry, without slivers of rounding."""
    flat = [one for part in shapely.get_parts(geometry) for one in shapely.get_parts(part)]
    kept = [one for one in flat if isinstance(one, Polygon) and one.area > SAME_PLACE_M**2]
    return kept[0] if len(kept) == 1 else MultiPolygon(kept)
