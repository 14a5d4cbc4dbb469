"""The misfit: how far a measurement lies from where the block expects its surveyed point.

A control point with weak coordinates follows its measurement, so its residual in the adjustment
stays small even if the place is wrong. The misfit does not: it is the projection of the *given*
coordinates minus the measurement, with the standard deviations of both. An accepted measurement
that the block contradicts has pulled the block towards itself: its misfit is as long as the verdict
says, which leaves it out.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from core.adjustment.adjusted import AdjustmentReport, Contradiction
from core.block import Block, Measurement, Photo, SurveyedPoint
from core.geometry.camera import Camera
from ui.review.state import DeskState, Key

STEPS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""A point and its neighbours a metre to the east and to the north."""
ORDINARY = 3.0
"""The ramp of sizes ends at about this many times the median misfit; few are larger."""
Matrices = Float64[np.ndarray, "n 2 2"]


@dataclass(frozen=True, slots=True)
class Misfit:
    """One measurement against the given coordinates of its point, expected minus measured."""

    pixels: tuple[float, float]
    """Column and row, scan pixels."""
    metres: tuple[float, float]
    """The same on the ground, east and north, metres."""
    ratio: float
    """Length in standard deviations, those of the coordinates included."""


def misfits(
    state: DeskState,
    keys: Iterable[Key] | None = None,
    report: AdjustmentReport | None = None,
) -> dict[Key, Misfit]:
    """Misfits of all measurements, or of those with some keys, that can be projected.

    Args:
        state: The block with its decisions.
        keys: Measurements; all by default.
        report: Another adjustment than the newest, for the old figures.
    """
    told = report or state.report
    block, oriented = state.block, told.block
    wanted = tuple(block.measurements if keys is None else keys)
    alone = _alone(block, {key[0] for key in wanted})
    by_photo: dict[str, list[tuple[Measurement, SurveyedPoint]]] = {}
    for key in wanted:
        if key in alone:
            continue
        measurement, point = state.measurement_of(key), state.point_of(key[0])
        if measurement is not None and point is not None and key[1] in oriented.photos:
            by_photo.setdefault(key[1], []).append((measurement, point))
    unit = max(told.unit, 0.5)
    found: dict[Key, Misfit] = {}
    for photo_id, within in by_photo.items():
        photo, camera = oriented.photos[photo_id], oriented.camera_of(photo_id)
        found |= _in_photo(photo, camera, within, unit)
    for one in told.contradictions:
        here, there = block.measurements.get(one.key), oriented.measurements.get(one.key)
        # Not of a draft, which lies elsewhere than what was judged.
        if one.key in found and here and there and _place(here) == _place(there):
            found[one.key] = without_pull(found[one.key], one)
    return found


def without_pull(misfit: Misfit, found: Contradiction) -> Misfit:
    """The misfit from where all other measurements put the place, as the verdict tells it.

    Its direction is that of the block which the measurement has pulled towards itself.
    """
    pixels, metres = math.hypot(*misfit.pixels), math.hypot(*misfit.metres)
    if not pixels or not metres:
        return replace(misfit, ratio=found.test)
    by_px, by_m = found.pixels / pixels, found.metres / metres
    return Misfit(
        (by_px * misfit.pixels[0], by_px * misfit.pixels[1]),
        (by_m * misfit.metres[0], by_m * misfit.metres[1]),
        found.test,
    )


def shown_misfits(state: DeskState, away: Mapping[Key, Misfit]) -> dict[Key, Misfit]:
    """Misfits of measurements that take part or judge."""
    measurements = state.block.measurements
    return {
        key: misfit
        for key, misfit in away.items()
        if key in measurements
        and state.shown_state(measurements[key]) not in ("unused", "rejected")
    }


def ramp_top_m(state: DeskState, away: Mapping[Key, Misfit]) -> float:
    """Where the ramp of sizes ends, 1, 2 or 5 of a power of ten, metres.

    It hangs on the median, so that a few gross errors do not make all others alike.
    """
    sizes = [np.hypot(*one.metres) for one in shown_misfits(state, away).values()]
    most = ORDINARY * float(np.median(sizes)) if sizes else 0.0
    if most <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(most))
    return float(min(step * power for step in (1, 2, 5, 10) if step * power >= most))


def _alone(block: Block, names: Collection[str]) -> set[Key]:
    """Measurements of some new points that no other photo measures.

    They place their point themselves, so that nothing is known of their misfit.
    """
    known = block.surveyed
    rays: dict[str, list[Key]] = {
        name: [] for name in names if name in known and known[name].role == "new"
    }
    for key, item in block.measurements.items() if rays else ():
        if key[0] in rays and item.used:
            rays[key[0]].append(key)
    return {keys[0] for keys in rays.values() if len(keys) == 1}


def _in_photo(
    photo: Photo,
    camera: Camera,
    within: list[tuple[Measurement, SurveyedPoint]],
    unit: float,
) -> dict[Key, Misfit]:
    """Misfits within one photo; `unit` is the standard deviation of unit weight."""
    measured, points = [item for item, _ in within], [point for _, point in within]
    around = np.array([point.position for point in points])[:, None, :] + STEPS
    pixels = photo.pixel_from_object(around.reshape(-1, 3), camera).reshape(-1, 3, 2)
    matrices: Matrices = np.swapaxes(pixels[:, 1:] - pixels[:, :1], 1, 2)
    sound = np.isfinite(matrices).all(axis=(1, 2)) & (abs(np.linalg.det(matrices)) > 1e-9)
    matrices[~sound] = np.eye(2)
    away = pixels[:, 0] - np.array([[item.column, item.row] for item in measured])
    metres = np.linalg.solve(matrices, away[:, :, None])[:, :, 0]
    per_metre = np.sqrt(abs(np.linalg.det(matrices)))
    ground = np.array([float(np.hypot(*point.sigma_m[:2])) for point in points]) / np.sqrt(2)
    sigma = unit * np.hypot([item.sigma_px for item in measured], ground * per_metre)
    ratio = np.hypot(away[:, 0], away[:, 1]) / sigma
    return {
        item.key: Misfit(_pair(away[i]), _pair(metres[i]), float(ratio[i]))
        for i, item in enumerate(measured)
        if sound[i]
    }


def _place(measurement: Measurement) -> tuple[float, float]:
    return measurement.column, measurement.row


def _pair(values: Float64[np.ndarray, " 2"]) -> tuple[float, float]:
    return float(values[0]), float(values[1])
