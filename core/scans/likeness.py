"""The middle of a mark that is known only from an example, measured in two ways.

An example that is not symmetric is a notch or a corner, and half of it is picture, which differs
from scan to scan. The picture biases grey values without the straight border, and gradient
directions, in different ways: where both agree, the mark is found.
"""

from functools import partial

import numpy as np
from jaxtyping import Float32

from core.doubts import Failure
from core.geometry.robust import TINY
from core.matching.peaks import (
    ScoreMap,
    ScorePeak,
    correlation_scores,
    cosine_scores,
    level_and_spread,
    measure_peak,
)
from core.matching.precision import place_covariance, sharpness_of
from core.scans.candidates import without_border
from core.scans.centring import Centre, Gray, Weights, blur_as_scanned


def centre_by_likeness(
    window: Gray, start: tuple[float, float], limit_px: float, template: Weights, along: int | None
) -> tuple[Centre, Centre] | Failure:
    """Where a window is most like an example that is not symmetric, in two ways.

    Grays without the straight border beside it, and directions of gradients whatever their height:
    the picture beside a notch is bright or dark, its edge runs the same way.

    Args:
        window: Part of the scan, without NaN.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
        template: The example as it lies in the scan.
        along: The axis along which the picture's border runs; None at a corner.
    """
    side, half = template.shape[0], template.shape[0] // 2
    reach = int(np.ceil(limit_px)) + 2
    column, row = int(start[0]) - half - reach, int(start[1]) - half - reach
    wide = side + 2 * reach
    if min(column, row) < 0 or max(column, row) + wide > min(window.shape):
        return Failure("It lies outside the scan.")
    gray = window[row : row + wide, column : column + wide]
    found: list[Centre] = []
    for layer_of, scores_of in (
        (partial(_without_border, along=along, side=side), correlation_scores),
        (_directions, cosine_scores),
    ):
        shown, sought = layer_of(gray), layer_of(template)
        scores = scores_of(shown, sought)
        peak = _highest(scores, limit_px)
        if peak is None:
            return Failure("Nothing there is like the mark that was shown.")
        at = round(peak.column), round(peak.row)
        part = shown[at[1] : at[1] + side, at[0] : at[0] + side]
        sharp = sharpness_of((sought,))
        if sharp is None:
            return Failure("The mark that was shown is an edge that fixes no place.")
        covariance = place_covariance(sharp, (part,))
        found.append(
            Centre(
                column + half + 0.5 + peak.column,
                row + half + 0.5 + peak.row,
                float(np.sqrt(np.trace(covariance) / 2)),
                peak.value,
            )
        )
    return found[0], found[1]


def _highest(scores: ScoreMap, limit_px: float) -> ScorePeak | None:
    """The highest peak within reach of the middle of a score map; None at the rim."""
    middle = scores.shape[0] // 2
    rows, columns = np.indices(scores.shape)
    near = np.hypot(rows - middle, columns - middle) <= limit_px
    best = int(np.argmax(np.where(near, scores, -np.inf)))
    row, column = divmod(best, scores.shape[1])
    if not (0 < row < scores.shape[0] - 1 and 0 < column < scores.shape[1] - 1):
        return None
    return measure_peak(scores, row, column, *level_and_spread(scores))


def _without_border(gray: np.ndarray, along: int | None, side: int) -> Gray:
    return without_border(gray.astype(np.float32), side, along)


def _directions(gray: np.ndarray) -> Float32[np.ndarray, "rows columns 2"]:
    """Gradients (right, down), strong ones weighing little more than weak ones."""
    soft = blur_as_scanned(gray.astype(np.float32))
    both = np.stack([np.gradient(soft, axis=1), np.gradient(soft, axis=0)], axis=-1)
    length = np.linalg.norm(both, axis=-1, keepdims=True)
    return (both / np.sqrt(length * length.mean() + TINY)).astype(np.float32)
