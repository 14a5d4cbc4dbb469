"""Points searched in a photo: what is found, what is chance, what need not be searched again."""

from dataclasses import replace

import numpy as np

from core.control.proposals import judge_searches
from core.control.search import (
    SEARCH_M,
    decoys_of,
    plan_search,
    search_points,
)
from core.localisation.photo_orientation import OrientationOptions
from core.matching.patches import object_on_ground
from core.reference.stage import ReferencePoints

SMALL = OrientationOptions(template_half_px=30)


def test_decoys_are_the_maxima_outside_the_middle__truth():
    grid = np.mgrid[:81, :81]
    surface = (0.01 * np.random.default_rng(0).normal(size=(81, 81))).astype(np.float32)
    for column, row in ((40, 40), (12, 60)):
        surface += np.exp(-((grid[1] - column) ** 2 + (grid[0] - row) ** 2) / 8).astype(np.float32)
    heights, _, spread = decoys_of(surface, 10)
    assert max(heights) > 10
    assert 0.005 < spread < 0.05
    everywhere = decoys_of(surface, -1)[0]
    assert len(everywhere) > len(heights)
    assert sum(height > 10 for height in heights) == 1
    assert sum(height > 10 for height in everywhere) == 2


def test_at_the_truth_unchanged_ground_is_used_and_right__truth(tiny):
    name = tiny.names[0]
    photo = tiny.photos[name]
    share = np.stack(np.meshgrid(*[np.linspace(0.25, 0.75, 5)] * 2), axis=-1).reshape(-1, 2)
    pixels = share * np.array(photo.size_px)
    ground = object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)
    points = ReferencePoints(
        tuple(f"P{i:02d}" for i in range(25)), ground, np.full(ground.shape, 0.3)
    )
    searches = search_points(
        tiny.opened(name), tiny.archival(), points, OrientationOptions(template_half_px=30)
    )
    assert [one.point_id for one in searches] == sorted(points.ids)
    found, _ = judge_searches(searches, {})
    used = [value for value in found if value.used]
    assert len(used) >= 22
    away = [np.hypot(*(value.pixel[0] - pixels[int(value.point_id[1:])])) for value in used]
    assert np.mean(np.array(away) < 1.0) > 0.9
    assert all(value.photo_id == name and value.peaks for value in found)


def test_on_ground_of_another_place_hardly_anything_is_used__truth(tiny):
    """The photo stands a kilometre from where it truly was: all that is found is chance."""
    name = tiny.names[0]
    true = tiny.photos[name]
    share = np.stack(np.meshgrid(*[np.linspace(0.2, 0.8, 9)] * 2), axis=-1).reshape(-1, 2)
    centre = true.exterior.centre + np.array([300.0, 500.0, 0.0])
    opened = tiny.opened(name, replace(true.exterior, centre=centre))
    ground = object_on_ground(
        opened.photo, tiny.truth.camera, share * np.array(true.size_px), tiny.reference.dem
    )
    ground = ground[np.isfinite(ground[:, 2])]
    points = ReferencePoints(
        tuple(f"P{i:02d}" for i in range(len(ground))), ground, np.full(ground.shape, 0.3)
    )
    orientation = OrientationOptions(template_half_px=30)
    searches = search_points(opened, tiny.reference, points, orientation)
    found, _ = judge_searches(searches, {})
    assert len(found) >= 20
    assert sum(value.used for value in found) <= 1


def spread_points(tiny, count):
    """Places all over the first photo as reference points, and their true pixels."""
    photo = tiny.photos[tiny.names[0]]
    share = np.stack(np.meshgrid(*[np.linspace(0.3, 0.7, count)] * 2), axis=-1).reshape(-1, 2)
    pixels = share * np.array(photo.size_px)
    ground = object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)
    ids = tuple(f"P{i:02d}" for i in range(len(ground)))
    return ReferencePoints(ids, ground, np.full(ground.shape, 0.3)), pixels


def shifted(tiny, metres):
    """The first photo, standing so far east of where it truly was."""
    exterior = tiny.photos[tiny.names[0]].exterior
    centre = exterior.centre + np.array([metres, 0.0, 0.0])
    return tiny.opened(tiny.names[0], replace(exterior, centre=centre))


def test_a_later_search_finds_the_same_as_one_from_anew__truth(tiny):
    """The block moved by three metres: near searches on what is known of chance find the same."""
    points, pixels = spread_points(tiny, 4)
    reference = tiny.archival()
    first = search_points(shifted(tiny, 3.0), reference, points, SMALL)
    opened = tiny.opened(tiny.names[0])
    again = search_points(opened, reference, points, SMALL, before=first)
    anew = search_points(opened, reference, points, SMALL)
    assert [one.point_id for one in again] == [one.point_id for one in anew]
    for near, wide, pixel in zip(again, anew, pixels, strict=True):
        best, other = near.peaks[0], wide.peaks[0]
        assert np.hypot(best.column - other.column, best.row - other.row) < 0.2
        assert np.hypot(best.column - pixel[0], best.row - pixel[1]) < 2.0
        assert near.distance_m[0] < 1.5
    # Chance was learnt in the first search and is not learnt again.
    assert all(one.chance is two.chance for one, two in zip(again, first, strict=True))


def test_where_the_block_hardly_moved_peaks_stay_in_the_scan__truth(tiny):
    """Only their distance from the prediction is told anew."""
    points, _ = spread_points(tiny, 3)
    first = search_points(tiny.opened(tiny.names[0]), tiny.archival(), points, SMALL)
    again = search_points(shifted(tiny, 0.5), tiny.archival(), points, SMALL, before=first)
    assert [one.peaks for one in again] == [one.peaks for one in first]
    change = [two.distance_m[0] - one.distance_m[0] for one, two in zip(first, again, strict=True)]
    assert 0.0 < np.abs(change).max() < 0.55


def test_a_block_that_moved_far_is_searched_from_anew__truth(tiny):
    points, _ = spread_points(tiny, 3)
    reference = tiny.archival()
    first = search_points(shifted(tiny, 15.0), reference, points, SMALL)
    opened = tiny.opened(tiny.names[0])
    again = search_points(opened, reference, points, SMALL, before=first)
    assert repr(again) == repr(search_points(opened, reference, points, SMALL))


def test_a_later_search_is_as_wide_as_a_right_candidate_can_be_off__law(tiny):
    points, _ = spread_points(tiny, 2)
    opened = tiny.opened(tiny.names[0])
    plan = plan_search(opened, tiny.reference, points, SMALL)
    assert plan.inner * plan.pixel_m >= SEARCH_M
    assert plan.inner < plan.narrow < plan.wide
