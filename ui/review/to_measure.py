"""Surveyed and new points that wait to be measured, where they are expected, in order."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from core.block import Block, Measurement, SurveyedPoint
from core.control.new_points import places_of_new_points
from core.control.prediction import Prediction, predict_points
from core.raster.dem import HeightSource
from ui.review.state import DeskState, Key, ToMeasure

# design: the order of views must not outweigh what two points bring.
VIEW_STEP = 1e-3
"""Share of its gain a point loses from one view to the next: all views of a point come together."""
WAITING = ("predicted", "proposed")
"""States of what is to be measured."""


def points_of_user(block: Block) -> tuple[SurveyedPoint, ...]:
    """Points that the user brought: they are measured by hand."""
    return tuple(point for point in block.surveyed.values() if point.source == "surveyed")


def with_predictions(state: DeskState, dem: HeightSource) -> DeskState:
    """The desk with its user's points and new ones predicted by the newest adjustment."""
    places = places_of_new_points(state.oriented, state.report, dem, state.evidence.covariances)
    found = predict_points(
        state.oriented,
        (*points_of_user(state.block), *(place.point for place in places.values())),
        state.evidence.covariances,
        state.report.unit,
        {name: place.covariance for name, place in places.items()},
    )
    known = replace(
        state.to_measure,
        predictions=found,
        places={name: place.point for name, place in places.items()},
    )
    return with_waiting(replace(state, to_measure=known))


def with_waiting(state: DeskState) -> DeskState:
    """The desk with what nobody has measured or given up so far."""
    known, block = state.to_measure, state.block
    waiting = {
        key: known.proposals.get(key) or _expected(one)
        for key, one in known.predictions.items()
        if key not in block.measurements and key[0] in block.surveyed
    }
    same = waiting.keys() == known.waiting.keys() and all(
        known.waiting[key] == item for key, item in waiting.items()
    )
    return state if same else replace(state, to_measure=replace(known, waiting=waiting))


def kept_up(before: DeskState, after: DeskState, dem: HeightSource) -> DeskState:
    """The desk after decisions: points that came or moved are predicted at once.

    What was proposed of a point that moved is of another place.
    """
    moved, known = _moved_points(before.block, after.block), after.to_measure
    if moved:
        left = {key: item for key, item in known.proposals.items() if key[0] not in moved}
        after = replace(after, to_measure=replace(known, proposals=left))
    same = not moved and _rays_of_new(before.block) == _rays_of_new(after.block)
    return with_waiting(after) if same else with_predictions(after, dem)


def _moved_points(before: Block, after: Block) -> set[str]:
    """Points of the user that came, went, or have other coordinates."""
    one, other = ({p.point_id: p for p in points_of_user(block)} for block in (before, after))
    return {
        name
        for name in one.keys() | other.keys()
        if one.get(name) is not other.get(name)
        and stated_place(before, name) != stated_place(after, name)
    }


def stated_place(block: Block, name: str) -> bytes:
    """Where a point lies and how surely, to be compared; nothing where there is none."""
    point = block.surveyed.get(name)
    return b"" if point is None else point.position.tobytes() + point.sigma_m.tobytes()


def _rays_of_new(block: Block) -> Mapping[str, list[Measurement]]:
    """What is measured of each new point."""
    rays = {name: list[Measurement]() for name, p in block.surveyed.items() if p.role == "new"}
    for (name, _), item in block.measurements.items() if rays else ():
        if name in rays:
            rays[name].append(item)
    return rays


def with_proposals(state: DeskState, proposals: Mapping[Key, Measurement]) -> DeskState:
    """The desk with other proposals of what is to be measured."""
    if proposals == state.to_measure.proposals:
        return state
    known = replace(state.to_measure, proposals=dict(proposals))
    return with_waiting(replace(state, to_measure=known))


def worth_of_rows(state: DeskState) -> dict[Key, float]:
    """What measuring brings, metres: that of a point's best view, less and less from view to view.

    So that a point is measured in all photos before the next one is looked at.
    """
    waiting, worth = state.to_measure.waiting, state.evidence.worth
    best: dict[str, float] = {}
    for key in waiting:
        best[key[0]] = max(best.get(key[0], 0.0), worth.get(key, 0.0))
    place: dict[str, int] = {}
    found: dict[Key, float] = {}
    for key in waiting:
        place[key[0]] = place.get(key[0], -1) + 1
        found[key] = best[key[0]] * (1 - VIEW_STEP * place[key[0]])
    return found


def by_view(to_measure: ToMeasure, keys: Iterable[Key]) -> list[Key]:
    """The same point in several photos, best view first; those not predicted come last."""
    predictions = to_measure.predictions
    inside = [key for key in keys if key in predictions]
    outside = [key for key in keys if key not in predictions]
    return [*sorted(inside, key=lambda key: predictions[key].view), *outside]


def _expected(one: Prediction) -> Measurement:
    """A place nobody has looked at, to be measured."""
    sigma = float(np.sqrt(np.trace(one.covariance) / 2))
    return Measurement(one.point_id, one.photo_id, one.column, one.row, sigma, 0.0, "unused")
