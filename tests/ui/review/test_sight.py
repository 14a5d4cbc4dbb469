"""What a ray in the 3D scene meets, and which photos see a place."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ui.desk_block import tiny_block, tiny_snapshot
from ui.review.scene import exaggerate_heights, frustum_depth_m, ground_level_m
from ui.review.sight import (
    Picked,
    area_under,
    frustum_corners,
    ground_under,
    photos_over,
    pick,
)
from ui.review.state import DeskState, SceneOptions

DEM = tiny_block().land.dem
ALL = SceneOptions(frozenset())


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def test_a_ray_hits_the_point_it_is_aimed_at__truth(state):
    block = state.oriented
    for name in list(block.surveyed)[::11]:
        target = block.surveyed[name].position - block.origin
        eye = target + np.array([300.0, -900.0, 1000.0])
        assert pick(tuple(eye), tuple(target - eye), block, ALL) == Picked("point", name)
        bare = SceneOptions(frozenset({"points", "photos"}))
        assert pick(tuple(eye), tuple(target - eye), block, bare) is None


def test_an_outline_lies_where_its_rays_meet_the_ground__truth(state):
    block = state.oriented
    corners = np.array([[-80.0, -60.0], [90.0, -50.0], [10.0, 70.0]]) + block.origin[:2]
    places = np.column_stack([corners, DEM.heights(corners)]) - block.origin
    eye = np.array([200.0, -700.0, 1500.0])
    rays = [(tuple(eye), tuple((one - eye) / np.linalg.norm(one - eye))) for one in places]
    assert area_under(rays, block, DEM, ALL) == pytest.approx(corners, abs=0.5)
    assert area_under([*rays, (tuple(eye), (0.0, 0.0, 1.0))], block, DEM, ALL) == ()


def test_a_ray_into_the_sky_hits_nothing__truth(state):
    assert pick((0.0, 0.0, 9000.0), (0.0, 0.0, 1.0), state.oriented, ALL) is None


def test_a_ray_through_a_frustum_hits_its_photo__truth(state):
    block = state.oriented
    depth = frustum_depth_m(block)
    for name in block.photos:
        middle = frustum_corners(block, name, depth).mean(axis=0) - block.origin
        eye = middle + np.array([0.0, 0.0, 5000.0])
        found = pick(tuple(eye), (0.0, 0.0, -1.0), block, SceneOptions(frozenset({"points"})))
        assert found == Picked("photo", name)


def test_frustums_open_as_the_camera_sees__law(state):
    block = state.oriented
    for name, photo in block.photos.items():
        corners = frustum_corners(block, name, 100.0)
        film = block.camera_of(name).frame_corners_mm
        seen = photo.pixel_from_object(corners, block.camera_of(name))
        expected = photo.interior.pixel_from_film(film)
        apart = np.linalg.norm(seen[:, None] - expected[None], axis=2)
        # The drawn pyramid is straight; the air bends the rays of a photo.
        assert apart.min(axis=1).max() < 0.05


def test_points_are_hit_where_exaggerated_heights_draw_them__truth(state):
    block = state.oriented
    steep = replace(ALL, relief=5.0)
    name = max(block.surveyed, key=lambda name: block.surveyed[name].position[2])
    target = block.surveyed[name].position - block.origin
    drawn = exaggerate_heights(target[None], ground_level_m(block), 5.0)[0]
    assert drawn[2] > target[2] + 20
    eye = drawn + np.array([300.0, -900.0, 1000.0])
    assert pick(tuple(eye), tuple(drawn - eye), block, steep) == Picked("point", name)


def test_a_perspective_centre_is_meant_before_the_point_behind_it__truth(state):
    block = state.oriented
    name, photo = next(iter(block.photos.items()))
    centre = photo.exterior.centre - block.origin
    point = next(iter(block.surveyed.values())).position - block.origin
    eye = centre + 2.0 * (centre - point)
    assert pick(tuple(eye), tuple(point - eye), block, ALL) == Picked("photo", name)
    inside = replace(ALL, inside=name)
    assert pick(tuple(eye), tuple(point - eye), block, inside).kind == "point"


@pytest.mark.parametrize("relief", [1.0, 5.0])
def test_a_ray_meets_the_ground_where_it_is_drawn__oracle(state, relief):
    block = state.oriented
    level, scene = ground_level_m(block), replace(ALL, relief=relief)
    for east, north in ((-400.0, 300.0), (100.0, -250.0), (350.0, 150.0)):
        place = block.origin + np.array([east, north, 0.0])
        place[2] = DEM.heights(place[None, :2])[0]
        target = exaggerate_heights((place - block.origin)[None], level, relief)[0]
        eye = target + np.array([200.0, -1500.0, 4000.0])
        found = ground_under(tuple(eye), tuple(target - eye), block, DEM, scene)
        assert found == pytest.approx(place, abs=0.5)
    assert ground_under((0.0, 0.0, 9000.0), (0.0, 0.6, 0.1), block, DEM, scene) is None


def test_the_photos_that_see_a_place_come_nearest_to_nadir_first__oracle(state):
    block = state.oriented
    place = block.origin.copy()
    place[2] = DEM.heights(place[None, :2])[0]
    seen = photos_over(place, block, DEM)
    inside = set()
    for name, photo in block.photos.items():
        pixel = photo.pixel_from_object(place[None], block.camera_of(name))[0]
        if ((pixel >= 0) & (pixel <= photo.size_px)).all():
            inside.add(name)
    assert {one.photo_id for one in seen} == inside
    assert len(inside) > 1
    up = [block.photos[one.photo_id].exterior.centre - place for one in seen]
    angles = [np.degrees(np.arctan2(np.hypot(*ray[:2]), ray[2])) for ray in up]
    assert angles == sorted(angles)
    assert angles == pytest.approx([one.nadir_deg for one in seen])
    assert seen[0].nadir_deg < seen[-1].nadir_deg < 45


def test_a_hill_between_hides_a_place__truth(state):
    block = state.oriented
    place = block.origin.copy()
    place[2] = 280.0

    class Wall:
        def heights(self, points):
            east = points[:, 0] - block.origin[0]
            return np.where((east > 20) & (east < 60), 1500.0, 280.0)

    seen = {one.photo_id for one in photos_over(place, block, Wall())}
    everywhere = {one.photo_id for one in photos_over(place, block, DEM)}
    east = {name for name in everywhere if block.photos[name].exterior.centre[0] > place[0] + 60}
    assert east
    assert not seen & east
