"""Reference points are looked for wherever the photos may lie."""

from dataclasses import replace

import numpy as np
import shapely

from core.progress import Silent, Work
from core.reference.stage import find_reference_points, gather_reference_points, join_points


def test_reference_points_lie_in_what_is_searched__truth(given, scan_set, placed):
    scans = {name: scan.scan for name, scan in scan_set.oriented.items()}
    found = find_reference_points(placed.block, scans, given.reference, 0.35, work=Work())
    west, south, east, north = placed.block.search_bounds
    places = found.points.positions
    assert len(places) > 60
    assert ((places[:, :2] >= [west, south]) & (places[:, :2] <= [east, north])).all()
    assert set(found.sources.values()) == {"junction", "salient"}


def test_junctions_come_first_and_salient_points_fill_the_gaps__truth(tiny, junctions, features):
    points = features.points
    kinds = [features.sources[name] for name in points.ids]
    assert kinds[: kinds.index("salient")] == ["junction"] * kinds.index("salient")
    assert kinds.count("junction") == len({junction.junction_id for junction in junctions})
    assert kinds.count("salient") > 20
    assert len(points.ids) == len(points.positions) == len(points.sigma_m) == len(set(points.ids))
    assert np.isfinite(points.positions).all()
    assert (points.sigma_m > 0).all()
    heights = tiny.reference.dem.heights(points.positions[:, :2])
    np.testing.assert_allclose(points.positions[:, 2], heights, atol=0.05)


def test_salient_points_keep_away_from_junctions_and_from_each_other__truth(features):
    points = features.points
    salient = np.array([features.sources[name] == "salient" for name in points.ids])
    places = points.positions[:, :2]
    apart = np.hypot(*(places[salient][:, None] - places[None]).transpose(2, 0, 1))
    apart[apart == 0] = np.inf
    # One a cell: half a cell's spacing would be two for one place.
    assert np.percentile(apart.min(axis=1), 5) > 20.0


def test_nothing_is_matched_in_the_mask__truth(tiny, junctions):
    west, south, east, north = tiny.reference.ortho.bounds
    middle = (west + east) / 2
    mask = shapely.box(west, south, middle, north)
    found = gather_reference_points(
        tiny.reference,
        (),
        (west, south, east, north),
        1200.0,
        gsd_m=1.2,
        mask=mask,
        progress=Silent(),
    )
    assert len(found.points.ids) > 10
    assert (found.points.positions[:, 0] > middle).all()


def test_a_name_given_twice_is_taken_once__truth(junctions):
    again = replace(junctions[0], position=junctions[0].position + 5.0)
    found = join_points((*junctions[:3], again), ())
    assert len(found.points.ids) == 3
    np.testing.assert_array_equal(found.points.positions[0], junctions[0].position)


def test_no_points_at_all_are_empty_arrays__law():
    found = join_points((), ())
    assert found.points.ids == ()
    assert found.points.positions.shape == found.points.sigma_m.shape == (0, 3)
