"""The sample of map sheets at the desk: what is shown, what is said, and who is not told."""

from dataclasses import replace

import pytest
from shapely.geometry import box

from core.quality.check_plan import CheckPlace
from core.sheets.map_sheets import MapSheet
from sessions.checks import new_plan
from sessions.decisions import Decision, DrawSheets, JudgeSheet, ReadCheck, Recorded, Remark
from sessions.sheet_samples import lot_digest, new_sample
from tests.ui.desk_block import tiny_snapshot
from ui.review.check_gestures import SheetJudged
from ui.review.checking import decided_judgement, parts_now
from ui.review.judgement import judge_desk
from ui.review.pages import seat_mosaic, seat_quality
from ui.review.sheet_samples import sheets_part
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Notice, Seat

VERSION = "m1"
SHEETS = tuple(MapSheet(f"S{n:02d}", box(100 * n, 0, 100 * n + 100, 80)) for n in range(30))


@pytest.fixture(scope="module")
def sample() -> DrawSheets:
    return new_sample(SHEETS, 3)


def desk_after(*said: Decision) -> DeskSnapshot:
    recorded = [
        Recorded(n, f"2026-01-01T10:00:{n:02d}", "ada", one) for n, one in enumerate(said, 1)
    ]
    return replace(tiny_snapshot(), mosaic_version=VERSION, sheets=SHEETS, recorded=recorded)


def good(name: str) -> JudgeSheet:
    return JudgeSheet(name, good=True, version=VERSION, lot=lot_digest(SHEETS))


def test_only_drawn_sheets_are_judged_and_a_bad_one_with_words__law(sample: DrawSheets) -> None:
    desk = desk_after(sample)
    name = sample.sheets[0].name
    beside = next(one.name for one in SHEETS if one.name not in {s.name for s in sample.sheets})
    says = SheetJudged("s", name, True, "", 0)
    assert decided_judgement(says, desk, "ada") == ((good(name),), None)
    told = Notice("notice.sheet-not-drawn", {"sheet": beside}, grave=True)
    assert decided_judgement(replace(says, sheet=beside), desk, "ada") == ((), told)
    assert decided_judgement(says, desk_after(), "ada") == ((), None)
    assert decided_judgement(says, replace(desk, mosaic_version=""), "ada") == ((), None)
    bad = replace(says, good=False)
    assert decided_judgement(bad, desk, "ada") == ((), Notice("notice.sheet-words"))
    decided, _ = decided_judgement(replace(bad, words="smear"), desk, "ada")
    assert decided == (
        JudgeSheet(name, good=False, version=VERSION, words="smear", lot=sample.lot),
    )


def test_sheets_states_and_risks_are_told__truth(sample: DrawSheets) -> None:
    assert sheets_part(desk_after(), blind=False) == {"count": 30, "sample": None}
    first, second, *_ = sample.sheets
    place = first.area.centroid.coords[0]
    marked = Remark("place", "", "", (place[0], place[1]), "smear")
    told = sheets_part(desk_after(sample, marked, good(second.name)), blind=False)["sample"]
    assert (told["lot"], told["drawn"], told["accepted"]) == (30, 15, 1)
    assert (told["bad"], told["open"], told["state"]) == (1, 13, "open")
    assert (told["digest"], told["unchanged"], told["who"]) == (sample.digest, True, "ada")
    # Four per cent are one sheet, which 15 of 30 with one bad allowed always pass.
    assert told["good_lot"] == [4.0, 1, 100.0]
    assert told["bad_lot"] == [20.0, 6, pytest.approx(8.43)]
    assert told["curve"][0] == [0.0, 100.0]
    assert all(a[1] >= b[1] for a, b in zip(told["curve"], told["curve"][1:], strict=False))
    one, other, *_ = told["sheets"]
    assert (one["state"], one["faults"], one["said"]) == ("bad", 1, [])
    assert (other["state"], other["said"][0]["who"], other["said"][0]["outdated"]) == (
        "good",
        "ada",
        False,
    )
    assert one["rings"][0][0] in [list(corner) for corner in first.area.exterior.coords]


def test_the_verdict_of_the_block_tells_of_its_sheets__law(sample: DrawSheets) -> None:
    """A rejected lot is a block that is not good enough."""
    bad = [replace(good(one.name), good=False, words="x") for one in sample.sheets]
    fine = [good(one.name) for one in sample.sheets]
    for words, kind, grave in (
        ([], "sheets-open", 1),
        (fine, "sheets-accepted", 0),
        (bad[:2], "sheets-rejected", 2),
    ):
        judged = judge_desk(desk_after(sample, *words))
        (finding,) = (one for one in judged.findings if one.kind.startswith("sheets"))
        assert (finding.kind, finding.grave) == (kind, grave)
        (rule,) = (one for one in judged.rules if one.rule.name == "sheets")
        assert rule.finding == finding
    before, after = (parts_now(desk_after(sample, *words)) for words in ((), fine))
    assert [part for part in after if before[part] != after[part]] == ["sheets"]


def test_who_still_reads_is_not_told_what_readings_make_of_sheets__law(sample: DrawSheets) -> None:
    east, north = sample.sheets[0].area.centroid.coords[0]
    places = [CheckPlace(f"{n:02d}", east + n, north) for n in range(4)]
    plan = new_plan(places, (4, 1), 1, "", beforehand=True, decisions=())
    read = [
        ReadCheck(p.place_id, (p.east + 9.0, p.north - 9.0), (p.east, p.north), VERSION)
        for p in plan.places
    ]
    begun, done = desk_after(sample, plan, *read[:1]), desk_after(sample, plan, *read)
    for desk, state, lot in ((begun, "open", ""), (done, "bad", "open")):
        seat = Seat("s", "ada")
        for told in (
            seat_quality(seat, desk)["sheets"]["sample"],
            seat_mosaic(seat, desk)["sampled"],
        ):
            assert (told["sheets"][0]["state"], told["state"]) == (state, lot)
    assert not [one for one in seat_quality(Seat("s", "ada"), begun)["rules"] if one[0] == "sheets"]
