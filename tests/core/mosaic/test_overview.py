"""Orthos in small, on cells that all of them share."""

import numpy as np

from core.mosaic.overview import common_cells, read_overview


def test_overview_cells_coincide__law(block):
    views = [read_overview(ortho, 8) for ortho in block]
    common = common_cells(views[0], views[2])
    assert len(common.first) > 200
    assert np.std(common.first * 1.1 - 20 - common.second) < 3.0
    cell = views[0].grid.grid_from_object(common.places).astype(int)
    assert np.array_equal(views[0].values[cell[:, 1], cell[:, 0]], common.first.astype("float32"))


def test_coarser_overview_is_the_overview_of_larger_cells__law(block):
    fine, coarse = read_overview(block[0], 4).coarser(3), read_overview(block[0], 12)
    assert fine.grid == coarse.grid
    assert np.allclose(fine.share, coarse.share)
    assert np.allclose(fine.values, coarse.values, atol=0.01, equal_nan=True)
