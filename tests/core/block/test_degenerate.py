"""Blocks that cannot be adjusted, or only badly: each says why, none falls over."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.adjusted import AdjustmentOptions
from core.block.adjustment import adjust_block
from core.block.block import TiePoints
from core.block.degenerate import control_doubts
from core.geometry.exterior import ExteriorOrientation
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=300, control=30, check=0)


@pytest.fixture(scope="module")
def block():
    return fly(PLAN, np.random.default_rng(4)).block


@pytest.fixture(scope="module")
def dense():
    """Many control points to choose from, and strips long enough for photos that do not overlap."""
    plan = replace(PLAN, photos_per_strip=4, control=400)
    return fly(plan, np.random.default_rng(4)).block


def kinds(report):
    return {doubt.kind for doubt in report.doubts}


def doubt(report, kind):
    return next(doubt for doubt in report.doubts if doubt.kind == kind)


def with_photos(block, names):
    """Only these photos, with what they show."""
    photos = {name: photo for name, photo in block.photos.items() if name in names}
    measured = {key: m for key, m in block.measurements.items() if key[1] in names}
    return replace(block, photos=photos, measurements=measured)


def with_control_in(block, inside):
    """Only the control points whose place a function accepts."""
    keep = {name for name, point in block.surveyed.items() if inside(point.position)}
    return replace(
        block, measurements={k: m for k, m in block.measurements.items() if k[0] in keep}
    )


def sound(report):
    """Orientations are numbers, whatever was wrong."""
    for photo in report.block.photos.values():
        assert np.isfinite(photo.exterior.centre).all()
    return report


def test_one_photo__law(block):
    report = sound(adjust_block(with_photos(block, {"00_000"})))
    assert report.converged
    assert doubt(report, "single-photo").subject == "00_000"


def test_two_photos_without_overlap__law(dense):
    report = sound(adjust_block(with_photos(dense, {"00_000", "00_003"})))
    found = doubt(report, "block-in-parts")
    assert "no tie point joins it" in found.message
    assert found.evidence["parts"] == 2


def test_two_blocks_without_connection__law(block):
    ties = block.ties
    strip = np.array([name.startswith("01") for name in ties.photo_ids])[ties.photo]
    split = replace(ties, point=np.where(strip, ties.point + ties.count, ties.point))
    report = sound(adjust_block(replace(block, ties=split)))
    found = doubt(report, "block-in-parts")
    assert len(found.evidence["scans"]) == 3
    assert found.evidence["control_points"] > 3
    # Without control of its own the second part hangs on its approximate place alone.
    bare = {k: m for k, m in block.measurements.items() if not k[1].startswith("01")}
    alone = sound(adjust_block(replace(block, ties=split, measurements=bare)))
    assert "which is too few" in doubt(alone, "block-in-parts").message


def test_all_control_on_a_line__law(dense):
    north = np.median([point.position[1] for point in dense.surveyed.values()])
    line = with_control_in(dense, lambda position: abs(position[1] - north) < 60)
    report = sound(adjust_block(line))
    found = doubt(report, "control-on-a-line")
    assert found.evidence["along_m"] > 5 * found.evidence["across_m"]


def test_all_control_in_one_corner__law(block, dense):
    places = np.array([point.position for point in dense.surveyed.values()])
    corner = places.min(axis=0) + 0.35 * np.ptp(places, axis=0)
    near = with_control_in(dense, lambda position: (position[:2] < corner[:2]).all())
    report = sound(adjust_block(near))
    assert doubt(report, "control-in-one-corner").evidence["share"] < 0.15
    assert "control-in-one-corner" not in kinds(adjust_block(block))


def test_no_control_and_too_little__law(block):
    assert "no-control" in kinds(sound(adjust_block(replace(block, measurements={}))))
    two = sorted({key[0] for key in block.measurements})[:2]
    few = {key: m for key, m in block.measurements.items() if key[0] in two}
    report = sound(adjust_block(replace(block, measurements=few)))
    assert "control-too-few" in kinds(report)
    assert not control_doubts(
        np.zeros((0, 3)), np.zeros((0, 3)), np.eye(3) * 5000, 2000.0, measured_centres=3
    )


def test_point_behind_the_camera__law(block):
    name, photo = next(iter(block.photos.items()))
    over = ExteriorOrientation(photo.exterior.centre, np.pi, 0.0, 0.0)
    prior = replace(photo.prior, sigma_angles=np.full(3, 1e-4))
    upside = replace(photo, exterior=over, approximate=over, prior=prior)
    report = sound(adjust_block(block.with_photos({**block.photos, name: upside})))
    found = doubt(report, "point-behind-camera")
    assert found.subject == name
    mine = [key for key in block.measurements if key[1] == name]
    assert all("behind the camera" in report.rejected[key] for key in mine)


def test_duplicate_points__law(block):
    key, item = next(iter(block.measurements.items()))
    point = block.surveyed[key[0]]
    twin = replace(point, point_id="zz-again")
    double = replace(
        block,
        surveyed={**block.surveyed, "zz-again": twin},
        measurements={
            **block.measurements,
            ("zz-again", key[1]): replace(item, point_id="zz-again"),
        },
    )
    report = sound(adjust_block(double))
    assert doubt(report, "duplicate-points").subject == "zz-again"
    assert point.point_id in report.rejected["zz-again", key[1]]
    assert report.sigma_nought == pytest.approx(adjust_block(block).sigma_nought)


def test_duplicate_tie_rays_count_once__law(block):
    ties = block.ties
    twice = TiePoints(
        ties.photo_ids,
        np.append(ties.point, ties.point[:50]),
        np.append(ties.photo, ties.photo[:50]),
        np.concatenate([ties.pixels, ties.pixels[:50]]),
        np.append(ties.sigma_px, ties.sigma_px[:50]),
    )
    report = sound(adjust_block(replace(block, ties=twice)))
    assert report.redundancy == adjust_block(block).redundancy


@pytest.mark.parametrize("shift", [1e6, 1e9, 1e15])
def test_control_with_huge_coordinates__law(block, shift):
    name = next(iter(block.measurements))[0]
    point = block.surveyed[name]
    far = replace(point, position=point.position + np.array([shift, 0.0, 0.0]))
    report = sound(adjust_block(replace(block, surveyed={**block.surveyed, name: far})))
    assert report.converged
    assert doubt(report, "control-far-away").subject == name
    assert "km from where the photo was taken" in next(iter(report.rejected.values()))
    assert 0.8 < report.sigma_nought < 1.2


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none__law(block, value):
    name = next(iter(block.measurements))[0]
    point = block.surveyed[name]
    spoilt = replace(point, position=np.array([value, *point.position[1:]]))
    report = sound(adjust_block(replace(block, surveyed={**block.surveyed, name: spoilt})))
    assert doubt(report, "impossible-number").subject == name
    assert report.converged


def test_sigma_of_nought__law(block):
    fixed = {n: replace(p, sigma_m=np.zeros(3)) for n, p in block.surveyed.items()}
    report = sound(adjust_block(replace(block, surveyed=fixed), AdjustmentOptions(robust=False)))
    assert "standard deviation of nought" in doubt(report, "sigma-nought-given").message
    ties = replace(block.ties, sigma_px=np.zeros(len(block.ties.point)))
    exact = sound(adjust_block(replace(block, ties=ties), AdjustmentOptions(robust=False)))
    assert doubt(exact, "sigma-nought-given").subject == "measurements"


def test_uncheckable_control_is_named__law(block):
    """One photo and three points: nothing is left over to check them."""
    one = with_photos(block, {"00_000"})
    loose = replace(
        one.photos["00_000"].prior, sigma_centre_m=np.full(3, 1e4), sigma_angles=np.full(3, 10.0)
    )
    photo = replace(one.photos["00_000"], prior=loose)
    names = sorted({key[0] for key in one.measurements})[:3]
    three = {key: m for key, m in one.measurements.items() if key[0] in names}
    report = adjust_block(
        replace(one, photos={"00_000": photo}, measurements=three, ties=TiePoints.none()),
        AdjustmentOptions(estimate_cameras=False),
    )
    assert "cannot be checked by any other" in doubt(sound(report), "uncheckable-control").message


def test_a_class_that_is_worse_than_stated_is_told__truth():
    flight = fly(replace(PLAN, ties=600, tie_sigma_px=1.5), np.random.default_rng(3))
    ties = flight.block.ties
    block = replace(flight.block, ties=replace(ties, sigma_px=ties.sigma_px / 3))
    report = adjust_block(block, AdjustmentOptions(robust=False))
    found = doubt(report, "class-too-large")
    assert found.subject == "tie"
    assert found.evidence["ratio"] == pytest.approx(3.0, rel=0.1)
