"""The session file: a GeoPackage to which decisions are appended, one transaction each.

Its version decides which SQL still upgrades it.
"""

import sqlite3
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from core.errors import StorageError
from core.said import say

GEOPACKAGE_ID = 0x47504B47
"""`application_id` of a GeoPackage ("GPKG")."""
GEOPACKAGE_VERSION = 10400
"""`user_version` of GeoPackage 1.4."""


@dataclass(frozen=True, slots=True)
class Migration:
    """One step from a version of the session file to the next."""

    version: int
    """The version the file has afterwards."""
    statements: tuple[str, ...]
    """SQL, run in one transaction together with the new version number."""


_GEOPACKAGE = (
    """CREATE TABLE gpkg_spatial_ref_sys (
        srs_name TEXT NOT NULL,
        srs_id INTEGER NOT NULL PRIMARY KEY,
        organization TEXT NOT NULL,
        organization_coordsys_id INTEGER NOT NULL,
        definition TEXT NOT NULL,
        description TEXT)""",
    """CREATE TABLE gpkg_contents (
        table_name TEXT NOT NULL PRIMARY KEY,
        data_type TEXT NOT NULL,
        identifier TEXT UNIQUE,
        description TEXT DEFAULT '',
        last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
        min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
        srs_id INTEGER,
        CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id))""",
    """CREATE TABLE gpkg_geometry_columns (
        table_name TEXT NOT NULL,
        column_name TEXT NOT NULL,
        geometry_type_name TEXT NOT NULL,
        srs_id INTEGER NOT NULL,
        z TINYINT NOT NULL,
        m TINYINT NOT NULL,
        CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
        CONSTRAINT uk_gc_table_name UNIQUE (table_name),
        CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
        CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id))""",
    """CREATE TABLE gpkg_extensions (
        table_name TEXT,
        column_name TEXT,
        extension_name TEXT NOT NULL,
        definition TEXT NOT NULL,
        scope TEXT NOT NULL,
        CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))""",
    """INSERT INTO gpkg_spatial_ref_sys VALUES
        ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', NULL),
        ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL),
        ('WGS 84', 4326, 'EPSG', 4326, 'GEOGCS["WGS 84",DATUM["WGS_1984",'
         || 'SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
         || 'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
         || 'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],'
         || 'AUTHORITY["EPSG","4326"]]', NULL)""",
    f"PRAGMA application_id = {GEOPACKAGE_ID}",
    f"PRAGMA user_version = {GEOPACKAGE_VERSION}",
)

# Decisions are appended and nothing else: the triggers hold even against a table edited in QGIS.
_DECISIONS = (
    "CREATE TABLE gruber_version (version INTEGER NOT NULL)",
    "INSERT INTO gruber_version VALUES (0)",
    """CREATE TABLE decisions (
        decision_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
        recorded TEXT NOT NULL,
        who TEXT NOT NULL,
        kind TEXT NOT NULL,
        decision TEXT NOT NULL)""",
    """CREATE TRIGGER decisions_never_change BEFORE UPDATE ON decisions
        BEGIN SELECT RAISE(ABORT, 'decisions are only appended'); END""",
    """CREATE TRIGGER decisions_never_vanish BEFORE DELETE ON decisions
        BEGIN SELECT RAISE(ABORT, 'decisions are only appended'); END""",
    """INSERT INTO gpkg_contents (table_name, data_type, identifier, description)
        VALUES ('decisions', 'attributes', 'decisions', 'What the operators decided, in order')""",
)

MIGRATIONS: tuple[Migration, ...] = (Migration(1, _GEOPACKAGE + _DECISIONS),)
"""All steps in order; a new version is one more entry, and no entry ever changes."""

BUSY_SECONDS = 10.0
"""How long to wait for another program that is writing."""


@dataclass(frozen=True, slots=True)
class Row:
    """One decision as it lies in the file."""

    decision_id: int
    """Counts upwards."""
    recorded: str
    """Time, UTC, ISO 8601."""
    who: str
    """The operator."""
    decision: str
    """The decision, encoded."""


class Transaction:
    """SQL inside one transaction; handed out by `Store.writing`."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def execute(self, sql: str, values: Sequence[Any] = ()) -> int:
        """Run one statement.

        Returns:
            Number of the row that an insertion made.
        """
        return self._connection.execute(sql, values).lastrowid or 0

    def execute_many(self, sql: str, rows: Iterable[Sequence[Any]]) -> None:
        """Run one statement for each row."""
        self._connection.executemany(sql, rows)

    def append(self, recorded: str, who: str, decisions: Sequence[tuple[str, str]]) -> list[int]:
        """Add decisions after all others; arguments and result as for `Store.append`."""
        return [
            self.execute(
                "INSERT INTO decisions (recorded, who, kind, decision) VALUES (?, ?, ?, ?)",
                (recorded, who, kind, decision),
            )
            for kind, decision in decisions
        ]

    def query(self, sql: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """All rows of a question."""
        return self._connection.execute(sql, values).fetchall()


class Store:
    """One connection to `session.gpkg`; used by one thread at a time.

    A rollback journal, not a write-ahead log, so that the file is whole by itself and may lie on a
    network share; each commit is on the disk when the call returns.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    @classmethod
    def open(cls, path: Path, used: bool = False) -> Self:
        """Open the session file, made or brought to this version as needed.

        Args:
            path: Where it lies, or will.
            used: Whether the block has been worked on, so that an empty file has lost decisions.

        Raises:
            StorageError: Not a session, of a newer version, emptied, locked, read-only, or a full
                disk.
        """
        emptied = used and path.exists()
        with _told(path):
            connection = sqlite3.connect(
                path, timeout=BUSY_SECONDS, isolation_level=None, check_same_thread=False
            )
        store = cls(path, connection)
        try:
            with _told(path):
                store._prepare(emptied)
        except BaseException:
            connection.close()
            raise
        return store

    @classmethod
    def look(cls, path: Path) -> Self:
        """Open the session file only to read it; an empty one where there is none.

        Raises:
            StorageError: Not a session, or of a newer version.
        """
        there = path.is_file()
        with _told(path):
            connection = sqlite3.connect(
                f"{path.as_uri()}?mode=ro" if there else "file::memory:",
                uri=True, timeout=BUSY_SECONDS, isolation_level=None, check_same_thread=False,
            )  # fmt: skip
        store = cls(path, connection)
        try:
            with _told(path):
                if there:
                    store._version()
                else:
                    store._prepare()
        except BaseException:
            connection.close()
            raise
        return store

    def append(self, recorded: str, who: str, decisions: Sequence[tuple[str, str]]) -> list[int]:
        """Put decisions on the disk, all or none; when this returns, they are there.

        Args:
            recorded: When.
            who: Who decided.
            decisions: Kind and text of each.

        Returns:
            Their numbers.
        """
        with self.writing() as transaction:
            return transaction.append(recorded, who, decisions)

    def rows(self, after: int = 0) -> list[Row]:
        """The decisions recorded after a given one, in order."""
        with _told(self.path):
            found = self._connection.execute(
                "SELECT decision_id, recorded, who, decision FROM decisions"
                " WHERE decision_id > ? ORDER BY decision_id",
                (after,),
            ).fetchall()
            for number, *words in found:
                if not all(isinstance(word, str) for word in words):
                    raise sqlite3.DatabaseError(f"decision {number} is damaged")
        return [Row(*row) for row in found]

    @contextmanager
    def writing(self) -> Generator[Transaction]:
        """One transaction: all of it or nothing, on the disk when the block ends."""
        with _told(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield Transaction(self._connection)
                self._connection.execute("COMMIT")
            except BaseException:
                # A full disk has already rolled back; the first error is the one to tell.
                with suppress(sqlite3.Error):
                    self._connection.execute("ROLLBACK")
                raise

    def close(self) -> None:
        """Let go of the file, which is then one whole file without companions."""
        with suppress(sqlite3.Error):
            self._leave_wal()
        self._connection.close()

    def _prepare(self, emptied: bool = False) -> None:
        self._connection.execute("PRAGMA synchronous = EXTRA")
        with suppress(sqlite3.OperationalError):
            # QGIS edits in WAL mode and holds on to it; appending is as safe in either.
            self._leave_wal()
        self._clear_up()
        if self._version() < newest():
            with self.writing() as transaction:
                # Asked again under the lock: another process may just have made the file.
                version = self._version()
                if emptied and version == 0:
                    cause = "is empty: the decisions of this block are lost."
                    remedy = "Restore a copy of it, or delete it to begin without decisions."
                    raise StorageError(self.path, cause, remedy)
                for step in steps_from(version):
                    _take(step, transaction)

    def _clear_up(self) -> None:
        """Take away the journal of who was killed before its head was written; SQLite leaves it.

        Nothing was changed in the file by then: the head comes first.
        """
        with suppress(FileNotFoundError, sqlite3.OperationalError):
            with Path(f"{self.path}-journal").open("rb") as journal:
                head = journal.read(1)
            if head in (b"", b"\0"):
                # A write of what stands there already; its end takes the journal away.
                number = self._connection.execute("PRAGMA user_version").fetchone()[0]
                self._connection.execute(f"PRAGMA user_version = {number}")

    def _leave_wal(self) -> None:
        if self._connection.execute("PRAGMA journal_mode").fetchone()[0] != "delete":
            self._connection.execute("PRAGMA journal_mode = DELETE").fetchone()

    def _version(self) -> int:
        """Version of the file, 0 when it is empty; refuses what is no session of ours."""
        tables = {
            row[0] for row in self._connection.execute("SELECT name FROM sqlite_master").fetchall()
        }
        identity = self._connection.execute("PRAGMA application_id").fetchone()[0]
        if not tables:
            return 0
        if "gruber_version" not in tables or identity != GEOPACKAGE_ID:
            raise StorageError(
                self.path,
                "is a database, but not a session of Gruber.",
                "Move it out of the block's folder; a new session is then begun.",
            )
        row = self._connection.execute("SELECT version FROM gruber_version").fetchone()
        version = row[0] if row else None
        if not isinstance(version, int):
            raise sqlite3.DatabaseError("it names no version")
        if version > newest():
            raise StorageError(
                self.path,
                say(
                    "was written by a newer Gruber (session version {version}, this one knows "
                    "{known}).",
                    version=version,
                    known=newest(),
                ),
                "Update Gruber; the file was not touched.",
            )
        return version


def _take(step: Migration, transaction: Transaction) -> None:
    for statement in step.statements:
        transaction.execute(statement)
    transaction.execute("UPDATE gruber_version SET version = ?", (step.version,))


@contextmanager
def _told(path: Path) -> Generator[None]:
    """Turn what SQLite says into file, cause and remedy."""
    try:
        yield
    except (sqlite3.Error, UnicodeDecodeError) as error:  # of names in a damaged file
        cause, remedy = _explained(error, path)
        raise StorageError(path, cause, remedy) from error


def _explained(error: Exception, path: Path) -> tuple[str, str]:
    """Cause and remedy of a SQLite error; the extended codes keep the base code in the low byte."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
    if path.is_dir():
        return "is a folder where the session file belongs.", "Rename it or move it elsewhere."
    if code in _EXPLANATIONS:
        return _EXPLANATIONS[code]
    cause = say("could not be used ({error}).", error=error)
    return cause, say("Make a copy of {name}, then try again.", name=path.name)


_LOCKED = (
    say(
        "has been held by another program for more than {seconds:.0f} seconds.",
        seconds=BUSY_SECONDS,
    ),
    "Save or end the editing of its layers (in QGIS: toggle editing off), then try again.",
)
_READ_ONLY = (
    "may not be written.",
    "Give yourself the right to write the block's folder, or copy the block elsewhere.",
)
_EXPLANATIONS: dict[int, tuple[str, str]] = {
    sqlite3.SQLITE_BUSY: _LOCKED,
    sqlite3.SQLITE_LOCKED: _LOCKED,
    sqlite3.SQLITE_READONLY: _READ_ONLY,
    sqlite3.SQLITE_PERM: _READ_ONLY,
    sqlite3.SQLITE_FULL: (
        "could not be written: the disk is full.",
        "Free some space and repeat the last step; everything recorded before it is safe.",
    ),
    sqlite3.SQLITE_IOERR: (
        "could not be read or written: the disk reports an error or is full.",
        "Check the free space and the disk, then repeat the last step.",
    ),
    sqlite3.SQLITE_CANTOPEN: (
        "cannot be opened.",
        "Check that the block's folder exists and may be written.",
    ),
    sqlite3.SQLITE_NOTADB: (
        "is not a session: it is no database at all.",
        "Move it out of the block's folder; a new session is then begun.",
    ),
    sqlite3.SQLITE_CORRUPT: (
        "is damaged.",
        "Restore it from a backup, or rescue it with `sqlite3 session.gpkg .recover`.",
    ),
}

assert MIGRATIONS[-1].version == len(MIGRATIONS), "versions count 1, 2, 3"


def newest() -> int:
    """The version this program writes."""
    return MIGRATIONS[-1].version


def steps_from(version: int) -> tuple[Migration, ...]:
    """The migrations that a file of some version still needs; 0 is an empty file."""
    return tuple(step for step in MIGRATIONS if step.version > version)
