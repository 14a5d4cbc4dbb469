"""The plan of a block's checks: places drawn on its reference, or a list of the user."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from app.bring_points import brought_points
from app.project import Project, described, listed_points
from core.adjustment.adjusted import AdjustmentReport
from core.block import Block
from core.control.stage import ControlFound
from core.errors import ProjectError
from core.formats.roads import read_roads
from core.geometry.crs import Bounds
from core.georeference.stage import Georeferenced
from core.localisation.photo_orientation import OrientationOptions
from core.matching.reference import level_of, open_reference
from core.orthos.rectification import footprint_of
from core.progress import SILENT, Progress
from core.quality.check_plan import CheckPlace, DrawnPlan, PlanRequest, draw_places
from core.raster.dem import Dem
from core.reference.stage import junctions_of
from core.said import say
from sessions.checks import new_plan
from sessions.decisions import PlanChecks, Recorded
from sessions.session import Session

LEAST_SIGMA_M = 0.001
"""Nothing is surveyed better; nought would mean that the reference is read."""


@dataclass(frozen=True, slots=True)
class PlanWish:
    """What is asked of a plan."""

    cells: tuple[int, int] | None = None
    """Columns and rows of the grid; as many as give enough places when None."""
    seed: int = 1
    """Decides between places that are shown equally well."""
    points: Path | None = None
    """Surveyed points to be checked instead."""


@dataclass(frozen=True, slots=True)
class MadePlan:
    """A plan, and what is to be said about it."""

    plan: PlanChecks
    """The plan."""
    enough: bool
    """Whether the rules of the job allow a statement when all places are read."""
    remarks: tuple[str, ...]
    """What the user should know."""
    recorded: Recorded | None = None
    """The decision, once it is on disk."""


def plan_checks(
    project: Project, session: Session, wish: PlanWish, progress: Progress = SILENT
) -> MadePlan:
    """Draw a plan, as `draw_plan` does, and record it."""
    made = draw_plan(project, session, wish, progress)
    recorded = session.record(made.plan)
    # Its number may be another: somebody else may have drawn one meanwhile.
    return replace(made, plan=cast("PlanChecks", recorded.decision), recorded=recorded)


def draw_plan(
    project: Project, session: Session, wish: PlanWish, progress: Progress = SILENT
) -> MadePlan:
    """Choose places to be checked; nothing of the block changes.

    Args:
        project: The block.
        session: Its session; it is only read.
        wish: Grid and seed, or a list.
        progress: Told per cell.

    Raises:
        ProjectError: The block was not run as far as georeference, or there is nothing to draw on.
    """
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    if placed is None or not placed.block.photos:
        raise ProjectError(
            project.file,
            "nothing says yet where the photos lie.",
            say(
                "Run it first: gruber run {folder}", folder=f"{project.folder} --until georeference"
            ),
        )
    beforehand = session.products.latest_value("control") is None
    request, crs = _request(project, session, placed, wish), project.block.crs
    if wish.points is None:
        if not request.ortho.is_there:
            raise ProjectError(
                project.file,
                "has no reference ortho on which places could be drawn.",
                "Give surveyed points with --points.",
            )
        drawn, remarks = draw_places(request, progress), list[str]()
        source = ""
    else:
        drawn, remarks = _listed(request, wish.points, crs, _control_names(project, session))
        source = wish.points.name
    if not drawn.places:
        raise ProjectError(
            wish.points or project.file,
            "gives no place to check within the ground of the photos.",
            "Check its coordinates, or ask for other --cells.",
        )
    plan = new_plan(
        drawn.places,
        drawn.cells,
        wish.seed if not source else 0,
        source,
        beforehand=beforehand,
        decisions=session.decisions(),
    )
    remarks += _remarks(drawn, request.least, beforehand)
    return MadePlan(plan, drawn.count >= request.least, tuple(remarks))


def _remarks(drawn: DrawnPlan, least: int, beforehand: bool) -> list[str]:
    """What weakens a plan."""
    found: list[str] = []
    if drawn.empty:
        told = "No place is shown well and away from control in {count:# cell|# cells} of the grid."
        found.append(say(told, count=drawn.empty))
    if drawn.count < least:
        told = (
            "{count:# place is|# places are} fewer than the {least} that the rules of the job ask "
            "for: no statement by them."
        )
        found.append(say(told, count=drawn.count, least=least))
    if not beforehand:
        found.append(
            "Control of this block has been searched already; the plan and the report say so."
        )
    return found


def _request(
    project: Project, session: Session, placed: Georeferenced, wish: PlanWish
) -> PlanRequest:
    """Ground, reference and control of a block as it stands now."""
    given = described(project, brought_points(session))
    adjusted = cast("AdjustmentReport | None", session.products.latest_value("adjustment"))
    found = cast("ControlFound | None", session.products.latest_value("control"))
    block = placed.block if adjusted is None else adjusted.block
    bounds: Bounds = placed.block.search_bounds
    reference = open_reference(given.reference, bounds, level_of(block))
    roads = read_roads(given.reference.roads, given.reference.crs, bounds)
    listed = [point.position[:2] for point in given.surveyed if point.role == "control"]
    used = [] if found is None else _used_control(block if adjusted else found.report.block)
    control = np.array([*listed, *used], dtype=np.float64).reshape(-1, 2)
    orientation = given.control.orientation
    return PlanRequest(
        ground_of(block, reference.dem),
        reference.ortho,
        control,
        patch_half_m(block, orientation),
        wish.seed,
        junctions_of(roads, reference, given.reference, bounds),
        ground_pixel_m(block),
        wish.cells,
        project.rules.readings,
    )


def _used_control(block: Block) -> list[np.ndarray]:
    """Places of control in use."""
    names = {key[0] for key, item in block.measurements.items() if block.steers(item)}
    return [block.surveyed[name].position[:2] for name in sorted(names)]


def ground_of(block: Block, dem: Dem) -> BaseGeometry:
    """Ground that the photos of a block show, in its CRS; of oriented ones where there are any."""
    oriented = [photo for photo in block.photos.values() if photo.oriented]
    photos = oriented or list(block.photos.values())
    outlines = [footprint_of(photo, block.camera_of(photo.photo_id), dem) for photo in photos]
    ground = shapely.union_all(outlines)
    assert isinstance(ground, BaseGeometry)
    return ground


def patch_half_m(block: Block, options: OrientationOptions) -> float:
    """Half the side of the patches that control is compared by, metres on the ground."""
    return options.template_half_px * max(options.finest_gsd_m, ground_pixel_m(block))


def ground_pixel_m(block: Block) -> float:
    """Median pixel of the photos on the ground, metres."""
    pixels = [photo.ground_pixel_m(block.camera_of(name)) for name, photo in block.photos.items()]
    return float(np.median(pixels))


def _control_names(project: Project, session: Session) -> set[str]:
    """Points of the user that steer the block."""
    given = described(project, brought_points(session))
    brought = {point.point_id for point in brought_points(session) if point.role != "check"}
    return brought | {point.point_id for point in given.surveyed if point.role == "control"}


def _listed(
    request: PlanRequest, file: Path, crs: str, control: set[str]
) -> tuple[DrawnPlan, list[str]]:
    """Places of a list: those within the block that do not steer it."""
    points = listed_points(file, crs)
    if not points:
        raise ProjectError(
            file, "lists no point.", "Write one row for each point below the header."
        )
    inside = [p for p in points if shapely.contains_xy(request.ground, p.easting, p.northing)]
    free = [point for point in inside if point.point_id not in control]
    places = [
        CheckPlace(
            point.point_id,
            point.easting,
            point.northing,
            max(float(np.sqrt(np.mean(np.square(point.sigma_m[:2])))), LEAST_SIGMA_M),
        )
        for point in free
    ]
    remarks: list[str] = []
    if outside := len(points) - len(inside):
        told = "No photo shows {count:# point|# points} of the list; left out."
        remarks.append(say(told, count=outside))
    if steering := len(inside) - len(free):
        told = "{count:# point of the list is|# points of the list are} control; left out."
        remarks.append(say(told, count=steering))
    return DrawnPlan(tuple(places), (0, 0), 0), remarks


def told_lines(made: MadePlan) -> Sequence[str]:
    """What came of a plan, a sentence each."""
    plan = made.plan
    first = say(
        "{count:# place|# places} to be checked, digest {digest}.",
        count=plan.count,
        digest=plan.digest,
    )
    spares = len(plan.places) - plan.count
    told = "{count:# spare|# spares} to follow where one cannot be read."
    following = (say(told, count=spares),) if spares else ()
    return (first, *following, *made.remarks, "Read them at the desk, under Checks.")
