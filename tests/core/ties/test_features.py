"""Features: where they are, where they may be, how they are shared out."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st

from core.raster.scan_file import ScanFile, open_scan
from core.ties.features import FeatureOptions, detect_features, strongest_per_cell
from core.ties.matches import match_features


def texture(rows: int, columns: int, seed: int = 1) -> np.ndarray:
    """Grey values with structure of all sizes."""
    rng = np.random.default_rng(seed)
    total = np.zeros((rows, columns))
    for sigma in (1.5, 3.0, 6.0, 12.0, 24.0):
        layer = cv2.GaussianBlur(rng.normal(size=(rows, columns)), (0, 0), sigma)
        total += layer / layer.std()
    return np.clip(128 + 22 * total, 0, 255).astype(np.uint8)


def write_scan(path: Path, gray: np.ndarray) -> ScanFile:
    profile = {"driver": "GTiff", "count": 1, "dtype": "uint8"}
    rows, columns = gray.shape
    with rasterio.open(path, "w", width=columns, height=rows, **profile) as dataset:
        dataset.write(gray, 1)
    return open_scan(path)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize("longest", [1000, 400], ids=["full size", "reduced"])
def test_half_a_turn_of_the_scan_turns_the_places__law(tmp_path, longest):
    """Any bias of the places, such as half a pixel of the origin, would show twofold."""
    gray = texture(600, 800)
    options = FeatureOptions(longest_side_px=longest, tile_px=256)
    first = detect_features(write_scan(tmp_path / "a.tif", gray), None, options)
    second = detect_features(write_scan(tmp_path / "b.tif", gray[::-1, ::-1]), None, options)
    assert first.reduction == (1 if longest == 1000 else 2)
    matches = match_features(first, second)
    assert len(matches.first) > 500
    there = np.array([800.0, 600.0]) - second.pixels[matches.second]
    off = there - first.pixels[matches.first]
    assert np.abs(np.median(off, axis=0)).max() < 0.02 * first.reduction
    assert np.abs(off[np.abs(off).max(axis=1) < 2].mean(axis=0)).max() < 0.03 * first.reduction


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_features_lie_where_they_may_and_everywhere_there__truth(tmp_path):
    scan = write_scan(tmp_path / "a.tif", texture(500, 700))
    mask = np.zeros((50, 70), dtype=bool)
    mask[10:40, 20:60] = True
    options = FeatureOptions(max_features=2000)
    found = detect_features(scan, mask, options)
    cell = np.floor(found.pixels / 10).astype(int)
    assert mask[cell[:, 1], cell[:, 0]].all()
    assert 1000 < len(found.pixels) <= 2000 + 256
    quarters = np.histogram2d(*found.pixels.T, bins=4, range=[[200, 600], [100, 400]])[0]
    assert quarters.min() > 60
    as_function = detect_features(
        scan, lambda p: mask[np.int64(p[:, 1] // 10), np.int64(p[:, 0] // 10)], options
    )
    assert np.array_equal(as_function.pixels, found.pixels)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_tiles_do_not_change_the_features__law(tmp_path):
    scan = write_scan(tmp_path / "a.tif", texture(500, 700))
    many = FeatureOptions(max_features=100_000)
    whole = detect_features(scan, None, many)
    tiled = detect_features(scan, None, FeatureOptions(max_features=100_000, tile_px=256))
    small = whole.radii_px < 5
    theirs = {tuple(place) for place in np.rint(tiled.pixels * 20).tolist()}
    ours = [tuple(place) in theirs for place in np.rint(whole.pixels[small] * 20).tolist()]
    assert np.mean(ours) > 0.97


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_shading_does_not_choose_the_features__law(tmp_path):
    gray = texture(500, 700).astype(np.float64)
    shade = np.linspace(0.25, 1.0, 700)[None, :]
    plain = detect_features(write_scan(tmp_path / "a.tif", gray.astype(np.uint8)))
    shaded = detect_features(write_scan(tmp_path / "b.tif", (gray * shade).astype(np.uint8)))
    left = [np.mean(found.pixels[:, 0] < 350) for found in (plain, shaded)]
    assert left[1] == pytest.approx(left[0], abs=0.06)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_an_empty_scan_has_no_features__truth(tmp_path):
    scan = write_scan(tmp_path / "a.tif", np.full((300, 400), 90, dtype=np.uint8))
    assert len(detect_features(scan).pixels) == 0


@settings(max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 5), st.floats(0, 1)), max_size=60), st.integers(1, 6))
def test_each_cell_keeps_its_strongest__law(entries, quota):
    cells = np.array([cell for cell, _ in entries], dtype=np.int64)
    strengths = np.array([strength for _, strength in entries], dtype=np.float64)
    kept = strongest_per_cell(cells, strengths, quota)
    dropped = np.setdiff1d(np.arange(len(cells)), kept)
    for cell in range(6):
        inside = kept[cells[kept] == cell]
        assert len(inside) == min(quota, int(np.sum(cells == cell)))
        left = dropped[cells[dropped] == cell]
        if len(left):
            assert strengths[inside].min() >= strengths[left].max()
