"""Control proposals: reference points searched near where the block says they are."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from core.arrays import PixelPoints, Scalars
from core.block.block import Block, Measurement, Peak, Source, SurveyedPoint
from core.block.matching import Found, MatchingOptions, match_points, predict_pixels
from core.block.orientation import (
    OrientationOptions,
    ReferencePoints,
    finest_reduction,
    ground_sigma_px,
)
from core.block.patches import OpenPhoto
from core.progress import Progress
from core.reference.reference import Reference

CLEAR = 4.0
"""Robust standard deviations above other places at which a peak is as likely right as wrong."""
MATCH_FLOOR_PX = 0.35
"""No match is better than this, in pixels of the pass."""


@dataclass(frozen=True, slots=True)
class ControlOptions:
    """What makes a proposal one that is used."""

    search_m: float = 5.0
    """Half-width of the search about the block's prediction, metres."""
    gate: float = 2.2
    """The best peak must lie within this many standard deviations of the prediction."""
    min_score: float = 0.2
    """Likeness below this is no evidence."""


def measurements_of(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    orientation: OrientationOptions,
    options: ControlOptions,
    progress: Progress | None = None,
) -> tuple[Measurement, ...]:
    """Search all reference points in one photo of an oriented block and say which agree.

    Args:
        opened: The photo with the block's orientation.
        reference: Ortho and heights.
        points: Junctions and salient points.
        orientation: Sizes of the templates.
        options: Limits.
        progress: Told as the work goes on.

    Returns:
        One measurement for every point that was found at all, used or with the reason why not.
    """
    reduction = finest_reduction(opened, reference, orientation)
    half = int(np.ceil(options.search_m / opened.ground_pixel_m / reduction))
    matching = MatchingOptions(
        reduction=reduction,
        template_half_px=orientation.template_half_px,
        min_search_px=max(half, 8),
        max_search_px=max(half, 8),
    )
    prediction = predict_pixels(opened, np.zeros((6, 6)), points.positions, points.sigma_m)
    found = match_points(opened, reference, prediction, matching, progress)
    sigma = ground_sigma_px(opened, points.sigma_m)
    return tuple(
        judged(opened, points.ids[match.point], match, prediction.pixels, sigma, reduction, options)
        for match in found
    )


def judged(
    opened: OpenPhoto,
    point_id: str,
    match: Found,
    predicted: PixelPoints,
    sigma_ground_px: Scalars,
    reduction: int,
    options: ControlOptions,
) -> Measurement:
    """The measurement of one point: its best peak, used when it agrees with the block.

    Only the best peak may agree: with several to choose from, chance would agree too often.
    """
    peak = match.peaks[0]
    sigma = max(peak.sigma_px, MATCH_FLOOR_PX * reduction)
    offset = np.array([peak.column, peak.row]) - predicted[match.point]
    distance = float(np.hypot(*offset)) / float(np.hypot(sigma, sigma_ground_px[match.point]))
    score = likeness(peak)
    away_m = float(np.hypot(*offset)) * opened.ground_pixel_m
    reason = ""
    if distance > options.gate * np.sqrt(2):
        reason = f"{away_m:.1f} m from where the block expects it"
    elif score < options.min_score:
        reason = "not alike enough"
    return Measurement(
        point_id,
        opened.photo.photo_id,
        peak.column,
        peak.row,
        sigma,
        score,
        "unused" if reason else "auto",
        reason,
        match.peaks,
    )


def likeness(peak: Peak) -> float:
    """0 to 1: how far a peak stands above other places, halved where only grey values agree."""
    clear = 1.0 / (1.0 + float(np.exp(CLEAR - peak.score)))
    return clear * (0.5 if peak.operator == "ncc" else 1.0)


def surveyed_of(points: ReferencePoints, sources: Mapping[str, Source]) -> dict[str, SurveyedPoint]:
    """Reference points as control points."""
    return {
        point_id: SurveyedPoint(point_id, position, sigma, "control", sources[point_id])
        for point_id, position, sigma in zip(
            points.ids, points.positions, points.sigma_m, strict=True
        )
    }


def with_proposals(
    block: Block,
    points: ReferencePoints,
    sources: Mapping[str, Source],
    measurements: tuple[Measurement, ...],
) -> Block:
    """The block with newly proposed control in place of all that was proposed before.

    Surveyed points of the user stay, and so does whatever was measured of them.
    """
    kept = {name: point for name, point in block.surveyed.items() if point.source == "surveyed"}
    measured = {key: value for key, value in block.measurements.items() if key[0] in kept}
    measured.update({value.key: value for value in measurements})
    named = {key[0] for key in measured}
    surveyed = {
        name: point
        for name, point in {**surveyed_of(points, sources), **kept}.items()
        if name in named or name in kept
    }
    return replace(block, surveyed=surveyed, measurements=dict(sorted(measured.items())))
