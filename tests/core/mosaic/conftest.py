"""Four orthos that overlap, for seams, balance and composition."""

import numpy as np
import pytest
import rasterio
from affine import Affine

from core.orthos.rectification import OrthoProduct, rectify_photo

CRS = "EPSG:32633"


def write_ortho(path, name, grid, values, nadir):
    profile = {"width": grid.columns, "height": grid.rows, "count": 1, "dtype": values.dtype}
    transform = Affine.from_gdal(*grid.geotransform)
    with rasterio.open(
        path, "w", driver="GTiff", crs=CRS, transform=transform, nodata=0, **profile
    ) as file:
        file.write(values, 1)
    return OrthoProduct(name, path, grid, float(np.mean(values > 0)), nadir)


@pytest.fixture(scope="module")
def block(scene, tmp_path_factory):
    """Orthos of four photos in two strips that overlap; gains and offsets differ."""
    folder = tmp_path_factory.mktemp("block")
    places = {
        "a": (-130, -120, 1.0, 0),
        "b": (130, -110, 0.8, 25),
        "c": (-120, 120, 1.1, -20),
        "d": (135, 125, 0.9, 5),
    }
    return [
        rectify_photo(
            scene.photo(name, e, n, 0.05, gain, offset),
            scene.camera,
            scene.dem,
            1.0,
            folder / f"{name}_ortho.tif",
            CRS,
        )
        for name, (e, n, gain, offset) in places.items()
    ]
