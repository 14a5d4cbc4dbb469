"""Sections of `block.toml`: all but map sheets, and those that `app/project.py` reads itself."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date, datetime
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import pyogrio

from app.block_toml import Document, Table
from app.job_rules import read_rules
from core.adjustment.adjusted import AdjustmentOptions
from core.doubts import Failure
from core.errors import CrsError, PhotogrammetryError
from core.formats.micmac_points import read_camera_measures
from core.formats.records import read_rows
from core.formats.stac import time_span
from core.formats.vectors import GDAL_ERRORS, LAYER_MARK, no_remarks
from core.geometry.camera import SETS, Camera, additional_set, polynomial_from_table
from core.geometry.collinearity import CORRECTIONS
from core.geometry.crs import parse_crs, read_crs
from core.georeference.principal_distance import camera_types, proposed_distances, types_named
from core.orthos.rectification import Resampling
from core.quality.job_rules import USUAL_RULES, JobRules
from core.said import say
from core.surface.stage import SurfaceOptions

MARKS = (0, 4, 8)

TAKEN = ("file", "time")
"""Columns of a list of times."""
NO_DATE = "Write a day, a month or a year: 1938-05-16, 1938-05 or 1938."


@dataclass(frozen=True, slots=True)
class BlockSection:
    """`[block]`."""

    name: str
    """Name of the block, for the report."""
    crs: str
    """Horizontal CRS: X east, Y north, metres."""
    heights: str = ""
    """Height system, in words or as a code."""
    corrections: tuple[str, ...] = CORRECTIONS
    """What rays are corrected for."""
    rules: JobRules = USUAL_RULES
    """Limits by which the block is judged."""


@dataclass(frozen=True, slots=True)
class OrthoSection:
    """`[ortho]`."""

    gsd_m: float | None = None
    """Ground sample distance of orthos and mosaic, metres; None takes that of the reference."""
    balance: bool = True
    ground: str = "dem"
    """What orthos stand on: `dem`, `surface` or `auto`."""
    tone: str = ""
    """Whose tone a balanced mosaic has: `reference`, a scan, or all photos' mean."""
    visibility: bool = False
    """Whether orthos leave out what their photos do not see."""
    area: Path | None = None
    """Polygons outside of which nothing is made."""
    resampling: Resampling = "cubic"
    """Kernel by which scans are sampled."""
    edge_mm: float = 1.0
    """Strip along the frame's edge that is left out, millimetres."""


def read_camera(document: Document, name: str) -> Camera:
    """One camera.

    Raises:
        ProjectError: Something in its table cannot be used.
        ScanError: `fiducials_file` holds no marks.
    """
    table = document.table("camera", name)
    width, height = table.measures("frame_mm")
    distances = _distances(table, (width, height))
    longer, radial = _radial_distortion(table)
    east, north = table.numbers("principal_point_mm")
    if abs(east) > width / 2 or abs(north) > height / 2:
        remedy = "Write millimetres, counted from the fiducial centre (x right, y up)."
        raise table.error("principal_point_mm", "lies outside the picture.", remedy)
    return Camera(
        name,
        distances[0][0] if distances else longer * table.number("principal_distance_mm"),
        (width, height),
        (east, north),
        radial,
        fiducials_of(table, max(width, height)),
        table.choice("data_strip"),
        _marks(table),
        table.flag("digital"),
        _decentring(table, max(width, height) / 2),
        distances[0][1] if distances else 0.0,
        distances,
    )


def _distances(table: Table, frame_mm: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """What the principal distance may be where it is left out; nothing where it is given."""
    if table.has("principal_distance_mm"):
        return ()
    make, model = table.text("make"), table.text("model")
    if (make or model) and not types_named(make, model):
        models = dict.fromkeys(kind.model for kind in camera_types() if kind.model)
        remedy = say("Leave make and model out, or name one of {models}.", models=list(models))
        key = "model" if model else "make"
        raise table.error(key, "no certificate of this camera type is known.", remedy)
    return proposed_distances(make, model, frame_mm)


def _decentring(table: Table, half_mm: float) -> tuple[float, ...]:
    """The camera's deformation by its tangential terms; none where both are nought."""
    given = table.numbers("decentring")
    if not any(given):
        return ()
    # One of the set's parameters is millimetres at the edge: 4 p h^2.
    values = 4 * half_mm**2 * np.array(given)
    return tuple((values @ additional_set(("tangential",)).basis.reshape(2, -1)).tolist())


def _radial_distortion(table: Table) -> tuple[float, tuple[float, float, float]]:
    """k1, k2, k3; those left out are nought, or fitted to the certificate's table.

    Before them what the principal distance is to be multiplied with, so that they are of it.
    """
    given = table.numbers("radial_distortion")
    k1, k2, k3, *_ = (*given, 0.0, 0.0, 0.0)
    if not table.has("distortion_table_um"):
        return 1.0, (k1, k2, k3)
    key = "distortion_table_um"
    if given:
        remedy = "Leave one of the two out."
        raise table.error(key, "radial_distortion says the same in another way.", remedy)
    rows = table.values[key]
    if not isinstance(rows, list):
        raise table.error(key, "must be a list of pairs.", "Write [[10, -1.0], [20, -1.5], ...].")
    pairs = [table.sequence(key, row, 2) for row in cast("list[object]", rows)]
    fitted = polynomial_from_table([(radius, shift) for radius, shift in pairs])
    if isinstance(fitted, Failure):
        raise table.error(key, fitted.reason, "Give the certificate's table, four rows or more.")
    return fitted[:2]


def _marks(table: Table) -> int:
    """How many marks the camera has, where nobody knows their places."""
    value: object = table.values.get("fiducial_marks", 0)
    if isinstance(value, bool) or value not in MARKS:
        remedy = "Write 4 or 8, or leave it out."
        raise table.error(
            "fiducial_marks",
            say("must be 4 or 8, not {value!r}.", value=value),
            remedy,
        )
    return int(cast(int, value))


def fiducials_of(table: Table, side_mm: float) -> dict[str, tuple[float, float]]:
    """Certified marks by name, from the table itself or from MicMac's file."""
    key = "fiducials_mm"
    given = table.values.get(key, {})
    file = table.file("fiducials_file")
    if file is not None:
        if given:
            remedy = "Leave one of the two out."
            raise table.error("fiducials_file", "fiducials_mm is given too.", remedy)
        key, given = "fiducials_file", {n: list(p) for n, p in read_camera_measures(file).items()}
    if not isinstance(given, dict):
        raise table.error(key, "must name each mark.", "Write { 1 = [-84.5, 0.3], ... }.")
    fiducials: dict[str, tuple[float, float]] = {}
    in_millimetres = "Write millimetres from the fiducial centre, x right, y up."
    for name, value in cast("dict[str, object]", given).items():
        x, y = table.sequence(key, value, 2)
        if max(abs(x), abs(y)) > side_mm:
            cause = say("mark {name} lies far outside the picture.", name=name)
            raise table.error(key, cause, in_millimetres)
        fiducials[name] = x, y
    if len(fiducials) == 1:
        remedy = "Give two or more, or leave them all out."
        raise table.error(key, "one mark alone says nothing of scale and rotation.", remedy)
    # Marks lie at the rim; in centimetres all would lie in the middle, and none be found.
    farthest = max((abs(value) for place in fiducials.values() for value in place), default=side_mm)
    if farthest < side_mm / 4:
        raise table.error(key, "all marks lie in the middle of the picture.", in_millimetres)
    return fiducials


def taken_in(table: Table) -> str | dict[str, str]:
    """What `[scans]` says of the time of exposure: one day for all scans, or days by file.

    Raises:
        ProjectError: Something in it is no date, or its list cannot be read.
    """
    given = table.values.get("taken")
    if isinstance(given, dict):
        times = cast("dict[str, object]", given)
        return {name: _day_in(table, value) for name, value in times.items()}
    if not isinstance(given, str) or not _is_list(table, given):
        return taken_of(table, "")
    file, days = table.files("taken")[0], dict[str, str]()
    for row in read_rows(file, TAKEN):
        name, time = row.filled(TAKEN[0]), row.cell(TAKEN[1])
        day = _time_of(time)
        if day is None:
            raise row.refused(
                'Line {number}: "{said}" is no date between 1858 and 2015, when film was exposed.',
                NO_DATE,
                said=time,
            )
        days[name] = day
    return days


def taken_of(table: Table, usual: str) -> str:
    """The day of exposure that a table states, else the usual one."""
    return _day_in(table, table.values["taken"]) if table.has("taken") else usual


def _is_list(table: Table, given: str) -> bool:
    """Whether a text that is no date names a list of files and times."""
    there = os.path.isfile(table.document.path.parent / given)
    return _time_of(given) is None and (there or given.lower().endswith(".csv"))


def _day_in(table: Table, given: object) -> str:
    day = _time_of(given)
    if day is None:
        cause = say('"{said}" is no date between 1858 and 2015, when film was exposed.', said=given)
        raise table.error("taken", cause, NO_DATE)
    return day


def _time_of(given: object) -> str | None:
    """Day, month or year as ISO has it, or a time with its offset from UTC; None where none."""
    text = given.isoformat() if isinstance(given, date) else given
    if not isinstance(text, str):
        return None
    day, _, hour = text.strip().replace("T", " ", 1).partition(" ")
    known = day
    try:
        if hour and (moment := datetime.fromisoformat(f"{day}T{hour}")).tzinfo is not None:
            known = moment.isoformat()
    except ValueError:
        return None
    return None if isinstance(time_span(day), Failure) else known


def adjustment_options(document: Document) -> AdjustmentOptions:
    """The options of `[adjustment]`, every key with its default."""
    table = document.table("adjustment")
    test = table.choice("gross_errors")
    return AdjustmentOptions(
        estimate_cameras=table.flag("cameras"),
        sigma_principal_distance_mm=table.number("sigma_principal_distance_mm"),
        sigma_principal_point_mm=table.number("sigma_principal_point_mm"),
        sigma_distortion_um=table.number("sigma_distortion_um"),
        robust=test != "none",
        self_calibration=_sets(table),
        per_photo=table.choice("self_calibration_per") == "photo",
        sigma_additional_um=table.number("sigma_additional_um"),
        only_significant=table.flag("only_significant"),
        gnss_shift=cast("Literal['none', 'block', 'strip']", table.choice("gnss_shift")),
        gnss_drift=table.flag("gnss_drift"),
        misalignment=table.flag("imu_misalignment"),
        dem_sigma_m=table.number("dem_sigma_m"),
        free_network=table.choice("network") == "free",
        variance_components=table.flag("variance_components"),
        test="tau" if test == "tau" else "w",
        risk=table.number("risk"),
        compare_methods=table.flag("compare_methods"),
    )


def surface_options(document: Document) -> SurfaceOptions | None:
    """The options of `[surface]`; None where the table is left out."""
    if "surface" not in document.values:
        return None
    table = document.table("surface")
    return SurfaceOptions(
        table.number("gsd_m") if table.has("gsd_m") else None,
        table.flag("point_cloud"),
        table.number("contours_m") if table.has("contours_m") else None,
    )


def ortho_section(document: Document) -> OrthoSection:
    """The options of `[ortho]`, but for its map sheets."""
    table = document.table("ortho")
    gsd_m = table.number("gsd_m") if table.has("gsd_m") else None
    return OrthoSection(
        gsd_m,
        table.flag("balance"),
        table.choice("ground"),
        table.text("tone"),
        table.flag("visibility"),
        area=table.file("area"),
        resampling=cast("Resampling", table.choice("resampling")),
        edge_mm=table.number("edge_mm"),
    )


def check_edge(document: Document, section: OrthoSection, cameras: Mapping[str, Camera]) -> None:
    """Make sure that something is left of every frame within its edge."""
    for name, camera in cameras.items():
        if 2 * section.edge_mm >= min(camera.frame_mm):
            cause = say("leaves nothing of the frame of {camera}.", camera=name)
            remedy = say(
                "Write less than half of its shorter side, {side:g} mm.",
                side=min(camera.frame_mm),
            )
            raise document.table("ortho").error("edge_mm", cause, remedy)


def _sets(table: Table) -> tuple[str, ...]:
    """Names of sets of additional parameters, each once."""
    key = "self_calibration"
    given: Any = table.values.get(key, [])
    names = [given] if isinstance(given, str) else given
    known = f"Write a list of {', '.join(SETS)}; [] for none."
    if not isinstance(names, list):
        raise table.error(
            key,
            say("must be a list of sets, not {given!r}.", given=given),
            known,
        )
    for name in cast("list[Any]", names):
        if name not in SETS:
            raise table.error(
                key,
                say("{name!r} is no set of parameters.", name=name),
                known,
            )
    found = tuple(dict.fromkeys(cast("list[str]", names)))
    wide = [name for name in found if name in ("ebner12", "gruen44")]
    if len(wide) == 2 or (wide and "affinity" in found):
        cause = say("{found} hold the same terms more than once.", found=", ".join(found))
        remedy = (
            "ebner12 and gruen44 contain the affinity, and gruen44 what ebner12 does: take one."
        )
        raise table.error(key, cause, remedy)
    return found


def check_attribute(table: Table, file_key: str, path: Path, key: str, attribute: str) -> None:
    """Make sure that a vector file can be opened and has an attribute."""
    try:
        file, _, layer = str(path).partition(LAYER_MARK)
        with no_remarks():
            present = list(pyogrio.read_info(file, layer or None)["fields"])
    except GDAL_ERRORS as error:
        remedy = "Give a vector file that GDAL can open, such as a GeoPackage."
        cause = say("{name} cannot be opened: GDAL does not know what it is.", name=path.name)
        raise table.error(file_key, cause, remedy) from error
    if attribute not in present:
        cause = say('{name} has no attribute "{attribute}".', name=path.name, attribute=attribute)
        hint = say("It has {names}.", names=", ".join(present) or "none at all")
        if key == file_key:
            hint = say("{has} Rename the right one to {attribute}.", has=hint, attribute=attribute)
        raise table.error(key, cause, hint)


def read_block(document: Document) -> BlockSection:
    """The table `[block]`.

    Raises:
        FieldError: It lacks something, its CRS is none of a map in metres, its heights are none.
        ProjectError: The file of its rules cannot be used.
    """
    table = document.table("block", required=True)
    crs, heights = table.text("crs"), table.text("heights")
    refusing(table, "crs", lambda: parse_crs(crs, ""))
    if heights.upper().startswith("EPSG:"):
        refusing(table, "heights", lambda: _check_heights(heights))
    rules = read_rules(table.file("rules"))
    return BlockSection(table.text("name"), crs, heights, _corrections(table), rules)


def _check_heights(heights: str) -> None:
    if not read_crs(heights, "").is_vertical:
        remedy = 'Name one, such as "EPSG:8357", or write words: "Bpv".'
        raise CrsError("", say("{heights} is no height system.", heights=heights), remedy)


def _corrections(table: Table) -> tuple[str, ...]:
    """What rays are corrected for, each once."""
    key = "corrections"
    given: object = table.values.get(key, list(CORRECTIONS))
    if not isinstance(given, list) or any(one not in CORRECTIONS for one in given):
        raise table.error(
            key,
            say("must be a list of corrections, not {given!r}.", given=given),
            say("Write some of {names}, or [] for none.", names=list(CORRECTIONS)),
        )
    return tuple(name for name in CORRECTIONS if name in given)


def refusing(table: Table, key: str, check: Callable[[], object]) -> None:
    """A check of the engine's, told with the line of its key."""
    try:
        check()
    except PhotogrammetryError as error:
        raise table.error(key, error.cause, error.remedy) from error
