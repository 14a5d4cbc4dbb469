"""The session file: whole after every kill, and plain about what is wrong with it."""

import itertools
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from core.errors import StorageError
from sessions import store
from sessions.decisions import Place
from sessions.session import Session
from sessions.store import Migration, Store
from tests.forked import Forked

REPOSITORY = Path(__file__).resolve().parents[2]


def record_for_ever(folder: Path, who: str, pause_s: float) -> int:
    """Records decisions, and tells of each its number and its place."""
    session = Session.open(folder, who)
    for place in itertools.count():
        recorded = session.record(Place("P1", "A", float(place), 0.5))
        tell(recorded.decision_id, place)
        time.sleep(pause_s)
    return 0


def begin_for_ever(folder: Path) -> int:
    """Begins sessions, and tells of each before."""
    for number in itertools.count():
        tell(number, number)
        Store.open(folder / f"{number}.gpkg").close()
    return 0


def begin_one(path: Path) -> int:
    """Begins a session, or opens that which another began, and appends to it."""
    file = Store.open(path)
    file.append("", "x", [("Accept", "{}")])
    file.close()
    return 0


def tell(*numbers: int) -> None:
    sys.stdout.write(f"{numbers[0]} {numbers[1]}\n")
    sys.stdout.flush()


def acknowledged_by(process: Forked, first: str = "") -> dict[int, int]:
    """What a process that was killed had printed: the place by the number of the decision."""
    told = process.ended()
    assert (told.code, told.err) == (-signal.SIGKILL, "")
    lines = [line for line in (first + told.out).splitlines(keepends=True) if line.endswith("\n")]
    return {int(line.split()[0]): int(line.split()[1]) for line in lines}


def append(file: Store, text: str = "{}") -> int:
    return file.append("2026-01-01T00:00:00+00:00", "ada", [("Accept", text)])[0]


def raw(path: Path, sql: str) -> list[tuple[object, ...]]:
    connection = sqlite3.connect(path, isolation_level=None)
    try:
        return connection.execute(sql).fetchall()
    finally:
        connection.close()


def test_decisions_come_back_in_order__truth(tmp_path: Path) -> None:
    file = Store.open(tmp_path / "session.gpkg")
    assert [append(file, f'"{n}"') for n in range(3)] == [1, 2, 3]
    assert [row.decision for row in file.rows(after=1)] == ['"1"', '"2"']
    file.close()
    again = Store.open(tmp_path / "session.gpkg")
    assert [row.decision_id for row in again.rows()] == [1, 2, 3]
    again.close()
    assert [path.name for path in tmp_path.iterdir()] == ["session.gpkg"]


def test_file_is_a_geopackage__paper(tmp_path: Path) -> None:
    """OGC 12-128r18, requirements 2, 10, 11, 13: identity and the required tables and rows."""
    path = tmp_path / "session.gpkg"
    Store.open(path).close()
    assert raw(path, "PRAGMA application_id") == [(0x47504B47,)]
    assert raw(path, "PRAGMA user_version") == [(10400,)]
    srs = {row[0] for row in raw(path, "SELECT srs_id FROM gpkg_spatial_ref_sys")}
    assert srs == {-1, 0, 4326}
    assert raw(path, "PRAGMA foreign_key_check") == []


@pytest.mark.parametrize("sql", ["DELETE FROM decisions", "UPDATE decisions SET who = 'eve'"])
def test_decisions_cannot_be_changed_or_deleted__law(tmp_path: Path, sql: str) -> None:
    path = tmp_path / "session.gpkg"
    file = Store.open(path)
    append(file)
    file.close()
    with pytest.raises(sqlite3.IntegrityError, match="only appended"):
        raw(path, sql)


def test_no_decision_is_lost_when_the_process_is_killed__law(tmp_path: Path) -> None:
    moments = random.Random(20)
    acknowledged: dict[int, int] = {}
    for _ in range(8):
        with Forked(record_for_ever, tmp_path, "ada", 0.0) as process:
            first = process.out.readline()
            time.sleep(moments.uniform(0, 0.08))
            process.kill()
            acknowledged |= acknowledged_by(process, first)
        file = Store.open(tmp_path / "session.gpkg")
        kept = {row.decision_id: row.decision for row in file.rows()}
        file.close()
        assert raw(tmp_path / "session.gpkg", "PRAGMA integrity_check") == [("ok",)]
        for number, value in acknowledged.items():
            assert f'"column": {float(value)}' in kept[number]
        # At most the one that was on disk but not yet told.
        assert len(kept) <= len(acknowledged) + 8
    assert len(acknowledged) >= 8


def test_a_session_killed_while_it_is_begun_can_be_opened__law(tmp_path: Path) -> None:
    moments = random.Random(7)
    for attempt in range(4):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        with Forked(begin_for_ever, folder) as process:
            first = process.out.readline()
            time.sleep(moments.uniform(0, 0.05))
            process.kill()
            begun = acknowledged_by(process, first)
        for number in begun:
            file = Store.open(folder / f"{number}.gpkg")
            assert append(file) == 1
            file.close()


@pytest.mark.parametrize("left", [b"", bytes(512) + b"pages"])
def test_the_journal_of_who_was_killed_at_once_is_taken_away__law(
    tmp_path: Path, left: bytes
) -> None:
    path = tmp_path / "session.gpkg"
    Store.open(path).close()
    journal = tmp_path / "session.gpkg-journal"
    journal.write_bytes(left)
    before = path.stat().st_size
    Store.open(path).close()
    assert not journal.exists()
    assert path.stat().st_size == before


def test_two_processes_append_at_once__law(tmp_path: Path) -> None:
    told: set[int] = set()
    with (
        Forked(record_for_ever, tmp_path, "ada", 0.005) as ada,
        Forked(record_for_ever, tmp_path, "bob", 0.005) as bob,
    ):
        for process in (ada, bob):
            process.out.readline()
        time.sleep(0.3)
        for process in (ada, bob):
            process.kill()
            told |= set(acknowledged_by(process))
    file = Store.open(tmp_path / "session.gpkg")
    rows = file.rows()
    file.close()
    assert told <= {row.decision_id for row in rows}
    assert {row.who for row in rows} == {"ada", "bob"}


def test_two_processes_may_begin_the_same_session__law(tmp_path: Path) -> None:
    path = tmp_path / "session.gpkg"
    with ExitStack() as stack:
        processes = [stack.enter_context(Forked(begin_one, path)) for _ in range(4)]
        ends = [process.ended() for process in processes]
    assert [(told.code, told.err) for told in ends] == [(0, "")] * 4
    assert raw(tmp_path / "session.gpkg", "SELECT count(*) FROM decisions") == [(4,)]


def test_failed_transaction_leaves_nothing__law(tmp_path: Path) -> None:
    file = Store.open(tmp_path / "session.gpkg")
    append(file)
    with pytest.raises(StorageError), file.writing() as transaction:  # noqa: PT012
        transaction.execute("INSERT INTO decisions VALUES (9, '', '', '', '')")
        transaction.execute("INSERT INTO nowhere VALUES (1)")
    assert [row.decision_id for row in file.rows()] == [1]
    assert append(file) == 2
    file.close()


def test_a_file_that_is_no_database_is_told__truth(tmp_path: Path) -> None:
    path = tmp_path / "session.gpkg"
    path.write_text("this is a text file, and long enough to have a header" * 4)
    with pytest.raises(StorageError, match=r"it is no database at all. Move it out"):
        Store.open(path)


def test_another_programs_database_is_told_and_left_alone__truth(tmp_path: Path) -> None:
    path = tmp_path / "session.gpkg"
    raw(path, "CREATE TABLE parcels (id INTEGER)")
    before = path.read_bytes()
    with pytest.raises(StorageError, match="a database, but not a session"):
        Store.open(path)
    assert path.read_bytes() == before


def test_a_newer_session_is_told_and_left_alone__truth(tmp_path: Path) -> None:
    path = tmp_path / "session.gpkg"
    Store.open(path).close()
    raw(path, "UPDATE gruber_version SET version = 99")
    before = path.read_bytes()
    with pytest.raises(StorageError, match=r"newer Gruber \(session version 99, this one knows 1"):
        Store.open(path)
    assert path.read_bytes() == before


def test_an_older_session_is_brought_up_with_its_decisions__truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "session.gpkg"
    file = Store.open(path)
    append(file)
    file.close()
    later = Migration(2, ("CREATE TABLE notes (note TEXT)",))
    monkeypatch.setattr(store, "MIGRATIONS", (*store.MIGRATIONS, later))
    file = Store.open(path)
    assert len(file.rows()) == 1
    file.close()
    assert raw(path, "SELECT version FROM gruber_version") == [(2,)]
    assert raw(path, "SELECT count(*) FROM notes") == [(0,)]


def test_a_locked_session_is_told__truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "BUSY_SECONDS", 0.1)
    path = tmp_path / "session.gpkg"
    file = Store.open(path)
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(StorageError, match=r"held by another program.*QGIS"):
        append(file)
    other.execute("ROLLBACK")
    other.close()
    assert append(file) == 1
    file.close()


def test_a_session_that_qgis_is_editing_can_be_used__truth(tmp_path: Path) -> None:
    path = tmp_path / "session.gpkg"
    Store.open(path).close()
    qgis = sqlite3.connect(path, isolation_level=None)
    qgis.execute("PRAGMA journal_mode = WAL")
    reading = qgis.execute("SELECT srs_id FROM gpkg_spatial_ref_sys")
    reading.fetchone()
    file = Store.open(path)
    assert append(file) == 1
    file.close()
    reading.close()
    qgis.close()
    file = Store.open(path)
    assert [row.decision_id for row in file.rows()] == [1]
    file.close()
    assert raw(path, "PRAGMA journal_mode") == [("delete",)]


def test_a_missing_folder_and_a_folder_in_its_place_are_told__truth(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="cannot be opened"):
        Store.open(tmp_path / "nowhere" / "session.gpkg")
    (tmp_path / "session.gpkg").mkdir()
    with pytest.raises(StorageError, match="is a folder where the session file belongs"):
        Store.open(tmp_path / "session.gpkg")


def test_a_read_only_file_is_told__truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "session.gpkg"
    Store.open(path).close()
    connect = sqlite3.connect

    def read_only(path: Path, **options: object) -> sqlite3.Connection:
        return connect(f"file:{path}?mode=ro", uri=True, **options)

    monkeypatch.setattr(sqlite3, "connect", read_only)
    file = Store.open(path)
    with pytest.raises(StorageError, match="may not be written"):
        append(file)
    file.close()


def test_decisions_recorded_at_once_are_on_disk_all_or_none__law(tmp_path: Path) -> None:
    file = Store.open(tmp_path / "session.gpkg")
    refused: Any = None
    with pytest.raises(StorageError):
        file.append("2026-01-01", "ada", [("Accept", "{}"), ("Accept", refused)])
    assert file.rows() == []
    assert file.append("2026-01-01", "ada", [("Accept", "{}")] * 3) == [1, 2, 3]
    file.close()


def test_a_full_disk_is_told_and_keeps_what_was_recorded__truth(tmp_path: Path) -> None:
    """The limit on the size of a file stands in for a full disk."""
    script = """
import resource, sys
from pathlib import Path
from core.errors import StorageError
from sessions.store import Store

file = Store.open(Path(sys.argv[1]))
limit = Path(sys.argv[1]).stat().st_size + 20000
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
for number in range(1000):
    try:
        file.append("", "ada", [("Accept", "x" * 500)])
    except StorageError as error:
        print(number, error)
        break
print(len(file.rows()))
"""
    path = tmp_path / "session.gpkg"
    limited = subprocess.run(
        [sys.executable, "-c", script, str(path)], cwd=REPOSITORY, capture_output=True, text=True
    )
    assert limited.stderr == ""
    told, kept = limited.stdout.splitlines()
    assert "is full" in told
    assert told.split()[0] == kept
    file = Store.open(path)
    assert len(file.rows()) == int(kept)
    assert append(file) == int(kept) + 1
    file.close()


def test_a_damaged_file_is_told__truth(tmp_path: Path) -> None:
    path = tmp_path / "session.gpkg"
    file = Store.open(path)
    for _ in range(200):
        append(file, "x" * 300)
    file.close()
    with path.open("r+b") as raw_file:
        raw_file.truncate(os.path.getsize(path) // 2)
    with pytest.raises(StorageError, match="is damaged"):
        Store.open(path).rows()


def test_a_copy_of_the_closed_file_is_the_whole_session__law(tmp_path: Path) -> None:
    file = Store.open(tmp_path / "session.gpkg")
    append(file)
    file.close()
    shutil.copy(tmp_path / "session.gpkg", tmp_path / "copy.gpkg")
    copy = Store.open(tmp_path / "copy.gpkg")
    assert len(copy.rows()) == 1
    copy.close()
