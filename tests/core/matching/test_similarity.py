"""Two operators, and the maxima of what they say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.matching.similarity import (
    detect_peaks,
    doubled_angle_field,
    gradient_surface,
    high_passed,
    measure_peak,
    ncc_surface,
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
    return ncc_surface(trimmed(high_passed(window, 10.0)), trimmed(high_passed(template, 10.0)))


def gradient(window: np.ndarray, template: np.ndarray) -> np.ndarray:
    return gradient_surface(
        trimmed(doubled_angle_field(window)), trimmed(doubled_angle_field(template))
    )


OPERATORS = {"ncc": ncc, "gradient": gradient}


def top(surface: np.ndarray):
    return detect_peaks(surface, 1, 4)[0]


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


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(0, 3))
def test_no_two_peaks_are_closer_than_said_and_none_is_near_the_rim__law(seed, apart, flatness):
    """Whatever the surface, plateaus of rounded values included."""
    rng = np.random.default_rng(seed)
    surface = np.round(rng.normal(size=(31, 37)) * 4 ** (3 - flatness)).astype(np.float32)
    peaks = detect_peaks(surface, 6, apart)
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
    surface = np.minimum(np.exp(-((row - 20) ** 2 + (column - 18) ** 2) / 60), 0.97)
    peaks = detect_peaks(surface.astype(np.float32), 5, 4)
    assert len(peaks) == 1
    assert np.hypot(peaks[0].column - 18, peaks[0].row - 20) < 5


def test_a_broad_maximum_is_one_peak_and_its_sides_are_none__truth():
    row, column = np.mgrid[:61, :61]
    surface = np.exp(-((row - 30.3) ** 2 + (column - 24.7) ** 2) / 200).astype(np.float32)
    peaks = detect_peaks(surface, 3, 4)
    assert len(peaks) == 1
    assert (peaks[0].column, peaks[0].row) == pytest.approx((24.7, 30.3), abs=0.02)


@pytest.mark.parametrize("place", [(0, 0), (0, 15), (15, 40), (2, 20), (15, 37)])
def test_a_maximum_at_the_rim_is_none__truth(place):
    """The surface may go on rising outside."""
    row, column = np.mgrid[:31, :41]
    surface = np.exp(-((row - place[0]) ** 2 + (column - place[1]) ** 2) / 40).astype(np.float32)
    assert detect_peaks(surface, 3, 4) == ()


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (3, 9), (5, 5), (9, 9)])
def test_a_small_surface_breaks_nothing__law(shape):
    surface = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    for peak in detect_peaks(surface, 3, 4):
        assert np.isfinite([peak.column, peak.row, peak.z, peak.sigma_px]).all()


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
    surface = OPERATORS[operator](window, template)
    assert np.isfinite(surface).all()
    for peak in detect_peaks(surface, 3, 4):
        assert np.isfinite([peak.column, peak.row, peak.value, peak.z, peak.sigma_px]).all()
        assert peak.value < 0.5
    empty = np.full_like(window, np.nan)
    assert detect_peaks(OPERATORS[operator](empty, template), 3, 4) == ()


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
