"""Lists at the desk: looked at, asked about, handed in as one decision."""

import numpy as np
import pytest

from app.desk.listed_points import DeskPoints, reading_of
from core.errors import ProjectError
from core.formats.listed_point import PointListReading
from core.formats.point_axes import Ground
from sessions.decisions import BringPoints
from sessions.session import Session
from tests.ui.desk_block import tiny_block


@pytest.fixture
def handed():
    return []


@pytest.fixture
def points(tmp_path, handed):
    return DeskPoints(tiny_block().block, tmp_path, handed.append, Ground())


def place():
    west, south, east, north = tiny_block().block.bounds
    return (west + east) / 2, (south + north) / 2


def listed(*rows):
    return "\n".join(["id,X,Y,Z", *rows]).encode()


def test_a_list_is_shown_as_it_would_come_in__truth(points, handed):
    east, north = place()
    page = points.read("a.csv", listed(f"G1,{east},{north},250", f"G2,{east},,250"), {})
    assert page["points"] == [["G1", east, north, "control"]]
    assert page["rows"][0][:2] == [2, "G1"]
    assert (page["refused_count"], page["refused"][0]["number"]) == (1, 3)
    assert [asked["about"] for asked in page["questions"]] == ["refused"]
    assert len(page["footprints"]) == len(tiny_block().block.photos)
    assert handed == []


def test_what_is_asked_is_answered_and_then_handed_in__truth(points, handed):
    east, north = place()
    data = listed(f"G1,{east},{north},250", f"G2,{east},,250")
    assert points.bring("s", "a.csv", data, {})["questions"]
    assert handed == []
    assert points.bring("s", "a.csv", data, {"refused": "leave out"}) == {"brought": 1}
    decision = handed[0].decision
    assert isinstance(decision, BringPoints)
    assert ([one.point_id for one in decision.points], decision.source) == (["G1"], "a.csv")


def test_heights_off_the_dem_all_alike_are_asked_about__truth(tmp_path, handed):
    level = Ground(lambda plan: np.full(len(plan), 205.7), 0.5)
    points = DeskPoints(tiny_block().block, tmp_path, handed.append, level)
    east, north = place()
    data = listed(f"G1,{east},{north},250", f"G2,{east + 9},{north},250.2")
    (asked,) = points.bring("s", "a.csv", data, {})["questions"]
    assert asked["about"] == "height_system"
    assert asked["words"].startswith("a.csv: heights of 2 points lie +44.4 m off the DEM")
    answer = {asked["about"]: asked["choices"][0]["value"]}
    assert points.bring("s", "a.csv", data, answer) == {"brought": 2}


def test_a_known_point_is_given_back_to_be_corrected__truth(points, handed, tmp_path):
    east, north = place()
    assert points.known("G1") == {}
    data = f"id,X,Y,Z,role,popis\nG1,{east},{north},250,check,stone\n".encode()
    points.bring("s", "", data, {})
    with Session.open(tmp_path, "anna") as session:
        session.record(handed[0].decision)
    known = points.known(" G1 ")
    assert known["position"] == [east, north, 250.0]
    assert (known["role"], known["description"], known["sigma"]) == ("check", "stone", [0.1, 0.1])


def test_an_error_names_the_list_and_no_place_on_disk__truth(points):
    with pytest.raises(ProjectError) as told:
        points.read("C:\\lists\\a.xlsx", b"PK\x03\x04", {})
    assert told.value.file == "a.xlsx"


def test_only_what_a_page_can_choose_is_read__law():
    chosen = {"delimiter": ";", "axes": "-N -E", "header": True, "columns": ["id", "rm -rf"],
              "role": "check", "sigma_plan_m": 0.5}  # fmt: skip
    assert reading_of(chosen) == PointListReading(
        delimiter=";", axes="-N -E", header=True, columns=("id", ""), role="check", sigma_plan_m=0.5
    )
    wrong = {"delimiter": ";;", "axes": "up", "header": "yes", "columns": 3, "role": "king",
             "sigma_plan_m": -1, "refused": "perhaps", "other": 1}  # fmt: skip
    assert reading_of(wrong) == PointListReading()
