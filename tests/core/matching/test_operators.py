"""Operators behind one interface: what each sees, and what it is blind to."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from core.matching.descriptors import has_akaze
from core.matching.operators import OPERATORS, Operator, has_roads, operator_named

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


def found_at(name, scan, reference, roads=NONE):
    """Displacement (right, down) at which an operator puts the middle of the reference."""
    operator = operator_named(name, HALF)
    middle = np.s_[60 - HALF : 61 + HALF, 60 - HALF : 61 + HALF]
    outer = HALF + REACH
    around = np.s_[60 - outer : 61 + outer, 60 - outer : 61 + outer]
    surface = operator.surface(
        tuple(np.ascontiguousarray(layer[around]) for layer in operator.of_scan(scan)),
        tuple(
            np.ascontiguousarray(layer[middle]) for layer in operator.of_reference(reference, roads)
        ),
    )
    assert surface.shape == (2 * REACH + 1, 2 * REACH + 1)
    row, column = np.unravel_index(int(np.argmax(surface)), surface.shape)
    return int(column) - REACH, int(row) - REACH


HERE = [name for name in OPERATORS if name != "roads" and (name != "akaze" or has_akaze())]
"""OpenCV 5 has no AKAZE; that it is refused there is tested with `block.toml`."""


@pytest.mark.parametrize("name", HERE)
def test_the_same_ground_is_found_where_it_was_moved_to__truth(name):
    image = ground(0)
    moved = np.roll(image, (3, -5), (0, 1))
    column, row = found_at(name, moved, image)
    slack = 1 if name == "akaze" else 0
    assert abs(column + 5) <= slack
    assert abs(row - 3) <= slack


@pytest.mark.parametrize("name", ["gradient", "cfog", "fused"])
def test_a_negative_is_found_as_a_positive_is__law(name):
    """Dark roads became bright: grey values alone are misled."""
    image = ground(1)
    moved = 255 - np.roll(image, (-4, 6), (0, 1))
    assert found_at(name, moved, image) == (6, -4)
    assert found_at("ncc", moved, image) != (6, -4)


@pytest.mark.parametrize("tone", [200.0, 20.0])
def test_drawn_roads_find_a_junction_between_fields_that_all_changed__truth(tone):
    """Bright or dark, on other fields than those of the ortho."""
    drawn = crossing(255.0)
    then = np.where(np.roll(drawn, (5, 2), (0, 1)) > 0, np.float32(tone), ground(2))
    then = cv2.GaussianBlur(then, (0, 0), 0.8)
    now = np.where(drawn > 0, np.float32(120), ground(3))
    for name in ("roads", "fused"):
        column, row = found_at(name, then, now, drawn)
        assert abs(column - 2) <= 1
        assert abs(row - 5) <= 1


def test_a_straight_road_does_not_place_and_a_junction_does__truth():
    operator = operator_named("fused", HALF)
    image = ground(4)
    straight = crossing(255.0, arms=((60, 0), (60, 120)))
    bend = crossing(255.0, arms=((60, 0), (120, 60)))
    assert not has_roads(operator.of_reference(image, NONE))
    assert not has_roads(operator.of_reference(image, straight))
    assert has_roads(operator.of_reference(image, bend))
    assert has_roads(operator.of_reference(image, crossing(255.0)))


def test_without_roads_fused_is_the_gradient_alone__law():
    image, other = ground(5), ground(6)
    fused, gradient = operator_named("fused", HALF), operator_named("gradient", HALF)
    patch = np.ascontiguousarray(image[30:71, 30:71])
    empty = np.zeros_like(patch)
    np.testing.assert_array_equal(
        fused.surface(fused.of_scan(other), fused.of_reference(patch, empty)),
        gradient.surface(gradient.of_scan(other), gradient.of_reference(patch, empty)),
    )


def test_flat_ground_has_no_likeness_and_breaks_nothing__law():
    flat = np.full((121, 121), 90.0, np.float32)
    for name in [name for name in OPERATORS if name != "akaze"]:
        operator = operator_named(name, HALF)
        patch = tuple(
            np.ascontiguousarray(layer[:41, :41]) for layer in operator.of_reference(flat, NONE)
        )
        surface = operator.surface(operator.of_scan(flat), patch)
        assert np.isfinite(surface).all()


def test_every_operator_has_its_name__law():
    for name in OPERATORS:
        operator = operator_named(name, HALF)
        assert isinstance(operator, Operator)
        assert operator.name == name
    with pytest.raises(KeyError):
        operator_named("magic", HALF)


def test_a_drawn_road_lies_where_the_photo_shows_it__truth(tiny):
    """Vertices of the true lines, projected, lie on the strips that were drawn."""
    from core.formats.roads import read_roads
    from core.matching.patches import Window, drawn_roads
    from core.matching.road_lines import lines_on_ground
    from core.synthetic.options import CRS

    roads = read_roads(sorted((tiny.folder / "roads").glob("*.shp")), CRS)
    lines = lines_on_ground(roads, tiny.reference.dem)
    reference = replace(tiny.reference, roads=lines)
    opened = tiny.opened(tiny.names[0])
    window = Window(200, 250, 300, 260, 2)
    picture = drawn_roads(opened, reference, window)
    places = window.window_from_pixel(
        opened.photo.pixel_from_object(np.asarray(lines.points), tiny.truth.camera)
    )
    inside = ((places > 3) & (places < np.array([297, 257]))).all(axis=1)
    assert inside.sum() > 50
    column, row = np.floor(places[inside]).astype(int).T
    assert (picture[row, column] > 0).mean() > 0.99
    assert 0.01 < (picture > 0).mean() < 0.3
    assert not drawn_roads(opened, tiny.reference, window).any()
