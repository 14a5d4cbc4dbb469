"""Which part of a scan may be used, once a hand has drawn on it."""

import numpy as np
import shapely
from rasterio.features import geometry_mask
from rasterio.transform import Affine

from core.arrays import Mask, PixelPoints
from core.geometry.drawn_mask import Area, DrawnMask
from core.raster.scan_file import UsableArea


def with_drawn(
    usable: UsableArea | None,
    drawn: DrawnMask,
    size_px: tuple[int, int],
    picture: PixelPoints | None = None,
) -> UsableArea:
    """What may be used of a scan: every cell that is touched by what was hidden is left out.

    Args:
        usable: What the program found; None where it did not look: all of the scan.
        drawn: What a hand drew.
        size_px: Columns and rows of the scan.
        picture: Corners of the exposed picture, pixels: nothing beyond it is given back.
    """
    # design: cells of 8 pixels, the largest that the program makes itself.
    known = usable or UsableArea.of(
        np.ones((-(-size_px[1] // 8), -(-size_px[0] // 8)), bool), size_px
    )
    cells, freed = known.mask.copy(), drawn.freed
    if picture is not None:
        freed &= shapely.Polygon(picture).buffer(0)
    cells |= _cells(freed, known, whole=True)
    cells &= ~_cells(drawn.hidden, known, whole=False)
    return UsableArea.of(cells, size_px, known.scratches)


def _cells(area: Area, known: UsableArea, whole: bool) -> Mask:
    """Cells whose middle lies in an area, or that the area touches."""
    if area.is_empty:
        return np.zeros(known.shape, dtype=np.bool_)
    (columns, rows), (down, across) = known.size_px, known.shape
    pixel_from_cell = Affine.scale(columns / across, rows / down)
    outside = geometry_mask([area], known.shape, pixel_from_cell, all_touched=not whole)
    return np.asarray(~outside)
