"""Readers for the published blocks: only what the tests need, in the form of our own values."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.block import Block, ExteriorPrior, Measurement, Photo, SurveyedPoint, TiePoints
from core.geometry.camera import Camera
from core.geometry.collinearity import Atmosphere
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

UNKNOWN = ExteriorPrior(np.full(3, 1e5), np.full(3, 100.0))
"""No prior worth the name: the published adjustments had none."""


def read_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def read_table(path: Path) -> list[list[str]]:
    """Comma separated rows without the comment lines."""
    lines = path.read_text().splitlines()
    rows = [line for line in lines if line.strip() and not line.startswith("#")]
    return [[cell.strip() for cell in row.split(",")] for row in rows]


def ties_of(rays: list[tuple[str, str, float, float, float]]) -> TiePoints:
    """Tie points from rays (point, photo, column, row, sigma_px)."""
    points = {name: number for number, name in enumerate(dict.fromkeys(ray[0] for ray in rays))}
    photos = {name: number for number, name in enumerate(sorted({ray[1] for ray in rays}))}
    return TiePoints(
        tuple(photos),
        np.array([points[ray[0]] for ray in rays]),
        np.array([photos[ray[1]] for ray in rays]),
        np.array([ray[2:4] for ray in rays]),
        np.array([ray[4] for ray in rays]),
    )


class VacuumPhoto(Photo):
    """A photo of a program that corrected neither refraction nor curvature."""

    @property
    def atmosphere(self) -> Atmosphere:
        return Atmosphere()


# ---------------------------------------------------------------- Addis Ababa 2002, ERDAS LPS

ADDIS = "film-blocks-numeric/addis-ababa-2002-rmktop15"
ADDIS_SIGMA_PX = 0.33
"""`ImageStandardDeviation` of the block file."""


def read_addis(folder: Path) -> Block:
    """Three film photos, eight fiducials each, six control points that ERDAS held fixed."""
    camera = _addis_camera(folder / "camera_file.cam")
    fiducials = read_rows(folder / "fiducials_px.csv")
    photos = {}
    for row in read_rows(folder / "eo.csv"):
        name = row["image"]
        start = ExteriorOrientation(
            np.array([float(row[f"init_{axis}"]) for axis in "XYZ"]), 0.0, 0.0, np.pi
        )
        interior = affine_interior([mark for mark in fiducials if mark["image"] == name])
        size = (int(row["columns"]), int(row["rows"]))
        # ERDAS applied neither refraction nor curvature ("Z-Axis", EarthCurvatureIsApplied False).
        photos[name] = VacuumPhoto(
            name,
            Path(f"{name}.img"),
            size,
            "RMK Top15",
            interior,
            start,
            start,
            UNKNOWN,
            2340.0,
            True,
        )
    surveyed = {
        row["id"]: SurveyedPoint(
            row["id"],
            np.array([float(row[axis]) for axis in "XYZ"]),
            np.zeros(3),
            "control",
            "surveyed",
        )
        for row in read_rows(folder / "ground_points.csv")
        if row["usage"] == "GCP_CONTROL"
    }
    measurements, rays = {}, []
    for row in read_rows(folder / "image_points.csv"):
        if row["used"] != "TRUE":
            continue
        point, photo = row["point_id"], row["image"]
        pixel = float(row["px_x"]), float(row["px_y"])
        if point in surveyed:
            measurements[point, photo] = Measurement(
                point, photo, *pixel, ADDIS_SIGMA_PX, status="accepted"
            )
        else:
            rays.append((point, photo, *pixel, ADDIS_SIGMA_PX))
    return Block("EPSG:20137", {"RMK Top15": camera}, photos, surveyed, measurements, ties_of(rays))


def _addis_camera(path: Path) -> Camera:
    """LPS camera file: c, principal point, eight fiducials.

    Its radial table (at most 5 micrometres) is left out: ERDAS kept it, but its adjustment worked
    with k0 = k1 = k2 = 0 (block file), and only so its result is reproduced.
    """
    lines = [line.split() for line in path.read_text().splitlines()]
    marks = {str(row): (float(lines[9 + row][0]), float(lines[9 + row][1])) for row in range(1, 9)}
    return Camera(
        "RMK Top15",
        float(lines[2][0]),
        (230.0, 230.0),
        (float(lines[3][0]), float(lines[4][0])),
        fiducials_mm=marks,
    )


def affine_interior(marks: list[dict[str, str]]) -> InteriorOrientation:
    """Film from pixel by least squares over all fiducials, as ERDAS does it."""
    pixels = np.array([[float(mark["px_x"]), float(mark["px_y"])] for mark in marks])
    film = np.array([[float(mark["film_x_mm"]), float(mark["film_y_mm"])] for mark in marks])
    design = np.column_stack([pixels, np.ones(len(pixels))])
    matrix = np.linalg.lstsq(design, film)[0].T
    residuals = 1000.0 * (design @ matrix.T - film)
    sigma = float(np.sqrt(np.sum(residuals**2) / (residuals.size - 6)))
    names = tuple(mark["fiducial"] for mark in marks)
    return InteriorOrientation("affine", matrix, names, pixels, residuals, sigma)


def read_addis_orientation(folder: Path) -> dict[str, ExteriorOrientation]:
    """The orientation that ERDAS published."""
    return {
        row["image"]: ExteriorOrientation(
            np.array([float(row[f"final_{axis}"]) for axis in "XYZ"]),
            *(float(row[f"final_{angle}_rad"]) for angle in ("omega", "phi", "kappa")),
        )
        for row in read_rows(folder / "eo.csv")
    }


# ---------------------------------------------------------------- SXB Strasbourg, DBAT

SXB = "sxb-strasbourg/script_sxb"
SXB_CHECK = ("351", "410")
"""The filter of `sxb.xml`."""
SXB_MARK_SIGMA_PX, SXB_TIE_SIGMA_PX = 0.5, 1.0
"""`sxy` of marked and of automatic points in `sxb.xml`."""
SXB_PIXEL_MM = 0.006
SXB_PRINCIPAL_POINT_MM = np.array([26.577, 38.811])
"""From the top left corner."""


def read_sxb(folder: Path) -> Block:
    """Five digital frames; film frame with its origin in the principal point."""
    camera = Camera("aerial", 123.9392, (53.148, 77.976))
    matrix = np.array(
        [
            [SXB_PIXEL_MM, 0.0, -SXB_PRINCIPAL_POINT_MM[0]],
            [0.0, -SXB_PIXEL_MM, SXB_PRINCIPAL_POINT_MM[1]],
        ]
    )
    nothing = np.zeros((0, 2))
    interior = InteriorOrientation("nominal", matrix, (), nothing, nothing, np.nan)
    photos = {}
    for name, start in _sxb_starts(folder).items():
        photos[name] = VacuumPhoto(
            name, Path(f"{name}.jpg"), (8858, 12996), "aerial", interior, start, start, UNKNOWN,
            140.0, True,
        )  # fmt: skip
    names = dict(zip(range(1, 6), photos, strict=True))
    surveyed = {
        row[0]: SurveyedPoint(
            row[0],
            np.array([float(cell) for cell in row[2:5]]),
            np.array([float(cell) for cell in row[5:8]]),
            "check" if row[0] in SXB_CHECK else "control",
            "surveyed",
        )
        for row in read_table(folder / "reference" / "sxb-control.txt")
    }
    measurements = {}
    for point, image, column, row in read_table(folder / "measurements" / "markpts.txt"):
        key = point, names[int(image)]
        measurements[key] = Measurement(
            *key, float(column), float(row), SXB_MARK_SIGMA_PX, status="accepted"
        )
    rays = [
        (point, names[int(image)], float(column), float(row), SXB_TIE_SIGMA_PX)
        for point, image, column, row in read_table(folder / "measurements" / "smartpts.txt")
    ]
    return Block("local", {"aerial": camera}, photos, surveyed, measurements, ties_of(rays))


def read_sxb_report(folder: Path) -> dict[str, ExteriorOrientation]:
    """Orientations of the published report."""
    values = {"Omega": 0.0, "Phi": 0.0, "Kappa": 0.0, "Xc": 0.0, "Yc": 0.0, "Zc": 0.0}
    found: dict[str, ExteriorOrientation] = {}
    photo = parameter = ""
    for line in (folder / "result" / "report.txt").read_text().splitlines():
        words = line.replace(":", " ").split()
        if words[:1] == ["Photo"] and words[-1].endswith(".jpg"):
            photo = words[-1].removesuffix(".jpg")
        elif photo and words and words[0] in values:
            parameter = words[0]
        elif photo and words[:1] == ["Value"] and parameter:
            values[parameter] = float(words[1])
            if parameter == "Zc":
                angles = (np.radians(values[name]) for name in ("Omega", "Phi", "Kappa"))
                centre = np.array([values["Xc"], values["Yc"], values["Zc"]])
                found[photo] = ExteriorOrientation(centre, *angles)
            parameter = ""
    return found


def _sxb_starts(folder: Path) -> dict[str, ExteriorOrientation]:
    """First orientations: the published ones rounded to 50 m and 5 degrees."""
    return {
        name: ExteriorOrientation(
            np.round(known.centre / 50) * 50,
            0.0,
            0.0,
            float(np.radians(5 * np.round(np.degrees(known.kappa) / 5))),
        )
        for name, known in read_sxb_report(folder).items()
    }


def with_checks_as_ties(block: Block) -> Block:
    """The check points' rays as tie points: DBAT lets them take part as unknown points."""
    checks = [key for key in block.measurements if block.surveyed[key[0]].role == "check"]
    ties = block.ties
    names = sorted({point for point, _ in checks})
    pixels = [(block.measurements[key].column, block.measurements[key].row) for key in checks]
    sigmas = [block.measurements[key].sigma_px for key in checks]
    more = TiePoints(
        ties.photo_ids,
        np.append(ties.point, [ties.count + names.index(point) for point, _ in checks]),
        np.append(ties.photo, [ties.photo_ids.index(photo) for _, photo in checks]),
        np.concatenate([ties.pixels, pixels]),
        np.append(ties.sigma_px, sigmas),
    )
    return replace(block, ties=more)


# ---------------------------------------------------------------- RC30, photos 62 and 63

RC30 = "film-blocks-numeric/rc30-photos-62-63"
RC30_MEASURED_UM = 9.0
"""RMS of the published resections: what a measurement is worth."""


def read_rc30(folder: Path) -> Block:
    """Two film photos with eight control points each, measured in millimetres of film."""
    camera = Camera("RC30", 154.006, (230.0, 230.0))
    nothing = np.zeros((0, 2))
    interior = InteriorOrientation(
        "nominal", np.array([[0.015, 0, -115], [0, -0.015, 115]]), (), nothing, nothing, np.nan
    )
    start = ExteriorOrientation(np.array([4300.0, 2100.0, 2300.0]), 0.0, 0.0, 0.0)
    photos, surveyed, measurements = {}, {}, {}
    name = ""
    for line in (folder / "Block_62_63.yml").read_text().splitlines():
        words = _numbers(line.split("#")[0].partition(":")[2])
        point = line.partition(":")[0].strip()
        if line.strip().startswith("Photo6"):
            name = line.strip()[len("Photo") :][:2]
            photos[name] = VacuumPhoto(
                name, Path(f"{name}.tif"), (15334, 15334), "RC30", interior, start, start, UNKNOWN,
                250.0, True,
            )  # fmt: skip
        elif point.isdigit() and len(words) == 3:
            place = np.array([float(word) for word in words])
            surveyed[point] = SurveyedPoint(point, place, np.zeros(3), "control", "surveyed")
        elif point.isdigit() and len(words) == 2:
            pixel = interior.pixel_from_film(np.array([[float(word) for word in words]]))[0]
            measurements[point, name] = Measurement(
                point, name, *pixel.tolist(), RC30_MEASURED_UM / 15, status="accepted"
            )
    return Block("local", {"RC30": camera}, photos, surveyed, measurements)


def _numbers(line: str) -> list[str]:
    return re.findall(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?", line)


def read_rc30_orientation(folder: Path) -> dict[str, ExteriorOrientation]:
    """The orientations of the published resections, from the intersection that used them."""
    lines = (folder / "TwoPhotoInter_62_63.yml").read_text().splitlines()
    found: dict[str, ExteriorOrientation] = {}
    for row, line in enumerate(lines):
        if "XYZ" in line:
            name = lines[row - 1].strip()[len("Photo_") :].rstrip(":")
            centre = np.array([float(word) for word in _numbers(line)])
            angles = np.radians([float(word) for word in _numbers(lines[row + 1].split("#")[0])])
            found[name] = ExteriorOrientation(centre, *(float(angle) for angle in angles))
    return found
