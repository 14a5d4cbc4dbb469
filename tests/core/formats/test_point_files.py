"""Tables of surveyed points as Metashape, Pix4D and people read them."""

import csv
from pathlib import Path

import pytest

from core.formats.point_files import (
    write_metashape_points,
    write_pix4d_points,
    write_points,
)
from tests.exchanged import block_of

BLOCK = block_of((11, 2, 0, False))


def rows_of(path: Path) -> list[list[str]]:
    with path.open(newline="") as stream:
        return [row for row in csv.reader(stream) if row and not row[0].startswith("#")]


def test_the_plain_table_holds_every_digit__truth(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    notes = write_points(path, BLOCK)
    assert "points alone" in notes[0]
    head, *rows = rows_of(path)
    assert head == ["id", "X", "Y", "Z", "sigma_X", "sigma_Y", "sigma_Z", "role"]
    for row in rows:
        point = BLOCK.points[row[0]]
        assert tuple(map(float, row[1:4])) == point.position
        assert tuple(map(float, row[4:7])) == point.sigma_m
        assert row[7] == point.role
    assert path.read_text().startswith("# CRS: EPSG:5514\n")


def test_metashape_unticks_checks__truth(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    write_metashape_points(path, BLOCK)
    assert path.read_text().split("\n")[1].startswith("#Label,X/Easting,Y/Northing,Z/Altitude,")
    ticked = {row[0]: row[-1] for row in rows_of(path)}
    assert ticked == {n: "1" if p.role == "control" else "0" for n, p in BLOCK.points.items()}


def test_pix4d_gets_control_checks_and_marks_apart__truth(tmp_path: Path) -> None:
    notes = write_pix4d_points(tmp_path, BLOCK)
    assert len(notes) == 2
    control, checks = rows_of(tmp_path / "gcp.csv"), rows_of(tmp_path / "checkpoints.csv")
    assert {row[0] for row in control} | {row[0] for row in checks} == set(BLOCK.points)
    assert {row[0] for row in checks} == {n for n, p in BLOCK.points.items() if p.role == "check"}
    point = BLOCK.points[control[0][0]]
    assert float(control[0][4]) == max(point.sigma_m[:2])
    marks = rows_of(tmp_path / "marks.csv")
    assert len(marks) == len(BLOCK.measurements)
    first = BLOCK.measurements[0]
    assert marks[0][:2] == [f"{first.photo_id}.tif", first.point_id]
    assert list(map(float, marks[0][2:])) == pytest.approx([first.column, first.row])
