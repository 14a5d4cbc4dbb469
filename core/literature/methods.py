"""The classical methods of aerial triangulation beside the bundle, on the same observations."""

from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.accuracy import intersect_checks
from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Position
from core.block import Block
from core.doubts import Failure
from core.literature.independent_models import (
    Sights,
    Triangulated,
    form_models,
    triangulate_models,
)
from core.literature.strip_triangulation import triangulate_strips


@dataclass(frozen=True, slots=True, eq=False)
class MethodResult:
    """What one method makes of a block; all differences as RMS of X, Y, Z, metres."""

    method: str
    """`strips`, `models` or `bundle`."""
    reason: str = ""
    """Why it could not be done; empty when it was."""
    joint_m: Position | None = None
    """Left where strips or models meet each other and the control."""
    control_m: Position | None = None
    """Control points, intersected, minus known."""
    check_m: Position | None = None
    """Check points, intersected, minus known; None without any."""
    centres_m: Position | None = None
    """Perspective centres minus those of the bundle."""


def compare_methods(report: AdjustmentReport) -> tuple[MethodResult, ...]:
    """Orient an adjusted block again by strips and by independent models.

    The oriented photos with their used control; cameras are those of the bundle.
    """
    bundle = report.block
    oriented = {name: photo for name, photo in bundle.photos.items() if photo.oriented}
    measured = {key: m for key, m in bundle.measurements.items() if m.photo_id in oriented}
    block = replace(bundle, photos=oriented, measurements=measured)
    sights = Sights.of(block)
    models = form_models(block, np.random.default_rng(0))
    methods = {"strips": triangulate_strips, "models": triangulate_models}
    results = [
        _judged(name, method(block, models, sights) if models else _NONE, block)
        for name, method in methods.items()
    ]
    return (*results, _judged("bundle", Triangulated(block, None), block))


_NONE = Failure("no two photos make a model")


def _judged(method: str, found: Triangulated | Failure, bundle: Block) -> MethodResult:
    """The figures of one method."""
    if isinstance(found, Failure):
        return MethodResult(method, found.reason)
    block = found.block
    known = {name: replace(point, role="check") for name, point in block.surveyed.items()}
    differences: dict[str, list[Position]] = {"control": [], "check": []}
    for check in intersect_checks(replace(block, surveyed=known)):
        if check.used_scans > 1:
            role = bundle.surveyed[check.point_id].role
            differences[role].append(check.difference_m)
    centres = [
        photo.exterior.centre - bundle.photos[name].exterior.centre
        for name, photo in block.photos.items()
    ]
    control, checks = _rms(differences["control"]), _rms(differences["check"])
    return MethodResult(method, "", found.joint_m, control, checks, _rms(centres))


def _rms(differences: list[Position]) -> Position | None:
    """Root mean square by axis; None without any."""
    if not differences:
        return None
    return np.asarray(np.sqrt(np.mean(np.square(differences), axis=0)))
