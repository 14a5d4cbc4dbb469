"""Upright SIFT at every place of a window at once.

A keypoint's histogram sums gradient magnitudes, shared out between neighbouring orientations and
neighbouring bins in place, under a Gaussian about the keypoint (Lowe 2004,
doi:10.1023/B:VISI.0000029664.99615.94, section 6). Upright, of one size and at every place, each
bin is a filter that is the same everywhere and separable: two products of matrices take the place
of a loop over keypoints. Figures are those of OpenCV: smoothing to 1.6 pixels of a scan taken to
be sharp to 0.5, a Gaussian of half the descriptor's width, values cut at a fifth.
"""

import cv2
import numpy as np
from jaxtyping import Float32

from core.matching.peaks import ScoreMap
from core.matching.template_search import Field, Image, TemplateField

Filters = Float32[np.ndarray, "filtered places"]
"""One row for each bin and place: what it takes of a line of pixels."""
Histograms = Float32[np.ndarray, "8 4 shifts_down 4 shifts_right"]
"""Orientation, bin downwards, place downwards, bin to the right, place to the right."""
OrientationMaps = Float32[np.ndarray, "8 rows columns"]
ORIENTATIONS, BINS = 8, 4
SMOOTHED_PX = float(np.sqrt(1.6**2 - 0.5**2))
MOST = np.float32(0.2)
"""No value of a descriptor of unit length counts for more, so that no single edge rules it."""
DULL = np.float32(1e-6)


def smoothed_gradients(image: Image) -> Field:
    """Gradients to the right and upwards of smoothed grey values."""
    smooth = cv2.GaussianBlur(image, (0, 0), SMOOTHED_PX)
    step = np.array([[-1, 0, 1]], np.float32)
    right = cv2.filter2D(smooth, cv2.CV_32F, step)
    up = cv2.filter2D(smooth, cv2.CV_32F, -step.T)
    return np.asarray(cv2.merge([right, up]), dtype=np.float32)


def sift_surface(window: Field, template: TemplateField) -> ScoreMap:
    """Less the distance between a template's descriptor and that of every place of a window.

    Args:
        window: Gradients of the scan.
        template: Gradients of the reference, square, with an odd number of rows.

    Returns:
        From -sqrt(2) for descriptors that share nothing to 0 for the same one.
    """
    side = template.shape[0]
    wanted = sift_histograms(template, side // 2, side / BINS)
    offered = sift_histograms(window, side // 2, side / BINS)
    likeness = np.einsum("kaibj,kab->ij", offered, wanted[:, :, 0, :, 0])
    return -np.sqrt(np.maximum(np.float32(2) - np.float32(2) * likeness, np.float32(0)))


def sift_histograms(gradients: Field | TemplateField, half_px: int, bin_px: float) -> Histograms:
    """Descriptors of unit length, of a square of 2 n + 1 pixels about every place.

    Args:
        gradients: To the right and upwards.
        half_px: n: no place closer to the rim is described, nothing further off is looked at.
        bin_px: Side of one of the four by four bins; their triangles reach two and a half of them
            from the place, less what the square cuts off.
    """
    rows, columns = (side - 2 * half_px for side in gradients.shape[:2])
    down, across = (bin_filters(places, half_px, bin_px) for places in (rows, columns))
    found = np.matmul(np.matmul(down, orientation_maps(gradients)), across.T)
    found = found.reshape(ORIENTATIONS, BINS, rows, BINS, columns)
    found = np.minimum(found, MOST * lengths(found))
    found /= lengths(found) + DULL
    return found


def lengths(found: Histograms) -> Float32[np.ndarray, "shifts_down 1 shifts_right"]:
    """Length of the descriptor of every place."""
    return np.sqrt(np.einsum("kaibj,kaibj->ij", found, found))[:, None]


def orientation_maps(gradients: Field | TemplateField) -> OrientationMaps:
    """Gradient magnitude, shared out between the two orientations it lies between."""
    right, up = (np.ascontiguousarray(gradients[:, :, axis]) for axis in (0, 1))
    magnitude, angle = cv2.cartToPolar(right, up)
    bins = angle * np.float32(ORIENTATIONS / (2 * np.pi))
    shared = np.empty((ORIENTATIONS, *right.shape), np.float32)
    for orientation in range(ORIENTATIONS):
        away = np.abs(bins - np.float32(orientation))
        away = np.minimum(away, np.float32(ORIENTATIONS) - away)
        shared[orientation] = np.maximum(np.float32(1) - away, np.float32(0)) * magnitude
    return shared


def bin_filters(places: int, half_px: int, bin_px: float) -> Filters:
    """What each bin of each place takes along a line: a triangle under the Gaussian.

    Args:
        places: How many places there are along the line.
        half_px: Half the square of a place.
        bin_px: Distance between the middles of two bins.
    """
    away = np.arange(-half_px, half_px + 1) / bin_px
    middles = np.arange(BINS) - (BINS - 1) / 2
    triangles = np.maximum(1 - np.abs(away - middles[:, None]), 0)
    taken = triangles * np.exp(-0.5 * (away / (BINS / 2)) ** 2)
    filters = np.zeros((BINS, places, places + 2 * half_px), np.float32)
    for place in range(places):
        filters[:, place, place : place + taken.shape[1]] = taken
    return filters.reshape(BINS * places, -1)
