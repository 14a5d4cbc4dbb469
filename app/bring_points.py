"""Lists of surveyed points into a block: read, judged against its ground, recorded whole or not."""

from dataclasses import dataclass
from pathlib import Path
from typing import cast

from app.project import Project
from core.block import Block
from core.control.stage import ControlFound
from core.formats.listed_point import PointList, PointListReading
from core.formats.point_axes import Surroundings
from core.formats.point_list import read_point_list
from core.georeference.stage import Georeferenced
from sessions.decisions import BringPoints, Recorded
from sessions.session import Session


@dataclass(frozen=True, slots=True)
class BroughtPoints:
    """What came of a list."""

    found: PointList
    """The list: points, refused rows, evidence and questions."""
    recorded: Recorded | None
    """The decision that brings its points; None where a question was left: nothing came in."""
    replaced: tuple[str, ...] = ()
    """Names of points the block had before."""


def bring_points(
    project: Project, session: Session, path: Path, reading: PointListReading | None = None
) -> BroughtPoints:
    """Bring a list of surveyed points into a block.

    All of its points come in by one decision, or none where a question is left open.

    Args:
        project: The block.
        session: Its session.
        path: The list.
        reading: How it is to be read, and answers to questions.

    Raises:
        PhotogrammetryError: The file is no table of text, or its CRS is unknown.
    """
    block = known_block(session)
    found = read_point_list(path, surroundings(project.block.crs, block), reading)
    if found.questions or not found.points:
        return BroughtPoints(found, None)
    before = {} if block is None else block.surveyed
    replaced = tuple(point.point_id for point in found.points if point.point_id in before)
    return BroughtPoints(found, session.record(BringPoints(found.points, path.name)), replaced)


def known_block(session: Session) -> Block | None:
    """The block as far as it was run, with all decisions; None where nothing places its photos."""
    control = cast("ControlFound | None", session.products.latest_value("control"))
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    if control is not None:
        return session.replayed(control.report.block)
    return None if placed is None else session.replayed(placed.block)


def surroundings(crs: str, block: Block | None) -> Surroundings:
    """Where the points of a list ought to lie, and the names they may not have."""
    if block is None or not block.photos:
        return Surroundings(crs)
    taken = (name for name, point in block.surveyed.items() if point.source != "surveyed")
    return Surroundings(crs, block.bounds, frozenset(taken))
