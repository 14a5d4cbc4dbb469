"""Import lists of surveyed points: read, compare with the block's ground, record as a whole."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from app.answers import named_columns, parted, positive
from app.project import Project, listed_points
from core.block import Block, SurveyedPoint, surveyed_point
from core.control.stage import ControlFound
from core.errors import ProjectError
from core.formats.listed_point import QUANTITIES, ListedPoint, PointList, PointListReading, Quantity
from core.formats.point_axes import Ground, Surroundings
from core.formats.point_list import read_point_list
from core.formats.rotations import triple_of
from core.geometry.heights import height_system
from core.georeference.stage import Georeferenced
from core.raster.dem import HeightSource, open_dem
from core.said import say
from sessions.decisions import BringPoints, Recorded, standing
from sessions.session import Session

POINT_TABLE = "points"
"""What `gruber import --from` calls any table of surveyed points."""
ANSWERS = ("encoding", "delimiter", "decimal", "columns", "axes", "crs", "role", "duplicates",
           "outside", "heights", "height_system", "refused", "sigma_xy", "sigma_Z")  # fmt: skip
"""What a word settles: fields of `PointListReading`, and accuracies of rows that say none."""
SIGMA_FIELDS = {"sigma_xy": "sigma_plan_m", "sigma_Z": "sigma_height_m"}
"""The fields of these accuracies, metres."""


@dataclass(frozen=True, slots=True)
class BroughtPoints:
    """What came of a list."""

    found: PointList
    """The list: points, refused rows, evidence and questions."""
    recorded: Recorded | None
    """The decision that brings its points; None where a question was left: nothing came in."""
    replaced: tuple[str, ...] = ()
    """Names of points the block had before."""


class OpenQuestionsError(ProjectError):
    """A list leaves something to be asked, and nothing of it came in.

    Attributes:
        lines: Evidence, refused rows and questions with their answers, a sentence each.
    """

    def __init__(self, path: Path, lines: Sequence[str]) -> None:
        """The lines stand below the message in a traceback, too."""
        super().__init__(
            path,
            "no point was taken over.",
            "Settle what is asked with --answer, in Python with answers=.",
        )
        self.lines = tuple(lines)
        for line in lines:
            self.add_note(line)


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
    block = known_block(project, session)
    files, crs = project.reference.dem, project.block.crs
    ground = ground_of(project, open_dem(files, crs) if files else None)
    found = read_point_list(path, surroundings(crs, block, ground), reading)
    if found.questions or not found.points:
        return BroughtPoints(found, None)
    before = {} if block is None else block.surveyed
    replaced = tuple(point.point_id for point in found.points if point.point_id in before)
    return BroughtPoints(found, session.record(BringPoints(found.points, path.name)), replaced)


def known_block(project: Project, session: Session) -> Block | None:
    """The block as far as it was run, with all decisions; None where nothing places its photos."""
    control = cast("ControlFound | None", session.products.latest_value("control"))
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    if control is not None:
        return session.replayed(control.report.block, given=project.cameras)
    return None if placed is None else session.replayed(placed.block, given=project.cameras)


def brought_points(session: Session) -> tuple[ListedPoint, ...]:
    """Points that stand in the session, whatever `block.toml` lists."""
    said = [item.decision for item in standing(session.decisions())]
    return tuple(p for one in said if isinstance(one, BringPoints) for p in one.points)


def points_of(
    project: Project, session: Session, block: Block | None
) -> Mapping[str, SurveyedPoint]:
    """All points of a block by name: listed, brought, clicked and proposed."""
    listed = listed_points(project.control.points, project.block.crs)
    surveyed = {p.point_id: surveyed_point(p) for p in (*listed, *brought_points(session))}
    return surveyed | ({} if block is None else dict(block.surveyed))


def ground_of(project: Project, dem: HeightSource | None) -> Ground:
    """The heights of a block, with which those of a list are compared."""
    system = height_system(project.block.heights) or ""
    if dem is None or not project.reference.dem:
        return Ground(system=system)
    return Ground(dem.heights, project.reference.sigmas_m(project.block.crs)[1], system)


def surroundings(crs: str, block: Block | None, ground: Ground) -> Surroundings:
    """Where the points of a list ought to lie, and the points whose names are the block's."""
    if block is None or not block.photos:
        return Surroundings(crs, ground=ground)
    taken = {
        name: triple_of(point.position)
        for name, point in block.surveyed.items()
        if point.source != "surveyed"
    }
    return Surroundings(crs, block.bounds, taken, ground)


def reading_of(answers: Sequence[str]) -> PointListReading:
    """How a list is to be read, from words such as `axes=-E -N`.

    Raises:
        ProjectError: A word answers nothing that is asked, or not in a way there is.
    """
    reading = PointListReading()
    for answer in answers:
        name, value = parted(answer, ANSWERS)
        if name == "columns":
            columns = cast("tuple[Quantity, ...]", named_columns(value, QUANTITIES))
            reading = replace(reading, columns=columns)
        elif name in SIGMA_FIELDS:
            reading = replace(reading, **{SIGMA_FIELDS[name]: positive(name, value)})
        else:
            reading = replace(reading, **{name: value})
    return reading


def told_lines(brought: BroughtPoints) -> Iterator[str]:
    """What came of a list, a sentence each: evidence, refused rows, and the questions left."""
    found = brought.found
    yield from found.evidence
    for row in found.refused:
        yield say(
            "Row {number}: {cause} {remedy}",
            number=row.number,
            cause=row.cause,
            remedy=row.remedy,
        )
    for question in found.questions:
        yield question.words
        for choice in question.choices:
            yield say(
                "  --answer {about}={value!r}: {words}",
                about=question.about,
                value=choice.value,
                words=choice.words,
            )
