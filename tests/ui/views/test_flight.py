"""The eye on its way into a photo: it begins here, ends there, and sees the whole photo."""

import numpy as np
import pytest

from tests.ui.desk_block import tiny_snapshot
from ui.review.scene import FrustumPicture, ground_level_m
from ui.review.sight import frustum_corners
from ui.views.flight import Pose, flight_between, pose_inside

LEVEL_M = 280.0


@pytest.fixture(scope="module")
def frustum() -> FrustumPicture:
    block = tiny_snapshot().state.oriented
    photo, camera = block.photos["1938_01_015"], block.camera_of("1938_01_015")
    width, height = camera.frame_mm
    opening = 2 * float(np.arctan(height / 2 / camera.principal_distance_mm))
    rotation, centre = photo.exterior.object_from_image, photo.exterior.centre - block.origin
    return FrustumPicture("1938_01_015", centre, rotation, opening, width / height, True, False)


@pytest.mark.parametrize("window", [0.7, 1.6])
def test_a_photo_fits_the_window_from_its_perspective_centre__law(frustum, window):
    pose = pose_inside(frustum, LEVEL_M, window)
    block = tiny_snapshot().state.oriented
    rays = frustum_corners(block, frustum.photo_id, 100.0) - block.origin - pose.position
    ahead = (pose.look_at - pose.position) / np.linalg.norm(pose.look_at - pose.position)
    right = np.cross(ahead, pose.up)
    half = np.tan(pose.fov / 2)
    assert (np.abs(rays @ pose.up) < half * (rays @ ahead)).all()
    assert (np.abs(rays @ right) < half * window * (rays @ ahead)).all()
    assert pose.look_at[2] == pytest.approx(LEVEL_M)
    assert ground_level_m(block) == LEVEL_M


def test_a_flight_begins_gently_and_ends_there__law(frustum):
    up, zero = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    here = Pose(np.array([0.0, -3000.0, 4000.0]), zero, up, 0.8)
    there = pose_inside(frustum, LEVEL_M, 1.5)
    flight = flight_between(here, there)
    assert flight[-1].position == pytest.approx(there.position)
    assert flight[-1].fov == pytest.approx(there.fov)
    places = np.array([here.position, *(pose.position for pose in flight)])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps[0] < steps[len(steps) // 2] > steps[-1]
