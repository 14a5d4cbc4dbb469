"""Check points take part in nothing that is computed: blocks with and without them are the same."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.expected_gain import expected_gains
from core.adjustment.influence import influence_of
from core.block import Block, Measurement, SurveyedPoint
from core.control.proposals import PROPOSED, surveyed_of, with_proposals
from core.control.stage import adjusted_without_gross, with_true_worth
from core.quality.control_design import wanted_control
from core.reference.stage import ReferencePoints
from tests.flights import FlightPlan, fly

pytestmark = pytest.mark.slow

PLAN = FlightPlan(strips=2, photos_per_strip=3, ties=150, control=40, check=0)
OPTIONS = st.fixed_dictionaries(
    {
        "estimate_cameras": st.booleans(),
        "robust": st.booleans(),
        "self_calibration": st.sampled_from([(), ("ebner12",)]),
        "per_photo": st.booleans(),
        "free_network": st.booleans(),
        "variance_components": st.booleans(),
        "test": st.sampled_from(["w", "tau"]),
    }
)


def with_strangers(block: Block, rng: np.random.Generator) -> Block:
    """Check points of every source and state: sharp, far off, twice in one place, behind a name."""
    surveyed, measurements = dict(block.surveyed), dict(block.measurements)
    listed = list(measurements.values())
    for number in range(int(rng.integers(1, 40))):
        known = listed[int(rng.integers(len(listed)))]
        name = rng.choice(["A", "control", "z"]) + f"-check{number:02d}"
        source = rng.choice(["surveyed", "junction", "salient", "hand"])
        place = surveyed[known.point_id].position + rng.normal(size=3) * rng.choice([0.0, 0.1, 1e3])
        sigma = np.full(3, rng.choice([1e-6, 0.05, 5.0]))
        surveyed[name] = SurveyedPoint(name, place, sigma, "check", str(source))
        for photo in rng.choice(list(block.photos), int(rng.integers(1, 5)), replace=False):
            column, row = rng.uniform(0, 12_000, 2) if rng.random() < 0.3 else known.pixel[0]
            status = str(rng.choice(["auto", "accepted", "rejected", "dubious", "unused"]))
            item = Measurement(name, str(photo), column, row, rng.choice([0.01, 0.5, 9.0]))
            measurements[item.key] = replace(item, status=status)
    mixed = dict(sorted(measurements.items())) if rng.random() < 0.5 else measurements
    return replace(block, surveyed=dict(sorted(surveyed.items())), measurements=mixed)


def without_checks(block: Block) -> Block:
    control = {name: point for name, point in block.surveyed.items() if point.role == "control"}
    measured = {key: item for key, item in block.measurements.items() if key[0] in control}
    return replace(block, surveyed=control, measurements=measured)


def assert_same(one: Block, other: Block) -> None:
    """Every orientation and every camera constant, to the last digit."""
    assert list(one.photos) == list(other.photos)
    for name, photo in one.photos.items():
        same = other.photos[name]
        np.testing.assert_array_equal(photo.exterior.centre, same.exterior.centre)
        for angle in ("omega", "phi", "kappa"):
            assert getattr(photo.exterior, angle) == getattr(same.exterior, angle)
        assert photo.oriented == same.oriented
    for name, camera in one.cameras.items():
        same = other.cameras[name]
        for constant in dataclasses.fields(camera):
            np.testing.assert_equal(getattr(camera, constant.name), getattr(same, constant.name))


def wrong_control(block: Block, rng: np.random.Generator) -> Block:
    """A tenth of the control is wrong, and half of it salient: all gross error rules have work."""
    surveyed = {
        name: replace(
            point,
            source="salient" if number % 2 else "junction",
            position=point.position + (rng.normal(size=3) * 20 if number % 10 == 0 else 0.0),
        )
        for number, (name, point) in enumerate(block.surveyed.items())
    }
    return replace(block, surveyed=surveyed)


@settings(max_examples=6, phases=[Phase.explicit, Phase.generate])
@given(seed=st.integers(0, 10_000), chosen=OPTIONS)
def test_no_orientation_depends_on_check_points__law(seed, chosen):
    options = AdjustmentOptions(**chosen)
    rng = np.random.default_rng(seed)
    plain = wrong_control(fly(PLAN, rng).block, rng)
    mixed = with_strangers(plain, rng)
    assert_same(plain, without_checks(mixed))
    one, other = (adjusted_without_gross(block, options) for block in (plain, mixed))
    assert_same(one.block, other.block)
    assert one.sigma_nought == other.sigma_nought
    assert one.rejected == other.rejected
    assert one.redundancy_numbers == other.redundancy_numbers
    np.testing.assert_array_equal(one.tie_sigmas_m, other.tie_sigmas_m)
    if options.per_photo:  # the engine's own passes never are
        return
    (one, told), (other, told_too) = (with_true_worth(r, options) for r in (one, other))
    assert_same(one.block, other.block)
    assert [doubt.evidence for doubt in told] == [doubt.evidence for doubt in told_too]


@pytest.mark.parametrize("seed", range(3))
def test_what_is_looked_at_first_does_not_depend_on_check_points__law(seed):
    rng = np.random.default_rng(seed)
    plain = wrong_control(fly(PLAN, rng).block, rng)
    blocks = plain, with_strangers(plain, rng)
    ahead = [
        influence_of(adjusted_without_gross(block, AdjustmentOptions()), AdjustmentOptions())
        for block in blocks
    ]
    gains = [expected_gains(one) for one in ahead]
    assert list(gains[0]) == list(gains[1])
    assert [gain.expected_m for gain in gains[0].values()] == [
        gain.expected_m for gain in gains[1].values()
    ]
    wanted, wanted_too = (wanted_control(one) for one in ahead)
    assert len(wanted) == len(wanted_too) > 0
    for want, other in zip(wanted, wanted_too, strict=True):
        np.testing.assert_array_equal(want.position, other.position)


def test_a_check_point_with_the_name_of_a_proposal_does_not_take_its_place__law():
    flight = fly(PLAN, np.random.default_rng(0))
    block = replace(flight.block, surveyed={}, measurements={})
    listed = list(flight.block.surveyed.values())
    points = ReferencePoints(
        tuple(point.point_id for point in listed),
        np.array([point.position for point in listed]),
        np.array([point.sigma_m for point in listed]),
    )
    sources = dict.fromkeys(points.ids, "junction")
    proposed = tuple(flight.block.measurements.values())
    taken = listed[7].point_id
    mine = SurveyedPoint(taken, listed[0].position, np.full(3, 0.01), "check", "surveyed")
    plain = with_proposals(block, surveyed_of(points, sources), proposed)
    mixed = with_proposals(
        replace(block, surveyed={taken: mine}), surveyed_of(points, sources), proposed
    )
    assert mixed.surveyed[taken] is mine
    assert not [key for key in mixed.measurements if key[0] == taken]
    assert mixed.surveyed[taken + PROPOSED].role == "control"
    again = with_proposals(mixed, surveyed_of(points, sources), proposed)
    for one in (mixed, again):
        assert_same(
            adjusted_without_gross(plain, AdjustmentOptions()).block,
            adjusted_without_gross(one, AdjustmentOptions()).block,
        )
