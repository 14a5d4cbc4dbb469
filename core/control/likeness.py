"""Similarity of a reference point's patch and a scan around the expected place."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from core.arrays import PixelPoints, locked
from core.doubts import Failure
from core.localisation.photo_orientation import OrientationOptions, finest_reduction
from core.matching.local_search import (
    SEPARATION_PX,
    MatchingOptions,
    prepared,
    view_of,
)
from core.matching.operators import FusedOperator
from core.matching.patches import OpenPhoto, Window
from core.matching.peaks import Image, detect_peaks, level_and_spread
from core.matching.reference import Reference

OPERATOR = FusedOperator()
"""What the desk compares with."""
# design: less than the separation of two peaks.
REACH_PX = 3.0
"""A place is refined to a peak no further away than this, pixels of the pass."""
# design: all that a window of the desk holds, at their separation.
PEAKS = 12
"""So many maxima of a surface are looked at."""
# design: the usual level of a test.
BY_CHANCE = 0.05
"""In this share of windows that do not hold the point, chance alone brings a higher peak."""


@dataclass(frozen=True, slots=True, eq=False)
class Likeness:
    """Likeness to ortho and roads by place, in the scan."""

    values: Image
    """1 where all is the same, 0 and below where they have nothing in common, (n, n)."""
    first: PixelPoints
    """Scan pixel of the first value, (1, 2)."""
    reduction: int
    """Scan pixels from one value to the next."""

    def refined(self, pixel: PixelPoints) -> PixelPoints | Failure:
        """The sub-pixel peak, by least squares through its surroundings, nearest to a scan pixel.

        Args:
            pixel: Where the point was set or measured, (1, 2).

        Returns:
            Its place, (1, 2), or why there is none.
        """
        peaks = detect_peaks(self.values, PEAKS, SEPARATION_PX)
        places = self.first + self.reduction * np.array(
            [[peak.column, peak.row] for peak in peaks]
        ).reshape(-1, 2)
        away = np.hypot(*(places - pixel).T)
        if not len(away) or away.min() > REACH_PX * self.reduction:
            return Failure("there is no peak of likeness near")
        return places[[int(np.argmin(away))]]

    def value_at(self, pixel: PixelPoints) -> float:
        """Likeness at the place nearest to a scan pixel, (1, 2)."""
        cell = np.rint((pixel - self.first)[0] / self.reduction).astype(np.int64)
        across, down = np.clip(cell, 0, np.array(self.values.shape)[::-1] - 1)
        return float(self.values[down, across])

    def height_at(self, pixel: PixelPoints) -> float:
        """How far the likeness at a scan pixel, (1, 2), stands above its surface, in robust sigma.

        The measure of the heights of proposed candidates, except that the middle is not left out.
        """
        middle, spread = level_and_spread(self.values)
        return (self.value_at(pixel) - middle) / spread

    @property
    def chance_height(self) -> float:
        """Height in robust sigma that the highest peak of chance passes in `BY_CHANCE` of windows.

        The highest of n independent normal values, n the places of the window that are a
        separation of peaks apart: 3.2 of 35 values square, 3.6 of 81.
        """
        places = max(self.values.size / SEPARATION_PX**2, 1.0)
        return float(ndtri((1.0 - BY_CHANCE) ** (1.0 / places)))


def search_options(
    opened: OpenPhoto, reference: Reference, orientation: OrientationOptions, search_m: float
) -> MatchingOptions:
    """The sizes with which control is proposed, for a search of some metres."""
    reduction = finest_reduction(opened, reference, orientation)
    # design: twice the separation of peaks; less would show a single one.
    half = max(int(np.ceil(search_m / opened.ground_pixel_m / reduction)), 8)
    return MatchingOptions(
        reduction=reduction,
        template_half_px=orientation.template_half_px,
        min_search_px=half,
        max_search_px=half,
        operators=(OPERATOR,),
    )


def likeness_about(
    opened: OpenPhoto, reference: Reference, pixel: PixelPoints, options: MatchingOptions
) -> Likeness | Failure:
    """Compare the reference about a point with a scan around where it is expected.

    Args:
        opened: The photo with its orientation.
        reference: Ortho and heights.
        pixel: Scan pixel at which the orientation expects the point, (1, 2).
        options: Sizes; `min_search_px` is how far around.

    Returns:
        The surface, or why there is none.
    """
    if not np.all(np.isfinite(pixel)):
        return Failure("the point is not in this photo")
    half, inner, reduction = options.min_search_px, options.template_half_px, options.reduction
    margin = (half + inner + 3) * reduction
    low = np.floor(pixel[0]).astype(np.int64) - margin
    side = 2 * (half + inner + 3) + 1
    window = Window(int(low[0]), int(low[1]), side, side, reduction)
    view = view_of(prepared(opened, reference, window, pixel, options), 0, pixel, half)
    if view is None:
        return Failure("the reference is not known about the point")
    return Likeness(view.scores(OPERATOR.name), locked(view.centre - half * reduction), reduction)
