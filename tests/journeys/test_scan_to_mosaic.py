"""First journey: from six scans to a mosaic, judged by the truth that was put in."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio

from app.report.tables import write_results
from app.surface import usable_parts
from core.adjustment.adjusted import AdjustmentReport
from core.mosaic.comparison import compare_orthos
from core.synthetic.truth import judge_control, judge_orientations
from sessions.session import Session
from tests.core.control.test_check_points import assert_same
from tests.journeys.copies import run_alone, stages_walked
from tests.tiny import CHECK_POINTS, CONTROL, Tiny

SCAN_PIXEL_M = 1.2
PROMISED = {
    "control_points.csv": "point_id,scan,col,row,X,Y,Z,role,status,score,residual_col,"
    "residual_row,sigma_px,reason",
    "check_points.csv": "point_id,X,Y,Z,dX,dY,dZ,used_scans",
    "exterior_orientation.csv": "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,sigma_X,sigma_Y,sigma_Z,"
    "sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg",
    "tie_points.csv": "point_id,X,Y,Z,sigma_X,sigma_Y,sigma_Z,rays,max_residual_px",
}
"""CONTRACT 4."""


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def tables(folder: Path) -> dict[str, bytes]:
    """What a run tells in tables."""
    return {path.name: path.read_bytes() for path in sorted((folder / "results").glob("*.csv"))}


def product(folder: Path, stage: str):
    with Session.open(folder, "reader") as session:
        return session.products.latest_value(stage)


def made(folder: Path) -> dict[str, int]:
    """When every product and every raster was made, nanoseconds."""
    files = [*(folder / ".gruber" / "products").rglob("*.value"), *folder.rglob("results/**/*.tif")]
    return {str(path.relative_to(folder)): path.stat().st_mtime_ns for path in files}


@pytest.fixture(scope="module")
def report(tiny_run: Tiny) -> AdjustmentReport:
    return product(tiny_run.folder, "adjustment")


def test_every_photo_stands_where_it_was__truth(tiny_run, report):
    judged = judge_orientations(tiny_run.truth, report.block)
    assert judged.photo_ids == tuple(tiny_run.names)
    assert np.sqrt(np.mean(np.square(judged.ground_m))) < 1.5 * SCAN_PIXEL_M
    assert report.converged
    assert 0.7 < report.sigma_nought < 1.4


def test_control_that_is_used_is_right__truth(tiny_run, report):
    """At most one in twenty is more than 3 m off, two and a half pixels of these scans.

    Not none: where a third of the roads and most parcels have changed since 1938, a wrong peak
    within the gate of five pixels looks like a right one, and one that the block does not
    contradict does not harm it either. Nor do junctions that stand a little aside of the map, which
    weigh less: the photos lie much better than their control.
    """
    judged = judge_control(tiny_run.truth, report.block)
    assert judged.used >= 30
    assert judged.wrong_share <= 0.05
    assert judged.rms_m < 1.1 * SCAN_PIXEL_M
    ground_m = judge_orientations(tiny_run.truth, report.block).ground_m
    assert np.sqrt(np.mean(ground_m**2)) < 0.45 * SCAN_PIXEL_M


def test_the_mosaic_lies_on_the_true_ground__truth(tiny_run):
    mosaic = tiny_run.folder / "results" / "mosaic.tif"
    compared = compare_orthos(mosaic, tiny_run.truth.archival_ortho)
    assert compared.n > 100
    assert compared.m_p <= 1.5 * SCAN_PIXEL_M
    with rasterio.open(mosaic) as raster:
        assert raster.crs.to_epsg() == 5514
        assert raster.overviews(1)
        assert (raster.read_masks(1) > 0).mean() > 0.5


def test_check_points_are_as_far_off_as_they_say__truth(tiny_run, report):
    rows = table(tiny_run.folder / "results" / "check_points.csv")
    assert len(rows) == CHECK_POINTS
    plan = np.array([[float(row["dX"]), float(row["dY"])] for row in rows])
    assert np.sqrt(np.mean(np.sum(plan**2, axis=1))) < 1.5 * SCAN_PIXEL_M
    assert all(int(row["used_scans"]) >= 1 for row in rows)
    assert {check.point_id for check in report.checks} == {row["point_id"] for row in rows}


def test_every_result_is_there_with_its_columns__law(tiny_run):
    results = tiny_run.folder / "results"
    for name, columns in PROMISED.items():
        head, *rows = (results / name).read_text(encoding="utf-8").splitlines()
        assert head == columns
        assert rows, name
    interior = table(results / "interior_orientation.csv")
    assert [row["scan"] for row in interior] == tiny_run.names
    assert all(float(row["residual_1_x_um"]) < 100 for row in interior)
    assert {path.stem for path in (results / "ortho").glob("*.tif")} == set(tiny_run.names)
    for name in (
        "mosaic.tif",
        "seams.gpkg",
        "change.gpkg",
        "report.html",
        "report.json",
        "../session.gpkg",
    ):
        assert (results / name).stat().st_size > 0
    json.loads((results / "report.json").read_text(encoding="utf-8"))
    assert not list(results.rglob("*.part*"))
    statuses = {row["status"] for row in table(results / "control_points.csv")}
    assert statuses <= {"auto", "accepted", "rejected", "dubious", "unused"}
    assert {row["role"] for row in table(results / "control_points.csv")} == {"control", "check"}


def test_what_is_used_has_a_residual_and_what_is_not_a_reason__law(tiny_run):
    for row in table(tiny_run.folder / "results" / "control_points.csv"):
        assert row["residual_col"]
        assert row["residual_row"]
        if row["status"] == "unused":
            assert row["reason"]


def test_a_second_run_makes_nothing_anew__law(tiny_run):
    before, told = made(tiny_run.folder), tables(tiny_run.folder)
    assert len(before) > 15
    again = run_alone("run", tiny_run.folder)
    assert again.code == 0
    assert made(tiny_run.folder) == before
    assert tables(tiny_run.folder) == told
    assert again.out.count("(as before)") == stages_walked(tiny_run.folder)


def test_rules_of_the_job_judge_anew_and_make_nothing_anew__law(tiny_run, tmp_path):
    folder = shutil.copytree(tiny_run.folder, tmp_path / "block")
    block = folder / "block.toml"
    text = block.read_text(encoding="utf-8")
    block.write_text(text.replace("[block]", '[block]\nrules = "rules.toml"'), encoding="utf-8")
    (folder / "rules.toml").write_text("control_points = 9000\n", encoding="utf-8")
    before, told = made(folder), tables(folder)
    again = run_alone("run", folder)
    assert again.code == 0
    assert again.out.count("(as before)") == stages_walked(folder)
    assert (made(folder), tables(folder)) == (before, told)
    reports = [
        json.loads((where / "results" / "report.json").read_text(encoding="utf-8"))
        for where in (tiny_run.folder, folder)
    ]
    usual, own = ({one["kind"] for one in report["verdict"]} for report in reports)
    assert "control-few" in own - usual
    asked = {one["rule"]: one["source"] for one in reports[1]["checked"]["rules"]}
    assert [rule for rule, source in asked.items() if source == "job"] == ["control"]
    doubts = (folder / "results" / "adjustment.txt").read_text(encoding="utf-8")
    assert "a block needs 9000" in " ".join(doubts.split())


def test_from_a_stage_it_is_made_again_and_comes_out_the_same__law(tiny_run):
    """The same inputs give the same bytes: METHODS 5.6."""
    folder = tiny_run.folder
    before = made(folder)
    (file,) = (folder / ".gruber" / "products" / "ties").glob("*.value")
    content = file.read_bytes()
    assert run_alone("run", folder, "--from", "ties", "--until", "ties").code == 0
    after = made(folder)
    changed = {name for name in before if after[name] != before[name]}
    times = {name for name in before if Path(name).parent.name == "times"}
    assert changed == {str(file.relative_to(folder)), *times}
    assert file.read_bytes() == content
    assert run_alone("run", folder, "--until", "control").code == 0
    # Nothing is made; of the ties the last pass still counts, not the first, which is newer.
    assert made(folder) == after
    last = folder / ".gruber" / "products" / "ties" / "last"
    assert int(last.read_text(encoding="utf-8").split("/")[1]) > 1


def test_check_points_do_not_steer__law(tiny_run, tmp_path):
    """Without them not a digit of any orientation changes."""
    before = tables(tiny_run.folder)
    folder = shutil.copytree(tiny_run.folder, tmp_path / "block")
    block = folder / "block.toml"
    text = block.read_text(encoding="utf-8")
    assert CONTROL in text
    block.write_text(text.replace(CONTROL, ""), encoding="utf-8")
    assert run_alone("run", folder, "--until", "adjustment").code == 0
    written = write_results(tmp_path, product(folder, "adjustment"))
    without = {path.name: path.read_bytes() for path in written}
    assert len(without["check_points.csv"].splitlines()) == 1
    for name in ("exterior_orientation.csv", "tie_points.csv", "interior_orientation.csv"):
        assert without[name] == before[name], name
    with Session.open(folder, "reader") as plain, Session.open(tiny_run.folder, "reader") as judged:
        for stage in ("localisation", "control", "adjustment"):
            found = [one.products.latest_value(stage) for one in (plain, judged)]
            blocks = [getattr(value, "report", value) for value in found]
            assert_same(*(getattr(value, "block", value) for value in blocks))


def test_orthos_are_given_the_masks_of_their_scans__law(tiny_run):
    """What is not photograph (margin, housings, data strip, marks) is shown in no ortho."""
    with Session.open(tiny_run.folder, "reader") as session:
        oriented = session.products.latest_value("scans").oriented
        usable = usable_parts(session)
        for name in tiny_run.names[:2]:
            mask = usable(name)
            assert mask is not None
            assert 0.4 < mask.mean() < 0.99
            reduction = oriented[name].size_px[0] // mask.shape[1]
            assert (mask == oriented[name].usable(reduction).mask).all()
        assert usable("nobody") is None
