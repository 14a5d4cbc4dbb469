"""Walking the stages: what is fresh is kept, what is not is made, what breaks is resumed."""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import app.run
from app.project import described, read_project
from app.run import STAGE_NAMES, Run, RunOptions, adjustment_digest
from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import REFERENCE, ShiftedReference, TiePoints
from core.control.stage import ControlFound
from core.doubts import Doubt
from core.errors import Cancelled, OrientationError, StorageError
from core.georeference.stage import Georeferenced
from core.localisation.initial_orientation import WeakControl
from core.localisation.stage import Localised
from core.pipeline import STAGES, Stage
from core.progress import Progress, Silent
from core.results import StageResults
from core.scans.stage import ScanSet
from core.ties.stage import Tied
from sessions.decisions import Accept, ReadCheck
from sessions.session import Session
from tests.flights import FlightPlan, fly


class Listener:
    """A voice that remembers what it was told."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def stage(self, name: str, title: str) -> Progress:
        return Silent()

    def ended(self, name: str, title: str, seconds: float, said: str) -> None:
        self.lines.append(f"{name}: {said}")

    def say(self, text: str) -> None:
        self.lines.append(text)

    def ended_early(self, why: str) -> None:
        self.say(why)


def value_of(stage: str, text: str) -> Any:
    """What a stage makes, as small as can be, with a word in it."""
    block = fly(FlightPlan(ties=40, control=6, check=2), np.random.default_rng(0)).block
    match stage:
        case "scans":
            return ScanSet({}, {"x": text}, ())
        case "georeference":
            return Georeferenced(block, {}, {"x": text}, ())
        case "localisation":
            return Localised(block, WeakControl.none(), (Doubt("datum", "x", text),))
        case _:
            return Tied(TiePoints.none(), (Doubt("datum", "x", text),), {})


class Kitchen:
    """Two stages that count how often they run; the second needs the first."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tiny_block: Path, folder: Path) -> None:
        self.made: list[str] = []
        self.inputs: dict[str, Any] = {"scans": 1, "georeference": 1}
        self.project = read_project(tiny_block)
        self.folder = folder
        stages = tuple(self.stage(stage) for stage in STAGES[:2])
        monkeypatch.setattr(app.run, "STAGES", stages)
        monkeypatch.setattr(app.run, "STAGE_LINES", defaultdict(lambda: str))
        monkeypatch.setattr(Run, "corrected", lambda walk, scans: scans)
        self.stages = stages

    def stage(self, stage: Stage) -> Stage:
        def run(given, results, work):
            self.made.append(stage.name)
            return value_of(stage.name, f"{self.inputs[stage.name]} of {results}")

        return replace(stage, inputs=lambda given: (self.inputs[stage.name],), run=run)

    def walk(self, last: str = "georeference", first: str | None = None) -> list[str]:
        """Go through the stages; the names of those that were made."""
        self.made.clear()
        with Session.open(self.folder, "cook") as session:
            walk = Run(self.project, session, Listener(), RunOptions(first, last))
            walk.walk()
        return list(self.made)


@pytest.fixture
def kitchen(monkeypatch, tiny_block, tmp_path) -> Kitchen:
    return Kitchen(monkeypatch, tiny_block, tmp_path)


def test_what_is_fresh_is_not_made_again__law(kitchen):
    assert kitchen.walk() == ["scans", "georeference"]
    assert kitchen.walk() == []


def test_another_input_makes_its_stage_and_what_needs_it__law(kitchen):
    kitchen.walk()
    kitchen.inputs["georeference"] = 2
    assert kitchen.walk() == ["georeference"]
    kitchen.inputs["scans"] = 2
    assert kitchen.walk() == ["scans", "georeference"]


def test_another_version_of_a_stage_makes_it_again__law(kitchen, monkeypatch):
    kitchen.walk()
    changed = (kitchen.stages[0], replace(kitchen.stages[1], version=9))
    monkeypatch.setattr(app.run, "STAGES", changed)
    assert kitchen.walk() == ["georeference"]


def test_a_place_on_an_unfit_map_that_was_kept_is_found_out__law(kitchen, monkeypatch):
    """Version 3 of the stage placed photos on maps that are refused since."""
    kept = (kitchen.stages[0], replace(kitchen.stages[1], version=3))
    monkeypatch.setattr(app.run, "STAGES", kept)
    kitchen.walk()
    monkeypatch.setattr(app.run, "STAGES", kitchen.stages)
    assert kitchen.walk() == ["georeference"]


def test_from_makes_a_stage_and_all_after_it__law(kitchen):
    kitchen.walk()
    assert kitchen.walk(first="georeference") == ["georeference"]
    assert kitchen.walk(first="scans") == ["scans", "georeference"]
    assert kitchen.walk(first="mosaic") == []


def test_until_stops_there__law(kitchen):
    assert kitchen.walk(last="scans") == ["scans"]
    assert kitchen.walk() == ["georeference"]


@pytest.mark.parametrize(
    "error", [OrientationError("block", "it fell.", "Try again."), Cancelled(), KeyboardInterrupt()]
)
def test_what_was_made_before_a_stop_is_kept__law(kitchen, monkeypatch, error):
    def breaks(given, made, work):
        raise error

    whole = kitchen.stages
    broken = replace(whole[1], run=breaks)
    monkeypatch.setattr(app.run, "STAGES", (whole[0], broken))
    with pytest.raises(type(error)):
        kitchen.walk()
    monkeypatch.setattr(app.run, "STAGES", whole)
    assert kitchen.walk() == ["georeference"]


def test_a_resumed_run_tells_how_long_each_product_took_to_make__truth(kitchen, monkeypatch):
    """The time told was that of looking through what was there already."""
    clock = [0.0]

    def slow(stage, seconds, stops=False):
        def run(given, results, work):
            clock[0] += seconds
            if stops:
                raise Cancelled
            return stage.run(given, results, work)

        return replace(stage, run=run)

    def walk():
        with Session.open(kitchen.folder, "cook") as session:
            walk = Run(kitchen.project, session, Listener(), RunOptions(None, "georeference"))
            walk.walk()
            return walk.seconds

    monkeypatch.setattr(app.run, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    first, second = kitchen.stages
    monkeypatch.setattr(app.run, "STAGES", (slow(first, 70.0), slow(second, 5.0, stops=True)))
    with pytest.raises(Cancelled):
        walk()
    monkeypatch.setattr(app.run, "STAGES", (slow(first, 1.0), slow(second, 30.0)))
    assert walk() == walk() == {"scans": 70.0, "georeference": 30.0}
    kitchen.inputs["georeference"] = 2
    monkeypatch.setattr(app.run, "STAGES", (slow(first, 1.0), slow(second, 40.0)))
    assert walk() == {"scans": 70.0, "georeference": 40.0}


def test_a_report_without_a_walk_tells_digests_and_times_of_the_last_one__truth(
    kitchen, monkeypatch
):
    """After orthos were made again at the desk the report had lost them."""
    monkeypatch.setattr(app.run, "write_all", lambda *_: None)
    monkeypatch.setattr(Run, "content", lambda walk, progress: None)
    monkeypatch.setattr(Run, "dem", lambda walk: None)
    kitchen.walk()
    with Session.open(kitchen.folder, "cook") as session:
        walk = Run(kitchen.project, session, Listener(), RunOptions())
        walk.seconds, walk.digests = {"scans": 3.0, "ties": 8.5}, {"scans": "3f9a"}
        walk.report(Silent())
        later = Run(kitchen.project, session, Listener(), RunOptions())
        report = adjust_block(fly(FlightPlan(ties=40, control=6), np.random.default_rng(0)).block)
        later.stand_in(report, None, {})
        assert later.seconds == walk.seconds
        assert later.digests == walk.digests
        walk.threads.close()
        later.threads.close()


def test_a_run_ends_with_what_the_block_contradicts__truth(kitchen):
    block = fly(FlightPlan(ties=200, control=20), np.random.default_rng(1)).block
    key = next(key for key in block.measurements if block.surveyed[key[0]].role == "control")
    item = block.measurements[key]
    wrong = replace(item, column=item.column + 60, sigma_px=0.5, status="accepted")
    listener = Listener()
    with Session.open(kitchen.folder, "cook") as session:
        walk = Run(kitchen.project, session, listener, RunOptions(None, "georeference"))
        walk.results = StageResults(adjustment=adjust_block(block.with_measurement(wrong)))
        walk.walk()
    assert listener.lines[-1].startswith(f"{key[0]} in {key[1]} was accepted by hand")


def test_other_decisions_under_the_same_numbers_are_adjusted_anew__law(tmp_path):
    made_from = []
    for name, photo in (("a", "A"), ("b", "B")):
        with Session.open(tmp_path / name, "ada") as session:
            session.record(Accept("P1", photo))
            first = adjustment_digest(session, "", AdjustmentOptions())
            session.record(ReadCheck("1-01", None, None, "m", "blurred"))
            assert adjustment_digest(session, "", AdjustmentOptions()) == first
            assert [item.decision_id for item in session.changing()] == [1]
            made_from.append(first)
    assert made_from[0] != made_from[1]


def test_only_one_walks_at_a_time__law(kitchen):
    with (
        Session.open(kitchen.folder, "first") as session,
        session.running(),
        pytest.raises(StorageError, match="working on this block"),
    ):
        kitchen.walk()


def test_the_engine_s_stages_come_before_what_needs_decisions__law():
    assert (
        *("scans", "georeference", "reference", "localisation", "ties", "control"),
        *("adjustment", "surface", "orthos", "mosaic", "sheets", "report"),
    ) == STAGE_NAMES


def test_the_engine_repeats_until_control_is_final__law(kitchen, monkeypatch):
    """Localisation, ties and control are walked again; `--until ties` ends in the first pass."""

    flight = fly(FlightPlan(ties=40, control=6, check=2), np.random.default_rng(0))
    report = adjust_block(flight.block, AdjustmentOptions())

    def control(given, results, work):
        kitchen.made.append("control")
        before = results.control
        return ControlFound(report, (), passes=1 if before is None else before.passes + 1)

    def other(name):
        def run(given, results, work):
            kitchen.made.append(name)
            return value_of(name, str(len(kitchen.made)))

        return run

    runs = {"localisation": other("localisation"), "ties": other("ties"), "control": control}
    repeated = tuple(
        replace(stage, needs=(), inputs=lambda given: (), run=runs[stage.name])
        for stage in STAGES
        if stage.repeated
    )
    monkeypatch.setattr(app.run, "STAGES", (*kitchen.stages, *repeated))
    monkeypatch.setattr(app.run, "STAGE_NAMES", tuple(s.name for s in app.run.STAGES))
    assert kitchen.walk("ties") == ["scans", "georeference", "localisation", "ties"]
    assert kitchen.walk("control") == ["control", *["localisation", "ties", "control"] * 2]
    assert kitchen.walk("control") == []
    # The first pass was made again since, and the last one is as it was: it is the block still.
    with Session.open(kitchen.folder, "ada") as session:
        (first,) = (session.products.folder / "control").glob("*.value")
        last = session.products.latest_digest("control")
        first.unlink()
        assert kitchen.walk("control") == ["control"]
        assert session.products.latest_digest("control") == last != first.stem


def test_a_block_knows_what_its_reference_may_be_off__law(tiny_run):
    given = described(read_project(tiny_run.folder)).reference
    with Session.open(tiny_run.folder, "ada") as session:
        block = session.products.latest_value("adjustment").block
    sigma_m = (given.ortho_sigma_m, given.ortho_sigma_m, given.dem_sigma_m)
    assert block.reference == ShiftedReference(REFERENCE, sigma_m)
    assert block.reference_error_m(given.ortho_sigma_m) == given.ortho_sigma_m
