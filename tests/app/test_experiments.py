"""The experiments of the thesis on a tiny block with truth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.experiments import (
    EXPERIMENTS,
    REPAIRED_M,
    TABLE_4,
    TABLE_5,
    Ground,
    graph_5,
    open_ground,
    repaired,
    table_2,
    table_5,
    write_log,
)
from app.verbs.teach import table_lines
from core.literature.detectors import is_installed
from core.progress import SILENT
from ui.words.catalogue import LANGUAGES, Teller


@pytest.fixture(scope="module")
def ground(tiny_block: Path) -> Ground:
    """One photo is enough."""
    whole = open_ground(tiny_block)
    return replace(whole, photos=whole.photos[:1])


def test_the_tables_are_those_the_thesis_prints__paper() -> None:
    """Thesis, p. 70 and 73: the mean is that of the two axes."""
    means = [np.mean(one.printed[1:]) for one in TABLE_4]
    printed = [4.79, 11.43, 4.81, 4.78, 4.74, 10.70, 6.71, 5.06, 4.74]
    assert means == pytest.approx(printed, abs=0.0101)
    assert [np.mean(one.printed[1:]) for one in TABLE_5] == pytest.approx(
        [9.28, 8.63, 8.81], abs=0.0101
    )


def test_photos_begin_as_far_off_as_repaired_georeferences__paper(ground: Ground) -> None:
    """Thesis, Table 3: 6.83 m and 8.08 m."""
    true = ground.truth.photos[ground.photos[0].photo.photo_id].exterior
    off = np.array([repaired(true, f"{i}").centre - true.centre for i in range(400)])
    # 400 draws tell a standard deviation to 3.5 %; three of those are allowed.
    assert off[:, :2].std(axis=0) == pytest.approx(REPAIRED_M, rel=0.11)
    assert not off[:, 2].any()


def test_the_ground_of_the_flight_is_matched_and_todays_less__truth(ground: Ground) -> None:
    table = table_5(ground, SILENT)
    right, count = (table.columns.index(name) for name in ("right", "count"))
    older, green, grey = table.rows
    assert older[count] == grey[count] >= 10
    assert older[right] > 70 > max(green[right], grey[right])
    assert len(table.matches) == sum(row[count] for row in table.rows)


def test_what_ransac_keeps_was_a_cluster_before__law(ground: Ground) -> None:
    table = graph_5(ground, SILENT)
    row = dict(zip(table.columns[1:], table.rows[0][1:], strict=True))
    assert row["junctions"] >= row["above"] <= row["clusters"]
    assert row["agree.right"] <= min(row["agree"], row["clusters.right"])
    assert row["agree"] <= row["clusters"]
    assert table.rows[-1][1:] == table.rows[0][1:]


def test_every_variant_of_table_2_has_its_row_and_its_log__law(
    ground: Ground, tmp_path: Path
) -> None:
    table = table_2(ground, SILENT)
    assert [row[0][:1] for row in table.rows] == list("1234567–––––")
    right = {row[0]: row[3] for row in table.rows}
    if not is_installed("surf"):
        assert right.pop("5 SURF-VDD") is None
    # In built-up land fewer points are detected, and fields that changed are not among them.
    pairs = {row[0]: row[2] for row in table.rows}
    assert 0 < pairs["– SIFT, NCC +"] < pairs["– SIFT, NCC"]
    assert all(0 <= share <= 100 for share in right.values())
    told = json.loads(write_log(tmp_path, ground, table, 1.0).read_text(encoding="utf-8"))
    assert told["rows"] == [list(row) for row in table.rows]
    assert {one["variant"] for one in told["matches"]} >= {"sift-d", "ncc-vd"}
    for language in LANGUAGES:
        lines = table_lines(table, Teller(language))
        assert len(lines) == 1 + len(table.rows)
        assert "SIFT-VDD" in lines[4]


def test_without_a_block_with_truth_the_remedy_is_named__law(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in EXPERIMENTS:
        assert main(["teach", "--experiment", name, "--block", str(tmp_path)]) == 1
    assert "gruber demo" in capsys.readouterr().err
