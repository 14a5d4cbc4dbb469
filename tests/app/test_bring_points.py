"""Lists of surveyed points into a block: whole, or with a word and not at all."""

import shutil
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from app.bring_points import bring_points, ground_of, known_block, reading_of, surroundings
from app.project import read_project
from core.errors import PhotogrammetryError
from core.exchange import fit_to_format
from core.formats.exchange_formats import FORMATS
from core.formats.listed_point import PointListReading
from core.formats.point_files import write_points
from core.formats.point_list import read_point_list
from core.geometry.crs import operation_between
from core.geometry.heights import ELLIPSOIDAL, FAR_M
from core.raster.dem import open_dem
from sessions.decisions import BringPoints
from sessions.session import Session
from tests.tiny import Tiny

EAST, NORTH = -577_300.0, -1_193_400.0
"""In the middle of the tiny block."""
GOOD = f"G1,{EAST},{NORTH},250\nG2,{EAST + 50},{NORTH + 50},251\n"


def zipped() -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")
    return stream.getvalue()


def rows(*more: str, header: str = "id,X,Y,Z") -> bytes:
    return "\n".join([header, *GOOD.splitlines(), *more]).encode()


ERRORS: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "holds no rows"),
    "only blank lines": (b"\n \n\t\n", "holds no rows"),
    "a header alone": (b"id,X,Y,Z\n", "holds no rows"),
    "only comments": (b"# nothing\n# yet\n", "holds no rows"),
    "spreadsheet": (zipped(), "spreadsheet"),
    "old spreadsheet": (b"\xd0\xcf\x11\xe0" + bytes(600), "spreadsheet"),
    "pdf": (b"%PDF-1.7 id,X,Y,Z", "spreadsheet, picture or archive"),
    "tiff": (b"II*\x00" + bytes(100), "picture"),
    "gzip": (b"\x1f\x8b\x08" + bytes(50), "archive"),
    "xml": (b"<?xml version='1.0'?><p/>", "XML or JSON"),
    "xml bomb": (b'<!DOCTYPE a [<!ENTITY b "cc">]><a>&b;</a>', "XML or JSON"),
    "geojson": (b'{"type": "FeatureCollection"}', "XML or JSON"),
    "noughts": (b"id,X,Y,Z\nA,1\x00,2,3\n", "is no text"),
    "no letters of cp1250": (b"id,X,Y,Z\n\x81\x83,1,2,3\n", "is no text in cp1250"),
    "odd utf-16": (b"\xff\xfei\x00d\x00,", "is no text in utf-16"),
}
"""Files that are no table: an error that names the file."""
QUESTIONS: dict[str, tuple[bytes, str]] = {
    "no heights": (b"id,X,Y\nA,1,2\nB,3,4\n", "columns"),
    "no names": (f"X,Y,Z\n{EAST},{NORTH},250\n".encode(), "columns"),
    "no coordinates": (b"id,role\nA,control\n", "columns"),
    "prose": (b"Dear colleague,\nplease find the points attached.\n", "columns"),
    "two eastings": (f"id,X,Easting,Y,Z\nA,{EAST},{EAST},{NORTH},250\n".encode(), "columns"),
    "kilometres": (b"id,X [km],Y [km],Z\nA,-577.3,-1193.4,250\n", "columns"),
    "feet": (b"id,X (ft),Y (ft),Z (ft)\nA,-1908792,-3931102,820\n", "columns"),
    "only words": (b"id,X,Y,Z\nA,one,two,three\n", "columns"),
    "swapped": (f"id,X,Y,Z\nA,{NORTH},{EAST},250\n".encode(), "axes"),
    "eastings swapped": (f"id,E,N,H\nA,{NORTH},{EAST},250\n".encode(), "axes"),
    "positive eastings": (f"id,E,N,H\nA,{-EAST},{-NORTH},250\n".encode(), "axes"),
    "degrees": (b"id,X,Y,Z\nA,16.939,48.923,250\nB,16.940,48.922,250\n", "crs"),
    "degrees, latitude first": (b"id,X,Y,Z\nA,48.923,16.939,250\n", "crs"),
    "degrees elsewhere": (b"id,X,Y,Z\nA,2.35,48.85,35\n", "crs"),
    "another zone": (b"id,X,Y,Z\nA,642034,5420697,250\n", "crs"),
    "another country": (b"id,X,Y,Z\nA,999604.58,112344.443,139.4\n", "outside"),
    "a height of another column": (rows(f"A,{EAST + 20},{NORTH},2500"), "heights"),
    "a digit too many": (rows(f"A,{EAST * 10},{NORTH},250"), "outside"),
    "local coordinates": (b"id,X,Y,Z\nA,1000,5000,250\nB,1010,5010,250\n", "outside"),
    "two of one name": (rows(f"G1,{EAST + 9},{NORTH},250"), "duplicates"),
    "two of one name after a blank": (rows(f" G1 ,{EAST},{NORTH},999"), "duplicates"),
}
"""Tables that leave something open: a question, and nothing comes in."""
REFUSED: dict[str, tuple[bytes, str]] = {
    "a word for a number": (rows(f"A,{EAST},{NORTH},high"), "Z is 'high'"),
    "an empty northing": (rows(f"A,{EAST},,250"), "Y is empty"),
    "cut off": (rows("A,-5773"), "Y is empty"),
    "no name": (rows(f",{EAST},{NORTH},250"), "no name"),
    "nan": (rows(f"A,{EAST},nan,250"), "Y is 'nan'"),
    "infinite": (rows(f"A,{EAST},{NORTH},1e999"), "Z is '1e999'"),
    "no height": (rows(f"A,{EAST},{NORTH},-9999"), "no height"),
    "millimetres": (rows(f"A,{EAST},{NORTH},250000"), "no height"),
    "a unit": (rows(f"A,{EAST},{NORTH},250 m"), "Z is '250 m'"),
    "decimal commas in commas": (rows("A,-577300,25,-1193400,50,250,1"), "7 cells"),
    "thousands in commas": (rows("A,-577,300,-1,193,400,250"), "7 cells"),
    "two decimal signs": (rows(f'A,{EAST},{NORTH},"250,125"'), "Z is '250,125'"),
    "degrees, minutes": (rows("A,16°43'20\",49°08'53\",250"), "X is '16"),
    "an open quote": (rows(f'"A,{EAST},{NORTH},250'), "X is empty"),
    "a name of two lines": (rows(f"A\x0bB,{EAST},{NORTH},250"), "name cannot be used"),
    "a name without end": (rows(f"{'A' * 200},{EAST},{NORTH},250"), "name cannot be used"),
    "a sum at the end": (rows("total,2"), "Y is empty"),
    "an unknown role": (rows(f"A,{EAST},{NORTH},250,tie", header="id,X,Y,Z,role"), "'tie'"),
    "a sigma of nought": (
        rows(f"A,{EAST},{NORTH},250,0", header="id,X,Y,Z,mxy"),
        "sigma_xy is '0'",
    ),
    "a sigma below nought": (rows(f"A,{EAST},{NORTH},250,-1", header="id,X,Y,Z,mz"), "sigma_Z"),
    "a sigma in words": (rows(f"A,{EAST},{NORTH},250,good", header="id,X,Y,Z,mx"), "'good'"),
    "a footprint's formula": (rows("A,=B1,=B2,250"), "X is '=B1'"),
}
"""Tables with a row that brings no point: a word on it, and whether the rest comes in is asked."""


@pytest.fixture(scope="module")
def block(tiny_run: Tiny, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shutil.copytree(tiny_run.folder, tmp_path_factory.mktemp("brought") / "block")


def brought(block: Path, folder: Path, content: bytes, reading: PointListReading | None = None):
    path = folder / "points.csv"
    path.write_bytes(content)
    project = read_project(block)
    with Session.open(block, "anna") as session:
        before = len(session.decisions())
        try:
            found = bring_points(project, session, path, reading)
        finally:
            made = session.decisions()[before:]
        return found, [one.decision for one in made]


def test_there_are_fifty_broken_lists__truth() -> None:
    assert len(ERRORS) + len(QUESTIONS) + len(REFUSED) >= 50


@pytest.mark.parametrize("name", ERRORS)
def test_what_is_no_table_is_an_error_with_file_cause_and_remedy__truth(block, tmp_path, name):
    content, said = ERRORS[name]
    with pytest.raises(PhotogrammetryError) as told:
        brought(block, tmp_path, content)
    assert said in told.value.cause
    assert told.value.file.endswith("points.csv")
    assert told.value.remedy


def test_a_height_far_off_the_dem_is_told_with_file_point_and_both_heights__truth(block, tmp_path):
    content, _ = QUESTIONS["a height of another column"]
    found, _ = brought(block, tmp_path, content)
    (question,) = found.found.questions
    assert question.words.startswith("points.csv: 1 height is far off the DEM, such as A at 2500.0")
    left, (decision,) = brought(
        block, tmp_path, content, PointListReading(heights="leave out", refused="leave out")
    )
    assert [point.point_id for point in decision.points] == ["G1", "G2"]
    assert "2500.0 m, where the DEM has" in left.found.refused[0].cause
    _, (kept,) = brought(block, tmp_path, content, PointListReading(heights="keep"))
    assert len(kept.points) == 3
    with Session.open(block, "anna") as session:
        session.undo()
        session.undo()


@pytest.mark.parametrize(
    ("head", "above_m", "words"),
    [
        ("Z", 44.7, "points.csv: heights of 3 points lie +44.7 m off the DEM"),
        ("h_ellipsoidal", 44.7, "points.csv: heights of 3 points lie +44.7 m off the DEM"),
        ("ellipsoidal height [m]", 0.0, "the list says that its heights are ellipsoidal"),
        ("elipsoidická výška", 0.0, "the list says that its heights are ellipsoidal"),
        ("Z", 3.0, ""),
    ],
)
def test_heights_of_another_system_are_asked_about__truth(block, tmp_path, head, above_m, words):
    project = read_project(block)
    plan = np.array([[EAST, NORTH], [EAST + 50, NORTH + 50], [EAST - 50, NORTH]])
    dem = open_dem(project.reference.dem, project.block.crs)
    ground = dem.heights(plan).tolist()
    lines = [
        f"E{n},{east},{north},{height + above_m}"
        for n, ((east, north), height) in enumerate(zip(plan.tolist(), ground, strict=True))
    ]
    content = "\n".join([f"id,X,Y,{head}", *lines]).encode()
    path = tmp_path / "points.csv"
    path.write_bytes(content)
    around = surroundings(project.block.crs, None, ground_of(project, dem))
    asked = read_point_list(path, around).questions
    assert [one.about for one in asked] == (["height_system"] if words else [])
    assert all(words in one.words for one in asked)
    answered = read_point_list(path, around, reading_of(["height_system=keep"]))
    assert (answered.questions, len(answered.points)) == ((), 3)
    # A block whose own heights are ellipsoidal is asked only where the DEM is against it.
    own = replace(around, ground=replace(around.ground, system=ELLIPSOIDAL))
    assert len(read_point_list(path, own).questions) == (above_m > FAR_M)


@pytest.mark.parametrize("name", QUESTIONS)
def test_what_a_list_leaves_open_is_asked_and_nothing_comes_in__truth(block, tmp_path, name):
    content, about = QUESTIONS[name]
    found, made = brought(block, tmp_path, content)
    assert found.found.questions[0].about == about
    assert found.found.questions[0].words
    assert (found.recorded, made) == (None, [])


@pytest.mark.parametrize("name", REFUSED)
def test_a_row_that_is_refused_has_its_word_and_the_rest_waits__truth(block, tmp_path, name):
    content, said = REFUSED[name]
    found, made = brought(block, tmp_path, content)
    assert said in found.found.refused[0].cause
    assert found.found.refused[0].remedy
    assert found.found.refused[0].number == 4
    assert [question.about for question in found.found.questions] == ["refused"]
    assert (found.recorded, made) == (None, [])
    assert [point.point_id for point in found.found.points] == ["G1", "G2"]


def test_a_whole_list_comes_in_by_one_decision_and_goes_by_one_undo__truth(block, tmp_path):
    found, made = brought(block, tmp_path, b"id,X,Y,Z\n" + GOOD.encode())
    assert made == [BringPoints(found.found.points, "points.csv")]
    with Session.open(block, "anna") as session:
        ours = known_block(read_project(block), session)
        assert ours is not None
        assert ours.surveyed["G1"].source == "surveyed"
        session.undo()
        gone = known_block(read_project(block), session)
        assert gone is not None
        assert "G1" not in gone.surveyed


def test_answered_the_rest_comes_in__truth(block, tmp_path):
    content = REFUSED["nan"][0]
    _, made = brought(block, tmp_path, content, PointListReading(refused="leave out"))
    assert [point.point_id for point in made[0].points] == ["G1", "G2"]
    found, again = brought(block, tmp_path, b"id,X,Y,Z\n" + GOOD.encode())
    assert (len(again), found.replaced) == (1, ("G1", "G2"))


def test_a_name_the_engine_has_given_is_refused__truth(block, tmp_path):
    with Session.open(block, "anna") as session:
        ours = known_block(read_project(block), session)
        assert ours is not None
        taken = next(name for name, one in ours.surveyed.items() if one.source != "surveyed")
    found, made = brought(block, tmp_path, rows(f"{taken},{EAST},{NORTH},250"))
    assert "of another kind" in found.found.refused[0].cause
    assert made == []


def test_points_the_block_found_itself_stay_its_own__truth(block, tmp_path):
    """An exported list comes back: the block's own points stand as found, the others come in."""
    with Session.open(block, "anna") as session:
        ours = known_block(read_project(block), session)
        assert ours is not None
    out = fit_to_format(ours, None, FORMATS["points"])
    write_points(tmp_path / "out.csv", out)
    own = {name for name, one in ours.surveyed.items() if one.source != "surveyed"}
    assert own & set(out.points)
    found, made = brought(block, tmp_path, (tmp_path / "out.csv").read_bytes())
    assert found.found.refused == ()
    assert {point.point_id for point in made[0].points} == set(out.points) - own
    assert any("own and stay as found" in line for line in found.found.evidence)


def test_the_crs_above_a_list_counts__truth(block, tmp_path):
    """A list that says another CRS is read in it; one that says nonsense is read in the block's."""
    east, north = operation_between(
        "EPSG:5514", "EPSG:32633", np.array([[EAST, NORTH]]), ""
    ).forward(np.array([[EAST, NORTH]]))[0]
    text = f"# CRS: EPSG:32633\nid,X,Y,Z\nU1,{east:.3f},{north:.3f},250\n"
    _, made = brought(block, tmp_path, text.encode())
    point = made[0].points[0]
    assert (point.easting, point.northing) == pytest.approx((EAST, NORTH), abs=0.01)
    _, made = brought(block, tmp_path, b"# CRS: ours\nid,X,Y,Z\n" + GOOD.encode())
    assert len(made[0].points) == 2
