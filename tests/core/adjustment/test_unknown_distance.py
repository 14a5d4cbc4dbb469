"""A principal distance that nobody stated is told by relief and ties, or said to be unknown."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport, SharedParameter
from core.adjustment.block_adjustment import adjust_block
from core.quality.assessment import assess_block
from core.quality.rules import judge_block
from tests.flights import Flight, FlightPlan, fly
from tests.forgotten_camera import forget_distance

PROPOSED = (210.01, 31.5)
"""The usual lens next to that of the flights, as `core.georeference.principal_distance` has it."""


def adjusted(relief_m: float, seed: int) -> tuple[Flight, AdjustmentReport, AdjustmentReport]:
    """The flight, its adjustment with the certificate, and without."""
    flight = fly(FlightPlan(relief_m=relief_m, check=40), np.random.default_rng(seed))
    forgotten = forget_distance(flight.block, *PROPOSED)
    return flight, adjust_block(flight.block), adjust_block(forgotten)


def distance_of(report: AdjustmentReport) -> tuple[float, SharedParameter]:
    """What was estimated, with its standard deviation."""
    told = next(one for one in report.parameters if one.name == "principal_distance_mm")
    (camera,) = report.block.cameras.values()
    return camera.principal_distance_mm, told


def verdict_on(report: AdjustmentReport) -> list[str]:
    kinds = [finding.kind for finding in judge_block(assess_block(report), report)]
    return [kind for kind in kinds if kind.startswith("distance")]


def off_m(report: AdjustmentReport) -> float:
    return float(
        np.sqrt(np.mean([np.sum(np.square(check.difference_m[:2])) for check in report.checks]))
    )


@pytest.mark.parametrize("relief_m", [60.0, 200.0])
def test_relief_tells_the_distance_as_well_as_it_says__truth(relief_m: float) -> None:
    ratios: list[float] = []
    for seed in range(4):
        flight, known, unknown = adjusted(relief_m, 40 + seed)
        true = flight.truth.cameras["wide"].principal_distance_mm
        distance, told = distance_of(unknown)
        # design: three standard deviations of four seeds; one in a hundred would miss by chance.
        assert abs(distance - true) < 3 * told.sigma
        assert told.sigma < 0.02 * true
        assert off_m(unknown) < 1.3 * off_m(known)
        ratios.append(told.sigma)
    assert np.mean(ratios) < (1.1 if relief_m > 100 else 3.0)


def test_level_ground_exchanges_it_for_the_flying_height_and_that_is_said__truth() -> None:
    for seed in range(4):
        _, _, unknown = adjusted(0.0, 50 + seed)
        _, told = distance_of(unknown)
        assert told.partner == "flying height"
        assert abs(told.correlation) > 0.99
        assert verdict_on(unknown) == ["distance-unknown"]


def test_high_relief_is_no_doubt__truth() -> None:
    _, known, unknown = adjusted(200.0, 60)
    assert verdict_on(unknown) == ["distance"]
    assert verdict_on(known) == []


def test_what_a_type_tells_holds_over_level_ground__truth() -> None:
    flight = fly(FlightPlan(relief_m=0.0), np.random.default_rng(70))
    report = adjust_block(forget_distance(flight.block, 211.5, 0.5))
    distance, told = distance_of(report)
    assert verdict_on(report) == ["distance"]
    assert told.sigma < 0.6
    assert abs(distance - 211.5) < 1.5


def test_known_flying_heights_tell_it_over_level_ground__truth() -> None:
    """Centres measured in flight leave nothing to exchange it for."""
    flight = fly(FlightPlan(relief_m=0.0, start_m=1.0), np.random.default_rng(71))
    block = forget_distance(flight.block, *PROPOSED, lifted=False)
    report = adjust_block(block, AdjustmentOptions())
    distance, told = distance_of(report)
    true = flight.truth.cameras["wide"].principal_distance_mm
    assert abs(distance - true) < 3 * told.sigma
    assert told.sigma < 0.1
    assert verdict_on(report) == ["distance"]


def test_heights_of_many_photos_do_not_speak_for_a_wrong_proposal__truth() -> None:
    """All follow from it alike: six photos are not six witnesses."""
    flight = fly(FlightPlan(relief_m=200.0), np.random.default_rng(72))
    report = adjust_block(forget_distance(flight.block, 152.67, 22.9))
    distance, told = distance_of(report)
    assert abs(distance - flight.truth.cameras["wide"].principal_distance_mm) < 3 * told.sigma


def test_a_block_that_was_bent_to_a_wrong_distance_finds_back__truth() -> None:
    """Principal point and lens have taken up what they could; full steps lead out of that."""
    flight = fly(FlightPlan(relief_m=60.0), np.random.default_rng(74))
    bent = adjust_block(forget_distance(flight.block, 270.0, 0.5)).block
    assert bent.cameras["wide"].principal_distance_mm > 260
    cameras = {
        name: replace(
            camera.at_distance(camera.principal_distance_mm, 45.0),
            certified=camera.certificate.at_distance(270.0, 45.0),
        )
        for name, camera in bent.cameras.items()
    }
    report = adjust_block(replace(bent, cameras=cameras))
    distance, told = distance_of(report)
    assert report.converged
    assert abs(distance - flight.truth.cameras["wide"].principal_distance_mm) < 3 * told.sigma


def test_a_certificate_is_held_as_before__law() -> None:
    flight = fly(FlightPlan(relief_m=60.0), np.random.default_rng(73))
    report = adjust_block(flight.block)
    camera = replace(report.block.cameras["wide"], certified=None)
    assert camera.sigma_principal_distance_mm == 0
    assert abs(camera.principal_distance_mm - 211.59) < 0.2
