"""Session: a block's folder, and the door through which all other rooms use it."""

import json
from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import TracebackType
from typing import Self

import shapely

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block
from core.errors import StorageError
from core.geometry.camera import Camera
from core.mosaic.misfit_places import Misfit
from core.raster.files import FILES
from core.said import say
from sessions.atomic_write import clean_leftovers
from sessions.checks import with_free_number
from sessions.codec import CodecError, from_json, to_json, unfit_field
from sessions.decisions import (
    DECISIONS,
    Decision,
    Kinds,
    PlanChecks,
    Recorded,
    Withdraw,
    changing,
    last_to_redo,
    last_to_undo,
    standing,
)
from sessions.disk import explain_disk_errors
from sessions.layers import write_layers
from sessions.processes import only_run
from sessions.products import Products
from sessions.remarks import Fault
from sessions.replay import Replayed, replay, with_place
from sessions.scan_decisions import Films
from sessions.store import Row, Store

FILE = "session.gpkg"
"""The session file in the block's folder."""
HIDDEN = ".gruber"
"""Folder of everything that can be made again."""
RESULTS = "results"
"""Folder of what the user takes away."""


def products_of(folder: Path) -> Products:
    """What the stages of a block made; its folder need not be opened to read it."""
    return Products(folder / HIDDEN / "products", folder)


class Session:
    """One operator's door to a block's memory; used by one thread at a time.

    Several sessions, of one process or of many, may be open on the same block.
    """

    def __init__(self, folder: Path, operator: str, store: Store) -> None:
        self.folder = folder
        self.operator = operator
        self.products = products_of(folder)
        self.results = folder / RESULTS
        self._store = store
        self._known: list[Recorded] = []
        self._when = datetime.min.replace(tzinfo=UTC)

    @classmethod
    def open(cls, block_folder: Path, operator: str) -> Self:
        """Open the session of a block's folder, begun if there is none.

        What a killed process left half written is removed.

        Args:
            block_folder: The folder that holds `block.toml`.
            operator: Name under which decisions are recorded.

        Raises:
            StorageError: The session cannot be read or written.
        """
        folder = block_folder.resolve()
        for own in (folder / HIDDEN, folder / RESULTS):
            # What is tended there would be the files of others.
            if own.resolve() in (folder, *folder.parents):
                cause = "is a link to a folder that holds the block."
                raise StorageError(own, cause, "Take the link away.")
        for made in (folder / HIDDEN / "products", folder / RESULTS):
            with explain_disk_errors(made):
                made.mkdir(parents=True, exist_ok=True)
        FILES.web_folder = folder / HIDDEN / "web"
        products = folder / HIDDEN / "products"
        with explain_disk_errors(products):
            used = any(products.iterdir())
        store = Store.open(folder / FILE, used=used)
        for tended in (folder / HIDDEN, folder / RESULTS):
            clean_leftovers(tended)
        return cls(folder, operator, store)

    @classmethod
    def look(cls, block_folder: Path, operator: str) -> Self:
        """Open the session of a folder that may not be written: nothing can be recorded.

        Raises:
            StorageError: The session cannot be read.
        """
        folder = block_folder.resolve()
        return cls(folder, operator, Store.look(folder / FILE))

    def record(
        self, decision: Decision, seen: Block | None = None, operator: str | None = None
    ) -> Recorded:
        """Put one decision on the disk; see `record_all`."""
        return self.record_all((decision,), seen, operator)[0]

    def record_all(
        self,
        decisions: Sequence[Decision],
        seen: Block | None = None,
        operator: str | None = None,
        joined: Recorded | None = None,
    ) -> tuple[Recorded, ...]:
        """Put decisions on the disk, all or none; when this returns, they are there.

        What is recorded at once bears one time, which no other record of this session has: it is
        undone at once. A plan of checks drawn at the same time as another has the next number.

        Args:
            decisions: What was decided.
            seen: The block that was on screen: fills in the place that was looked at, so that a
                later run cannot move what a human has accepted.
            operator: Who decided; the session's own operator by default.
            joined: What the same operator began and these complete: they bear its time.

        Raises:
            ValueError: A decision says what none may say, and could not be read again.
        """
        _refuse_unfit(decisions)
        self._when = max(datetime.now(UTC), self._when + timedelta(milliseconds=1))
        when = self._when.isoformat(timespec="milliseconds")
        who = operator or self.operator
        if joined is not None and joined.who == who:
            when = joined.when
        placed = [one if seen is None else with_place(one, seen) for one in decisions]
        with self._store.writing() as transaction:
            # Nobody else records meanwhile: a number that is free now stays free.
            placed = [
                with_free_number(one, self.decisions()) if isinstance(one, PlanChecks) else one
                for one in placed
            ]
            texts = [
                (type(one).__name__, json.dumps(to_json(one), ensure_ascii=False)) for one in placed
            ]
            numbers = transaction.append(when, who, texts)
        return tuple(
            Recorded(number, when, who, one) for number, one in zip(numbers, placed, strict=True)
        )

    def decisions(self) -> tuple[Recorded, ...]:
        """Every decision of every operator, in order, withdrawn ones and withdrawals included."""
        after = self._known[-1].decision_id if self._known else 0
        self._known.extend(self.since(after))
        return tuple(self._known)

    def since(self, decision_id: int) -> tuple[Recorded, ...]:
        """What was recorded after a given decision, by whomever; 0 for everything."""
        return tuple(self._recorded(row) for row in self._store.rows(after=decision_id))

    def changing(self) -> tuple[Recorded, ...]:
        """Records that say something of the block itself.

        What follows from the block depends on these; plans and readings of checks change nothing.
        It depends on what was decided, not on the numbers: a session file that is put back from a
        copy counts anew.
        """
        return changing(self.decisions())

    def replayed(
        self, block: Block, found: Films | None = None, given: Mapping[str, Camera] | None = None
    ) -> Block:
        """The block with all standing decisions laid over it; the others as for `replay`."""
        return self.replayed_all(block, found, given).block

    def replayed_all(
        self, block: Block, found: Films | None = None, given: Mapping[str, Camera] | None = None
    ) -> Replayed:
        """As `replayed`, with the decisions that find no place in this block."""
        return replay(block, self.decisions(), found, given)

    def undo(
        self,
        operator: str | None = None,
        kinds: Kinds = (),
        others: Collection[int] = frozenset(),
        own: Collection[int] = frozenset(),
    ) -> Recorded | None:
        """Withdraw the operator's own last decision that stands, and what was recorded with it.

        Args:
            operator: Who decided; the session's own operator by default.
            kinds: Kinds of decisions among which it is the last; all by default.
            others: Numbers of decisions that somebody else made under the same name.
            own: Numbers of decisions that the operator made, under whatever name.

        Returns:
            The last withdrawal; None when there is nothing to withdraw.
        """
        who = operator or self.operator
        return self._withdrawn(last_to_undo(self.decisions(), who, kinds, others, own), who)

    def redo(
        self,
        operator: str | None = None,
        kinds: Kinds = (),
        others: Collection[int] = frozenset(),
        own: Collection[int] = frozenset(),
    ) -> Recorded | None:
        """Withdraw the operator's own last undo; None when something was decided after it."""
        who = operator or self.operator
        return self._withdrawn(last_to_redo(self.decisions(), who, kinds, others, own), who)

    def _withdrawn(self, last: Recorded | None, operator: str) -> Recorded | None:
        """Withdraw a record with all that its operator recorded at the same time."""
        if last is None:
            return None
        together = [
            Withdraw(item.decision_id)
            for item in standing(self.decisions())
            if (item.when, item.who) == (last.when, last.who)
            and isinstance(item.decision, Withdraw) == isinstance(last.decision, Withdraw)
        ]
        return self.record_all(together, operator=operator)[-1]

    def write_layers(
        self,
        block: Block,
        report: AdjustmentReport,
        footprints: Mapping[str, shapely.Polygon],
        misfit: Misfit | None = None,
        faults: Sequence[Fault] = (),
    ) -> None:
        """Replace the layers QGIS shows by those of this block, all at once."""
        write_layers(self._store, block, report, footprints, misfit, faults)

    @contextmanager
    def running(self) -> Generator[None]:
        """Be the only one who makes this block's products.

        Raises:
            StorageError: Another run is at work in the same block.
        """
        with only_run(self.folder / HIDDEN / "run.lock", self.operator):
            yield

    def close(self) -> None:
        """Let go of the session file."""
        self._store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _recorded(self, row: Row) -> Recorded:
        try:
            decision = from_json(json.loads(row.decision))
            if not isinstance(decision, DECISIONS):
                raise CodecError("no decision")
            _refuse_unfit([decision])
            datetime.fromisoformat(row.recorded)
        except (CodecError, ValueError, RecursionError) as error:
            newer = isinstance(error, CodecError)
            raise StorageError(
                self._store.path,
                say(
                    "holds decision {decision_id}, which this Gruber cannot read ({error}).",
                    decision_id=row.decision_id,
                    error=error,
                ),
                "Update Gruber; the decision is kept."
                if newer
                else "The file was changed by another program: put it back from a copy.",
            ) from error
        return Recorded(row.decision_id, row.recorded, row.who, decision)


def _refuse_unfit(decisions: Sequence[Decision]) -> None:
    """Refuse what no decision may say, such as a reason that there is not, or a place nowhere."""
    for one in decisions:
        if unfit := unfit_field(one):
            raise ValueError(f"{type(one).__name__}: {unfit}")
