"""Drawings are whole SVG, and show what they are given."""

from xml.etree import ElementTree

import pytest

from app.report.drawing import draw_bars, draw_coverage, draw_map, draw_seams


def parts_of(svg):
    return [part.tag.split("}")[-1] for part in ElementTree.fromstring(str(svg)).iter()]


def test_the_map_is_one_drawing__law(written):
    drawing, enlarged = draw_map(written[1]["map"])
    assert parts_of(drawing)[0] == "svg"
    assert enlarged is None or enlarged > 0


def test_bars_are_as_high_as_their_numbers__truth():
    drawing = str(draw_bars({"2": 10, "3": 30}, "rays"))
    bars = [part for part in ElementTree.fromstring(drawing).iter() if part.tag.endswith("rect")]
    heights = [float(bar.get("height")) for bar in bars]
    assert heights[-1] == pytest.approx(3 * heights[-2], rel=0.02)


def test_coverage_and_seams_are_drawn__law(written):
    assert parts_of(draw_coverage(written[1]["coverage"][0]))[0] == "svg"
    assert parts_of(draw_seams(written[1]["mosaic"]))[0] == "svg"
