"""A template searched in a window."""

import numpy as np
import pytest
from scipy.signal import correlate2d

from core.matching.operators import doubled_angle_field, high_passed
from core.matching.peaks import detect_peaks
from core.matching.template_search import (
    channel_scores,
    correlation_scores,
    cosine_scores,
    finite,
    normalised,
    sum_of_products,
)

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
