"""A tilted photo: what it displaces, beside collinearity, and squares up to the horizon."""

import numpy as np
import pytest

from app.found_lessons import find_lessons
from app.lessons.photo import HALF_MM, tilted_at
from app.teaching import Teacher, state_of
from core.geometry.image_corrections import nadir_on_film

LESSONS = find_lessons()
TILT = LESSONS["tilt"]


def film(**state):
    return next(one for one in TILT.view(state_of(TILT, state)).canvases if one.name == "film")


@pytest.mark.parametrize("direction", [0, 75, 200])
def test_tilt_displaces_as_collinearity_says__truth(direction):
    for tilt, x, y in ((2, 80, -90), (20, -60, 40), (50, 10, 5)):
        figures = TILT.view(
            state_of(TILT, {"t": tilt, "direction": direction, "x": x, "y": y})
        ).figures
        if "by_tilt" in figures:
            assert figures["by_tilt"].value == pytest.approx(figures["by_tilt"].truth, abs=1e-9)


def test_relief_displaces_a_vertical_photo_as_its_formula_says_and_a_tilted_one_not__truth():
    for h in (50, 400):
        level = TILT.view(state_of(TILT, {"t": 0, "h": h})).figures["by_relief"]
        assert level.value == pytest.approx(level.truth, rel=1e-4)
        tilted = TILT.view(state_of(TILT, {"t": 20, "h": h})).figures["by_relief"]
        assert abs(tilted.value / tilted.truth - 1) > 0.1


def test_the_truth_of_both_is_hidden_and_shown__law():
    teacher = Teacher(LESSONS)
    for shown in (False, True):
        view = teacher.view("tilt", {}, shown)
        looks = {shape["look"] for canvas in view["canvases"] for shape in canvas["shapes"]}
        assert ("truth" in looks) is shown
        for name in ("by_tilt", "by_relief"):
            assert (view["figures"][name]["truth"] is not None) is shown


def test_a_foot_in_the_sky_has_no_tower__law():
    figures = TILT.view(state_of(TILT, {"t": 60, "x": 110, "y": 0})).figures
    assert "by_tilt" not in figures
    assert "nadir" in figures


@pytest.mark.parametrize("direction", [0, 30, 200])
@pytest.mark.parametrize("tilt", [0, 10, 20, 30])
def test_squares_go_as_far_as_the_picture__law(tilt, direction):
    """To both edges of the drawing along the tilt; before they ended within the photo."""
    canvas = film(t=tilt, direction=direction)
    lines = np.array([s.points for s in canvas.shapes if s.look == "faint"])
    along = np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction))])
    reach = lines @ along
    assert reach.min() < -canvas.window[2]
    assert reach.max() > canvas.window[2]


def test_squares_go_to_the_horizon__law():
    """Nearer to it than a tenth of the photo; and none lies beyond."""
    canvas = film(t=55, c=152)
    lines = np.array([s.points for s in canvas.shapes if s.look == "faint"])
    nadir = nadir_on_film(tilted_at(1500.0, np.radians(55), 0.0), 152.0)[0]
    horizon = 152.0**2 / np.hypot(*nadir)
    assert 0 < horizon - lines[..., 0].max() < 0.1 * 2 * HALF_MM
