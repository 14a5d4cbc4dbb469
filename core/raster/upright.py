"""A scan laid upright: resampled once into square pixels along the film's own axes, by windows."""

from pathlib import Path
from typing import Any

import numpy as np
from affine import Affine
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.vrt import WarpedVRT

from core.geometry.interior import InteriorOrientation
from core.progress import Progress
from core.raster.files import FILES, open_plain
from core.raster.grid import window_of
from core.raster.scan_pixels import white_is_nought

# source: any CRS in metres will do; the film's millimetres are no place on Earth.
PLANE = CRS.from_wkt('LOCAL_CS["film",UNIT["metre",1]]')
# design: a tile of the result and what it is made of stay below a few megabytes.
TILE_PX = 512


def write_upright(
    scan: Path,
    target: Path,
    interior: InteriorOrientation,
    frame: tuple[tuple[int, int], float, tuple[float, float]],
    progress: Progress,
) -> None:
    """Write a scan as its film lies, bicubic, tiled and deflated.

    Args:
        scan: The scan.
        target: GeoTIFF to write.
        interior: Film from pixels of the scan.
        frame: Columns and rows, side of a pixel (mm), and film point of the outer corner (mm).
        progress: Told per row of tiles.
    """
    (columns, rows), pixel_mm, (left, top) = frame
    upright = Affine(pixel_mm, 0.0, left, 0.0, -pixel_mm, top)
    with FILES.borrow(scan) as source:
        profile: dict[str, Any] = {
            "driver": "GTiff", "width": columns, "height": rows, "count": source.count,
            "dtype": source.dtypes[0], "tiled": True, "blockxsize": TILE_PX,
            "blockysize": TILE_PX, "compress": "deflate", "bigtiff": "if_safer",
        }  # fmt: skip
        if white_is_nought(source):
            profile["photometric"] = "MINISWHITE"
        with open_plain(target, {"mode": "w", **profile}) as written:
            for row in range(0, rows, TILE_PX):
                progress.report(row, rows, scan.name)
                for column in range(0, columns, TILE_PX):
                    width, height = min(TILE_PX, columns - column), min(TILE_PX, rows - row)
                    window = window_of((column, row, width, height))
                    middle = upright @ (column + width / 2, row + height / 2)
                    with WarpedVRT(
                        source, src_crs=PLANE, crs=PLANE, src_transform=_around(interior, middle),
                        transform=upright, width=columns, height=rows, resampling=Resampling.cubic,
                    ) as laid:  # fmt: skip
                        written.write(laid.read(window=window), window=window)
    progress.report(rows, rows, scan.name)


def _around(interior: InteriorOrientation, film_mm: tuple[float, float]) -> Affine:
    """Film from pixels about a film point; a tile is bent by less than a micrometre."""
    film = np.array([film_mm])
    pixel = interior.pixel_from_film(film)
    linear = interior.film_by_pixel(pixel)[0]
    shift = film[0] - linear @ pixel[0]
    return Affine(*np.column_stack([linear, shift]).ravel().tolist())
