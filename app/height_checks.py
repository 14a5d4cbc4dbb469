"""Check before and after a run that block, DEM and point list use one height system."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from pyproj import CRS

from app.project import Project
from core.arrays import ObjectPoints
from core.block import UNKNOWN_M, SurveyedPoint
from core.doubts import Doubt
from core.errors import PhotogrammetryError
from core.geometry.crs import shared_bounds
from core.geometry.heights import (
    ELLIPSOIDAL,
    height_offset,
    height_system,
    told_offset,
    vertical_of,
)
from core.matching.reference import DEM_SIGMA
from core.raster.dem import Dem, HeightSource, open_dem
from core.raster.files import open_plain
from core.results import StageResults
from core.said import Said, say


def height_doubts(
    project: Project, surveyed: Sequence[SurveyedPoint], dem: HeightSource
) -> tuple[Doubt, ...]:
    """What is doubtful about the heights of a block.

    Args:
        project: The block.
        surveyed: Its user's points.
        dem: Heights of the ground.
    """
    told = [*_systems(project)]
    if project.reference.dem and surveyed:
        file = "" if project.control.points is None else project.control.points.name
        own = offset_told(file, surveyed, dem, project.reference.sigmas_m(project.block.crs)[1])
        told += [own] if own is not None else []
    if project.reference.dem and isinstance(dem, Dem):
        told += _other_heights(project, dem)
    return tuple(Doubt("heights", "heights", one) for one in told)


def doubts_after(
    project: Project, results: StageResults, dem: Callable[[], HeightSource]
) -> tuple[Doubt, ...]:
    """Every doubt of a run, gravest first: once it was adjusted, those about heights as well.

    Args:
        project: The block.
        results: What its stages made, with the points that the session brought.
        dem: Opens the heights of the ground.
    """
    if results.adjustment is None:
        return results.doubts
    every = results.adjustment.block.surveyed.values()
    surveyed = [point for point in every if point.source == "surveyed"]
    heights = height_doubts(project, surveyed, dem())
    return tuple(sorted((*results.doubts, *heights), key=lambda doubt: -doubt.gravity))


def offset_told(
    name: str, surveyed: Sequence[SurveyedPoint], dem: HeightSource, dem_sigma_m: float
) -> Said | None:
    """The question about a list whose heights lie off the DEM all alike; None where they fit.

    Args:
        name: The list, as the user knows it.
        surveyed: Its points, in the block's CRS.
        dem: Heights of the ground.
        dem_sigma_m: Their standard deviation, metres.
    """
    known = [point for point in surveyed if point.sigma_m[2] < UNKNOWN_M]
    places: ObjectPoints = np.array([point.position for point in known]).reshape(-1, 3)
    sigma = np.hypot([point.sigma_m[2] for point in known], dem_sigma_m)
    return told_offset(name or "block.toml", places[:, 2], dem.heights(places[:, :2]), sigma)


# design: a tenth of them on houses or in woods decides nothing
SIDE = 20
"""So many heights are compared along each side of what two terrain models share."""


def _other_heights(project: Project, dem: Dem) -> Iterator[Said]:
    """What is wrong with further heights, which may be of another system than those in use."""
    own_sigma_m = project.reference.sigmas_m(project.block.crs)[1]
    for other in project.reference.other:
        try:
            heights = open_dem(other.dem, project.block.crs) if other.dem else None
        except PhotogrammetryError as error:
            yield error.told
            continue
        if heights is None:
            continue
        west, south, east, north = shared_bounds(dem.bounds, heights.bounds)
        across, along = np.linspace(west, east, SIDE), np.linspace(south, north, SIDE)
        places = np.array(np.meshgrid(across, along), dtype=np.float64).reshape(2, -1).T
        sigma_m = other.dem_sigma_m or DEM_SIGMA.expected_m(heights.ground_sample_distance_m)
        allowed = np.full(len(places), np.hypot(own_sigma_m, sigma_m))
        found = height_offset(heights.heights(places), dem.heights(places), allowed)
        if found is not None:
            yield say(
                "{name}: heights lie {offset:+.1f} m off the DEM, all alike (scatter {scatter:.1f} "
                "m). Are they of another system? Then one of the two is not in that of the block.",
                name=other.dem[0].name,
                offset=found.offset_m,
                scatter=found.scatter_m,
            )


def _systems(project: Project) -> list[Said]:
    """What block.toml and the DEM's own CRS say against each other."""
    own = height_system(project.block.heights)
    if own is None:
        return [
            say(
                "block.toml [block] heights: {heights} is no height system that is known here. It "
                'is compared with nothing. Write "Bpv", "ellipsoidal" or a code such as '
                '"EPSG:8357".',
                heights=project.block.heights,
            )
        ]
    told: list[Said] = []
    for path in project.reference.dem[:1]:
        with open_plain(path, {}) as file:
            there = vertical_of(CRS.from_wkt(file.crs.to_wkt())) if file.crs else ""
        if own and there and own != there:
            told.append(
                say(
                    "{file} has heights in {there}, and block.toml [block] heights says {own}. "
                    "Heights are taken as they are: bring the DEM to the block's system, or name "
                    "its system in block.toml.",
                    file=path.name,
                    there=_named(there),
                    own=_named(own),
                )
            )
    return told


def _named(system: str) -> str:
    """A height system as people call it."""
    if system == ELLIPSOIDAL or not system.upper().startswith("EPSG:"):
        return system
    return f"{system} ({CRS.from_user_input(system).name})"
