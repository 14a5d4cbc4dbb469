"""The adjustment's protocol as text and JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.report.protocol import write_protocol
from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of

PLAIN = AdjustmentOptions()
PARTS = (
    "ADJUSTMENT OF block", "A-PRIORI STANDARD DEVIATIONS", "RESULT", "CLASSES OF OBSERVATIONS",
    "CAMERAS AND SHARED PARAMETERS", "TIE POINTS", "PHOTOS", "ON THE GROUND", "CONTROL POINTS",
    "ENOUGH AND WELL SPREAD", "CHECK POINTS", "EXTERIOR ORIENTATION", "OBSERVATIONS LEFT OUT",
)  # fmt: skip


@pytest.fixture(scope="module")
def written(report, tmp_path_factory):
    folder = tmp_path_factory.mktemp("protocol")
    text, figures = write_protocol(folder, "block", report, PLAIN, influence_of(report, PLAIN))
    return text.read_text(encoding="utf-8"), json.loads(figures.read_text(encoding="utf-8"))


def test_every_part_is_told_in_its_order__law(written):
    text, _ = written
    places = [text.index(part) for part in PARTS]
    assert places == sorted(places)
    assert "nan" not in text


def test_methods_are_compared_where_that_is_asked_for__law(written, report, tmp_path):
    text, f = written
    assert f["methods"] == []
    assert "METHODS" not in text
    both = write_protocol(tmp_path, "block", report, AdjustmentOptions(compare_methods=True), None)
    text, figures = (path.read_text(encoding="utf-8") for path in both)
    rows = {row["method"]: row for row in json.loads(figures)["methods"]}
    assert list(rows) == ["strips", "models", "bundle"]
    assert rows["bundle"]["centres_m"] == [0.0, 0.0, 0.0]
    assert max(rows["models"]["centres_m"]) < 50
    assert text.index("CHECK POINTS\n") < text.index("METHODS COMPARED") < text.index("EXTERIOR O")


def test_figures_are_those_of_the_report__law(written, report):
    _, f = written
    assert f["quality"]["sigma_nought"] == report.sigma_nought
    assert f["block"]["strips"] == 2
    assert {row["strip"] for row in f["photos"]} == {1, 2}
    assert f["classes"]["tie"]["observations"] == 2 * f["ties"]["rays"]
    seen = np.isfinite(report.tie_residuals_px[:, 0])
    assert f["ties"]["rays"] == seen.sum()
    assert sum(f["ties"]["within_strips"].values()) + sum(
        f["ties"]["across_strips"].values()
    ) == len(np.unique(report.block.ties.point[seen]))
    assert len(f["control"]["measurements"]) == len(report.redundancy_numbers)
    assert len(f["exterior"]["photos"]) == 6
    assert len(f["excluded"]["tie_rays"]) == len(report.tie_reasons)
    assert all(row["reason"] for row in f["excluded"]["tie_rays"])
    statuses = {row["status"] for row in f["excluded"]["control"]}
    assert {"rejected", "unused", "dubious"} <= statuses


@pytest.mark.parametrize("applied", [("refraction", "curvature"), ("curvature",), ()])
def test_corrections_are_told_as_they_were_applied__truth(report, tmp_path, applied):
    photos = {n: replace(p, corrections=applied) for n, p in report.block.photos.items()}
    given = replace(report, block=replace(report.block, photos=photos))
    text, figures = write_protocol(tmp_path, "block", given, PLAIN, None)
    told = ", ".join("on" if one in applied else "off" for one in ("refraction", "curvature"))
    assert f"refraction, curvature   {told}\n" in text.read_text(encoding="utf-8")
    options = json.loads(figures.read_text(encoding="utf-8"))["options"]
    assert options["refraction"] == ("refraction" in applied)
    assert options["earth_curvature"] == ("curvature" in applied)


def test_reliability_is_told_in_words__law(written):
    _, f = written
    for row in f["control"]["measurements"]:
        weak = row["redundancy_number"] < 0.1
        assert weak == (row["says"] == "cannot be checked by any other")
        assert row["smallest_detectable_px"] > 0
        assert row["its_effect_on_the_ground_m"] >= 0
    checks = f["checks"]
    assert len(checks["points"]) > 5
    ratio = np.hypot(*checks["rms_m"][:2]) / np.hypot(*checks["predicted_rms_m"][:2])
    assert 0.4 < ratio < 2.0
    for row in f["photos"]:
        assert set(row["ground_sigma_m"]) == {"NW", "N", "NE", "W", "centre", "E", "SW", "S", "SE"}


def test_places_for_more_control_are_told_the_most_useful_first__law(written):
    text, f = written
    spread = f["control_spread"]
    assert spread["rules"]["plan"]["points"] == len(f["control"]["points"])
    then = [want["worst_then_m"] for want in spread["wanted"]]
    assert len(then) == 5
    assert then == sorted(then, reverse=True)
    assert all(want["sigma_then_m"] < want["sigma_now_m"] for want in spread["wanted"])
    assert f"1. a point in {spread['wanted'][0]['scan']}" in text


def test_a_block_without_orientation_has_a_protocol_too__law(report, tmp_path):
    photos = {n: replace(p, oriented=False) for n, p in report.block.photos.items()}
    bare = adjust_block(report.block.with_photos(photos))
    text, figures = write_protocol(tmp_path, "block", bare, PLAIN, influence_of(bare, PLAIN))
    assert "no-photo-oriented" in text.read_text(encoding="utf-8")
    assert json.loads(figures.read_text(encoding="utf-8"))["quality"]["sigma_nought"] is None
