"""What there is to judge in a block: flight, overlaps, ties, control, systematic residuals."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float64
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.positioning import MEASURED_M
from core.arrays import ObjectPoints, Position
from core.block import Block, footprint
from core.quality.control_count import ControlCount, count_control, known_names, ray_counts_of
from core.quality.residuals import (
    CELLS,
    CellCounts,
    FilmCounts,
    UsedRays,
    Vectors,
    count_by_cell,
    mean_pattern,
    rays_taking_part,
    rms_of,
    used_rays,
    worst_pattern,
)

Footprints = Mapping[str, shapely.Polygon]
"""Ground polygon of each photo, metres."""


@dataclass(frozen=True, slots=True)
class PhotoQuality:
    """One photo."""

    photo_id: str
    """The photo."""
    oriented: bool
    """Whether it takes part."""
    tilt_deg: float
    """Of its axis from the vertical, degrees."""
    crab_deg: float
    """Of its side from the direction to its neighbour, degrees; NaN without one."""
    rms_px: float
    """RMS residual per coordinate of everything used in it, pixels; NaN without any."""
    control: int
    """Control measurements in use."""
    ties: int
    """Rays of tie points in use."""
    sigma_m: float
    """Standard deviation of its centre, the largest of three, metres; NaN where unknown."""
    cells: tuple[int, ...]
    """Measurements in use in its nine areas, top row first."""


@dataclass(frozen=True, slots=True)
class Overlap:
    """Two photos that see the same ground."""

    first: str
    """One."""
    second: str
    """The other."""
    share: float
    """Common part of the smaller one."""
    ties: int
    """Tie points in use that both show."""
    along: bool | None
    """Within a strip, between strips, or None for neither (diagonal)."""


@dataclass(frozen=True, slots=True, eq=False)
class BlockQuality:
    """The whole block."""

    photos: tuple[PhotoQuality, ...]
    """Worst first."""
    overlaps: tuple[Overlap, ...]
    """Pairs."""
    rays: Mapping[int, int]
    """Tie points by number of rays."""
    pattern_um: Vectors
    """Mean residual (x right, y up) by cell of the film, top row first, um; NaN without any."""
    pattern_counts: FilmCounts
    """Measurements in each cell."""
    pattern_worst: tuple[str, float, float]
    """The camera with the surest pattern of its own, how many standard deviations a mean residual
    of it stands out, and how large it is, micrometres."""
    parts: tuple[tuple[tuple[str, ...], int], ...]
    """Photos that no tie point joins to the largest part, and control points they show."""
    side_m: float
    """Side of the ground one photo shows, metres."""
    known_plan: tuple[str, ...]
    """Control points in use whose plan is known."""
    known_heights: tuple[str, ...]
    """Those whose height is known."""
    heights_extent_m: tuple[float, float]
    """Extent of the latter along their longest direction, and across it, metres."""
    control_by_flight: bool
    """Centres measured in flight stand for control."""
    control_cells: CellCounts
    """Control points in use in the nine parts of the block's bounds, north row first."""
    control: ControlCount | None
    """Control against the rules; None where no two photos follow one another in a strip."""


def assess_block(report: AdjustmentReport, footprints: Footprints | None = None) -> BlockQuality:
    """Measure an adjusted block; `core/quality/rules.py` judges it.

    Args:
        report: The adjustment.
        footprints: Ground polygon of each photo in the block's CRS; else of level ground.
    """
    if footprints is None:
        cameras = report.block.camera_of
        used = {n: p for n, p in report.block.photos.items() if p.oriented}
        footprints = {name: footprint(photo, cameras(name)) for name, photo in used.items()}
    taking_part = rays_taking_part(report)
    counts_of = ray_counts_of(report)
    overlaps = _overlaps(report.block, footprints, taking_part, counts_of.strip)
    rays = used_rays(report)
    photos = tuple(
        _photo(report, name, overlaps, rays[name], footprints) for name in report.block.photos
    )
    pattern, counts, _ = mean_pattern(report.block, rays)
    plan, heights = known_names(report)
    side = _side_m(report.block)
    return BlockQuality(
        photos=tuple(sorted(photos, key=lambda one: -_badness(one))),
        overlaps=overlaps,
        rays=Counter(counts_of.within) + Counter(counts_of.across),
        pattern_um=pattern,
        pattern_counts=counts,
        pattern_worst=worst_pattern(report.block, rays),
        parts=_parts(report, taking_part),
        side_m=side,
        known_plan=tuple(plan),
        known_heights=tuple(heights),
        heights_extent_m=_extent_m([report.surveyed_positions[name] for name in heights]),
        control_by_flight=_control_by_flight(report.block, side),
        control_cells=_control_cells(report, footprints),
        control=count_control(report),
    )


def _photo(
    report: AdjustmentReport,
    name: str,
    overlaps: tuple[Overlap, ...],
    rays: UsedRays,
    footprints: Footprints,
) -> PhotoQuality:
    photo, sigmas = report.block.photos[name], report.exterior_sigmas.get(name)
    axis = photo.exterior.object_from_image[:, 2]
    return PhotoQuality(
        photo_id=name,
        oriented=photo.oriented,
        tilt_deg=float(np.degrees(np.arccos(np.clip(axis[2], -1.0, 1.0)))),
        crab_deg=_crab_deg(report.block, name, overlaps),
        rms_px=rms_of(rays.residuals),
        control=rays.control,
        ties=len(rays.pixels) - rays.control,
        sigma_m=float("nan") if sigmas is None else float(np.max(sigmas.centre_m)),
        cells=tuple(count_by_cell(report.block, name, rays.pixels).ravel().tolist()),
    )


def _crab_deg(block: Block, name: str, overlaps: tuple[Overlap, ...]) -> float:
    """Angle between a side of the frame and the line to the photo it overlaps most, degrees."""
    mine = [pair for pair in overlaps if name in (pair.first, pair.second) and pair.along]
    if not mine:
        return float("nan")
    best = max(mine, key=lambda pair: pair.share)
    other = best.second if best.first == name else best.first
    line = block.photos[other].exterior.centre - block.photos[name].exterior.centre
    side = block.photos[name].exterior.object_from_image[:2, 0]
    apart = np.degrees(np.arctan2(line[1], line[0]) - np.arctan2(side[1], side[0]))
    # source: a side is nearest to a line within 45 degrees.
    return float(abs((apart + 45.0) % 90.0 - 45.0))


def _overlaps(
    block: Block, footprints: Footprints, taking_part: np.ndarray, strip: Mapping[str, int]
) -> tuple[Overlap, ...]:
    """All pairs whose footprints share more than a twentieth."""
    ties = block.ties
    shown = {
        name: set(ties.point[taking_part & (ties.photo == number)].tolist())
        for number, name in enumerate(ties.photo_ids)
    }
    names = [name for name in block.photos if name in footprints]
    if not names:
        return ()
    polygons = [footprints[name] for name in names]
    touching = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    pairs: list[tuple[str, str, float]] = []
    for i, j in sorted(touching.T.tolist()):
        smaller = min(polygons[i].area, polygons[j].area)
        share = polygons[i].intersection(polygons[j]).area / smaller if smaller > 0 else 0.0
        # design: a twentieth is no overlap that is flown for.
        if i < j and share > 0.05:
            pairs.append((names[i], names[j], share))
    directions = _directions(block, pairs, strip)
    return tuple(
        Overlap(
            first,
            second,
            share,
            len(shown.get(first, set()) & shown.get(second, set())),
            _along(block, first, second, directions),
        )
        for first, second, share in pairs
    )


def _directions(
    block: Block, pairs: list[tuple[str, str, float]], strip: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Unit vector from each photo to the one of its strip, or else of any, it overlaps most."""
    best: dict[str, tuple[bool, float, str]] = {}
    for first, second, share in pairs:
        together = first in strip and strip.get(first) == strip.get(second)
        for one, other in ((first, second), (second, first)):
            best[one] = max(best.get(one, (False, 0.0, "")), (together, share, other))
    return {one: _unit(block, one, other) for one, (*_, other) in best.items()}


def _along(
    block: Block, first: str, second: str, directions: Mapping[str, np.ndarray]
) -> bool | None:
    line = _unit(block, first, second)
    beside = max(abs(float(line @ directions[name])) for name in (first, second))
    # design: within 20 degrees of the strip, or beyond 70.
    return True if beside > 0.94 else False if beside < 0.35 else None


def _unit(block: Block, one: str, other: str) -> np.ndarray:
    line = (block.photos[other].exterior.centre - block.photos[one].exterior.centre)[:2]
    # design: two photos at one place have no direction.
    return line / max(float(np.linalg.norm(line)), 1e-9)


def _parts(
    report: AdjustmentReport, taking_part: np.ndarray
) -> tuple[tuple[tuple[str, ...], int], ...]:
    """All connected parts but the largest, with the control points in use that they show."""
    ties, names = report.block.ties, list(report.exterior_sigmas)
    if len(names) < 2:
        return ()
    row_of = {name: row for row, name in enumerate(names)}
    photo = np.array([row_of.get(name, -1) for name in ties.photo_ids] + [-1])[ties.photo]
    used = taking_part & (photo >= 0)
    size = len(names) + int(ties.count)
    joins = csr_array(
        (np.ones(int(used.sum())), (photo[used], len(names) + ties.point[used])), shape=(size, size)
    )
    number = connected_components(joins, directed=False)[1][: len(names)]
    parts = [[names[i] for i in np.flatnonzero(number == part)] for part in np.unique(number)]
    keys = report.redundancy_numbers
    return tuple(
        (tuple(part), len({key[0] for key in keys if key[1] in part}))
        for part in sorted(parts, key=len, reverse=True)[1:]
    )


def _side_m(block: Block) -> float:
    """Median side of the ground that a photo shows, metres."""
    photos = [photo for photo in block.photos.values() if photo.oriented]
    sides = [photo.width_m(block.camera_of(photo.photo_id)) for photo in photos]
    return float(np.median(sides)) if sides else float("nan")


def _control_by_flight(block: Block, side_m: float) -> bool:
    """Three photos or more, not in a line, whose centres were measured in flight."""
    measured = [
        photo.exterior.centre
        for photo in block.photos.values()
        if photo.oriented and (np.asarray(photo.prior.sigma_centre_m) <= MEASURED_M).all()
    ]
    # design: a tenth of a photo off the line keeps the block from turning about it.
    return len(measured) >= 3 and _extent_m(measured)[1] > 0.1 * side_m


def _extent_m(points: list[Position]) -> tuple[float, float]:
    """Extent in plan along the longest direction and across it, metres."""
    if len(points) < 2:
        return 0.0, 0.0
    places = np.array(points)[:, :2]
    offset = places - places.mean(axis=0)
    turned = offset @ np.linalg.svd(offset, full_matrices=False)[2].T
    return float(np.ptp(turned[:, 0])), float(np.ptp(turned[:, 1]))


def _control_cells(report: AdjustmentReport, footprints: Footprints) -> CellCounts:
    """Control points in use in the nine parts of the block's bounds."""
    counts = np.zeros((CELLS, CELLS), dtype=np.int64)
    points: ObjectPoints = np.array(list(report.surveyed_positions.values())).reshape(-1, 3)
    if not footprints or not len(points):
        return counts
    west, south, east, north = shapely.union_all(list(footprints.values())).bounds
    # design: keeps a division from failing.
    share: Float64[np.ndarray, "n 2"] = (points[:, :2] - (west, south)) / (
        max(east - west, 1e-9),
        max(north - south, 1e-9),
    )
    numbers = np.clip((share * CELLS).astype(np.int64), 0, CELLS - 1)
    np.add.at(counts, (CELLS - 1 - numbers[:, 1], numbers[:, 0]), 1)
    return counts


def _badness(photo: PhotoQuality) -> float:
    """Worst first: not placed, large residuals, empty areas, tilt."""
    # design: a pixel of residual weighs as much as five empty areas, or ten degrees.
    rms = 3.0 if np.isnan(photo.rms_px) else photo.rms_px
    empty = sum(count == 0 for count in photo.cells)
    # design: a pixel of residual weighs as five empty areas, or ten degrees.
    return 10.0 * (not photo.oriented) + rms + 0.2 * empty + 0.1 * photo.tilt_deg
