"""The engine's operators: what each sees, and what it is blind to."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from core.matching.operators import (
    USUAL,
    FusedOperator,
    HighPassOperator,
    Operator,
    has_roads,
    high_passed,
    surroundings,
)

HALF, REACH = 20, 12
NONE = np.zeros((121, 121), np.float32)


def ground(seed, size=121):
    """Fields of chance with edges between them."""
    rng = np.random.default_rng(seed)
    image = rng.uniform(60, 190, (size // 12 + 1, size // 12 + 1)).astype(np.float32)
    wide = cv2.resize(image, (size, size), interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(wide, (0, 0), 1.0) + rng.normal(0, 2, (size, size)).astype(np.float32)


def crossing(tone, size=121, arms=((60, 0), (60, 120), (0, 70), (120, 50))):
    """A picture of roads that meet in the middle."""
    picture = np.zeros((size, size), np.float32)
    for arm in arms:
        cv2.line(picture, (60, 60), arm, tone, 7)
    return picture


def found_at(operator, scan, reference, roads=NONE):
    """Displacement (right, down) at which an operator puts the middle of the reference."""
    middle = np.s_[60 - HALF : 61 + HALF, 60 - HALF : 61 + HALF]
    outer = HALF + REACH
    around = np.s_[60 - outer : 61 + outer, 60 - outer : 61 + outer]
    shown, wanted = operator.of_scan(scan, HALF), operator.of_reference(reference, roads, HALF)
    scores = operator.scores(
        tuple(np.ascontiguousarray(layer[around]) for layer in shown),
        tuple(np.ascontiguousarray(layer[middle]) for layer in wanted),
    )
    assert scores.shape == (2 * REACH + 1, 2 * REACH + 1)
    row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    return int(column) - REACH, int(row) - REACH


@pytest.mark.parametrize("operator", USUAL, ids=lambda operator: operator.name)
def test_the_same_ground_is_found_where_it_was_moved_to__truth(operator):
    assert isinstance(operator, Operator)
    image = ground(0)
    assert found_at(operator, np.roll(image, (3, -5), (0, 1)), image) == (-5, 3)


def test_a_negative_is_found_as_a_positive_is_by_edges_alone__law():
    """Dark roads became bright: grey values alone are misled."""
    image = ground(1)
    moved = 255 - np.roll(image, (-4, 6), (0, 1))
    assert found_at(FusedOperator(), moved, image) == (6, -4)
    assert found_at(HighPassOperator(), moved, image) != (6, -4)


@pytest.mark.parametrize("tone", [200.0, 20.0])
def test_drawn_roads_find_a_junction_between_fields_that_all_changed__truth(tone):
    """Bright or dark, on other fields than those of the ortho."""
    then, now, drawn = changed_fields(tone)
    column, row = found_at(FusedOperator(), then, now, drawn)
    assert abs(column - 2) <= 1
    assert abs(row - 5) <= 1


def changed_fields(tone):
    """Roads of a tone moved by (2, 5) on old fields, new fields with them, and the roads drawn."""
    drawn = crossing(255.0)
    then = np.where(np.roll(drawn, (5, 2), (0, 1)) > 0, np.float32(tone), ground(2))
    then = cv2.GaussianBlur(then, (0, 0), 0.8)
    return then, np.where(drawn > 0, np.float32(120), ground(3)), drawn


def test_a_straight_road_does_not_place_and_a_junction_does__truth():
    operator = FusedOperator()
    image = ground(4)
    straight = crossing(255.0, arms=((60, 0), (60, 120)))
    bend = crossing(255.0, arms=((60, 0), (120, 60)))
    assert not has_roads(operator.of_reference(image, NONE, HALF))
    assert not has_roads(operator.of_reference(image, straight, HALF))
    assert has_roads(operator.of_reference(image, bend, HALF))
    assert has_roads(operator.of_reference(image, crossing(255.0), HALF))


@pytest.mark.parametrize("operator", USUAL, ids=lambda operator: operator.name)
def test_flat_ground_is_alike_everywhere_and_breaks_nothing__law(operator):
    flat = np.full((121, 121), 90.0, np.float32)
    patch = tuple(
        np.ascontiguousarray(layer[:41, :41]) for layer in operator.of_reference(flat, NONE, HALF)
    )
    scores = operator.scores(operator.of_scan(flat, HALF), patch)
    assert np.isfinite(scores).all()
    assert np.ptp(scores) == 0


def test_a_wide_mean_found_on_a_reduced_image_is_that_of_the_whole_one__oracle():
    """To a thirtieth of the contrast: half a reduced pixel of a mean as wide as 17 pixels."""
    image = ground(7)
    for sigma in (5.0, 17.0):
        expected = cv2.GaussianBlur(image, (0, 0), sigma)
        inner = np.s_[20:-20, 20:-20]
        away = np.abs(surroundings(image, sigma) - expected)[inner]
        assert away.max() < (1e-3 if sigma == 5.0 else image.std() / 30)
    flat = np.full((121, 121), 93.7, np.float32)
    np.testing.assert_allclose(high_passed(flat, 20.0), 0, atol=1e-4)


def test_a_drawn_road_lies_where_the_photo_shows_it__truth(tiny):
    """Vertices of the true lines, projected, lie on the strips that were drawn."""
    from core.formats.roads import read_roads
    from core.matching.patches import drawn_roads
    from core.matching.reference import lines_on_ground
    from core.synthetic.options import CRS

    roads = read_roads(sorted((tiny.folder / "roads").glob("*.shp")), CRS)
    lines = lines_on_ground(roads, tiny.reference.dem)
    reference = replace(tiny.reference, roads=lines)
    opened = tiny.opened(tiny.names[0])
    middle = np.array([[500.0, 510.0]])
    picture = drawn_roads(opened, reference, middle, (301, 1), 2)
    pixels = opened.photo.pixel_from_object(np.asarray(lines.points), tiny.truth.camera)
    places = (pixels - middle) / 2 + 150.5
    inside = ((places > 3) & (places < 298)).all(axis=1)
    assert inside.sum() > 50
    column, row = np.floor(places[inside]).astype(int).T
    assert (picture[row, column] > 0).mean() > 0.99
    assert 0.01 < (picture > 0).mean() < 0.3
    assert not drawn_roads(opened, tiny.reference, middle, (301, 1), 2).any()
