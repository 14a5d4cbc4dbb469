"""Peaks of score maps whose places are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter

from core.matching.peaks import (
    FLAT,
    detect_peaks,
    highest_places,
    level_and_spread,
    local_maxima,
    measure_peak,
    nearest_peak,
)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(0, 3))
def test_no_two_peaks_are_closer_than_said_and_none_is_near_the_rim__law(seed, apart, flatness):
    """Whatever the scores, plateaus of rounded values included."""
    rng = np.random.default_rng(seed)
    scores = np.round(rng.normal(size=(31, 37)) * 4 ** (3 - flatness)).astype(np.float32)
    peaks = detect_peaks(scores, 6, apart)
    places = np.round([(peak.column, peak.row) for peak in peaks]).reshape(-1, 2)
    for index, place in enumerate(places):
        assert (place >= apart - 1).all()
        assert (place <= np.array([36, 30]) - apart + 1).all()
        others = np.abs(places[index + 1 :] - place).max(axis=1)
        assert (others >= apart - 1).all()  # each within 0.6 of its own pixel
    values = [peak.value for peak in peaks]
    assert values == sorted(values, reverse=True)


def test_a_flat_top_is_one_peak__truth():
    row, column = np.mgrid[:41, :41]
    scores = np.minimum(np.exp(-((row - 20) ** 2 + (column - 18) ** 2) / 60), 0.97)
    peaks = detect_peaks(scores.astype(np.float32), 5, 4)
    assert len(peaks) == 1
    assert np.hypot(peaks[0].column - 18, peaks[0].row - 20) < 5


def test_a_broad_maximum_is_one_peak_and_its_sides_are_none__truth():
    row, column = np.mgrid[:61, :61]
    scores = np.exp(-((row - 30.3) ** 2 + (column - 24.7) ** 2) / 200).astype(np.float32)
    peaks = detect_peaks(scores, 3, 4)
    assert len(peaks) == 1
    assert (peaks[0].column, peaks[0].row) == pytest.approx((24.7, 30.3), abs=0.02)


@pytest.mark.parametrize("place", [(0, 0), (0, 15), (15, 40), (2, 20), (15, 37)])
def test_a_maximum_at_the_rim_is_none__truth(place):
    """The scores may go on rising outside."""
    row, column = np.mgrid[:31, :41]
    scores = np.exp(-((row - place[0]) ** 2 + (column - place[1]) ** 2) / 40).astype(np.float32)
    assert detect_peaks(scores, 3, 4) == ()


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (3, 9), (5, 5), (9, 9)])
def test_a_small_scores_breaks_nothing__law(shape):
    scores = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    for peak in detect_peaks(scores, 3, 4):
        assert np.isfinite([peak.column, peak.row, peak.z, peak.sigma_px]).all()


def test_a_sharp_peak_is_better_placed_than_a_dull_one__law():
    row, column = np.mgrid[:41, :41]

    def sigma(width):
        hill = np.exp(-((row - 20) ** 2 + (column - 20) ** 2) / (2 * width**2))
        return measure_peak(hill.astype(np.float32), 20, 20, 0.0, 0.3).sigma_px

    sizes = [sigma(width) for width in (0.7, 3.0, 5.0, 7.0, 20.0)]
    assert sizes == sorted(sizes)
    assert (sizes[0], sizes[-1]) == (0.2, 3.0)
    # Noise over curvature: twice the width, four times the standard deviation.
    assert sigma(6.0) == pytest.approx(4 * sigma(3.0), rel=0.1)


def hills(*places: tuple[float, float, float]) -> np.ndarray:
    """Bells of a width of two pixels at columns and rows, with their heights."""
    row, column = np.mgrid[:31, :41]
    bells = [h * np.exp(-((column - c) ** 2 + (row - r) ** 2) / 8) for c, r, h in places]
    return np.sum(bells, axis=0).astype(np.float32)


def test_the_nearest_peak_is_taken_whatever_its_height__truth():
    scores = hills((12.3, 14.6, 5.0), (24.2, 15.8, 9.0))
    found = nearest_peak(scores, 13.0, 14.0, 1.5)
    assert found is not None
    assert (found.column, found.row) == pytest.approx((12.3, 14.6), abs=0.05)
    assert found.z == found.value == scores[15, 12]
    assert nearest_peak(scores, 18.0, 15.0, 1.5) is None
    assert nearest_peak(scores, 1.0, 14.0, 1.5) is None, "a rim has no surroundings to refine in"


def test_highest_places_lie_apart_and_may_lie_at_the_rim__truth():
    scores = hills((0.0, 0.0, 9.0), (20.0, 10.0, 5.0), (26.0, 10.0, 4.0))
    assert highest_places(scores, 2, 6) == [(0, 0), (10, 20)]
    assert highest_places(scores, 3, 5)[2] == (10, 26)
    assert highest_places(scores, 3, 50) == [(0, 0)]


@pytest.mark.parametrize("separation", [1, 2, 5])
def test_local_maxima_are_those_of_scipy__oracle(separation):
    scores = np.round(np.random.default_rng(separation).normal(size=(40, 33)), 1)
    scores = scores.astype(np.float32)
    expected = maximum_filter(scores, size=2 * separation + 1) == scores
    np.testing.assert_array_equal(local_maxima(scores, separation), expected)


def test_level_and_spread_are_those_of_most_scores__truth():
    scores = np.random.default_rng(2).normal(0.3, 0.1, (80, 80)).astype(np.float32)
    scores[:10] = 5.0
    middle, spread = level_and_spread(scores)
    # An eighth of outliers moves the median by 0.16 and widens the spread by 0.2 of a deviation.
    assert middle == pytest.approx(0.3, abs=0.03)
    assert spread == pytest.approx(0.1, abs=0.03)
    assert level_and_spread(np.full((5, 5), 0.7, np.float32))[1] == pytest.approx(FLAT)
