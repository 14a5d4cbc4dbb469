"""Every lesson over the whole range of its sliders, and its figures beside the engine's."""

from dataclasses import replace

import numpy as np
import pytest

from app.found_lessons import find_lessons, text_keys, view_keys
from app.lessons import relative, sheet, space
from app.lessons.photo import camera_with, photo_model, tilted_at, vertical_at
from app.lessons.sheet import LessonError
from app.teaching import Teacher, plain, state_of
from core.geometry.collinearity import film_from_object, object_from_film, refraction_constant
from core.geometry.image_corrections import (
    curvature_um,
    image_motion_mm,
    refraction_um,
    relief_displacement_mm,
)
from core.geometry.relative import RayPairs, parallax, rays_from_ideal
from ui.words.catalogue import LANGUAGES

pytestmark = pytest.mark.usefixtures("teaching_cache")
LESSONS = find_lessons()
MOVES = [(name, slider.name) for name, lesson in LESSONS.items() for slider in lesson.sliders]


def moved(lesson: sheet.Lesson, slider: sheet.Slider) -> list[float]:
    """Both ends of a slider, and places between."""
    steps = round((slider.high - slider.low) / slider.step)
    return [slider.low + slider.step * round(steps * share) for share in (0, 0.4, 1)]


@pytest.mark.parametrize(("name", "which"), MOVES)
def test_a_moved_slider_leaves_every_figure_finite__law(name: str, which: str) -> None:
    lesson = LESSONS[name]
    slider = next(one for one in lesson.sliders if one.name == which)
    seen = []
    for value in moved(lesson, slider):
        view = lesson.view(lesson.start | {which: float(value)})
        blocks = [one if isinstance(one, list) else [[one]] for one in view.symbols.values()]
        numbers = [*view.figures.values(), *(one for rows in blocks for row in rows for one in row)]
        # Without redundancy nothing tells sigma nought.
        free = "r" in view.symbols and view.symbols["r"].value == 0
        unknown = [view.figures["sigma_nought"]] if free and name == "least_squares" else []
        assert all(np.isfinite(one.value) or one in unknown for one in numbers), value
        assert view.canvases
        assert all(canvas.shapes for canvas in view.canvases)
        seen.append(str(plain(view)))
    if which in lesson.view(lesson.start).idle:
        assert len(set(seen)) == 1, "moves, though it is said to move nothing"
        return
    # Two seeds draw the same only by accident, and what a slider moves is seen.
    assert len(set(seen)) > 1, "nothing moves"


@pytest.mark.parametrize("name", LESSONS)
def test_the_same_state_shows_the_same__law(name: str) -> None:
    lesson = LESSONS[name]
    assert plain(lesson.view(lesson.start)) == plain(lesson.view(lesson.start))


@pytest.mark.parametrize("name", LESSONS)
def test_every_text_of_a_lesson_is_there__law(name: str) -> None:
    keys = text_keys(LESSONS[name])
    view = LESSONS[name].view(LESSONS[name].start)
    keys |= {f"label.{one.label}" for c in view.canvases for one in c.shapes if one.label}
    for one in LESSONS[name].sliders:
        if one.name in ("method", "block", "operator"):
            for number in np.arange(one.low, one.high + 1):
                keys |= view_keys(LESSONS[name].view(LESSONS[name].start | {one.name: number}))
    for language in LANGUAGES:
        told = Teacher(LESSONS).listed(language)["words"]
        assert {key for key in keys if f"lesson.{name}.{key}" not in told} == set()


@pytest.mark.parametrize("name", LESSONS)
def test_a_question_takes_its_answer_and_no_other__law(name: str) -> None:
    teacher = Teacher(LESSONS)
    for which in range(len(LESSONS[name].questions)):
        for seed in range(5):
            truth = teacher.judge(name, which, seed, None)["answer"]
            assert teacher.judge(name, which, seed, truth)["right"]
            within = teacher.judge(name, which, seed, truth)["tolerance"]
            assert within > 0
            wrong = teacher.judge(name, which, seed, truth + 1.5 * within)
            assert not wrong["right"]
            assert "answer" not in wrong
            # The right amount with the other sign is told as such.
            other = teacher.judge(name, which, seed, -truth)
            assert other["right"] or other["opposite"]


def test_curvature_moves_inwards_and_its_question_says_so__paper() -> None:
    """Table 4.2 has amounts; of the lesson's figure and of the answer the sign is the same."""
    teacher = Teacher(LESSONS)
    for seed in range(20):
        asked = teacher.question("corrections", 0, seed)
        truth = teacher.judge("corrections", 0, seed, None)["answer"]
        assert asked["signed"]
        assert truth < 0
        assert teacher.judge("corrections", 0, seed, truth)["right"]
        if abs(truth) > LESSONS["corrections"].questions[0].tolerance:
            assert teacher.judge("corrections", 0, seed, -truth)["opposite"]
    for language in LANGUAGES:
        words = teacher.listed(language)["words"]
        for name, lesson in LESSONS.items():
            signs = [f"lesson.{name}.sign.{one.name}" for one in lesson.questions if one.signed]
            assert all("+" in words[sign] or "minus" in words[sign] for sign in signs)


def test_the_parallax_shown_is_that_of_the_question__law() -> None:
    """A kappa alone: y on the left minus y on the right at point 1, in the drawing as well."""
    kappa = LESSONS["relative"].questions[0].ask(np.random.default_rng(3))
    first, second = relative.measured(np.array([0, 0, 0, 0, kappa.values["kappa"]]), 0.0, 1)
    rays = RayPairs(
        rays_from_ideal(first, relative.C_MM),
        rays_from_ideal(second, relative.C_MM),
        (relative.UM_ANGLE, relative.UM_ANGLE),
    )
    level = relative.orientation_of(0, 0, np.zeros(3))
    drawn = np.sqrt(2) * parallax(rays, level)[0]
    assert drawn == pytest.approx(kappa.answer, rel=1e-3)


def told_truths(value: object) -> list[object]:
    """Whatever in an answer to the page says what was put in."""
    if isinstance(value, dict):
        own = [value] if value.get("truth") is not None or value.get("look") == "truth" else []
        return own + [one for part in value.values() for one in told_truths(part)]
    if isinstance(value, list):
        return [one for part in value for one in told_truths(part)]
    return []


@pytest.mark.parametrize("name", LESSONS)
def test_hidden_truth_is_not_sent__law(name: str) -> None:
    teacher, lesson = Teacher(LESSONS), LESSONS[name]
    steps = [one for one in lesson.sliders if one.name == "step"]
    states = [{}, *({"step": float(k)} for one in steps for k in range(1, int(one.high) + 1))]
    shown = []
    for state in states:
        assert told_truths(teacher.view(name, state, False)) == []
        shown += told_truths(teacher.view(name, state, True))
    assert bool(shown) == lesson.hides_truth
    assert "height" not in teacher.view("stereo", {}, False)["figures"]


def figure(name: str, key: str, **state: float) -> float:
    return LESSONS[name].view(state_of(LESSONS[name], state)).figures[key].value


def test_figures_are_those_of_the_engine__law() -> None:
    one = np.array([1.0])
    lean = relief_displacement_mm(90 * one, 150 * one, 1500)
    assert figure("relief", "leans", r=90, h=150, H=1500) == lean[0]
    air = refraction_um(130 * one, 152, refraction_constant(4500, 300))
    assert figure("corrections", "refraction", r=130, c=152, H=4500, h=300) == air[0]
    earth = curvature_um(130 * one, 152, 4200)
    assert figure("corrections", "curvature", r=130, c=152, H=4500, h=300) == -earth[0]
    blur = 1000 * image_motion_mm(180, 1 / 200, 152, 1520)
    assert figure("motion", "moved", n=180, shutter=200, c=152, H=1520) == blur


def test_the_tower_on_film_is_where_collinearity_puts_it__truth() -> None:
    """The formula of relief displacement and the projection of foot and top are two ways."""
    for r, h, above in ((20.0, 30.0, 900.0), (110.0, 280.0, 1100.0)):
        away = figure("relief", "distance", r=r, h=h, H=above)
        points = np.array([[away, 0.0, 0.0], [away, 0.0, h]])
        film = film_from_object(points, vertical_at(0.0, above), camera_with(152.0))
        lean = figure("relief", "leans", r=r, h=h, H=above)
        assert film[1, 0] - film[0, 0] == pytest.approx(lean, rel=1e-12)


def test_a_ray_in_space_leaves_through_its_film_point__truth() -> None:
    """Centre, enlarged film and the ground that collinearity says are on one line."""
    exterior, film = tilted_at(1500.0, 0.4, 2.1), np.array([[60.0, -90.0], [-30.0, 10.0]])
    ground = object_from_film(film, np.zeros(2), exterior, camera_with(152.0))
    shown = space.in_space(film, exterior, 152.0, 4000.0) - exterior.centre
    assert np.allclose(np.cross(shown, ground - exterior.centre), 0, atol=1e-6)
    assert np.linalg.norm(shown, axis=1) == pytest.approx(
        4 * np.hypot(np.hypot(*film.T), 152.0), rel=1e-12
    )


@pytest.mark.parametrize("name", ["tilt", "relief", "stereo", "resection", "relative", "absolute"])
def test_what_is_drawn_in_space_follows_every_slider_of_geometry__law(name: str) -> None:
    still = {"times", "noise", "seed"}
    lesson = LESSONS[name]

    def drawn(state: dict[str, float]) -> object:
        canvases = lesson.view(lesson.start | state).canvases
        return plain(next(one for one in canvases if len(one.window) == 6))

    for slider in lesson.sliders:
        if slider.name not in still:
            other = slider.high if slider.start != slider.high else slider.low
            assert drawn({slider.name: float(other)}) != drawn({}), slider.name


def test_rays_of_an_oriented_pair_meet_in_space__truth() -> None:
    """Their gaps are as large as the noise: none without it, after least squares."""
    lesson = LESSONS["relative"]

    def gaps(**state: float) -> float:
        view = lesson.view(lesson.start | {"noise": 0.0} | state)
        lines = [
            np.array(one.points)
            for one in view.canvases[1].shapes
            if (one.kind, one.look) == ("line", "bad")
        ]
        assert len(lines) == 6
        return max(float(np.linalg.norm(line[1] - line[0])) for line in lines)

    # Places are drawn to a millimetre.
    assert gaps(solve=1) < 0.005
    assert gaps(solve=0) > 5


def test_film_shape_is_found_as_it_was_put_in__truth() -> None:
    state = {"model": 1.0, "noise": 0.0, "bend": 0.0}
    view = LESSONS["interior"].view(LESSONS["interior"].start | state)
    for name in ("shrink_x", "shrink_y"):
        assert view.figures[name].value == pytest.approx(view.figures[name].truth, abs=1e-3)
    # A shear turns both axes a little; its square is the difference.
    assert view.figures["shear"].value == pytest.approx(view.figures["shear"].truth, abs=1e-3)
    assert view.figures["rms"].value == pytest.approx(0, abs=1e-6)


def test_a_forgotten_principal_point_shifts_the_ground_and_bends_relief__truth() -> None:
    """By its offset times the scale; of a hill a shift of the photo takes up less."""
    lesson = LESSONS["interior"]
    figures = lesson.view(lesson.start | {"x0": 0.12, "y0": -0.05}).figures
    assert figures["aside"].value == pytest.approx(0.13 * 1500 / 152, abs=1e-6)
    assert figures["hill"].value == pytest.approx(0.13 * 100 / 152, abs=1e-6)
    nothing = lesson.view(lesson.start | {"x0": 0.0, "y0": 0.0}).figures
    assert nothing["aside"].value == pytest.approx(0, abs=1e-9)


def test_least_squares_find_the_relative_orientation_that_was_hidden__truth() -> None:
    lesson = LESSONS["relative"]
    for seed in range(1, 6):
        view = lesson.view(lesson.start | {"solve": 1, "noise": 0, "seed": seed})
        assert view.figures["rms"].value < 1e-3
        for name in ("by", "bz", "omega", "phi", "kappa"):
            assert view.figures[name].value == pytest.approx(view.figures[name].truth, abs=1e-3)


def test_the_way_that_is_told_takes_parallaxes_away_by_hand__truth() -> None:
    """Four rounds with the over-correction of omega leave what the steps of the sliders leave."""
    lesson, over = LESSONS["relative"], {"omega": 1.0}
    for seed in (1, 2):
        hand = lesson.start | {"seed": seed}
        for _ in range(4):
            for name, point in {"by": 2, "kappa": 1, "bz": 4, "phi": 3, "omega": 5}.items():
                goal = -over.get(name, 0.0) * left_at(lesson, hand, point)
                hand[name] = turned_until(lesson, hand, name, point, goal)
        assert lesson.view(hand).figures["rms"].value < 60


def left_at(lesson: sheet.Lesson, state: sheet.State, point: int) -> float:
    shapes = lesson.view(state).canvases[0].shapes
    return next(one.number.value for one in shapes if one.label == f"{point}" and one.number)


def turned_until(
    lesson: sheet.Lesson, hand: dict[str, float], name: str, point: int, goal: float
) -> float:
    """A slider halved to where the arrow of a point is as long as wanted, in whole steps."""
    slider = next(one for one in lesson.sliders if one.name == name)
    low, high = slider.low, slider.high
    rises = left_at(lesson, hand | {name: high}, point) > left_at(lesson, hand | {name: low}, point)
    while high - low > slider.step:
        middle = (low + high) / 2
        above = left_at(lesson, hand | {name: middle}, point) > goal
        low, high = (low, middle) if above == rises else (middle, high)
    return slider.low + slider.step * round((low - slider.low) / slider.step)


def test_by_hand_the_hidden_elements_leave_no_parallax__truth() -> None:
    lesson = LESSONS["relative"]
    found = lesson.view(lesson.start | {"solve": 1, "noise": 0}).figures
    hand = {name: round(found[name].value, 2) for name in ("by", "bz", "omega", "phi", "kappa")}
    assert lesson.view(lesson.start | hand | {"noise": 0}).figures["rms"].value < 0.1


def test_the_resection_scatters_as_its_ellipse_says__truth() -> None:
    """Three hundred photos measured anew: their scatter is the covariance, to a tenth."""
    from app.lessons.resection import PLACES, TRUTH, covariance_of, resected
    from core.geometry.resection import difference

    model, rng, sigma = photo_model(152.0), np.random.default_rng(5), 0.5
    points = np.column_stack([np.array(PLACES, float), [0.0, 40.0, -24.0, 16.0]])
    exact = model.pixels(points, TRUTH)
    draws = np.array(
        [
            difference(resected(model, points, exact + rng.normal(0, sigma, exact.shape)), TRUTH)
            for _ in range(300)
        ]
    )
    expected = np.sqrt(np.diag(covariance_of(model, points, sigma)))
    # 300 draws tell a standard deviation to 4 %; three of those are allowed.
    assert draws.std(axis=0) == pytest.approx(expected, rel=0.13)


def test_three_points_on_the_dangerous_cylinder_fix_nothing__law() -> None:
    """The camera's place in plan on the circle of three points at one height."""
    start = LESSONS["resection"].start | {"fourth": 0, "relief": 0, "noise": 10}
    turn = np.radians([80.0, 200.0, 300.0])
    # A circle of 500 m radius about (500, 0) goes through the nadir.
    circle = {
        f"{axis}{i}": float(place)
        for i, angle in enumerate(turn, 1)
        for axis, place in zip("xy", (500 + 500 * np.cos(angle), 500 * np.sin(angle)), strict=True)
    }
    good = LESSONS["resection"].view(start).figures["sigma_x"].value
    bad = LESSONS["resection"].view(start | circle).figures["sigma_x"].value
    assert not np.isfinite(bad) or bad > 1000 * good


def test_an_error_on_one_of_three_points_shows_nowhere__law() -> None:
    """Three points leave no redundancy: the residual is nought, and the camera has moved."""
    state = {"count": 3, "error": 30, "sigma": 0.1}
    assert figure("least_squares", "residual", **state) < 0.05
    assert figure("least_squares", "moved", **state) > 1.0


def test_data_snooping_finds_the_error_that_was_put_in__truth() -> None:
    state = {"count": 8, "which": 3, "error": 30, "sigma": 1, "snoop": 1}
    assert figure("least_squares", "left_out", **state) == 1
    assert figure("least_squares", "sigma_nought", **state) < 2


def test_errors_of_the_block_are_as_large_as_it_says__truth() -> None:
    """Over eight flights the true error of the ground is what the adjustment states, to a fifth."""
    lesson = LESSONS["control"]
    ratios = [
        figures["error"].value / figures["rms"].value
        for seed in range(1, 9)
        if (figures := lesson.view(lesson.start | {"seed": float(seed)}).figures)
    ]
    # Twenty control points per flight: a flight's own scatter is a quarter, of eight a tenth.
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)
    seen = [
        lesson.view(lesson.start | {"seed": float(s)}).figures["sigma_nought"].value
        for s in range(1, 9)
    ]
    assert all(0.85 < sigma < 1.15 for sigma in seen)


def test_centres_from_gnss_enter_where_the_lesson_lets_them__law() -> None:
    """Radially and by strips the switch does nothing and is shut; models and bundle take them."""
    lesson = LESSONS["triangulation"]
    for method in (1.0, 2.0, 3.0, 4.0):
        without, with_ = (lesson.view(lesson.start | {"method": method, "gnss": g}) for g in (0, 1))
        same = plain(without.figures) == plain(with_.figures)
        assert same == ("gnss" in with_.idle) == (method < 3)
        turned = lesson.view(lesson.start | {"method": method, "about": 3.0})
        assert (plain(turned.figures) == plain(without.figures)) == ("about" in turned.idle)


def test_two_known_points_are_warned_of_where_heights_are_lost__truth() -> None:
    lesson = LESSONS["triangulation"]
    for method in (3.0, 4.0):
        for control in (2.0, 3.0, 4.0):
            for gnss in (0.0, 1.0):
                state = {"method": method, "control": control, "gnss": gnss}
                view = lesson.view(lesson.start | state)
                # Metres: with three points, or centres, it is half a metre.
                assert (view.figures["height"].value > 3) == bool(view.warning)


def test_four_methods_on_one_flight_rank_as_the_books_say__paper() -> None:
    """Radial on hills behind strips and models, the bundle before all; control holds heights."""
    rms = {
        method: np.sqrt(
            np.mean(
                [figure("triangulation", "plan", method=method, seed=s) ** 2 for s in (1, 2, 3)]
            )
        )
        for method in (1, 2, 3, 4)
    }
    assert rms[4] < min(rms[2], rms[3]) < max(rms[2], rms[3]) < rms[1]
    # Two known points leave the tilt about their line to nothing; centres by GNSS hold it.
    loose, held = (
        figure("triangulation", "height", method=4, control=2, gnss=gnss) for gnss in (0, 1)
    )
    assert held < 1 < loose
    few = LESSONS["triangulation"].view(
        LESSONS["triangulation"].start | {"method": 2, "control": 2}
    )
    assert set(few.figures) == {"delta"}


def test_each_method_is_shown_or_said_to_be_impossible_with_any_control__law() -> None:
    """Five known points hold a strip by three on one line: it could turn about them."""
    lesson, shown = LESSONS["triangulation"], {}
    for method in (1, 2, 3, 4):
        for count in range(2, 13):
            view = lesson.view(lesson.start | {"method": method, "control": count})
            assert all(np.isfinite(one.value) for one in view.figures.values())
            shown[method, count] = "plan" in view.figures
    assert [count for count in range(2, 13) if not shown[2, count]] == [2, 3, 4, 5, 6]
    assert all(shown[method, 12] for method in (1, 2, 3, 4))


def test_absolute_orientation_finds_what_was_hidden__truth() -> None:
    """By least squares without noise wholly, by hand as well as the sliders' steps allow."""
    lesson = LESSONS["absolute"]
    for count in (3, 8):
        found = lesson.view(lesson.start | {"solve": 1, "noise": 0, "n": count}).figures
        assert found["plan"].value < 1e-6
        hidden = {name: one.truth for name, one in found.items() if one.truth is not None}
        assert len(hidden) == 4
        for name, truth in hidden.items():
            assert found[name].value == pytest.approx(truth, abs=1e-9)
        hand = lesson.view(lesson.start | hidden | {"noise": 0}).figures
        assert max(hand["plan"].value, hand["height"].value) < 1e-6


def test_unchanged_ground_is_found_by_all_and_changed_ground_by_edges__truth() -> None:
    def hits(operator: int, changed: int) -> int:
        return sum(
            figure("matching", "miss", operator=operator, changed=changed, junction=j) <= 2.0
            for j in range(1, 10)
        )

    assert all(hits(operator, 0) == 9 for operator in range(1, 6))
    assert hits(3, 100) > hits(1, 100)


@pytest.mark.parametrize("state", [{}, {"changed": 100, "grain": 40}, {"size": 11, "turn": -7}])
def test_the_formula_of_correlation_gives_what_the_engine_says__law(state) -> None:
    lesson = LESSONS["matching"]
    view = lesson.view(lesson.start | state)
    both, own, other = (view.symbols[name].value for name in ("σ_oi", "σ_o", "σ_i"))
    assert both / (own * other) == pytest.approx(view.figures["best"].value, abs=1e-4)
    assert lesson.view(lesson.start | state | {"operator": 3}).equations == lesson.equations[1:]


def test_a_state_without_a_picture_is_refused_in_words__law() -> None:
    def view(state: sheet.State) -> sheet.View:
        raise ZeroDivisionError(str(state))

    teacher = Teacher({"relief": replace(LESSONS["relief"], view=view)})
    with pytest.raises(LessonError, match="shows nothing with these values"):
        teacher.view("relief", {}, truth=False)


@pytest.mark.parametrize("seed", range(1, 6))
def test_points_that_fix_no_photo_are_shown_as_such__law(seed: int) -> None:
    """Three points on a circle with the nadir, hardly fixed; and four at the nadir, not at all."""
    lesson = LESSONS["resection"]
    circle = {"x1": 590, "y1": 490, "x2": 30, "y2": -170, "x3": 750, "y3": -430}
    view = lesson.view(lesson.start | circle | {"fourth": 0, "relief": 0, "seed": seed})
    assert not view.figures["sigma_x"].value < 100
    together = {f"{axis}{number}": 0.0 for axis in "xy" for number in range(1, 5)}
    view = lesson.view(lesson.start | together | {"relief": 0, "seed": seed})
    assert np.isnan(view.figures["sigma_x"].value)


def test_no_error_is_found_where_nothing_controls_it__law() -> None:
    """Three points and six unknowns: no redundancy, so however large an error is, it hides."""
    lesson = LESSONS["least_squares"]
    assert "least" not in lesson.view(lesson.start | {"count": 3}).figures
    assert lesson.view(lesson.start).figures["least"].value > 0


def test_radial_triangulation_of_level_photos_over_flat_ground_is_exact__law() -> None:
    lesson = LESSONS["triangulation"]
    flat = {"method": 1, "noise": 0, "known": 0, "relief": 0, "tilt": 0}
    assert lesson.view(lesson.start | flat).figures["worst"].value < 1e-4
    hilly = lesson.view(lesson.start | flat | {"relief": 200, "tilt": 2}).figures
    assert hilly["worst"].value > 1


def test_an_ortho_that_knows_the_roof_brings_the_top_over_its_foot__law() -> None:
    lesson = LESSONS["relief"]
    flat = lesson.view(lesson.start | {"h": 200}).figures["ground"].value
    assert flat > 50
    knows = lesson.view(lesson.start | {"h": 200, "roof": 1})
    assert knows.figures["ground"].value == 0
    assert knows.figures["leans"] == lesson.view(lesson.start | {"h": 200}).figures["leans"]


def test_points_drawn_together_leave_less_and_less__law() -> None:
    """Where plan and relief shrink alike, the ground at the corner is known the worse."""
    lesson = LESSONS["resection"]
    for relief in (0.0, 40.0, 300.0):
        plot = lesson.view(lesson.start | {"relief": relief}).plot
        assert plot is not None
        sigmas = [sigma for _, sigma in plot.curves[0].points]
        assert sigmas == sorted(sigmas, reverse=True), relief


def test_a_turn_by_kappa_makes_the_parallax_its_hint_tells__law() -> None:
    [question] = LESSONS["relative"].questions
    for seed in range(20):
        asked = question.ask(np.random.default_rng(seed))
        arc = 1000 * asked.values["b"] * np.radians(asked.values["kappa"])
        assert abs(asked.answer) == pytest.approx(arc, rel=1e-3)
