"""Figures of a report agree with one another."""

import json

import numpy as np

from app.report.model import gather


def test_coverage_counts_all_used_control__law(written):
    figures = written[1]
    used = sum(figures["control"]["by_status"].get(s, 0) for s in ("auto", "accepted"))
    assert sum(np.sum(photo["control"]) for photo in figures["coverage"]) == used
    rays = sum(int(n) * count for n, count in figures["ties"]["points_by_rays"].items())
    assert rays == figures["ties"]["rays"]


def test_figures_are_those_of_the_json_and_hold_no_nan__law(content, written):
    text = json.dumps(gather(content), allow_nan=False)
    assert json.loads(text).keys() == written[1].keys()
    assert {"block", "adjustment", "checks", "control", "ties", "exterior"} <= written[1].keys()
