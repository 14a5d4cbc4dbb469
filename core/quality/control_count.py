"""Amount and distribution of control and of ties; `core/quality/rules.py` judges it."""

from collections import Counter
from dataclasses import dataclass
from typing import cast

import numpy as np
import shapely
from jaxtyping import Int

from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.positioning import places_along, strips_of
from core.arrays import PlanPosition
from core.block import Block, footprint

KNOWN_M = 100.0  # design: no photo is steered by less.
"""A coordinate with a larger standard deviation is not known, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeGap:
    """The longest part of the block's edge without a known point."""

    bases: float
    """How long it is, in bases."""
    middle: PlanPosition
    """Where its middle lies, metres."""
    photo_id: str
    """The photo that shows it."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlSpread:
    """How much control there is and where, of one kind."""

    points: int
    """Points in use."""
    gap: EdgeGap
    """The longest part of the edge without one."""
    per_model: float
    """Points inside for each stereo model."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlCount:
    """Control of a block against the rules."""

    base_m: float
    """Median distance of neighbouring photos of a strip, metres."""
    models: int
    """Stereo models: pairs of neighbours in a strip."""
    poorest_strip: tuple[str, int]
    """First photo of the strip with the fewest points, and how many it shows."""
    plan: ControlSpread
    """Points whose plan is known."""
    heights: ControlSpread
    """Points whose height is known."""
    check_share: float
    """Check points among all points that take part."""


@dataclass(frozen=True, slots=True, eq=False)
class RayCounts:
    """How many tie points have how many rays."""

    strip: dict[str, int]
    """Number of the strip of each photo that takes part."""
    within: dict[int, int]
    """Tie points by their rays, all of one strip."""
    across: dict[int, int]
    """Tie points by their rays, of two strips and more."""
    by_photo: dict[str, dict[int, int]]
    """Tie points in each photo by the number of their rays in all."""


def count_control(report: AdjustmentReport) -> ControlCount | None:
    """Hold the control of an adjusted block against the rules.

    Args:
        report: The adjustment; points that took part in it count.

    Returns:
        The counts, or None where no two photos follow one another in a strip.
    """
    block, strip = report.block, ray_counts_of(report).strip
    bases = _bases_m(block, strip)
    if not bases:
        return None
    base = float(np.median(bases))
    plan, heights = known_names(report)
    total = len(report.surveyed_positions) + len(report.checks)
    return ControlCount(
        base,
        len(bases),
        _poorest_strip(report, strip),
        _spread(report, plan, base, len(bases)),
        _spread(report, heights, base, len(bases)),
        len(report.checks) / total if total else 0.0,
    )


def known_names(report: AdjustmentReport) -> tuple[list[str], list[str]]:
    """Control points in use whose plan is known, and those whose height is."""
    known = {name: report.block.surveyed[name].sigma_m for name in report.surveyed_positions}
    plan = [name for name, sigma in known.items() if max(sigma[:2]) < KNOWN_M]
    return plan, [name for name, sigma in known.items() if sigma[2] < KNOWN_M]


def _bases_m(block: Block, strip: dict[str, int]) -> list[float]:
    """Distances of neighbours in all strips, metres."""
    names = list(strip)
    photos = [block.photos[name] for name in names]
    numbers = np.array([strip[name] for name in names], dtype=np.int64)
    along = places_along(photos, numbers)
    found: list[float] = []
    for number in np.unique(numbers).tolist():
        members = np.flatnonzero(numbers == number)
        ordered = members[np.argsort(along[members])]
        centres = np.array([photos[row].exterior.centre[:2] for row in ordered.tolist()])
        found += np.linalg.norm(np.diff(centres, axis=0), axis=1).tolist()
    return found


def _poorest_strip(report: AdjustmentReport, strip: dict[str, int]) -> tuple[str, int]:
    """The strip whose photos show the fewest control points."""
    shown = {
        (strip[item.photo_id], item.point_id)
        for item in report.block.measurements.values()
        if item.used
        and item.key not in report.rejected
        and item.photo_id in strip
        and item.point_id in report.surveyed_positions
    }
    counts = Counter(number for number, _ in shown)
    poorest = min(set(strip.values()), key=lambda number: (counts[number], number))
    return next(name for name, number in strip.items() if number == poorest), counts[poorest]


def _spread(
    report: AdjustmentReport, names: list[str], base_m: float, models: int
) -> ControlSpread:
    """Points at the edge (within a base of it) and inside."""
    block = report.block
    prints = {
        name: footprint(block.photos[name], block.camera_of(name))
        for name in report.exterior_sigmas
    }
    edge = cast("shapely.Polygon", shapely.union_all(list(prints.values())).convex_hull).exterior
    points = [shapely.Point(report.surveyed_positions[name][:2]) for name in names]
    at_edge = [point for point in points if edge.distance(point) <= base_m]
    places = np.sort([edge.project(point) for point in at_edge])
    start, length = _longest_gap(places, edge.length)
    middle = edge.interpolate((start + length / 2) % edge.length)
    nearest = min(prints, key=lambda name: (prints[name].distance(middle), name))
    gap = EdgeGap(length / base_m, np.array([middle.x, middle.y]), nearest)
    return ControlSpread(len(names), gap, (len(points) - len(at_edge)) / models)


def _longest_gap(places: np.ndarray, length: float) -> tuple[float, float]:
    """Start and length of the longest way round a ring between two places on it."""
    if not len(places):
        return 0.0, length
    gaps = np.diff(np.append(places, places[0] + length))
    longest = int(np.argmax(gaps))
    return float(places[longest]), float(gaps[longest])


def ray_counts_of(report: AdjustmentReport) -> RayCounts:
    """Count the rays that took part in an adjustment."""
    block, ties = report.block, report.block.ties
    photos = [block.photos[name] for name in report.exterior_sigmas]
    cameras = [block.camera_of(photo.photo_id) for photo in photos]
    sides = [
        camera.frame_mm[0]
        / camera.principal_distance_mm
        * abs(float(photo.exterior.centre[2]) - photo.ground_height_m)
        for photo, camera in zip(photos, cameras, strict=True)
    ]
    numbers = strips_of(photos, sides).tolist() if photos else []
    strip = {photo.photo_id: number for photo, number in zip(photos, numbers, strict=True)}
    used = np.isfinite(report.tie_residuals_px).all(axis=1)
    point, photo = ties.point[used], ties.photo[used]
    of_photo = np.array([strip.get(name, -1) for name in ties.photo_ids] + [-1])
    rays = np.bincount(point, minlength=ties.count)
    lowest, highest = np.full((2, ties.count), -1)
    lowest[:] = len(photos)
    np.minimum.at(lowest, point, of_photo[photo])
    np.maximum.at(highest, point, of_photo[photo])
    seen = rays > 0
    return RayCounts(
        strip,
        _counted(rays[seen & (lowest == highest)]),
        _counted(rays[seen & (lowest != highest)]),
        {
            name: _counted(rays[point[photo == row]])
            for row, name in enumerate(ties.photo_ids)
            if name in strip
        },
    )


def _counted(rays: Int[np.ndarray, "points"]) -> dict[int, int]:
    counts = np.bincount(rays)
    return {number: int(count) for number, count in enumerate(counts) if count}
