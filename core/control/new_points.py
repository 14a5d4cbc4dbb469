"""Ground positions of details that are known from photos alone.

A detail measured in one photo lies on a ray that ends near the ground; in the next photo it is
searched along the image of that ray. From two photos on its rays intersect.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block, SurveyedPoint
from core.control.located import ABOVE_GROUND_M, Located, Space, Surroundings, locate_point
from core.control.prediction import LEAST_UNIT, Covariances
from core.raster.dem import HeightSource


@dataclass(frozen=True, slots=True, eq=False)
class NewPlace:
    """A new point where its measurements put it."""

    point: SurveyedPoint
    """The point, with their standard deviations."""
    covariance: Space
    """Square metres."""


def places_of_new_points(
    oriented: Block, report: AdjustmentReport, heights: HeightSource, covariances: Covariances
) -> dict[str, NewPlace]:
    """Every new point of a block.

    Args:
        oriented: The block with the newest orientations and all measurements.
        report: The newest adjustment; what it says of a point that has gained no ray since, stands.
        heights: The terrain.
        covariances: Of the photos that took part in it.
    """
    unit = max(report.unit, LEAST_UNIT) ** 2
    known = {name: unit * covariance for name, covariance in covariances.items()}
    around = Surroundings(oriented, {}, report.exterior_sigmas, heights, known)
    adjusted = {point.point_id: point for point in report.new_points}
    found: dict[str, NewPlace] = {}
    for name, point in oriented.surveyed.items():
        if point.role != "new":
            continue
        where = _located(around, point)
        sigma = np.sqrt(np.diag(where.covariance))
        own = replace(point, position=where.position, sigma_m=sigma)
        told = adjusted.get(name)
        if told is not None and _rays(oriented, name) == _rays(report.block, name):
            own = replace(own, position=told.position, sigma_m=told.sigma_m)
        found[name] = NewPlace(own, where.covariance)
    return found


def _located(around: Surroundings, point: SurveyedPoint) -> Located:
    """Where rays put a point; before it has any, where it was pointed at."""
    photos = around.block.photos
    measured = [
        item
        for (name, photo_id), item in around.block.measurements.items()
        if name == point.point_id and item.used and photos[photo_id].oriented
    ]
    where = locate_point(around, measured, None) if measured else None
    if isinstance(where, Located):
        return where
    return Located(point.position, np.eye(3) * ABOVE_GROUND_M**2, np.zeros(2))


def _rays(block: Block, name: str) -> Mapping[str, tuple[float, float]]:
    """Where a point is measured and in use, by photo."""
    every = block.measurements.values()
    return {m.photo_id: (m.column, m.row) for m in every if m.point_id == name and m.used}
