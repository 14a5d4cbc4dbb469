"""Operators: measures of similarity between a reference patch and every place of a scan window.

All implement one small interface. A whole tile is described once; the score map of a point is then
cut out of two descriptions. The engine uses two: `fused` compares the directions of edges with
those of the ortho and of the drawn roads, whatever their contrast and its sign; `ncc-high-pass`
compares grey values. `core/literature/baselines.py` has others for comparison,
`core/matching/learned.py` the one that runs a network of the user.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from core.matching.peaks import (
    FLAT,
    Description,
    Field,
    Image,
    ScoreMap,
    correlation_scores,
    cosine_scores,
    normalised,
    sum_of_products,
)

# design: less than a pixel takes grain away and leaves edges (METHODS 4.2).
GRAIN_SIGMA_PX = 0.7
# design: edges of scan and ortho become of nearly one width (METHODS 4.1).
GRADIENT_SIGMA_PX = 1.2
# design: a Gaussian of five pixels changes little from one pixel to the next.
REDUCED_SIGMA_PX = 5.0
"""A wide mean is found on an image so far reduced that it still spans this many pixels."""
# design: a metre or two: maps draw the axis, and the width is that of a class.
VERGE_PX, FADE_PX = 2.0, 3.0
"""A drawn road is compared to so many pixels beyond its edges, and fades out over so many more."""
# source: exp(-3.03 squared / 2) = 0.01.
FADED = 3.03
"""Beyond so many times `FADE_PX` less than a hundredth is left of it."""
# design: both edges of a road across twenty pixels, a third of a template.
LEAST_ROAD_PX = 40.0
"""With less of a road in the template there is nothing to compare."""
# design: equal roads that cross at less than 32 degrees, or a side road of a thirteenth of all: the
# peak is a ridge.
MOST_STRAIGHT = 0.85
"""Where this share of all drawn edges runs one way, they say nothing of the place along it."""


@runtime_checkable
class Operator(Protocol):
    """One way to compare a scan with the reference, warped into the scan's geometry."""

    @property
    def name(self) -> str:
        """What `block.toml` calls it."""
        ...

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """What is compared of a window of the scan."""
        ...

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """What is compared of the ortho, and of the roads drawn into the same window."""
        ...

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Likeness at every place of a patch of the reference within a window of the scan."""
        ...

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """The layers of scan and reference whose products `surface` sums, both of one size."""
        ...


@dataclass(frozen=True, slots=True)
class FusedOperator:
    """The mean of `gradient` and `roads`: what the ortho and the map both say."""

    name: str = "fused"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Field of doubled angles, and its squared length."""
        field = doubled_angle_field(scan)
        return field, squared_length(field)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """Field of the ortho, then that of the roads with its weights."""
        return doubled_angle_field(reference), *drawn_field(roads)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Mean of both likenesses; where no road is drawn, that of the ortho alone."""
        ortho = cosine_scores(around[0], patch[0])
        energy, along = road_content(patch[1:])
        if not fixed_by_roads(energy, along):
            return ortho
        return (ortho + road_scores(around, patch[1:], energy)) / np.float32(2)

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """The scan's field, and the sum of ortho and roads as their likenesses weigh them."""
        energy, along = road_content(patch[1:])
        if not fixed_by_roads(energy, along):
            return shown[:1], patch[:1]
        field, squares = shown
        ortho, roads, weight = patch
        of_ortho = np.sqrt(float(np.sum(ortho * ortho)) * float(np.sum(squares))) + FLAT
        of_roads = np.sqrt(energy * float(np.sum(weight * squares))) + FLAT
        both = ortho / np.float32(of_ortho) + roads / np.float32(of_roads)
        return (field,), (both,)


@dataclass(frozen=True, slots=True)
class HighPassOperator:
    """Normalised cross-correlation of grey values less their surroundings.

    These are a Gaussian mean of a third of half the template.
    """

    name: str = "ncc-high-pass"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """A band of detail."""
        return (high_passed(scan, template_half_px / 3),)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """A band of detail."""
        return (high_passed(reference, template_half_px / 3),)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Pearson's correlation."""
        return correlation_scores(around[0], patch[0])

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """Grey values less their means."""
        return without_means(shown, patch)


USUAL = (FusedOperator(), HighPassOperator())
"""What is compared unless `block.toml` says otherwise."""
GREY = ("ncc", "ncc-high-pass")
"""Operators that compare grey values: crowns and shadows move all of them together."""


def without_means(shown: Description, patch: Description) -> tuple[Description, Description]:
    """Grey values less their means: the layers whose products a correlation sums."""
    return (shown[0] - shown[0].mean(),), (patch[0] - patch[0].mean(),)


def smoothed_gradient(image: Image, sigma_px: float) -> tuple[Image, Image]:
    """Derivatives to the right and downwards of smoothed grey values."""
    smooth = cv2.GaussianBlur(image, (0, 0), sigma_px)
    right = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    return right, cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)


def doubled_angle_field(image: Image) -> Field:
    """Gradient direction doubled, weighted from 0 (flat) to 1: z = g^2 / (|g|^2 + tau^2).

    Returns:
        Real and imaginary part of z; tau is the 60th percentile of |g|.
    """
    right, down = smoothed_gradient(image, GRADIENT_SIGMA_PX)
    across, along = right * right, down * down
    squared = across + along
    # design: the flatter 60 % of the ground count for less than a half each (METHODS 4.1).
    tau_squared = float(np.percentile(squared[::3, ::3], 60)) + FLAT
    squared += np.float32(tau_squared)
    across -= along
    across /= squared
    right *= down
    right *= np.float32(2)
    right /= squared
    return np.asarray(cv2.merge([across, right]), dtype=np.float32)


def squared_length(field: Field) -> Image:
    """Squared length of every vector of a field."""
    right, down = cv2.split(field)
    right *= right
    down *= down
    return np.asarray(right + down, dtype=np.float32)


def drawn_field(roads: Image) -> Description:
    """Doubled angles of drawn roads times the weight they are compared with, and that weight."""
    drawn = roads > 0
    if not drawn.any():
        return np.zeros((*roads.shape, 2), np.float32), np.zeros_like(roads)
    field = doubled_angle_field(roads)
    away = cv2.distanceTransform((~drawn).astype(np.uint8), cv2.DIST_L2, 3)
    weight = np.zeros_like(roads)
    near = away < VERGE_PX + FADED * FADE_PX
    fade = np.maximum(away[near] - VERGE_PX, 0) / FADE_PX
    weight[near] = np.exp(-0.5 * fade * fade)
    return np.asarray(field * cv2.merge([weight, weight]), dtype=np.float32), weight


def road_scores(around: Description, patch: Description, energy: float) -> ScoreMap:
    """Re sum(w conj(z_T) z_S) / sqrt(sum w |z_T|^2 sum w |z_S|^2), w of the drawn roads."""
    field, weight = patch
    shape = np.array(around[1].shape) - weight.shape + 1
    if energy < LEAST_ROAD_PX:
        return np.zeros(tuple(shape), np.float32)
    product = sum_of_products(around[:1], (field,))
    seen = sum_of_products(around[1:], (weight,))
    return normalised(product, seen, energy)


def road_content(patch: Description) -> tuple[float, float]:
    """How much road a template holds, sum of w |z_T|^2, and how much of it runs one way."""
    field, weight = patch
    telling = np.flatnonzero(weight)
    weights = weight.reshape(-1)[telling]
    vectors = field.reshape(-1, 2)[telling]
    lengths = np.hypot(vectors[:, 0], vectors[:, 1])
    along = (vectors * (lengths / weights)[:, None]).sum(axis=0)
    return float(np.sum(lengths * lengths / weights)), float(np.hypot(*along))


def fixed_by_roads(energy: float, along: float) -> bool:
    """Whether roads fix a place in both directions: a straight one alone is alike all along."""
    return energy >= LEAST_ROAD_PX and along <= MOST_STRAIGHT * energy


def has_roads(patch: Description) -> bool:
    """Whether a template of `fused` holds roads that fix a place in both directions."""
    return len(patch) == 3 and fixed_by_roads(*road_content(patch[1:]))


def high_passed(image: Image, sigma_px: float) -> Image:
    """Grey values less their surroundings, with the grain smoothed: a band of detail."""
    fine = cv2.GaussianBlur(image, (0, 0), GRAIN_SIGMA_PX)
    return np.asarray(fine - surroundings(image, sigma_px), dtype=np.float32)


def surroundings(image: Image, sigma_px: float) -> Image:
    """Gaussian mean about every place; where it is wide, found on a reduced image."""
    size = int(sigma_px / REDUCED_SIGMA_PX)
    rows, columns = image.shape
    # design: with fewer reduced pixels to a side the rim would decide.
    if size < 2 or min(rows, columns) < 8 * size:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32)
    shape = (-(-columns // size), -(-rows // size))
    # Less one of its values, so that rounding leaves a flat image flat.
    level = image[0, 0]
    small = cv2.resize(image - level, shape, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / size)
    whole = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole + level, dtype=np.float32)
