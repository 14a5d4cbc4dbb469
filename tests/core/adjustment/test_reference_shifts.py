"""References that lie off as a whole: the adjustment finds by how much."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.block import UNKNOWN_M, ShiftedReference
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(strips=2, photos_per_strip=3, ties=300, control=60)
PLAIN = AdjustmentOptions(robust=False)
MOSAIC = ShiftedReference("../1984 (1984)", (1.5, 1.5, 1.5))
SHIFT_M = (0.9, -0.6, 0.4)


def tied_to_both(seed: int, shared: ShiftedReference | None = MOSAIC):
    """A flight of whose control every other point comes from a mosaic that lies off and slopes.

    Returns:
        The block, the truth, and the nine values that were put in.
    """
    flight = fly(PLAN, np.random.default_rng(seed))
    surveyed = flight.block.surveyed
    names = [name for row, name in enumerate(sorted(flight.truth.surveyed)) if row % 2]
    shown = {key[0] for key in flight.block.measurements}
    names = [name for name in names if surveyed[name].role == "control" and name in shown]
    plan = np.array([surveyed[name].position[:2] for name in names])
    low, high = plan.min(axis=0), plan.max(axis=0)
    places = np.column_stack([np.ones(len(plan)), (2 * plan - low - high) / (high - low)])
    put_in = np.column_stack([SHIFT_M, np.random.default_rng(seed).normal(0, 0.3, (3, 2))])
    moved = {
        name: replace(surveyed[name], position=surveyed[name].position + off, shifted=shared)
        for name, off in zip(names, places @ put_in.T, strict=True)
    }
    return replace(flight.block, surveyed={**surveyed, **moved}), flight.truth, put_in.ravel()


def ground_error_m(report, truth) -> float:
    """RMS of where photos show the ground under their middle, less where it truly is, metres."""
    off = [
        photo.object_from_pixel(np.array([photo.size_px]) / 2, np.array([300.0]), camera)
        - true.object_from_pixel(np.array([true.size_px]) / 2, np.array([300.0]), true_camera)
        for name, photo in report.block.photos.items()
        for camera, true in [(report.block.camera_of(name), truth.photos[name])]
        for true_camera in [truth.cameras["wide"]]
    ]
    return float(np.sqrt(np.mean(np.sum(np.concatenate(off)[:, :2] ** 2, axis=1))))


def test_what_a_reference_is_off_comes_out_with_its_sigma__truth() -> None:
    off, sigma_noughts = [], []
    for seed in range(8):
        block, _, put_in = tied_to_both(seed)
        report = adjust_block(block, PLAIN)
        told = [one for one in report.parameters if one.owner == MOSAIC.name]
        assert [one.name for one in told[:2]] == ["shift_E_m", "slope_E_east_m"]
        # Much less than the prior: it is the other control that tells.
        assert max(one.sigma for one in told[::3]) < 0.3 * MOSAIC.sigma_m[0]
        off.append([(one.value - true) / one.sigma for one, true in zip(told, put_in, strict=True)])
        sigma_noughts.append(report.sigma_nought)
        residuals = [
            (place - block.surveyed[name].position) / block.surveyed[name].sigma_m
            for name, place in report.surveyed_positions.items()
            if block.surveyed[name].shifted
        ]
        assert np.abs(np.mean(residuals, axis=0)).max() < 0.5
    assert np.mean(sigma_noughts) == pytest.approx(1.0, abs=0.03)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.2)


def test_the_datum_comes_from_the_other_control__truth() -> None:
    alone, tied, taken_over = [], [], []
    for seed in range(4):
        block, truth, _ = tied_to_both(seed)
        own = {k: m for k, m in block.measurements.items() if not block.surveyed[k[0]].shifted}
        alone.append(ground_error_m(adjust_block(replace(block, measurements=own), PLAIN), truth))
        tied.append(ground_error_m(adjust_block(block, PLAIN), truth))
        believed, _, _ = tied_to_both(seed, None)
        taken_over.append(ground_error_m(adjust_block(believed, PLAIN), truth))
    assert np.mean(tied) < np.mean(alone) < np.mean(taken_over)


def surveyed_on_reference(seed: int, surveyed: int):
    """A flight on one reference, all of it off by a shift, with so many points of a survey.

    Returns:
        The block and the truth.
    """
    flight = fly(PLAN, np.random.default_rng(seed))
    shown = sorted({key[0] for key in flight.block.measurements})
    control = [name for name in shown if flight.block.surveyed[name].role == "control"]
    points = dict(flight.block.surveyed)
    for row, name in enumerate(control):
        own = points[name]
        points[name] = (
            replace(own, source="surveyed")
            if row < surveyed
            else replace(own, position=own.position + np.array(SHIFT_M))
        )
    return replace(flight.block, surveyed=points, reference=MOSAIC), flight.truth


def test_surveyed_points_tell_what_the_reference_is_off__truth() -> None:
    off, told, believed = [], [], []
    for seed in range(8):
        block, truth = surveyed_on_reference(seed, 6)
        assert block.surveyed_datum
        report = adjust_block(block, PLAIN)
        found = {one.name: one for one in report.parameters if one.owner == MOSAIC.name}
        shifts = [found[f"shift_{axis}_m"] for axis in "ENH"]
        off += [(one.value - true) / one.sigma for one, true in zip(shifts, SHIFT_M, strict=True)]
        told.append(ground_error_m(report, truth))
        believed.append(ground_error_m(adjust_block(replace(block, reference=None), PLAIN), truth))
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.3)
    assert np.mean(told) < 0.5 * np.mean(believed)


def test_fewer_than_three_leave_it_to_the_reference__law() -> None:
    block, _ = surveyed_on_reference(0, 2)
    assert not block.surveyed_datum
    assert block.reference_error_m(0.25) == 0.25
    assert not [one for one in adjust_block(block, PLAIN).parameters if one.owner == MOSAIC.name]
    three, _ = surveyed_on_reference(0, 3)
    assert three.surveyed_datum
    assert three.reference_error_m(0.25) == 0.0
    # Where nobody said what the reference may be off, it cannot be estimated and is not left out.
    assert replace(three, reference=None).reference_error_m(0.25) == 0.25
    one = next(
        name for name, p in three.surveyed.items() if p.source == "surveyed" and p.role == "control"
    )
    loose = {
        key: replace(m, status="rejected") for key, m in three.measurements.items() if key[0] == one
    }
    assert not replace(three, measurements={**three.measurements, **loose}).surveyed_datum
    flat = replace(three.surveyed[one], sigma_m=np.array([0.1, 0.1, UNKNOWN_M]))
    assert not replace(three, surveyed={**three.surveyed, one: flat}).surveyed_datum


def test_an_adjusted_block_is_found_again_from_its_report__law() -> None:
    block, _, _ = tied_to_both(1)
    report = adjust_block(block, PLAIN)
    influence = influence_of(report, PLAIN)
    assert influence is not None
    assert influence.solution.fit.steps <= 1
    shifts = [one.value for one in report.parameters if one.owner == MOSAIC.name]
    np.testing.assert_allclose(influence.solution.fit.state.shifts, shifts, atol=1e-6)
    judged = {one.point_id: one for one in influence.leave_one_out()}
    name = next(
        name
        for name, one in judged.items()
        if block.surveyed[name].shifted and np.isfinite(one.difference_m).all()
    )
    free = replace(block.surveyed[name], sigma_m=np.full(3, 1e4))
    again = adjust_block(replace(block, surveyed={**block.surveyed, name: free}), PLAIN)
    off = again.surveyed_positions[name] - block.surveyed[name].position
    np.testing.assert_allclose(judged[name].difference_m, off, atol=0.01)
