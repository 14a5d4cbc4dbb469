"""What a mask and a placing by hand make again, and what stays fresh."""

import io
from dataclasses import replace
from pathlib import Path

import pytest

import app.run
from app.project import read_project
from app.run import Run, RunOptions
from app.terminal import JsonLines
from core.pipeline import STAGES
from sessions.decisions import DrawMask, PlacePhoto
from sessions.products import digest_of
from sessions.session import Session
from tests.app.test_run import Kitchen


@pytest.fixture
def kitchen(monkeypatch: pytest.MonkeyPatch, tiny_block: Path, tmp_path: Path) -> Kitchen:
    return Kitchen(monkeypatch, tiny_block, tmp_path)


def test_a_mask_makes_again_what_looks_at_the_picture_and_nothing_before__law(
    kitchen: Kitchen, monkeypatch: pytest.MonkeyPatch
) -> None:
    kitchen.inputs["localisation"] = 1
    looking = replace(kitchen.stage(STAGES[3]), needs=("georeference",), repeated=False)
    assert looking.name == "localisation"
    stages = *kitchen.stages, looking
    monkeypatch.setattr(app.run, "STAGES", stages)
    monkeypatch.setattr(app.run, "STAGE_NAMES", [stage.name for stage in stages])
    kitchen.walk(last="localisation")
    with Session.open(kitchen.folder, "ada") as session:
        session.record(DrawMask("x", ((1.0, 1.0), (9.0, 1.0)), 4.0, hides=True))
    assert kitchen.walk(last="localisation") == ["localisation"]
    assert kitchen.walk(last="localisation") == []
    with Session.open(kitchen.folder, "ada") as session:
        session.undo()
    assert kitchen.walk(last="localisation") == ["localisation"]
    assert [stage.name for stage in STAGES if stage.masked] == ["localisation"]


def test_clicks_make_again_where_photos_lie_and_no_scan__law(
    tiny_block: Path, tmp_path: Path
) -> None:
    with Session.open(tmp_path, "ada") as session:
        plain, given = [
            Run(read_project(tiny_block), session, JsonLines(io.StringIO()), RunOptions()).given
            for decision in (None, PlacePhoto("x", ((1.0, 1.0, 2.0, 2.0), (3.0, 3.0, 4.0, 4.0))))
            if decision is None or session.record(decision)
        ]
    same = [digest_of(stage.inputs(plain)) == digest_of(stage.inputs(given)) for stage in STAGES]
    assert [stage.name for stage, one in zip(STAGES, same, strict=True) if not one] == [
        "georeference"
    ]
