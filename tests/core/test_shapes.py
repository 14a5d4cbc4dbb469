"""The checks of shapes that tests of the engine are run with."""

import jaxtyping
import numpy as np
import pytest

from core.frames import pixel_from_opencv
from tests.shapes import CALLS


def test_a_wrong_shape_is_told_in_the_first_calls_of_a_test__law():
    in_space = np.zeros((4, 3))
    for _ in range(CALLS):
        with pytest.raises(jaxtyping.TypeCheckError):
            pixel_from_opencv(in_space)
    assert pixel_from_opencv(in_space).shape == in_space.shape
