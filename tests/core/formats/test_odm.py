"""ODM's list of control points."""

from pathlib import Path

import pytest
from hypothesis import given, settings

from core.errors import PhotogrammetryError
from core.formats.exchange import ExchangeBlock
from core.formats.odm import read_odm, write_odm
from tests.exchanged import (
    RECIPES,
    Recipe,
    assert_same_measurements,
    assert_same_points,
    block_of,
)


@given(RECIPES)
@settings(max_examples=25, deadline=None)
def test_points_and_measurements_come_back__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block, path = block_of(recipe, "upright"), tmp_path_factory.mktemp("odm") / "gcp_list.txt"
    write_odm(path, block)
    again = read_odm(path)
    assert again.crs == block.crs
    assert {name: photo.file for name, photo in again.photos.items()} == {
        name: photo.file for name, photo in block.photos.items()
    }
    assert_same_points(block, again)
    assert_same_measurements(block, again)


def test_a_list_for_odm_is_read_and_the_same_again__real(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "exchange-samples/odm/tmizu_gcp_list.txt"
    block = read_odm(path)
    assert block.crs == "EPSG:32654"
    assert (len(block.points), len(block.measurements)) == (4, 149)
    first = block.measurements[0]
    assert (first.photo_id, first.column, first.row) == ("IMG_6785", 333.5, 1590.5)
    assert block.points[first.point_id].position == (494399.2, 4232697.1, 5.0)
    write_odm(tmp_path / "gcp_list.txt", block)
    before = [line.split() for line in path.read_text().splitlines()[1:] if line]
    after = [line.split() for line in (tmp_path / "gcp_list.txt").read_text().splitlines()[1:]]
    assert [[*map(float, line[:5]), line[5]] for line in after] == [
        [*map(float, line[:5]), line[5]] for line in before
    ]


HEAD = "EPSG:32633\n"
ROW = "544256.7 5320919.9 5 3044 2622 IMG_0525.jpg gcp01\n"


@pytest.mark.parametrize(
    "head", ["EPSG:32633", "WGS84 UTM 33N", "+proj=utm +zone=33 +datum=WGS84 +units=m +no_defs"]
)
def test_the_first_line_names_the_crs_in_three_ways__truth(tmp_path: Path, head: str) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text(f"\ufeff{head}\n# comment\n{ROW}", encoding="utf-8")
    block = read_odm(path)
    assert "EPSG:32633" in block.crs or "zone 33N" in block.crs or "Transverse" in block.crs
    assert block.points["gcp01"].position == (544256.7, 5320919.9, 5.0)
    assert (block.measurements[0].column, block.measurements[0].row) == (3044.5, 2622.5)


SPOILED = {
    "empty": "", "no points": HEAD, "no crs": ROW, "unknown crs": "EPSG:1\n" + ROW,
    "degrees": "EPSG:4326\n" + ROW, "short row": HEAD + "544256.7 5320919.9 5 3044 2622\n",
    "nan": HEAD + ROW.replace(" 5 ", " NaN "), "word": HEAD + ROW.replace("3044", "left"),
    "two places": HEAD + ROW + ROW.replace("544256.7", "544257.7"),
    "two scans": HEAD + ROW + ROW.replace(".jpg", ".tif"), "binary": HEAD + ROW + "\0",
    "infinite": HEAD + ROW.replace("2622", "inf"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILED)
def test_a_broken_list_is_refused__truth(tmp_path: Path, name: str) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text(SPOILED[name], encoding="utf-8")
    with pytest.raises(PhotogrammetryError):
        read_odm(path)


def test_without_crs_or_measurements_nothing_is_written__truth(tmp_path: Path) -> None:
    for block in (ExchangeBlock(), ExchangeBlock("EPSG:5514")):
        with pytest.raises(PhotogrammetryError):
            write_odm(tmp_path / "gcp_list.txt", block)
        assert not (tmp_path / "gcp_list.txt").exists()
