"""What is kept between two reads: each tile once, within bounds, as the file now stands."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import rasterio

from core.raster.files import OpenFiles, TileCache, file_stamp, open_plain
from tests.core.raster_files import place, write_raster


def test_many_threads_make_a_tile_once__law():
    cache, made, together = TileCache(10_000), [], threading.Barrier(4)

    def make():
        made.append(1)
        return np.ones(10)

    def ask(_):
        together.wait()
        return cache.get("tile", make)

    with ThreadPoolExecutor(4) as pool:
        tiles = list(pool.map(ask, range(4)))
    assert len(made) == 1
    assert all(tile is tiles[0] for tile in tiles)


def test_the_tile_asked_for_longest_ago_goes_first__law():
    cache = TileCache(3 * 80)
    for name in "abc":
        cache.get(name, lambda: np.zeros(10))
    cache.get("a", lambda: pytest.fail("a is held"))
    cache.get("d", lambda: np.zeros(10))
    assert cache.nbytes == 3 * 80
    cache.get("a", lambda: pytest.fail("a was asked for lately"))
    fresh = cache.get("b", lambda: np.ones(10))
    assert fresh.all()
    assert cache.nbytes == 3 * 80


def test_a_tile_larger_than_the_bound_is_given_all_the_same__law():
    cache = TileCache(8)
    assert len(cache.get("large", lambda: np.zeros(100))) == 100
    cache.get("next", lambda: np.zeros(1))
    assert cache.nbytes == 8


def test_what_could_not_be_made_is_tried_again__law():
    cache = TileCache(1000)
    with pytest.raises(OSError, match="torn"):
        cache.get("tile", lambda: (_ for _ in ()).throw(OSError("torn")))
    assert cache.get("tile", lambda: np.ones(3)).sum() == 3
    cache.clear()
    assert cache.nbytes == 0


def test_a_file_stays_open_for_its_next_reader_and_serves_one_at_a_time__law(tmp_path):
    path = write_raster(tmp_path / "a.tif", np.ones((4, 4), np.uint8), place(1.0))
    files = OpenFiles(2)
    with files.borrow(path) as first, files.borrow(path) as second:
        assert first is not second
    with files.borrow(path) as again:
        assert again in (first, second)
    assert not again.closed
    others = [
        write_raster(tmp_path / f"{i}.tif", np.ones((4, 4), np.uint8), place(1.0)) for i in range(3)
    ]
    for other in others:
        with files.borrow(other) as file:
            assert file.read().all()
    assert first.closed
    assert second.closed


def test_a_changed_file_is_opened_anew__truth(tmp_path):
    path = write_raster(tmp_path / "a.tif", np.full((4, 4), 1, np.uint8), place(1.0))
    files = OpenFiles(4)
    with files.borrow(path) as file:
        assert (file.read() == 1).all()
    write_raster(tmp_path / "b.tif", np.full((4, 4), 2, np.uint8), place(1.0))
    os.replace(tmp_path / "b.tif", path)
    with files.borrow(path) as file:
        assert (file.read() == 2).all()


def test_what_failed_is_opened_anew__law(tmp_path):
    path = write_raster(tmp_path / "a.tif", np.ones((4, 4), np.uint8), place(1.0))
    files = OpenFiles(4)
    with pytest.raises(rasterio.RasterioIOError), files.borrow(path) as file:
        raise rasterio.RasterioIOError("torn")
    assert file.closed
    with pytest.raises(FileNotFoundError), files.borrow(tmp_path / "missing.tif"):
        pass


@pytest.mark.parametrize("beside", ["a.tfw", "a.tifw", "a.wld", "a.prj", "a.tif.aux.xml"])
def test_a_file_beside_counts_as_part_of_it__law(tmp_path, beside):
    path = write_raster(tmp_path / "a.tif", np.ones((4, 4), np.uint8), place(1.0))
    before = file_stamp(path)
    (tmp_path / beside).write_text("1\n0\n0\n-1\n0\n0\n")
    assert file_stamp(path) != before


def test_what_gdal_quotes_of_a_spoilt_file_is_printed_nowhere__law(tmp_path, capfd):
    """Rasterio printed two tracebacks for a quote that is no text."""
    path = tmp_path / "spoilt.tif"
    path.write_bytes(b'<VRTDataset rasterXSize="9" rasterYSize="9"><VRTRaster\xc2(Band>')
    with pytest.raises(OSError, match="no text"):
        open_plain(path, {})
    assert capfd.readouterr() == ("", "")
