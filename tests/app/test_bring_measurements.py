"""Lists of measurements become decisions, tie points and fiducials, whole or not at all."""

from dataclasses import replace
from pathlib import Path

import pytest

from app.bring_measurements import measured_part
from app.desk.listed_points import DeskPoints
from app.desk.messages import Measured
from app.exchange import import_into
from app.project import read_project
from core.block import HAND_SIGMA_PX
from core.errors import ProjectError
from core.exchange import UPRIGHT_SUFFIX
from core.formats.listed_point import ListedPoint
from core.formats.micmac_points import read_image_measures
from core.formats.point_axes import Ground
from core.formats.tie_list import read_ties
from sessions.decisions import BringPoints, Place, standing
from sessions.session import Session
from tests.journeys.copies import BlockCopy, copied
from tests.ui.desk_block import tiny_block as tiny_flight

POINTS = '[control]\npoints = "points.csv"\n'


@pytest.fixture
def block(tiny_block: Path, tmp_path: Path) -> BlockCopy:
    copy = copied(tiny_block, tmp_path / "block", 2)
    text = (copy.folder / "block.toml").read_text(encoding="utf-8")
    if "points = " not in text:
        copy.replace("points.csv", "id,X,Y,Z\nG1,-544000,-1159000,300\n")
        text = f"{text}\n{POINTS}" if "[control]" not in text else text
    copy.replace("block.toml", text)
    return copy


def listed(block: BlockCopy, *rows: str, head: str = "point,scan,column,row") -> Path:
    first, second = (scan.name for scan in block.scans)
    text = "\n".join([head, *rows]).replace("FIRST", first).replace("SECOND", second)
    path = block.folder.parent / "list.csv"
    path.write_text(text + "\n", encoding="utf-8")
    return path


def known(block: BlockCopy) -> str:
    return read_project(block.folder).control.points.read_text().splitlines()[1].split(",")[0]


def test_known_points_are_decisions_and_others_ties__truth(block: BlockCopy) -> None:
    name = known(block)
    path = listed(
        block, f"{name},FIRST,100.5,200.25", "T,FIRST,10,20", "T,SECOND,30,40", "L,FIRST,1,2",
        "T,other.tif,5,6",
    )  # fmt: skip
    first, second = (scan.stem for scan in block.scans)
    with Session.open(block.folder, "anna") as session:
        brought = import_into(read_project(block.folder), session, "measurements", path)
        decided = [one.decision for one in session.decisions()]
    assert brought.counts == {"measurements": 1, "ties": 1}
    assert decided == [Place(name, first, 100.5, 200.25, HAND_SIGMA_PX)]
    told = " ".join(brought.notes)
    assert "outer corner" in told
    assert "in one scan alone" in told
    assert "1 photo is no scan of this block: other.tif" in told
    ties = read_ties(read_project(block.folder).scans.ties, (first, second))
    assert (ties.names, ties.photo_ids) == (("T",), (first, second))
    assert ties.pixels.tolist() == [[10.0, 20.0], [30.0, 40.0]]


def test_an_import_of_measurements_is_undone__law(block: BlockCopy) -> None:
    path = listed(block, f"{known(block)},FIRST,1,2", f"{known(block)},SECOND,3,4")
    with Session.open(block.folder, "anna") as session:
        import_into(read_project(block.folder), session, "measurements", path)
        session.undo()
        assert not [o for o in standing(session.decisions()) if isinstance(o.decision, Place)]


def test_pixels_and_weights_are_those_of_the_answers__truth(block: BlockCopy) -> None:
    path = listed(block, f"{known(block)},FIRST,1,2")
    with Session.open(block.folder, "anna") as session:
        answers = ("origin=middle", "sigma=0.25")
        brought = import_into(read_project(block.folder), session, "measurements", path, answers)
        (decided,) = (one.decision for one in session.decisions())
    assert decided == Place(known(block), block.scans[0].stem, 1.5, 2.5, 0.25)
    assert brought.notes == ()


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (["T,FIRST,10,20", "T,SECOND,30,999999"], "measures T in .* at column 30.0, row 999999.0"),
        (["T,FIRST,10,-20", "T,SECOND,30,40"], "measures T in .* at column 10.0, row .20.0"),
        (["T,elsewhere.tif,10,20"], "knows no scan of this block"),
    ],
)
def test_a_list_that_is_wrong_in_one_row_brings_nothing__law(
    block: BlockCopy, rows: list[str], told: str
) -> None:
    before = (block.folder / "block.toml").read_text()
    path = listed(block, f"{known(block)},{rows[0].split(',')[1]},1,2", *rows)
    with Session.open(block.folder, "anna") as session:
        with pytest.raises(ProjectError, match=told):
            import_into(read_project(block.folder), session, "measurements", path)
        assert not list(session.decisions())
    assert (block.folder / "block.toml").read_text() == before


def test_fiducials_come_in_by_their_certified_names__truth(block: BlockCopy) -> None:
    project = read_project(block.folder)
    certified = list(project.cameras[project.scans.listed[0].camera].fiducials_mm)
    name, head = certified[0], "fiducial,scan,column,row"
    path = listed(block, f"{name},FIRST,10.5,20.5", f"{name},SECOND,30,40", head=head)
    with Session.open(block.folder, "anna") as session:
        brought = import_into(project, session, "measurements", path)
    assert brought.counts == {"fiducials": 2}
    again = read_project(block.folder).scans.fiducial_measures
    measured = {k: v for file in again for k, v in read_image_measures(file).items()}
    assert measured[block.scans[0].name][name] == pytest.approx((10.5, 20.5))
    wrong = listed(block, "no such mark,FIRST,1,2", head=head)
    with pytest.raises(ProjectError, match="has no fiducial no such mark"):
        measured_part(project, wrong, ())


def test_pixels_of_scans_laid_upright_are_not_those_of_the_scans__law(block: BlockCopy) -> None:
    upright = f"{block.scans[0].stem}{UPRIGHT_SUFFIX}.tif"
    path = listed(block, f"J,{upright},1,2", "T,FIRST,10,20", "T,SECOND,30,40")
    taken = measured_part(read_project(block.folder), path, ("J",))
    assert taken.decisions == ()
    assert f"1 photo is no scan of this block: {upright}" in " ".join(taken.brought.notes)


def test_without_points_everybody_is_told_that_all_are_ties__truth(block: BlockCopy) -> None:
    path = listed(block, "T,FIRST,10,20", "T,SECOND,30,40")
    taken = measured_part(read_project(block.folder), path, ())
    assert "no surveyed points yet" in " ".join(taken.brought.notes)


def test_a_list_comes_in_at_the_desk_as_well__truth(block: BlockCopy) -> None:
    path = listed(block, "J1,FIRST,100.5,200.25", "T,FIRST,10,20", "T,SECOND,30,40")
    flown = tiny_flight().block
    surveyed = {"J1": next(iter(flown.surveyed.values()))}
    handed: list[Measured] = []
    points = DeskPoints(replace(flown, surveyed=surveyed), block.folder, handed.append, Ground())
    reading, data = {"format": "measurements"}, path.read_bytes()
    page = points.read("list.csv", data, reading)
    assert page["counts"] == {"measurements": 1, "ties": 1}
    assert points.bring("seat", "list.csv", data, reading) == {"brought": 2}
    assert handed[0].more == (Place("J1", block.scans[0].stem, 100.5, 200.25, HAND_SIGMA_PX),)
    assert read_project(block.folder).scans.ties is not None


def test_ties_of_an_earlier_import_go_once_their_points_are_surveyed__law(
    block: BlockCopy,
) -> None:
    """Each of their rays counted twice: as a tie, and as control."""
    first, second = (scan.name for scan in block.scans[:2])
    path = listed(block, f"T1,{first},100,200", f"T1,{second},110,210")
    with Session.open(block.folder, "anna") as session:
        import_into(read_project(block.folder), session, "measurements", path)
        assert read_project(block.folder).scans.ties is not None
        place = ListedPoint("T1", -577_500.0, -1_192_900.0, 300.0, (0.1, 0.1, 0.1), "control")
        session.record(BringPoints((place,), "list"))
        brought = import_into(read_project(block.folder), session, "measurements", path)
    assert brought.counts == {"measurements": 2}
    assert read_project(block.folder).scans.ties is None
