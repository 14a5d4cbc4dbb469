"""The stages in order: the table of contents of the engine.

Each stage takes the description of the block and the results of earlier stages, and returns a
value. Nothing here knows folders, sessions or screens; `app.run` walks this list. Localisation,
ties and control are repeated from the adjusted block until the photos no longer move.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from core.control.stage import ControlFound, find_control
from core.georeference.stage import Georeferenced, georeference_photos
from core.literature.published_chains import CHAINS, assemble_published
from core.localisation.initial_orientation import Site
from core.localisation.stage import Localised, detect_features, localise_again, localise_photos
from core.matching.reference import open_reference
from core.progress import Work
from core.reference.stage import ReferenceFeatures, find_reference_points
from core.results import BlockInput, StageResults
from core.scans.stage import ScanSet, orient_scans
from core.ties.stage import Tied, tie_photos, ties_of_list

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Stage:
    """One entry of the table of contents."""

    name: str
    """Word used on the command line, for the folder in core, and in the names of products."""
    title: str
    """What the operator reads while it runs."""
    needs: tuple[str, ...]
    """Stages whose values it takes."""
    inputs: Callable[[BlockInput], tuple[Any, ...]]
    """The parts of the description that its value depends on."""
    run: Callable[[BlockInput, StageResults, Work], Any]
    """The work."""
    version: int = 1
    """Counted up when the same inputs give another value than before."""
    repeated: bool = False
    """Whether it is walked again until the block has settled."""
    masked: bool = False
    """Whether it is the first to look at what of a scan is photograph."""


def made(value: T | None) -> T:
    """What an earlier stage made, which the walk has seen to."""
    assert value is not None, "a stage was run before one it needs"
    return value


def _scans(given: BlockInput, results: StageResults, work: Work) -> ScanSet:
    return orient_scans(given.scans, given.cameras, work)


def _georeference(given: BlockInput, results: StageResults, work: Work) -> Georeferenced:
    return georeference_photos(
        made(results.scans),
        given.scan_cameras,
        given.cameras,
        given.georeference,
        files=given.reference,
        work=work,
    )


def _reference(given: BlockInput, results: StageResults, work: Work) -> ReferenceFeatures:
    return find_reference_points(
        made(results.georeference).block,
        results.opened_scans,
        given.reference,
        given.localisation.orientation.finest_gsd_m,
        work=work,
    )


def _localisation(given: BlockInput, results: StageResults, work: Work) -> Localised:
    features, scans = made(results.reference), results.opened_scans
    if results.control is not None:
        adjusted = results.control.report.block
        return localise_again(
            made(results.localisation), adjusted, scans, features, given.reference, work
        )
    placed = made(results.georeference)
    ties = ties_of_list(given.ties, placed.block)
    return localise_photos(
        placed, scans, features, given.reference, given.localisation, work, ties=ties
    )


def _ties(given: BlockInput, results: StageResults, work: Work) -> Tied:
    localised = made(results.localisation)
    if results.ties is not None and results.ties.still_hold(localised.block):
        return results.ties
    ties = ties_of_list(given.ties, localised.block)
    if ties is not None:
        places = {name: photo.exterior for name, photo in localised.block.photos.items()}
        return Tied(ties, (), places)
    features = localised.features or detect_features(
        localised.block, results.opened_scans, given.localisation, work.part(0.0, FEATURES_SHARE)
    )
    return tie_photos(localised.block, features, given.localisation.ties, work)


def _control(given: BlockInput, results: StageResults, work: Work) -> ControlFound:
    if given.preset != "gruber":
        return _published_control(given, results, work)
    return find_control(
        made(results.localisation),
        made(results.ties).ties,
        results.opened_scans,
        made(results.reference),
        given.reference,
        given.surveyed,
        results.control,
        given.control,
        work,
    )


def _published_control(given: BlockInput, results: StageResults, work: Work) -> ControlFound:
    """Control as a published chain finds it, from where the archive puts the photos.

    Those chains look no further than a repaired georeference may be off, and do not repeat.
    """
    block, features = made(results.georeference).block, made(results.reference)
    points = {point.point_id: point for point in given.surveyed}
    block = replace(block, surveyed=points, ties=made(results.ties).ties)
    reference = open_reference(given.reference, block.search_bounds)
    site = Site(reference, results.opened_scans, features.points, features.sources)
    report, doubts = assemble_published(
        block, site, CHAINS[given.preset], given.adjustment, work.random(given.preset), work.mapper
    )
    return ControlFound(report, doubts, moved=0.0)


# design: share of the bar on the screen; nothing is computed from it.
FEATURES_SHARE = 0.3
"""Share of the stage of ties that finding features takes."""

STAGES: tuple[Stage, ...] = (
    Stage(
        "scans",
        "Interior orientation of the scans",
        (),
        lambda given: (given.scans, given.cameras, [scan.path for scan in given.scans]),
        _scans,
        version=11,
    ),
    Stage(
        "georeference",
        "Approximate exterior orientation",
        ("scans",),
        lambda given: (given.georeference, given.reference),
        _georeference,
        version=4,
    ),
    Stage(
        "reference",
        "Junctions and salient points",
        ("georeference",),
        lambda given: (given.reference, given.localisation.orientation.finest_gsd_m),
        _reference,
        version=4,
    ),
    Stage(
        "localisation",
        "The photos on the reference",
        ("georeference", "reference"),
        lambda given: (given.localisation, *given.ties),
        _localisation,
        version=2,
        repeated=True,
        masked=True,
    ),
    Stage(
        "ties",
        "Tie points between the scans",
        ("localisation",),
        lambda given: (given.localisation.ties, *given.ties),
        _ties,
        version=8,
        repeated=True,
    ),
    Stage(
        "control",
        "Control points and the block",
        ("localisation", "ties", "reference"),
        lambda given: (given.control, given.surveyed, given.preset),
        _control,
        version=16,
        repeated=True,
    ),
)
"""What is computed before any decision; the adjustment with decisions, the orthos and the mosaic
follow in `app.run`, because they depend on the session."""
