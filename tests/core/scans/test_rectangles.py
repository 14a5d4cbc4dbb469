"""Rectangles through peaks of four windows."""

import numpy as np
import pytest

from core.scans.naming import CORNERS, SIDES
from core.scans.rectangles import fit_rectangles


def peaks_of(directions: np.ndarray, half: tuple[float, float], turn: float) -> np.ndarray:
    """Three peaks a window, of which the second is the mark."""
    rng = np.random.default_rng(7)
    film = directions * half
    place = np.exp(1j * turn) * (film @ np.array([1, 1j])) + (300 - 200j)
    aside = rng.uniform(-40, 40, (4, 3)) + 1j * rng.uniform(-40, 40, (4, 3))
    aside[:, 1] = 0
    return place[:, None] + aside


@pytest.mark.parametrize("group", [CORNERS, SIDES], ids=["corners", "sides"])
def test_the_marks_are_the_rectangle_that_fits__truth(group: dict) -> None:
    directions = np.array(list(group.values()))
    fitted = fit_rectangles(peaks_of(directions, (830.0, 842.0), 0.02), directions)
    best = int(np.argmin(np.where(fitted.seen.all(axis=1), fitted.apart.max(axis=1), np.inf)))
    assert fitted.chosen[best].tolist() == [1, 1, 1, 1]
    assert fitted.half[best] == pytest.approx([830.0, 842.0])
    assert fitted.turn[best] == pytest.approx(0.02)
    assert fitted.middle[best] == pytest.approx(300 - 200j)


@pytest.mark.parametrize("missing", range(4))
def test_three_marks_put_the_fourth__truth(missing: int) -> None:
    directions = np.array(list(CORNERS.values()))
    places = peaks_of(directions, (830.0, 842.0), -0.03)
    wanted = places[missing, 1]
    places[missing] = np.nan
    fitted = fit_rectangles(places, directions)
    assert not fitted.seen[:, missing].any()
    best = int(np.argmin(fitted.apart.max(axis=1)))
    drawn = directions[missing] * fitted.half[best] @ np.array([1, 1j])
    put = fitted.middle[best] + np.exp(1j * fitted.turn[best]) * drawn
    assert put == pytest.approx(wanted)


def test_what_is_no_rectangle_says_how_far_off_it_is__law() -> None:
    directions = np.array(list(CORNERS.values()))
    places = peaks_of(directions, (830.0, 842.0), 0.0)[:, 1:2].copy()
    places[0] += 8.0
    fitted = fit_rectangles(places, directions)
    whole = fitted.apart[fitted.seen.all(axis=1)]
    assert 1.0 < whole.max() < 8.0
