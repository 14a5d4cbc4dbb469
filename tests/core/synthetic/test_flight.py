"""Flight and landscape: overlaps, directions, and how much changed between the epochs."""

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon

from core.synthetic.flight import make_flight
from core.synthetic.land_cover import make_tracts
from core.synthetic.landscape import make_landscape
from core.synthetic.network import Network, Road
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import read_truth


def _footprints(flight):
    return [
        Polygon(
            e.ground_from_pixel(
                e.pixels(flight.camera.frame_corners_mm), flight.terrain, flight.camera
            )[:, :2]
        )
        for e in flight.exposures
    ]


@pytest.mark.parametrize("seed", range(6))
def test_strips_overlap_as_archives_do__truth(seed):
    flight = make_flight(SyntheticOptions(size="tiny", seed=seed))
    frames = _footprints(flight)
    forward = [frames[i].intersection(frames[i + 1]).area / frames[i].area for i in (0, 1, 3, 4)]
    assert 0.5 < np.mean(forward) < 0.66
    strips = shapely.union_all(frames[:3]), shapely.union_all(frames[3:])
    side = strips[0].intersection(strips[1]).area / strips[0].area
    assert 0.2 < side < 0.34
    kappas = np.array([e.exterior.kappa for e in flight.exposures])
    assert np.cos(kappas[:3]).min() > 0.95
    assert np.cos(kappas[3:]).max() < -0.95


def test_a_larger_block_keeps_its_overlaps_and_lies_on_its_terrain__truth():
    flight = make_flight(SyntheticOptions(size="tiny", seed=2, strips=3, photos_per_strip=4))
    frames = _footprints(flight)
    assert len({e.photo_id for e in flight.exposures}) == len(frames) == 12
    forward = [frames[i].intersection(frames[i + 1]).area / frames[i].area for i in (4, 5, 6)]
    assert 0.5 < np.mean(forward) < 0.66
    strips = [shapely.union_all(frames[i : i + 4]) for i in (0, 4, 8)]
    assert 0.2 < strips[1].intersection(strips[2]).area / strips[1].area < 0.34
    assert shapely.box(*flight.terrain.grid.bounds).contains(shapely.union_all(frames))


@pytest.mark.parametrize("relief_m", [0.0, 60.0, 300.0])
def test_relief_is_what_was_asked_for__truth(relief_m):
    flight = make_flight(SyntheticOptions(size="tiny", relief_m=relief_m))
    west, south, east, north = flight.bounds
    x, y = np.meshgrid(np.linspace(west, east, 80), np.linspace(south, north, 80))
    heights = flight.terrain.heights(np.column_stack([x.ravel(), y.ravel()]))
    assert np.ptp(heights) == pytest.approx(relief_m, rel=0.25)


def test_camera_differs_from_its_certificate_by_what_is_usual__truth():
    for seed in range(8):
        flight = make_flight(SyntheticOptions(size="tiny", seed=seed, epoch=1984))
        true, nominal = flight.camera, flight.nominal
        assert nominal.principal_distance_mm == 151.92
        assert abs(true.principal_distance_mm - 151.92) <= 0.02
        assert 0.02 <= np.hypot(*true.principal_point_mm) <= 0.08
        assert nominal.radial_distortion == (0.0, 0.0, 0.0)
        k1, k2, _ = true.radial_distortion
        r = np.hypot(90.0, 90.0)
        corner_um = 1000 * r * (k1 * r**2 + k2 * r**4)
        assert 15 <= abs(corner_um) <= 40


@pytest.mark.parametrize(("epoch", "change"), [(1938, 0.33), (1984, 0.10)])
def test_share_of_changed_roads_is_what_was_asked_for__truth(epoch, change):
    options = SyntheticOptions(size="tiny", seed=4, epoch=epoch)
    flight = make_flight(options)
    roads = make_landscape(options, flight.terrain, flight.bounds).network.roads
    changed = [r for r in roads if r.moved or not (r.exists_now and r.existed_then)]
    share = sum(r.length_m for r in changed) / sum(r.length_m for r in roads)
    assert share == pytest.approx(change, abs=0.04)
    stayed = [r for r in roads if r.exists_now and r.existed_then and not r.moved]
    away = np.concatenate([np.linalg.norm(r.now - r.then, axis=1) for r in stayed])
    assert 0.2 < np.sqrt(np.mean(away**2)) < 1.0


def test_most_parcels_of_1938_are_gone_and_few_of_1984__truth():
    kept = {}
    for epoch in (1938, 1984):
        options = SyntheticOptions(size="tiny", seed=5, epoch=epoch)
        flight = make_flight(options)
        network = make_landscape(options, flight.terrain, flight.bounds).network
        then, now = (
            make_tracts(network, past, options.parcel_change, options.recency, seed=5)
            for past in (True, False)
        )
        outlines = {tract.outline.tobytes() for tract in now}
        kept[epoch] = np.mean([tract.outline.tobytes() in outlines for tract in then])
    assert kept[1938] < 0.25
    assert kept[1984] > 0.4


def test_three_arms_in_both_epochs_make_a_lasting_junction__law():
    places = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0], [-100.0, 0.0], [0.0, -100.0]])

    def road(end: int, **epochs: bool) -> Road:
        line = places[[0, end]]
        return Road(0, end, "track", 0, line, line, **epochs)

    def lasting(*roads: Road) -> list[list[float]]:
        return Network(places, roads, ()).lasting_junctions().tolist()

    both = [road(1), road(2)]
    ploughed, built = road(3, exists_now=False), road(4, existed_then=False)
    assert lasting(*both, road(3)) == [[0.0, 0.0]]
    assert lasting(*both, ploughed, built) == []


def test_the_truth_names_the_junctions_that_lasted__truth(tiny_block):
    places = read_truth(tiny_block).lasting_junctions
    assert len(places) >= 5
    assert len(np.unique(places, axis=0)) == len(places)


def test_a_scan_pixel_of_ones_own_leaves_the_photo_scale_to_follow__truth():
    usual = make_flight(SyntheticOptions(size="tiny", seed=3))
    finer = make_flight(SyntheticOptions(size="tiny", seed=3, scan_pixel_um=90.0))
    wider = make_flight(SyntheticOptions(size="tiny", seed=3, scan_ground_m=2.4))
    assert finer.exposures[0].size_px[0] == pytest.approx(2 * usual.exposures[0].size_px[0], abs=2)

    def above(flight):
        exposure = flight.exposures[0]
        return exposure.exterior.centre[2] - np.median(flight.terrain.coefficients)

    assert above(finer) == pytest.approx(2 * above(usual), rel=0.02)
    assert above(wider) == pytest.approx(2 * above(usual), rel=0.02)
