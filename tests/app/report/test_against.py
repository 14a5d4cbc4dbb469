"""Two states of a block side by side: what was changed is told, and nothing else."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.report.against import against_told, compare_states, read_earlier
from app.report.model import gather
from app.report.page import write_report
from core.errors import PhotogrammetryError
from sessions.decisions import Accept, Recorded, Remark, Withdraw
from ui.words.catalogue import LANGUAGES, Teller

SHIFT_M = np.array([0.3, -0.4, 1.2])
TURN_DEG = 0.01


@pytest.fixture(scope="module")
def moved(content):
    """The block with one photo 0.5 m off in plan, 1.2 m in height and turned by 36 seconds."""
    report = content.report
    name, photo = next(iter(report.block.photos.items()))
    exterior = replace(
        photo.exterior,
        centre=photo.exterior.centre + SHIFT_M,
        kappa=photo.exterior.kappa + np.radians(TURN_DEG),
    )
    photos = {**report.block.photos, name: replace(photo, exterior=exterior)}
    changed = replace(report, block=replace(report.block, photos=photos), sigma_nought=1.5)
    back = Recorded(9, "2025-11-22T08:00:00", "eva", Withdraw(1))
    fault = Remark("place", "", "double road", (1.0, 2.0), "double")
    more = [back, Recorded(10, "2025-11-22T08:01:00", "eva", fault)]
    return name, replace(content, report=changed, decisions=[*content.decisions, *more])


def test_a_state_compared_with_itself_does_not_differ__law(content):
    figures = gather(content)
    found = compare_states(figures, json.loads(json.dumps(figures)))
    assert [found[name] for name in ("figures", "rules", "photos", "points", "decisions")] == [
        []
    ] * 5
    told = against_told(found, Teller())
    assert told == "Nothing differs from kobyli-1938 <script>, 2025-11-21 01:02 UTC"


def test_what_was_changed_is_told_and_nothing_else__truth(content, moved):
    name, later = moved
    found = compare_states(gather(later), gather(content))
    (photo,) = found["photos"]
    assert photo["scan"] == name
    assert photo["shift_m"] == pytest.approx(SHIFT_M)
    assert (photo["plan_m"], photo["height_m"]) == pytest.approx((0.5, 1.2))
    assert photo["turn_arcsec"] == pytest.approx(3600 * TURN_DEG, rel=1e-6)
    sigmas = content.report.exterior_sigmas[name]
    assert photo["plan_sigmas"] == pytest.approx(np.hypot(*(SHIFT_M[:2] / sigmas.centre_m[:2])))
    assert photo["height_sigmas"] == pytest.approx(1.2 / sigmas.centre_m[2])
    assert photo["turn_sigmas"] == pytest.approx(np.radians(TURN_DEG) / sigmas.angles[2])
    figures = {row["name"]: row for row in found["figures"]}
    assert figures["sigma"]["after"] == 1.5
    assert figures["faults"]["difference"] == 1
    assert "oriented" not in figures
    rules = {row["rule"]: (row["before"], row["after"]) for row in found["rules"]}
    assert rules["faults"] == (None, 1)
    assert rules["sigma"][1] == 1
    changes = {(row["against"], row["decision"], row["number"]) for row in found["decisions"]}
    assert changes == {("withdrawn", "Accept", 1), ("made", "Remark", 10)}
    # The other way about.
    back = compare_states(gather(content), gather(later))
    changes = {(row["against"], row["number"]) for row in back["decisions"]}
    assert changes == {("restored", 1), ("missing", 10)}


def test_points_that_changed_come_worst_first_those_of_one_state_before__truth(content):
    now = gather(content)
    earlier = json.loads(json.dumps(now))
    rows = earlier["control"]["in_use"]
    points = list(dict.fromkeys(row["point_id"] for row in rows))
    for row in rows:
        for number, point in enumerate(points[:2], start=1):
            if row["point_id"] == point:
                row["difference_m"][0] += 0.1 * number
    earlier["control"]["in_use"] = [row for row in rows if row["point_id"] != points[2]]
    found = compare_states(now, earlier)["points"]
    assert [row["point_id"] for row in found] == [points[2], points[1], points[0]]
    assert [row["change_m"] for row in found] == [None, pytest.approx(0.2), pytest.approx(0.1)]
    assert found[0]["before_m"] is None


def test_a_photo_that_lost_its_orientation_comes_first__truth(content, moved):
    _, later = moved
    earlier = gather(content)
    earlier["exterior"][-1]["oriented"] = False
    found = compare_states(gather(later), earlier)["photos"]
    assert [row["oriented_before"] for row in found] == [False, True]
    assert found[0]["plan_m"] is None


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_chapter_stands_in_the_page_only_where_states_are_compared__law(
    content, moved, language, tmp_path
):
    _, later = moved
    html, _ = write_report(tmp_path, replace(content, language=language))
    assert 'id="against"' not in html.read_text(encoding="utf-8")
    earlier = read_earlier(tmp_path / "report.json", list(content.report.block.photos))
    html, told = write_report(tmp_path, replace(later, language=language, against=earlier))
    page, tell = html.read_text(encoding="utf-8"), Teller(language)
    assert 'id="against"' in page
    for name in ("figures", "rules", "photos", "decisions"):
        assert tell(f"report.against.{name}") in page
    assert json.loads(told.read_text(encoding="utf-8"))["against"]["photos"]
    html, _ = write_report(tmp_path, replace(content, language=language, against=earlier))
    assert tell("report.against.figures") not in html.read_text(encoding="utf-8")


def test_what_is_no_earlier_state_is_told_with_file_cause_and_remedy__law(content, tmp_path):
    write_report(tmp_path, content)
    report, scans = tmp_path / "report.json", list(content.report.block.photos)
    whole = json.loads(report.read_text(encoding="utf-8"))

    def refused(path, content=None, scans=scans):
        if content is not None:
            path.write_text(content, encoding="utf-8")
        with pytest.raises(PhotogrammetryError) as caught:
            read_earlier(path, scans)
        assert caught.value.file == str(path)
        return caught.value.told

    assert "does not exist" in refused(tmp_path / "nothing.json")
    assert "has no report" in refused(tmp_path)
    other = tmp_path / "other.json"
    for text in ("<html>", "[1]", "{}", '"a"'):
        assert "is no report" in refused(other, text)
    old = {**whole, "decisions": {"log": [{"number": 1, "about": ""}]}}
    assert "earlier version: it lacks decision, after" in refused(other, json.dumps(old))
    old = {name: part for name, part in whole.items() if name != "checked"}
    assert "lacks checked" in refused(other, json.dumps(old))
    for part, damaged in (
        ("decisions", "abc"),
        ("exterior", [{}]),
        ("control", []),
        ("checked", {**whole["checked"], "figures": "x"}),
    ):
        assert "report" in refused(other, json.dumps({**whole, part: damaged}))
    assert "another block" in refused(report, scans=["00999"])
    # A copy of the block's folder is as good as its report.
    (tmp_path / "results").mkdir()
    report.rename(tmp_path / "results" / "report.json")
    assert read_earlier(tmp_path, scans) == whole


def test_decisions_taken_in_the_same_minute_are_told_apart__law(content):
    keys = list(content.report.residuals_px)[3:5]
    made = [Recorded(20 + n, "2025-11-22T09:00:00", "eva", Accept(*k)) for n, k in enumerate(keys)]
    now = gather(replace(content, decisions=[*content.decisions, *made]))
    found = compare_states(now, gather(replace(content, decisions=[*content.decisions, made[0]])))
    assert [row["number"] for row in found["decisions"]] == [21]
