"""Peaks of score maps whose places are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter
from scipy.signal import correlate2d

from core.matching.operators import doubled_angle_field, high_passed
from core.matching.peaks import (
    FLAT,
    channel_scores,
    correlation_scores,
    cosine_scores,
    detect_peaks,
    finite,
    highest_places,
    level_and_spread,
    local_maxima,
    measure_peak,
    nearest_peak,
    normalised,
    sum_of_products,
)


@settings(max_examples=40)
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


HALF, SEARCH = 30, 12
RIM = 20
"""Pixels cut off after filtering, so that the filters' own edges play no part."""


def texture(column: np.ndarray, row: np.ndarray, seed: int) -> np.ndarray:
    """Grey values known at every place: waves of 5 to 25 pixels in all directions."""
    rng = np.random.default_rng(seed)
    total = np.zeros(np.broadcast(column, row).shape)
    for _ in range(60):
        length, way, phase = rng.uniform(5, 25), rng.uniform(0, np.pi), rng.uniform(0, 2 * np.pi)
        wave = 2 * np.pi / length
        total += np.cos(wave * (column * np.cos(way) + row * np.sin(way)) + phase)
    return 120 + 12 * total


def picture(half: int, seed: int, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """The texture about the origin; `shift` moves it to the right and downwards."""
    row, column = np.mgrid[-half - RIM : half + RIM + 1, -half - RIM : half + RIM + 1]
    return texture(column - shift[0], row - shift[1], seed).astype(np.float32)


def trimmed(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image[RIM:-RIM, RIM:-RIM])


def ncc(window: np.ndarray, template: np.ndarray) -> np.ndarray:
    return correlation_scores(
        trimmed(high_passed(window, 10.0)), trimmed(high_passed(template, 10.0))
    )


def gradient(window: np.ndarray, template: np.ndarray) -> np.ndarray:
    return cosine_scores(
        trimmed(doubled_angle_field(window)), trimmed(doubled_angle_field(template))
    )


OPERATORS = {"ncc": ncc, "gradient": gradient}


def top(scores: np.ndarray):
    return detect_peaks(scores, 1, 4)[0]


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("seed", range(6))
def test_a_shift_is_found_to_a_twentieth_of_a_pixel__truth(operator, seed):
    shift = np.random.default_rng(seed).uniform(-8, 8, 2)
    window = picture(HALF + SEARCH, seed, (float(shift[0]), float(shift[1])))
    peak = top(OPERATORS[operator](window, picture(HALF, seed)))
    found = np.array([peak.column, peak.row]) - SEARCH
    np.testing.assert_allclose(found, shift, atol=0.05)
    assert peak.value > 0.9
    assert peak.z > 4


@pytest.mark.parametrize("seed", range(4))
def test_a_dark_road_turned_bright_is_found_by_gradients_alone__truth(seed):
    window = 255 - picture(HALF + SEARCH, seed, (5.3, -3.6))
    template = picture(HALF, seed)
    peak = top(gradient(window, template))
    np.testing.assert_allclose([peak.column - SEARCH, peak.row - SEARCH], (5.3, -3.6), atol=0.1)
    every = detect_peaks(ncc(window, template), 5, 4)
    assert all(np.hypot(p.column - SEARCH - 5.3, p.row - SEARCH + 3.6) > 2 for p in every)


@pytest.mark.parametrize("operator", OPERATORS)
def test_brightness_and_contrast_do_not_matter__law(operator):
    window, template = picture(HALF + SEARCH, 1, (2.0, 3.0)), picture(HALF, 1)
    one = OPERATORS[operator](window, template)
    other = OPERATORS[operator](0.3 * window + 90, template)
    np.testing.assert_allclose(one, other, atol=2e-3)


def test_two_blank_pictures_are_not_alike__truth():
    blank = np.full((40, 40), 180, np.float32)
    assert (correlation_scores(blank, blank[:30, :30].copy()) == 0).all()


@pytest.mark.parametrize("operator", OPERATORS)
def test_flat_windows_and_flat_templates_have_no_peak__truth(operator):
    flat = np.full((2 * (HALF + SEARCH + RIM) + 1,) * 2, 180, np.float32)
    dull = np.full((2 * (HALF + RIM) + 1,) * 2, 180, np.float32)
    for window, template in (
        (flat, picture(HALF, 0)),
        (picture(HALF + SEARCH, 0), dull),
        (flat, dull),
    ):
        assert detect_peaks(OPERATORS[operator](window, template), 3, 4) == ()


@pytest.mark.parametrize("operator", OPERATORS)
def test_values_that_are_none_have_no_peak__truth(operator):
    window, template = picture(HALF + SEARCH, 0), picture(HALF, 0)
    window[40:60, 40:60] = np.nan
    scores = OPERATORS[operator](window, template)
    assert np.isfinite(scores).all()
    for peak in detect_peaks(scores, 3, 4):
        assert np.isfinite([peak.column, peak.row, peak.value, peak.z, peak.sigma_px]).all()
        assert peak.value < 0.5
    empty = np.full_like(window, np.nan)
    assert detect_peaks(OPERATORS[operator](empty, template), 3, 4) == ()


def test_correlation_is_that_of_numpy__oracle():
    rng = np.random.default_rng(3)
    window, template = (rng.normal(size=(n, n)).astype(np.float32) for n in (12, 5))
    scores = correlation_scores(window, template)
    assert scores.shape == (8, 8)
    for row, column in ((0, 0), (3, 6), (7, 7)):
        part = window[row : row + 5, column : column + 5]
        expected = np.corrcoef(part.ravel(), template.ravel())[0, 1]
        assert scores[row, column] == pytest.approx(expected, abs=1e-5)


def test_sums_of_products_over_layers_are_those_of_scipy__oracle():
    rng = np.random.default_rng(4)
    window, template = (
        [rng.normal(size=(n, n, 3)).astype(np.float32), rng.normal(size=(n, n)).astype(np.float32)]
        for n in (14, 6)
    )
    layers = [(window[0][:, :, i], template[0][:, :, i]) for i in range(3)]
    layers.append((window[1], template[1]))
    expected = sum(correlate2d(*pair, mode="valid") for pair in layers)
    np.testing.assert_allclose(sum_of_products(window, template), expected, atol=1e-4)


def test_channels_score_one_where_the_template_was_cut__truth():
    rng = np.random.default_rng(5)
    channels = rng.uniform(0, 1, (20, 20, 3)).astype(np.float32)
    energy = np.asarray(np.sum(channels**2, axis=2), np.float32)
    part = np.s_[6:13, 9:16]
    cut = tuple(np.ascontiguousarray(layer[part]) for layer in (channels, energy))
    scores = channel_scores((channels, energy), cut)
    assert np.unravel_index(int(np.argmax(scores)), scores.shape) == (6, 9)
    assert scores[6, 9] == pytest.approx(1.0, abs=1e-4)
    assert scores.max() <= 1.0 + 1e-4


def test_places_without_energy_score_nought__law():
    product = np.array([[2.0, 3.0], [1.0, 0.0]], np.float32)
    energy = np.array([[4.0, 0.0], [1.0, 1e-9]], np.float32)
    np.testing.assert_allclose(normalised(product, energy, 1.0), [[1, 0], [1, 0]], atol=1e-6)


def test_what_is_no_correlation_counts_as_nought__law():
    scores = np.array([[np.nan, np.inf, 0.4], [1.0, -1.0, 1.5]], np.float32)
    np.testing.assert_array_equal(finite(scores), np.float32([[0, 0, 0.4], [1, -1, 0]]))
