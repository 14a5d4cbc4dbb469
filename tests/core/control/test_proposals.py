"""Control proposals: which of them the block believes."""

from dataclasses import replace

import numpy as np
import pytest

from core.block import Block, Measurement, Peak, Source, SurveyedPoint
from core.control.proposals import (
    ACCEPT,
    judge_searches,
    measurement_of,
    surveyed_of,
    with_proposals,
)
from core.control.search import Chance, Search
from core.reference.stage import ReferencePoints

PIXEL_M = 0.5
IN_PLACE = np.zeros(2)
SOURCES: dict[str, Source] = {
    **{f"J{i}": "junction" for i in range(40)},
    **{f"S{i}": "salient" for i in range(10)},
}


def search(*peaks, roads=True, point_id="J1") -> Search:
    """A search whose candidates lie so many metres away and stand so high."""
    away = np.array([peak[0] for peak in peaks], dtype=np.float64)
    return Search(
        point_id,
        "A",
        roads,
        (500.0, 400.0),
        tuple(Peak(500.0 + a, 400.0, 0.4, h, "fused") for a, h in peaks),
        away,
        np.full(len(peaks), 0.6),
        Chance(tuple(np.random.default_rng(0).exponential(0.6, 40) + 0.8), 900.0, 0.0, 0.05),
        PIXEL_M,
    )


def test_the_probable_candidate_is_used_though_another_is_higher__law():
    found = measurement_of(search((5.0, 6.0), (0.2, 5.0)), np.array([0.02, 0.97]), IN_PLACE)
    assert (found.status, found.reason, found.score) == ("auto", "", 0.97)
    assert found.column == 500.2
    assert [peak.score for peak in found.peaks] == [5.0, 6.0]


def test_where_none_is_probable_the_highest_is_shown_and_not_used__law():
    found = measurement_of(search((5.0, 6.0), (0.2, 5.0)), np.array([0.02, 0.45]), IN_PLACE)
    assert found.status == "unused"
    assert found.reason == "right with probability 0.02"
    assert found.column == 505.0


def test_what_stands_aside_is_stated_with_the_spread_of_such_objects__law():
    """Half probable to stand aside, by a metre per axis: a variance of half a square metre more."""
    one = search((2.4, 6.0))
    found = measurement_of(one, np.array([1.0]), np.array([0.5]))
    assert found.sigma_px == pytest.approx(np.hypot(0.4, np.sqrt(0.5) / PIXEL_M))
    assert measurement_of(one, np.array([1.0]), np.zeros(1)).sigma_px == 0.4


def test_what_a_candidate_counts_for_grows_from_nearly_nothing_with_its_probability__law():
    """No candidate that crosses the threshold moves the block all at once."""
    one = search((2.4, 6.0))
    weights = [
        (0.4 / measurement_of(one, np.array([right]), np.zeros(1)).sigma_px) ** 2
        for right in np.linspace(ACCEPT, 1.0, 50)
    ]
    assert weights[0] == pytest.approx(0.05)
    assert weights[-1] == pytest.approx(1.0)
    assert (np.diff(weights) >= -1e-9).all()
    assert np.diff(weights).max() < 0.03


def test_a_junction_aside_is_believed_and_a_salient_point_there_is_not__truth():
    """High peaks 2.3 m off, 3.8 of their stated deviations: the map may err, the ortho not."""
    rng = np.random.default_rng(4)
    usual = [
        search((float(abs(rng.normal(0, 0.5))), rng.normal(5.0, 0.5)), point_id=f"{kind}{i}")
        for kind in "JS"
        for i in range(10)
    ]
    aside = [search((2.3, 5.5), point_id="J30"), search((2.3, 5.5), point_id="S9")]
    measured, _ = judge_searches((*usual, *aside), SOURCES)
    found = {value.point_id: value for value in measured[-2:]}
    assert found["J30"].used
    assert not found["S9"].used
    assert found["J30"].sigma_px * PIXEL_M > 0.7


def test_clear_points_are_believed_and_stray_ones_are_not__truth():
    """Forty points found where they should be, ten whose best peak is chance."""
    rng = np.random.default_rng(1)
    right = [
        search((float(abs(rng.normal(0, 0.5))), rng.normal(4.0, 0.5)), point_id=f"J{i}")
        for i in range(40)
    ]
    stray = [search((float(rng.uniform(3, 6)), 1.3), point_id=f"S{i}") for i in range(10)]
    measured, resting = judge_searches((*right, *stray), SOURCES)
    used = {value.point_id for value in measured if value.used}
    assert len(used & {one.point_id for one in right}) >= 38
    assert not used & {one.point_id for one in stray}
    assert set(resting) == {("junction", True), ("salient", True)}
    assert all(one is not None for one in resting.values())


def test_a_search_without_any_candidate_is_no_measurement__law():
    assert judge_searches((search(),), SOURCES)[0] == ()
    assert judge_searches((), SOURCES)[0] == ()


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
    now = with_proposals(block, surveyed_of(points, sources), proposed)
    assert set(now.surveyed) == {"J1", "S2", "GCP"}  # J3 was found in no photo
    assert list(now.measurements) == [("GCP", name), ("J1", name), ("S2", other)]
    assert now.measurements[("GCP", name)].status == "accepted"
    assert now.surveyed["S2"].source == "salient"
    assert (
        with_proposals(now, surveyed_of(points, sources), proposed).measurements == now.measurements
    )


def test_reference_points_become_control_with_their_accuracy__law():
    points = ReferencePoints(("J1",), np.array([[1.0, 2, 3]]), np.array([[0.3, 0.4, 0.9]]))
    point = surveyed_of(points, {"J1": "junction"})["J1"]
    assert (point.role, point.source) == ("control", "junction")
    np.testing.assert_array_equal(point.sigma_m, [0.3, 0.4, 0.9])
    assert replace(point, role="check").role == "check"
