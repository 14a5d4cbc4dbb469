"""Drawings are whole SVG, and show what they are given."""

from pathlib import Path
from xml.etree import ElementTree

import app.report.drawing as drawing
from app.report.drawing import (
    draw_coverage,
    draw_map,
    draw_mosaic,
    draw_symbols,
)
from ui.words.catalogue import Teller

TELL = Teller()


def parts_of(svg):
    return [part.tag.split("}")[-1] for part in ElementTree.fromstring(str(svg)).iter()]


def test_every_kind_of_vector_has_a_colour__law():
    page = (Path(drawing.__file__).parent / "page.css").read_text(encoding="utf-8")
    for kind in ("control", "check", "tie"):
        assert f".{kind}line {{ stroke: " in page


def test_the_map_is_one_drawing__law(written):
    drawing, enlarged = draw_map(written[1]["map"], TELL)
    assert parts_of(drawing)[0] == "svg"
    assert enlarged is None or enlarged > 0


def test_coverage_and_seams_are_drawn__law(written):
    assert parts_of(draw_coverage(written[1]["coverage"][0]))[0] == "svg"
    mosaic = {**written[1]["mosaic"], "holes": [{"area_m2": 900.0, "east": 0.0, "north": 0.0}]}
    parts = parts_of(draw_mosaic(mosaic, "data:image/jpeg;base64,", TELL))
    assert parts[0] == "svg"
    assert parts.count("polygon") == sum(len(seam["rings"]) for seam in mosaic["seams"])
    assert parts.count("circle") == 1


def test_the_legend_shows_what_the_map_draws__truth(written):
    """The legend showed dots where the map has crosses and triangles."""
    drawing = ElementTree.fromstring(str(draw_map(written[1]["map"], TELL)[0]))
    on_map = {part.get("class"): part.tag for part in drawing.iter() if part.get("class")}
    symbols = draw_symbols(TELL)
    assert len(symbols) == 5
    for symbol in symbols.values():
        (shape,) = ElementTree.fromstring(str(symbol))
        assert on_map[shape.get("class")] == shape.tag
