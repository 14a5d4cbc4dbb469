"""Scans laid upright: every pixel comes from where the interior orientation says."""

import numpy as np
import pytest
from rasterio.transform import Affine

from core.geometry.interior import InteriorOrientation
from core.progress import SILENT
from core.raster import upright
from core.raster.files import FILES
from tests.core.raster_files import write_raster


@pytest.mark.parametrize("model", ["affine", "projective", "bilinear"])
def test_a_scan_is_laid_upright_by_the_whole_model__truth(tmp_path, monkeypatch, model) -> None:
    """Columns and rows themselves are the picture; a bend of half a pixel at the corners."""
    monkeypatch.setattr(upright, "TILE_PX", 128)  # as wide on the film as usual ones
    size, pixel_mm = 1400, 0.05
    down, across = np.mgrid[:size, :size].astype(np.float32) + 0.5
    path = write_raster(
        tmp_path / "a.tif", np.stack([across, down]), Affine(1, 0, 5, 0, -1, 9), crs=None
    )
    matrix = np.array([[0.001, pixel_mm, -35.7], [pixel_mm, -0.001, -34.3]])
    nobody, warp = np.zeros((0, 2)), np.array([2e-5, -3e-5]) * (model != "affine")
    interior = InteriorOrientation(model, matrix, (), nobody, nobody, np.nan, warp)
    frame = (1200, 1150), pixel_mm, (-30.0, 28.75)
    upright.write_upright(path, tmp_path / "b.tif", interior, frame, SILENT)
    with FILES.borrow(tmp_path / "b.tif") as laid:
        found = laid.read()
    down, across = np.mgrid[:1150, :1200] + 0.5
    film = np.column_stack([across.ravel() * pixel_mm - 30.0, 28.75 - down.ravel() * pixel_mm])
    expected = interior.pixel_from_film(film).T.reshape(2, 1150, 1200)
    np.testing.assert_allclose(found, expected, atol=0.06)  # GDAL's kernel leaves half of it
