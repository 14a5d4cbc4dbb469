"""Residuals of the measurements in use, by photo, film, radius and height; and of georeferences."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Indices, PixelPoints, PlanPosition, Scalars
from core.block import Block, Photo
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.transforms import fit_similarity, rotation_and_scale

CELLS = 3  # source: the nine Gruber areas of a photo.
"""Cells a side in which the coverage of a photo is counted."""
PATTERN_CELLS = 6  # design: 30 mm of a film of 18 cm, which lens and film bend over.
"""Cells a side of the film in which residuals are averaged."""
TREND_PARTS = 8  # design: a distortion polynomial bends twice at most.
"""Parts of equal count in which residuals are averaged by radius and by height."""
MEAN_OF = 20  # design: their mean is four times as sure as one residual.
"""Residuals at least that a cell's mean is taken from."""
CellCounts = Int64[np.ndarray, "side side"]
FilmCounts = Int64[np.ndarray, "cells cells"]
Vectors = Float64[np.ndarray, "cells cells 2"]


@dataclass(frozen=True, slots=True, eq=False)
class UsedRays:
    """What is used in one photo."""

    pixels: PixelPoints
    residuals: PixelPoints
    heights: Scalars
    """Of the ground, metres."""
    control: int


# source: the nine Gruber places of a photo.
SHARES = np.stack(np.meshgrid([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]), axis=-1).reshape(-1, 2)
"""Places over the frame, shares of its width and height."""


@dataclass(frozen=True, slots=True, eq=False)
class Displacement:
    """From the approximate orientation to the present one, on level ground under the frame."""

    shift_m: PlanPosition
    """Mean shift, easting and northing, metres."""
    turn: float
    """Turn, radians, counter-clockwise."""
    scale: float
    """Change of scale, 1 = none."""
    rms_m: float
    """RMS of the shifts over the frame, metres."""


def rays_taking_part(report: AdjustmentReport) -> np.ndarray:
    """True for every ray of a tie point that has a residual."""
    return np.all(np.isfinite(report.tie_residuals_px), axis=1)


def used_rays(
    report: AdjustmentReport, names: Collection[str] | None = None
) -> dict[str, UsedRays]:
    """Control and ties in use, by photo; of all photos by default."""
    block, ties, taking_part = report.block, report.block.ties, rays_taking_part(report)
    numbers = {name: number for number, name in enumerate(ties.photo_ids)}
    wanted = block.photos if names is None else names
    control: dict[str, list[tuple[float, ...]]] = {name: [] for name in wanted}
    for key, item in block.measurements.items():
        point, residual = block.surveyed.get(key[0]), report.residuals_px.get(key)
        if point is None or residual is None or not item.used or key in report.rejected:
            continue
        if point.role == "control" and key[1] in control:
            control[key[1]].append((item.column, item.row, *residual, point.position[2]))
    found: dict[str, UsedRays] = {}
    for name in wanted:
        mine: Indices = np.flatnonzero(taking_part & (ties.photo == numbers.get(name, -1)))
        points = np.array(control[name], dtype=np.float64).reshape(-1, 5)
        found[name] = UsedRays(
            np.vstack([points[:, :2], ties.pixels[mine]]),
            np.vstack([points[:, 2:4], report.tie_residuals_px[mine]]),
            np.append(points[:, 4], report.tie_positions[ties.point[mine], 2]),
            len(points),
        )
    return found


def rms_of(residuals: PixelPoints) -> float:
    """Per coordinate; NaN without any."""
    return float(np.sqrt(np.mean(residuals**2))) if len(residuals) else float("nan")


def film_patterns(report: AdjustmentReport) -> dict[str, tuple[Vectors, FilmCounts]]:
    """Mean residual (film axes, micrometres) by cell of each photo's film, and how many make it.

    Args:
        report: The adjustment.
    """
    rays = used_rays(report)
    return {name: mean_pattern(report.block, {name: used})[:2] for name, used in rays.items()}


def area_counts(report: AdjustmentReport) -> dict[str, CellCounts]:
    """Measurements in use in the nine Gruber areas of each photo, top row first.

    Args:
        report: The adjustment.
    """
    rays = used_rays(report)
    return {name: count_by_cell(report.block, name, used.pixels) for name, used in rays.items()}


@dataclass(frozen=True, slots=True)
class PhotoFit:
    """How well one photo fits what is measured in it."""

    rms_px: float
    """RMS residual per coordinate of everything used in it, pixels; NaN without any."""
    control: int
    """Control measurements in use."""
    ties: int
    """Rays of tie points in use."""


def photo_fit(report: AdjustmentReport, photo_id: str) -> PhotoFit:
    """Residuals of one photo of an adjusted block.

    Args:
        report: The adjustment.
        photo_id: The photo.
    """
    used = used_rays(report, (photo_id,))[photo_id]
    return PhotoFit(rms_of(used.residuals), used.control, len(used.pixels) - used.control)


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """Radial residuals against what they may depend on."""

    along: Float64[np.ndarray, " parts"]
    """Median of each part: radius on the film in millimetres, or height in metres."""
    mean_px: Float64[np.ndarray, " parts"]
    """Mean radial residual, outwards, pixels."""
    sigma_px: Float64[np.ndarray, " parts"]
    """Standard deviation of that mean, pixels."""
    count: int
    """Residuals in all parts."""


def residual_trends(report: AdjustmentReport) -> dict[str, Trend]:
    """Radial residuals of ties and control in use by `radius` and by `height`.

    Distortion that nobody took out is a trend along the radius; an error of scale that heights
    hide, or of the heights, is one along the height. Nothing where too few are in use.

    Args:
        report: The adjustment.
    """
    parts: list[np.ndarray] = []
    for name, used in used_rays(report).items():
        photo, camera = report.block.photos[name], report.block.camera_of(name)
        middle = np.array([camera.principal_point_mm])
        outwards = used.pixels - photo.interior.pixel_from_film(middle)
        radius = np.linalg.norm(photo.interior.film_from_pixel(used.pixels) - middle, axis=1)
        with np.errstate(invalid="ignore"):
            outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
        radial = np.sum(used.residuals * outwards, axis=1)
        parts.append(np.column_stack([radius, used.heights, radial]))
    found = np.vstack(parts) if parts else np.zeros((0, 3))
    found = found[np.isfinite(found).all(axis=1)]
    if len(found) < TREND_PARTS * MEAN_OF:
        return {}
    return {"radius": _trend(found[:, 0], found[:, 2]), "height": _trend(found[:, 1], found[:, 2])}


def _trend(along: Scalars, radial: Scalars) -> Trend:
    cells = np.array_split(np.argsort(along, kind="stable"), TREND_PARTS)
    return Trend(
        np.array([np.median(along[cell]) for cell in cells]),
        np.array([np.mean(radial[cell]) for cell in cells]),
        np.array([np.std(radial[cell]) / np.sqrt(len(cell)) for cell in cells]),
        len(along),
    )


def count_by_cell(block: Block, name: str, pixels: PixelPoints) -> CellCounts:
    """Measurements in the Gruber areas of a photo, top row first."""
    across, down = _cell_numbers(block, name, pixels, CELLS)
    counts = np.zeros((CELLS, CELLS), dtype=np.int64)
    np.add.at(counts, (down, across), 1)
    return counts


def _cell_numbers(
    block: Block, name: str, pixels: PixelPoints, side: int
) -> tuple[Indices, Indices]:
    frame = np.array(block.camera_of(name).frame_mm)
    share = block.photos[name].interior.film_from_pixel(pixels) / frame + 0.5
    numbers = np.clip((share * side).astype(np.int64), 0, side - 1)
    return numbers[:, 0], side - 1 - numbers[:, 1]


def mean_pattern(block: Block, rays: Mapping[str, UsedRays]) -> tuple[Vectors, FilmCounts, Vectors]:
    """Residuals of all photos averaged by cell of the film: what is left is systematic.

    Along the axes of the film, x right and y up, micrometres: scans may lie on it in any way. Also
    each mean in its standard deviations, nought where few residuals make it.
    """
    side = PATTERN_CELLS
    sums, counts = np.zeros((side, side, 2)), np.zeros((side, side), dtype=np.int64)
    parts = [np.zeros((0, 2))]
    for name, used in rays.items():
        across, down = _cell_numbers(block, name, used.pixels, side)
        film = block.photos[name].interior.film_from_pixel
        parts.append(1000 * (film(used.pixels + used.residuals) - film(used.pixels)))
        np.add.at(sums, (down, across), parts[-1])
        np.add.at(counts, (down, across), 1)
    mean, every = sums / np.maximum(counts, 1)[..., None], np.concatenate(parts)
    spread = float(np.sqrt(np.mean(every**2))) if len(every) else 0.0
    # design: residuals of nought have no pattern.
    test = np.abs(mean) * np.sqrt(counts)[..., None] / max(spread, 1e-9)
    test[counts < MEAN_OF] = 0.0
    mean[counts == 0] = np.nan
    return mean, counts, test


def worst_pattern(block: Block, rays: Mapping[str, UsedRays]) -> tuple[str, float, float]:
    """The camera whose films have the surest pattern, its test, and the largest mean in um."""
    found = ("", 0.0, 0.0)
    for camera in sorted({photo.camera for photo in block.photos.values()}):
        own = {name: used for name, used in rays.items() if block.photos[name].camera == camera}
        mean, counts, test = mean_pattern(block, own)
        lengths = np.linalg.norm(mean[counts >= MEAN_OF], axis=1)
        if test.max() >= found[1]:
            found = camera, float(test.max()), float(lengths.max(initial=0.0))
    return found


def displacement(photo: Photo, camera: Camera) -> Displacement:
    """How far the photo's approximate orientation showed the ground from where it lies.

    Args:
        photo: With the orientation it came with and the one it has now.
        camera: Its camera.
    """
    pixels = SHARES * np.array(photo.size_px)
    heights = np.full(len(pixels), photo.ground_height_m)
    believed = replace(photo, exterior=photo.approximate)
    before = believed.object_from_pixel(pixels, heights, camera)[:, :2]
    after = photo.object_from_pixel(pixels, heights, camera)[:, :2]
    apart = after - before
    fitted = fit_similarity(before, after)
    turn, scale = (0.0, 1.0) if isinstance(fitted, Failure) else rotation_and_scale(fitted.matrix)
    rms = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
    return Displacement(apart.mean(axis=0), turn, scale, rms)
