"""Second journey: a decision is recorded, the block adjusted anew, and all taken back again."""

import numpy as np
import pytest
import rasterio

from sessions.decisions import Reject
from sessions.session import Session
from tests.journeys.copies import run_alone
from tests.journeys.test_scan_to_mosaic import product, table, tables
from tests.tiny import Tiny


def rasters(folder):
    """Grey values of the mosaic and of every ortho."""
    files = [folder / "results" / "mosaic.tif", *sorted((folder / "results" / "ortho").glob("*"))]
    values = {}
    for path in files:
        with rasterio.open(path) as raster:
            values[path.name] = raster.read(1)
    return values


@pytest.fixture(scope="module")
def rejected(tiny_run: Tiny):
    """Before; a used control measurement rejected and the block run again; afterwards undone."""
    folder = tiny_run.folder
    before = tables(folder), product(folder, "adjustment"), rasters(folder)
    used = [
        row
        for row in table(folder / "results" / "control_points.csv")
        if row["status"] == "auto" and row["role"] == "control"
    ]
    largest = max(
        used, key=lambda row: np.hypot(float(row["residual_col"]), float(row["residual_row"]))
    )
    key = largest["point_id"], largest["scan"]
    with Session.open(folder, "operator") as session:
        session.record(Reject(*key, "wrong object"), before[1].block)
    assert run_alone("run", folder).code == 0
    yield key, before
    with Session.open(folder, "operator") as session:
        undone = list(iter(session.undo, None))
    # The last test has undone it and run already, unless it failed or was left out.
    assert not undone or run_alone("run", folder).code == 0


def test_a_decision_stands_although_the_run_was_never_finished__law(tiny_run, rejected):
    """Recorded is recorded: a new session, as after a crash, finds it and so does the report."""
    key, _ = rejected
    with Session.open(tiny_run.folder, "somebody else") as session:
        last = session.decisions()[-1]
        block = session.replayed(product(tiny_run.folder, "control").report.block)
    assert (last.who, last.decision) == ("operator", Reject(*key, "wrong object"))
    assert block.measurements[key].status == "rejected"


def test_a_rejected_point_no_longer_steers_and_undo_brings_all_back__law(tiny_run, rejected):
    """The last one: it takes the decision back."""
    folder = tiny_run.folder
    key, (told, report, pictures) = rejected
    rows = {
        (row["point_id"], row["scan"]): row
        for row in table(folder / "results" / "control_points.csv")
    }
    assert (rows[key]["status"], rows[key]["reason"]) == ("rejected", "wrong object")
    # Prediction minus measurement: what the operator rejected is still told.
    assert float(rows[key]["residual_col"]) != 0.0
    now = product(folder, "adjustment")
    assert now.sigma_nought != report.sigma_nought
    assert now.redundancy < report.redundancy
    assert not now.block.measurements[key].used
    assert tables(folder)["exterior_orientation.csv"] != told["exterior_orientation.csv"]
    centres = [
        [photo.exterior.centre for photo in block.photos.values()]
        for block in (report.block, now.block)
    ]
    # One point of many: nothing leaps.
    assert np.abs(np.subtract(*centres)).max() < 5.0

    with Session.open(folder, "operator") as session:
        assert session.undo() is not None
    assert run_alone("run", folder).code == 0
    assert tables(folder) == told
    again = product(folder, "adjustment")
    assert again.sigma_nought == report.sigma_nought
    for name, values in rasters(folder).items():
        np.testing.assert_array_equal(values, pictures[name])
