"""Lists of surveyed points: whatever the dialect, the same points."""

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyproj import Transformer

from core.errors import ProjectError
from core.formats.listed_point import ROLES, ListedPoint, PointList, PointListReading
from core.formats.point_axes import Surroundings
from core.formats.point_list import read_control_points, read_point_list

KROVAK = Surroundings("EPSG:5514", (-750e3, -1_050e3, -740e3, -1_040e3))
UTM = Surroundings("EPSG:32633", (450e3, 5_540e3, 470e3, 5_560e3))
OWN = "id,X,Y,Z,sigma_xy,sigma_z,role\n"


def read(
    folder: Path,
    text: str,
    around: Surroundings = KROVAK,
    reading: PointListReading | None = None,
    encoding: str = "utf-8",
) -> PointList:
    path = folder / "points.csv"
    path.write_bytes(text.encode(encoding))
    return read_point_list(path, around, reading)


def listed(folder: Path, text: str, encoding: str = "utf-8") -> tuple[ListedPoint, ...]:
    path = folder / "points.csv"
    path.write_bytes(text.encode(encoding))
    return read_control_points(path, "EPSG:32633")


def test_every_column_of_a_row__truth(tmp_path: Path) -> None:
    points = listed(
        tmp_path,
        OWN + "GCP 1,-580000.25,-1190000.5,201.125,0.05,0.08,control\n7,-580100,-1190100,205,0.5,1"
        ",check\n",
    )
    assert points[0] == ListedPoint("GCP 1", -580000.25, -1190000.5, 201.125, (0.05, 0.05, 0.08))
    assert points[1].point_id == "7"
    assert points[1].role == "check"


@pytest.mark.parametrize(
    "text",
    ["id,X,Y,Z\nA,1,2,3\n", OWN + "A,1,2,3,,,\n", "role,Z,Y,X,id,note\n,3,2,1, A ,\n",
     OWN + "A,1,2,3\n"],
)  # fmt: skip
def test_what_is_left_out_has_a_default__truth(tmp_path: Path, text: str) -> None:
    assert listed(tmp_path, text) == (ListedPoint("A", 1.0, 2.0, 3.0, (0.1, 0.1, 0.1)),)


def test_a_list_without_rows_yet_brings_nothing__truth(tmp_path: Path) -> None:
    assert listed(tmp_path, OWN) == ()


def test_a_list_saved_by_a_spreadsheet_has_a_byte_order_mark__truth(tmp_path: Path) -> None:
    assert listed(tmp_path, "id,X,Y,Z\nBöhm,1,2,3\n", "utf-8-sig")[0].point_id == "Böhm"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-16-be", "cp1250"])
def test_names_come_in_any_usual_encoding__truth(tmp_path: Path, encoding: str) -> None:
    assert listed(tmp_path, "id,X,Y,Z\nPříbor žďár,1,2,3\n", encoding)[0].point_id == "Příbor žďár"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("id,X,Y\nA,1,2\n", "column Z is missing"),
        ("", "holds no rows"),
        ("id,X,Y,Z\nA,1,2,3\nB,1,2,x\n", "line 3"),
        ("id,X,Y,Z\nA,1,,3\n", "line 2"),
        ("id,X,Y,Z\nA,1,2\n", "line 2"),
        ("id,X,Y,Z\nA,1,2,nan\n", "line 2"),
        ("id,X,Y,Z,sigma_xy\nA,1,2,3,0\n", "line 2"),
        ("id,X,Y,Z,sigma_xy\nA,1,2,3,-1\n", "line 2"),
        ("id,X,Y,Z,role\nA,1,2,3,tie\n", "'tie' is unknown"),
        ("id,X,Y,Z\nA,1,2,3\nA,4,5,6\n", "such as A in lines 2 and 3"),
        ("id,X,Y,Z\n,1,2,3\n", "line 2"),
    ],
)
def test_a_list_of_block_toml_is_whole_or_an_error__truth(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(ProjectError) as told:
        listed(tmp_path, text)
    assert said in str(told.value)
    assert "points.csv" in str(told.value)
    assert told.value.remedy


HEADERS = {
    "own": ("id", "X", "Y", "Z", "sigma_X", "sigma_Y", "sigma_Z", "role", "description", "sketch"),
    "czech": ("Č. bodu", "X", "Y", "Výška [m]", "mx", "my", "mz", "úloha", "popis", "náčrt"),
    "english": ("Point name", "X (m)", "Y (m)", "Height", "SX", "SY", "SZ", "Role", "Note",
                "Photo"),
    "metashape": ("#Label", "X/Easting", "Y/Northing", "Z/Altitude", "Accuracy_X_(m)",
                  "Accuracy_Y_(m)", "Accuracy_Z_(m)", "usage", "comment", "picture"),
}  # fmt: skip
names = st.text("abcABCřž123-_.", min_size=1, max_size=8).map(lambda text: "b" + text)
metres = st.integers(-4_000_000, 4_000_000).map(lambda number: number / 1000)
sigma = st.integers(1, 2000).map(lambda number: number / 1000)
point = st.builds(
    ListedPoint, names, metres.map(lambda m: -745_000 + m), metres.map(lambda m: -1_045_000 + m),
    st.integers(-100_000, 900_000).map(lambda number: number / 1000),
    st.tuples(sigma, sigma, sigma), st.sampled_from(ROLES),
    st.sampled_from(["", "roh plotu", "věž", "kámen 3"]),
    st.sampled_from(["", "a.jpg", "bod 1.png"]),
)  # fmt: skip
lists = st.lists(point, min_size=1, max_size=6, unique_by=lambda one: one.point_id)


def written(
    points: list[ListedPoint],
    *,
    delimiter: str,
    decimal: str,
    header: str,
    axes: str,
    order: list[int],
) -> str:
    """The points in one dialect."""
    rows = [list(HEADERS[header])]
    for one in points:
        plane = {"E N": (one.easting, one.northing), "-N -E": (-one.northing, -one.easting),
                 "-E -N": (-one.easting, -one.northing)}[axes]  # fmt: skip
        sigmas = one.sigma_m
        if axes == "-N -E":
            sigmas = sigmas[1], sigmas[0], sigmas[2]
        figures = [f"{value:.3f}".replace(".", decimal) for value in (*plane, one.height, *sigmas)]
        rows.append([one.point_id, *figures, one.role, one.description, one.sketch])
    return "\r\n".join(delimiter.join(row[n] for n in order) for row in rows) + "\r\n"


@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(
    points=lists,
    delimiter=st.sampled_from([";", "\t", ","]),
    comma=st.booleans(),
    header=st.sampled_from(list(HEADERS)),
    axes=st.sampled_from(["E N", "-N -E", "-E -N"]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1250"]),
    seed=st.integers(0, 1000),
)
def test_any_dialect_reads_back_the_same_points__law(
    tmp_path: Path,
    points: list[ListedPoint],
    delimiter: str,
    comma: bool,
    header: str,
    axes: str,
    encoding: str,
    seed: int,
) -> None:
    if header == "metashape" and axes != "E N":
        axes = "E N"  # its columns are called easting and northing
    order = list(range(10))
    if header != "metashape":  # whose names stand in a comment line that begins with #Label
        random.Random(seed).shuffle(order)
    decimal = "," if comma and delimiter != "," else "."
    text = written(
        points, delimiter=delimiter, decimal=decimal, header=header, axes=axes, order=order
    )
    found = read(tmp_path, text, encoding=encoding)
    assert found.questions == ()
    assert found.refused == ()
    assert found.points == tuple(points)


@settings(max_examples=30, suppress_health_check=list(HealthCheck))
@given(points=lists, delimiter=st.sampled_from([";", "\t", ",", " "]), numbered=st.booleans())
def test_a_table_without_names_of_columns_reads_back__law(
    tmp_path: Path, points: list[ListedPoint], delimiter: str, numbered: bool
) -> None:
    if numbered:
        points = [replace(one, point_id=f"{1000 + n}") for n, one in enumerate(points)]
    plain = [
        replace(one, role="control", sigma_m=(0.1,) * 3, description="", sketch="")
        for one in points
    ]
    text = "\n".join(
        delimiter.join([p.point_id, f"{p.easting:.3f}", f"{p.northing:.3f}", f"{p.height:.3f}"])
        for p in plain
    )
    found = read(tmp_path, text)
    assert (found.questions, found.refused, found.points) == ((), (), tuple(plain))


def test_the_answer_is_read_again_alike_when_all_of_it_is_named__law(tmp_path: Path) -> None:
    text = "cislo;Y;X;H\n1;743011,77;1043823,16;250,5\n"
    first = read(tmp_path, text)
    assert first.points == read(tmp_path, text, reading=first.reading).points
    assert first.points[0].easting == -743011.77
    assert first.points[0].northing == -1043823.16


def test_a_choice_goes_before_what_is_recognised__truth(tmp_path: Path) -> None:
    text = "A 1 -743011.77 -1043823.16 250.5 0.2\n"
    columns = ("id", "", "X", "Y", "Z", "sigma_xy")
    chosen = PointListReading(columns=columns, role="check", sigma_height_m=0.5)
    found = read(tmp_path, text, reading=chosen).points[0]
    assert (found.role, found.sigma_m) == ("check", (0.2, 0.2, 0.5))


def test_swapped_axes_are_asked_about_outside_the_custom_of_krovak__truth(tmp_path: Path) -> None:
    text = "id,X,Y,Z\nA,5550000,460000,300\nB,5551000,461000,300\n"
    found = read(tmp_path, text, UTM)
    assert [question.about for question in found.questions] == ["axes"]
    assert [choice.value for choice in found.questions[0].choices] == ["N E", "E N"]
    assert "2 of 2 points" in found.questions[0].choices[0].words
    answered = read(tmp_path, text, UTM, PointListReading(axes="N E"))
    assert answered.questions == ()
    assert (answered.points[0].easting, answered.points[0].northing) == (460000, 5550000)


def test_sigmas_follow_their_axes__truth(tmp_path: Path) -> None:
    text = "id,X,Y,Z,mx,my,mz\nA,1043823,743011,250,0.1,0.2,0.3\n"
    assert read(tmp_path, text).points[0].sigma_m == (0.2, 0.1, 0.3)


def test_sigmas_may_be_millimetres__truth(tmp_path: Path) -> None:
    text = "id;X;Y;Z;m_xy [mm];mz [mm]\nA;-743011;-1043823;250;20;35\n"
    assert read(tmp_path, text).points[0].sigma_m == pytest.approx((0.02, 0.02, 0.035))


@pytest.mark.parametrize(
    ("word", "role"),
    [("Kontrolní", "check"), ("vlícovací", "control"), ("CHECK", "check"), ("výškový", "height"),
     ("Passpunkt", "control"), ("XY", "plan")],
)  # fmt: skip
def test_roles_are_read_in_several_languages__truth(tmp_path: Path, word: str, role: str) -> None:
    assert read(tmp_path, f"id,X,Y,Z,role\nA,-743011,-1043823,250,{word}\n").points[0].role == role


def test_degrees_are_asked_about_and_then_brought_by_proj__oracle(tmp_path: Path) -> None:
    there = Transformer.from_crs("EPSG:32633", "EPSG:4326", always_xy=True)
    east, north = there.transform(460_000.0, 5_550_000.0)
    text = f"id,X,Y,Z\nA,{north:.9f},{east:.9f},300\n"
    asked = read(tmp_path, text, UTM)
    assert [question.about for question in asked.questions] == ["crs"]
    assert asked.questions[0].choices[0].value == "EPSG:4326"
    found = read(tmp_path, text, UTM, replace(asked.reading, crs="EPSG:4326"))
    assert found.questions == ()
    place = (found.points[0].easting, found.points[0].northing)
    np.testing.assert_allclose(place, (460_000, 5_550_000), atol=0.001)


def test_points_beyond_the_block_are_left_out_only_when_asked__truth(tmp_path: Path) -> None:
    text = "id,X,Y,Z\nA,-745000,-1045000,300\nB,-600000,-1100000,300\n"
    found = read(tmp_path, text)
    assert [question.about for question in found.questions] == ["outside"]
    without = read(
        tmp_path, text, reading=PointListReading(outside="leave out", refused="leave out")
    )
    assert [point.point_id for point in without.points] == ["A"]
    assert "145" in without.refused[0].cause
    assert not without.questions
    kept = read(tmp_path, text, reading=PointListReading(outside="keep"))
    assert len(kept.points) == 2


def test_one_of_two_differing_rows_holds_as_answered__truth(tmp_path: Path) -> None:
    text = "id,X,Y,Z\nA,-745000,-1045000,300\nA,-745001,-1045000,300\n"
    assert [question.about for question in read(tmp_path, text).questions] == ["duplicates"]
    for answer, east in (("first", -745000), ("last", -745001)):
        found = read(tmp_path, text, reading=PointListReading(duplicates=answer))
        assert [point.easting for point in found.points] == [east]


REAL = (
    ("sxb-strasbourg/script_sxb/reference/sxb-control.txt", "EPSG:2154",
     (999e3, 112e3, 1000.5e3, 113e3), 16, ("317", 999604.58, 112344.443, 139.453)),
    ("film-blocks-numeric/addis-ababa-2002-rmktop15/GCPs/gcp.txt", "EPSG:32637",
     (483e3, 993e3, 485e3, 996e3), 6, ("1", 483404.75, 995082.83, 2363.62)),
    ("film-blocks-numeric/addis-ababa-2002-rmktop15/ground_points.csv", "EPSG:32637",
     (483e3, 993e3, 485e3, 996e3), 6, ("1", 483404.75, 995082.83, 2363.62)),
    ("exchange-samples/ign-opk-borea/dataset/GCP_test.app", "EPSG:2154",
     (815e3, 6281e3, 839e3, 6285e3), 3, ("1003", 815601.51, 6283629.28, 54.96)),
)  # fmt: skip


@pytest.mark.parametrize(("file", "crs", "bounds", "count", "first"), REAL)
def test_lists_of_others_are_read_as_they_stand__real(
    shared_data: Path, file: str, crs: str, bounds: tuple[float, ...], count: int, first: tuple
) -> None:
    west, south, east, north = bounds
    found = read_point_list(shared_data / file, Surroundings(crs, (west, south, east, north)))
    assert {question.about for question in found.questions} <= {"refused"}
    assert len(found.points) == count
    point = found.points[0]
    assert (point.point_id, point.easting, point.northing, point.height) == first
