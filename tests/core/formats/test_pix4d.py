"""Pix4D's tables of control, checks and marks, both ways."""

import csv
from pathlib import Path

import pytest
from hypothesis import given, settings

from core.errors import PhotogrammetryError
from core.formats.exchange import read_format
from core.formats.pix4d import PIX4D_POINTS, read_pix4d_points, write_pix4d_points
from tests.exchanged import RECIPES, Recipe, block_of

BLOCK = block_of((11, 2, 0, False))


def rows_of(path: Path) -> list[list[str]]:
    with path.open(newline="") as stream:
        return list(csv.reader(stream))


def test_pix4d_gets_control_checks_and_marks_apart__truth(tmp_path: Path) -> None:
    notes = write_pix4d_points(tmp_path, BLOCK)
    assert len(notes) == 1
    control, checks = rows_of(tmp_path / "gcp.csv"), rows_of(tmp_path / "checkpoints.csv")
    assert {row[0] for row in control} | {row[0] for row in checks} == set(BLOCK.points)
    assert {row[0] for row in checks} == {n for n, p in BLOCK.points.items() if p.role == "check"}
    point = BLOCK.points[control[0][0]]
    assert float(control[0][4]) == max(point.sigma_m[:2])
    marks = rows_of(tmp_path / "marks.csv")
    assert len(marks) == len(BLOCK.measurements)
    first = BLOCK.measurements[0]
    assert marks[0][:2] == [f"{first.photo_id}.tif", first.point_id]
    assert list(map(float, marks[0][2:])) == [first.column, first.row, first.sigma_px]


@settings(max_examples=10)
@given(RECIPES)
def test_points_and_marks_come_back_to_every_digit__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block = block_of(recipe, "upright")
    path = tmp_path_factory.mktemp("pix4d")
    write_pix4d_points(path, block)
    again = read_format(PIX4D_POINTS, path)
    assert set(again.measurements) == set(block.measurements)
    assert {n: photo.file for n, photo in again.photos.items()} == {
        n: photo.file for n, photo in block.photos.items()
    }
    for name, point in block.points.items():
        other = again.points[name]
        assert (other.position, other.role) == (point.position, point.role)
        plan = max(point.sigma_m[:2])
        assert other.sigma_m == (plan, plan, point.sigma_m[2])


@pytest.mark.parametrize("sign", [",", ", ", ";", "\t", " "])
def test_tables_as_pix4d_parts_them__truth(tmp_path: Path, sign: str) -> None:
    """With the folder of the images before their names, with and without accuracy and heads."""
    marks = [["C:\\flight\\a.JPG", "GCP0", "1200.5", "800.25"],
             ["C:\\flight\\b.JPG", "7", "10.5", "20.5", "0.5"]]  # fmt: skip
    (tmp_path / "m.txt").write_text("\n".join(map(sign.join, marks)) + "\n")
    points = [["label", "X", "Y", "Z"], ["GCP0", "2532795.105", "1152094.639", "395.883"],
              ["7", "2532728.8", "1152079.8", "396.6", "0.02", "0.03"]]  # fmt: skip
    (tmp_path / "g.csv").write_text("\n".join(map(sign.join, points)) + "\n")
    found = read_pix4d_points(tmp_path)
    assert [(m.photo_id, m.point_id, m.column, m.row, m.sigma_px) for m in found.measurements] == [
        ("a", "GCP0", 1200.5, 800.25, None), ("b", "7", 10.5, 20.5, 0.5),
    ]  # fmt: skip
    assert {photo.file for photo in found.photos.values()} == {"a.JPG", "b.JPG"}
    assert found.points["GCP0"].sigma_m is None
    assert found.points["7"].sigma_m == (0.02, 0.02, 0.03)
    assert len(read_pix4d_points(tmp_path / "m.txt").measurements) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "neither points nor marks"), ("G1,1,2\n", "at least 4"),
     ("G1,1,2,high\n", "Line 1: 'high'"), ("G1,1000,2000,3\nG1,1000,2000,3\n", "stands twice"),
     ("G1,46.2,6.5,299.9\n", "degrees"), ("a.tif,G1,5\n", "at least 4"),
     ("a.tif,G1,5,6\na.jpg,G1,5,6\n", "two scans")],
)  # fmt: skip
def test_broken_tables_are_named__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "p.csv"
    path.write_text(text)
    with pytest.raises(PhotogrammetryError, match=words):
        read_format(PIX4D_POINTS, path)


def test_lines_of_any_system_are_read__truth(tmp_path: Path) -> None:
    write_pix4d_points(tmp_path, BLOCK)
    whole, table = read_format(PIX4D_POINTS, tmp_path), tmp_path / "checkpoints.csv"
    table.write_bytes(table.read_bytes().replace(b"\n", b"\r"))
    again = read_format(PIX4D_POINTS, tmp_path)
    assert (again.points, again.measurements) == (whole.points, whole.measurements)
