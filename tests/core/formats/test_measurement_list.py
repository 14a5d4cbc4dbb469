"""Lists of measurements: our own form there and back, foreign heads, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from core.errors import ProjectError
from core.formats.exchange import ExchangeBlock, ExchangeMeasurement, ExchangeTies
from core.formats.measurement_list import (
    MeasurementReading,
    read_measurement_list,
    read_measurements,
    write_measurements,
)
from core.formats.tie_list import USUAL_SIGMA_PX, read_ties, write_ties

TIES = ExchangeTies(
    ("a", "b"),
    np.array([0, 0, 1, 1]),
    np.array([0, 1, 0, 1]),
    np.array([[1.25, 2.5], [3.0, 4.0], [5.0, 6.0], [7.0, 8.125]]),
    ("T0", "P1"),
    sigma_px=np.array([0.3, 0.3, np.nan, np.nan]),
)


def written(folder: Path, text: str) -> Path:
    path = folder / "list.csv"
    path.write_text(text, encoding="utf-8")
    return path


def places(path: Path, **reading: object) -> list[tuple[str, str, float, float]]:
    found = read_measurement_list(path, MeasurementReading(**reading))
    return [(row.name, row.scan, row.column, row.line) for row in found.rows]


def test_what_is_written_is_read_again__law(tmp_path: Path) -> None:
    measured = (ExchangeMeasurement("P1", "a", 10.1, 20.2, 0.5),)
    path = tmp_path / "list.csv"
    write_measurements(path, ExchangeBlock(measurements=measured, ties=TIES))
    rows = read_measurement_list(path).rows
    assert (rows[0].name, rows[0].column, rows[0].line, rows[0].sigma_px) == ("P1", 10.1, 20.2, 0.5)
    # A tie point called as a surveyed one is not taken for it.
    assert [row.name for row in rows[1:]] == ["T0", "T0", "P1-tie", "P1-tie"]
    assert [[row.column, row.line] for row in rows[1:]] == TIES.pixels.tolist()
    assert [row.sigma_px for row in rows[1:3]] == [0.3, 0.3]
    assert np.isnan(rows[3].sigma_px)


def test_a_list_of_ties_is_the_same_form__law(tmp_path: Path) -> None:
    path = tmp_path / "ties.csv"
    write_ties(path, TIES)
    again = read_ties(path, ("a", "b"))
    assert again.names == TIES.names
    assert np.array_equal(again.pixels, TIES.pixels)
    assert again.sigma_px.tolist() == [0.3, 0.3, USUAL_SIGMA_PX, USUAL_SIGMA_PX]
    assert read_measurements(path).ties.names == TIES.names


def test_a_list_of_ties_may_have_the_heads_of_other_programs__truth(tmp_path: Path) -> None:
    path = written(tmp_path, "point_id;image;px_x;px_y\n7;a.tif;1,5;2\n7;b.tif;3;4\n")
    ties = read_ties(path, ("a", "b"))
    assert (ties.photo_ids, ties.names) == (("a", "b"), ("7",))
    assert ties.pixels.tolist() == [[1.5, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize(
    "text",
    [
        "point_id,image,px_x,px_y\nP,a,10,20\n",
        "Photo\tMarker\tX [px]\tY [px]\na\tP\t10\t20\n",
        "# a comment\nname scan column row\nP a 10 20\n",
    ],
)
def test_heads_of_programs_are_known__truth(tmp_path: Path, text: str) -> None:
    assert places(written(tmp_path, text)) == [("P", "a", 10.0, 20.0)]


def test_columns_may_be_said__truth(tmp_path: Path) -> None:
    columns = ("scan", "", "point", "column", "row")
    headed = written(tmp_path, "A,B,C,D,E\na,x,P,10,20\n")
    assert places(headed, columns=columns) == [("P", "a", 10.0, 20.0)]
    assert places(written(tmp_path, "a,x,P,10,20\n"), columns=columns) == [("P", "a", 10.0, 20.0)]


def test_pixels_from_the_middle_are_half_a_pixel_further__law(tmp_path: Path) -> None:
    path = written(tmp_path, "point,scan,column,row\nP,a,0,0\n")
    assert places(path, origin="middle") == [("P", "a", 0.5, 0.5)]


def test_rows_that_are_not_used_are_counted__truth(tmp_path: Path) -> None:
    path = written(tmp_path, "point,scan,column,row,used\nP,a,1,2,TRUE\nQ,a,3,4,FALSE\n")
    found = read_measurement_list(path)
    assert ([row.name for row in found.rows], found.unused) == (["P"], 1)


def test_fiducials_are_those_of_their_scans__truth(tmp_path: Path) -> None:
    path = written(tmp_path, "image,fiducial,px_x,px_y\na,1,10,20\na,2,30,40\nb,1,50,60\n")
    block = read_measurements(path)
    assert block.photos["a"].fiducials_px == {"1": (10.0, 20.0), "2": (30.0, 40.0)}
    assert block.photos["b"].fiducials_px == {"1": (50.0, 60.0)}
    with pytest.raises(ProjectError, match="holds fiducials"):
        read_ties(path, ("a", "b"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("scan,column,row\na,1,2\n", "point / fiducial is missing"),
        ("point,scan,column,x,row\nP,a,1,1,2\n", "Several columns hold column: column, x"),
        ("point,scan,column,row\nP,a,1,2\nP,a.tif,1,2\n", "Line 3: P stands twice"),
        ("point,scan,column,row\nP,a,1,two\n", "Line 2: 'two' is not a number"),
        ("point,scan,column,row,sigma\nP,a,1,2,0\n", "Line 2: the standard deviation 0"),
        ("point,scan,column,row\nP,,1,2\n", "Line 2: the column scan is empty"),
        ("point,scan,column,row\n", "holds no rows"),
        ("", "holds no rows"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_line__truth(
    tmp_path: Path, text: str, told: str
) -> None:
    with pytest.raises(ProjectError, match=told):
        read_measurement_list(written(tmp_path, text))


def test_names_that_were_guarded_come_back_and_empty_first_cells_stay__truth(
    tmp_path: Path,
) -> None:
    path = tmp_path / "list.csv"
    path.write_text("point,scan,column,row\n'@12,a.tif,1,2\n")
    assert [row.name for row in read_measurement_list(path).rows] == ["@12"]
    path.write_text("used\tpoint\tscan\tcolumn\trow\n\tP\ta.tif\t1\t2\n")
    assert [row.name for row in read_measurement_list(path).rows] == ["P"]
