"""Orthos and mosaics of real pixels, judged by orthos that others made."""

import numpy as np
import pytest

from core.mosaic.comparison import ComparisonOptions, compare_orthos
from core.mosaic.composition import compose_mosaic, mosaic_grid
from core.orthos.rectification import rectify_photo
from core.raster.dem import open_dem
from tests.core.ties.ngi import ngi_block
from tests.core.ties.vovcha import true_block, vovcha_block


def test_vovcha_with_true_orientation_is_its_truth__real(shared_data, tmp_path):
    # The scans were made from this ortho: what is left is resampling, 0.02 px of 0.5 m.
    folder = shared_data / "vovcha-film"
    block = true_block(folder, vovcha_block(folder))
    dem = open_dem([folder / "dem.tif"], block.crs)
    dem = dem.cropped(dem.bounds)
    orthos = [
        rectify_photo(
            photo, block.cameras["archive"], dem, 0.5, tmp_path / f"{name}.tif", block.crs
        )
        for name, photo in list(block.photos.items())[1::2]
    ]
    mosaic = compose_mosaic(
        orthos, mosaic_grid(orthos), tmp_path / "mosaic.tif", tmp_path / "seams.gpkg"
    )
    found = compare_orthos(mosaic.path, folder / "truth" / "archival_ortho.tif")
    assert found.n >= 150
    assert found.m_p < 0.05
    assert found.largest < 0.3
    assert np.abs(found.mean_shift).max() < 0.01


@pytest.mark.parametrize("number", [0, 2])
def test_ngi_ortho_is_the_published_one__real(shared_data, tmp_path, number):
    # The published orthos rest on the same orientation and DEM; half a pixel of 5 m is the limit
    # of what is known about their pixel origin.
    folder = shared_data / "ngi-baviaanskloof"
    _, block = ngi_block(folder)
    photo = list(block.photos.values())[number]
    dem = open_dem([folder / "frames" / "dem.tif"], block.crs)
    dem = dem.cropped(dem.bounds)
    product = rectify_photo(
        photo, block.cameras["dmc"], dem, 5.0, tmp_path / "ortho.tif", block.crs
    )
    options = ComparisonOptions(places=150, patch_px=40, search_px=16)
    published = folder / "orthos-5m" / f"ngi_rgb_byte_{number + 1}.tif"
    found = compare_orthos(product.path, published, options)
    assert found.n >= 80
    assert np.hypot(*found.median_shift) < 2.5
    assert found.m_p < 4.0
