"""Sheets together: which share a raster, their order, what is told; exact means of their pixels."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import rasterio
from pyproj import CRS as Crs
from rasterio.transform import Affine

from core.raster import lattices
from core.raster.files import TILES
from core.raster.lattices import CellWindow, open_sheets, read_cells
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster

PICTURE = np.full((40, 50), 120, np.uint8)
NOISE = np.random.default_rng(1).integers(1, 255, (1100, 1300)).astype(np.uint8)


def sheets_of(*files, crs=CRS):
    return open_sheets(files, Crs(crs), "ortho")


def test_sheets_of_one_raster_share_a_lattice__truth(tmp_path):
    one = write_raster(tmp_path / "a.tif", PICTURE, place(0.5))
    two = write_raster(tmp_path / "b.tif", PICTURE, place(0.5, 50.01, -39.995))
    (lattice,) = sheets_of(two, one, one).lattices
    np.testing.assert_array_equal(lattice.offsets, [[0, 0], [50, -40]])
    assert [sheet.path for sheet in lattice.sheets] == [str(one), str(two)]
    assert lattice.ground_sample_distance_m == pytest.approx(0.5)
    assert lattice.north_up


@pytest.mark.parametrize(
    "other",
    [place(0.5, 50.1), place(0.501, 50), Affine(0.5, 0.01, WEST + 25, 0.01, -0.5, NORTH)],
    ids=["phase", "size", "turned"],
)
def test_what_does_not_fit_has_its_own_lattice__truth(tmp_path, other):
    one = write_raster(tmp_path / "a.tif", PICTURE, place(0.5))
    two = write_raster(tmp_path / "b.tif", PICTURE, other)
    assert len(sheets_of(one, two).lattices) == 2


def test_the_finest_lattice_comes_first_and_bounds_hold_all__truth(tmp_path):
    coarse = write_raster(tmp_path / "a.tif", PICTURE, place(2.0))
    fine = write_raster(tmp_path / "b.tif", PICTURE, place(0.5, -10, -20))
    sheets = sheets_of(coarse, fine)
    sizes = [lattice.ground_sample_distance_m for lattice in sheets.lattices]
    assert sizes == pytest.approx([0.5, 2.0])
    assert sheets.bounds == pytest.approx((WEST - 5, NORTH - 80, WEST + 100, NORTH + 10))
    assert sheets.notes == ()


def test_turned_and_foreign_lattices_are_not_north_up__truth(tmp_path):
    turned = Affine(0.3, 0.4, WEST, 0.4, -0.3, NORTH)
    (lattice,) = sheets_of(write_raster(tmp_path / "t.tif", PICTURE, turned)).lattices
    assert not lattice.north_up
    assert lattice.ground_sample_distance_m == pytest.approx(0.5)
    path = write_raster(tmp_path / "u.tif", PICTURE, place(0.5))
    foreign = sheets_of(path, crs="EPSG:32634")
    assert not foreign.lattices[0].north_up
    (note,) = foreign.notes
    assert note.kind == "reference-reprojected"


def test_the_key_changes_with_any_file__law(tmp_path):
    path = write_raster(tmp_path / "a.tif", PICTURE, place(0.5))
    before = sheets_of(path).key
    assert sheets_of(path).key == before
    write_raster(path, PICTURE + 1, place(0.5))
    assert sheets_of(path).key != before


@pytest.fixture(autouse=True)
def nothing_remembered():
    TILES.clear()


def lattice_of(*paths, what="ortho"):
    (lattice,) = open_sheets(paths, Crs(CRS), what).lattices
    return lattice


def cut(tmp_path, name, column, row, columns, rows, picture=NOISE, **profile):
    part = picture[..., row : row + rows, column : column + columns].copy()
    return write_raster(tmp_path / name, part, place(0.5, column, row), **profile)


def means(picture, size):
    rows, columns = picture.shape[0] // size, picture.shape[1] // size
    whole = picture[: rows * size, : columns * size].astype(np.float64)
    return whole.reshape(rows, size, columns, size).mean(axis=(1, 3))


@pytest.mark.parametrize("size", [1, 2, 4, 8])
def test_cells_across_sheets_are_exact_means__oracle(tmp_path, size):
    lattice = lattice_of(
        cut(tmp_path, "a.tif", 0, 0, 701, 1100), cut(tmp_path, "b.tif", 701, 0, 599, 1100)
    )
    window = CellWindow(11, 7, 1000 // size, 900 // size, size)
    cells = read_cells(lattice, window, "gray", exact=True)
    expected = means(NOISE, size)[7 : 7 + window.rows, 11 : 11 + window.columns]
    assert cells.weight.min() == 1 if size < 8 else cells.weight.max() == 1
    known = cells.weight[: expected.shape[0], : expected.shape[1]] == 1
    got = cells.values[0, : expected.shape[0], : expected.shape[1]]
    np.testing.assert_allclose(got[known], expected[known], atol=1e-4)


def test_a_cell_that_is_partly_known_averages_what_is_known__truth(tmp_path):
    holed = NOISE.copy()
    holed[100:103, 200:300] = 0
    lattice = lattice_of(cut(tmp_path, "a.tif", 0, 0, 1300, 1100, holed, nodata=0))
    cells = read_cells(lattice, CellWindow(50, 25, 20, 1, 4), "gray", exact=True)
    np.testing.assert_array_equal(cells.weight, 0.25)
    expected = NOISE[103, 200:280].reshape(20, 4).mean(axis=1)
    np.testing.assert_allclose(cells.values[0, 0], expected, rtol=1e-6)


def test_where_sheets_overlap_the_first_is_taken__truth(tmp_path):
    first = np.full((60, 60), 10, np.uint8)
    second = np.full((60, 60), 30, np.uint8)
    lattice = lattice_of(
        write_raster(tmp_path / "a.tif", first, place(0.5)),
        write_raster(tmp_path / "b.tif", second, place(0.5, 30)),
    )
    cells = read_cells(lattice, CellWindow(0, 0, 45, 30, 2), "gray", exact=True)
    np.testing.assert_array_equal(cells.values[0, :, :30], 10)
    np.testing.assert_array_equal(cells.values[0, :, 30:], 30)
    np.testing.assert_array_equal(cells.weight, 1)


def test_every_pixel_is_decoded_once_for_all_levels__law(tmp_path, monkeypatch):
    lattice = lattice_of(cut(tmp_path, "a.tif", 0, 0, 1300, 1100))
    decoded, read = [], lattices._read

    def counted(sheet, box, shape, whole):
        decoded.append((box[2] - box[0]) * (box[3] - box[1]))
        return read(sheet, box, shape, whole)

    monkeypatch.setattr(lattices, "_read", counted)
    for size in (4, 1, 2, 4):
        for column in (0, 40, 90):
            window = CellWindow(column, 3, 200, 250, size)
            read_cells(lattice, window, "gray", exact=True)
    assert sum(decoded) == 1300 * 1100


def test_the_order_of_reading_changes_nothing__law(tmp_path):
    lattice = lattice_of(cut(tmp_path, "a.tif", 0, 0, 1300, 1100))
    windows = [CellWindow(c, r, 150, 120, s) for s in (1, 2, 4) for c in (-20, 99) for r in (3, 80)]

    def read(window):
        cells = read_cells(lattice, window, "gray", exact=True)
        return cells.values.tobytes() + cells.weight.tobytes()

    forward = [read(window) for window in windows]
    TILES.clear()
    assert [read(window) for window in windows[::-1]][::-1] == forward
    TILES.clear()
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(read, windows)) == forward


def test_overviews_are_used_only_where_allowed__truth(tmp_path):
    path = cut(tmp_path, "a.tif", 0, 0, 1024, 1024)

    with rasterio.open(path, "r+") as file:
        file.build_overviews([8], rasterio.enums.Resampling.average)
        (tag,) = file.overviews(1)
    assert tag == 8
    with rasterio.open(path, "r+", OVERVIEW_LEVEL="0") as level:
        level.write(np.full((1, 128, 128), 77, np.uint8))
    lattice = lattice_of(path)
    window = CellWindow(2, 2, 100, 100, 8)
    np.testing.assert_allclose(read_cells(lattice, window, "gray", exact=False).values, 77)
    exact = read_cells(lattice, window, "gray", exact=True).values[0]
    np.testing.assert_allclose(exact, means(NOISE, 8)[2:102, 2:102], atol=1e-4)


def test_gray_colour_and_heights__truth(tmp_path):
    colour = np.zeros((3, 40, 40), np.uint8)
    colour[0], colour[1], colour[2] = 200, 100, 50
    lattice = lattice_of(write_raster(tmp_path / "c.tif", colour, place(0.5)))
    window = CellWindow(0, 0, 5, 5, 2)
    gray = read_cells(lattice, window, "gray", exact=True).values
    np.testing.assert_allclose(gray, 0.299 * 200 + 0.587 * 100 + 0.114 * 50, rtol=1e-6)
    shown = read_cells(lattice, window, "colour", exact=True).values
    np.testing.assert_allclose(shown[:, 2, 2], [200, 100, 50])
    path = write_raster(tmp_path / "d.tif", np.full((40, 40), 2345, np.int16), place(0.5))

    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = (0.1,), (5.0,)
    heights = read_cells(lattice_of(path, what="DEM"), window, "heights", exact=True).values
    np.testing.assert_allclose(heights, 239.5, rtol=1e-6)
