"""Names for array shapes, and the lock that keeps the arrays inside frozen values unchanged."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int, Num

PixelPoints = Float64[np.ndarray, "n 2"]
"""Column right, row down, pixels; the outer corner of the first pixel is (0, 0)."""
FilmPoints = Float64[np.ndarray, "n 2"]
"""x right, y up, millimetres, in the frame of the camera certificate's fiducials."""
ObjectPoints = Float64[np.ndarray, "n 3"]
"""Easting, northing, height in the block's CRS, metres."""
Position = Float64[np.ndarray, "3"]
"""One point: easting, northing, height, metres."""
PlanPosition = Float64[np.ndarray, "2"]
"""One point: easting, northing, metres."""
Rotation = Float64[np.ndarray, "3 3"]
"""A rotation matrix."""
Affine2 = Float64[np.ndarray, "2 3"]
"""Plane affine transform: target = A[:, :2] @ source + A[:, 2]."""
Scalars = Float64[np.ndarray, "n"]
"""One number per row."""
Indices = Int[np.ndarray, "n"]
"""One index per row."""
Flags = Bool[np.ndarray, "n"]
"""One truth value per row."""
Matrix = Float64[np.ndarray, "rows columns"]
"""Any matrix of doubles."""
Raster = Num[np.ndarray, "rows columns"]
"""One band of a raster, row 0 at the top."""
Mask = Bool[np.ndarray, "rows columns"]
"""True where a raster may be used."""


def locked(values: Any, dtype: Any = np.float64) -> np.ndarray:
    """A read-only copy of an array, since a frozen dataclass does not freeze its arrays."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array
