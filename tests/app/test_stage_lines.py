"""What each stage made, in one line."""

import numpy as np

from app.stage_lines import STAGE_LINES, last_lines, lines_at_once
from core.doubts import Doubt
from core.georeference.stage import Georeferenced
from core.quality.job_rules import JobRules
from core.results import StageResults
from core.scans.stage import ScanSet
from core.ties.stage import Tied
from tests.flights import FlightPlan, fly


def test_each_value_is_told_in_one_line__truth():
    flight = fly(FlightPlan(ties=40, control=6, check=2), np.random.default_rng(0))
    block = flight.block
    doubts: tuple[Doubt, ...] = ()
    results = StageResults(
        scans=ScanSet({}, {}, doubts),
        georeference=Georeferenced(block, {}, {"x": "why"}, doubts),
        ties=Tied(block.ties, doubts, {}),
    )
    assert STAGE_LINES["georeference"](results) == "6 photos placed, 1 set aside"
    assert STAGE_LINES["scans"](results) == "0 scans, 0 set aside, no fiducials"
    assert STAGE_LINES["ties"](results).startswith("40 tie points")


def test_what_the_reference_lacks_is_told_at_once_and_not_again__law():
    block = fly(FlightPlan(ties=40, control=6, check=2), np.random.default_rng(0)).block
    doubts = (
        Doubt("dem-holes", "dem.tif", "dem.tif has no heights in 1 place."),
        Doubt("map-scale", "block", "The block is far from the meridian."),
    )
    results = StageResults(georeference=Georeferenced(block, {}, {}, doubts))
    assert lines_at_once("scans", results) == []
    assert lines_at_once("georeference", results) == ["Doubt: dem.tif has no heights in 1 place."]
    last = last_lines(results, doubts, JobRules(), "report.html")
    assert last == ["Doubt: The block is far from the meridian."]
