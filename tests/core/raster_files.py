"""Small rasters and polygons on disk for the tests of the reference."""

from pathlib import Path

import numpy as np
import pyogrio.raw
import rasterio
import shapely
from rasterio.transform import Affine

CRS = "EPSG:32633"
WEST, NORTH = 620_000.0, 5_420_000.0


def write_raster(path: Path, values: np.ndarray, transform: Affine, crs=CRS, **profile) -> Path:
    bands = values if values.ndim == 3 else values[None]
    with rasterio.open(
        path, "w", driver=profile.pop("driver", "GTiff"), count=len(bands), height=bands.shape[1],
        width=bands.shape[2], dtype=bands.dtype, crs=crs, transform=transform, **profile,
    ) as file:  # fmt: skip
        file.write(bands)
    return path


def write_footprints(path: Path, polygons: dict, name_attribute: str, crs: str) -> None:
    """Polygons by scan file name, as a GeoPackage or what the extension says."""
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(list(polygons.values())),
        field_data=[np.array(list(polygons), dtype=object)],
        fields=[name_attribute],
        geometry_type="Polygon",
        crs=crs,
    )


def place(gsd: float, column: float = 0, row: float = 0) -> Affine:
    return Affine(gsd, 0, WEST + column * gsd, 0, -gsd, NORTH - row * gsd)


def smooth_picture(rows: int, columns: int, seed: int = 0, bands: int = 1) -> np.ndarray:
    """Texture without detail finer than some pixels, so that sampling is the only question."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :columns]
    picture = np.zeros((bands, rows, columns))
    for band in picture:
        for _ in range(8):
            u, v = rng.uniform(-0.5, 0.5, 2)
            band += np.cos(u * x + v * y + rng.uniform(0, 6))
    return (127 + 14 * picture).clip(1, 254)
