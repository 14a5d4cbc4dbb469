"""Findings in words, and a few lines after a run: scans set aside, kinds of grave doubts."""

import json

import pytest

from app.report.wording import LINES, findings, parameter_told, remarks
from core.doubts import Doubt
from ui.words.catalogue import Teller


def doubt(kind: str, subject: str, gravity: float) -> Doubt:
    return Doubt(kind, subject, f"Something is odd about {kind}.", gravity)


def test_scans_set_aside_come_first_and_once__truth():
    aside = {"513": "513.tif: It was cut off. Copy it again."}
    doubts = [doubt("scan-set-aside", "513", 0.8), doubt("datum", "block", 0.9)]
    assert remarks(aside, doubts, "report.html") == [
        "Set aside: 513.tif: It was cut off. Copy it again.",
        "Doubt: block: Something is odd about datum.",
    ]


def test_doubts_of_a_kind_share_a_line_and_small_ones_are_left_to_the_report__truth():
    doubts = [doubt("fiducial", name, 0.7) for name in ("513", "514", "515")] + [
        doubt("roads", "layer", 0.3)
    ]
    assert remarks({}, doubts, "report.html") == [
        "Doubt: 513: Something is odd about fiducial. (2 more like this)"
    ]


def test_no_more_lines_than_can_be_read__truth():
    aside = {str(number): f"{number}.tif: cut off." for number in range(30)}
    told = remarks(aside, [doubt("datum", "block", 0.9)], "results/report.html")
    assert len(told) == LINES + 1
    assert told[-1] == "... 23 more in results/report.html"


def test_nothing_to_tell_is_not_told__law():
    assert remarks({}, [], "report.html") == []


@pytest.mark.parametrize(
    ("value", "said"), [(1.0, "as large as"), (1.5, "larger"), (0.5, "smaller")]
)
def test_sigma_nought_is_put_into_words__law(written, value, said):
    figures = json.loads(json.dumps(written[1]))
    figures["adjustment"]["sigma_nought"] = value
    assert said in findings(figures, Teller())["sigma"]


def test_a_crs_without_a_name_is_told_shortly__law(written):
    figures = json.loads(json.dumps(written[1]))
    figures["block"]["crs"] = "+proj=tmerc +lat_0=0 +lon_0=25 +k=1 +datum=WGS84 +units=m"
    told = findings(figures, Teller("cs"))["subtitle"]
    assert "nepojmenovaný systém (Transverse Mercator)" in told
    assert "+proj" not in told


@pytest.mark.parametrize(("name", "said"), [
    ("principal_distance_mm", "konstanta komory, mm"),
    ("k1_um wild", "radiální distorze k1, µm wild"), ("gnss_shift_X_m", "posun GNSS X, m"),
    ("misalignment_z_deg", "natočení aparatury vůči komoře z, °"),
    ("flying height", "výška letu"), ("b1_um", "b1_um"),
])  # fmt: skip
def test_parameters_are_told_in_words__truth(name: str, said: str) -> None:
    assert parameter_told(name, Teller("cs")) == said
