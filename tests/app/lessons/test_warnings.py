"""What a drawing, its figures and its warning say of one state is the same."""

from types import ModuleType

import numpy as np
import pytest

from app.lessons import absolute, corrections, interior, relative, resection, stereo, tilt
from app.lessons.photo import HALF_MM
from app.lessons.sheet import Lesson, View


def shown(lesson: Lesson, **moved: float) -> View:
    return lesson.view(lesson.start | moved)


@pytest.mark.parametrize("mark", [-50.0, 0.0, 250.0])
def test_the_floating_mark_is_drawn_where_its_figure_says__law(mark: float) -> None:
    """It was told with the other sign."""
    view = shown(stereo.LESSON, mark=mark)
    drawn = view.canvases[1].shapes[-1]
    assert drawn.points[0][0] == pytest.approx(view.figures["split"].value, abs=1e-3)


def test_a_base_that_no_film_covers_is_warned_of__law() -> None:
    wide = shown(stereo.LESSON, B=3000, H=600, c=310)
    assert wide.warning == "beyond"
    assert HALF_MM < 3000 / 2 / 600 * 310
    assert shown(stereo.LESSON).warning == ""
    # The curve goes as far as the place on it that is marked.
    assert wide.plot is not None
    assert wide.plot.curves[0].points[-1][0] == pytest.approx(3000 / 600)
    narrow = shown(stereo.LESSON, B=200, H=6000).plot
    assert narrow is not None
    assert narrow.curves[0].points[0] == pytest.approx(narrow.at)


def test_ground_above_the_aircraft_leaves_the_lens_alone__law() -> None:
    for height, ground in ((600, 600), (600, 2000)):
        view = shown(corrections.LESSON, H=height, h=ground, lens=12, r=100)
        assert view.warning == "below"
        assert {name: one.value for name, one in view.figures.items()} == pytest.approx(
            {"lens": 12}
        )
        assert not {"K", "Δr_a", "Δr_e"} & set(view.symbols)
    assert shown(corrections.LESSON, H=700, h=600).warning == ""


@pytest.mark.parametrize("model", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("end", [0, 1])
def test_arrows_of_the_frame_stay_in_the_drawing__law(model: float, end: int) -> None:
    """As many times their size as is said, and never beyond the edge."""
    extreme = {one.name: (one.low, one.high)[end] for one in interior.LESSON.sliders}
    across = extreme | {"shrink_y": interior.LESSON.sliders[1].high * (1 - end)}
    for state in (extreme, across, {"bend": 5.0}, {}):
        view = shown(interior.LESSON, **(state | {"model": model}))
        arrows = [one for one in view.canvases[0].shapes if one.kind == "arrow"]
        assert len(arrows) == 9
        assert np.abs([one.points for one in arrows]).max() <= view.canvases[0].window[2]
        times = view.figures["times"].value
        for one in arrows:
            assert one.number is not None
            drawn = np.hypot(*np.subtract(*one.points))
            assert drawn == pytest.approx(times * one.number.value / 1000, abs=0.01)
    assert shown(interior.LESSON).figures["times"].value == 400


def test_the_scale_number_grows_towards_the_horizon__law() -> None:
    """The photo has it on the right, as the plot."""
    view = shown(tilt.LESSON, t=30)
    assert view.plot is not None
    assert view.plot.at is not None
    numbers = [number for _, number in view.plot.curves[0].points]
    assert np.all(np.diff(numbers) > 0)
    assert view.plot.at[0] == pytest.approx(-view.figures["isocentre"].value)


def test_a_foot_in_the_sky_is_warned_of__law() -> None:
    assert shown(tilt.LESSON, t=40, c=85, x=110).warning == "sky"
    assert shown(tilt.LESSON).warning == ""


def test_points_that_fix_nothing_are_warned_of__law() -> None:
    line = {f"y{i}": 0.0 for i in range(1, 5)} | {"relief": 0.0}
    assert shown(resection.LESSON, **line).warning == "undetermined"
    assert shown(resection.LESSON).warning == ""


@pytest.mark.parametrize("module", [relative, absolute])
def test_what_least_squares_finds_is_not_moved_and_shown_as_found__law(module: ModuleType) -> None:
    hand = shown(module.LESSON, omega=1.0)
    assert not hand.idle
    found = shown(module.LESSON, omega=1.0, solve=1.0)
    assert set(found.idle) == set(found.in_force) == set(module.NAMES)
    for name, value in found.in_force.items():
        assert value == pytest.approx(found.figures[name].value, abs=0.005)
        # By hand nothing of it is seen; noise leaves it near what was put in.
        assert value == pytest.approx(found.figures[name].truth, abs=0.05)


def test_the_plot_marks_the_known_points_in_use__law() -> None:
    for count in (3, 8):
        plot = shown(absolute.LESSON, n=count).plot
        assert plot is not None
        assert plot.at in plot.curves[0].points or list(plot.at or ()) in plot.curves[0].points
        assert plot.at is not None
        assert plot.at[0] == count
        assert list(plot.at) in plot.curves[0].points
