"""What the first stage found, as tables: every mark of every scan, every film, MicMac's files."""

from collections.abc import Mapping
from pathlib import Path

from app.results import Cell, write_table
from core.formats.micmac_measures import (
    image_measures_name,
    write_camera_measures,
    write_image_measures,
)
from core.geometry.interior import film_shape
from core.results import BlockInput
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet
from sessions.atomic_write import whole_file

FIDUCIAL_COLUMNS = (
    "scan,fiducial,status,col,row,sigma_px,score,disagreement_px,kind,"
    "residual_x_um,residual_y_um,reason"
)
FILM_COLUMNS = (
    "scan,camera,model,quarter_turns,mirrored,data_strip,marks,redundancy,variance_factor,chance,"
    "scale_x,scale_y,shear_mrad,sigma_corner_um"
)
MICMAC = "Ori-InterneScan"


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
