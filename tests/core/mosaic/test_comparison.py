"""Accuracy of orthos whose errors were put in."""

import numpy as np
import pytest
import rasterio
from affine import Affine
from scipy import ndimage

from core.errors import CrsError, ReferenceDataError
from core.mosaic.comparison import ComparisonOptions, compare_orthos
from core.quality.readings import circular_error_90, rms_interval

CRS = "EPSG:32633"
WEST, NORTH = 500_000.0, 4_100_000.0


def write(path, values, gsd, west=WEST, north=NORTH, crs=CRS, nodata=0):
    values = np.clip(np.rint(values), 1, 255).astype(np.uint8)
    bands = values if values.ndim == 3 else values[None]
    profile = {"width": bands.shape[2], "height": bands.shape[1], "count": len(bands)}
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        dtype="uint8",
        crs=crs,
        nodata=nodata,
        transform=Affine(gsd, 0, west, 0, -gsd, north),
        **profile,
    ) as file:
        file.write(bands)
    return path


@pytest.fixture(scope="module")
def landscape():
    """Ground at 0.25 m with detail of many sizes."""
    rng = np.random.default_rng(7)
    fields = np.kron(rng.uniform(60, 190, (36, 36)), np.ones((50, 50)))[:1800, :1800]
    detail = sum(
        ndimage.gaussian_filter(rng.normal(size=(1800, 1800)), s) * s * 18 for s in (1.5, 3, 7)
    )
    return ndimage.gaussian_filter(fields, 1.0) + detail


def resampled(landscape, step, shift_m=(0.0, 0.0), warp=None):
    """The ground at `step` quarter metres; the content moved east, north by a shift or a field."""
    size = 1600 // step
    columns, rows = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    east, north = columns * step * 0.25, -rows * step * 0.25
    moved_e, moved_n = shift_m if warp is None else warp(east, north)
    places = [(-(north - moved_n)) / 0.25 - 0.5 + 100, (east - moved_e) / 0.25 - 0.5 + 100]
    smooth = ndimage.gaussian_filter(landscape, 0.45 * step)
    return ndimage.map_coordinates(smooth, places, order=3)


@pytest.mark.parametrize("shift", [(0.13, -0.31), (3.7, 2.2), (-0.25, 0.5)])
def test_a_shift_is_found_to_hundredths_of_a_pixel__truth(landscape, tmp_path, shift):
    rng = np.random.default_rng(1)
    truth = resampled(landscape, 2)
    product = 0.8 * resampled(landscape, 2, shift) + 20 + rng.normal(0, 4, truth.shape)
    found = compare_orthos(
        write(tmp_path / "p.tif", product, 0.5), write(tmp_path / "t.tif", truth, 0.5)
    )
    assert found.n >= 100
    assert np.abs(np.array(found.mean_shift) - shift).max() < 0.01
    assert max(found.deviation) < 0.02
    assert found.m_p == pytest.approx(np.hypot(*shift), abs=0.02)


def test_other_pixel_size_and_grid_do_not_shift__truth(landscape, tmp_path):
    truth = np.stack([resampled(landscape, 2)] * 3)
    product = resampled(landscape, 5, (0.4, 0.7))
    found = compare_orthos(
        write(tmp_path / "p.tif", product, 1.25), write(tmp_path / "t.tif", truth, 0.5)
    )
    assert found.ground_sample_distance_m == 1.25
    assert np.abs(np.array(found.mean_shift) - (0.4, 0.7)).max() < 0.02
    back = compare_orthos(tmp_path / "t.tif", tmp_path / "p.tif")
    assert np.abs(np.add(back.mean_shift, (0.4, 0.7))).max() < 0.02


def test_offset_grids_are_brought_together__truth(landscape, tmp_path):
    truth = write(tmp_path / "t.tif", resampled(landscape, 2), 0.5)
    moved = write(
        tmp_path / "p.tif", resampled(landscape, 2, (0.2, 0.1)), 0.5, WEST + 0.2, NORTH + 0.1
    )
    found = compare_orthos(moved, truth)
    assert np.abs(np.array(found.mean_shift) - (0.4, 0.2)).max() < 0.01


def test_a_warp_is_seen_place_by_place__truth(landscape, tmp_path):
    def warp(east, north):
        return 1.5 * np.sin(east / 120), 0.8 * np.cos(north / 90) + 0.3

    truth = write(tmp_path / "t.tif", resampled(landscape, 2), 0.5)
    product = write(tmp_path / "p.tif", resampled(landscape, 2, warp=warp), 0.5)
    found = compare_orthos(product, truth)
    used = found.places.used
    positions = found.places.positions[used] - (WEST, NORTH)
    wanted = np.column_stack(warp(positions[:, 0] + 0.5, positions[:, 1]))
    errors = found.places.shifts_m[used] - wanted
    assert np.sqrt(np.mean(errors**2)) < 0.06
    assert found.m_x == pytest.approx(np.sqrt(np.mean(wanted[:, 0] ** 2)), rel=0.05)
    assert found.m_y == pytest.approx(np.sqrt(np.mean(wanted[:, 1] ** 2)), rel=0.05)


def test_changed_ground_does_not_enter__truth(landscape, tmp_path):
    rng = np.random.default_rng(5)
    truth = resampled(landscape, 2)
    product = resampled(landscape, 2, (0.3, -0.2))
    product[:300, :400] = ndimage.gaussian_filter(rng.normal(size=(300, 400)), 2) * 120 + 120
    found = compare_orthos(
        write(tmp_path / "p.tif", product, 0.5), write(tmp_path / "t.tif", truth, 0.5)
    )
    assert sum(found.refused.values()) > 15
    assert np.abs(np.array(found.mean_shift) - (0.3, -0.2)).max() < 0.02
    assert found.largest < 0.6


def test_a_displaced_corner_counts_as_error__truth(landscape, tmp_path):
    def warp(east, north):
        inside = (east < 120) & (north > -120)
        return np.where(inside, 4.0, 0.0), np.zeros_like(north)

    found = compare_orthos(
        write(tmp_path / "p.tif", resampled(landscape, 2, warp=warp), 0.5),
        write(tmp_path / "t.tif", resampled(landscape, 2), 0.5),
    )
    assert found.m_x > 0.8
    assert found.largest == pytest.approx(4.0, abs=0.1)


def test_nothing_in_common_is_said__law(landscape, tmp_path):
    truth = write(tmp_path / "t.tif", landscape[:200, :200], 0.5)
    away = write(tmp_path / "p.tif", landscape[:200, :200], 0.5, WEST + 5000)
    bare = write(tmp_path / "b.tif", landscape[:200, :200], 0.5, crs=None)
    noise = write(tmp_path / "n.tif", np.random.default_rng(1).uniform(1, 255, (400, 400)), 0.5)
    with pytest.raises(ReferenceDataError, match="no area in common"):
        compare_orthos(away, truth)
    with pytest.raises(CrsError, match="no CRS"):
        compare_orthos(bare, truth)
    with pytest.raises(ReferenceDataError, match="recognised"):
        compare_orthos(noise, write(tmp_path / "l.tif", landscape[:400, :400], 0.5))


def test_places_and_search_are_options__law(landscape, tmp_path):
    truth = write(tmp_path / "t.tif", resampled(landscape, 2), 0.5)
    few = compare_orthos(truth, truth, ComparisonOptions(places=30, search_px=8))
    assert 20 <= len(few.places.verdicts) <= 50
    assert few.m_p < 1e-3


def test_interval_of_a_root_mean_square__paper():
    # Chi-square with 10 degrees of freedom: 3.247 and 20.483 at 2.5 % and 97.5 %.
    low, high = rms_interval(1.0, 10)
    assert low == pytest.approx(np.sqrt(10 / 20.483), rel=1e-4)
    assert high == pytest.approx(np.sqrt(10 / 3.247), rel=1e-4)


def test_nine_in_ten_normal_errors_lie_within_ce90__law():
    errors = np.random.default_rng(17).normal(0, 0.4, (100_000, 2))
    lengths = np.linalg.norm(errors, axis=1)
    radius = circular_error_90(float(np.sqrt(np.mean(lengths**2))))
    # The share of 100,000 draws has a standard deviation of 0.00095.
    assert np.mean(lengths < radius) == pytest.approx(0.9, abs=0.003)
