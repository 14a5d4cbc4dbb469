"""GDAL reads the names of numbers that are written beside a raster."""

import ctypes
import os
from pathlib import Path

import numpy as np
import pytest
import rasterio

from core.formats.raster_table import write_raster_table
from tests.core.raster_files import CRS, place, write_raster

ROWS = {0: ("", ""), 1: ("Kobylí <1> & co", "1938-05"), 3: ("b", "")}
NO_GDAL = "this rasterio brings no GDAL of its own"
POINTER, TEXTS, WHOLE = ctypes.c_void_p, ctypes.POINTER(ctypes.c_char_p), ctypes.c_int


@pytest.fixture
def gdal():
    """The library that reads rasters here, of which rasterio does not show tables."""
    folder = Path(rasterio.__file__).parents[1] / "rasterio.libs"
    library = next(folder.glob("libgdal*"), None)
    if library is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(NO_GDAL)
    found = ctypes.CDLL(str(library))

    def call(name, gives, *given):
        function = getattr(found, name)
        function.restype = gives
        return function(
            *(POINTER(one) if isinstance(one, int) and one > 2**31 else one for one in given)
        )

    call("GDALAllRegister", None)
    return call


def test_gdal_reads_names_and_table__oracle(tmp_path, gdal):
    path = write_raster(tmp_path / "n.tif", np.ones((4, 5), np.uint8), place(1.0), crs=CRS)
    write_raster_table(path, ROWS, ("scan", "date"))
    file = gdal("GDALOpen", POINTER, str(path).encode(), 0)
    band = gdal("GDALGetRasterBand", POINTER, file, 1)
    table = gdal("GDALGetDefaultRAT", POINTER, band)
    size = [gdal(f"GDALRATGet{what}Count", WHOLE, table) for what in ("Row", "Column")]
    assert size == [3, 3]
    heads = [gdal("GDALRATGetNameOfCol", ctypes.c_char_p, table, column) for column in range(3)]
    assert heads == [b"number", b"scan", b"date"]
    told = {
        int(row[0]): tuple(text.decode() for text in row[1:])
        for row in (
            [gdal("GDALRATGetValueAsString", ctypes.c_char_p, table, k, i) for i in range(3)]
            for k in range(3)
        )
    }
    assert told == ROWS
    names = gdal("GDALGetRasterCategoryNames", TEXTS, band)
    assert [names[k].decode() for k in range(4)] == ["", ROWS[1][0], "", "b"]
    assert names[4] is None
    gdal("GDALClose", None, file)
