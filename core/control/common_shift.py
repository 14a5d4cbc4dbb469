"""Salient points with a common offset: estimated against the junctions, and weighted down by it.

Crowns and shadows belong to another hour and another height than those of the reference, in every
photo alike. Salient points may therefore agree with each other and all be off in one direction,
which their residuals do not show. Road junctions do, where they hold the block by themselves.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.block import UNKNOWN_M, Block, SurveyedPoint
from core.doubts import Doubt
from core.geometry.robust import robust_sigma
from core.said import say

# design: their mean is known to a quarter of what one is.
LEAST_JUNCTIONS = 15
"""Fewer junctions do not judge."""
# design: their mean is known to a third of what one is.
LEAST_SALIENT = 8
"""Fewer salient points have no common shift that could be told from chance."""
# design: a pixel of a common ortho; less is within what anybody asks for.
TOLD_M = 0.3
"""A shift larger than this is told."""
# design: of a thousand good points one lies as far off in either axis.
GROSS = 3.5
"""A point further from the median than so many robust standard deviations has no voice."""


@dataclass(frozen=True, slots=True, eq=False)
class CommonShift:
    """Where the salient points lie, all together, against the junctions."""

    shift_m: Float64[np.ndarray, "2"]
    """Where the junctions put them less where they are said to be (E, N), metres."""
    sigma_m: Float64[np.ndarray, "2"]
    """Standard deviations of that."""
    points: tuple[str, ...]
    """The salient points in use."""
    reference: str = ""
    """Which reference they come from, where that has a shift of its own."""

    @property
    def shared_m(self) -> Float64[np.ndarray, "2"]:
        """The part that is more than chance (E, N), metres: s^2 less its variance, not below 0."""
        return np.sqrt(np.maximum(self.shift_m**2 - self.sigma_m**2, 0.0))


def common_shifts(block: Block, options: AdjustmentOptions) -> tuple[CommonShift, ...]:
    """Adjust with the plan of all salient points left open, and see where they come to lie.

    Args:
        block: An oriented block with its control.
        options: The adjustment.

    Returns:
        For each reference the mean over its points without gross ones, with its standard deviation;
        none where there are too few of either kind.
    """
    used = {key[0] for key, item in block.measurements.items() if block.steers(item)}
    of = {
        source: [name for name in sorted(used) if block.surveyed[name].source == source]
        for source in ("junction", "salient")
    }
    if len(of["junction"]) < LEAST_JUNCTIONS or len(of["salient"]) < LEAST_SALIENT:
        return ()
    open_m = np.array([UNKNOWN_M, UNKNOWN_M, 0.0])
    loose = {
        name: replace(block.surveyed[name], sigma_m=block.surveyed[name].sigma_m + open_m)
        for name in of["salient"]
    }
    report = adjust_block(replace(block, surveyed={**block.surveyed, **loose}), options)
    groups: dict[str, list[str]] = {}
    for name in of["salient"]:
        if name in report.surveyed_positions:
            groups.setdefault(_reference_of(block.surveyed[name]), []).append(name)
    return tuple(
        _shift_of(report, block, tuple(points), reference)
        for reference, points in groups.items()
        if report.converged and len(points) >= LEAST_SALIENT
    )


def _shift_of(
    report: AdjustmentReport, block: Block, points: tuple[str, ...], reference: str
) -> CommonShift:
    """The mean of some points less where they are said to be."""
    off = np.array(
        [(report.surveyed_positions[n] - block.surveyed[n].position)[:2] for n in points]
    )
    apart = off - np.median(off, axis=0)
    spread = np.array([robust_sigma(axis) for axis in apart.T])
    off = off[np.all(np.abs(apart) <= GROSS * spread, axis=1)]
    # The best held point tells how well the junctions know the ground under all of them alike.
    held = np.min([report.surveyed_sigmas_m[name][:2] for name in points], axis=0)
    sigma = np.hypot(off.std(axis=0, ddof=1) / np.sqrt(len(off)), held)
    return CommonShift(off.mean(axis=0), sigma, points, reference)


def _reference_of(point: SurveyedPoint) -> str:
    return "" if point.shifted is None else point.shifted.name


def weigh_salient_points(block: Block, shift: CommonShift) -> tuple[Block, tuple[Doubt, ...]]:
    """The block with its salient points given what they are worth together, and what to tell.

    Those of other references keep their worth.

    An error that n points share makes their mean no better than one point: each gets the variance
    n times the square of what they share besides its own.
    """
    shared = np.append(shift.shared_m, 0.0) * np.sqrt(len(shift.points))
    lesser = {
        name: replace(point, sigma_m=np.hypot(point.sigma_m, shared))
        for name, point in block.surveyed.items()
        if point.source == "salient" and point.role == "control"
        if _reference_of(point) == shift.reference
    }
    length = float(np.hypot(*shift.shared_m))
    told = Doubt(
        "common-shift",
        shift.reference or "salient points",
        say(
            "{count} salient points lie {length:.1f} m off where the road junctions put "
            "them, all the same way, as crowns and shadows do. They were given less "
            "weight.",
            count=len(shift.points),
            length=length,
        ),
        evidence={"east_m": float(shift.shift_m[0]), "north_m": float(shift.shift_m[1])},
    )
    return replace(block, surveyed={**block.surveyed, **lesser}), (told,) * (length > TOLD_M)
