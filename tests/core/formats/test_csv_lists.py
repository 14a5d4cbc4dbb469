"""Lists of exterior orientations and surveyed points, as people write them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.errors import ProjectError
from core.formats.csv_lists import read_control_points, read_eo_list, scan_stem
from core.formats.point_list import ListedPoint

place = st.floats(-1e7, 1e7, allow_nan=False)
angle = st.floats(-3.14, 3.14, allow_nan=False)
triples = st.tuples(place, place, place)
HEADER = "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg\n"


@settings(max_examples=40, deadline=None)
@given(triples, st.none() | st.tuples(angle, angle, angle), st.none() | triples)
def test_written_and_read__law(
    tmp_path_factory: pytest.TempPathFactory,
    centre: tuple,
    angles: tuple | None,
    sigma: tuple | None,
) -> None:
    path = tmp_path_factory.mktemp("eo") / "eo.csv"
    turned = ("",) * 3 if angles is None else np.degrees(angles).tolist()
    cells = ["LMSA08.1938.HUST25.00859", *centre, *turned, *(sigma or ("",) * 3), *turned]
    sigmas = ",sigma_X,sigma_Y,sigma_Z,sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg\n"
    path.write_text(HEADER.strip() + sigmas + ",".join(map(str, cells)) + "\n")
    back = read_eo_list(path)["LMSA08.1938.HUST25.00859"]
    np.testing.assert_allclose(back.centre, centre, atol=1e-4)
    for got, given_ in ((back.angles, angles), (back.sigma_angles, angles)):
        assert (got is None) == (given_ is None)
        if got is not None:
            np.testing.assert_allclose(got, given_, atol=1e-9)
    assert (back.sigma_centre_m is None) == (sigma is None)


def test_columns_in_any_order_and_case__truth(tmp_path: Path) -> None:
    path = tmp_path / "eo.csv"
    path.write_text(
        "\ufeffScan;Z;Y;X;kappa_gon;phi_gon;omega_gon;note\nscans\\a.TIF;3;2;1;200;0;-1;x\n"
    )
    record = read_eo_list(path)["a"]
    assert record.centre == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(record.angles, np.radians([-0.9, 0, 180]))


def test_position_only_rows__truth(tmp_path: Path) -> None:
    path = tmp_path / "eo.csv"
    path.write_text(
        "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,sigma_X,sigma_Y,sigma_Z\na,1,2,3,,,,200,200,50\n"
    )
    record = read_eo_list(path)["a"]
    assert record.angles is None
    assert record.sigma_centre_m == (200.0, 200.0, 50.0)
    path.write_text("scan,X,Y,Z\nb.tif,1,2,3\n")
    assert read_eo_list(path)["b"].angles is None


@pytest.mark.parametrize(
    ("text", "words"),
    [("scan,X,Y\na,1,2\n", "column Z is missing"), ("X,Y,Z\n1,2,3\n", "column scan is missing"),
     ("scan,X,Y,Z,omega_deg,phi_deg\na,1,2,3,4,5\n", "column kappa_deg is missing"),
     ("scan,X,Y,Z,omega,phi,kappa\na,1,2,3,4,5,6\n", "does not say its unit"),
     (HEADER + "a,1,two,3,0,0,0\n", "Row 2, column Y: 'two' is not a number"),
     (HEADER + "a,1,2,,0,0,0\n", r"Row 2 \(a\), column Z is empty"),
     (HEADER + ",1,2,3,0,0,0\n", "names no scan"), (HEADER, "no rows")],
)  # fmt: skip
def test_unusable_list_says_why__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "eo.csv"
    path.write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_eo_list(path)


def test_missing_list_says_so__truth(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"cannot be read.*`exterior`"):
        read_eo_list(tmp_path / "none.csv")


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
