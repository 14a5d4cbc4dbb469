"""`kill -9` anywhere: the next start goes on, no decision is lost, the results are the same."""

import json
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import rasterio

from app.cli import main
from app.run import STAGE_NAMES as EVERY_STAGE
from app.run import WHEN_ASKED
from core.synthetic.truth import read_truth
from sessions.decisions import Accept, Recorded, Reject, Withdraw
from sessions.session import Session
from tests.forked import Forked
from tests.journeys.copies import BlockCopy, copied, nearly_placed, run_alone

SCANS = 2
KILLS_A_STAGE = 1
ROWS_OF_DECISIONS = 12
STAGE_NAMES = [name for name in EVERY_STAGE if name not in WHEN_ASKED]
BEFORE_DECISIONS = STAGE_NAMES.index("adjustment")
TABLES = (
    "control_points.csv",
    "check_points.csv",
    "interior_orientation.csv",
    "exterior_orientation.csv",
    "tie_points.csv",
)


@dataclass(frozen=True)
class Outcome:
    """Two runs of one block: left alone, and killed all the time."""

    calm: BlockCopy
    killed: BlockCopy
    kills: dict[str, int]
    acknowledged: list[int]
    decided: tuple[Recorded, ...]
    most_left_over: int


@pytest.fixture(scope="module")
def outcome(tiny_block: Path, tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Kills in every stage and in rows of decisions, then the same decisions in peace."""
    folder = tmp_path_factory.mktemp("kills")
    calm = copied(tiny_block, folder / "calm", SCANS)
    killed = copied(tiny_block, folder / "killed", SCANS)
    for copy in (calm, killed):
        nearly_placed(copy, read_truth(tiny_block))
    rng = np.random.default_rng(20)
    seconds = finished(calm, "--until", "adjustment", "--workers", "1")
    kills: dict[str, int] = {}
    left: list[int] = []
    for stage in STAGE_NAMES[:BEFORE_DECISIONS]:
        kills[stage] = kill_in(killed, stage, seconds[stage], rng, left)
    finished(killed, "--until", "control")
    acknowledged = [number for _ in range(ROWS_OF_DECISIONS) for number in decide(killed, rng)]
    with Session.open(killed.folder, "reader") as session:
        decided = session.decisions()
    with Session.open(calm.folder, "operator") as session:
        for recorded in decided:
            session.record(recorded.decision)
    seconds |= finished(calm, "--workers", "1")
    for stage in STAGE_NAMES[BEFORE_DECISIONS:]:
        kills[stage] = kill_in(killed, stage, seconds[stage], rng, left)
    finished(killed)
    return Outcome(calm, killed, kills, acknowledged, decided, max(left))


def finished(copy: BlockCopy, *arguments: str) -> dict[str, float]:
    """A run that is left alone; seconds of each stage."""
    told = run_alone("--log-json", "run", copy.folder, *arguments)
    assert (told.code, told.err) == (0, "")
    events = [json.loads(line) for line in told.out.splitlines()]
    return {event["stage"]: event["seconds"] for event in events if event["event"] == "done"}


def decide_without_end(folder: Path, pairs: list[tuple[str, str]]) -> int:
    """Decides, and says of each decision that it is on the disk."""
    with Session.open(folder, "operator") as session:
        number = 0
        for count in range(10_000):
            pair = pairs[count % len(pairs)]
            decision = Reject(*pair, "changed") if count % 7 == 3 else Accept(*pair)
            if count % 5 == 4:
                decision = Withdraw(number)
            number = session.record(decision).decision_id
            sys.stdout.write(f"{number}\n")
            sys.stdout.flush()
    return 0


def kill_in(
    copy: BlockCopy, stage: str, seconds: float, rng: np.random.Generator, left: list[int]
) -> int:
    """Runs killed at random times within a stage; how many of them were not over before."""
    kills = 0
    arguments = ["--log-json", "run", str(copy.folder), "--workers", "2"]
    for _ in range(KILLS_A_STAGE):
        with Forked(main, arguments) as process:
            for line in process.out:
                if json.loads(line) == {"event": "stage", "stage": stage}:
                    break
            time.sleep(rng.uniform(0, seconds))
            process.kill()
            kills += process.ended().code == -signal.SIGKILL
        left.append(len(left_over(copy)))
    return kills


def decide(copy: BlockCopy, rng: np.random.Generator) -> list[int]:
    """A row of decisions, killed in the middle; the numbers that were said to be on the disk."""
    with Session.open(copy.folder, "reader") as session:
        assembly = session.products.latest_value("control")
    pairs = [key for key, value in assembly.report.block.measurements.items() if value.used]
    with Forked(decide_without_end, copy.folder, pairs) as process:
        said = [int(process.out.readline()) for _ in range(rng.integers(3, 9))]
        time.sleep(rng.uniform(0, 0.02))
        process.kill()
        return said + [int(line) for line in process.ended().out.splitlines()]


def left_over(copy: BlockCopy) -> list[Path]:
    """Temporaries anywhere in the block's folder."""
    return [*copy.folder.rglob(".*part-*"), *copy.folder.rglob("*-journal")]


def pixels(path: Path) -> np.ndarray:
    with rasterio.open(path) as file:
        return file.read()


@pytest.mark.slow
def test_every_stage_and_rows_of_decisions_were_killed__law(outcome: Outcome) -> None:
    assert set(outcome.kills) == set(STAGE_NAMES)
    assert sum(outcome.kills.values()) + ROWS_OF_DECISIONS >= 20


@pytest.mark.slow
def test_no_decision_is_lost_and_none_is_made_up__law(outcome: Outcome) -> None:
    numbers = [recorded.decision_id for recorded in outcome.decided]
    assert numbers == list(range(1, len(numbers) + 1))
    assert set(outcome.acknowledged) <= set(numbers)
    # At each kill one more may have reached the disk than was said.
    assert len(numbers) <= len(outcome.acknowledged) + ROWS_OF_DECISIONS
    with Session.open(outcome.killed.folder, "reader") as session:
        assert session.decisions() == outcome.decided


@pytest.mark.slow
@pytest.mark.parametrize("table", TABLES)
def test_tables_are_those_of_an_undisturbed_run__law(table: str, outcome: Outcome) -> None:
    ours = (outcome.killed.results / table).read_bytes()
    assert ours == (outcome.calm.results / table).read_bytes()
    assert ours.count(b"\n") > 1 or table == "check_points.csv"


@pytest.mark.slow
def test_rasters_are_those_of_an_undisturbed_run__law(outcome: Outcome) -> None:
    calm, killed = outcome.calm.results, outcome.killed.results
    rasters = sorted(path.relative_to(calm) for path in calm.rglob("*.tif"))
    assert rasters == sorted(path.relative_to(killed) for path in killed.rglob("*.tif"))
    assert Path("mosaic.tif") in rasters
    for raster in rasters:
        np.testing.assert_array_equal(pixels(killed / raster), pixels(calm / raster))


@pytest.mark.slow
def test_kills_leave_nothing_behind__law(outcome: Outcome) -> None:
    assert not left_over(outcome.killed)
    assert outcome.most_left_over <= 4, "leftovers of one kill, not of several"
    products = outcome.killed.folder / ".gruber" / "products"
    for stage in STAGE_NAMES[: BEFORE_DECISIONS + 1]:
        assert len(list((products / stage).glob("*.value"))) == 1
    calm = {path.relative_to(outcome.calm.folder) for path in outcome.calm.folder.rglob("*")}
    names = {path.relative_to(outcome.killed.folder) for path in outcome.killed.folder.rglob("*")}
    assert {path for path in names if path.suffix != ".value"} == {
        path for path in calm if path.suffix != ".value"
    }
