"""Formulas of the lessons with their present numbers: each gives its left side."""

from collections.abc import Sequence

import numpy as np
import pytest

from app.found_lessons import find_lessons
from app.lessons import sheet
from app.teaching import state_of

LESSONS = find_lessons()
METRES = {"µm": 1e-6, "mm": 1e-3, "m": 1.0, "km": 1e3, "°": np.pi / 180, "·10⁻⁶": 1e-6,
          "·10⁻⁶/µm": 1.0, "·10⁻⁶/mm": 1e-3}  # fmt: skip
"""Units of symbols; an angle per micrometre is one per metre a million times over."""
FUNCTIONS = {"sin": np.sin, "cos": np.cos, "tan": np.tan}
Value = float | np.ndarray


class Formula:
    """A formula that is worked out with the numbers of a view, as a reader would."""

    def __init__(self, symbols: dict[str, Value]) -> None:
        self.symbols = symbols

    def value(self, part: sheet.Math) -> Value:
        if isinstance(part, str):
            return self.symbols[part] if part in self.symbols else float(part)
        act, *inside = part
        if act == "row":
            return self.row(inside)
        if act == "named":
            return self.symbols[inside[0]]
        if act == "over":
            return self.value(inside[0]) / self.value(inside[1])
        if act == "power":
            return self.value(inside[0]) ** float(inside[1].replace("−", "-"))
        if act == "root":
            return np.sqrt(self.value(inside[0]))
        assert act == "fence"
        return self.value(inside[0])

    def row(self, parts: Sequence[sheet.Math]) -> Value:
        """Sums of products; functions take what stands next to them."""
        total, product, sign, how, function = 0.0, None, 1.0, "*", None
        for part in parts:
            if part in ("+", "−"):
                if product is not None:
                    total, product = total + sign * product, None
                sign = 1.0 if part == "+" else -1.0
            elif part in ("*", "·", "×"):
                how = str(part)
            elif isinstance(part, str) and part in FUNCTIONS:
                function = FUNCTIONS[part]
            else:
                one = self.value(part)
                one, function = (function(one) if function else one), None
                product = one if product is None else joined(product, one, how)
                how = "*"
        assert product is not None
        return total + sign * product


def joined(one: Value, other: Value, how: str) -> Value:
    """Products of numbers, matrices and columns."""
    if how == "×":
        # The turned ray comes last in the row, and is made first.
        return np.cross(np.ravel(one), np.ravel(other))[:, None]
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return (one.T @ other).item() if how == "·" else one @ other
    return one * other


def symbols_of(view: sheet.View, lesson: sheet.Lesson, state: dict[str, float]) -> dict[str, Value]:
    """All symbols in metres and radians, with the digits that are shown."""
    shown: dict[str, Value] = {}
    for slider in lesson.sliders:
        if slider.symbol:
            shown[slider.symbol] = state[slider.name] * METRES.get(slider.unit, 1.0)
    for name, one in view.symbols.items():
        rows = one if isinstance(one, list) else [[one]]
        values = np.array([[round(n.value, n.digits) * METRES.get(n.unit, 1.0) for n in row]
                           for row in rows])  # fmt: skip
        shown[name] = values if isinstance(one, list) else float(values[0, 0])
    return shown


def worked_out(name: str, **state: float) -> dict[str, tuple[Value, Value]]:
    """Each formula's left side as it is shown, and what its right side comes to."""
    lesson = LESSONS[name]
    whole = state_of(lesson, state)
    view = lesson.view(whole)
    symbols, shown = symbols_of(view, lesson, dict(whole)), view.equations or lesson.equations
    formula = Formula(symbols)
    return {one.left: (symbols[one.left], formula.value(one.right)) for one in shown}


def test_refraction_its_constant_and_curvature_come_out_of_their_formulas__law() -> None:
    for height, ground in ((4500, 300), (12000, 1500), (800, 0)):
        found = worked_out("corrections", H=height, h=ground, c=210, r=110)
        # The constant takes its heights in kilometres, as print has it.
        view = LESSONS["corrections"].view(
            LESSONS["corrections"].start | {"H": height, "h": ground}
        )
        assert {view.symbols[name].unit for name in ("H", "h")} == {"km"}
        known = {name: view.symbols[name].value for name in ("H", "h", "K_H", "K_h")}
        air, constant = LESSONS["corrections"].equations[:2]
        for level in ("H", "h"):
            below = Formula({"H": known[level]}).value(air.right)
            assert 1e6 * below == pytest.approx(known[f"K_{level}"], abs=1e-9)
        whole = Formula(known).value(constant.right)
        assert whole == pytest.approx(view.symbols["K"].value, abs=1e-9)
        for left in ("Δr_a", "Δr_e"):
            shown, come = found[left]
            assert come == pytest.approx(shown, abs=0.1e-6), left


@pytest.mark.parametrize("model", [0, 1, 2])
def test_a_mark_comes_from_the_scan_to_the_film_as_its_model_says__law(model: int) -> None:
    """Both the scan's pixel and the sixth digit of the model are shown to less than 2 µm."""
    found = worked_out("interior", model=model, bend=4, shear=0.5, x0=-0.1)
    assert ("x_A" in found) == (model == 2)
    for left, (shown, come) in found.items():
        assert come == pytest.approx(shown, abs=2e-6), left


def test_the_parallax_of_the_mark_and_the_image_of_a_point_come_out__law() -> None:
    for state in ({}, {"mark": 120, "B": 2000}, {"H": 600, "c": 85, "mark": -50}):
        shown, come = worked_out("stereo", **state)["p"]
        assert come == pytest.approx(shown, abs=0.6e-6), state
    for state in ({}, {"x1": 700, "relief": 300}):
        shown, come = worked_out("resection", **state)["x_1"]
        assert come == pytest.approx(shown, rel=1e-4), state


def test_points_and_displacements_of_a_tilted_photo_come_out_of_their_formulas__law() -> None:
    for state in ({"t": 20}, {"t": 3, "direction": 130, "x": -80}, {"t": 45, "x": -20, "y": 90}):
        for left, (shown, come) in worked_out("tilt", **state).items():
            assert come == pytest.approx(shown, rel=2e-3, abs=1e-5), (left, state)


def test_a_parallax_comes_out_of_the_rays_base_and_turn_that_are_shown__law() -> None:
    for state in ({}, {"by": 2, "kappa": -1.2, "omega": 0.7}, {"seed": 5, "phi": -0.8}):
        lesson = LESSONS["relative"]
        view = lesson.view(state_of(lesson, state))
        known = symbols_of(view, lesson, {})
        turned = known["R"] @ known["v_i"]
        product = (known["u_i"].T @ np.cross(known["b"].ravel(), turned.ravel())).item()
        assert np.sqrt(2) * product / known["σ_i"] == pytest.approx(known["p_i"], rel=5e-3)
        assert abs(view.symbols["p_i"].value) == max(
            abs(one.number.value) for one in view.canvases[0].shapes if one.number
        )


def test_a_point_of_the_model_comes_to_lie_where_the_formula_says__law() -> None:
    for state in ({}, {"scale": 3, "kappa": 5, "omega": -2}, {"solve": 1, "n": 8}):
        shown, come = worked_out("absolute", **state)["X_1"]
        assert np.allclose(come, shown, atol=0.2), state


def test_the_covariance_of_the_place_is_sigma_squared_times_its_cofactors__law() -> None:
    for state in ({}, {"fourth": 0}, {"x1": -200, "y1": 100, "noise": 25}):
        lesson = LESSONS["resection"]
        shown, come = worked_out("resection", **state)["Σ"]
        assert np.allclose(come, shown, rtol=5e-3, atol=2e-3), state
        figures = lesson.view(state_of(lesson, state)).figures
        sigmas = [figures[f"sigma_{axis}"].value for axis in "xyz"]
        assert np.allclose(np.sqrt(np.diag(shown)), sigmas, rtol=0.05, atol=0.03)


def test_a_camera_of_which_nothing_is_known_has_no_covariance__law() -> None:
    lesson = LESSONS["resection"]
    together = {f"{axis}{number}": 0.0 for axis in "xy" for number in range(1, 5)}
    assert "Σ" not in lesson.view(state_of(lesson, together)).symbols


def test_the_last_formula_of_lesson_b_is_that_of_its_question__law() -> None:
    """The hint names it so, with and without a lens."""
    lesson = LESSONS["corrections"]
    for lens in (-30, 0, 10):
        view = lesson.view(lesson.start | {"lens": lens})
        assert (view.equations or lesson.equations)[-1].left == "Δr_e"
