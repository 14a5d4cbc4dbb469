"""The 3D scene: where things are drawn, and what a ray hits."""

from dataclasses import replace

import numpy as np
import pytest

from core.frames import object_from_local
from tests.ui.desk_block import outlines, tiny_snapshot
from ui.review.misfit import misfits
from ui.review.scene import (
    Picked,
    frustum_corners,
    frustum_depth_m,
    measure_m,
    misfit_vectors,
    pick,
    point_states,
    readable_scale,
    scene_picture,
    short_names,
    tie_vectors,
)
from ui.review.state import DeskState


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def test_footprints_are_closed_outlines__law(state):
    outline = outlines(state)
    assert len(outline) == 6 * 48
    assert np.allclose(outline[47, 1], outline[0, 0])


def test_a_ray_hits_the_point_it_is_aimed_at__truth(state):
    block = state.oriented
    for name in list(block.surveyed)[::11]:
        target = block.surveyed[name].position - block.origin
        eye = target + np.array([300.0, -900.0, 1000.0])
        assert pick(tuple(eye), tuple(target - eye), block, ()) == Picked("point", name)
        assert pick(tuple(eye), tuple(target - eye), block, ("points", "photos")) is None


def test_a_ray_into_the_sky_hits_nothing__truth(state):
    assert pick((0.0, 0.0, 9000.0), (0.0, 0.0, 1.0), state.oriented, ()) is None


def test_a_ray_through_a_frustum_hits_its_photo__truth(state):
    block = state.oriented
    depth = frustum_depth_m(block)
    for name in block.photos:
        middle = frustum_corners(block, name, depth).mean(axis=0) - block.origin
        eye = middle + np.array([0.0, 0.0, 5000.0])
        assert pick(tuple(eye), (0.0, 0.0, -1.0), block, ("points",)) == Picked("photo", name)


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


def test_a_point_shows_its_worst_state__law(state):
    key = next(k for k in state.block.measurements if state.block.surveyed[k[0]].role == "control")
    rejected = replace(state.block.measurements[key], status="rejected")
    worse = replace(state, block=state.block.with_measurement(rejected))
    assert point_states(worse)[key[0]] == "rejected"


def test_vectors_begin_at_their_points_and_are_as_long_as_the_misfit__law(state):
    vectors = misfit_vectors(state)
    assert len(vectors) > 0
    lengths = np.linalg.norm(vectors[:, 1] - vectors[:, 0], axis=1)
    known = sorted(np.hypot(*one.metres) for one in misfits(state).values())
    assert lengths.max() == pytest.approx(known[-1], rel=0.2)


def test_tie_vectors_are_the_longest_residuals_in_metres__law(state):
    vectors = tie_vectors(state)
    report = state.report
    assert len(vectors) == np.isfinite(report.tie_positions).all(axis=1).sum()
    name = next(iter(state.oriented.photos))
    pixel_m = state.oriented.photos[name].ground_pixel_m(state.oriented.camera_of(name))
    longest = np.linalg.norm(vectors[:, 1] - vectors[:, 0], axis=1).max()
    assert longest == pytest.approx(
        pixel_m * np.nanmax(np.linalg.norm(report.tie_residuals_px, axis=1)), rel=0.15
    )


def test_vectors_are_drawn_as_long_as_can_be_read__law(state):
    scale = readable_scale(state)
    assert scale / 10 ** np.floor(np.log10(scale)) in (1, 2, 5)
    bare = replace(state, block=replace(state.block, measurements={}))
    assert readable_scale(bare) == 1.0


def test_the_picture_is_in_the_local_frame__law(state):
    picture = scene_picture(state, ("1938_01_014",), outlines(state))
    assert [f.photo_id for f in picture.frustums if f.stale] == ["1938_01_014"]
    for frustum in picture.frustums:
        back = object_from_local(frustum.centre[None], state.block.origin)[0]
        assert np.allclose(back, state.oriented.photos[frustum.photo_id].exterior.centre)
    drawn = sum(len(points) for points in picture.points.values())
    assert drawn == len(point_states(state))


def test_photos_are_named_without_what_all_share__truth():
    names = ["LMSA08.1938.SYNT25.00515", "LMSA08.1938.SYNT25.00543"]
    assert list(short_names(names).values()) == ["00515", "00543"]
    assert short_names(["a.1"]) == {"a.1": "a.1"}
    assert short_names(["left", "right"]) == {"left": "left", "right": "right"}


@pytest.mark.parametrize(("extent", "scale"), [(2400.0, 50.0), (900.0, 1000.0), (8e4, 1.0)])
def test_the_arrow_of_scale_is_round_and_fits_the_block__law(extent, scale):
    length = measure_m(extent, scale)
    assert round(length / 10 ** np.floor(np.log10(length) + 1e-9), 6) in (1, 2, 5)
    assert 0.03 * extent < length * scale <= 0.1 * extent * (1 + 1e-9)
