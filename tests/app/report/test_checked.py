"""Readings, rules and signatures in the report and its JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import box

from app.report.checked import REMARK_COLUMNS, remark_rows
from app.report.model import ReportContent, gather
from app.report.page import write_report
from app.verbs.run import signed_lines
from core.mosaic.seams import Seam
from core.quality.check_plan import CheckPlace
from core.sheets.delivery import Delivery
from sessions.checks import judged_parts, new_plan
from sessions.decisions import Decision, JudgeSheet, ReadCheck, Recorded, Remark, SignBlock
from sessions.sheet_samples import new_sample, sheets_of
from tests.sessions.test_sheet_samples import delivered
from ui.words.catalogue import Teller

BIAS, SCATTER, OBSERVER = np.array([0.2, -0.1]), 0.3, 0.1
VERSION = "m1"


@pytest.fixture(scope="module")
def checked(content: ReportContent) -> ReportContent:
    """The report of a block read at thirty places, ten of them twice, and signed."""
    rng = np.random.default_rng(5)
    places = [CheckPlace(f"{n:02d}", 1000.0 + 10 * n, 500.0) for n in range(30)]
    plan = new_plan(places, (6, 5), 1, "", beforehand=True, decisions=())
    said: list[tuple[str, Decision]] = [("ada", plan)]
    for number, place in enumerate(plan.places):
        error = BIAS + rng.normal(0, SCATTER, 2)
        for who in ("ada", "bob")[: 1 + (number < 10)]:
            east, north = np.array([place.east, place.north]) + error + rng.normal(0, OBSERVER, 2)
            mosaic, reference = (float(east), float(north)), (place.east, place.north)
            said.append((who, ReadCheck(place.place_id, mosaic, reference, VERSION)))
    said.append(("bob", ReadCheck("1-29", None, None, "m0", "changed")))
    records = [Recorded(100 + n, f"2026-01-02T10:{n:02d}:00", *one) for n, one in enumerate(said)]
    decided = [*content.decisions, *records]
    parts = judged_parts(decided, content.report, VERSION)
    signed = SignBlock("accept-with-remarks", "the <b>south</b>", parts)
    decided.append(Recorded(999, "2026-01-02T12:00:00", "eva", signed))
    return replace(content, decisions=decided, mosaic_version=VERSION)


def test_figures_of_readings_are_those_put_in__truth(checked: ReportContent) -> None:
    found = gather(checked)["checked"]
    figures = found["figures"]
    assert (figures["read"], figures["doubled"]) == (30, 10)
    true = np.sqrt(np.sum(BIAS**2) + 2 * SCATTER**2 + 2 * OBSERVER**2)
    low, high = figures["together"]["m_p_interval"]
    assert low < true < high
    assert figures["together"]["c"] == pytest.approx(BIAS, abs=0.2)
    assert figures["pairs"][0]["who"] == "ada / bob"
    assert figures["observer_m"] == pytest.approx(np.sqrt(2) * OBSERVER, rel=0.4)
    assert found["plans"][0]["outdated"] == 1
    assert len(found["readings"]) == 41
    assert all(one["of_newest_plan"] for one in found["readings"])


def test_readings_are_told_by_part_photo_and_year__truth(checked: ReportContent, tmp_path) -> None:
    """The western half of a block shows a photo of 1938 and is a metre off, the eastern is not."""
    places = [CheckPlace(f"{n:02d}", 100.0 * n - 1450.0, 0.0) for n in range(30)]
    plan = new_plan(places, (6, 5), 1, "", beforehand=True, decisions=())
    rng = np.random.default_rng(2)
    said: list[Decision] = [plan]
    for place in plan.places:
        off = np.array([1.0 if place.east < 0 else 0.0, 0.0]) + rng.normal(0, 0.1, 2)
        mosaic = float(place.east + off[0]), float(place.north + off[1])
        said.append(ReadCheck(place.place_id, mosaic, (place.east, place.north), VERSION))
    records = [Recorded(n, "2026-01-02T10:00:00", "ada", one) for n, one in enumerate(said, 1)]
    west, east = list(checked.report.block.photos)[:2]
    seams = [
        Seam(west, "1938-07-09", box(-2000, -99, 0, 99)),
        Seam(east, "1939-07-09", box(0, -99, 2000, 99)),
    ]
    found = replace(checked, decisions=records, seams=seams, seam_fits=())
    for language in ("en", "cs"):
        html, told = write_report(tmp_path, replace(found, language=language))
        page = html.read_text(encoding="utf-8")
        for name in ("photos", "years"):
            assert Teller(language)(f"report.readings.{name}") in page
        # All places are of one kind: nothing to compare.
        assert Teller(language)("report.readings.kinds") not in page
    groups = json.loads(told.read_text(encoding="utf-8"))["checked"]["groups"]
    assert [one["group"] for one in groups["years"]] == ["1938", "1939"]
    assert [one["group"] for one in groups["photos"]] == [west, east]
    assert [one["count"] for one in groups["photos"]] == [15, 15]
    first, second = groups["years"]
    assert first["c"][0] == pytest.approx(1.0, abs=0.1)
    assert (first["shifted"][0], second["shifted"][0]) == (True, False)
    assert first["circular_error_90"] > 3 * second["circular_error_90"]
    assert [one["group"] for one in groups["kinds"]] == ["reference"]
    assert sum(one["count"] for one in groups["parts"]) == 30


def test_the_page_shows_readings_rules_and_the_signature__truth(
    checked: ReportContent, tmp_path
) -> None:
    for language, words, closes in (
        ("en", "Accepted with remarks", "”"),
        ("cs", "Přijato s výhradami", "“"),
    ):
        html, told = write_report(tmp_path, replace(checked, language=language))
        page = html.read_text(encoding="utf-8")
        assert words in page
        assert 'id="readings"' in page
        assert f"the &lt;b&gt;south&lt;/b&gt;{closes}" in page
        # The first page, too: it told what is predicted and not what was read.
        for name in ("read", "read-position", "shift", "second"):
            assert Teller(language)(f"rule.{name}") in page
    figures = json.loads(told.read_text(encoding="utf-8"))
    (signature,) = figures["checked"]["signatures"]
    assert signature["holds"]
    assert signature["digest"] in page
    assert {row["rule"] for row in figures["checked"]["rules"]} >= {
        "read",
        "read-position",
        "second",
    }


def test_places_that_were_passed_over_are_listed_with_their_reason__law(
    checked: ReportContent, tmp_path
) -> None:
    html, _ = write_report(tmp_path, checked)
    assert "passed over" not in html.read_text(encoding="utf-8")
    assert 'id="passed-over"' not in html.read_text(encoding="utf-8")
    passed = ReadCheck("1-28", None, None, VERSION, "blurred")
    more = Recorded(998, "2026-01-02T11:00:00", "bob", passed)
    html, _ = write_report(tmp_path, replace(checked, decisions=[*checked.decisions, more]))
    page = html.read_text(encoding="utf-8")
    table = page[page.index('id="passed-over"') :].partition("</table>")[0]
    assert all(word in table for word in ("1-28", "bob", "blurred"))


def test_a_change_after_the_signature_shows_it_as_outdated__law(
    checked: ReportContent, tmp_path
) -> None:
    later = replace(checked, mosaic_version="m2")
    (signature,) = gather(later)["checked"]["signatures"]
    assert signature["changed"] == ["mosaic"]
    html, _ = write_report(tmp_path, later)
    assert "Outdated; changed since" in html.read_text(encoding="utf-8")
    (line,) = signed_lines(tmp_path / "report.json", Teller())
    assert "Accepted with remarks, eva" in line
    assert line.endswith("Outdated; changed since: mosaic")


def test_a_block_without_a_plan_has_no_chapter_of_readings__law(
    content: ReportContent, tmp_path
) -> None:
    html, told = write_report(tmp_path, content)
    assert 'id="readings"' not in html.read_text(encoding="utf-8")
    found = json.loads(told.read_text(encoding="utf-8"))["checked"]
    assert found["figures"] is None
    assert found["signatures"] == []


def test_faults_and_remarks_stand_in_page_json_and_table__law(
    content: ReportContent, tmp_path
) -> None:
    said = (
        Remark("place", "", "church <twice>", (1.0, 2.0), "double", "eve"),
        Remark("photo", "00513", "scratched"),
        Remark("decision", "901", "seam moved", closes=True),
    )
    records = [Recorded(901 + n, "2026-01-02T10:00:00", "ada", one) for n, one in enumerate(said)]
    rows = remark_rows([*content.decisions, *records])
    assert [(row[7], row[-1]) for row in rows[-3:]] == [
        ("double", "closed"), ("", ""), ("", "closed"),
    ]  # fmt: skip
    assert len(rows[0]) == len(REMARK_COLUMNS.split(","))
    for left, kind, sentence in (
        (2, "faults-open", "still open: 1"),
        (3, "faults", "all closed"),
    ):
        found = replace(content, decisions=[*content.decisions, *records[:left]])
        verdict = {one["kind"]: one["sentence"] for one in gather(found)["verdict"]}
        assert sentence in verdict[kind]
    write_report(tmp_path, found)
    page = (tmp_path / "report.html").read_text()
    assert "church &lt;twice&gt;" in page
    assert "seam moved" in page


def test_a_sample_of_sheets_is_told_with_its_risks_and_rejects_the_block__truth(
    checked: ReportContent, tmp_path
) -> None:
    lot = Delivery(tuple(delivered(f"S{n:02d}", east=500.0 * n) for n in range(30)), 0, 0, VERSION)
    sample = new_sample(sheets_of(lot, VERSION), 3)
    names = [one.name for one in sample.sheets]
    words = [
        JudgeSheet(name, good=n > 1, version=VERSION, words="a smear" * (n < 2), lot=sample.lot)
        for n, name in enumerate(names)
    ]
    said = [
        Recorded(2000 + n, "2026-01-02T13:00:00", "eva", one)
        for n, one in enumerate((sample, *words))
    ]
    found = replace(checked, decisions=[*checked.decisions, *said], sheets=lot)
    assert gather(checked)["checked"]["sheets"] is None
    told = gather(found)["checked"]
    assert (told["sheets"]["state"], told["sheets"]["bad"]) == ("rejected", 2)
    assert [row["kind"] for row in told["rules"] if row["rule"] == "sheets"] == ["sheets-rejected"]
    assert told["signatures"][0]["changed"] == ["sheets"]
    for language in ("en", "cs"):
        tell = Teller(language)
        html, _ = write_report(tmp_path, replace(found, language=language))
        page = html.read_text(encoding="utf-8")
        assert 'id="samples"' in page
        table = page[page.index('id="sampled"') :].partition("</table>")[0]
        assert all(name in table for name in names)
        assert "a smear" in table
        assert tell("samples.rejected", bad=2) in page
        assert tell.number(told["sheets"]["bad_lot"][2], ".1f") in page
