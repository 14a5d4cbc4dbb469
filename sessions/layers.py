"""The block as layers of the session file, for QGIS: photos, footprints, points, residuals."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
import shapely

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Position, locked
from core.block import Block, Measurement, Status
from core.geometry.drawn_mask import outlines
from sessions.geopackage import Feature, Layer, register_crs, replace_layer
from sessions.store import Store

RESIDUAL_SCALE = 100.0
"""How much longer than life a residual vector is drawn."""
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


def write_layers(
    store: Store,
    block: Block,
    report: AdjustmentReport,
    footprints: Mapping[str, shapely.Polygon],
    residual_scale: float = RESIDUAL_SCALE,
) -> None:
    """Replace all layers in one transaction; the decisions are not touched.

    Args:
        store: The session file.
        block: The block with its measurements as they stand; orientations come from the report.
        report: The adjustment of the block.
        footprints: Ground polygon of each photo in the block's CRS.
        residual_scale: How much longer than life a residual is drawn.
    """
    made = (
        (PHOTOS, list(_photos(block, report))),
        (FOOTPRINTS, list(_footprints(block, footprints))),
        (POINTS, list(_points(block, report))),
        (MEASUREMENTS, list(_measurements(block, report))),
        (NEW_POINTS, list(_new_points(report))),
        (RESIDUAL_VECTORS, list(_residual_vectors(block, report, residual_scale))),
        (MASKS, list(_masks(block, report))),
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
        status, reason = _status(report, item)
        measured = (item.column, item.row, item.sigma_px, item.score)
        residual = report.residuals_px.get(key, (math.nan, math.nan))
        length, redundancy = _length(report, item), report.redundancy_numbers.get(key, math.nan)
        named = (*key, point.role, status, reason)
        yield shapely.Point(point.position), (*named, *measured, *residual, length, redundancy)


def _status(report: AdjustmentReport, item: Measurement) -> tuple[Status, str]:
    """State and reason of a measurement, after the adjustment left out its gross errors."""
    left_out = report.rejected.get(item.key)
    return (item.status, item.reason) if left_out is None else ("unused", left_out)


def _length(report: AdjustmentReport, item: Measurement) -> float:
    """Length of a measurement's residual, pixels; NaN where there is none."""
    return math.hypot(*report.residuals_px.get(item.key, (math.nan, math.nan)))


def _residual_vectors(block: Block, report: AdjustmentReport, scale: float) -> Iterable[Feature]:
    for key, item in block.measurements.items():
        residual, point = report.residuals_px.get(key), block.surveyed.get(item.point_id)
        status, _ = _status(report, item)
        if status not in SHOWN or residual is None or point is None:
            continue
        vector = _on_ground(report.block, item, residual, float(point.position[2]))
        if vector is None:
            continue
        start = point.position[:2]
        line = shapely.LineString([start, start + scale * vector])
        lengths = (math.hypot(*residual), float(np.hypot(*vector)), scale)
        yield line, (*key, point.role, status, *lengths)


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
