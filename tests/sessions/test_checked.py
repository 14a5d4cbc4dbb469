"""Readings of a mosaic beside what the adjustment lets expect of them."""

from dataclasses import replace

import numpy as np
import shapely

from core.adjustment.influence import influence_of
from core.mosaic.seams import Seam
from core.progress import SILENT
from core.quality.check_plan import CheckPlace
from core.quality.job_rules import USUAL_RULES
from core.quality.rules import relative_sigma_m
from core.sheets.acceptance import JudgedLot, lot_findings
from sessions.checked import Predicted, checked_by_hand, judged_lot
from sessions.checks import new_plan
from sessions.decisions import Decision, JudgeSheet, ReadCheck, Recorded, Remark, Withdraw
from sessions.sheet_samples import new_sample
from tests.sessions.test_checks import REPORT
from tests.sessions.test_sheet_samples import SHEETS


def test_readings_are_judged_against_what_the_equations_let_expect__law() -> None:
    """Thirty readings as large as predicted, and four times as large."""
    influence = influence_of(REPORT, REPORT.options, SILENT)
    assert influence is not None
    relative_m = relative_sigma_m(REPORT, influence)
    name, photo = next(iter(REPORT.block.photos.items()))
    middle = photo.exterior.centre[:2]
    seams = (Seam(name, "1938", shapely.Point(middle).buffer(500.0)),)
    predicted = Predicted(relative_m, 0.0, influence, seams)
    rng = np.random.default_rng(4)
    spread = rng.uniform(-200, 200, (30, 2)) + middle
    places = [CheckPlace(f"{n:02d}", *place) for n, place in enumerate(spread.tolist())]
    plan = new_plan(places, (6, 5), 1, "", beforehand=True, decisions=())
    errors = rng.normal(0, relative_m / 2**0.5, (30, 2))

    def judged(times: float, by: Predicted) -> set[str]:
        said: list[Decision] = [plan]
        for place, error in zip(plan.places, times * errors, strict=True):
            east, north = place.east, place.north
            seen = (east + float(error[0]), north + float(error[1]))
            said.append(ReadCheck(place.place_id, seen, (east, north), "m1"))
        recorded = [
            Recorded(n, "2026-11-27T10:00:00", who, one)
            for n, (who, one) in enumerate(
                [*(("ada", one) for one in said), *(("bob", one) for one in said[1:])], 1
            )
        ]
        found = checked_by_hand(REPORT, recorded, "m1", by)
        assert found is not None
        assert found.figures.read == 30
        return {one.kind for one in found.findings}

    assert "read-as-predicted" in judged(1.0, predicted)
    assert "read-worse" in judged(4.0, predicted)
    unknown = replace(predicted, relative_m=float("nan"), influence=None)
    assert not {"read-as-predicted", "read-worse", "read-better"} & judged(4.0, unknown)
    assert checked_by_hand(REPORT, [], "m1", predicted) is None


def lot_after(*said: Decision, version: str = "m1", sheets=SHEETS, **more) -> JudgedLot:
    recorded = [Recorded(n, "2026-11-27T10:00:00", "ada", one) for n, one in enumerate(said, 1)]
    found = judged_lot(recorded, sheets, version, 0.8, **more)
    assert found is not None
    return found


def states(lot: JudgedLot) -> dict[str, str]:
    return {one.sheet.name: one.state for one in lot.sheets if one.state != "open"}


def test_sheets_are_judged_by_words_faults_and_readings_on_them__law() -> None:
    """A fault and a reading beside the sheet are of its neighbour."""
    sample = new_sample(SHEETS, 3)
    first, second, third, *_ = sample.sheets
    outside = next(one for one in SHEETS if one.name not in {s.name for s in sample.sheets})

    def marked(sheet) -> Remark:
        return Remark("place", "", "", tuple(sheet.area.centroid.coords[0]), "smear")

    assert judged_lot([], SHEETS, "m1", 0.8) is None
    assert states(lot_after(sample)) == {}
    good = JudgeSheet(first.name, good=True, version="m1", lot=sample.lot)
    bad = JudgeSheet(second.name, good=False, version="m1", words="dark", lot=sample.lot)
    assert states(lot_after(sample, good, bad)) == {first.name: "good", second.name: "bad"}
    assert states(lot_after(sample, good, marked(first))) == {first.name: "bad"}
    assert states(lot_after(sample, marked(outside))) == {}
    mended = Remark("decision", "2", "", closes=True)
    assert states(lot_after(sample, marked(first), mended)) == {}
    assert states(lot_after(sample, marked(first), Withdraw(2))) == {}

    east, north = third.area.centroid.coords[0]
    places = [CheckPlace(f"{n:02d}", east + n, north) for n in range(4)]
    plan = new_plan(places, (4, 1), 1, "", beforehand=True, decisions=())
    for off, state in ((2.0, "bad"), (0.05, "good")):
        read = [
            ReadCheck(p.place_id, (p.east + off, p.north - off), (p.east, p.north), "m1")
            for p in plan.places
        ]
        assert states(lot_after(sample, plan, *read)) == {third.name: state}
        # An observer who still reads is not told.
        assert states(lot_after(sample, plan, *read, blind=True)) == {}
        assert states(lot_after(sample, plan, *read, version="m2")) == {}


def test_another_mosaic_has_to_be_looked_at_again_and_another_lot_to_be_drawn__law() -> None:
    sample = new_sample(SHEETS, 3)
    words = [JudgeSheet(one.name, good=True, version="m1", lot=sample.lot) for one in sample.sheets]
    assert lot_after(sample, *words).state == "accepted"
    renewed = lot_after(sample, *words, version="m2")
    assert (renewed.state, renewed.changed) == ("open", False)
    assert lot_after(sample, *words, sheets=SHEETS[:-1]).changed
    limits = replace(USUAL_RULES, consumer_risk_percent=1.0)
    assert lot_after(sample, *words, rules=limits).changed
    assert lot_after(replace(sample, seed=9), *words).changed


def test_a_newer_sample_does_not_hide_what_was_judged__law() -> None:
    first, second = new_sample(SHEETS, 3), new_sample(SHEETS, 4)
    gone = [one for one in first.sheets if one not in second.sheets]
    assert gone
    bad = JudgeSheet(gone[0].name, good=False, version="m1", words="dark", lot=first.lot)
    hidden = lot_after(first, bad, second)
    # No bad sheet is allowed of twelve: the first sample rejected the lot, and still does.
    assert (hidden.replaced, hidden.rejected) == (1, 1)
    told = [one.kind for one in lot_findings(hidden, USUAL_RULES)]
    assert told == ["sheets-rejected-before", "sheets-open", "sheets-replaced"]
    assert lot_after(first, bad, Withdraw(2), second).rejected == 0
    (east, north), *_ = gone[0].area.centroid.coords
    smear = Remark("place", "", "", (east, north), "smear")
    assert lot_after(first, smear, second).rejected == 1
    assert lot_after(first, bad).replaced == 0
    assert lot_after(first, bad, second, version="m2").replaced == 0
    # Another lot, or a sample that was withdrawn, is no excuse and no matter.
    assert lot_after(new_sample(SHEETS[:-1], 3), bad, second).replaced == 0
