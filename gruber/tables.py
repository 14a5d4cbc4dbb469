"""A block's values as arrays with named columns, or as GeoDataFrames if geopandas is installed."""

from typing import Any

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block as BlockValue

Table = np.ndarray[Any, Any]
"""A structured array: `table["X"]` is a column, `table[3]` a row."""
NAME = "U64"
NOT_KNOWN = np.full(3, np.nan)
PLACE = [("X", "f8"), ("Y", "f8"), ("Z", "f8")]
PLACE_SIGMAS = [("sigma_X", "f8"), ("sigma_Y", "f8"), ("sigma_Z", "f8")]
ANGLES = [("omega", "f8"), ("phi", "f8"), ("kappa", "f8")]
ANGLE_SIGMAS = [("sigma_omega", "f8"), ("sigma_phi", "f8"), ("sigma_kappa", "f8")]


def orientations(block: BlockValue, report: AdjustmentReport | None) -> Table:
    """Exterior orientations of all photos: metres, radians; NaN where no sigma is known.

    Columns: photo, oriented, X, Y, Z, omega, phi, kappa, and their `sigma_...`.
    """
    columns = [("photo", NAME), ("oriented", "?"), *PLACE, *ANGLES, *PLACE_SIGMAS, *ANGLE_SIGMAS]
    rows: list[tuple[Any, ...]] = []
    for name, photo in block.photos.items():
        own = photo.exterior
        known = None if report is None else report.exterior_sigmas.get(name)
        places, turns = (NOT_KNOWN, NOT_KNOWN) if known is None else (known.centre_m, known.angles)
        angles = own.omega, own.phi, own.kappa
        rows.append((name, photo.oriented, *own.centre, *angles, *places, *turns))
    return np.array(rows, dtype=columns)


def points(block: BlockValue) -> Table:
    """Surveyed points: metres.

    Columns: point, X, Y, Z, sigma_X, sigma_Y, sigma_Z, role, source.
    """
    columns = [("point", NAME), *PLACE, *PLACE_SIGMAS, ("role", "U16"), ("source", "U16")]
    return np.array(
        [
            (name, *point.position, *point.sigma_m, point.role, point.source)
            for name, point in block.surveyed.items()
        ],
        dtype=columns,
    )


def measurements(block: BlockValue, report: AdjustmentReport | None) -> Table:
    """Measurements of surveyed points: pixels, outer corner of the first pixel (0, 0).

    Columns: point, photo, column, row, sigma_px, status, residual_column, residual_row (computed
    minus measured, NaN where the photo is not oriented).
    """
    columns = [
        ("point", NAME), ("photo", NAME), ("column", "f8"), ("row", "f8"), ("sigma_px", "f8"),
        ("status", "U16"), ("residual_column", "f8"), ("residual_row", "f8"),
    ]  # fmt: skip
    residuals = {} if report is None else report.residuals_px
    return np.array(
        [
            (*key, one.column, one.row, one.sigma_px, one.status,
             *residuals.get(key, (np.nan, np.nan)))
            for key, one in block.measurements.items()
        ],
        dtype=columns,
    )  # fmt: skip


def cameras(block: BlockValue) -> Table:
    """Cameras as adjusted: millimetres in the film frame (x right, y up, the certificate's origin).

    Columns: camera, principal_distance_mm, principal_point_x_mm, principal_point_y_mm, k1, k2, k3
    (imaged = ideal * (1 + k1 r^2 + k2 r^4 + k3 r^6), r in millimetres), width_mm, height_mm.
    """
    columns = [
        ("camera", NAME), ("principal_distance_mm", "f8"), ("principal_point_x_mm", "f8"),
        ("principal_point_y_mm", "f8"), ("k1", "f8"), ("k2", "f8"), ("k3", "f8"),
        ("width_mm", "f8"), ("height_mm", "f8"),
    ]  # fmt: skip
    return np.array(
        [
            (name, own.principal_distance_mm, *own.principal_point_mm, *own.radial_distortion,
             *own.frame_mm)
            for name, own in block.cameras.items()
        ],
        dtype=columns,
    )  # fmt: skip


def interiors(block: BlockValue) -> Table:
    """Interior orientations of all photos: film (mm) of pixels (outer corner of the first (0, 0)).

    Columns: photo, camera, model, columns, rows (of the scan), x_0, x_col, x_row, y_0, y_col,
    y_row (x = x_0 + x_col * column + x_row * row, likewise y; the affine part), pixel_um, sigma_um
    (NaN without redundancy), fiducials (how many were used).
    """
    affine = [(name, "f8") for name in ("x_0", "x_col", "x_row", "y_0", "y_col", "y_row")]
    columns = [
        ("photo", NAME), ("camera", NAME), ("model", "U16"), ("columns", "i4"), ("rows", "i4"),
        *affine, ("pixel_um", "f8"), ("sigma_um", "f8"), ("fiducials", "i4"),
    ]  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for name, photo in block.photos.items():
        own = photo.interior
        (x_col, x_row, x_0), (y_col, y_row, y_0) = own.film_from_pixel_matrix.tolist()
        film = x_0, x_col, x_row, y_0, y_col, y_row
        figures = 1000 * own.pixel_size_mm, own.sigma_um, len(own.names)
        rows.append((name, photo.camera, own.model, *photo.size_px, *film, *figures))
    return np.array(rows, dtype=columns)


def ties(report: AdjustmentReport) -> Table:
    """Adjusted tie points: metres; NaN for those that were left out.

    Columns: X, Y, Z, sigma_X, sigma_Y, sigma_Z, rays.
    """
    columns = [*PLACE, *PLACE_SIGMAS, ("rays", "i4")]
    own = report.block.ties
    rays = np.bincount(own.point, minlength=own.count)
    table = np.zeros(own.count, dtype=columns)
    for axis, name in enumerate("XYZ"):
        table[name] = report.tie_positions[:, axis]
        table[f"sigma_{name}"] = report.tie_sigmas_m[:, axis]
    table["rays"] = rays
    return table


def as_geodataframe(table: Table, crs: str) -> Any:
    """A table with X, Y and Z as a GeoDataFrame of points.

    Raises:
        ImportError: geopandas is not installed; `pip install gruber[notebook]` has it.
    """
    import geopandas

    plain = {name: table[name] for name in table.dtype.names or () if name not in ("X", "Y", "Z")}
    places = geopandas.points_from_xy(table["X"], table["Y"], table["Z"], crs=crs)
    return geopandas.GeoDataFrame(plain, geometry=places)
