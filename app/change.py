"""The layer of what has changed since, from the mosaic and the present ortho."""

from collections.abc import Mapping

from app.project import Project
from core.mosaic.change import find_change, write_change
from core.mosaic.composition import MosaicProduct
from core.progress import Progress
from core.raster.ortho import open_ortho
from sessions.atomic_write import whole_file
from sessions.session import Session

CHANGE = "change.gpkg"


def make_change(
    session: Session,
    project: Project,
    mosaic: MosaicProduct,
    progress: Progress,
    *,
    anew: bool = False,
) -> Mapping[str, float]:
    """Write the layer unless it is fresh.

    Args:
        session: Where results are kept.
        project: For the reference.
        mosaic: The mosaic, on disk.
        progress: Told per tile.
        anew: Make it again.

    Returns:
        Share of the ground that is the same, and that is different; nothing without a reference.
    """
    crs, reference = project.block.crs, project.reference.ortho
    if not reference:
        return {}
    target = session.results / CHANGE
    digest = session.products.digest_of("change", 1, mosaic.path, reference)
    kept = None if anew else session.products.load_value("change", digest)
    if kept is not None and target.is_file():
        return kept
    found = find_change(
        open_ortho([mosaic.path], crs), open_ortho(reference, crs), mosaic.grid.bounds,
        progress=progress,
    )  # fmt: skip
    with whole_file(target) as temporary:
        write_change(found, temporary, crs)
    session.products.save_value("change", digest, found.shares)
    return found.shares
