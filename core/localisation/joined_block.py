"""Photos joined to one body by their ties, with what single photos agreed on as weak control."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import Block, Measurement, Source, SurveyedPoint
from core.doubts import Failure
from core.localisation.initial_orientation import MIN_TIES
from core.localisation.photo_orientation import OrientedPhoto
from core.reference.stage import ReferencePoints

# design: crowns lean and shadows turn together by this much, so that single photos may be wrong
# together; they must not bend the block.
WEAK_M = 6.0
"""Standard deviation of what single photos agree on while ties bring them together, metres."""
# design: peaks of a first pass are broader than those of control, and shared errors hide in them.
WEAK_SCALE = 2.0
"""Their measurements count with so many times the standard deviation that their peaks have."""


@dataclass(frozen=True, slots=True, eq=False)
class WeakControl:
    """Points that single photos agreed on."""

    surveyed: Mapping[str, SurveyedPoint]
    """The points by name."""
    measurements: tuple[Measurement, ...]
    """Where the photos show them."""

    @staticmethod
    def none() -> "WeakControl":
        """No such points."""
        return WeakControl({}, ())


def weak_control(
    block: Block,
    oriented: Mapping[str, OrientedPhoto | Failure],
    points: ReferencePoints,
    sources: Mapping[str, Source],
) -> WeakControl:
    """What the photos that stand by themselves agreed on.

    Args:
        block: The block; photos that do not stand have no say.
        oriented: What each photo found by itself.
        points: The reference points, in the order in which `oriented` counts them.
        sources: Where each comes from.
    """
    measurements = tuple(
        Measurement(points.ids[point], photo_id, peak.column, peak.row, WEAK_SCALE * peak.sigma_px)
        for photo_id, result in oriented.items()
        if isinstance(result, OrientedPhoto) and block.photos[photo_id].oriented
        for point, peak in zip(result.agreeing.tolist(), result.agreed, strict=True)
    )
    rows = {name: row for row, name in enumerate(points.ids)}
    surveyed = {
        name: SurveyedPoint(
            name, points.positions[rows[name]], np.full(3, WEAK_M), "control", sources[name]
        )
        for name in sorted({value.point_id for value in measurements})
    }
    return WeakControl(surveyed, measurements)


def join_photos(block: Block, weak: WeakControl, options: AdjustmentOptions) -> Block:
    """Adjust by the ties with weak control.

    Without ties, or where the adjustment does not converge, the photos stay as they are.
    """
    if block.ties.count < MIN_TIES:
        return block
    first = replace(
        block,
        surveyed=weak.surveyed,
        measurements={value.key: value for value in weak.measurements},
    )
    report = adjust_block(first, replace(options, robust=False))
    return block.with_photos(report.block.photos) if report.converged else block
