"""The lesson on the whole chain: what it finds at each step, beside what was put in."""

from dataclasses import replace

import numpy as np
import pytest

from app.found_lessons import find_lessons
from app.lessons import chain_flight as flown
from app.lessons.chain import LESSON, STEPS
from app.lessons.chain_flight import CAMERA, DEM, MARKS, Given
from app.teaching import Teacher, shown
from core.literature.common_grid import grid_about

SEEDS = range(1, 6)


def figures(step: str, **state: float):
    number = [one.__name__ for one in STEPS].index(step) + 1
    return LESSON.view(LESSON.start | {"step": float(number)} | state).figures


def off(found, *names: str) -> float:
    """Distance of an estimate from what was put in."""
    return float(np.hypot(*(found[name].value - found[name].truth for name in names)))


def test_fiducials_are_measured_to_a_tenth_of_a_pixel__truth():
    for seed in SEEDS:
        for name, photo in flown.true_flight(seed).photos.items():
            true = photo.interior.pixel_from_film(np.array(list(MARKS.values())))
            away = flown.measure_marks(name, seed) - true
            assert np.sqrt(np.mean(away**2)) < 0.1
            assert np.abs(away).max() < 0.3


def test_the_film_point_is_found_to_two_micrometres__truth():
    for seed in SEEDS:
        for point in (1, 5, 9):
            found = figures("interior", seed=seed, point=point)
            assert 1000 * off(found, "film_x", "film_y") < 2.0


def test_corrections_are_those_of_the_true_photo__truth():
    """Rough orientations tilt the photo by a tenth of a degree: less than 0.1 um."""
    for seed in SEEDS:
        for one in figures("corrections", seed=seed, point=6).values():
            assert one.value == pytest.approx(one.truth, abs=0.3)


def test_the_search_finds_the_crossroads_though_most_fields_have_changed__truth():
    """To a metre of the ortho, which is what its pixels are; peaks of other crossroads are few."""
    misses = [
        off(figures("search", seed=seed, point=point), "east", "north")
        for seed in SEEDS
        for point in range(1, 10)
    ]
    assert np.mean(np.array(misses) < 1.0) > 0.9
    assert np.median(misses) < 0.5


def test_the_measured_place_is_off_as_its_standard_deviation_says__truth():
    """Two coordinates off by one sigma each are off by its root of two.

    Peaks at another crossroads or field are off by many sigmas and are left to the adjustment.
    """
    ratios = []
    for seed in SEEDS:
        for point in range(1, 10):
            found = figures("control", seed=seed, point=point)
            ratios.append(off(found, "column", "row") / found["sigma_px"].value)
    right = np.array(ratios)[np.array(ratios) < 5]
    assert len(right) >= len(ratios) - 1
    assert 1.1 < np.sqrt(np.mean(right**2)) < 1.8


def test_the_adjusted_block_is_as_good_as_it_says__truth():
    ratios, sigmas = [], []
    for seed in SEEDS:
        report = flown.adjust_flight(Given(0.6, seed))
        sigmas.append(report.sigma_nought)
        for name, place in report.surveyed_positions.items():
            away = (place - flown.true_place(int(name), Given(0.6, seed))[0])[:2]
            ratios.append(np.hypot(*away) / np.hypot(*report.surveyed_sigmas_m[name][:2]))
    assert 0.9 < np.mean(sigmas) < 1.1
    # Its variance has some 150 degrees of freedom: three sigmas of one flight are 0.17.
    assert all(0.8 < sigma < 1.2 for sigma in sigmas)
    assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.2


def test_what_the_adjustment_has_no_residual_of_is_left_out__law(monkeypatch):
    report = flown.adjust_flight(Given(0.6, 1))
    assert "residual" in figures("adjustment")
    for residuals in ({}, dict.fromkeys(report.residuals_px, (np.nan, np.nan))):
        bare = replace(report, residuals_px=residuals)
        monkeypatch.setattr(flown, "adjust_flight", lambda given, bare=bare: bare)
        assert "residual" not in figures("adjustment")


def test_a_place_that_no_photo_shows_has_no_photo__law(monkeypatch):
    ground, names = flown.seams(Given(0.6, 1))
    assert "photo" in figures("mosaic")
    nowhere = replace(ground, labels=np.full_like(ground.labels, -1))
    monkeypatch.setattr(flown, "seams", lambda given: (nowhere, names))
    assert list(figures("mosaic")) == ["dem_error"]


@pytest.mark.parametrize("step", ["ray", "mosaic"])
def test_ray_and_mosaic_miss_the_truth_by_what_heights_and_orientations_do__truth(step):
    names = {"ray": ("ground_east", "ground_north"), "mosaic": ("mosaic_east", "mosaic_north")}
    misses = [
        off(figures(step, seed=seed, point=point), *names[step])
        for seed in SEEDS
        for point in (1, 4, 7)
    ]
    # Heights wrong by 1.5 m at most, seen at 45 degrees at most, and orientations of half a metre.
    assert max(misses) < 2.5
    assert np.median(misses) < 1.2


def test_two_rays_tell_the_height_as_their_covariance_says__truth():
    ratios = [
        (found["height"].value - found["height"].truth) / found["sigma_height"].value
        for seed in SEEDS
        for point in range(1, 10)
        for found in [figures("neighbours", seed=seed, point=point)]
    ]
    assert np.median(np.abs(ratios)) < 2.0


def test_a_scan_is_the_ground_seen_through_its_film__law():
    """Rectified by the true orientation on the true ground, it is the painting and grain."""
    given = Given(0.6, 1)
    photo = next(iter(flown.true_flight(given.seed).photos.values()))
    grid = grid_about(photo.exterior.centre + 300, 40, 1.0)
    plan = flown.plan_of(grid)
    pixels = photo.pixel_from_object(
        np.column_stack([plan, flown.TRUE_GROUND.heights(plan)]), CAMERA
    )
    values = flown.scan_values(photo, pixels, given)
    painted = 0.9 * flown.paint_ground(plan, 0.6, 1)
    assert np.corrcoef(values, painted)[0, 1] > 0.98
    assert not np.allclose(DEM.heights(plan), flown.TRUE_GROUND.heights(plan))


def test_a_window_made_of_a_few_rays_is_the_scan_itself__law():
    given, place = Given(0.6, 2), flown.junctions()[0]
    for name, photo in flown.true_flight(2).photos.items():
        rough, grid = flown.approximate_photo(name, 2), grid_about(np.append(place, 0.0), 50, 1.0)
        plan = flown.plan_of(grid)
        ground = np.column_stack([plan, DEM.heights(plan)])
        every = flown.scan_values(photo, rough.pixel_from_object(ground, CAMERA), given)
        window = flown.rectify_scan(rough, grid, photo, given)
        # At the edge of a road, the steepest there is, a millimetre is a tenth of a grey value.
        assert np.abs(window.ravel() - every).max() < 1e-3


def test_truth_in_the_pictures_is_hidden_until_it_is_asked_for__law():
    for step in range(1, len(STEPS) + 1):
        view = shown(LESSON.view(LESSON.start | {"step": float(step)}), False)
        assert all(one.truth is None for one in view.figures.values())
        assert "truth" not in {s.look for canvas in view.canvases for s in canvas.shapes}


def test_every_step_has_a_picture_a_formula_and_its_source__law():
    told = Teacher(find_lessons()).listed("en")["words"]
    for number, step in enumerate(STEPS, 1):
        view = LESSON.view(LESSON.start | {"step": float(number)})
        assert view.step == step.__name__
        assert len(view.equations) == 1
        assert told[f"lesson.chain.step.{view.step}"].startswith(f"{number} ")
        assert told[f"lesson.chain.source_of.{view.step}"]


def test_a_photo_in_which_a_point_is_not_found_is_left_out__law() -> None:
    """In flight 28 one photo lies further off than is searched: nothing stands out there."""
    given = Given(0.6, 28)
    report = flown.adjust_flight(given)
    lost = [
        (point, name)
        for point, name in flown.true_flight(given.seed).block.measurements
        if flown.search_point(int(point), name, given) is None
    ]
    assert lost
    assert not set(lost) & set(report.residuals_px)
    for point, _ in lost:
        for step in STEPS:
            assert figures(step.__name__, seed=28, point=int(point))
