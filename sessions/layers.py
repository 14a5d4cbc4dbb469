"""The block as layers of the session file, for QGIS, and how a GeoPackage holds them."""

import math
import struct
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import shapely
from pyproj.exceptions import CRSError
from shapely.geometry.base import BaseGeometry

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Position, locked
from core.block import Block, Measurement, Status
from core.geometry.crs import read_crs
from core.geometry.drawn_mask import outlines
from core.mosaic.misfit_places import Misfit
from sessions.remarks import Fault
from sessions.store import Store, Transaction

CUSTOM_SRS_ID = 100_000
"""Number of a CRS that has no code of an authority."""
_LITTLE_ENDIAN, _XY_ENVELOPE, _EMPTY = 0b1, 0b10, 0b10000


@dataclass(frozen=True, slots=True)
class Layer:
    """One table of features."""

    name: str
    """Table and layer name."""
    description: str
    """One sentence, shown by QGIS."""
    geometry_type: str
    """POINT, LINESTRING or POLYGON."""
    has_z: bool
    """True when the geometries carry heights."""
    columns: Mapping[str, str]
    """SQL type by attribute name."""


Feature = tuple[BaseGeometry, tuple[Any, ...]]
"""A geometry and its attributes in the order of the layer's columns."""

RESIDUAL_SCALE = 100.0
"""How much longer than life a residual vector is drawn."""
MISFIT_SCALE = 20.0
"""How much longer than life a misfit vector is drawn."""
BEST_FIRST: tuple[Status, ...] = ("accepted", "auto", "dubious", "rejected", "unused")
"""Order in which the states of a point's measurements stand for the point."""
SHOWN: tuple[Status, ...] = ("auto", "accepted", "dubious")
"""States whose residuals are drawn: those of wrong matches would cover the map."""
_NOWHERE = locked([np.nan] * 3)

PHOTOS = Layer(
    "photos",
    "Perspective centres with exterior orientation; angles in degrees, kappa from grid east",
    "POINT",
    True,
    {"photo_id": "TEXT", "scan": "TEXT", "camera": "TEXT", "oriented": "BOOLEAN"}
    | dict.fromkeys(("X", "Y", "Z", "omega_deg", "phi_deg", "kappa_deg"), "DOUBLE")
    | dict.fromkeys(("sigma_X", "sigma_Y", "sigma_Z"), "DOUBLE")
    | dict.fromkeys(("sigma_omega_deg", "sigma_phi_deg", "sigma_kappa_deg"), "DOUBLE")
    | {"control_used": "INTEGER", "tie_points": "INTEGER"},
)
FOOTPRINTS = Layer(
    "footprints",
    "What each photo shows of the ground",
    "POLYGON",
    False,
    {"photo_id": "TEXT", "scan": "TEXT", "area_m2": "DOUBLE"},
)
POINTS = Layer(
    "points",
    "Surveyed points: role, state, and how well they fit; dX dY dZ computed minus known, metres",
    "POINT",
    True,
    {"point_id": "TEXT", "role": "TEXT", "source": "TEXT", "status": "TEXT"}
    | dict.fromkeys(("X", "Y", "Z", "sigma_X", "sigma_Y", "sigma_Z"), "DOUBLE")
    | {"photos_used": "INTEGER", "photos_proposed": "INTEGER", "worst_residual_px": "DOUBLE"}
    | dict.fromkeys(("dX", "dY", "dZ"), "DOUBLE"),
)
MEASUREMENTS = Layer(
    "measurements",
    "Each surveyed point in each photo, at the point; residuals computed minus measured, pixels",
    "POINT",
    True,
    {"point_id": "TEXT", "photo_id": "TEXT", "role": "TEXT", "status": "TEXT", "reason": "TEXT"}
    | dict.fromkeys(("column", "row", "sigma_px", "score"), "DOUBLE")
    | dict.fromkeys(("residual_column", "residual_row", "residual_px", "redundancy"), "DOUBLE"),
)
NEW_POINTS = Layer(
    "points_from_photos",
    "Points intersected from photos, with their standard deviations in metres",
    "POINT",
    True,
    {"point_id": "TEXT"}
    | dict.fromkeys(("X", "Y", "Z", "sigma_X", "sigma_Y", "sigma_Z"), "DOUBLE")
    | {"rays": "INTEGER", "max_residual_px": "DOUBLE"},
)
RESIDUAL_VECTORS = Layer(
    "residual_vectors",
    "Residuals of used and dubious measurements on the ground, from measured towards computed",
    "LINESTRING",
    False,
    {"point_id": "TEXT", "photo_id": "TEXT", "role": "TEXT", "status": "TEXT"}
    | dict.fromkeys(("residual_px", "residual_m", "scale"), "DOUBLE"),
)

MASKS = Layer(
    "masks",
    "What operators left out of scans, on level ground; outlines in scan pixels, corner origin",
    "POLYGON",
    False,
    {"photo_id": "TEXT", "scan": "TEXT", "kind": "TEXT", "pixels": "TEXT", "area_m2": "DOUBLE"},
)

MISFIT = Layer(
    "misfit",
    "Mosaic less reference at details of both, drawn longer by scale; metres",
    "LINESTRING",
    False,
    {"photo_id": "TEXT"}
    | dict.fromkeys(("dX", "dY", "sigma", "predicted_X", "predicted_Y"), "DOUBLE")
    | dict.fromkeys(("probability", "scale"), "DOUBLE"),
)

FAULTS = Layer(
    "faults",
    "Faults of mosaic and photos that people marked, with what was answered",
    "POINT",
    False,
    {"number": "INTEGER", "is_open": "BOOLEAN"}
    | dict.fromkeys(("fault", "photo", "words", "who", "when", "assigned", "answers"), "TEXT"),
)


def write_layers(
    store: Store,
    block: Block,
    report: AdjustmentReport,
    footprints: Mapping[str, shapely.Polygon],
    misfit: Misfit | None = None,
    faults: Sequence[Fault] = (),
) -> None:
    """Replace all layers in one transaction; the decisions are not touched.

    Args:
        store: The session file.
        block: The block with its measurements as they stand; orientations come from the report.
        report: The adjustment of the block.
        footprints: Ground polygon of each photo in the block's CRS.
        misfit: Of the mosaic; its layer is empty without one.
        faults: That were marked in the mosaic.
    """
    made = (
        (PHOTOS, list(_photos(block, report))),
        (FOOTPRINTS, list(_footprints(block, footprints))),
        (POINTS, list(_points(block, report))),
        (MEASUREMENTS, list(_measurements(block, report))),
        (NEW_POINTS, list(_new_points(report))),
        (RESIDUAL_VECTORS, list(_residual_vectors(block, report))),
        (MASKS, list(_masks(block, report))),
        (MISFIT, list(_misfit(misfit))),
        (FAULTS, list(_faults(faults))),
    )
    with store.writing() as transaction:
        srs_id = register_crs(transaction, block.crs)
        for layer, features in made:
            replace_layer(transaction, layer, srs_id, features)


def _photos(block: Block, report: AdjustmentReport) -> Iterable[Feature]:
    counts = np.bincount(block.ties.photo, minlength=len(block.ties.photo_ids))
    ties = dict(zip(block.ties.photo_ids, counts, strict=True))
    used = Counter(item.photo_id for item in block.measurements.values() if block.steers(item))
    for photo_id, known in block.photos.items():
        photo = report.block.photos.get(photo_id, known)
        exterior, sigmas = photo.exterior, report.exterior_sigmas.get(photo_id)
        angles = np.degrees(exterior.angles)
        centre_sigmas = _NOWHERE if sigmas is None else sigmas.centre_m
        angle_sigmas = _NOWHERE if sigmas is None else np.degrees(sigmas.angles)
        orientation = (*exterior.centre, *angles, *centre_sigmas, *angle_sigmas)
        named = (photo_id, str(photo.scan), photo.camera, photo.oriented)
        counted = (used[photo_id], int(ties.get(photo_id, 0)))
        yield shapely.Point(exterior.centre), (*named, *orientation, *counted)


def _footprints(block: Block, footprints: Mapping[str, shapely.Polygon]) -> Iterable[Feature]:
    for photo_id, polygon in footprints.items():
        if photo_id in block.photos and not polygon.is_empty:
            yield polygon, (photo_id, str(block.photos[photo_id].scan), polygon.area)


def _masks(block: Block, report: AdjustmentReport) -> Iterable[Feature]:
    """A polygon for each part that was drawn, where its photo shows the mean height."""
    for photo_id, known in block.photos.items():
        photo, camera = report.block.photos.get(photo_id, known), block.camera_of(photo_id)
        for kind, area in (("hidden", known.mask.hidden), ("freed", known.mask.freed)):
            for part in outlines(area):
                ground = shapely.transform(
                    part,
                    lambda pixels, photo=photo, camera=camera: photo.object_from_pixel(
                        pixels, np.full(len(pixels), photo.ground_height_m), camera
                    )[:, :2],
                )
                named = (photo_id, str(known.scan), kind)
                yield ground, (*named, shapely.to_wkt(part, 1), ground.area)


def _points(block: Block, report: AdjustmentReport) -> Iterable[Feature]:
    by_point: dict[str, list[Measurement]] = {point_id: [] for point_id in block.surveyed}
    for item in block.measurements.values():
        by_point.setdefault(item.point_id, []).append(item)
    differences = _differences(block, report)
    for point_id, point in block.surveyed.items():
        items = by_point[point_id]
        used = [item for item in items if item.used]
        worst = max((_length(report, item) for item in used), default=math.nan)
        named = (point_id, point.role, point.source, _state_of(items))
        counted = (len(used), len(items), worst)
        known = (*point.position, *point.sigma_m)
        difference = differences.get(point_id, _NOWHERE)
        yield shapely.Point(point.position), (*named, *known, *counted, *difference)


def _new_points(report: AdjustmentReport) -> Iterable[Feature]:
    for point in report.new_points:
        figures = (*point.position, *point.sigma_m, point.rays, point.largest_residual_px)
        yield shapely.Point(point.position), (point.point_id, *figures)


def _differences(block: Block, report: AdjustmentReport) -> dict[str, Position]:
    """Computed minus known coordinates of the check and control points that were computed."""
    control = {
        name: position - block.surveyed[name].position
        for name, position in report.surveyed_positions.items()
        if name in block.surveyed
    }
    return control | {check.point_id: check.difference_m for check in report.checks}


def _state_of(items: list[Measurement]) -> Status:
    """The best state among the measurements of a point."""
    found = {item.status for item in items}
    for status in BEST_FIRST:
        if status in found:
            return status
    return "unused"


def _measurements(block: Block, report: AdjustmentReport) -> Iterable[Feature]:
    for key, item in block.measurements.items():
        point = block.surveyed.get(item.point_id)
        if point is None:
            continue
        status, reason = report.final_status(item)
        measured = (item.column, item.row, item.sigma_px, item.score)
        residual = report.residuals_px.get(key, (math.nan, math.nan))
        length, redundancy = _length(report, item), report.redundancy_numbers.get(key, math.nan)
        named = (*key, point.role, status, reason)
        yield shapely.Point(point.position), (*named, *measured, *residual, length, redundancy)


def _length(report: AdjustmentReport, item: Measurement) -> float:
    """Length of a measurement's residual, pixels; NaN where there is none."""
    return math.hypot(*report.residuals_px.get(item.key, (math.nan, math.nan)))


def _residual_vectors(block: Block, report: AdjustmentReport) -> Iterable[Feature]:
    for key, item in block.measurements.items():
        residual, point = report.residuals_px.get(key), block.surveyed.get(item.point_id)
        status, _ = report.final_status(item)
        if status not in SHOWN or residual is None or point is None:
            continue
        vector = _on_ground(report.block, item, residual, float(point.position[2]))
        if vector is None:
            continue
        start = point.position[:2]
        line = shapely.LineString([start, start + RESIDUAL_SCALE * vector])
        lengths = (math.hypot(*residual), float(np.hypot(*vector)), RESIDUAL_SCALE)
        yield line, (*key, point.role, status, *lengths)


def _misfit(misfit: Misfit | None) -> Iterable[Feature]:
    if misfit is None:
        return
    vectors = misfit.vectors
    for row, start in enumerate(vectors.positions):
        shift, predicted = vectors.shifts_m[row], vectors.predicted_sigmas_m[row]
        line = shapely.LineString([start, start + MISFIT_SCALE * shift])
        told = (float(vectors.sigmas_m[row]), *predicted, float(vectors.probabilities[row]))
        yield line, (vectors.photo_ids[row], *shift, *told, MISFIT_SCALE)


def _faults(faults: Sequence[Fault]) -> Iterable[Feature]:
    for one in faults:
        item, said = one.recorded, one.said
        answers = "; ".join(f"{who.who}: {answer.words}" for who, answer in one.answers)
        told = said.fault, said.name, said.words, item.who, item.when, one.assigned, answers
        yield shapely.Point(said.place or (0, 0)), (item.decision_id, one.is_open, *told)


def _on_ground(
    block: Block, item: Measurement, residual: tuple[float, float], height: float
) -> np.ndarray | None:
    """A residual (column, row; pixels) at a height (metres) as (east, north), metres."""
    photo = block.photos.get(item.photo_id)
    if photo is None:
        return None
    pixels = np.vstack([item.pixel, item.pixel + np.array(residual)])
    camera = block.cameras[photo.camera]
    ground = photo.object_from_pixel(pixels, np.full(2, height), camera)
    vector = ground[1, :2] - ground[0, :2]
    return vector if np.all(np.isfinite(vector)) else None


def replace_layer(
    transaction: Transaction, layer: Layer, srs_id: int, features: Sequence[Feature]
) -> None:
    """Put a layer in the place of what the file held under its name.

    The table is dropped, not emptied: a spatial index or feature count that QGIS may have hung on
    it lives in triggers that only GDAL can run.
    """
    _drop(transaction, layer.name)
    columns = "".join(f', "{name}" {kind}' for name, kind in layer.columns.items())
    transaction.execute(
        f'CREATE TABLE "{layer.name}" ('
        f"fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom {layer.geometry_type}{columns})"
    )
    bounds = [geometry.bounds for geometry, _ in features if not geometry.is_empty]
    extent = _extent(np.array(bounds)) if bounds else [None] * 4
    transaction.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description,"
        " min_x, min_y, max_x, max_y, srs_id) VALUES (?, 'features', ?, ?, ?, ?, ?, ?, ?)",
        (layer.name, layer.name, layer.description, *extent, srs_id),
    )
    transaction.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)",
        (layer.name, layer.geometry_type, srs_id, int(layer.has_z)),
    )
    marks = ", ".join("?" * (1 + len(layer.columns)))
    names = ", ".join(["geom", *(f'"{name}"' for name in layer.columns)])
    transaction.execute_many(
        f'INSERT INTO "{layer.name}" ({names}) VALUES ({marks})',
        (
            (geometry_blob(shape, srs_id, layer.has_z), *map(_plain, values))
            for shape, values in features
        ),
    )


def geometry_blob(geometry: BaseGeometry, srs_id: int, has_z: bool = False) -> bytes:
    """A geometry as GeoPackage binary: header with envelope, then ISO well-known binary."""
    flags = _LITTLE_ENDIAN | (_EMPTY if geometry.is_empty else 0)
    envelope = b""
    if not geometry.is_empty and geometry.geom_type != "Point":
        west, south, east, north = geometry.bounds
        flags |= _XY_ENVELOPE
        envelope = struct.pack("<4d", west, east, south, north)
    header = struct.pack("<2sBBi", b"GP", 0, flags, srs_id)
    return (
        header
        + envelope
        + shapely.to_wkb(geometry, output_dimension=3 if has_z else 2, byte_order=1, flavor="iso")
    )


def register_crs(transaction: Transaction, crs: str) -> int:
    """Enter the CRS into the file.

    Returns:
        Its `srs_id`.
    """
    known = read_crs(crs, "block.toml [block] crs")
    epsg = known.to_epsg(min_confidence=100)
    organization, code = ("NONE", CUSTOM_SRS_ID) if epsg is None else ("EPSG", epsg)
    try:
        definition = known.to_wkt("WKT1_GDAL")
    except CRSError:
        definition = known.to_wkt()
    transaction.execute(
        "INSERT OR REPLACE INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, NULL)",
        (known.name, code, organization, code, definition),
    )
    return code


def _drop(transaction: Transaction, name: str) -> None:
    """Remove a table and what GDAL may have entered about it."""
    tables = {row[0] for row in transaction.query("SELECT name FROM sqlite_master")}
    for about in ("gpkg_ogr_contents", "gpkg_extensions", "gpkg_geometry_columns", "gpkg_contents"):
        if about in tables:
            transaction.execute(f"DELETE FROM {about} WHERE table_name = ?", (name,))
    transaction.execute(f'DROP TABLE IF EXISTS "{name}"')
    transaction.execute(f'DROP TABLE IF EXISTS "rtree_{name}_geom"')


def _extent(bounds: np.ndarray) -> list[float]:
    low, high = np.nanmin(bounds[:, :2], axis=0), np.nanmax(bounds[:, 2:], axis=0)
    return [float(value) for value in (*low, *high)]


def _plain(value: Any) -> Any:
    """An attribute as SQLite takes it: no NumPy scalars; NaN is NULL."""
    plain: Any = cast("Any", value).item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, float) and not np.isfinite(plain) else plain
