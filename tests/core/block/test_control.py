"""Control proposals: which of them the block believes."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.block import Block, Measurement, Peak, SurveyedPoint
from core.block.control import (
    CLEAR,
    ControlOptions,
    judged,
    likeness,
    measurements_of,
    surveyed_of,
    with_proposals,
)
from core.block.matching import Found
from core.block.orientation import OrientationOptions, ReferencePoints
from core.block.patches import object_on_ground

OPTIONS = ControlOptions()
PREDICTED = np.array([[500.0, 400.0]])
GROUND_SIGMA_PX = np.array([0.6])


def peak(away_px, sigma=0.5, score=9.0, operator="gradient+ncc") -> Peak:
    return Peak(500.0 + 0.6 * away_px, 400.0 + 0.8 * away_px, sigma, score, operator)


def said(tiny, *peaks) -> Measurement:
    return judged(
        tiny.opened(tiny.names[0]),
        "J1",
        Found(0, peaks, 400.0),
        PREDICTED,
        GROUND_SIGMA_PX,
        1,
        OPTIONS,
    )


def test_within_the_gate_it_is_used_beyond_it_is_not__law(tiny):
    limit = OPTIONS.gate * np.sqrt(2) * np.hypot(0.5, 0.6)
    inside, outside = said(tiny, peak(0.99 * limit)), said(tiny, peak(1.01 * limit))
    assert (inside.status, inside.reason) == ("auto", "")
    assert outside.status == "unused"
    metres = 1.01 * limit * tiny.opened(tiny.names[0]).ground_pixel_m
    assert outside.reason == f"{metres:.1f} m from where the block expects it"


def test_only_the_best_peak_may_agree__law(tiny):
    """With several to choose from, chance would agree too often."""
    found = said(tiny, peak(12.0, score=9.0), peak(0.0, score=8.0))
    assert found.status == "unused"
    assert (found.column, found.row) == (peak(12.0).column, peak(12.0).row)
    assert len(found.peaks) == 2


def test_a_peak_no_higher_than_others_is_no_evidence__law(tiny):
    found = said(tiny, peak(0.0, score=CLEAR - 2))
    assert (found.status, found.reason) == ("unused", "not alike enough")


def test_no_match_claims_to_be_better_than_its_pass_allows__law(tiny):
    found = judged(
        tiny.opened(tiny.names[0]),
        "J1",
        Found(0, (peak(0.0, sigma=0.01),), 400.0),
        PREDICTED,
        GROUND_SIGMA_PX,
        3,
        OPTIONS,
    )
    assert found.sigma_px == pytest.approx(0.35 * 3)


def test_likeness_rises_with_the_peak_and_grey_values_alone_count_half__law():
    scores = [likeness(peak(0.0, score=score)) for score in (0.0, 3.0, CLEAR, 6.0, 20.0)]
    assert scores == sorted(scores)
    assert scores[2] == pytest.approx(0.5)
    assert 0 < scores[0] < scores[-1] < 1
    assert likeness(peak(0.0, operator="ncc")) == pytest.approx(
        likeness(peak(0.0, operator="gradient")) / 2
    )


def test_at_the_truth_unchanged_ground_is_used_and_right__truth(tiny):
    name = tiny.names[0]
    photo = tiny.photos[name]
    share = np.stack(np.meshgrid(*[np.linspace(0.25, 0.75, 5)] * 2), axis=-1).reshape(-1, 2)
    pixels = share * np.array(photo.size_px)
    ground = object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)
    points = ReferencePoints(
        tuple(f"P{i:02d}" for i in range(25)), ground, np.full(ground.shape, 0.3)
    )
    found = measurements_of(
        tiny.opened(name),
        tiny.archival(),
        points,
        OrientationOptions(template_half_px=30),
        ControlOptions(search_m=10.0),
    )
    used = [value for value in found if value.used]
    assert len(used) >= 22
    away = [np.hypot(*(value.pixel[0] - pixels[int(value.point_id[1:])])) for value in used]
    assert np.mean(np.array(away) < 1.0) > 0.9
    assert all(value.photo_id == name and value.peaks for value in found)


def surveyed(name, source="junction") -> SurveyedPoint:
    return SurveyedPoint(name, np.array([1.0, 2, 3]), np.full(3, 0.1), "control", source)


def test_new_proposals_replace_the_old_and_leave_the_user_s_points__law(tiny):
    points = ReferencePoints(("J1", "S2", "J3"), np.arange(9.0).reshape(3, 3), np.full((3, 3), 0.4))
    sources = {"J1": "junction", "S2": "salient", "J3": "junction"}
    name, other = tiny.names[:2]
    block = Block(
        tiny.block.crs,
        tiny.block.cameras,
        tiny.photos,
        {"OLD": surveyed("OLD"), "GCP": surveyed("GCP", "surveyed")},
        {
            ("OLD", name): Measurement("OLD", name, 1.0, 1.0, 1.0),
            ("GCP", name): Measurement("GCP", name, 2.0, 2.0, 1.0, status="accepted"),
        },
    )
    proposed = (
        Measurement("S2", other, 5.0, 5.0, 1.0),
        Measurement("J1", name, 4.0, 4.0, 1.0, status="unused"),
    )
    now = with_proposals(block, points, sources, proposed)
    assert set(now.surveyed) == {"J1", "S2", "GCP"}  # J3 was found in no photo
    assert list(now.measurements) == [("GCP", name), ("J1", name), ("S2", other)]
    assert now.measurements[("GCP", name)].status == "accepted"
    assert now.surveyed["S2"].source == "salient"
    assert with_proposals(now, points, sources, proposed).measurements == now.measurements


def test_reference_points_become_control_with_their_accuracy__law():
    points = ReferencePoints(("J1",), np.array([[1.0, 2, 3]]), np.array([[0.3, 0.4, 0.9]]))
    point = surveyed_of(points, {"J1": "junction"})["J1"]
    assert (point.role, point.source) == ("control", "junction")
    np.testing.assert_array_equal(point.sigma_m, [0.3, 0.4, 0.9])
    assert replace(point, role="check").role == "check"
