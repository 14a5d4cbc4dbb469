"""A window of a scan beside the reference as that photo would see it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry.exterior import ExteriorOrientation
from core.matching.operators import high_passed
from core.matching.patches import (
    Templates,
    Window,
    filled,
    grid_over,
    object_on_ground,
    read_scan,
    read_templates,
    side_by_side,
    upsampled,
)
from core.matching.peaks import correlation_scores, detect_peaks

SIDE, ROOM = 161, 8
PLACES = [(0.35, 0.35), (0.65, 0.35), (0.5, 0.5), (0.35, 0.65), (0.68, 0.6)]


def window_about(photo, share, side=SIDE, reduction=1) -> Window:
    """A window about a place given as shares of the scan."""
    column, row = (round(size * part) for size, part in zip(photo.size_px, share, strict=True))
    half = side * reduction // 2
    return Window(column - half, row - half, side, side, reduction)


def templates_in(opened, reference, window):
    """The reference in the very pixels of a window of odd size."""
    middle = window.pixel_from_window(np.array([[window.columns / 2, window.rows / 2]]))
    return read_templates(opened, reference, middle, window.columns // 2, window.reduction)


def shift_between(opened, reference, window) -> tuple[np.ndarray, float]:
    """Shift (column, row) of the scan against the warped reference, pixels, and likeness."""
    part, templates = read_scan(opened, window), templates_in(opened, reference, window)
    assert part.grey.shape == templates.reference.shape
    scan, reference = high_passed(part.grey, 10.0), high_passed(templates.reference, 10.0)
    patch = np.ascontiguousarray(reference[ROOM:-ROOM, ROOM:-ROOM])
    peak = detect_peaks(correlation_scores(scan, patch), 1, 4)[0]
    return np.array([peak.column - ROOM, peak.row - ROOM]), peak.value


def test_the_ground_of_its_day_seen_through_the_truth_is_the_scan__truth(tiny):
    """Unchanged ground, true orientation: window by window the same to a fifth of a pixel."""
    shifts, likenesses = [], []
    for name in tiny.names[:3]:
        for share in PLACES:
            window = window_about(tiny.photos[name], share)
            shift, likeness = shift_between(tiny.opened(name), tiny.archival(), window)
            shifts.append(shift)
            likenesses.append(likeness)
    assert np.min(likenesses) > 0.6
    assert np.max(np.abs(np.median(shifts, axis=0))) < 0.1
    assert np.mean(np.hypot(*np.array(shifts).T) < 0.2) >= 0.9


def test_a_reduced_window_is_warped_alike__truth(tiny):
    name = tiny.names[1]
    window = window_about(tiny.photos[name], (0.5, 0.5), side=121, reduction=2)
    shift, likeness = shift_between(tiny.opened(name), tiny.archival(), window)
    assert likeness > 0.6
    assert np.hypot(*shift) < 0.15


def test_a_wrong_orientation_shows_as_the_shift_it_is__truth(tiny):
    name = tiny.names[0]
    true = tiny.photos[name].exterior
    aside = ExteriorOrientation(
        true.centre + np.array([4.0, 0.0, 0.0]), true.omega, true.phi, true.kappa
    )
    window = window_about(tiny.photos[name], (0.5, 0.5))
    middle = window.pixel_from_window(np.array([[SIDE / 2, SIDE / 2]]))
    camera, dem = tiny.truth.camera, tiny.reference.dem
    ground = object_on_ground(tiny.opened(name, aside).photo, camera, middle, dem)
    expected = tiny.photos[name].pixel_from_object(ground, camera) - middle
    found, _ = shift_between(tiny.opened(name, aside), tiny.archival(), window)
    np.testing.assert_allclose(found, expected[0], atol=0.3)


def test_a_pixel_followed_to_the_ground_lies_on_it_and_leads_back__law(tiny):
    name = tiny.names[2]
    photo, dem = tiny.photos[name], tiny.reference.dem
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0.15, 0.85, (200, 2)) * np.array(photo.size_px)
    ground = object_on_ground(photo, tiny.truth.camera, pixels, dem)
    np.testing.assert_allclose(ground[:, 2], dem.heights(ground[:, :2]), atol=0.01)
    back = photo.pixel_from_object(ground, tiny.truth.camera)
    np.testing.assert_allclose(back, pixels, atol=1e-6)


def test_beyond_the_reference_nothing_is_known__truth(tiny):
    name = tiny.names[0]
    true = tiny.photos[name].exterior
    away = ExteriorOrientation(true.centre + np.array([1e5, 0, 0]), true.omega, true.phi, 0.0)
    window = window_about(tiny.photos[name], (0.5, 0.5))
    templates = templates_in(tiny.opened(name, away), tiny.reference, window)
    assert not templates.known.any()
    assert not templates.reference.any()
    ground = object_on_ground(
        tiny.opened(name, away).photo,
        tiny.truth.camera,
        np.array([[500.0, 500.0]]),
        tiny.reference.dem,
    )
    assert np.isnan(ground[0, 2])
    assert np.isfinite(ground[0, :2]).all()


def test_a_window_over_the_edge_of_the_reference_knows_its_part__truth(tiny):
    """The photo moved to the eastern edge of the sheets: its left half is known."""
    name = tiny.names[0]
    true, bounds = tiny.photos[name].exterior, tiny.reference.ortho.bounds
    centre = np.array([bounds[2], (bounds[1] + bounds[3]) / 2, true.centre[2]])
    edge = ExteriorOrientation(centre, 0.0, 0.0, 0.0)
    window = window_about(tiny.photos[name], (0.5, 0.5), side=301)
    templates = templates_in(tiny.opened(name, edge), tiny.reference, window)
    assert templates.known[:, :100].mean() > 0.95
    assert not templates.known[:, -100:].any()
    assert np.isfinite(templates.reference).all()


def test_templates_hang_on_the_point_and_not_on_where_the_photo_is_thought_to_be__law(tiny):
    """A photo moved by a pixel and a half has the same templates about the same points."""
    name = tiny.names[0]
    true, opened = tiny.photos[name].exterior, tiny.opened(tiny.names[0])
    shift = np.array([1.5 * opened.ground_pixel_m, 0.4, 0.0])
    beside = tiny.opened(name, replace(true, centre=true.centre + shift))
    ground = object_on_ground(
        opened.photo, opened.camera, np.array(PLACES) * opened.scan.size_px, tiny.reference.dem
    )
    one, other = (
        read_templates(
            each, tiny.reference, each.photo.pixel_from_object(ground, each.camera), 30, 1
        )
        for each in (opened, beside)
    )
    assert one.known.all()
    assert one.reference.std() > 10
    assert np.sqrt(np.mean((one.reference - other.reference) ** 2)) < 0.02 * one.reference.std()


def test_cells_stand_in_their_order__law():
    cells = np.arange(5, dtype=np.float32)[:, None, None] + np.zeros((5, 7, 7), np.float32)
    picture = side_by_side(cells, 3)
    assert picture.shape == (14, 21)
    templates = Templates(7, 3, picture, picture > 0, picture)
    for number in range(5):
        part = picture[templates.cell(number, 2)]
        assert part.shape == (5, 5)
        assert (part == number).all()


@settings(max_examples=50)
@given(st.integers(-500, 500), st.integers(-500, 500), st.integers(1, 8))
def test_window_and_scan_pixels_lead_to_each_other__law(column, row, reduction):
    window = Window(column, row, 10, 10, reduction)
    points = np.array([[0.0, 0.0], [3.5, 7.25], [10.0, 10.0]])
    np.testing.assert_allclose(
        window.window_from_pixel(window.pixel_from_window(points)), points, atol=1e-9
    )
    np.testing.assert_array_equal(window.pixel_from_window(points)[0], [column, row])


@pytest.mark.parametrize("side", [1, 24, 25, 49, 161])
def test_a_plane_over_the_nodes_is_that_plane_at_every_pixel__law(side):
    nodes = int(np.ceil(side / 24)) + 1
    row, column = np.mgrid[:nodes, :nodes] * 24.0
    planes = np.stack([3 + 0.5 * column - 0.25 * row, 900.0 - column])
    row, column = np.mgrid[:side, :side] + 0.5
    expected = np.stack([3 + 0.5 * column - 0.25 * row, 900.0 - column])
    np.testing.assert_allclose(upsampled(planes, side), expected, rtol=1e-5, atol=1e-5)


def test_the_grid_covers_its_points_with_room__law():
    points = np.random.default_rng(0).uniform(-1000, 1000, (30, 2))
    west, south, east, north = grid_over(points, 2.0).bounds
    assert (points.min(axis=0) - [west, south] >= 8.0).all()
    assert ([east, north] - points.max(axis=0) >= 8.0).all()


def test_unknown_places_take_the_mean__truth():
    values = np.array([[1.0, 3.0], [100.0, 100.0]], np.float32)
    mask = np.array([[True, True], [False, False]])
    np.testing.assert_array_equal(filled(values, mask), [[1, 3], [2, 2]])
    np.testing.assert_array_equal(filled(values, ~mask & mask), values)
    np.testing.assert_array_equal(filled(values, mask | ~mask), values)


def test_sizes_on_the_ground__truth(tiny):
    opened = tiny.opened(tiny.names[0])
    assert opened.ground_pixel_m == pytest.approx(1.2, rel=0.02)
    assert opened.width_m == pytest.approx(1.2 * 180 / 0.18, rel=0.02)
