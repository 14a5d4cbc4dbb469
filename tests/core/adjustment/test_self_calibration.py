"""Camera constants and additional parameters that a block determines, and those it does not."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import ExteriorPrior, TiePoints
from core.errors import OrientationError
from core.geometry.camera import additional_set
from core.geometry.exterior import angles_from_rotation, rotation_from_angles
from core.quality.rules import doubts_of
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(
    strips=3, photos_per_strip=5, ties=1500, control=60, camera_errors=False, side=0.5
)
EBNER = AdjustmentOptions(robust=False, self_calibration=("ebner12",))


def bent_flight(values, names, seed=3):
    """A block flown with a film that is bent by some parameters, millimetres."""
    plan = PLAN
    flat = fly(plan, np.random.default_rng(seed))
    parameters = additional_set(names)
    bent = np.tensordot(np.array(values), parameters.basis, axes=1).ravel()
    camera = replace(flat.truth.cameras["wide"], deformation_mm=tuple(bent))
    pixels = flat.block.ties.pixels.copy()
    ties = flat.block.ties
    for index, name in enumerate(ties.photo_ids):
        rows = ties.photo == index
        photo, points = flat.truth.photos[name], flat.ties[ties.point[rows]]
        straight = photo.pixel_from_object(points, flat.truth.cameras["wide"])
        pixels[rows] += photo.pixel_from_object(points, camera) - straight
    measurements = {}
    for key, item in flat.block.measurements.items():
        photo = flat.truth.photos[key[1]]
        point = flat.truth.surveyed[key[0]].position[None]
        off = photo.pixel_from_object(point, camera) - photo.pixel_from_object(
            point, flat.truth.cameras["wide"]
        )
        measurements[key] = replace(
            item, column=item.column + float(off[0, 0]), row=item.row + float(off[0, 1])
        )
    block = replace(flat.block, ties=replace(ties, pixels=pixels), measurements=measurements)
    return replace(flat, block=block)


def test_significant_parameters_come_back_and_others_are_held__truth():
    values = np.zeros(12)
    values[[0, 5, 8]] = [0.03, -0.02, 0.025]
    flight = bent_flight(values, ("ebner12",))
    plain = adjust_block(flight.block, replace(EBNER, self_calibration=()))
    report = adjust_block(flight.block, EBNER)
    assert any(doubt.kind == "systematic" for doubt in doubts_of(plain))
    assert plain.sigma_nought > 1.1 > report.sigma_nought
    found = {p.name: p for p in report.parameters}
    for number, value in zip((1, 6, 9), values[[0, 5, 8]], strict=True):
        parameter = found[f"ebner_{number}_um"]
        assert not parameter.held
        assert abs(parameter.value - 1000 * value) < 4 * parameter.sigma
    held = [p for p in report.parameters if p.held]
    assert len(held) >= 7
    assert all(abs(p.value) < 0.01 for p in held)
    # The camera carries it on: adjusting again changes nothing.
    again = adjust_block(report.block, EBNER)
    assert again.sigma_nought == pytest.approx(report.sigma_nought, abs=1e-6)


@pytest.mark.parametrize("name", ["tangential", "affinity", "gruen44"])
def test_every_set_takes_up_its_own_bend__truth(name):
    count = len(additional_set((name,)).names)
    values = np.zeros(count)
    values[count - 1] = 0.03
    flight = bent_flight(values, (name,))
    options = replace(EBNER, self_calibration=(name,), only_significant=False)
    assert adjust_block(flight.block, options).sigma_nought < 1.05


def test_each_photo_with_constants_of_its_own__law():
    flight = fly(replace(PLAN, strips=1, photos_per_strip=3, ties=400), np.random.default_rng(1))
    options = AdjustmentOptions(robust=False, per_photo=True, self_calibration=("affinity",))
    report = adjust_block(flight.block, options)
    assert {photo.camera for photo in report.block.photos.values()} == {
        f"wide@{name}" for name in flight.block.photos
    }
    again = adjust_block(report.block, options)
    assert again.sigma_nought == pytest.approx(report.sigma_nought, abs=1e-6)
    assert len({p.owner for p in report.parameters}) == 3


def test_too_many_cameras_are_refused__law():
    block = fly(PLAN, np.random.default_rng(1)).block
    photo = next(iter(block.photos.values()))
    photos = {f"p{n:03d}": replace(photo, photo_id=f"p{n:03d}") for n in range(120)}
    bare = replace(block, measurements={}, ties=TiePoints.none(), photos=photos)
    with pytest.raises(OrientationError, match="self_calibration_per"):
        adjust_block(bare, AdjustmentOptions(per_photo=True))


# ------------------------------------------------------------------ GNSS and IMU


def flown_block(seed, shift=(0.0, 0.0, 0.0), drift=0.0, turn=0.0):
    """Centres good to 0.1 m but shifted, drifting and turned together."""
    plan = replace(PLAN, strips=2, control=20, control_sigma_m=(0.05, 0.05, 0.05))
    flight, rng = fly(plan, np.random.default_rng(seed)), np.random.default_rng(seed + 100)
    photos = {}
    for name, photo in flight.block.photos.items():
        true = flight.truth.photos[name].exterior
        place = int(name[3:]) / 2 - 1
        centre = true.centre + np.array(shift) + drift * place + rng.normal(size=3) * 0.1
        angles = np.array([true.omega, true.phi, true.kappa]) + rng.normal(size=3) * 2e-4
        known = replace(
            true,
            centre=centre,
            omega=float(angles[0]),
            phi=float(angles[1]),
            kappa=float(angles[2]),
        )
        if turn:
            known = turned(known, turn)
        prior = ExteriorPrior(np.full(3, 0.1), np.full(3, 2e-4))
        photos[name] = replace(photo, exterior=known, approximate=known, prior=prior)
    return flight, flight.block.with_photos(photos)


def turned(exterior, angle):
    """A measured rotation R exp[m] with the same m about x in every photo."""
    rotation = exterior.object_from_image @ rotation_from_angles(angle, 0.0, 0.0)
    omega, phi, kappa = angles_from_rotation(rotation)
    return replace(exterior, omega=omega, phi=phi, kappa=kappa)


def test_shift_drift_and_misalignment_are_found__truth():
    _, block = flown_block(5, shift=(1.5, -0.8, 2.0), drift=0.6, turn=0.004)
    plain = AdjustmentOptions(robust=False, estimate_cameras=False)
    without = adjust_block(block, plain)
    assert any(doubt.subject.startswith("measured") for doubt in doubts_of(without))
    options = replace(plain, gnss_shift="strip", gnss_drift=True, misalignment=True)
    report = adjust_block(block, options)
    found = {(p.owner, p.name): p for p in report.parameters}
    for owner in ("strip 1", "strip 2"):
        for axis, value in zip("XYZ", (1.5, -0.8, 2.0), strict=True):
            parameter = found[owner, f"gnss_shift_{axis}_m"]
            assert abs(parameter.value - value) < 4 * parameter.sigma
            # The second strip is flown the other way, but counted the same way along.
            drift = found[owner, f"gnss_drift_{axis}_m"]
            assert abs(abs(drift.value) - 0.6) < 4 * drift.sigma
    angle = found["block", "misalignment_x_deg"]
    assert abs(angle.value - np.degrees(0.004)) < 4 * angle.sigma
    assert report.classes["centre"].sigma_ratio == pytest.approx(1.0, abs=0.35)
    assert report.classes["angles"].sigma_ratio == pytest.approx(1.0, abs=0.35)


def test_measured_centres_stand_for_control__truth():
    flight, block = flown_block(6)
    report = adjust_block(replace(block, measurements={}), AdjustmentOptions(robust=False))
    assert not any(doubt.kind.startswith("control") for doubt in doubts_of(report))
    for name, photo in report.block.photos.items():
        off = photo.exterior.centre - flight.truth.photos[name].exterior.centre
        assert np.abs(off).max() < 0.4
