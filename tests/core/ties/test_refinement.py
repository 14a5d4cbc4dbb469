"""Least squares matching on patches bent by a known affinity."""

import cv2
import numpy as np
import pytest

from core.raster.scan_file import open_scan
from core.ties.refinement import (
    PatchSize,
    local_affinities,
    patch_centres,
    read_patches,
    refine_rays,
)
from tests.core.ties.rendered import write

SIZE = PatchSize.at_reduction()
LINEAR = np.array([[0.97, 0.12], [-0.15, 1.04]])


def bent_pair(noise: float, seed: int = 1):
    """Two pictures, the second a bent copy of the first, and points of both."""
    rng = np.random.default_rng(seed)
    total = np.zeros((800, 800), dtype=np.float32)
    for cell in (2, 4, 8, 16):
        coarse = rng.normal(size=(800 // cell, 800 // cell)).astype(np.float32)
        total += cv2.resize(coarse, (800, 800), interpolation=cv2.INTER_CUBIC)
    offset = np.array([30.3, 70.7])
    # OpenCV counts from the middle of the first pixel, the points below from its corner.
    shift = LINEAR @ np.array([0.5, 0.5]) + offset - 0.5
    matrix = np.column_stack([LINEAR, shift])
    second = cv2.warpAffine(total, matrix, (900, 900), flags=cv2.INTER_CUBIC)
    places = rng.uniform(120, 680, (300, 2))
    first = 128 + 20 * total + rng.normal(0, noise, total.shape)
    second = 40 + 1.4 * (60 + 20 * second) + rng.normal(0, noise, second.shape)
    return first, second, places, places @ LINEAR.T + offset


def matched(tmp_path, noise: float):
    first, second, here, there = bent_pair(noise)
    write(tmp_path / "a.tif", first)
    write(tmp_path / "b.tif", second)
    fixed_at = patch_centres(here)
    start_at = there + (fixed_at - here) @ LINEAR.T
    rng = np.random.default_rng(2)
    guess = start_at + rng.uniform(-1.2, 1.2, here.shape)
    fixed = read_patches(open_scan(tmp_path / "a.tif"), fixed_at, SIZE.radius_px)
    searched = read_patches(open_scan(tmp_path / "b.tif"), guess, SIZE.searched_radius_px)
    middle = patch_centres(guess)
    rough = LINEAR + 0.05
    start = np.concatenate(
        [np.tile(rough, (len(here), 1, 1)), (guess - middle)[:, :, None]], axis=2
    )
    found = refine_rays(fixed, searched, start, max_shift_px=3.0, size=SIZE)
    return found, middle + found.pixels - start_at


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_places_are_found_to_hundredths_of_a_pixel__truth(tmp_path):
    found, off = matched(tmp_path, noise=2.0)
    assert found.good.mean() > 0.97
    assert np.sqrt(np.mean(off[found.good] ** 2)) < 0.03
    assert np.abs(off[found.good].mean(axis=0)).max() < 0.005
    assert found.correlation[found.good].min() > 0.9


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_noise_is_told_by_the_formal_deviations__truth(tmp_path):
    quiet, _ = matched(tmp_path, noise=3.0)
    loud, off = matched(tmp_path, noise=9.0)
    ratio = np.median(loud.sigma_px[loud.good]) / np.median(quiet.sigma_px[quiet.good])
    # Three times the noise, less what the resampling of the second picture leaves in both.
    assert 1.4 < ratio < 3.2
    spread = np.sqrt(np.mean(off[loud.good] ** 2))
    # Too small by what smoothing does to the noise: the y-parallaxes of the block set it right.
    assert 0.25 * spread < np.median(loud.sigma_px[loud.good]) < 1.2 * spread


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_patches_of_elsewhere_are_refused__truth(tmp_path):
    first, second, here, there = bent_pair(2.0)
    write(tmp_path / "a.tif", first)
    write(tmp_path / "b.tif", second)
    fixed = read_patches(open_scan(tmp_path / "a.tif"), here, SIZE.radius_px)
    searched = read_patches(open_scan(tmp_path / "b.tif"), there[::-1], SIZE.searched_radius_px)
    start = np.tile(np.column_stack([LINEAR, np.zeros(2)]), (len(here), 1, 1))
    assert refine_rays(fixed, searched, start, max_shift_px=3.0, size=SIZE).good.mean() < 0.02


def test_affinities_follow_slopes__truth():
    rng = np.random.default_rng(3)
    first = rng.uniform(0, 3000, (4000, 2))
    second = first @ LINEAR.T
    second[:, 0] += 100 * -np.cos(first[:, 0] / 500)
    at = rng.uniform(300, 2700, (100, 2))
    found = local_affinities(at, first, second)
    expected = np.tile(LINEAR, (100, 1, 1))
    expected[:, 0, 0] += 0.2 * np.sin(at[:, 0] / 500)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.02


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_patches_are_cut_about_their_pixel_in_any_band__truth(tmp_path):
    gray = np.arange(60 * 80, dtype=np.float64).reshape(60, 80) % 251
    write(tmp_path / "a.tif", gray)
    scan = open_scan(tmp_path / "a.tif")
    centres = np.array([[40.2, 30.9], [10.0, 50.5], [70.9, 8.1], [0.5, 0.5]])
    for band in (1, 16, 500):
        patches = read_patches(scan, centres, 3, band_px=band)
        for centre, patch in zip(centres, patches, strict=True):
            column, row = np.floor(centre).astype(int)
            assert patch[3, 3] == gray[row, column]
        assert np.array_equal(patches[0], gray[27:34, 37:44])
        assert patches[3][0, 0] == gray[0, 0]
