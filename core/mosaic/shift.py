"""The shift between two patches of nearly the same content, to a few hundredths of a pixel.

Normalised correlation finds the whole pixel, least-squares matching (shift, gain and offset) the
fraction: unlike a parabola through the peak it does not lean towards whole pixels.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from scipy import ndimage

from core.matching.peaks import highest_places
from core.matching.template_search import correlation_scores

Patch = Float32[np.ndarray, "_ _"]
SMOOTHING_PX = 0.8
"""Both patches are smoothed a little before the fraction is measured: grain aliases."""


@dataclass(frozen=True, slots=True)
class Shift:
    """Where the content of one patch lies in another."""

    column: float
    """Pixels to the right."""
    row: float
    """Pixels down."""
    peak: float
    """Height of the correlation peak, -1 to 1."""
    second: float
    """Height of the next one outside the neighbourhood of the first."""
    at_edge: bool
    """True when the peak lies at the edge of the search: the shift may be larger."""


def find_shift(
    template: Patch, image: Patch, search_px: int, neighbourhood_px: int = 4
) -> Shift | None:
    """Find a template in an image that is `search_px` larger on every side.

    Args:
        template: Patch that is looked for.
        image: Where it is looked for.
        search_px: How far it may be shifted, pixels.
        neighbourhood_px: Around the peak no second one is looked for, pixels.

    Returns:
        The shift, NaN where the fraction does not converge; None where a patch has no contrast.
    """
    if min(float(np.std(template)), float(np.std(image))) < 1e-3:
        return None
    scores = correlation_scores(image, template)
    place, *others = highest_places(scores, 2, neighbourhood_px)
    at_edge = min(place) == 0 or max(place) == 2 * search_px
    fraction = _fraction(template, image, place)
    return Shift(
        column=place[1] - search_px + fraction[0],
        row=place[0] - search_px + fraction[1],
        peak=float(scores[place]),
        second=float(scores[others[0]]) if others else -1.0,
        at_edge=at_edge,
    )


def _fraction(
    template: Patch, image: Patch, place: tuple[int, int], iterations: int = 12
) -> Float64[np.ndarray, "2"]:
    """Column and row to add to a whole-pixel place, by least-squares matching; NaN if it fails."""
    wanted = ndimage.gaussian_filter(template.astype(np.float64), SMOOTHING_PX)[2:-2, 2:-2]
    smooth = ndimage.gaussian_filter(image.astype(np.float64), SMOOTHING_PX)
    spline = ndimage.spline_filter(smooth, order=3, mode="mirror")
    rows, columns = np.mgrid[0 : wanted.shape[0], 0 : wanted.shape[1]].astype(np.float64)
    rows, columns = rows + place[0] + 2, columns + place[1] + 2
    shift = np.zeros(2)
    for _ in range(iterations):
        found = ndimage.map_coordinates(
            spline, [rows + shift[1], columns + shift[0]], order=3, prefilter=False, mode="mirror"
        )
        down, right = np.gradient(found)
        design = np.stack([right, down, found, np.ones_like(found)], axis=-1)[1:-1, 1:-1]
        design = design.reshape(-1, 4)
        try:
            solution = np.linalg.solve(design.T @ design, design.T @ wanted[1:-1, 1:-1].ravel())
        except np.linalg.LinAlgError:
            break
        if not solution[2] > 1e-3:
            break
        step = solution[:2] / solution[2]
        shift += np.clip(step, -1, 1)
        if np.abs(shift).max() > 2:
            break
        if np.abs(step).max() < 1e-4:
            return shift
    return np.full(2, np.nan)
