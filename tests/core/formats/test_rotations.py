"""Three orders of angles against SciPy's rotations."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from core.formats.rotations import CONVENTIONS, AngleOrder, angles_of, rotation_of

ANGLES = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.4, 1.4), st.floats(-3.1, 3.1))
EAST_NORTH_UP = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])


@given(ANGLES)
def test_orders_are_those_of_scipy__oracle(angles: tuple[float, float, float]) -> None:
    a, b, c = angles
    for order, axes in (("omega-phi-kappa", "XYZ"), ("phi-omega-kappa", "YXZ")):
        assert np.allclose(
            rotation_of(order, angles), Rotation.from_euler(axes, angles).as_matrix()
        )
    body = Rotation.from_euler("ZYX", [a, b, c]).as_matrix()
    ours = rotation_of("yaw-pitch-roll", angles)
    assert np.allclose(ours, EAST_NORTH_UP @ body @ EAST_NORTH_UP)


@settings(max_examples=50)
@given(ANGLES, st.sampled_from(["omega-phi-kappa", "phi-omega-kappa", "yaw-pitch-roll"]))
def test_angles_come_back__law(angles: tuple[float, float, float], order: AngleOrder) -> None:
    back = angles_of(order, rotation_of(order, angles))
    assert np.allclose(rotation_of(order, back), rotation_of(order, angles), atol=1e-12)
    assert np.allclose(back, angles, atol=1e-9)


def test_a_plane_that_flies_east_turns_and_banks_as_told__truth() -> None:
    # Heading east: the photo's upper edge (y) lies east, its right edge (x) south.
    level = rotation_of("yaw-pitch-roll", (np.pi / 2, 0.0, 0.0))
    assert np.allclose(level @ [0, 1, 0], [1, 0, 0])
    assert np.allclose(level @ [1, 0, 0], [0, -1, 0])
    # Nose up: the upper edge rises; right wing down: the right edge sinks.
    assert (rotation_of("yaw-pitch-roll", (0.3, 0.1, 0.0)) @ [0, 1, 0])[2] > 0
    assert (rotation_of("yaw-pitch-roll", (0.3, 0.0, 0.1)) @ [1, 0, 0])[2] < 0


def test_every_way_has_one_name__law() -> None:
    names = [convention.name for convention in CONVENTIONS]
    assert len(set(names)) == 9
    assert {"opk-deg", "pok-gon", "ypr-rad"} <= set(names)
