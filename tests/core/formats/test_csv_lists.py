"""Lists of surveyed points, as people write them."""

from pathlib import Path

import pytest

from core.errors import ProjectError
from core.formats.csv_lists import read_control_points, scan_stem
from core.formats.point_list import ListedPoint


def test_names_lose_folder_and_image_extension_only__truth() -> None:
    assert scan_stem("LMSA08.1938.HUST25.00859") == "LMSA08.1938.HUST25.00859"
    assert scan_stem("a/b/LMSA08.1938.HUST25.00859.TIF") == "LMSA08.1938.HUST25.00859"
    assert scan_stem("C:\\scans\\1989_16401.jp2") == "1989_16401"


def listed(folder: Path, text: str, encoding: str = "utf-8") -> tuple[ListedPoint, ...]:
    path = folder / "points.csv"
    path.write_text(text, encoding=encoding)
    return read_control_points(path)


def test_every_column_of_a_row__truth(tmp_path):
    points = listed(
        tmp_path,
        "id,X,Y,Z,sigma_xy,sigma_z,role\n"
        "GCP 1,-580000.25,-1190000.5,201.125,0.05,0.08,control\n"
        "7,-580100,-1190100,205,0.5,1,check\n",
    )
    assert points[0] == ListedPoint("GCP 1", -580000.25, -1190000.5, 201.125, (0.05, 0.05, 0.08))
    assert points[1].point_id == "7"
    assert points[1].role == "check"


def test_what_is_left_out_has_a_default__truth(tmp_path):
    for text in (
        "id,X,Y,Z\nA,1,2,3\n",
        "id,X,Y,Z,sigma_xy,sigma_z,role\nA,1,2,3,,,\n",
        "role,Z,Y,X,id,note\n,3,2,1, A ,seen\n",
        "id,X,Y,Z,sigma_xy,sigma_z,role\nA,1,2,3\n",
    ):
        assert listed(tmp_path, text) == (ListedPoint("A", 1.0, 2.0, 3.0, (0.1, 0.1, 0.1)),)


def test_a_list_saved_by_a_spreadsheet_has_a_byte_order_mark__truth(tmp_path):
    assert listed(tmp_path, "id,X,Y,Z\nBöhm,1,2,3\n", "utf-8-sig")[0].point_id == "Böhm"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("id,X,Y\nA,1,2\n", "the column Z is missing"),
        ("", "the column id is missing"),
        ("id,X,Y,Z\nA,1,2,3\nB,1,2,x\n", "line 3"),
        ("id,X,Y,Z\nA,1,,3\n", "line 2"),
        ("id,X,Y,Z\nA,1,2\n", "line 2"),
        ("id,X,Y,Z\nA,1,2,nan\n", "line 2"),
        ("id,X,Y,Z,sigma_xy\nA,1,2,3,0\n", "line 2"),
        ("id,X,Y,Z,sigma_xy\nA,1,2,3,-1\n", "line 2"),
        ("id,X,Y,Z,role\nA,1,2,3,tie\n", "'tie' is unknown"),
        ("id,X,Y,Z\nA,1,2,3\nA,4,5,6\n", "A stands twice"),
        ("id,X,Y,Z\n,1,2,3\n", "line 2"),
    ],
)
def test_what_cannot_be_used_is_told_with_its_place__truth(tmp_path, text, said):
    with pytest.raises(ProjectError) as told:
        listed(tmp_path, text)
    assert said in str(told.value)
    assert "points.csv" in str(told.value)
    assert told.value.remedy


def test_a_list_in_another_encoding_is_told__truth(tmp_path):
    with pytest.raises(ProjectError, match="UTF-8"):
        listed(tmp_path, "id,X,Y,Z\nPříbor,1,2,3\n", "cp1250")
