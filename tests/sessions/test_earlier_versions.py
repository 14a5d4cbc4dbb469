"""A block of an earlier version opens with every decision, its products and its control."""

import zipfile
from pathlib import Path

import pytest

from core.control.stage import ControlFound
from core.georeference.stage import Georeferenced
from core.scans.stage import ScanSet
from sessions.decisions import Accept, MarkDubious, MarkNotVisible, Place, Reject, SetRole, Withdraw
from sessions.session import Session

STORED = Path(__file__).parent / "stored" / "block-414331f.zip"
"""A tiny demo block, run and reviewed with version 414331f; scans and reference left out."""
FIRST, SECOND = "LMSA08.1938.SYNT25.00465", "LMSA08.1938.SYNT25.00493"
AS_IT_STOOD = {
    ("J-5816419_-11981534", FIRST): "accepted",
    ("J-5816419_-11981534", SECOND): "rejected",
    ("J-5816916_-11986636", SECOND): "dubious",
    ("J-5817444_-11979071", FIRST): "rejected",
    ("J-5817444_-11979071", SECOND): "auto",
    ("J-5818029_-11973827", FIRST): "auto",
    ("J-5819362_-11976307", FIRST): "accepted",
}
"""What that version said of these measurements."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with zipfile.ZipFile(STORED) as stored:
        stored.extractall(tmp_path)
    return tmp_path


def test_every_decision_is_read_in_its_order__oracle(folder):
    with Session.open(folder, "Bob") as session:
        recorded = session.decisions()
    assert [type(one.decision) for one in recorded] == [
        *(Accept, Reject, MarkDubious, MarkNotVisible, Reject, Withdraw, SetRole, Place)
    ]
    assert {one.who for one in recorded} == {"Anna"}
    assert recorded[1].decision.reason == "changed"


def test_products_are_read_whole__oracle(folder):
    with Session.open(folder, "Bob") as session:
        read = {
            stage: session.products.latest_value(stage)
            for stage in ("scans", "georeference", "control", "adjustment")
        }
    assert isinstance(read["scans"], ScanSet)
    assert isinstance(read["georeference"], Georeferenced)
    assert isinstance(read["control"], ControlFound)
    assert len(read["control"].report.block.photos) == 6
    assert round(read["control"].report.sigma_nought, 2) == 0.96
    assert read["adjustment"].sigma_nought == pytest.approx(read["control"].report.sigma_nought)


def test_decisions_lie_over_the_block_as_they_did__oracle(folder):
    with Session.open(folder, "Bob") as session:
        control = session.products.latest_value("control")
        block = session.replayed(control.report.block)
    assert {key: block.measurements[key].status for key in AS_IT_STOOD} == AS_IT_STOOD
    assert block.surveyed["J-5818358_-11983277"].role == "check"
    moved, before = (
        one.measurements["J-5819362_-11976307", FIRST] for one in (block, control.report.block)
    )
    assert (moved.column - before.column, moved.row - before.row) == pytest.approx((1.25, -0.5))
