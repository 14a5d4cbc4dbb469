"""Lessons (h) and (k): nothing but points decides, or it is said what else does."""

import numpy as np
import pytest

from app.lessons import control, least_squares, sheet
from app.lessons.photo import photo_model
from app.teaching import state_of

PHOTO, BLOCK = least_squares.LESSON, control.LESSON
CORNER = {"x": 0.0, "y": 0.0}


def seen(lesson: sheet.Lesson, **state: float) -> sheet.View:
    return lesson.view(state_of(lesson, state))


def shown(view: sheet.View) -> dict[str, float]:
    """Figures with the digits they are shown with."""
    return {name: round(one.value, one.digits) for name, one in view.figures.items()}


def test_three_points_leave_no_residual_wherever_they_lie__law() -> None:
    """Six observations, six unknowns; or no camera sees the points so, and that is said."""
    rng, nowhere = np.random.default_rng(7), 0
    states = [
        {
            "count": 3, "x1": float(x), "y1": float(y), "which": float(which),
            "error": float(rng.choice([-40, 15, 40])),
        }
        for x, y, which in zip(
            rng.integers(-105, 106, 60), rng.integers(-105, 106, 60), rng.integers(1, 9, 60),
            strict=True,
        )
    ]  # fmt: skip
    states.append({"count": 3, "x1": 80, "y1": -7, "error": -40})
    for state in states:
        view = seen(PHOTO, **state)
        figures = shown(view)
        assert view.symbols["r"].value == 0
        assert "least" not in figures
        assert [one.left for one in view.equations] == ["r"]
        assert np.isnan(figures["sigma_nought"])
        assert figures["redundancy"] == 0
        assert figures["wrong"] == min(state.get("which", 1), 3)
        nowhere += view.warning == "nowhere"
        if view.warning == "nowhere":
            assert np.isnan(figures["residual"])
            assert np.isnan(figures["moved"])
            assert all(one.kind != "arrow" or one.look == "truth" for one in arrows(view))
        else:
            assert view.warning == ""
            assert figures["residual"] == 0
            assert max(lengths(view)) < 0.05
    # Few points lie so near the circle.
    assert nowhere < len(states) / 5


def arrows(view: sheet.View) -> list[sheet.Shape]:
    return [one for one in view.canvases[0].shapes if one.kind == "arrow"]


def lengths(view: sheet.View) -> list[float]:
    """Of the residuals drawn."""
    ends = [np.array(one.points) for one in arrows(view) if one.look == "bad"]
    return [float(np.hypot(*(end[1] - end[0]))) for end in ends]


def test_an_error_no_camera_can_take_up_is_told__law() -> None:
    view = seen(PHOTO, count=3, x1=16, y1=-74, error=40, which=3)
    assert view.warning == "nowhere"
    assert view.plot is None


@pytest.mark.parametrize("which", range(1, 7))
def test_a_column_takes_the_share_its_redundancy_number_says__truth(which: int) -> None:
    """The share is what the residual gains per pixel of error, by two adjustments."""
    gained = [shown(seen(PHOTO, which=which, sigma=0.1, error=e))["residual"] for e in (40, -40)]
    view = seen(PHOTO, which=which, sigma=0.1, error=40)
    share = view.figures["redundancy"].value
    # Noise of a tenth of a pixel, mean of both signs; what is not linear is below a per cent.
    assert np.mean(gained) == pytest.approx(40 * share, rel=0.02)
    assert view.figures["least"].value == pytest.approx(4.13 * 0.1 / np.sqrt(share), rel=1e-9)
    assert view.plot is not None
    assert view.plot.curves[0].points[-1] == pytest.approx([40, 40 * share])
    labels = {one.label: one.number for one in view.canvases[0].shapes if one.number is not None}
    assert labels[f"{which}"].value == share


@pytest.mark.parametrize("count", range(4, 9))
def test_redundancy_numbers_of_columns_are_those_of_the_projection__law(count: int) -> None:
    """1 minus the diagonal of A (A^T A)^-1 A^T, A the photo's six unknowns alone."""
    found = least_squares.found_in(PHOTO.start | {"count": float(count)})
    model = photo_model(least_squares.C_MM)
    places = np.array([one.position for one in found.report.block.surveyed.values()])
    exterior = found.report.block.photos["photo"].exterior
    design = model.linearised(places, exterior)[1].reshape(-1, 6)
    columns = np.diag(np.eye(2 * count) - design @ np.linalg.pinv(design))[::2]
    # Points known to a millimetre, and noise where the second is made linear, are 1e-4 of it.
    assert list(found.shares.values()) == pytest.approx(columns, abs=1e-3)


def test_a_point_left_out_is_said_to_be__truth() -> None:
    """Its residual is the whole error, and its redundancy number that from before."""
    view = seen(PHOTO, count=8, snoop=1)
    before = seen(PHOTO, count=8).figures["redundancy"].value
    assert view.warning == "left_out"
    assert view.figures["redundancy"].value == before > 0.1
    assert view.figures["residual"].value == pytest.approx(15, abs=3)
    assert view.plot is not None
    assert view.plot.curves[1].points[-1] == [40, 40]
    assert "out" in {one.label for one in view.canvases[0].shapes}
    assert {one.left for one in view.equations} == {"r", "∇"}


@pytest.mark.parametrize("spread", [15, 20])
def test_a_block_that_control_does_not_hold_errs_as_it_says__truth(spread: float) -> None:
    """What holds it is as wrong as is said: true errors over flights are as their sigmas."""
    flights = [seen(BLOCK, spread=spread, seed=seed, **CORNER) for seed in range(1, 41)]
    assert all(one.warning == "rough" for one in flights)
    error, sigma = (
        np.sqrt(np.mean([one.figures[name].value ** 2 for one in flights]))
        for name in ("error", "rms")
    )
    # One scale for each flight decides: of forty the RMS scatters by a ninth.
    assert error / sigma == pytest.approx(1, abs=0.3)


def test_a_block_that_control_holds_is_not_warned_of__law() -> None:
    for state in ({}, {"spread": 33}, {"spread": 33, **CORNER}, {"spread": 15}, {"count": 4}):
        assert seen(BLOCK, **state).warning == "", state


@pytest.mark.parametrize("state", [{}, {"spread": 33, **CORNER}, {"spread": 15, **CORNER}])
def test_circles_stay_in_the_picture__law(state: dict[str, float]) -> None:
    canvas = seen(BLOCK, **state).canvases[0]
    left, lower, right, upper = canvas.window
    places = np.concatenate([one.points for one in canvas.shapes if one.look in ("error", "truth")])
    assert (places >= [left, lower]).all()
    assert (places <= [right, upper]).all()


@pytest.mark.parametrize("seed", range(24))
def test_what_the_hint_says_to_measure_is_the_answer__law(seed: int) -> None:
    asked = BLOCK.questions[0].ask(np.random.default_rng(seed))
    own = {"count": asked.values["n"], "sigma": asked.values["sigma"],
           "seed": asked.values["flight"]}  # fmt: skip
    whole, ninth = (
        shown(seen(BLOCK, **own, **state))["rms"] for state in ({}, {"spread": 33, **CORNER})
    )
    assert ninth / whole == pytest.approx(asked.answer, abs=0.2)
