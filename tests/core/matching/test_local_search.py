"""Candidates of reference points in one photo."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from core.block import Peak
from core.geometry.resection import moved
from core.matching.local_search import (
    DULL,
    NCC_TRUST,
    SEPARATION_PX,
    Found,
    MatchingOptions,
    candidates_of,
    match_points,
    merged,
    peak_area_px2,
    predict_pixels,
    reduction_for,
    search_half_px,
    tiles,
)
from core.matching.patches import object_on_ground

STILL = np.zeros((6, 6))


def lattice(tiny, name, count=6):
    """True ground under a lattice over the middle of a photo."""
    photo = tiny.photos[name]
    share = np.linspace(0.25, 0.75, count)
    across, down = np.meshgrid(share, share)
    pixels = np.column_stack([across.ravel(), down.ravel()]) * np.array(photo.size_px)
    return object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)


def test_points_of_unchanged_ground_are_found_where_they_are__truth(tiny):
    """The orientation is two metres off: the best peak is the true place all the same."""
    name = tiny.names[0]
    points = lattice(tiny, name)
    aside = moved(tiny.photos[name].exterior, np.array([2.0, -1.5, 0.0, 0.0, 0.0, 0.0]))
    opened = tiny.opened(name, aside)
    prediction = predict_pixels(opened, STILL, points, np.full((len(points), 3), 0.3))
    options = MatchingOptions(min_search_px=10, max_search_px=10)
    found = match_points(opened, tiny.archival(), prediction, options)
    assert len(found) == len(points)
    assert [match.point for match in found] == sorted(match.point for match in found)
    truly = tiny.photos[name].pixel_from_object(points, tiny.truth.camera)
    best = np.array([[match.peaks[0].column, match.peaks[0].row] for match in found])
    away = np.hypot(*(best - truly).T)
    assert np.mean(away < 0.5) >= 0.9
    assert np.median(away) < 0.2
    assert found[0].searched_px2 == (21.0 - 2 * SEPARATION_PX) ** 2


def test_the_ground_of_today_still_holds_many_of_them__truth(tiny):
    """Forty per cent of the parcels and a third of the roads have gone: METHODS 4.3."""
    name = tiny.names[0]
    points = lattice(tiny, name, 8)
    opened = tiny.opened(name)
    prediction = predict_pixels(opened, STILL, points, np.full((len(points), 3), 0.3))
    options = MatchingOptions(min_search_px=10, max_search_px=10)
    found = match_points(opened, tiny.reference, prediction, options)
    near = [
        min(np.hypot(*(np.array([p.column, p.row]) - prediction.pixels[m.point])) for p in m.peaks)
        for m in found
    ]
    assert np.mean(np.array(near) < 2.5) > 0.3


def test_a_reduced_pass_gives_full_pixels__truth(tiny):
    name = tiny.names[1]
    points = lattice(tiny, name, 4)
    opened = tiny.opened(name)
    prediction = predict_pixels(opened, STILL, points, np.full((len(points), 3), 0.3))
    options = MatchingOptions(reduction=2, template_half_px=25, min_search_px=8, max_search_px=8)
    found = match_points(opened, tiny.archival(), prediction, options)
    best = np.array([[match.peaks[0].column, match.peaks[0].row] for match in found])
    away = np.hypot(*(best - prediction.pixels).T)
    assert np.median(away) < 0.4
    assert found[0].searched_px2 == (34.0 - 4 * SEPARATION_PX) ** 2


def test_the_prediction_is_as_sure_as_orientation_and_ground_are__truth(tiny):
    """Against many draws of the orientation and of the point."""
    name, rng = tiny.names[0], np.random.default_rng(0)
    opened, points = tiny.opened(name), lattice(tiny, name, 3)
    sigma = np.array([2.0, 3.0, 1.0, 0.001, 0.002, 0.003])
    ground = np.full((len(points), 3), [0.5, 0.8, 2.0])
    told = predict_pixels(opened, np.diag(sigma**2), points, ground).sigma_px
    drawn = np.array(
        [
            opened.at(
                moved(opened.photo.exterior, rng.normal(size=6) * sigma)
            ).photo.pixel_from_object(
                points + rng.normal(size=points.shape) * ground, tiny.truth.camera
            )
            for _ in range(600)
        ]
    )
    largest = [
        np.sqrt(np.linalg.eigvalsh(np.cov(drawn[:, index].T))[1]) for index in range(len(points))
    ]
    np.testing.assert_allclose(told, largest, rtol=0.1)


def test_what_lies_outside_the_picture_is_not_searched__truth(tiny):
    name = tiny.names[0]
    points = lattice(tiny, name, 2)
    points[0, 0] += 50_000.0
    points[1, 2] = tiny.photos[name].exterior.centre[2] + 10.0
    prediction = predict_pixels(tiny.opened(name), STILL, points, np.full((4, 3), 0.3))
    np.testing.assert_array_equal(prediction.inside, [False, False, True, True])
    found = match_points(tiny.opened(name), tiny.archival(), prediction, MatchingOptions())
    assert {match.point for match in found} <= {2, 3}


def test_where_the_reference_is_unknown_nothing_is_found__truth(tiny):
    """Beyond the sheets there is nothing to look for, and nothing breaks."""
    name = tiny.names[0]
    bounds = tiny.reference.ortho.bounds
    true = tiny.photos[name].exterior
    centre = np.array([bounds[2], (bounds[1] + bounds[3]) / 2, true.centre[2]])
    opened = tiny.opened(name, replace(true, centre=centre))
    points = np.array([[bounds[2] + 60.0 * i, centre[1], 300.0] for i in (-5, 1, 5)])
    prediction = predict_pixels(opened, STILL, points, np.full((3, 3), 0.3))
    found = match_points(opened, tiny.reference, prediction, MatchingOptions())
    assert {match.point for match in found} <= {0}


@pytest.mark.parametrize("reduction", [1, 3])
def test_every_point_is_in_one_tile_with_room_about_it__law(reduction):
    rng = np.random.default_rng(0)
    pixels = rng.uniform(-50, 9000, (200, 2))
    half = rng.integers(8, 60, 200)
    todo = np.flatnonzero(rng.random(200) < 0.7)
    options = MatchingOptions(reduction=reduction)
    seen: list[int] = []
    for window, members in tiles(pixels, todo, half, options):
        place = window.window_from_pixel(pixels[members])
        room = half[members, None] + options.template_half_px
        assert (place - room >= 0).all()
        assert (place + room + 1 <= [window.columns, window.rows]).all()
        seen.extend(members.tolist())
    assert sorted(seen) == todo.tolist()
    assert list(tiles(pixels, todo[:0], half, options)) == []


def test_the_search_is_as_wide_as_the_prediction_is_unsure__law(tiny):
    opened, points = tiny.opened(tiny.names[0]), lattice(tiny, tiny.names[0], 2)
    prediction = replace(
        predict_pixels(opened, STILL, points, np.full((4, 3), 0.3)),
        sigma_px=np.array([0.1, 10.0, 1000.0, np.inf]),
    )
    half = search_half_px(prediction, MatchingOptions(reduction=2))
    assert half.tolist() == [8, 15 + SEPARATION_PX, 120, 8]


def hill(column, row, height):
    grid = np.mgrid[:41, :41]
    return height * np.exp(-((grid[1] - column) ** 2 + (grid[0] - row) ** 2) / 8)


def test_two_operators_at_one_place_are_one_candidate__truth():
    noise = 0.01 * np.random.default_rng(0).normal(size=(2, 41, 41))
    surfaces = {
        "ncc-high-pass": (noise[0] + hill(20, 20, 0.8) + hill(8, 30, 0.5)).astype(np.float32),
        "fused": (noise[1] + hill(21, 20, 0.9) + hill(30, 9, 0.6)).astype(np.float32),
    }
    found = merged(surfaces, MatchingOptions())
    places = {operator: (round(p.column), round(p.row)) for operator, p in found}
    both = places.pop("fused+ncc-high-pass")
    assert places == {"ncc-high-pass": (8, 30), "fused": (30, 9)}
    assert abs(both[0] - 20) <= 1
    assert [p.z for _, p in found] == sorted((p.z for _, p in found), reverse=True)


def test_peaks_of_noise_fill_the_area_that_counts_as_searched__truth():
    """Were the area larger than where peaks can be, chance would look like agreement."""
    rng, half = np.random.default_rng(7), 12
    side = 2 * half + 1

    noise = rng.normal(size=(400, side, side)).astype(np.float32)
    found = [
        merged({"fused": cv2.GaussianBlur(one, (0, 0), 1.5)}, MatchingOptions()) for one in noise
    ]
    places = np.array([(p.column, p.row) for peaks in found for _, p in peaks]) - half
    away = np.abs(places).max(axis=1)
    reach = np.sqrt(peak_area_px2(half, 1)) / 2
    assert away.max() <= reach + 0.6
    # A square of half the side holds a quarter; two deviations of some eight hundred peaks.
    assert np.mean(away < reach / 2) == pytest.approx(0.25, abs=0.04)


def test_candidates_carry_their_trust_and_their_accuracy__law():
    def peak(sigma, operator, score=8.0):
        return Peak(10.0, 20.0, sigma, score, operator)

    found = [
        Found(2, (peak(0.2, "fused"), peak(0.4, "ncc-high-pass", 4.0)), 400.0),
        Found(7, (peak(30.0, "fused+ncc-high-pass"),), 900.0),
    ]
    ground = np.full(8, 0.6)
    candidates = candidates_of(found, ground, floor_px=0.35)
    assert candidates.point.tolist() == [2, 2, 7]
    assert candidates.trust.tolist() == [1.0, NCC_TRUST, 1.0]
    np.testing.assert_allclose(candidates.sigma_px, np.hypot([0.35, 0.4, DULL * 0.35], 0.6))
    np.testing.assert_allclose(candidates.chance, [1 / 400, 1 / 400, 1 / 900])
    assert candidates.weight[0] > candidates.weight[1]


@pytest.mark.parametrize(("gsd", "expected"), [(0.1, 1), (1.2, 1), (2.1, 2), (2.4, 2), (6.0, 5)])
def test_the_reduction_that_comes_closest_from_below__truth(tiny, gsd, expected):
    assert reduction_for(tiny.opened(tiny.names[0]), gsd) == expected
