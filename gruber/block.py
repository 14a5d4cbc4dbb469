"""One block on disk: run it, look at it, decide, adjust, export."""

from collections.abc import Collection, Sequence
from pathlib import Path

from app.block_list import was_made
from app.exchange import Brought, Exported, bring_file, export_block
from app.project import Project, read_project
from app.run import STAGE_NAMES, Run, RunOptions
from app.terminal import LastingConsole, Terminal
from core.adjustment.adjusted import AdjustmentReport
from core.block import Block as BlockValue
from core.block import Role
from core.progress import SILENT
from gruber import tables
from sessions.decisions import (
    Accept,
    AddPoint,
    ChoosePeak,
    Decision,
    MarkDubious,
    MarkNotVisible,
    Place,
    Reason,
    Recorded,
    Reject,
    SetRole,
)
from sessions.session import Session


def open_block(folder: str | Path, operator: str = "notebook", *, quiet: bool = False) -> "Block":
    """Open a block.

    Args:
        folder: The folder with a `block.toml`, or that file.
        operator: Name under which decisions are recorded.
        quiet: Whether runs say nothing.

    Raises:
        PhotogrammetryError: `block.toml` holds something that cannot be used.
    """
    # What is brought in may be what tells where the block lies; `run` asks for the rest.
    return Block(read_project(Path(folder), brought=True), operator, quiet=quiet)


class Block:
    """A block's folder. Every call reads what is there and leaves it on disk; nothing is held."""

    def __init__(self, project: Project, operator: str, *, quiet: bool) -> None:
        self.project, self.operator, self.quiet = project, operator, quiet

    def __repr__(self) -> str:
        """Name, place, size, and how far it was run; the block itself is not opened."""
        made = [name for name in STAGE_NAMES if was_made(self.folder, name)]
        reached = f"run as far as {made[-1]}" if made else "not run yet"
        scans = len(self.project.scans.listed)
        return (
            f"<Block {self.project.block.name!r}: {scans} scans, {self.crs}, {reached}; "
            f"in {str(self.folder)!r}>"
        )

    @property
    def folder(self) -> Path:
        """The block's folder."""
        return self.project.folder

    @property
    def results(self) -> Path:
        """Folder of tables, orthos, mosaic and report."""
        return self.folder / "results"

    @property
    def crs(self) -> str:
        """The block's CRS."""
        return self.project.block.crs

    def run(self, first: str | None = None, last: str | None = None, workers: int = 2) -> None:
        """Run the stages; what is fresh is kept.

        Args:
            first: Make this stage and all after it anew.
            last: Stop after this stage.
            workers: Pieces of a stage that run side by side.

        Raises:
            PhotogrammetryError: The data cannot be used.
            ValueError: There is no such stage, or the last comes before the first.
        """
        _check_stages(first, last)
        self._walk(RunOptions(first, last, workers))

    def adjust(self) -> AdjustmentReport:
        """The block adjusted with all decisions; what that needs and is not fresh is run first.

        Raises:
            PhotogrammetryError: The data cannot be used.
        """
        return self._walk(RunOptions(last="adjustment")).adjusted

    def orientations(self) -> tables.Table:
        """Exterior orientations; see `gruber.tables.orientations`."""
        return tables.orientations(*self._standing())

    def cameras(self) -> tables.Table:
        """Cameras as adjusted; see `gruber.tables.cameras`."""
        return tables.cameras(self._standing()[0])

    def interiors(self) -> tables.Table:
        """Interior orientations; see `gruber.tables.interiors`."""
        return tables.interiors(self._standing()[0])

    def points(self) -> tables.Table:
        """Surveyed points; see `gruber.tables.points`."""
        return tables.points(self._standing()[0])

    def measurements(self) -> tables.Table:
        """Measurements of surveyed points; see `gruber.tables.measurements`."""
        return tables.measurements(*self._standing())

    def ties(self) -> tables.Table:
        """Adjusted tie points; see `gruber.tables.ties`."""
        return tables.ties(self._standing()[1])

    def accept(self, point: str, photo: str) -> Recorded:
        """The measurement is right."""
        return self.decide(Accept(point, photo))

    def reject(self, point: str, photo: str, reason: Reason = "other") -> Recorded:
        """The measurement is wrong."""
        return self.decide(Reject(point, photo, reason))

    def place(self, point: str, photo: str, column: float, row: float) -> Recorded:
        """A measurement of one's own: pixels, outer corner of the first pixel (0, 0)."""
        return self.decide(Place(point, photo, column, row))

    def set_role(self, point: str, role: Role) -> Recorded:
        """Control steers, check only judges."""
        return self.decide(SetRole(point, role))

    def decide(self, decision: Decision) -> Recorded:
        """Record any decision of `sessions.decisions`; it is on the disk when this returns.

        Raises:
            ValueError: It names a point or photo that there is not, or a place outside of the scan.
        """
        seen = self._standing()[0]
        _refuse_unknown(decision, seen, {scan.photo_id for scan in self.project.scans.listed})
        with Session.open(self.folder, self.operator) as session:
            return session.record(decision, seen)

    def undo(self) -> Recorded | None:
        """Take back the operator's last decision; None when none stands."""
        with Session.open(self.folder, self.operator) as session:
            return session.undo()

    def decisions(self) -> tuple[Recorded, ...]:
        """Everything that was decided, by whomever, withdrawn or not."""
        with Session.open(self.folder, self.operator) as session:
            return session.decisions()

    def export(
        self, form: str, out: str | Path | None = None, *, pictures: bool = False
    ) -> Exported:
        """Write the adjusted block for another program, as `gruber export` does.

        Raises:
            PhotogrammetryError: The data cannot be used, or the disk not be written.
            ValueError: There is no such format.
        """
        block, report = self._standing()
        with Session.open(self.folder, self.operator) as session:
            target = None if out is None else Path(out)
            return export_block(
                session, block, report, form, target, pictures=pictures, progress=SILENT,
                taken=self.project.taken,
            )  # fmt: skip

    def bring(self, form: str, path: str | Path, *, answers: Sequence[str] = ()) -> Brought:
        """Take over what a file of another program knows, or a table of points.

        Args:
            form: The format, as `gruber import --from` takes it; `points` for any table.
            path: The file or folder.
            answers: What `--answer` takes, such as `["axes=-N -E", "refused=leave out"]`.

        Raises:
            PhotogrammetryError: The file cannot be used, or leaves something to be asked; the
                questions and their answers stand below the message. Nothing came in.
            ValueError: There is no such format.
        """
        with Session.open(self.folder, self.operator) as session:
            brought = bring_file(self.project, session, form, Path(path), answers)
        self.project = read_project(self.project.file, brought=True)
        return brought

    def _standing(self) -> tuple[BlockValue, AdjustmentReport]:
        """The block as adjusted with all decisions."""
        report = self.adjust()
        return report.block, report

    def _walk(self, options: RunOptions) -> Run:
        voice = Terminal(LastingConsole(quiet=True) if self.quiet else None)
        self.project = read_project(self.project.file)
        with Session.open(self.folder, self.operator) as session:
            walk = Run(self.project, session, voice, options)
            try:
                walk.walk()
            finally:
                voice.close()
        return walk


def _refuse_unknown(decision: Decision, block: BlockValue, scans: Collection[str]) -> None:
    """Refuse what the block does not have: it would be on the disk, and do nothing.

    Scans that were set aside can still be placed, masked, and have their fiducials corrected.
    """
    point, photo = (getattr(decision, name, None) for name in ("point_id", "photo_id"))
    if photo is not None and photo not in (scans if point is None else block.photos):
        raise ValueError(f"There is no photo {photo!r}.")
    if point is not None and point not in block.surveyed and not isinstance(decision, AddPoint):
        raise ValueError(f"There is no point {point!r}.")
    of_measured = isinstance(decision, Accept | Reject | MarkDubious | MarkNotVisible | ChoosePeak)
    if of_measured and (point, photo) not in block.measurements:
        raise ValueError(f"{point!r} is not measured in {photo!r}.")
    if isinstance(decision, Place):
        columns, rows = block.photos[decision.photo_id].size_px
        if not (0 <= decision.column <= columns and 0 <= decision.row <= rows):
            raise ValueError(f"{photo!r} has {columns} columns and {rows} rows.")


def _check_stages(first: str | None, last: str | None) -> None:
    """Refuse stages that do not exist or follow in the wrong order, with those there are."""
    names = ", ".join(STAGE_NAMES)
    for name in (first, last):
        if name is not None and name not in STAGE_NAMES:
            raise ValueError(f"{name!r} is no stage; it is one of {names}")
    if first and last and STAGE_NAMES.index(last) < STAGE_NAMES.index(first):
        raise ValueError(f"{last!r} comes before {first!r}; the stages are {names}")
