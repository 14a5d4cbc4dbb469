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
