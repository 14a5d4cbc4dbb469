"""What the command line answers, and what answers nothing."""

import pytest

from app.answers import check_answers, eo_heads, measurement_reading
from app.bring_points import reading_of
from core.errors import ProjectError
from core.formats.measurement_list import MeasurementReading


def test_answers_say_how_measurements_are_read__truth():
    said = ["columns=scan,,point,column,row", "origin=middle", "sigma=0.3"]
    columns = ("scan", "", "point", "column", "row")
    assert measurement_reading(said) == MeasurementReading(columns, "middle", 0.3)


def test_answers_say_the_accuracy_of_points__truth():
    reading = reading_of(["sigma_xy=0.02", "sigma_Z=0.05"])
    assert (reading.sigma_plan_m, reading.sigma_height_m) == (0.02, 0.05)


def test_answers_say_the_columns_of_orientations__truth():
    assert eo_heads("eo", ["columns=scan,,X,Y,Z"]) == ("scan", "", "X", "Y", "Z")


@pytest.mark.parametrize(
    ("name", "answer", "told"),
    [
        ("measurements", "origin=left", "'left' is no origin"),
        ("measurements", "sigma=0", "sigma is '0'"),
        ("measurements", "sigma=much", "sigma is 'much'"),
        ("measurements", "columns=point,colour", "'colour' is no column"),
        ("measurements", "axes=E N", "answers nothing"),
        ("eo-opk-rad", "columns=scan,easting", "'easting' is no column"),
        ("colmap", "columns=scan", "colmap asks nothing"),
    ],
)
def test_what_answers_nothing_is_refused__truth(name, answer, told):
    with pytest.raises(ProjectError, match=told):
        check_answers(name, [answer])
