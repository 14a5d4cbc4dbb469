"""Operators that lose, behind the interface of those that do not."""

from pathlib import Path

import numpy as np
import pytest

from core.literature.baselines import OPERATORS, operator_named, oriented_channels
from core.literature.dense_descriptors import has_akaze
from core.matching.learned import LearnedOperator
from core.matching.operators import USUAL, Operator
from tests.core.matching.test_operators import HALF, NONE, changed_fields, found_at, ground

HERE = [name for name in OPERATORS if name != "roads" and (name != "akaze" or has_akaze())]
"""OpenCV 5 has no AKAZE; that it is refused there is tested with `block.toml`."""


@pytest.mark.parametrize("name", HERE)
def test_the_same_ground_is_found_where_it_was_moved_to__truth(name):
    image = ground(0)
    moved = np.roll(image, (3, -5), (0, 1))
    column, row = found_at(OPERATORS[name], moved, image)
    slack = 1 if name == "akaze" else 0
    assert abs(column + 5) <= slack
    assert abs(row - 3) <= slack


@pytest.mark.parametrize("name", ["gradient", "cfog"])
def test_a_negative_is_found_as_a_positive_is__law(name):
    """Dark roads became bright: grey values alone are misled."""
    image = ground(1)
    moved = 255 - np.roll(image, (-4, 6), (0, 1))
    assert found_at(OPERATORS[name], moved, image) == (6, -4)
    assert found_at(OPERATORS["ncc"], moved, image) != (6, -4)


@pytest.mark.parametrize("tone", [200.0, 20.0])
def test_drawn_roads_alone_find_a_junction_between_fields_that_all_changed__truth(tone):
    column, row = found_at(OPERATORS["roads"], *changed_fields(tone))
    assert abs(column - 2) <= 1
    assert abs(row - 5) <= 1


def test_without_roads_fused_is_the_gradient_alone__law():
    image, other = ground(5), ground(6)
    fused, gradient = OPERATORS["fused"], OPERATORS["gradient"]
    patch = np.ascontiguousarray(image[30:71, 30:71])
    empty = np.zeros_like(patch)
    np.testing.assert_array_equal(
        fused.scores(fused.of_scan(other, HALF), fused.of_reference(patch, empty, HALF)),
        gradient.scores(gradient.of_scan(other, HALF), gradient.of_reference(patch, empty, HALF)),
    )


def test_flat_ground_has_no_likeness_and_breaks_nothing__law():
    flat = np.full((121, 121), 90.0, np.float32)
    for name in [name for name in OPERATORS if name != "akaze"]:
        operator = OPERATORS[name]
        patch = tuple(
            np.ascontiguousarray(layer[:41, :41])
            for layer in operator.of_reference(flat, NONE, HALF)
        )
        scores = operator.scores(operator.of_scan(flat, HALF), patch)
        assert np.isfinite(scores).all()


def test_channels_of_orientation_have_unit_length_less_their_mean__law():
    """Where there is an edge; their squared lengths are handed on beside them."""
    *groups, energy = oriented_channels(ground(8))
    channels = np.concatenate(groups, axis=2)
    np.testing.assert_allclose(np.sum(channels**2, axis=2), energy, atol=1e-5)
    np.testing.assert_allclose(np.sum(channels, axis=2), 0, atol=1e-4)
    assert 0 < energy.min() <= energy.max() <= 1 + 1e-4


def test_every_operator_has_its_name__law():
    assert set(USUAL) <= set(OPERATORS.values())
    for name, operator in OPERATORS.items():
        assert isinstance(operator, Operator)
        assert operator.name == name
        assert operator_named(name) is operator
    assert operator_named("learned", Path("net.onnx")) == LearnedOperator(Path("net.onnx"))
    for unknown in ("magic", "learned"):
        with pytest.raises(KeyError):
            operator_named(unknown)
