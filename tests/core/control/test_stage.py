"""Control is searched in photos that stand, rid of gross errors, and settles."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import ShiftedReference
from core.control.multi_photo import keeping_surfaces
from core.control.stage import (
    ControlStageOptions,
    adjusted_without_gross,
    movement,
    propose_and_adjust,
    search_photos,
)
from core.localisation.initial_orientation import Site
from core.localisation.photo_orientation import OrientationOptions
from core.matching.patches import object_on_ground
from core.progress import Work
from core.raster.ortho import open_ortho
from core.reference.stage import ReferencePoints
from core.synthetic.options import CRS
from tests.flights import FlightPlan, fly
from tests.tiny import ground_over, true_ties


def test_only_photos_that_stand_are_searched_for_control__truth(tiny):
    name = tiny.names[0]
    photo = tiny.photos[name]
    pixels = np.array([[400.0, 500.0], [600.0, 500.0]])
    ground = object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)
    points = ReferencePoints(("A", "B"), ground, np.full((2, 3), 0.3))
    site = Site(tiny.archival(), tiny.scans, points, {"A": "salient", "B": "salient"})
    block = tiny.block.with_photos(
        {n: replace(p, oriented=n == name) for n, p in tiny.photos.items()}
    )
    options = ControlStageOptions(orientation=OrientationOptions(template_half_px=30))
    with keeping_surfaces() as kept:
        found = search_photos(block, site, options, (), kept, Work())
    assert {value.photo_id for value in found} == {name}


def test_one_worker_and_two_propose_the_same__law(tiny):
    """To the last digit, whichever photo is done first."""
    ground = ground_over(tiny, 5)
    ids = tuple(f"P{i:02d}" for i in range(len(ground)))
    points = ReferencePoints(ids, ground, np.full(ground.shape, 0.4))
    site = Site(tiny.reference, tiny.scans, points, dict.fromkeys(ids, "salient"))
    block = tiny.block.with_photos({n: replace(p, oriented=True) for n, p in tiny.photos.items()})
    options = ControlStageOptions(orientation=OrientationOptions(template_half_px=30))
    with keeping_surfaces() as kept:
        alone = search_photos(block, site, options, (), kept, Work())
    with ThreadPoolExecutor(2) as pool, keeping_surfaces() as kept:
        together = search_photos(block, site, options, (), kept, Work(mapper=pool.map))
    assert len(alone) > 20
    assert repr(alone) == repr(together)


def test_an_ortho_that_lies_off_is_searched_by_itself_and_its_shift_is_found__truth(tiny, tmp_path):
    """The ground of then, in an ortho that lies off and in one that does not."""
    off_m = np.array([2.0, -1.0, 0.0])
    with rasterio.open(tiny.truth.archival_ortho) as right:
        moved = Affine.translation(*off_m[:2]) @ right.transform
        with rasterio.open(
            tmp_path / "off.tif", "w", **right.profile | {"transform": moved}
        ) as off:
            off.write(right.read())
    ground = ground_over(tiny, 5)
    sigma_m, mosaic = np.full(ground.shape, 0.3), ShiftedReference("mosaic", (3.0, 3.0, 0.0))
    ids = [tuple(f"{word}{i:02d}" for i in range(len(ground))) for word in ("P", "M")]
    points = [
        ReferencePoints(ids[0], ground, sigma_m),
        ReferencePoints(ids[1], ground + off_m, sigma_m, mosaic),
    ]
    now = tiny.archival()
    then = replace(now, ortho=open_ortho([tmp_path / "off.tif"], CRS))
    sites = [
        Site(reference, tiny.scans, own, dict.fromkeys(own.ids, "salient"))
        for reference, own in zip((now, then), points, strict=True)
    ]
    block = tiny.block.with_photos({n: replace(p, oriented=True) for n, p in tiny.photos.items()})
    block = replace(block, ties=true_ties(tiny))
    options = ControlStageOptions(orientation=OrientationOptions(template_half_px=30))
    report, _ = propose_and_adjust(block, sites, options, True, Work())
    told = {one.name: one for one in report.parameters if one.owner == "mosaic"}
    for name, true in (("shift_E_m", 2.0), ("shift_N_m", -1.0)):
        assert told[name].value == pytest.approx(true, abs=3 * told[name].sigma)
        assert told[name].sigma < 0.15
    used = {key[0][0] for key, item in report.block.measurements.items() if item.used}
    assert used == {"P", "M"}


def gross_flight():
    """A good block, and the same with one control point fifteen metres off in the field."""
    flight = fly(
        FlightPlan(ties=200, control=24, check=6, camera_errors=False, start_m=5.0),
        np.random.default_rng(5),
    )
    seen = [key[0] for key in flight.block.measurements]
    name = max((n for n, p in flight.block.surveyed.items() if p.role == "control"), key=seen.count)
    point = flight.block.surveyed[name]
    wrong = replace(point, position=point.position + np.array([9.0, -12.0, 0.0]))
    return flight, replace(flight.block, surveyed={**flight.block.surveyed, name: wrong}), name


def test_gross_control_is_left_out_and_the_rest_does_not_move__truth():
    flight, spoilt, name = gross_flight()
    options = AdjustmentOptions(estimate_cameras=False)
    without = replace(
        flight.block,
        measurements={k: m for k, m in flight.block.measurements.items() if k[0] != name},
    )
    clean = adjusted_without_gross(without, options)
    found = adjusted_without_gross(spoilt, options)
    mine = [m for key, m in found.block.measurements.items() if key[0] == name]
    assert mine
    assert all(m.status == "unused" and m.reason for m in mine)
    others = [m for key, m in found.block.measurements.items() if key[0] != name]
    assert np.mean([m.used for m in others]) > 0.97
    for photo in found.block.photos:
        apart = (
            found.block.photos[photo].exterior.centre - clean.block.photos[photo].exterior.centre
        )
        sigma = clean.exterior_sigmas[photo].centre_m
        assert (np.abs(apart) < 0.5 * sigma).all()
    assert 0.8 < found.sigma_nought < 1.2


def test_what_an_operator_accepted_is_never_left_out__law():
    """The engine may doubt it; it does not overrule a human."""
    _, spoilt, name = gross_flight()
    accepted = {
        key: replace(m, status="accepted") if key[0] == name else m
        for key, m in spoilt.measurements.items()
    }
    found = adjusted_without_gross(
        replace(spoilt, measurements=accepted), AdjustmentOptions(estimate_cameras=False)
    )
    kept = [m.status for key, m in found.block.measurements.items() if key[0] == name]
    assert set(kept) == {"accepted"}


def test_good_control_stays__law():
    flight, _, _ = gross_flight()
    options = AdjustmentOptions(estimate_cameras=False)
    found = adjusted_without_gross(flight.block, options)
    plain = adjust_block(flight.block, options)
    left_out = [k for k, m in found.block.measurements.items() if not m.used]
    assert len(left_out) <= 0.03 * len(found.block.measurements)
    for photo in found.block.photos:
        apart = (
            found.block.photos[photo].exterior.centre - plain.block.photos[photo].exterior.centre
        )
        assert (np.abs(apart) < plain.exterior_sigmas[photo].centre_m).all()


def test_movement_is_told_in_the_photos_own_standard_deviations__truth():
    flight, _, _ = gross_flight()
    report = adjust_block(flight.block, AdjustmentOptions(estimate_cameras=False))
    assert movement(report.block, report) == 0.0
    before = report.block.with_photos(
        {
            name: photo.with_exterior(
                replace(photo.exterior, centre=photo.exterior.centre + 2 * sigmas.centre_m), True
            )
            for name, sigmas in report.exterior_sigmas.items()
            for photo in [report.block.photos[name]]
        }
    )
    # Three of six unknowns have moved by two.
    assert movement(before, report) == pytest.approx(np.sqrt(2.0))


def test_a_photo_that_newly_stands_has_moved__law():
    flight, _, _ = gross_flight()
    report = adjust_block(flight.block, AdjustmentOptions(estimate_cameras=False))
    name = next(iter(report.block.photos))
    lost = replace(report.block.photos[name], oriented=False)
    before = report.block.with_photos({**report.block.photos, name: lost})
    assert movement(before, report) == float("inf")
