"""Scans by windows against NumPy, their usable area, and what is said of unusable files."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rasterio.enums import Resampling
from rasterio.transform import Affine

from core.errors import ScanError
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation
from core.matching.local_search import predict_pixels
from core.matching.patches import Window, object_on_ground, read_scan
from core.progress import SILENT
from core.raster.files import open_plain
from core.raster.scan_file import (
    ScanFiles,
    ScanSource,
    UsableArea,
    check_fits_camera,
    open_scan,
    read_overview,
    read_window,
)
from core.raster.upright import write_upright
from tests.core.scans.film_maker import write_gray

VALUES = np.random.default_rng(0).integers(0, 255, (230, 310)).astype(np.uint8)


@pytest.fixture(scope="module")
def scan_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scans") / "scan.tif"
    write_gray(path, VALUES, tiled=True, blockxsize=64, blockysize=64, compress="deflate")
    return path


@settings(max_examples=60)
@given(
    st.integers(-40, 320), st.integers(-40, 240), st.integers(1, 90), st.integers(1, 90),
    st.integers(1, 5), st.sampled_from(["nan", "edge"]),
)  # fmt: skip
def test_window_is_the_array_averaged__oracle(
    scan_path: Path, column: int, row: int, columns: int, rows: int, reduction: int, outside: str
) -> None:
    window = read_window(open_scan(scan_path), column, row, columns, rows, reduction, outside)
    padded = np.full((230 + 400, 310 + 400), np.nan)
    padded[200:430, 200:510] = VALUES
    part = padded[200 + row :, 200 + column :][
        : rows // reduction * reduction, : columns // reduction * reduction
    ]
    expected = part.reshape(rows // reduction, reduction, columns // reduction, reduction).mean(
        axis=(1, 3)
    )
    assert window.shape == expected.shape
    inside = np.isfinite(expected)
    # GDAL rounds averages to the scan's own type.
    np.testing.assert_allclose(window[inside], expected[inside], atol=0.51)
    if outside == "nan" or not inside.any():
        assert np.isnan(window[~inside]).all()
    else:
        assert np.isfinite(window).all()


def test_rotated_georeference_changes_no_window__truth(tmp_path: Path) -> None:
    path = tmp_path / "turned.tif"
    write_gray(path, VALUES, transform=Affine(-0.35, 0.04, -576837, 0.04, 0.35, -1195069))
    window = read_window(open_scan(path), -5, -7, 40, 40, outside="edge")
    np.testing.assert_array_equal(window[7:, 5:], VALUES[:33, :35])
    np.testing.assert_array_equal(window[0, 5:], VALUES[0, :35])


@pytest.mark.parametrize("reduction", [2, 3, 4, 5, 8])
@pytest.mark.parametrize("kind", ["nearest", "gauss", "levels"])
def test_a_reduced_scan_lies_where_the_scan_does__truth(
    tmp_path: Path, kind: str, reduction: int
) -> None:
    """Values grow by the same amount with each column and row, and so do their averages."""
    ramp = (40 * np.arange(1030) + 20 * np.arange(1030)[:, None]).astype(np.uint16)
    path = tmp_path / ("scan.jp2" if kind == "levels" else "scan.tif")
    lossless = {"driver": "JP2OpenJPEG", "quality": 100, "reversible": True}
    write_gray(path, ramp, **(lossless if kind == "levels" else {"tiled": True}))
    if kind != "levels":
        with open_plain(path, {"mode": "r+"}) as dataset:
            dataset.build_overviews([2, 4, 8], Resampling[kind])
    scan = open_scan(path)
    for window in ((0, 0, 1000, 1000), (333, 71, 200, 300)):
        found = read_window(scan, *window, reduction)
        columns, rows = (
            start + (np.arange(size // reduction) + 0.5) * reduction - 0.5
            for start, size in zip(window[:2], window[2:], strict=True)
        )
        # Half a gray value of rounding, of 40 a pixel.
        assert np.abs(found - (40 * columns + 20 * rows[:, None])).max() <= 1


def test_pixels_of_the_value_of_nodata_count_in_averages__truth(tmp_path: Path) -> None:
    path = tmp_path / "scan.tif"
    write_gray(path, np.tile(np.uint8([0, 200]), (64, 32)), nodata=0)
    np.testing.assert_array_equal(read_overview(open_scan(path), 4), np.full((16, 16), 100.0))


@pytest.mark.parametrize(("depth", "most"), [("uint8", 255), ("uint16", 65535)])
def test_a_scan_whose_nought_is_white_is_turned_round__truth(
    tmp_path: Path, depth: str, most: int
) -> None:
    path = tmp_path / "scan.tif"
    write_gray(path, VALUES.astype(depth), photometric="MINISWHITE")
    expected = most - VALUES.astype(float)
    np.testing.assert_array_equal(read_overview(open_scan(path), 1), expected)
    laid = tmp_path / "upright.tif"
    frame = ((310, 230), 1.0, (0.0, 0.0))
    nobody, lies = np.zeros((0, 2)), np.array([[1.0, 0, 0], [0, -1, 0]])
    interior = InteriorOrientation("affine", lies, (), nobody, nobody, np.nan, np.zeros(2))
    write_upright(path, laid, interior, frame, SILENT)
    np.testing.assert_array_equal(read_overview(open_scan(laid), 1), expected)


def test_colours_of_a_palette_are_averaged__truth(tmp_path: Path) -> None:
    path = tmp_path / "scan.tif"
    write_gray(path, np.tile(np.uint8([0, 7]), (8, 4)))
    with open_plain(path, {"mode": "r+"}) as dataset:
        dataset.write_colormap(1, {0: (200, 100, 50), 7: (0, 0, 0)})
    gray = read_overview(open_scan(path), 2)
    np.testing.assert_allclose(gray, (0.299 * 200 + 0.587 * 100 + 0.114 * 50) / 2, atol=1e-3)


@pytest.mark.parametrize(
    ("suffix", "driver"), [(".jpg", "JPEG"), (".jp2", "JP2OpenJPEG"), (".tif", "GTiff")]
)
def test_colour_becomes_gray__truth(tmp_path: Path, suffix: str, driver: str) -> None:
    colour = np.zeros((3, 64, 64), dtype=np.uint8)
    colour[0], colour[1], colour[2] = 200, 100, 50
    path = tmp_path / f"scan{suffix}"
    write_gray(path, colour, driver=driver)
    gray = read_window(open_scan(path), 0, 0, 64, 64)
    assert np.abs(gray - (0.299 * 200 + 0.587 * 100 + 0.114 * 50)).max() < 3


@pytest.mark.parametrize("bands", [1, 3])
def test_spoilt_data_of_the_camera_hide_no_picture__truth(tmp_path: Path, bands: int) -> None:
    """The five frames of SXB Strasbourg hold an EXIF directory that points behind their end."""
    whole, spoilt = tmp_path / "whole.jpg", tmp_path / "spoilt.jpg"
    colours = np.dstack([VALUES, VALUES[::-1], VALUES[:, ::-1]])
    cv2.imwrite(str(whole), colours if bands == 3 else VALUES)
    exif = b"Exif\0\0II*\0" + (0x14960000).to_bytes(4, "little")
    data = whole.read_bytes()
    length = (len(exif) + 2).to_bytes(2, "big")
    spoilt.write_bytes(data[:2] + b"\xff\xe1" + length + exif + data[2:])
    scan = open_scan(spoilt)
    assert scan.bands == bands
    np.testing.assert_array_equal(
        read_window(scan, 0, 0, 300, 200), read_window(open_scan(whole), 0, 0, 300, 200)
    )


def test_sixteen_bits_keep_their_values__truth(tmp_path: Path) -> None:
    path = tmp_path / "deep.tif"
    write_gray(path, VALUES.astype(np.uint16) * 257)
    scan = open_scan(path)
    assert scan.dtype == "uint16"
    np.testing.assert_array_equal(read_window(scan, 0, 0, 310, 230), VALUES * 257.0)


def test_missing_file_says_so__truth(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match=r"missing.*Check the path"):
        open_scan(tmp_path / "gone.tif")


def test_empty_file_says_so__truth(tmp_path: Path) -> None:
    path = tmp_path / "empty.tif"
    path.touch()
    with pytest.raises(ScanError, match=r"empty.*Copy the scan again"):
        open_scan(path)


def test_text_is_no_image__truth(tmp_path: Path) -> None:
    path = tmp_path / "notes.tif"
    path.write_text("this is not a scan\n" * 100)
    with pytest.raises(ScanError, match="not an image"):
        open_scan(path)


def test_folder_is_no_scan__truth(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match="not a file"):
        open_scan(tmp_path)


def test_floating_point_is_no_scan__truth(tmp_path: Path) -> None:
    path = tmp_path / "dem.tif"
    write_gray(path, VALUES.astype(np.float32))
    with pytest.raises(ScanError, match="float32, not 8 or 16 bit"):
        open_scan(path)


@pytest.mark.parametrize("tiled", [True, False])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.97])
def test_truncated_tiff_is_found__truth(tmp_path: Path, tiled: bool, share: float) -> None:
    whole = tmp_path / "whole.tif"
    layout = {"tiled": True, "blockxsize": 64, "blockysize": 64} if tiled else {}
    write_gray(whole, VALUES, **layout)
    cut = tmp_path / "cut.tif"
    data = whole.read_bytes()
    cut.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ScanError, match=r"cut off.*Copy the scan again"):
        open_scan(cut)


@pytest.mark.parametrize(("suffix", "driver"), [(".jpg", "JPEG"), (".jp2", "JP2OpenJPEG")])
def test_truncated_compressed_scan_is_found__truth(
    tmp_path: Path, suffix: str, driver: str
) -> None:
    whole = tmp_path / f"whole{suffix}"
    write_gray(whole, np.kron(VALUES, np.ones((3, 3), dtype=np.uint8)), driver=driver)
    open_scan(whole)
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(whole.read_bytes()[:-5000])
    with pytest.raises(ScanError, match="cut off"):
        open_scan(cut)


@pytest.mark.parametrize(
    ("pixel_um", "fits"), [(15.0, True), (45.0, False), (5.0, False), (14.0, True)]
)
def test_scan_has_to_fit_the_frame__truth(tmp_path: Path, pixel_um: float, fits: bool) -> None:
    path = tmp_path / "scan.tif"
    write_gray(path, np.zeros((1300, 1250), dtype=np.uint8))
    camera = Camera("small", 152.0, (18.0, 18.0))
    if fits:
        check_fits_camera(open_scan(path), camera, pixel_um / 1000)
        return
    with pytest.raises(ScanError, match=r"does not fit the 18 x 18 mm.*'small'.*scan_pixel_um"):
        check_fits_camera(open_scan(path), camera, pixel_um / 1000)


def test_scans_are_found_by_their_path_and_looked_at_once__law(scan_path: Path) -> None:
    files = ScanFiles(scan_path.parent)
    name = Path(scan_path.name)
    np.testing.assert_array_equal(files(name, 5, 7, 20, 10, 1), VALUES[7:17, 5:25])
    halved = files(name, 20, 30, 50, 40, 2)
    expected = VALUES[30:70, 20:70].reshape(20, 2, 25, 2).mean((1, 3))
    assert halved == pytest.approx(expected, abs=1)
    assert files.opened(name) is files.opened(name)


@pytest.mark.parametrize("reduction", [1, 3])
def test_a_scan_in_memory_and_by_windows_is_the_same__law(scan_path: Path, reduction: int) -> None:
    held = ScanSource(scan_path, reduction, 2, 10**9)
    read = ScanSource(scan_path, reduction, 2, 0)
    for window in ((0, 0, 40, 30), (50, 20, 53, 56)):
        np.testing.assert_array_equal(held.window(*window), read.window(*window))
    columns, rows = (-(-size // reduction) for size in (310, 230))
    assert held.window(0, 0, columns, rows).shape == (rows, columns)
    assert held.window(0, 0, 1, 1).dtype == np.uint8


@pytest.fixture
def mask() -> np.ndarray:
    return np.random.default_rng(4).random((53, 71)) < 0.6


def test_what_is_packed_comes_back__law(mask) -> None:
    area = UsableArea.of(mask, (568, 424))
    np.testing.assert_array_equal(area.mask, mask)
    assert len(area.packed) < mask.size / 4


def test_pixels_are_asked_of_the_cell_they_lie_in__truth(mask) -> None:
    area = UsableArea.of(mask, (568, 424))
    rows, columns = np.indices(mask.shape)
    inside = np.column_stack([columns.ravel(), rows.ravel()]) * 8.0
    for offset in (0.01, 7.99):
        np.testing.assert_array_equal(area.at(inside + offset), mask.ravel())
    outside = np.array([[-0.01, 5], [568.01, 5], [5, -0.01], [5, 424.01], [np.nan, 5]])
    assert not area.at(outside).any()


def test_a_window_is_asked_as_its_pixels_are__truth(mask) -> None:
    area = UsableArea.of(mask, (568, 424))
    columns, rows = np.meshgrid(-9 + (np.arange(200) + 0.5) * 3, 17 + (np.arange(150) + 0.5) * 3)
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    found = area.within(-9, 17, 200, 150, 3)
    np.testing.assert_array_equal(found.ravel(), area.at(pixels))


def test_nothing_is_sought_on_a_data_strip__truth(tiny) -> None:
    """The lower third of a scan is no photograph: no point is expected there, no template laid."""
    opened = tiny.opened(tiny.names[0])
    columns, rows = opened.scan.size_px
    strip = np.ones((rows // 8, columns // 8), bool)
    strip[2 * len(strip) // 3 :] = False
    masked = replace(
        opened, scan=replace(opened.scan, usable=UsableArea.of(strip, opened.scan.size_px))
    )
    share = np.stack(np.meshgrid(*[np.linspace(0.2, 0.8, 5)] * 2), axis=-1).reshape(-1, 2)
    pixels = share * np.array(opened.scan.size_px)
    ground = object_on_ground(opened.photo, opened.camera, pixels, tiny.reference.dem)
    flat = np.full(ground.shape, 0.4)
    whole = predict_pixels(opened, np.zeros((6, 6)), ground, flat)
    found = predict_pixels(masked, np.zeros((6, 6)), ground, flat)
    assert whole.inside.all()
    np.testing.assert_array_equal(found.inside, share[:, 1] < 2 / 3)
    window = Window(columns // 2, 2 * rows // 3 - 40, 80, 80, 1)
    usable = read_scan(masked, window).usable
    assert usable[:35].all()
    assert not usable[45:].any()


def test_a_spoilt_world_file_beside_a_scan_is_named__law(tmp_path: Path) -> None:
    """GDAL looks into it when it is asked for colours."""
    path = tmp_path / "scan.tif"
    write_gray(path, np.zeros((40, 60), np.uint8))
    path.with_suffix(".tfw").write_text("<a>" * 2_000_000)
    with pytest.raises(ScanError, match="A file beside it cannot be read"):
        open_scan(path)
