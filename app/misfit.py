"""The misfit of the mosaic against all references, and all places at which it is likely wrong."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from app.mosaic import seam_guides
from app.project import Project
from app.report.tables import Cell, write_table
from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.influence import influence_of
from core.control.prediction import covariances_of
from core.doubts import Doubt
from core.errors import PhotogrammetryError, ReferenceDataError
from core.geometry.robust import robust_sigma
from core.localisation.photo_orientation import OrientationOptions
from core.matching.reference import ReferenceFiles
from core.mosaic.comparison import MosaicAccuracy, compare_orthos
from core.mosaic.composition import MosaicProduct
from core.mosaic.fault_places import FaultPlace, worst_places
from core.mosaic.misfit import BlockErrors, accuracy_as_control, measure_misfit
from core.mosaic.misfit_places import Misfit, judge_misfit
from core.mosaic.seam_fit import SeamFit
from core.progress import Work
from core.raster.dem import Dem
from core.raster.ortho import open_ortho
from core.results import BlockInput
from core.said import say
from sessions.checks import version_on_disk
from sessions.products import Products
from sessions.session import Session

PRODUCT, TABLE = "misfit", "misfit.csv"
COMPARISONS = "comparisons"
"""Product that keeps the mosaic against each further reference, or why it was not compared."""
PLACES = "fault-places"
"""Product that keeps the places, worst first."""
COLUMNS = "X,Y,dX,dY,sigma,predicted_X,predicted_Y,probability,scan"
ALIKE = 0.5  # design: the content is nearly the same where gray values recognise half of it.
"""Share of the places that gray values recognise where they are enough."""
CENTI, MILLI = 2, 3
"""Decimal places of coordinates, and of metres and probabilities."""

Kept = tuple[str, Misfit]
"""The version of the mosaic that was compared, and what came of it."""
Compared = tuple[dict[str, MosaicAccuracy], tuple[Doubt, ...]]
"""The mosaic against further references by their name, and those that it is not compared with."""


def make_misfit(
    session: Session,
    given: BlockInput,
    mosaic: MosaicProduct,
    report: AdjustmentReport,
    dem: Dem,
    work: Work,
    *,
    anew: bool = False,
) -> Misfit | None:
    """Compare the mosaic with the reference all over the block, unless that is fresh.

    Args:
        session: Where product and table are kept.
        given: The reference, and how control is searched and the block adjusted.
        mosaic: The mosaic, on disk.
        report: The adjusted block, which predicts the misfit.
        dem: Heights.
        work: Runs tiles side by side and is told of each; may raise `Cancelled`.
        anew: Compare again.

    Returns:
        Vectors and places; None where no reference lies under the mosaic.
    """
    files, orientation = given.reference, given.control.orientation
    if not files.ortho or not _overlap(mosaic.path, files):
        return None
    products = session.products
    digest = products.digest_of(
        PRODUCT, 5, mosaic.path, files, orientation, report.sigma_nought, report.exterior_sigmas
    )
    kept: Kept | None = None if anew else products.load_value(PRODUCT, digest)
    if kept is not None:
        _, misfit = kept
    else:
        misfit = judge_misfit(
            measure_misfit(
                mosaic.path,
                files.ortho,
                mosaic.seams,
                block_errors(given, report, dem),
                orientation,
                work,
            )
        )
        products.save_value(PRODUCT, digest, (version_on_disk(products), misfit))
    write_table(session.results / TABLE, COLUMNS, misfit_rows(misfit))
    return misfit


def make_comparisons(
    session: Session,
    project: Project,
    given: BlockInput,
    mosaic: MosaicProduct,
    report: AdjustmentReport,
    dem: Dem,
    work: Work,
    *,
    anew: bool = False,
) -> Compared:
    """The mosaic against the ortho of each `[[reference.other]]`, unless that is fresh.

    Args:
        session: Where the product is kept.
        project: Names the references.
        given: How control is searched and the block adjusted.
        mosaic: The mosaic, on disk.
        report: The adjusted block.
        dem: Heights.
        work: Runs tiles side by side and is told of each place; may raise `Cancelled`.
        anew: Compare again.

    Returns:
        Its accuracy by the name of the ortho, and what could not be compared.
    """
    other = {one.name(project.folder): one for one in project.reference.other if one.ortho}
    if not other:
        return {}, ()
    sheets = [(name, one.ortho, one.ortho_sigma_m) for name, one in other.items()]
    digest = session.products.digest_of(
        COMPARISONS, 2, mosaic.path, mosaic.seams, sheets, given.control.orientation,
        report.sigma_nought, report.exterior_sigmas,
    )  # fmt: skip
    kept: Compared | None = None if anew else session.products.load_value(COMPARISONS, digest)
    if kept is not None:
        return kept
    errors = block_errors(given, report, dem)
    compared: dict[str, MosaicAccuracy] = {}
    doubts: list[Doubt] = []
    for number, (name, one) in enumerate(other.items()):
        part = work.part(number / len(other), (number + 1) / len(other))
        try:
            own = replace(errors, ortho_sigma_m=one.sigmas_m(project.block.crs)[0])
            found = _compared(mosaic, one.ortho, own, given.control.orientation, part)
            compared[name] = replace(found, truth_sigma_m=one.ortho_sigma_m)
        except PhotogrammetryError as error:
            told = say("The mosaic is not compared with {name}. {why}", name=name, why=error.told)
            doubts.append(Doubt("reference-not-compared", name, told))
    session.products.save_value(COMPARISONS, digest, (compared, tuple(doubts)))
    return compared, tuple(doubts)


def _compared(
    mosaic: MosaicProduct,
    ortho: Sequence[Path],
    errors: BlockErrors,
    orientation: OrientationOptions,
    work: Work,
) -> MosaicAccuracy:
    """By gray values, which are finest, where both look alike; else also as control is searched.

    Of both, the one that counts more places is told.
    """
    by_gray: MosaicAccuracy | None = None
    with suppress(ReferenceDataError):
        by_gray = compare_orthos(mosaic.path, ortho, progress=work.part(0.0, 0.5).progress)
    if by_gray is not None and by_gray.n >= ALIKE * len(by_gray.places.verdicts):
        return by_gray
    try:
        vectors = measure_misfit(
            mosaic.path, ortho, mosaic.seams, errors, orientation, work.part(0.5, 1.0)
        )
        found = accuracy_as_control(vectors, mosaic.path, ortho)
    except ReferenceDataError:
        if by_gray is None:
            raise
        return by_gray
    return found if by_gray is None or found.n > by_gray.n else by_gray


def make_places(
    session: Session,
    project: Project,
    given: BlockInput,
    mosaic: MosaicProduct,
    report: AdjustmentReport,
    dem: Dem,
    found: tuple[Misfit | None, Sequence[SeamFit]],
) -> tuple[FaultPlace, ...]:
    """Places at which the mosaic is likely wrong, worst first; they are kept for the desk.

    Args:
        session: Where they are kept.
        project: For the outlines of buildings.
        given: The reference, and how the block is adjusted.
        mosaic: The mosaic, on disk.
        report: The adjusted block.
        dem: Heights.
        found: How the mosaic fits the reference, and its photos along the seams.
    """
    products, (misfit, fits) = session.products, found
    files, buildings = given.reference, project.reference.buildings
    version = version_on_disk(products)
    digest = products.digest_of(
        PLACES, 6, version, mosaic.path, mosaic.seams, files, buildings, report.sigma_nought,
        report.exterior_sigmas, report.tie_residuals_px,
    )  # fmt: skip
    kept: tuple[str, tuple[FaultPlace, ...]] | None = products.load_value(PLACES, digest)
    if kept is not None:
        return kept[1]
    places = worst_places(
        () if misfit is None else misfit.places,
        fits,
        mosaic.seams,
        seam_guides(project, mosaic.grid.bounds).buildings,
        errors=block_errors(given, report, dem),
        grid=mosaic.grid,
        dem=dem if files.dem else None,
    )
    products.save_value(PLACES, digest, (version, places))
    return places


def known_places(products: Products) -> tuple[FaultPlace, ...]:
    """Places of the mosaic on disk, worst first; none where an earlier one was looked at."""
    match products.latest_value(PLACES):
        case (version, tuple() as places) if version == version_on_disk(products):
            return cast("tuple[FaultPlace, ...]", places)
        case _:
            return ()


def block_errors(given: BlockInput, report: AdjustmentReport, dem: Dem) -> BlockErrors:
    """What block and reference predict of the misfit."""
    options = report.options or given.adjustment
    influence = influence_of(report, options, terrain=lambda points: dem.heights(points[:, :2]))
    covariances = {} if influence is None else covariances_of(influence)
    files = given.reference
    heights = files.dem_sigma_m if files.dem else level_sigma_m(report, dem)
    return BlockErrors(report, covariances, dem, files.ortho_sigma_m, heights)


def level_sigma_m(report: AdjustmentReport, level: Dem) -> float:
    """How far the ground lies from level ground that stands for a DEM, by the ties, metres.

    Without ties nobody knows: NaN, and no misfit is judged by it.
    """
    ties = report.tie_positions[np.isfinite(report.tie_positions).all(axis=1)]
    return robust_sigma(ties[:, 2] - level.heights(ties[:, :2])) if len(ties) else float("nan")


def _overlap(mosaic: Path, files: ReferenceFiles) -> bool:
    """Whether any of the reference lies under the mosaic."""
    one, other = (open_ortho(paths, files.crs).bounds for paths in ([mosaic], files.ortho))
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    return bool((low < high).all())


def misfit_rows(misfit: Misfit) -> list[tuple[Cell, ...]]:
    """One row for each vector."""
    vectors = misfit.vectors
    columns = (
        (vectors.positions, CENTI),
        (vectors.shifts_m, MILLI),
        (vectors.sigmas_m[:, None], MILLI),
        (vectors.predicted_sigmas_m, MILLI),
        (vectors.probabilities[:, None], MILLI),
    )
    return [
        (
            *(f"{value:.{places}f}" for values, places in columns for value in values[row]),
            vectors.photo_ids[row],
        )
        for row in range(len(vectors.positions))
    ]
