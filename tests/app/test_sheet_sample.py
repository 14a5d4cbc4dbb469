"""`gruber check sheets`: a sample on disk, with all that lets somebody else draw it again."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from app.cli import main
from app.project import read_project
from app.sheet_sample import draw_sample
from app.sheets import FOLDER
from core.errors import ProjectError
from core.sheets.acceptance import draw_sheets
from core.sheets.delivery import Delivery
from sessions.checks import version_on_disk
from sessions.session import Session
from sessions.sheet_samples import is_unchanged, sample_of, sheets_on_disk, standing_samples
from tests.sessions.test_sheet_samples import cut, delivered
from tests.tiny import Tiny

LOT = Delivery(tuple(delivered(f"S{n:02d}", east=100.0 * n) for n in range(30)), 0)


@pytest.fixture
def folder(tiny_run: Tiny, tmp_path: Path) -> Path:
    """A copy of the block that was run, of which thirty map sheets were cut."""
    copied = tmp_path / "block"
    shutil.copytree(tiny_run.folder, copied)
    with Session.open(copied, "ada") as session:
        lot = replace(LOT, mosaic=version_on_disk(session.products))
        cut(session, lot)
    return copied


def test_a_sample_is_recorded_with_seed_digest_and_operator__truth(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "sheets", str(folder), "--operator", "ada", "--seed", "7"]) == 0
    told = capsys.readouterr().out
    with Session.open(folder, "bob") as session:
        (drawn,) = standing_samples(session.decisions())
        lot = sheets_on_disk(session.products, version_on_disk(session.products))
    sample = sample_of(drawn)
    assert (drawn.who, sample.seed, is_unchanged(sample)) == ("ada", 7, True)
    assert sample.sheets == draw_sheets(lot, sample.plan, 7)
    assert all(word in told for word in ("15 sheets drawn of 30", sample.digest, "8.4 times"))
    assert sample.sheets[3].name in told


def test_without_a_seed_nobody_knows_the_sheets_beforehand__law(folder: Path) -> None:
    with Session.open(folder, "ada") as session:
        samples = [draw_sample(read_project(folder), session) for _ in range(4)]
        assert standing_samples(session.decisions()) == ()
    assert len({one.seed for one in samples}) == 4
    assert len({tuple(sheet.name for sheet in one.sheets) for one in samples}) > 1


def test_a_block_without_sheets_says_how_to_make_them__truth(tiny_block: Path) -> None:
    with (
        Session.open(tiny_block, "ada") as session,
        pytest.raises(ProjectError, match=r"no map sheets yet[^\n]*\n?.*\[sheets\]"),
    ):
        draw_sample(read_project(tiny_block), session)


def test_sheets_that_are_gone_from_the_disk_are_no_lot__truth(folder: Path) -> None:
    """Somebody would have judged, and signed, sheets that nobody can be given."""
    for name in ("S03", "S07"):
        (folder / "results" / FOLDER / f"{name}.geotiff").unlink()
    with (
        Session.open(folder, "ada") as session,
        pytest.raises(ProjectError, match=r"S03\.geotiff: is gone; files of map sheets.*: 2"),
    ):
        draw_sample(read_project(folder), session)
