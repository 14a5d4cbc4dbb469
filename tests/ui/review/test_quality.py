"""Quality of a block: what is put in is what is found."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from core.quality.assessment import assess_block
from core.quality.rules import POOR, judge_block
from tests.ui.desk_block import (
    FLYING_HEIGHT_M,
    FRAME_MM,
    adjust,
    outlines,
    tiny_block,
    tiny_snapshot,
)
from ui.review.compare import made_with
from ui.review.judgement import footprint_polygons, judge_desk
from ui.review.quality import quality_part
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState
from ui.words.catalogue import words


@pytest.fixture(scope="module")
def state() -> DeskState:
    report = adjust(tiny_block().block)
    return DeskState(tiny_block().block, report, made=made_with(report.block))


@pytest.fixture(scope="module")
def desk() -> DeskSnapshot:
    desk = tiny_snapshot()
    return replace(desk, outlines=outlines(desk.state))


@pytest.fixture(scope="module")
def polygons(state) -> dict[str, shapely.Polygon]:
    return footprint_polygons(state, outlines(state))


def test_overlaps_are_those_the_flight_was_given__truth(state, polygons):
    found = assess_block(state.report, polygons)
    side = FRAME_MM / 210.0 * FLYING_HEIGHT_M
    along = [p.share for p in found.overlaps if p.along and p.share > 0.5]
    assert np.median(along) == pytest.approx(1 - 500 / side, abs=0.05)
    across = [max(p.share for p in found.overlaps if p.along is False)]
    assert across[0] == pytest.approx(1 - 640 / side, abs=0.06)


def test_tilt_is_that_of_the_orientation__law(state, polygons):
    for photo in assess_block(state.report, polygons).photos:
        exterior = state.report.block.photos[photo.photo_id].exterior
        small = np.degrees(np.hypot(exterior.omega, exterior.phi))
        assert photo.tilt_deg == pytest.approx(small, abs=0.02)
        assert 0 <= photo.crab_deg <= 45


def test_counts_are_complete__law(state, polygons):
    found, report = assess_block(state.report, polygons), state.report
    used = np.isfinite(report.tie_residuals_px).all(axis=1)
    assert sum(photo.ties for photo in found.photos) == used.sum()
    assert sum(rays * count for rays, count in found.rays.items()) == used.sum()
    assert found.control_cells.sum() == len(report.surveyed_positions)
    assert sum(sum(photo.cells) for photo in found.photos) == found.pattern_counts.sum()


def test_the_verdict_names_what_is_missing__truth(state, polygons):
    report = state.report
    findings = judge_block(assess_block(report, polygons), report)
    grave = {finding.kind: finding.grave for finding in findings}
    assert grave["sigma-far"] == 2
    bare = replace(report, surveyed_positions={}, checks=())
    worse = {finding.kind for finding in judge_block(assess_block(bare, polygons), bare)}
    assert "control-few" in worse
    assert judge_block(assess_block(bare, polygons), bare)[0].grave == 2


def test_the_sheet_begins_with_what_was_accepted_against_the_block__truth(desk):
    """The report said that the desk's own verdict was sound."""
    block = desk.state.block
    key = next(k for k, item in block.measurements.items() if item.status == "auto")
    item = block.measurements[key]
    wrong = replace(item, column=item.column + 30, sigma_px=0.5, status="accepted")
    block = block.with_measurement(wrong)
    state = replace(desk.state, block=block, report=adjust(block))
    part = quality_part(judge_desk(replace(desk, state=state)), state, ())
    text, grave, values = part["findings"][0]
    assert (text, grave) == ("verdict.contradicted-far", part["verdict"])
    assert (values["worst"], values["photo"]) == key
    assert part["verdict"] == 2


def test_no_limit_is_broken_beside_the_verdict__law(desk):
    """Position on the ground was a rule of its own, and a broken one left the verdict sound."""
    judged = judge_desk(desk)
    assert "position" in {one.rule.name for one in judged.rules if one.finding.grave == POOR}
    assert all(one.finding in judged.findings for one in judged.rules)


def test_every_sentence_of_the_view_has_words__law(desk):
    part = quality_part(judge_desk(desk), desk.state, ())
    for text, grave, values in part["findings"]:
        assert words()[text].format(**values)
        assert f"grave.{grave}" in words()
