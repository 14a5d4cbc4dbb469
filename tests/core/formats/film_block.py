"""The published film block of Addis Ababa as an exchanged block: three photos, one strip."""

from pathlib import Path

import numpy as np

from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
)
from core.geometry.exterior import ExteriorOrientation
from tests.real.readers import read_rows

FOLDER = "film-blocks-numeric/addis-ababa-2002-rmktop15"
FOCAL_MM, PRINCIPAL_MM = 153.255, (0.010, -0.006)


def read_film_block(shared_data: Path) -> ExchangeBlock:
    """Cameras, interior orientations, orientations by ERDAS, control and its measurements."""
    folder = shared_data / FOLDER
    marks = read_rows(folder / "fiducials_px.csv")
    photos = {}
    for row in read_rows(folder / "eo.csv"):
        name = row["image"]
        of_photo = [mark for mark in marks if mark["image"] == name]
        film = np.array([[float(m["film_x_mm"]), float(m["film_y_mm"]), 1.0] for m in of_photo])
        pixel = np.array([[float(m["px_x"]), float(m["px_y"])] for m in of_photo])
        affine = np.linalg.lstsq(film, pixel, rcond=None)[0].T
        shift = affine @ np.array([*PRINCIPAL_MM, 1.0])
        numbers = [float(row[f"final_{key}"]) for key in ("X", "Y", "Z")]
        angles = [float(row[f"final_{key}_rad"]) for key in ("omega", "phi", "kappa")]
        photos[name] = ExchangePhoto(
            name,
            f"{name}.tif",
            "RMK Top15",
            np.column_stack([affine[:, :2] * FOCAL_MM, shift]),
            ExteriorOrientation(np.array(numbers), *angles),
            fiducials_px={m["fiducial"]: (float(m["px_x"]), float(m["px_y"])) for m in of_photo},
        )
    certified = {
        m["fiducial"]: (float(m["film_x_mm"]), float(m["film_y_mm"]))
        for m in marks
        if m["image"] == "4092"
    }
    camera = ExchangeCamera(
        "RMK Top15",
        principal_distance_mm=FOCAL_MM,
        principal_point_mm=PRINCIPAL_MM,
        frame_mm=(230.0, 230.0),
        fiducials_mm=certified,
    )
    points = {
        row["id"]: ExchangePoint(row["id"], (float(row["X"]), float(row["Y"]), float(row["Z"])))
        for row in read_rows(folder / "ground_points.csv")
        if row["usage"] == "GCP_CONTROL"
    }
    measurements = tuple(
        ExchangeMeasurement(row["point_id"], row["image"], float(row["px_x"]), float(row["px_y"]))
        for row in read_rows(folder / "image_points.csv")
        if row["point_id"] in points
    )
    return ExchangeBlock("EPSG:20137", {camera.name: camera}, photos, points, measurements)
