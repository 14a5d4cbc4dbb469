"""The 3D scene: where things are drawn."""

from dataclasses import replace

import numpy as np
import pytest

from core.frames import object_from_local
from tests.ui.desk_block import outlines, tiny_block, tiny_snapshot
from ui.review.misfit import misfits, ramp_top_m
from ui.review.scene import (
    area_lines,
    ellipse_lines,
    exaggerate_heights,
    misfit_vectors,
    point_states,
    readable_scale,
    scene_picture,
    short_names,
    tie_vectors,
)
from ui.review.state import DeskState

DEM = tiny_block().land.dem


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def test_footprints_are_closed_outlines__law(state):
    outline = outlines(state)
    assert len(outline) == 6 * 48
    assert np.allclose(outline[47, 1], outline[0, 0])


def test_a_point_shows_its_worst_state__law(state):
    key = next(k for k in state.block.measurements if state.block.surveyed[k[0]].role == "control")
    rejected = replace(state.block.measurements[key], status="rejected")
    worse = replace(state, block=state.block.with_measurement(rejected))
    assert point_states(worse)[key[0]] == "rejected"


def test_vectors_begin_at_their_points_and_are_as_long_as_the_misfit__law(state):
    keys, vectors = misfit_vectors(state)
    assert len(keys) == len(vectors)
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
    picture = scene_picture(state, ("1938_01_014",), outlines(state), DEM)
    assert [f.photo_id for f in picture.frustums if f.stale] == ["1938_01_014"]
    for frustum in picture.frustums:
        back = object_from_local(frustum.centre[None], state.block.origin)[0]
        assert np.allclose(back, state.oriented.photos[frustum.photo_id].exterior.centre)
    drawn = sum(len(cloud.points) for cloud in picture.points.values())
    assert drawn == len(point_states(state))


def test_photos_are_named_without_what_all_share__truth():
    names = ["LMSA08.1938.SYNT25.00515", "LMSA08.1938.SYNT25.00543"]
    assert list(short_names(names).values()) == ["00515", "00543"]
    assert list(short_names(["2015_06_0253_RGB", "2015_05_0182_RGB"]).values()) == [
        "06_0253",
        "05_0182",
    ]
    assert short_names(["a.1"]) == {"a.1": "a.1"}
    assert short_names(["left", "right"]) == {"left": "left", "right": "right"}


def test_heights_are_exaggerated_about_the_level_of_the_ground__law():
    places = np.array([[1.0, 2.0, 300.0], [3.0, 4.0, 250.0]])
    higher = exaggerate_heights(places, 280.0, 5.0)
    assert higher.tolist() == [[1.0, 2.0, 380.0], [3.0, 4.0, 130.0]]
    assert exaggerate_heights(places[None], 280.0, 1.0)[0] == pytest.approx(places)


def test_ellipses_have_the_standard_deviations_as_half_axes__truth(state):
    picture = scene_picture(state, (), outlines(state), DEM)
    middles = picture.ellipses.points
    assert len(middles) == len(state.report.surveyed_sigmas_m)
    rings = ellipse_lines(middles, picture.half_axes, 200.0).reshape(len(middles), -1, 3)
    assert rings.mean(axis=1) == pytest.approx(middles, abs=0.01)
    extent = np.ptp(rings, axis=1) / 2
    sigmas = np.array(list(state.report.surveyed_sigmas_m.values()))
    assert extent[:, :2] == pytest.approx(200 * sigmas[:, :2], rel=0.01)


def test_areas_are_nine_of_each_photo_and_the_bare_ones_are_crossed__truth(state):
    name = "1938_01_014"
    ties = state.report.block.ties
    number = ties.photo_ids.index(name)
    kept = (ties.photo != number) | (ties.pixels[:, 0] > 400)
    fewer = replace(
        ties, point=ties.point[kept], photo=ties.photo[kept], pixels=ties.pixels[kept],
        sigma_px=ties.sigma_px[kept],
    )  # fmt: skip
    without = {
        key: item
        for key, item in state.report.block.measurements.items()
        if key[1] != name or item.column > 400
    }
    block = replace(state.report.block, ties=fewer, measurements=without)
    report = replace(
        state.report, block=block, tie_residuals_px=state.report.tie_residuals_px[kept]
    )
    picture = scene_picture(replace(state, report=report), (), outlines(state), DEM)
    areas = picture.areas()
    mine = np.array(areas.photo_ids) == name
    assert mine.sum() == 9
    # The scan's left third is empty; rows come from the top, each from the left.
    assert areas.served[mine].reshape(3, 3).tolist() == [[False, True, True]] * 3
    lines, served = area_lines(areas, name)
    ring = areas.outlines.shape[1]
    assert len(lines) == 9 * ring + 3 * 2
    assert (~served).sum() == 3 * (ring + 2)
    bare, _ = area_lines(areas, "")
    assert len(bare) == (~areas.served).sum() * (ring + 2)
    outline = outlines(state)[:48, 0]
    assert np.ptp(areas.outlines[mine].reshape(-1, 3), axis=0)[:2] == pytest.approx(
        np.ptp(outline, axis=0)[:2], rel=0.12
    )


def test_a_photo_shows_its_own_points_and_ties__law(state):
    picture = scene_picture(state, (), outlines(state), DEM)
    for name in state.oriented.photos:
        own = {point for point, photo in state.block.measurements if photo == name}
        roles = [state.block.surveyed[point].role for point in own]
        shown = sum(len(cloud.shown_in(name)) for cloud in picture.points.values())
        assert shown == roles.count("control")
        assert len(picture.checks.shown_in(name)) == roles.count("check")
    chosen = picture.ties.shown_in("1938_01_014")
    assert 0 < len(chosen) < len(picture.ties.points)
    assert len(picture.ties.shown_in("")) == len(picture.ties.points)
    assert picture.rays.min() >= 2


def test_few_gross_errors_do_not_stretch_the_ramp__law(state):
    away = misfits(state)
    _, vectors = misfit_vectors(state, away)
    top = ramp_top_m(state, away)
    usual = np.median(np.linalg.norm(vectors[:, 1] - vectors[:, 0], axis=1))
    assert 3 * usual <= top <= 7.5 * usual
    key = next(key for key in away if state.block.measurements[key].status == "auto")
    assert ramp_top_m(state, {**away, key: replace(away[key], metres=(500.0, 0.0))}) == top
    # What the program left out is not drawn, and has no say.
    far = {
        key: replace(one, metres=(500.0, 0.0))
        if state.block.measurements[key].status == "unused"
        else one
        for key, one in away.items()
    }
    assert ramp_top_m(state, far) == top
    assert ramp_top_m(state, {}) == 1.0
