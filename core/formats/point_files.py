"""Surveyed points as tables for Metashape and others."""

from pathlib import Path

from core.errors import ProjectError
from core.formats.exchange import Conventions, ExchangeBlock, ExchangeFormat, ExchangePoint
from core.formats.point_axes import Surroundings
from core.formats.point_list import read_point_list, refuse_doubtful, stated_crs
from core.formats.records import read_text, write_rows
from core.geometry.crs import read_crs
from core.said import say

METASHAPE_HEAD = (
    "Label",
    "X/Easting",
    "Y/Northing",
    "Z/Altitude",
    "Accuracy_X_(m)",
    "Accuracy_Y_(m)",
    "Accuracy_Z_(m)",
    "role",
    "Enabled",
)
"""Heads of Metashape's reference, checks not enabled; `role`, which is ours, brings them back."""
PLAIN_HEAD = ("id", "X", "Y", "Z", "sigma_X", "sigma_Y", "sigma_Z", "role")
"""Heads of the plain table."""


def write_points(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write the plain table.

    Returns:
        What was left out.
    """
    rows = [(p.point_id, *point_numbers(p), p.role) for p in block.points.values()]
    write_rows(path, [PLAIN_HEAD, *rows], [f"# CRS: {block.crs}"] if block.crs else [])
    return _lost(block)


def write_metashape_points(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write the reference of markers as Metashape exports it.

    Returns:
        What was left out.
    """
    head = [f"# CoordinateSystem: {block.crs}"] if block.crs else []
    rows = [
        [p.point_id, *point_numbers(p), p.role, "1" if p.role == "control" else "0"]
        for p in block.points.values()
    ]
    write_rows(path, rows, [*head, "#" + ",".join(METASHAPE_HEAD)])
    return _lost(block)


def read_points(path: Path) -> ExchangeBlock:
    """A table that names its CRS in a comment, and leaves nothing to be asked.

    Raises:
        ProjectError: It names no CRS, a row cannot be used, or something has to be asked.
    """
    crs = stated_crs(read_text(path).splitlines())
    if not crs:
        raise ProjectError(
            path,
            "names no CRS.",
            "Write `# CRS: EPSG:5514` above it, or bring the list in at the desk.",
        )
    read_crs(crs, path)
    found = read_point_list(path, Surroundings(crs))
    refuse_doubtful(path, found, "Bring the list in at the desk, which asks.")
    points = {
        one.point_id: ExchangePoint(
            one.point_id,
            (one.easting, one.northing, one.height),
            one.sigma_m,
            "check" if one.role == "check" else "control",
        )
        for one in found.points
    }
    return ExchangeBlock(crs, points=points, notes=found.evidence)


def point_numbers(point: ExchangePoint) -> tuple[object, ...]:
    """Coordinates and standard deviations as cells of a table."""
    return (*point.position, *(point.sigma_m or ("", "", "")))


def _lost(block: ExchangeBlock) -> tuple[str, ...]:
    if block.measurements or any(p.exterior is not None for p in block.photos.values()):
        return (say("The table holds points alone: no orientations, cameras and measurements."),)
    return ()


def _conventions(sigmas: str, tested: str) -> Conventions:
    return Conventions(
        object_space="easting, northing, height, metres",
        sigmas=sigmas,
        lost="all but surveyed points",
        tested=tested,
    )


POINT_FORMATS: tuple[ExchangeFormat, ...] = (
    ExchangeFormat(
        name="points",
        title="Surveyed points as a table",
        conventions=_conventions("metres, each axis", "our own form"),
        holds="nothing",
        write=write_points,
        read=read_points,
        default_name="points.csv",
        folder=False,
    ),
    ExchangeFormat(
        name="metashape-points",
        title="Metashape: reference of markers",
        conventions=_conventions("metres, each axis", "untested on real files"),
        holds="nothing",
        write=write_metashape_points,
        read=read_points,
        default_name="markers.csv",
        folder=False,
    ),
)
"""Tables of points; lists of any form are read as `[control] points` or at the desk."""
