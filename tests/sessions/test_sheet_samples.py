"""Samples of map sheets as decisions: what is drawn, what is said, and whether it still is so."""

from dataclasses import replace
from pathlib import Path

from shapely.geometry import box

from core.quality.job_rules import USUAL_RULES
from core.sheets.acceptance import smallest_plan
from core.sheets.delivery import Delivery, SheetFile
from core.sheets.map_sheets import MapSheet
from sessions.decisions import JudgeSheet, changing
from sessions.session import Session
from sessions.sheet_samples import (
    is_unchanged,
    lot_digest,
    new_sample,
    sample_of,
    sheets_of,
    sheets_on_disk,
    standing_samples,
    words_of_sheets,
)

SHEETS = tuple(MapSheet(f"S{n:02d}", box(100 * n, 0, 100 * n + 100, 80)) for n in range(12))
"""A lot of twelve sheets in a row."""


def delivered(name: str, form: str = "geotiff", east: float = 0.0) -> SheetFile:
    area = box(east, 0, east + 100, 80)
    return SheetFile(
        name, f"{name}.{form}", form, "EPSG:5514", area, (), (), 1.0, (1, 1), (), "", 1, ()
    )


def cut(session: Session, lot: Delivery) -> None:
    """Map sheets as they are after they were cut, with empty files."""
    session.products.save_value("sheets", "0" * 64, lot)
    (session.results / "sheets").mkdir(exist_ok=True)
    for one in lot.files:
        (session.results / "sheets" / one.file).touch()


def test_a_sheet_in_several_files_is_one_of_the_lot__law(tmp_path: Path) -> None:
    files = (delivered("B", east=100.0), delivered("A"), delivered("A", "jp2"))
    found = sheets_of(Delivery(files, 0, mosaic="m1"), "m1")
    assert [one.name for one in found] == ["A", "B"]
    assert [one.area.bounds[0] for one in found] == [0.0, 100.0]
    assert sheets_of(None, "m1") == ()
    # Cut from another mosaic they are no sheets of this one.
    assert sheets_of(Delivery(files, 0, mosaic="m1"), "m2") == ()
    with Session.open(tmp_path, "ada") as session:
        assert sheets_on_disk(session.products, "m1") == ()
        session.products.save_value("sheets", "0" * 64, Delivery(files, 0, mosaic="m1"))
        assert [one.name for one in sheets_on_disk(session.products, "m1")] == ["A", "B"]


def test_a_sample_is_drawn_by_the_limits_of_the_job__law() -> None:
    sample = new_sample(SHEETS, 3)
    assert sample.plan == smallest_plan(12, USUAL_RULES)
    assert sample.count == sample.plan.sample == 6
    strict = new_sample(SHEETS, 3, replace(USUAL_RULES, consumer_risk_percent=1.0))
    assert strict.count > sample.count
    assert new_sample(SHEETS[::-1], 3) == sample
    assert new_sample(SHEETS, 4) != sample


def test_a_sample_that_was_changed_is_seen_by_its_digest__law(tmp_path: Path) -> None:
    """Whoever dislikes a sheet that was drawn may not put another in its place."""
    made = new_sample(SHEETS, 3)
    with Session.open(tmp_path, "ada") as session:
        session.record(replace(made, sheets=made.sheets[1:]))
        session.record(replace(made, seed=4))
        session.record(made)
        drawn = standing_samples(session.decisions())
    assert [is_unchanged(sample_of(one)) for one in drawn] == [False, False, True]


def test_the_lot_is_names_and_areas_and_not_their_order__law() -> None:
    moved = (replace(SHEETS[0], area=box(0, 0, 100, 81)), *SHEETS[1:])
    assert lot_digest(SHEETS) == lot_digest(SHEETS[::-1])
    others = (moved, SHEETS[1:], (replace(SHEETS[0], name="X"), *SHEETS[1:]))
    assert lot_digest(SHEETS) not in {lot_digest(lot) for lot in others}


def test_everybodys_last_word_about_a_sheet_counts_until_it_is_withdrawn__law(
    tmp_path: Path,
) -> None:
    def said() -> list[tuple[str, bool]]:
        words = words_of_sheets(session.decisions(), "lot").get("S01", ())
        return [(item.who, one.good) for item, one in words]

    with Session.open(tmp_path, "ada") as session:
        session.record(JudgeSheet("S01", good=False, version="m1", words="dim", lot="lot"))
        session.record(JudgeSheet("S01", good=True, version="m1", lot="lot"))
        smear = JudgeSheet("S01", good=False, version="m1", words="smear", lot="lot")
        session.record(smear, operator="bob")
        assert said() == [("ada", True), ("bob", False)]
        assert words_of_sheets(session.decisions(), "another lot") == {}
        session.undo("bob")
        assert said() == [("ada", True)]
        # Nothing of the block follows from it.
        assert changing(session.decisions()) == ()
