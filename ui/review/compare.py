"""One measurement in both pictures: predicted and measured place, and the other peaks.

The right picture is the scan warped to the ground with the orientation it was *drawn* with, which
lags behind the newest adjustment by at most a third of a pixel, so that tiles are not made anew
after every decision. Everything laid over it passes through the same drawn orientation.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import ObjectPoints, PixelPoints
from core.block import Block, Photo
from core.control.likeness import Likeness
from core.doubts import Failure
from core.geometry.camera import Camera
from core.raster.dem import HeightSource
from sessions.checks import results_digest
from ui.review.state import DeskState, Key, Made

REDRAW_PX = 0.3
"""A photo is drawn anew when the newest orientation moves it by more than this, scan pixels."""
PlanePoints = Float64[np.ndarray, "n 2"]
"""Easting and northing, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnPhoto:
    """One photo as its tiles are drawn."""

    photo: Photo
    """With the orientation of the tiles."""
    camera: Camera
    """With the constants of the tiles."""
    version: int
    """Counts up whenever the tiles change; part of their address."""


Drawn = Mapping[str, DrawnPhoto]
LikenessSource = Callable[[Photo, Camera, ObjectPoints], Likeness | Failure]
"""(photo, camera, position (1, 3)) -> how alike reference and scan are about that position."""


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """What is laid over the two pictures for one measurement."""

    key: Key
    """Point and photo."""
    version: int
    """Version of the photo's tiles."""
    surveyed: PlanePoints
    """The surveyed point itself, (1, 2), as the ortho shows it."""
    predicted: PlanePoints
    """Where the orientation puts it in the warped scan, (1, 2)."""
    measured: PlanePoints
    """Where it is measured, in the warped scan, (1, 2)."""
    peaks: PlanePoints
    """Every candidate, in the warped scan, best first."""
    predicted_px: PixelPoints
    """Predicted place in the raw scan, (1, 2)."""
    measured_px: PixelPoints
    """Measured place in the raw scan, (1, 2)."""
    peaks_px: PixelPoints
    """Candidates in the raw scan."""
    pixel_from_ground: Float64[np.ndarray, "2 2"]
    """Scan pixels per metre east and per metre north at the point."""


def drawn_from_block(block: Block) -> Drawn:
    """Every photo as it is drawn first."""
    return {
        name: DrawnPhoto(photo, block.camera_of(name), 1) for name, photo in block.photos.items()
    }


def redrawn(drawn: Drawn, oriented: Block) -> Drawn:
    """The drawn photos, with a new version where the newest orientation moved them visibly."""
    fresh = dict(drawn)
    for name, photo in oriented.photos.items():
        camera = oriented.camera_of(name)
        old = drawn.get(name)
        if old is None:
            fresh[name] = DrawnPhoto(photo, camera, 1)
        elif shift_px(old.photo, old.camera, photo, camera) > REDRAW_PX:
            fresh[name] = DrawnPhoto(photo, camera, old.version + 1)
    return fresh


def shift_px(old: Photo, old_camera: Camera, new: Photo, new_camera: Camera) -> float:
    """Largest shift of nine ground points of a photo between two orientations, scan pixels."""
    columns, rows = old.size_px
    across, down = np.meshgrid(np.linspace(0, columns, 3), np.linspace(0, rows, 3))
    corners = np.column_stack([across.ravel(), down.ravel()])
    heights = np.full(len(corners), old.ground_height_m)
    ground = old.object_from_pixel(corners, heights, old_camera)
    moved = new.pixel_from_object(ground, new_camera)
    shift = np.linalg.norm(moved - corners, axis=1)
    return float(np.max(shift)) if np.all(np.isfinite(shift)) else float("inf")


def ground_from_pixel(
    pixels: PixelPoints, drawn: DrawnPhoto, dem: HeightSource, height_m: float
) -> ObjectPoints:
    """Where the rays of scan pixels meet the DEM; starts at `height_m`, kept over gaps."""
    heights = np.full(len(pixels), height_m)
    for _ in range(5):
        ground = drawn.photo.object_from_pixel(pixels, heights, drawn.camera)
        found = dem.heights(ground[:, :2])
        heights = np.where(np.isfinite(found), found, height_m)
    return drawn.photo.object_from_pixel(pixels, heights, drawn.camera)


def pixel_from_ground(plane: PlanePoints, drawn: DrawnPhoto, dem: HeightSource) -> PixelPoints:
    """Scan pixels of places in the warped scan: the DEM's height, then the orientation."""
    heights = dem.heights(plane)
    heights = np.where(np.isfinite(heights), heights, drawn.photo.ground_height_m)
    return drawn.photo.pixel_from_object(np.column_stack([plane, heights]), drawn.camera)


def overlay_of(state: DeskState, drawn: Drawn, dem: HeightSource, key: Key) -> Overlay | None:
    """What is laid over the pictures for one measurement; None when it is gone."""
    measurement, point = state.measurement_of(key), state.point_of(key[0])
    if measurement is None or point is None or key[1] not in drawn:
        return None
    picture = drawn[key[1]]
    oriented = state.oriented
    position = point.position[None, :]
    predicted_px = oriented.photos[key[1]].pixel_from_object(position, oriented.camera_of(key[1]))
    peaks_px = np.array([[p.column, p.row] for p in measurement.peaks]).reshape(-1, 2)
    height = float(point.position[2])
    pixels = np.vstack([predicted_px, measurement.pixel, peaks_px])
    plane = ground_from_pixel(pixels, picture, dem, height)[:, :2]
    steps = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    around = picture.photo.pixel_from_object(position + steps, picture.camera)
    return Overlay(
        key=key,
        version=picture.version,
        surveyed=position[:, :2],
        predicted=plane[:1],
        measured=plane[1:2],
        peaks=plane[2:],
        predicted_px=predicted_px,
        measured_px=measurement.pixel,
        peaks_px=peaks_px,
        pixel_from_ground=np.column_stack([around[1] - around[0], around[2] - around[0]]),
    )


def stale_photos(state: DeskState, tolerance_m: float) -> tuple[str, ...]:
    """Photos whose ortho was made with an orientation more than `tolerance_m` away, or unmasked."""
    oriented = state.oriented
    stale: list[str] = []
    for name, photo in oriented.photos.items():
        if name not in state.made or not photo.oriented:
            continue
        camera = oriented.camera_of(name)
        metres = shift_px(*state.made[name], photo, camera) * photo.ground_pixel_m(camera)
        if metres > tolerance_m or state.made[name][0].mask != photo.mask:
            stale.append(name)
    return tuple(stale)


def with_made(state: DeskState, photo_ids: tuple[str, ...], report: AdjustmentReport) -> DeskState:
    """The state once results, and the orthos of some photos, were made with an adjustment."""
    fresh = made_with(replace(state, report=report).oriented)
    made = {**state.made, **{name: fresh[name] for name in photo_ids}}
    return replace(state, made=made, written_of=results_digest(report))


def made_with(oriented: Block) -> Made:
    """All orthos as if made with the orientations of a block."""
    return {name: (photo, oriented.camera_of(name)) for name, photo in oriented.photos.items()}
