"""The notebook's tables come from its JSON, and samples from the program."""

import re
from pathlib import Path

from app.run import LAST_STAGES, WHEN_ASKED
from core.pipeline import STAGES
from tests.benchmarks.notebook import (
    CHANGED_NOTE,
    MARKED,
    OLDER,
    OLDER_NOTE,
    Row,
    Table,
    all_tables,
    draw_page,
    draw_table,
    drawn_pages,
    pages_of_tables,
    printed_tables,
    read_samples,
    read_tables,
    with_printed,
    write_tables,
)

TABLE = Table(
    ("block", "chain", "recall", "promised"),
    (
        Row("aaaaaaa", "2026-11-20 10:00", ("1", "ours", "80 %", "at least 75 %")),
        Row("bbbbbbb", "2026-11-21 10:00", ("1", "theirs", "20 %", "")),
    ),
    "python -m tests.benchmarks.prove_something",
    keys=2,
)
PRINTED = """
Some words before.
| block | chain | recall | seconds |
|---|---|---|---|
| 1 | ours | 90 % | 3 |
| 2 | ours | 85 % | 4 |
and after
""".splitlines()


def without_marks(text: str) -> str:
    """The text without what depends on how the code has gone on since."""
    for mark in (OLDER_NOTE, CHANGED_NOTE, OLDER):
        text = text.replace(mark, "")
    return "\n".join(line.rstrip() for line in text.splitlines() if line.strip())


def test_pages_show_what_the_notebook_holds__law() -> None:
    tables, samples = all_tables(), read_samples()
    for page in drawn_pages():
        text = page.read_text(encoding="utf-8")
        drawn = draw_page(text, tables, samples)
        assert without_marks(text) == without_marks(drawn), f"{page.name}: draw it again"


def test_every_table_is_shown_once_and_has_its_own_name__law() -> None:
    names = [name for path in pages_of_tables() for name in read_tables(path)]
    texts = [page.read_text(encoding="utf-8") for page in drawn_pages()]
    shown = [m[3] for text in texts for m in MARKED.finditer(text) if m[2] == "table"]
    assert sorted(names) == sorted(shown)
    assert len(set(names)) == len(names)


def test_every_row_names_its_version_and_fills_its_columns__law() -> None:
    for name, table in all_tables().items():
        for row in table.rows:
            assert re.fullmatch(r"[0-9a-f]{7,}\+?", row.commit), name
            assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d", row.date), name
            assert len(row.cells) == len(table.columns), name


def test_printed_rows_replace_those_with_the_same_key__truth() -> None:
    new = with_printed(TABLE, PRINTED, "ccccccc", "2026-11-22 10:00")
    assert [row.cells for row in new.rows] == [
        ("1", "ours", "90 %", "at least 75 %"),
        ("1", "theirs", "20 %", ""),
        ("2", "ours", "85 %", ""),
    ]
    assert [row.commit for row in new.rows] == ["ccccccc", "bbbbbbb", "ccccccc"]


def test_a_table_with_other_columns_is_left_alone__truth() -> None:
    assert printed_tables(PRINTED) == [
        (
            ["block", "chain", "recall", "seconds"],
            [["1", "ours", "90 %", "3"], ["2", "ours", "85 %", "4"]],
        )
    ]
    assert printed_tables([*PRINTED, "", *PRINTED]) == 2 * printed_tables(PRINTED)
    other = ["| pair | recall |", "|---|---|", "| 1 | 99 % |"]
    assert with_printed(TABLE, other, "ccccccc", "2026-11-22 10:00") == TABLE


def test_rows_of_another_version_are_marked__truth() -> None:
    drawn = draw_table(TABLE, lambda first, second: first == second)
    ours, theirs = (line for line in drawn.splitlines() if line.startswith("| 1"))
    assert ours.endswith(f"aaaaaaa, 2026-11-20{OLDER} |")
    assert theirs.endswith("bbbbbbb, 2026-11-21 |")
    assert OLDER_NOTE in drawn
    assert CHANGED_NOTE in drawn
    same = draw_table(TABLE, lambda first, second: True)
    assert OLDER not in same
    assert CHANGED_NOTE not in same


def test_tables_are_written_as_they_were_read__law(tmp_path: Path) -> None:
    path = tmp_path / "page.json"
    write_tables(path, {"one": TABLE, "two": TABLE})
    assert read_tables(path) == {"one": TABLE, "two": TABLE}


def test_the_demos_sample_shows_the_stages_of_the_program__law() -> None:
    titles = [stage.title for stage in STAGES] + [
        title for name, title in LAST_STAGES.items() if name not in WHEN_ASKED
    ]
    lines = read_samples()["demo"].lines
    shown = [match[1] for line in lines if (match := re.match(r"(\S.*?) +\d+\.\d s  ", line))]
    # Stages that are repeated stand there once for each pass.
    first = [title for title in shown[1:] if " (pass " not in title]
    assert first == titles, "run: python -m tests.benchmarks.notebook sample demo"
