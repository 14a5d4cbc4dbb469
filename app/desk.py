"""The review desk of a block that has been run: what it works on, and what it may set off."""

from collections.abc import Sequence
from typing import cast

from app.described import described
from app.project import Project
from app.results import write_results
from app.run import make_mosaic, make_orthos
from app.scan_files import ScanFiles
from app.wiring import DeskInputs
from core.block.adjusted import AdjustmentReport
from core.block.assembly import Assembly, adjusted_without_gross
from core.block.block import Block
from core.errors import ProjectError
from core.ground.picture import footprint_of
from core.pipeline import BlockInput, Georeferenced, open_reference, search_bounds
from core.progress import Progress
from core.reference.reference import Reference
from sessions.session import Session


def desk_inputs(
    project: Project, session: Session, operator: str, host: str, port: int
) -> DeskInputs:
    """Everything the desk needs of a block.

    Raises:
        ProjectError: The block has not been run as far as its control points.
    """
    given = described(project)
    assembly = cast("Assembly | None", session.products.latest_value("control"))
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    if assembly is None or placed is None:
        raise ProjectError(
            project.file,
            "the block has no control points to review yet.",
            f"Run it first: gruber run {project.folder}",
        )
    reference = open_reference(given, search_bounds(placed.block))
    block = assembly.report.block
    report = adjusted(given, session.replayed(block))
    made = cast("AdjustmentReport | None", session.products.latest_value("adjustment"))
    return DeskInputs(
        name=project.block.name,
        block=block,
        report=report,
        session=session,
        ortho=reference.ortho,
        dem=reference.dem,
        read_scan=ScanFiles(project.folder),
        adjust=lambda block, progress: adjusted(given, block),
        remake=Remaking(project, reference, operator),
        made=made.block if made is not None else block,
        operator=operator,
        host=host,
        port=port,
    )


def adjusted(given: BlockInput, block: Block) -> AdjustmentReport:
    """The adjustment that `gruber run` would make of the same block."""
    return adjusted_without_gross(block, given.assembly.adjustment)


class Remaking:
    """Makes orthos, mosaic and tables again from the desk's worker thread."""

    def __init__(self, project: Project, reference: Reference, operator: str) -> None:
        self.project, self.reference, self.operator = project, reference, operator

    def __call__(
        self, photo_ids: Sequence[str], progress: Progress, report: AdjustmentReport
    ) -> None:
        """Orthos of these photos, then the mosaic and all that is written beside it."""
        with Session.open(self.project.folder, self.operator) as session, session.running():
            orthos = make_orthos(
                session,
                self.project,
                report.block,
                self.reference.dem,
                progress,
                only=frozenset(photo_ids),
            )
            make_mosaic(session, orthos, progress)
            write_results(session.results, report)
            outlines = {
                name: footprint_of(photo, report.block.camera_of(name), self.reference.dem)
                for name, photo in report.block.photos.items()
            }
            session.write_layers(report.block, report, outlines)
