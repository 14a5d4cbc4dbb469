"""How sound a block is: flight, overlaps, ties, control, systematic residuals; judged by limits."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import shapely
from jaxtyping import Float64, Int64

from core.arrays import Indices, ObjectPoints, PixelPoints
from core.block.adjusted import AdjustmentReport
from core.block.block import Block
from core.block.control_rules import ControlCount, ControlLimits, count_control

CELLS = 3
"""Cells a side in which the coverage of a photo is counted: the nine Gruber areas."""
PATTERN_CELLS = 6
"""Cells a side of the film in which residuals are averaged."""
Footprints = Mapping[str, shapely.Polygon]
"""Ground polygon of each photo, metres."""
CellCounts = Int64[np.ndarray, "side side"]
FilmCounts = Int64[np.ndarray, "cells cells"]
Vectors = Float64[np.ndarray, "cells cells 2"]


@dataclass(frozen=True, slots=True)
class QualityLimits:
    """What a block is held against.

    Tilt, crab and overlaps are those of national specifications for aerial survey cameras (tilt at
    most 3 degrees as a rule and 4.5 at most, crab 5 and 7, overlap 56 to 70 % along and 20 to 35 %
    across the strips); the rest are the rules of thumb of the manuals.
    """

    tilt_deg: tuple[float, float] = (3.0, 4.5)
    """As a rule, and at most."""
    crab_deg: tuple[float, float] = (5.0, 7.0)
    """As a rule, and at most."""
    along: tuple[float, float] = (0.56, 0.70)
    """Least and greatest overlap within a strip."""
    across: tuple[float, float] = (0.20, 0.35)
    """Least and greatest overlap between strips."""
    control_cells: int = 6
    """Of the nine cells over the whole block so many need control."""
    control: ControlLimits = field(default_factory=ControlLimits)
    """The rules of aerial triangulation."""
    tie_cells: int = 6
    """Of a photo's nine areas so many need tie points or control."""
    rays: float = 0.4
    """Share of tie points that three photos or more should show."""
    pattern_px: float = 0.3
    """Mean residual of a cell of the film from which it looks systematic, pixels."""
    sigma_nought: tuple[float, float] = (0.5, 1.5)
    """Outside this the weights do not fit the residuals."""


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
    pattern_px: Vectors
    """Mean residual (column, row) by cell of the film, top row first, pixels; NaN without any."""
    pattern_counts: FilmCounts
    """Measurements in each cell."""
    control_cells: CellCounts
    """Control points in use in the nine parts of the block's bounds, north row first."""
    control: ControlCount | None
    """Control against the rules; None where no two photos follow one another in a strip."""


def assess_block(
    report: AdjustmentReport, footprints: Footprints, limits: QualityLimits | None = None
) -> BlockQuality:
    """Measure an adjusted block; `core/block/verdict.py` judges it.

    Args:
        report: The adjustment.
        footprints: Ground polygon of each photo in the block's CRS.
        limits: What it is held against.
    """
    held = limits or QualityLimits()
    taking_part = np.all(np.isfinite(report.tie_residuals_px), axis=1)
    overlaps = _overlaps(report.block, footprints, taking_part)
    rays = _used_rays(report, taking_part)
    photos = tuple(
        _photo(report, name, overlaps, rays[name], footprints) for name in report.block.photos
    )
    pattern, counts = _pattern(report.block, rays)
    return BlockQuality(
        photos=tuple(sorted(photos, key=lambda one: -_badness(one, held))),
        overlaps=overlaps,
        rays=_ray_counts(report, taking_part),
        pattern_px=pattern,
        pattern_counts=counts,
        control_cells=_control_cells(report, footprints),
        control=count_control(report),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """What is used in one photo."""

    pixels: PixelPoints
    residuals: PixelPoints
    control: int


def _used_rays(report: AdjustmentReport, taking_part: np.ndarray) -> dict[str, _Rays]:
    """Pixels and residuals of control and ties in use, by photo."""
    block, ties = report.block, report.block.ties
    numbers = {name: number for number, name in enumerate(ties.photo_ids)}
    control: dict[str, list[tuple[float, ...]]] = {name: [] for name in block.photos}
    for key, item in block.measurements.items():
        point, residual = block.surveyed.get(key[0]), report.residuals_px.get(key)
        if point is None or residual is None or not item.used or key in report.rejected:
            continue
        if point.role == "control" and key[1] in control:
            control[key[1]].append((item.column, item.row, *residual))
    found: dict[str, _Rays] = {}
    for name in block.photos:
        mine: Indices = np.flatnonzero(taking_part & (ties.photo == numbers.get(name, -1)))
        points = np.array(control[name], dtype=np.float64).reshape(-1, 4)
        found[name] = _Rays(
            np.vstack([points[:, :2], ties.pixels[mine]]),
            np.vstack([points[:, 2:], report.tie_residuals_px[mine]]),
            len(points),
        )
    return found


def _photo(
    report: AdjustmentReport,
    name: str,
    overlaps: tuple[Overlap, ...],
    rays: _Rays,
    footprints: Footprints,
) -> PhotoQuality:
    photo, sigmas = report.block.photos[name], report.exterior_sigmas.get(name)
    axis = photo.exterior.object_from_image[:, 2]
    rms = float(np.sqrt(np.mean(rays.residuals**2))) if len(rays.residuals) else float("nan")
    return PhotoQuality(
        photo_id=name,
        oriented=photo.oriented,
        tilt_deg=float(np.degrees(np.arccos(np.clip(axis[2], -1.0, 1.0)))),
        crab_deg=_crab_deg(report.block, name, overlaps),
        rms_px=rms,
        control=rays.control,
        ties=len(rays.pixels) - rays.control,
        sigma_m=float("nan") if sigmas is None else float(np.max(sigmas.centre_m)),
        cells=tuple(_cells(report.block, name, rays.pixels, CELLS).ravel().tolist()),
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
    return float(abs((apart + 45.0) % 90.0 - 45.0))


def _overlaps(block: Block, footprints: Footprints, taking_part: np.ndarray) -> tuple[Overlap, ...]:
    """All pairs whose footprints share more than a twentieth."""
    ties = block.ties
    shown = {
        name: set(ties.point[taking_part & (ties.photo == number)].tolist())
        for number, name in enumerate(ties.photo_ids)
    }
    names = [name for name in block.photos if name in footprints]
    polygons = [footprints[name] for name in names]
    touching = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    pairs: list[tuple[str, str, float]] = []
    for i, j in sorted(touching.T.tolist()):
        smaller = min(polygons[i].area, polygons[j].area)
        share = polygons[i].intersection(polygons[j]).area / smaller if smaller > 0 else 0.0
        if i < j and share > 0.05:
            pairs.append((names[i], names[j], share))
    directions = _directions(block, pairs)
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


def _directions(block: Block, pairs: list[tuple[str, str, float]]) -> dict[str, np.ndarray]:
    """Unit vector from each photo to the one it overlaps most: the direction of its strip."""
    best: dict[str, tuple[float, str]] = {}
    for first, second, share in pairs:
        for one, other in ((first, second), (second, first)):
            if share > best.get(one, (0.0, ""))[0]:
                best[one] = share, other
    return {one: _unit(block, one, other) for one, (_, other) in best.items()}


def _along(
    block: Block, first: str, second: str, directions: Mapping[str, np.ndarray]
) -> bool | None:
    line = _unit(block, first, second)
    beside = max(abs(float(line @ directions[name])) for name in (first, second))
    return True if beside > 0.94 else False if beside < 0.35 else None


def _unit(block: Block, one: str, other: str) -> np.ndarray:
    line = (block.photos[other].exterior.centre - block.photos[one].exterior.centre)[:2]
    return line / max(float(np.linalg.norm(line)), 1e-9)


def _cells(block: Block, name: str, pixels: PixelPoints, side: int) -> CellCounts:
    """Measurements in the cells of a photo's frame, top row first."""
    across, down = _cell_numbers(block, name, pixels, side)
    counts = np.zeros((side, side), dtype=np.int64)
    np.add.at(counts, (down, across), 1)
    return counts


def _cell_numbers(
    block: Block, name: str, pixels: PixelPoints, side: int
) -> tuple[Indices, Indices]:
    frame = np.array(block.camera_of(name).frame_mm)
    share = block.photos[name].interior.film_from_pixel(pixels) / frame + 0.5
    numbers = np.clip((share * side).astype(np.int64), 0, side - 1)
    return numbers[:, 0], side - 1 - numbers[:, 1]


def _pattern(block: Block, rays: Mapping[str, _Rays]) -> tuple[Vectors, FilmCounts]:
    """Residuals of all photos averaged by cell of the film: what is left is systematic."""
    side = PATTERN_CELLS
    sums, counts = np.zeros((side, side, 2)), np.zeros((side, side), dtype=np.int64)
    for name, used in rays.items():
        across, down = _cell_numbers(block, name, used.pixels, side)
        np.add.at(sums, (down, across), used.residuals)
        np.add.at(counts, (down, across), 1)
    mean = sums / np.maximum(counts, 1)[..., None]
    mean[counts == 0] = np.nan
    return mean, counts


def _ray_counts(report: AdjustmentReport, taking_part: np.ndarray) -> dict[int, int]:
    ties = report.block.ties
    rays = np.bincount(ties.point[taking_part], minlength=1)
    counts = np.bincount(rays[rays > 1])
    return {number: int(count) for number, count in enumerate(counts) if count}


def _control_cells(report: AdjustmentReport, footprints: Footprints) -> CellCounts:
    """Control points in use in the nine parts of the block's bounds."""
    counts = np.zeros((CELLS, CELLS), dtype=np.int64)
    points: ObjectPoints = np.array(list(report.surveyed_positions.values())).reshape(-1, 3)
    if not footprints or not len(points):
        return counts
    west, south, east, north = shapely.union_all(list(footprints.values())).bounds
    share: Float64[np.ndarray, "n 2"] = (points[:, :2] - (west, south)) / (
        max(east - west, 1e-9),
        max(north - south, 1e-9),
    )
    numbers = np.clip((share * CELLS).astype(np.int64), 0, CELLS - 1)
    np.add.at(counts, (CELLS - 1 - numbers[:, 1], numbers[:, 0]), 1)
    return counts


def _badness(photo: PhotoQuality, limits: QualityLimits) -> float:
    """Worst first: not placed, large residuals, empty areas, tilt."""
    rms = 3.0 if np.isnan(photo.rms_px) else photo.rms_px
    empty = sum(count == 0 for count in photo.cells)
    return 10.0 * (not photo.oriented) + rms + 0.2 * empty + photo.tilt_deg / limits.tilt_deg[1] / 2
