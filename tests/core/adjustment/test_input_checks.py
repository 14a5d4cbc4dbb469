"""Blocks that cannot be adjusted, or only badly: each says why, none falls over."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import TiePoints
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
