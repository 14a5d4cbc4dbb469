"""The frames coordinates live in, and the only half-pixel of the project.

pixel: column right, row down, outer corner of the first pixel (0, 0), its centre (0.5, 0.5).
film: x right, y up, millimetres, in the frame of the fiducials' certificate (or of the frame's
middle where there is none); the principal point is a point of this frame.
object: easting, northing, height in the block's CRS, metres, float64.
local: object minus the block's origin; the only frame that is sent to a screen.
grid: column, row of a raster product, counted like pixel.
"""

import numpy as np
from jaxtyping import Float64

from core.arrays import ObjectPoints, PixelPoints, Position

HALF_PIXEL = 0.5  # source: definition; the outer corner and the centre of a pixel.


def opencv_from_pixel(points: PixelPoints) -> PixelPoints:
    """OpenCV counts from the centre of the first pixel, we from its outer corner."""
    return points - HALF_PIXEL


def pixel_from_opencv(points: Float64[np.ndarray, "n 2"]) -> PixelPoints:
    """Back from OpenCV's centre origin to the outer corner."""
    return points + HALF_PIXEL


def local_from_object(points: ObjectPoints, origin: Position) -> ObjectPoints:
    """Object points relative to the block's origin, small enough for single precision."""
    return points - origin


def object_from_local(points: ObjectPoints, origin: Position) -> ObjectPoints:
    """Object points from points relative to the block's origin."""
    return points + origin
