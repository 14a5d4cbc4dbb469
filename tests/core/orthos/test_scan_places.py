"""Scan places of a tile against exact projection."""

import numpy as np

from core.orthos.scan_places import locate_tile
from core.raster.grid import Grid


def test_lattice_meets_exact_projection__truth(scene, middle, ground):
    rough = ground["Hills"](relief_m=60.0, ground_sample_distance_m=16.0)
    for gsd in (0.25, 1.0, 4.0):
        tile = Grid.over((499_950.0, 4_099_800.0, 499_950 + 300 * gsd, 4_099_800 + 300 * gsd), gsd)
        places = locate_tile(middle, scene.camera, rough, tile)
        east, north = np.meshgrid(*tile.centres())
        points = np.column_stack([east.ravel(), north.ravel(), rough.on(tile).ravel()])
        exact = middle.pixel_from_object(points, scene.camera)
        found = np.column_stack([places.columns.ravel(), places.rows.ravel()]) + places.origin
        inside = ((exact > 0) & (exact < middle.size_px)).all(axis=1)
        assert inside.sum() > 1000
        assert np.linalg.norm(found - exact, axis=1)[inside].max() < 0.05
