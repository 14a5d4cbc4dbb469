"""Plots show the numbers they are given, as parts of one page."""

import re
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from app.report.plots import (
    FILM,
    LONGEST,
    PALETTE,
    draw_bars,
    draw_film,
    draw_histogram,
    draw_reliability,
    draw_trend,
    longest_mean,
)
from ui.words.catalogue import Teller

TELL = Teller()
HISTOGRAM = {"counts": [1, 5, 20, 5, 1], "count": 32, "rms_px": 0.5, "reach_px": 2.0}


def places(path):
    """Corners of a path, pixels."""
    found = re.findall(r"[ML] ([-\d.]+) ([-\d.]+)", path.get("d") or "")
    return np.array(found, dtype=float).reshape(-1, 2)


def shapes(svg, colour):
    """Corners of each shape that is filled with a colour."""
    return [
        places(part)
        for part in ElementTree.fromstring(str(svg)).iter()
        if part.tag.endswith("path") and f"fill: {PALETTE[colour]}" in (part.get("style") or "")
    ]


def words(svg):
    return {part.text for part in ElementTree.fromstring(str(svg)).iter() if part.text}


def test_bars_are_as_high_as_their_numbers__truth():
    heights = [np.ptp(bar[:, 1]) for bar in shapes(draw_bars({"2": 10, "3": 30}, TELL), "accent")]
    assert heights[1] == pytest.approx(3 * heights[0], rel=0.02)
    assert {"2", "3", "10", "30", "rays"} <= words(draw_bars({"2": 10, "3": 30}, TELL))
    assert not draw_bars({}, TELL)


def test_a_histogram_is_as_high_as_its_counts__truth():
    heights = [np.ptp(bar[:, 1]) for bar in shapes(draw_histogram(HISTOGRAM, TELL), "accent")]
    assert heights == pytest.approx([n * max(heights) / 20 for n in (1, 5, 20, 5, 1)], rel=0.01)


def test_the_curve_is_the_normal_distribution_of_the_rms__truth():
    """Its foot to its top is the density at nought, times count and width of a bar."""
    svg = draw_histogram(HISTOGRAM, TELL)
    (curve,) = (
        places(part)
        for part in ElementTree.fromstring(str(svg)).iter()
        if f"stroke: {PALETTE['bad']}" in (part.get("style") or "")
    )
    tallest = max(np.ptp(bar[:, 1]) for bar in shapes(svg, "accent"))
    expected = 32 * 0.8 / (0.5 * np.sqrt(2 * np.pi))
    assert np.ptp(curve[:, 1]) / tallest == pytest.approx(expected / 20, rel=0.01)


def test_numbers_are_written_as_the_language_writes_them__law():
    assert "\u22120,5" in words(draw_histogram(HISTOGRAM, Teller("cs")))
    assert not any("," in word for word in words(draw_histogram(HISTOGRAM, TELL)))


def test_arrows_of_a_film_have_one_scale_for_all_photos__truth(written):
    films = written[1]["residuals"]["films"]
    longest = longest_mean(films)
    assert longest > 0
    lengths = []
    for film in films.values():
        for arrow in shapes(draw_film(film, longest, TELL), "control"):
            # Where nothing was measured the arrow has no corners.
            lengths += [np.linalg.norm(a - b) for a in arrow for b in arrow]
    cells = len(next(iter(films.values()))["mean_um"])
    inside = 72 * FILM[0] - 6  # points, less the room about the frame
    assert max(lengths) == pytest.approx(LONGEST * inside / cells, rel=0.05)


def test_no_two_plots_of_a_page_share_an_id__law():
    trend = {"along": [1, 2, 3], "mean_px": [0.1, 0.2, -0.1], "sigma_px": [0.1, 0.1, 0.1]}
    bins = [{"stated": 0.3, "borne_out": 0.2, "proposals": 9}]
    film = {"mean_um": [[[1.0, 0.0], [0.5, 0.5]]]}
    plots = [draw_trend(trend, unit, TELL) for unit in ("m", "mm")]
    plots += [draw_histogram(HISTOGRAM, TELL), draw_bars({"2": 1}, TELL)]
    plots += [draw_reliability(bins, TELL), draw_film(film, 1.0, TELL)]
    page = "".join(plots)
    ids = re.findall(r'\bid="([^"]*)"', page)
    assert len(ids) == len(set(ids)) > 4
    assert set(re.findall(r'(?:url\(#|href="#)(\w+)', page)) <= set(ids)
    assert "<style" not in page


def test_the_same_figures_make_the_same_plot__law():
    assert draw_histogram(HISTOGRAM, TELL) == draw_histogram(HISTOGRAM, TELL)


def test_what_draws_plots_is_imported_with_the_first__law():
    """Every start of the program waited for it."""
    told = "import app.report.mosaic, sys; print('matplotlib' in sys.modules)"
    assert subprocess.check_output([sys.executable, "-c", told], text=True) == "False\n"
