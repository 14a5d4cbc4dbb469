"""Surveyed points for MicMac, where XML and text lie side by side."""

from pathlib import Path

import pytest

from core.errors import ExchangeError, ProjectError
from core.formats.exchange import ExchangeBlock, ExchangePoint
from core.formats.micmac import read_micmac, write_micmac
from core.formats.micmac_points import (
    image_measures_name,
    read_camera_measures,
    read_image_measures,
    write_camera_measures,
    write_image_measures,
)


def test_names_with_blanks_do_not_come_back_twice__law(tmp_path: Path) -> None:
    points = {
        name: ExchangePoint(name, (1.0, 2.0, 3.0), (0.1, 0.1, 0.2))
        for name in ("church spire", "4711")
    }
    write_micmac(tmp_path, ExchangeBlock(points=points))
    assert read_micmac(tmp_path).points == points


MARKS = {"P1": (-106.0, 106.002), "P2": (105.998, 106.0), "P3": (106.0, -106.0)}


def test_pixels_come_back_with_the_half_pixel__law(tmp_path: Path) -> None:
    path = tmp_path / image_measures_name("a.tif")
    write_image_measures(path, "a.tif", {"P1": (0.5, 10.25), "P2": (99.125, 3.0)})
    assert "<PtIm>0.0 9.75</PtIm>" in path.read_text()
    assert read_image_measures(path) == {"a.tif": {"P1": (0.5, 10.25), "P2": (99.125, 3.0)}}


def test_the_camera_comes_back_about_its_middle__law(tmp_path: Path) -> None:
    write_camera_measures(tmp_path / "MeasuresCamera.xml", MARKS)
    back = read_camera_measures(tmp_path / "MeasuresCamera.xml")
    for name, (x, y) in MARKS.items():
        assert back[name] == pytest.approx((x - (-0.001 + 0.001), y - 0.001), abs=2.1e-3)
    assert back["P2"][0] - back["P1"][0] == pytest.approx(211.998, abs=1e-6)
    assert back["P3"][1] - back["P2"][1] == pytest.approx(-212.0, abs=1e-6)


def test_a_centred_camera_is_taken_as_certified__truth(tmp_path: Path) -> None:
    path = tmp_path / "MeasuresCamera.xml"
    path.write_text(
        "<MesureAppuiFlottant1Im><NameIm>Glob</NameIm><OneMesureAF1I><NamePt> P1 </NamePt>"
        "<PtIm> 106.004  -106.002 </PtIm></OneMesureAF1I></MesureAppuiFlottant1Im>"
    )
    assert read_camera_measures(path) == {"P1": (106.004, -106.002)}


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "no whole XML"),
        ("<a>", "no whole XML"),
        ("<a/>", "holds no marks"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><a/>", "declares entities"),
        (
            "<MesureAppuiFlottant1Im><OneMesureAF1I><NamePt>1</NamePt><PtIm>1 x</PtIm>"
            "</OneMesureAF1I></MesureAppuiFlottant1Im>",
            "where 2 numbers must stand",
        ),
    ],
)
def test_files_without_marks_say_so__truth(tmp_path: Path, content: str, told: str) -> None:
    path = tmp_path / "MeasuresIm-a.tif.xml"
    path.write_text(content)
    with pytest.raises(ExchangeError, match=told):
        read_image_measures(path)
    with pytest.raises(ProjectError, match="cannot be read"):
        read_camera_measures(tmp_path / "nothing.xml")
