"""Surveyed points as tables for Metashape, Pix4D and others."""

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
POINTS, CHECKS, MARKS = "gcp.csv", "checkpoints.csv", "marks.csv"
"""Files for Pix4D: control, checks, and where they are seen."""


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


def write_pix4d_points(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write control, checks and their marks, without heads, into a folder.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    for file, role in ((POINTS, "control"), (CHECKS, "check")):
        rows = [[p.point_id, *_for_pix4d(p)] for p in block.points.values() if p.role == role]
        if rows or role == "control":
            write_rows(path / file, rows)
    files = {name: photo.file for name, photo in block.photos.items()}
    marks = [
        [files.get(one.photo_id, one.photo_id), one.point_id, one.column, one.row]
        for one in block.measurements
    ]
    write_rows(path / MARKS, marks)
    notes: list[str] = []
    if any(photo.exterior is not None for photo in block.photos.values()):
        notes.append(say("The table holds points alone: no orientations and no cameras."))
    if any(one.sigma_px for one in block.measurements):
        notes.append(say("Standard deviations of measurements are left out."))
    return tuple(notes)


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


def _for_pix4d(point: ExchangePoint) -> tuple[float, ...]:
    """Coordinates, then accuracy in plan and height."""
    sigma = point.sigma_m
    return (*point.position, *((max(sigma[:2]), sigma[2]) if sigma is not None else ()))


def _lost(block: ExchangeBlock) -> tuple[str, ...]:
    if block.measurements or any(p.exterior is not None for p in block.photos.values()):
        return (say("The table holds points alone: no orientations, cameras and measurements."),)
    return ()


def _conventions(sigmas: str, tested: str, pixels: str = "none") -> Conventions:
    return Conventions(
        pixels=pixels,
        object_space="easting, northing, height, metres",
        sigmas=sigmas,
        lost="all but surveyed points" + ("" if pixels == "none" else " and their measurements"),
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
    ExchangeFormat(
        name="pix4d-points",
        title="Pix4D: control, checks and marks",
        conventions=_conventions(
            "metres, plan and height",
            "untested on real files",
            "column right, row down, outer corner of the first pixel",
        ),
        holds="upright",
        write=write_pix4d_points,
        default_name="pix4d",
    ),
)
"""Tables of points; lists of any form are read as `[control] points` or at the desk."""
