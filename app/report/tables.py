"""The result tables of a block as CSV, columns as CONTRACT 4 promises them; MicMac's measures."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block
from core.formats.micmac_points import (
    image_measures_name,
    write_camera_measures,
    write_image_measures,
)
from core.formats.records import guarded
from core.geometry.interior import film_shape
from core.results import BlockInput
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet
from sessions.atomic_write import whole_file

Cell = str | int | float | None
CONTROL_COLUMNS = (
    "point_id,scan,col,row,X,Y,Z,role,status,score,residual_col,residual_row,sigma_px,reason"
)
CHECK_COLUMNS = "point_id,X,Y,Z,dX,dY,dZ,used_scans"
EXTERIOR_COLUMNS = (
    "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,"
    "sigma_X,sigma_Y,sigma_Z,sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg"
)
TIE_COLUMNS = "point_id,X,Y,Z,sigma_X,sigma_Y,sigma_Z,rays,max_residual_px"
INTERIOR_COLUMNS = "scan,model,x_0,x_col,x_row,y_0,y_col,y_row,pixel_um,sigma_um,rms_um"
FIDUCIAL_COLUMNS = (
    "scan,fiducial,status,col,row,sigma_px,score,disagreement_px,kind,"
    "residual_x_um,residual_y_um,reason"
)
FILM_COLUMNS = (
    "scan,camera,model,quarter_turns,mirrored,data_strip,marks,redundancy,variance_factor,chance,"
    "scale_x,scale_y,shear_mrad,sigma_corner_um"
)
MICMAC = "Ori-InterneScan"
MILLI, DEGREES = 4, 8
"""Decimal places of pixels and metres, and of angles."""


def write_results(folder: Path, report: AdjustmentReport) -> tuple[Path, ...]:
    """Write every table of an adjusted block into a folder; each whole or not at all."""
    tables = {
        "control_points.csv": (CONTROL_COLUMNS, control_rows(report)),
        "check_points.csv": (CHECK_COLUMNS, check_rows(report)),
        "interior_orientation.csv": interior_table(report.block),
        "exterior_orientation.csv": (EXTERIOR_COLUMNS, exterior_rows(report)),
        "tie_points.csv": (TIE_COLUMNS, tie_rows(report)),
        "points_from_photos.csv": (TIE_COLUMNS, new_point_rows(report)),
    }
    for name, (columns, rows) in tables.items():
        write_table(folder / name, columns, rows)
    return tuple(folder / name for name in tables)


def write_table(path: Path, columns: str, rows: Iterable[Sequence[Cell]]) -> None:
    """Write one table: a header row, commas, points in numbers, UTF-8; NaN and None are empty."""
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns.split(","))
        writer.writerows([guarded(_told(cell)) for cell in row] for row in rows)


def control_rows(report: AdjustmentReport) -> list[list[Cell]]:
    """One row per measurement of a surveyed point, used or not; `new` points have none."""
    rows: list[list[Cell]] = []
    for key, measurement in sorted(report.block.measurements.items()):
        point = report.block.surveyed[measurement.point_id]
        if point.role == "new":
            continue
        residual = report.residuals_px.get(key, (float("nan"), float("nan")))
        status, reason = report.final_status(measurement)
        rows.append(
            [
                measurement.point_id,
                measurement.photo_id,
                *_rounded((measurement.column, measurement.row), MILLI),
                *_rounded(point.position, MILLI),
                point.role,
                status,
                *_rounded((measurement.score, *residual, measurement.sigma_px), MILLI),
                reason,
            ]
        )
    return rows


def check_rows(report: AdjustmentReport) -> list[list[Cell]]:
    """One row per check point: known coordinates, computed minus known."""
    independent = report.block.independent_checks
    return [
        [
            check.point_id,
            *_rounded(report.block.surveyed[check.point_id].position, MILLI),
            *_rounded(check.difference_m, MILLI),
            check.used_scans,
        ]
        for check in report.checks
        if check.point_id in independent
    ]


def interior_table(block: Block) -> tuple[str, list[list[Cell]]]:
    """Columns and one row per scan: x = x_0 + x_col * col + x_row * row in mm, likewise y."""
    names = sorted({name for photo in block.photos.values() for name in photo.interior.names})
    marks = [f"residual_{name}_{axis}_um" for name in names for axis in "xy"]
    rows: list[list[Cell]] = []
    for photo_id, photo in block.photos.items():
        interior = photo.interior
        (x_col, x_row, x_0), (y_col, y_row, y_0) = interior.film_from_pixel_matrix.tolist()
        residuals = dict(zip(interior.names, interior.residuals_um.tolist(), strict=True))
        figures = (interior.pixel_size_mm * 1000, interior.sigma_um, interior.rms_um)
        rows.append(
            [
                photo_id,
                interior.model,
                *_rounded((x_0, x_col, x_row, y_0, y_col, y_row), 9),
                *_rounded(figures, 3),
                *(v for name in names for v in _rounded(residuals.get(name, ("", "")), 2)),
            ]
        )
    return ",".join([INTERIOR_COLUMNS, *marks]), rows


def exterior_rows(report: AdjustmentReport) -> list[list[Cell]]:
    """One row per photo; sigmas are empty where the photo took no part."""
    rows: list[list[Cell]] = []
    for photo_id, photo in report.block.photos.items():
        exterior, sigmas = photo.exterior, report.exterior_sigmas.get(photo_id)
        angles = np.degrees(exterior.angles)
        rows.append(
            [
                photo_id,
                *_rounded(exterior.centre, MILLI),
                *_rounded(angles, DEGREES),
                *(["", "", ""] if sigmas is None else _rounded(sigmas.centre_m, MILLI)),
                *(["", "", ""] if sigmas is None else _rounded(np.degrees(sigmas.angles), DEGREES)),
            ]
        )
    return rows


def tie_rows(report: AdjustmentReport) -> list[list[Cell]]:
    """One row per tie point that took part."""
    ties = report.block.ties
    lengths = np.linalg.norm(report.tie_residuals_px, axis=1)
    took_part = np.isfinite(lengths)
    rays = np.bincount(ties.point[took_part], minlength=ties.count)
    largest = np.zeros(ties.count)
    np.maximum.at(largest, ties.point[took_part], lengths[took_part])
    return [
        [
            int(point),
            *_rounded(report.tie_positions[point], MILLI),
            *_rounded(report.tie_sigmas_m[point], MILLI),
            int(rays[point]),
            *_rounded((largest[point],), MILLI),
        ]
        for point in np.flatnonzero(rays)
        if np.isfinite(report.tie_positions[point]).all()
    ]


def new_point_rows(report: AdjustmentReport) -> list[list[Cell]]:
    """One row per point that photos alone determine."""
    return [
        [
            point.point_id,
            *_rounded(point.position, MILLI),
            *_rounded(point.sigma_m, MILLI),
            point.rays,
            *_rounded((point.largest_residual_px,), MILLI),
        ]
        for point in report.new_points
    ]


def _rounded(values: Iterable[object], places: int) -> list[Cell]:
    """Numbers as text with fixed places; what is no number stays as it is."""
    return [
        f"{float(value):.{places}f}" if isinstance(value, (int, float)) else str(value)
        for value in values
    ]


def _told(cell: Cell) -> str:
    text = "" if cell is None else str(cell)
    return "" if text == "nan" else text


def write_fiducials(folder: Path, given: BlockInput, scans: ScanSet) -> None:
    """Write `fiducials.csv`, `film.csv` and MicMac's measures into a folder."""
    inputs = {scan.path.stem: scan for scan in given.scans}
    marks: list[list[Cell]] = []
    films: list[list[Cell]] = []
    for name, oriented in scans.oriented.items():
        camera = inputs[name].camera
        certified = (scans.cameras or given.cameras)[camera].fiducials_mm
        marks += fiducial_rows(oriented, certified)
        films.append(film_row(oriented, camera, inputs[name].scan_pixel_um / 1000))
    write_table(folder / "fiducials.csv", FIDUCIAL_COLUMNS, marks)
    write_table(folder / "film.csv", FILM_COLUMNS, films)
    write_micmac(folder / MICMAC, scans)


def fiducial_rows(
    oriented: ScanOrientation, certified: Mapping[str, tuple[float, float]]
) -> list[list[Cell]]:
    """One row per mark of the camera: measured and used, measured and left out, or missing."""
    interior = oriented.interior
    residuals = dict(zip(interior.names, interior.residuals_um.tolist(), strict=True))
    found = {mark.name: mark for mark in oriented.fiducials}
    reasons: dict[str, str] = {}
    for doubt in oriented.doubts:
        if "fiducial" in doubt.evidence:
            reasons[str(doubt.evidence["fiducial"])] = doubt.message
    rows: list[list[Cell]] = []
    for name in dict.fromkeys((*certified, *found)):
        mark, residual = found.get(name), residuals.get(name)
        status = "missing" if mark is None else "used" if residual else "unused"
        measured: list[Cell] = [""] * 6
        if mark is not None:
            measured = [
                round(mark.column, 4), round(mark.row, 4), round(mark.sigma_px, 4),
                round(mark.correlation, 4), round(mark.disagreement_px, 4), mark.kind,
            ]  # fmt: skip
        on_film: list[Cell] = [round(value, 2) for value in residual] if residual else ["", ""]
        rows.append([oriented.photo_id, name, status, *measured, *on_film, reasons.get(name, "")])
    return rows


def film_row(oriented: ScanOrientation, camera: str, pixel_mm: float) -> list[Cell]:
    """How the film lies in its scan and how it has changed its shape."""
    interior = oriented.interior
    fitted = bool(interior.names)
    shape = film_shape(interior, pixel_mm)
    corner = float(interior.film_sigmas(oriented.area.corners[:1]).max()) if fitted else 0.0
    figures: list[Cell] = [
        len(interior.names), interior.redundancy, round(interior.variance_factor, 4),
        round(interior.chance, 6), round(shape.scale_x, 7), round(shape.scale_y, 7),
        round(shape.shear_mrad, 4), round(1000 * corner, 2),
    ] if fitted else [0, 0, *[""] * 6]  # fmt: skip
    quarter, mirrored = oriented.way
    return [
        oriented.photo_id, camera, interior.model, quarter, int(mirrored), oriented.strip or "",
        *figures,
    ]  # fmt: skip


def write_micmac(folder: Path, scans: ScanSet) -> None:
    """MeasuresIm-*.xml of every scan with marks, MeasuresCamera.xml where one camera took all."""
    measured = {name: one for name, one in scans.oriented.items() if one.fiducials}
    if not measured:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for oriented in measured.values():
        image = oriented.scan.path.name
        places = {mark.name: (mark.column, mark.row) for mark in oriented.fiducials}
        with whole_file(folder / image_measures_name(image)) as temporary:
            write_image_measures(temporary, image, places)
    cameras = [camera for camera in scans.cameras.values() if camera.fiducials_mm]
    if len(cameras) == 1:
        with whole_file(folder / "MeasuresCamera.xml") as temporary:
            write_camera_measures(temporary, cameras[0].fiducials_mm)
