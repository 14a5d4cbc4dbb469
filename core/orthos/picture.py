"""The part of a scan that shows the ground, on the film, in the scan, and on the terrain."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Int32, UInt8
from shapely import segmentize
from shapely.geometry import Polygon, box

from core.arrays import FilmPoints, Mask, ObjectPoints, PixelPoints
from core.block import Photo
from core.frames import opencv_from_pixel
from core.geometry.camera import Camera
from core.orthos.lattice import Heights

MASK_STEP_MM = 0.2
"""The mask is drawn with pixels of about this size on the film."""
FAR = 32000.0
"""Mask pixels beyond this would wrap around inside OpenCV."""


def footprint_of(
    photo: Photo, camera: Camera, dem: Heights, margin_mm: float = 0.0, per_side: int = 16
) -> Polygon:
    """Outline of the picture area on the terrain, in the block's CRS.

    Each ray of the outline goes down to the DEM by iteration; where the DEM has no height, to the
    mean ground height of the photo.
    """
    outline = picture_area_mm(photo, camera, margin_mm)
    dense = segmentize(outline.exterior, max(camera.frame_mm) / per_side)
    film: FilmPoints = np.array(dense.coords, dtype=np.float64)
    polygon = Polygon(_down_to_terrain(photo, camera, dem, film)[:, :2])
    if polygon.is_valid:
        return polygon
    hull = polygon.convex_hull
    assert isinstance(hull, Polygon)
    return hull


def _down_to_terrain(photo: Photo, camera: Camera, dem: Heights, film: FilmPoints) -> ObjectPoints:
    """Where the rays of film points meet the DEM."""
    pixels = photo.interior.pixel_from_film(film)
    heights = np.full(len(film), photo.ground_height_m)
    points = photo.object_from_pixel(pixels, heights, camera)
    for _ in range(30):
        found = dem.heights(points[:, :2])
        wanted = np.where(np.isfinite(found), found, photo.ground_height_m)
        if np.max(np.abs(wanted - heights)) < 0.01:
            break
        # Half steps: a full step swings for ever where the slope is as steep as the ray.
        heights = (wanted + heights) / 2
        points = photo.object_from_pixel(pixels, heights, camera)
    return points


def picture_area_mm(photo: Photo, camera: Camera, margin_mm: float) -> Polygon:
    """The picture area as far as it was scanned, less a margin along its edge, film mm."""
    width, height = (side / 2 - margin_mm for side in camera.frame_mm)
    columns, rows = photo.size_px
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], dtype=np.float64)
    scanned = Polygon(photo.interior.film_from_pixel(corners))
    area = box(-width, -height, width, height).intersection(scanned)
    assert isinstance(area, Polygon)
    return area


@dataclass(frozen=True, slots=True, eq=False)
class PictureMask:
    """Which pixels of a scan show the ground, drawn at a reduction."""

    values: UInt8[np.ndarray, "rows columns"]
    """255 where the scan may be used."""
    reduction: float
    """Scan pixels per mask pixel, along each axis."""

    def at(
        self,
        columns: Float32[np.ndarray, "r c"],
        rows: Float32[np.ndarray, "r c"],
        origin: tuple[int, int],
    ) -> Mask:
        """True where scan places (counted from an origin) are usable; NaN never is."""
        if self._holds_all(columns, rows, origin):
            return np.ones(columns.shape, dtype=bool)
        places = [
            (values + np.float32(start)) * np.float32(1 / self.reduction) - np.float32(0.5)
            for values, start in zip((columns, rows), origin, strict=True)
        ]
        for values in places:
            np.nan_to_num(values, copy=False, nan=-9.0)
            np.clip(values, -9.0, FAR, out=values)
        found = cv2.remap(self.values, places[0], places[1], cv2.INTER_NEAREST, borderValue=(0,))
        return np.asarray(found > 0)

    def _holds_all(
        self,
        columns: Float32[np.ndarray, "r c"],
        rows: Float32[np.ndarray, "r c"],
        origin: tuple[int, int],
    ) -> bool:
        """True when the mask has no gap around all places, as for most tiles of an ortho."""
        window: list[slice] = []
        for values, start, size in zip(
            (rows, columns), origin[::-1], self.values.shape, strict=True
        ):
            low = (float(values.min()) + start) / self.reduction
            high = (float(values.max()) + start) / self.reduction
            if not (low >= 1 and high < size - 1):
                return False
            window.append(slice(int(low) - 1, int(high) + 2))
        return bool(self.values[window[0], window[1]].all())


def picture_mask(
    photo: Photo, camera: Camera, margin_mm: float, mark_radius_mm: float, usable: Mask | None
) -> PictureMask:
    """The picture area less a margin, less discs around the fiducials, less what is not usable.

    Args:
        photo: The photo.
        camera: Its camera.
        margin_mm: Strip along the edge of the picture area, millimetres.
        mark_radius_mm: Radius around each fiducial, millimetres.
        usable: True where the scan may be shown, over the whole scan at any reduction.

    Returns:
        The mask.
    """
    reduction = max(1.0, float(np.floor(MASK_STEP_MM / photo.interior.pixel_size_mm)))
    columns, rows = (int(np.ceil(size / reduction)) for size in photo.size_px)
    mask = np.zeros((rows, columns), dtype=np.uint8)
    area: FilmPoints = np.array(picture_area_mm(photo, camera, margin_mm).exterior.coords)
    corners = _sixteenths(photo.interior.pixel_from_film(area) / reduction)
    cv2.fillPoly(mask, [corners], (255,), shift=4)
    if camera.fiducials_mm:
        marks = np.array(list(camera.fiducials_mm.values()), dtype=np.float64)
        radius = mark_radius_mm / photo.interior.pixel_size_mm / reduction
        for x, y in _sixteenths(photo.interior.pixel_from_film(marks) / reduction).tolist():
            cv2.circle(mask, (x, y), round(radius * 16), (0,), cv2.FILLED, shift=4)
    if usable is not None:
        shown = cv2.resize(
            usable.astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST
        )
        mask[np.asarray(shown) == 0] = 0
    return PictureMask(mask, reduction)


def _sixteenths(points: PixelPoints) -> Int32[np.ndarray, "n 2"]:
    """Pixels as OpenCV draws them: counted from the centre, integers with four binary places."""
    return np.rint(opencv_from_pixel(points) * 16).astype(np.int32)
