"""Holes of a raster: what is put in is what is found, what is open to the edge is none."""

import numpy as np
import pytest
import rasterio
from affine import Affine

from core.raster.holes import LATTICE, find_holes

GSD = 0.5
WEST, NORTH = -578_000.0, -1_190_000.0


def written(path, values):
    rows, columns = values.shape
    profile = {"width": columns, "height": rows, "count": 1, "dtype": "uint8", "nodata": 0}
    transform = Affine(GSD, 0, WEST, 0, -GSD, NORTH)
    with rasterio.open(
        path, "w", driver="GTiff", crs="EPSG:5514", transform=transform, tiled=True, **profile
    ) as file:
        file.write(values, 1)
    return path


def test_five_holes_are_found_with_size_and_place__truth(tmp_path):
    values = np.full((600, 800), 90, dtype=np.uint8)
    values[:40] = 0
    sizes = [(10, 12), (20, 30), (7, 7), (40, 25), (3, 50)]
    for number, (tall, wide) in enumerate(sizes):
        values[100 + 80 * number :, 60 + 120 * number :][:tall, :wide] = 0
    found = find_holes(written(tmp_path / "mosaic.tif", values))
    assert [hole.area_m2 for hole in found] == sorted(
        (tall * wide * GSD**2 for tall, wide in sizes), reverse=True
    )
    largest = found[0]
    assert largest.east == pytest.approx(WEST + GSD * (60 + 360 + 12.5))
    assert largest.north == pytest.approx(NORTH - GSD * (100 + 240 + 20))


def test_what_is_open_to_the_edge_is_no_hole__truth(tmp_path):
    values = np.full((300, 300), 90, dtype=np.uint8)
    values[100:150, 250:] = 0
    values[:30, 10:20] = 0
    assert find_holes(written(tmp_path / "open.tif", values)) == ()
    values[:] = 0
    assert find_holes(written(tmp_path / "empty.tif", values)) == ()


def test_a_large_raster_is_told_on_a_lattice_with_the_same_areas__truth(tmp_path):
    values = np.full((400, LATTICE + 301), 90, dtype=np.uint8)
    values[100:133, 501:548] = 0
    values[300:320, LATTICE + 100 : LATTICE + 111] = 0
    found = find_holes(written(tmp_path / "wide.tif", values))
    assert [hole.area_m2 for hole in found] == [33 * 47 * GSD**2, 20 * 11 * GSD**2]
    assert found[0].east == pytest.approx(WEST + GSD * 524.5, abs=2 * GSD)
