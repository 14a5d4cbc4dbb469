"""Names in the scene: those that would lie over each other are one."""

import numpy as np
import pytest

from ui.views.labels import label_node, names_apart


def test_names_too_near_each_other_become_one__law():
    places = {"N": np.zeros(3), "I": np.array([1.0, 0, 0]), "M": np.array([9.0, 0, 0])}
    assert list(names_apart(places, 0.5)) == ["N", "I", "M"]
    found = names_apart(places, 2.0)
    assert list(found) == ["N I", "M"]
    assert found["N I"] == pytest.approx([0.5, 0, 0])


def test_a_node_has_no_separator_of_the_tree_in_its_name__law():
    assert label_node("a/b") == "/labels/a_b"
