"""One judgement of a block: what is wrong with it is found, and keeps it from being released."""

from dataclasses import replace
from string import Formatter

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions, Contradiction
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.block import TiePoints
from core.quality.assessment import assess_block
from core.quality.controllability import unchecked_control
from core.quality.job_rules import USUAL_RULES
from core.quality.judged_rules import judge_rules
from core.quality.residuals import displacement
from core.quality.rules import (
    HOLDING_BACK,
    NAMED,
    SENTENCES,
    Finding,
    check_release,
    doubts_of,
    human_doubts,
    human_findings,
    judge_block,
)
from tests.flights import FlightPlan, fly

PLAIN = AdjustmentOptions(estimate_cameras=False)
PLAN = FlightPlan(ties=400, control=30, check=0, camera_errors=False)


@pytest.fixture(scope="module")
def flight():
    return fly(PLAN, np.random.default_rng(4))


def judged(block, ortho_sigma_m=0.0):
    report = adjust_block(block, PLAIN)
    return check_release(report, influence_of(report, PLAIN), ortho_sigma_m)


def kinds_of(found):
    return {finding.kind for finding in found.reasons}


def test_what_is_predicted_is_what_the_ground_is_off__truth():
    """Over several flights the predicted error is the true one."""
    ratios = []
    for seed in range(6):
        flight = fly(PLAN, np.random.default_rng(100 + seed))
        report = adjust_block(flight.block, PLAIN)
        off = [
            displacement(
                replace(report.block.photos[name], approximate=photo.exterior),
                flight.truth.cameras["wide"],
            ).rms_m
            for name, photo in flight.truth.photos.items()
        ]
        found = check_release(report, influence_of(report, PLAIN), 0.0)
        assert found.reasons == ()
        ratios.append(np.mean(np.square(off)) / found.predicted_m**2)
    assert 0.7 < np.sqrt(np.mean(ratios)) < 1.3


def test_an_inexact_reference_is_not_certified__truth(flight):
    fine, coarse = judged(flight.block, 0.25), judged(flight.block, 0.7)
    assert fine.reasons == ()
    assert kinds_of(coarse) == {"predicted"}
    assert coarse.predicted_m > coarse.limit_m == pytest.approx(0.8)
    assert fine.worst_photo in flight.block.photos
    assert fine.worst_m > fine.predicted_m
    # What is predicted relative to the reference does not hang on how good that is.
    assert fine.relative_m == coarse.relative_m
    assert fine.predicted_m**2 == pytest.approx(fine.relative_m**2 + 2 * 0.25**2)


def test_too_little_control_and_a_loose_photo_are_reasons__truth(flight):
    few = dict(sorted(flight.block.surveyed.items())[:2])
    measured = {k: v for k, v in flight.block.measurements.items() if k[0] in few}
    poor = judged(replace(flight.block, surveyed=few, measurements=measured))
    assert {"control-few", "predicted-alone"} <= kinds_of(poor)
    first = next(iter(flight.block.photos))
    photos = {n: replace(p, oriented=n != first) for n, p in flight.block.photos.items()}
    assert kinds_of(judged(flight.block.with_photos(photos))) == {"loose"}


def test_nothing_adjusted_is_not_certified__law(flight):
    photos = {n: replace(p, oriented=False) for n, p in flight.block.photos.items()}
    nothing = judged(flight.block.with_photos(photos))
    assert {"loose", "control-few", "predicted-unknown"} <= kinds_of(nothing)
    assert np.isnan(nothing.predicted_m)


BLOCK_PLAN = FlightPlan(ties=300, control=30, check=0)


@pytest.fixture(scope="module")
def block():
    return fly(BLOCK_PLAN, np.random.default_rng(4)).block


@pytest.fixture(scope="module")
def dense():
    """Many control points to choose from, and strips long enough for photos that do not overlap."""
    plan = replace(BLOCK_PLAN, photos_per_strip=4, control=400)
    return fly(plan, np.random.default_rng(4)).block


def kinds(report):
    return {doubt.kind for doubt in doubts_of(report)}


def finding(report, kind):
    found = judge_block(assess_block(report), report)
    return next(finding for finding in found if finding.kind == kind)


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


def test_every_sentence_can_be_said_and_every_limit_is_used_once__law():
    for kind, sentence in SENTENCES.items():
        names = [name for _, name, _, _ in Formatter().parse(sentence) if name]
        said = Finding(kind, 1, dict.fromkeys(names, "1")).sentence
        assert "{" not in said
        assert said.endswith(".")
    assert set(HOLDING_BACK) <= set(SENTENCES)


@pytest.mark.parametrize(("seed", "metres"), [(1, 3.0), (2, 8.0), (3, 18.0)])
def test_what_a_human_accepted_against_the_block_is_the_first_finding__truth(seed, metres):
    """An 18 m blunder accepted by hand left the verdict as it was, word for word."""
    flown = fly(BLOCK_PLAN, np.random.default_rng(seed)).block
    key = sorted(flown.measurements)[7 * seed]
    item, photo = flown.measurements[key], flown.photos[key[1]]
    off = metres / photo.ground_pixel_m(flown.camera_of(key[1]))
    wrong = replace(item, column=item.column + off, sigma_px=0.5, status="accepted")
    report = adjust_block(flown.with_measurement(wrong))
    told, *_ = judge_block(assess_block(report), report)
    assert told.kind.startswith("contradicted")
    assert (told.values["worst"], told.values["photo"]) == key
    assert float(told.values["metres"]) == pytest.approx(metres, abs=1.5)
    assert f"{told.values['metres']} m ({told.values['pixels']} px)" in told.sentence
    assert told.grave == 2
    release = check_release(report, influence_of(report, AdjustmentOptions()), 0.0)
    assert "contradicted-far" in kinds_of(release)
    good = adjust_block(flown.with_measurement(replace(item, status="accepted")))
    assert finding(good, "agreed").values["count"] == "1"


def test_so_many_disagreements_are_named_and_the_rest_counted__law(block):
    report = adjust_block(block)
    key = next(iter(report.redundancy_numbers))
    many = tuple(
        Contradiction(*key, pixels=20.0, metres=0.5, test=30.0 - number, shift_m=0.1)
        for number in range(NAMED + 3)
    )
    report = replace(report, contradictions=many)
    found = judge_block(assess_block(report), report)
    assert [one.kind for one in found].count("contradicted") == NAMED
    assert finding(report, "contradicted-more").values["count"] == "3"
    # The rule of the job tells the worst, and how many more there are.
    against = next(one for one in judge_rules(found) if one.rule.name == "against")
    assert (against.finding.kind, against.more) == ("contradicted", NAMED + 2)


def test_a_point_that_is_off_in_all_its_photos_is_one_finding__law(block):
    report = adjust_block(block)
    point = next(iter(report.redundancy_numbers))[0]
    off = [Contradiction(point, name, 20.0, 0.5, 5.0, 0.1) for name in ("a", "b", "c")]
    ray = Contradiction(point, "d", 18.0, 0.4, 4.0, 0.1)
    report = replace(report, contradictions=(*off, ray))
    told = [one for one in human_findings(report) if one.kind.startswith("contradicted")]
    assert [one.values["photo"] for one in told] == ["a, b, c", "d"]
    assert [one.subject for one in human_doubts(report)] == [point, point]
    against = next(one for one in judge_rules(told) if one.rule.name == "against")
    assert against.more == 3


def worse(report, times):
    """The same report with differences of its check points so many times as large."""
    checks = tuple(replace(c, difference_m=c.difference_m * times) for c in report.checks)
    return replace(report, checks=checks)


def test_only_independent_check_points_that_bear_it_out_certify__truth():
    """Thirty and more by the standard, and their differences within what chance explains."""
    flown = fly(replace(BLOCK_PLAN, check=45), np.random.default_rng(9)).block
    report = adjust_block(flown)
    ahead = influence_of(report, AdjustmentOptions())
    release = check_release(report, ahead, 0.0)
    assert release.reasons == ()
    assert release.certified
    few = replace(report, checks=report.checks[:20])
    assert not check_release(few, ahead, 0.0).certified
    off = worse(report, 2.0)
    assert finding(off, "checks-worse").grave == 1
    assert not check_release(off, ahead, 0.0).certified
    assert check_release(off, ahead, 0.0).reasons == ()
    far = worse(report, 20.0)
    assert [one.kind for one in check_release(far, ahead, 0.0).reasons] == ["checks-over"]
    assert finding(worse(report, 0.2), "checks-better").grave == 0


def test_proposals_kept_out_bear_nothing_out__law():
    flown = fly(replace(BLOCK_PLAN, check=45), np.random.default_rng(9)).block
    proposals = {
        name: replace(point, source="salient") if point.role == "check" else point
        for name, point in flown.surveyed.items()
    }
    report = adjust_block(replace(flown, surveyed=proposals))
    assert finding(report, "no-checks").grave == 1
    assert finding(report, "kept-out").values["count"] == str(len(report.checks))
    release = check_release(report, influence_of(report, AdjustmentOptions()), 0.0)
    assert not release.certified


@pytest.mark.parametrize(
    ("count", "kind"), [(0, "no-checks"), (1, "one-check"), (2, "checks-few"), (29, "checks-few")]
)
def test_few_check_points_are_too_few_to_judge__truth(count, kind):
    flown = fly(replace(BLOCK_PLAN, check=45), np.random.default_rng(9)).block
    report = adjust_block(flown)
    few = finding(replace(report, checks=report.checks[:count]), kind)
    assert few.grave == 1
    assert few.values["least"] == str(USUAL_RULES.check_points)
    assert finding(report, "checks").grave == 0


def test_a_sound_block_has_no_grave_finding__truth(block):
    report = adjust_block(block)
    found = judge_block(assess_block(report), report)
    assert max(finding.grave for finding in found) < 2
    assert {"sigma", "control", "no-pattern"} <= {finding.kind for finding in found}
    assert kinds(report) == {finding.kind for finding in found if finding.grave}


def test_one_photo_stands_alone__truth(block):
    report = adjust_block(with_photos(block, {"00_000"}))
    assert finding(report, "one-photo").grave == 1


def test_two_photos_without_overlap_are_bound_by_nothing__truth(dense):
    report = adjust_block(with_photos(dense, {"00_000", "00_003"}))
    assert finding(report, "no-ties").grave == 2


def test_two_blocks_without_connection__truth(block):
    ties = block.ties
    strip = np.array([name.startswith("01") for name in ties.photo_ids])[ties.photo]
    split = replace(ties, point=np.where(strip, ties.point + ties.count, ties.point))
    found = finding(adjust_block(replace(block, ties=split)), "in-parts")
    assert found.values["photos"] == "3"
    assert int(found.values["points"]) > 3
    assert found.grave == 1
    # Without control of its own the second part hangs on its approximate place alone.
    bare = {k: m for k, m in block.measurements.items() if not k[1].startswith("01")}
    alone = adjust_block(replace(block, ties=split, measurements=bare))
    assert finding(alone, "in-parts").grave == 2


def test_all_control_on_a_line__truth(dense):
    north = np.median([point.position[1] for point in dense.surveyed.values()])
    line = with_control_in(dense, lambda position: abs(position[1] - north) < 60)
    found = finding(adjust_block(line), "control-on-a-line")
    assert float(found.values["along"]) > 5 * float(found.values["across"])
    assert found.grave == 2


def test_all_control_in_one_corner__truth(block, dense):
    places = np.array([point.position for point in dense.surveyed.values()])
    corner = places.min(axis=0) + 0.35 * np.ptp(places, axis=0)
    near = with_control_in(dense, lambda position: (position[:2] < corner[:2]).all())
    assert "control-gaps" in kinds(adjust_block(near))
    assert "control-gaps" not in kinds(adjust_block(block))


def test_no_control_and_too_little_are_one_finding__truth(block):
    none = adjust_block(replace(block, measurements={}))
    assert finding(none, "control-few").grave == 2
    two = sorted({key[0] for key in block.measurements})[:2]
    few = {key: m for key, m in block.measurements.items() if key[0] in two}
    report = adjust_block(replace(block, measurements=few))
    assert finding(report, "control-few").values["count"] == "2"
    found = check_release(report, influence_of(report, AdjustmentOptions()), 0.0)
    assert finding(report, "control-few") in found.reasons


def test_uncheckable_control_is_named__truth(block):
    """One photo and three known points: nothing is left over to check them."""
    one = with_photos(block, {"00_000"})
    loose = replace(
        one.photos["00_000"].prior, sigma_centre_m=np.full(3, 1e4), sigma_angles=np.full(3, 10.0)
    )
    photo = replace(one.photos["00_000"], prior=loose)
    names = sorted({key[0] for key in one.measurements})[:4]
    four = {key: m for key, m in one.measurements.items() if key[0] in names}
    unknown = replace(one.surveyed[names[0]], sigma_m=np.full(3, 1e4))
    report = adjust_block(
        replace(
            one,
            photos={"00_000": photo},
            surveyed={**one.surveyed, names[0]: unknown},
            measurements=four,
            ties=TiePoints.none(),
        ),
        PLAIN,
    )
    weak = unchecked_control(report)
    assert int(finding(report, "unchecked").values["count"]) == len(weak) > 0


def test_a_class_that_is_worse_than_stated_is_told__truth():
    flight = fly(replace(BLOCK_PLAN, ties=600, tie_sigma_px=1.5), np.random.default_rng(3))
    ties = flight.block.ties
    block = replace(flight.block, ties=replace(ties, sigma_px=ties.sigma_px / 3))
    report = adjust_block(block, AdjustmentOptions(robust=False))
    found = finding(report, "class-large")
    assert found.values["worst"] == "tie points in the photos"
    assert float(found.values["ratio"]) == pytest.approx(3.0, rel=0.1)
