"""Tables of surveyed points as Metashape and people read them."""

import csv
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings

from core.errors import CrsError, ProjectError
from core.formats.point_files import (
    read_points,
    write_metashape_points,
    write_points,
)
from tests.exchanged import RECIPES, Recipe, block_of

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


@settings(max_examples=10)
@given(RECIPES)
@pytest.mark.parametrize("write", [write_points, write_metashape_points])
def test_tables_come_back_to_every_digit__law(
    tmp_path_factory: pytest.TempPathFactory, write: Callable, recipe: Recipe
) -> None:
    block = block_of(recipe)
    path = tmp_path_factory.mktemp("points") / "p.csv"
    write(path, block)
    again = read_points(path)
    assert again.crs == block.crs
    assert again.points == block.points


PLAIN = "# CRS: EPSG:5514\nid,X,Y,Z\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [("id,X,Y,Z\n1,-743000,-1043000,300\n", "names no CRS"),
     (PLAIN + "1,-743000,-1043000,high\n", "line 3"), (PLAIN, "holds no rows"),
     (PLAIN + "1,-743000,-1043000,300\n1,-743010,-1043000,300\n", "lines 3 and 4"),
     (PLAIN + "1,14.4,50.1,300\n", "degrees|No point lies")],
)  # fmt: skip
def test_broken_tables_are_named__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "p.csv"
    path.write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_points(path)


def test_an_unknown_crs_is_named__truth(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text(PLAIN.replace("EPSG:5514", "Atlantis") + "1,-743000,-1043000,300\n")
    with pytest.raises(CrsError, match="does not know"):
        read_points(path)
