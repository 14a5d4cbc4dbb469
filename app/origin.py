"""The rasters of origin of a block's mosaic, in its results."""

from pathlib import Path

from app.epochs import origin_files
from app.misfit import block_errors
from app.project import Project
from app.surface import CLASSES
from core.adjustment.adjusted import AdjustmentReport
from core.mosaic.composition import MosaicProduct
from core.mosaic.origin import OriginFiles, write_origin
from core.raster.dem import Dem
from core.results import BlockInput
from sessions.atomic_write import whole_file
from sessions.session import Session

PRODUCT = "origin"


def make_origin(
    session: Session,
    project: Project,
    given: BlockInput,
    mosaic: MosaicProduct,
    report: AdjustmentReport,
    dem: Dem,
    *,
    anew: bool = False,
) -> OriginFiles:
    """Write them, unless they are fresh.

    Args:
        session: Where results are kept.
        project: For dates, and what orthos stand on.
        given: The reference, and how the block is adjusted.
        mosaic: The mosaic, on disk.
        report: The adjusted block.
        dem: Heights.
        anew: Write them again.
    """
    products, results = session.products, session.results
    files = origin_files(results)
    dates = {name: project.taken.get(name, "") for name in sorted(report.block.photos)}
    classes: Path | None = results / CLASSES
    if project.ortho.ground == "dem" or not (results / CLASSES).is_file():
        classes = None
    inputs = products.digest_of(
        PRODUCT, 1, mosaic.path, mosaic.grid, mosaic.seams, dates, classes, given.reference,
        report.sigma_nought, report.exterior_sigmas,
    )  # fmt: skip
    kept = None if anew else products.load_value(PRODUCT, products.digest_of(inputs, files.every))
    if kept is not None and all(path.is_file() for path in files.every):
        return files
    errors = block_errors(given, report, dem)
    write_origin(mosaic.path, mosaic.grid, mosaic.seams, dates, errors, classes, files, whole_file)
    products.save_value(PRODUCT, products.digest_of(inputs, files.every), True)
    return files
