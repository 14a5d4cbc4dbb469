"""A mosaic in which one photo lies elsewhere than it should."""

from pathlib import Path

import numpy as np
import rasterio
from rasterio.features import rasterize

from core.mosaic.seams import Seam


def displaced(source: Path, target: Path, seam: Seam, pixels: tuple[int, int]) -> Path:
    """A copy of a mosaic that shows one photo's part so many pixels (right, up) off."""
    with rasterio.open(source) as file:
        values, transform = file.read(1), file.transform
        kept = {key: file.profile[key] for key in ("width", "height", "crs", "dtype", "nodata")}
    inside = rasterize([seam.area], values.shape, transform=transform).astype(bool)
    right, up = pixels
    moved = np.roll(values, (-up, right), (0, 1))
    with rasterio.open(target, "w", driver="GTiff", count=1, transform=transform, **kept) as file:
        file.write(np.where(inside, moved, values), 1)
    return target
