"""Operators: what says how alike a patch of the reference and every place of a scan window are.

All stand behind one small interface. What is compared is described once for a whole tile;
the surface of a point is then cut out of two descriptions. `gradient` is invariant to contrast
and its sign, `roads` owes the ortho nothing at all, and `fused` takes the mean of the two.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from core.matching.descriptors import AkazeOperator, OrbOperator, SiftOperator
from core.matching.learned import LEARNED, LearnedOperator
from core.matching.peaks import FLAT, ScoreMap
from core.matching.template_search import (
    Description,
    Field,
    Image,
    channel_scores,
    correlation_scores,
    cosine_scores,
    normalised,
    sum_of_products,
)

GRAIN_SIGMA_PX = 0.7
GRADIENT_SIGMA_PX = 1.2
REDUCED_SIGMA_PX = 5.0
"""A wide mean is found on an image so far reduced that it still spans this many pixels."""
CHANNELS = 9
"""Orientations of CFOG."""
CFOG_SIGMA_PX = 0.8
VERGE_PX, FADE_PX = 2.0, 3.0
"""A drawn road is compared to so many pixels beyond its edges, and fades out over so many more."""
FADED = 3.03
"""Beyond so many times `FADE_PX` less than a hundredth is left of it."""
LEAST_ROAD_PX = 40.0
"""With less of a road in the template there is nothing to compare."""
MOST_STRAIGHT = 0.85
"""Where this share of all drawn edges runs one way, they say nothing of the place along it."""


@runtime_checkable
class Operator(Protocol):
    """One way to compare a scan with the reference, warped into the scan's geometry."""

    @property
    def name(self) -> str:
        """What `block.toml` calls it."""
        ...

    def of_scan(self, scan: Image) -> Description:
        """What is compared of a window of the scan."""
        ...

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """What is compared of the ortho, and of the roads drawn into the same window."""
        ...

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Likeness at every place of a patch of the reference within a window of the scan."""
        ...


@dataclass(frozen=True, slots=True)
class NccOperator:
    """Normalised cross-correlation of grey values (thesis 3.3)."""

    name: str = "ncc"

    def of_scan(self, scan: Image) -> Description:
        """Grey values."""
        return (scan,)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """Grey values."""
        return (reference,)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Pearson's correlation."""
        return correlation_scores(around[0], patch[0])


@dataclass(frozen=True, slots=True)
class HighPassOperator:
    """Normalised cross-correlation of grey values less their surroundings."""

    sigma_px: float
    """Size of the surroundings, pixels."""
    name: str = "ncc-high-pass"

    def of_scan(self, scan: Image) -> Description:
        """A band of detail."""
        return (high_passed(scan, self.sigma_px),)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """A band of detail."""
        return (high_passed(reference, self.sigma_px),)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Pearson's correlation."""
        return correlation_scores(around[0], patch[0])


@dataclass(frozen=True, slots=True)
class GradientOperator:
    """Correlation of doubled gradient angles."""

    name: str = "gradient"

    def of_scan(self, scan: Image) -> Description:
        """Field of doubled angles."""
        return (doubled_angle_field(scan),)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """Field of doubled angles."""
        return (doubled_angle_field(reference),)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Re sum(conj(z_T) z_S) / sqrt(sum |z_T|^2 sum |z_S|^2)."""
        return cosine_scores(around[0], patch[0])


@dataclass(frozen=True, slots=True)
class CfogOperator:
    """Channel features of oriented gradients (Ye et al. 2019, doi:10.1109/TGRS.2019.2924684)."""

    name: str = "cfog"

    def of_scan(self, scan: Image) -> Description:
        """Channels in groups of three, and the squared length of each pixel's."""
        return oriented_channels(scan)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """The same of the ortho."""
        return oriented_channels(reference)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Correlation of all channels; as they have equal length, it ranks as squares would."""
        return channel_scores(around, patch)


@dataclass(frozen=True, slots=True)
class RoadOperator:
    """Doubled gradient angles of the drawn roads, compared on and beside them alone."""

    name: str = "roads"

    def of_scan(self, scan: Image) -> Description:
        """Field of doubled angles, and its squared length."""
        field = doubled_angle_field(scan)
        return field, squared_length(field)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """Field of the drawn roads where it is compared, and the weight of each pixel."""
        return drawn_field(roads)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """The weighted likeness; nought where no road is drawn."""
        return road_surface(around, patch, road_content(patch)[0])


@dataclass(frozen=True, slots=True)
class FusedOperator:
    """The mean of `gradient` and `roads`: what the ortho and the map both say."""

    name: str = "fused"

    def of_scan(self, scan: Image) -> Description:
        """Field of doubled angles, and its squared length."""
        field = doubled_angle_field(scan)
        return field, squared_length(field)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """Field of the ortho, then that of the roads with its weights."""
        return doubled_angle_field(reference), *drawn_field(roads)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Mean of both likenesses; where no road is drawn, that of the ortho alone."""
        ortho = cosine_scores(around[0], patch[0])
        energy, along = road_content(patch[1:])
        if not fixed_by_roads(energy, along):
            return ortho
        return (ortho + road_surface(around, patch[1:], energy)) / np.float32(2)


def high_passed(image: Image, sigma_px: float) -> Image:
    """Grey values less their surroundings, with the grain smoothed: a band of detail."""
    fine = cv2.GaussianBlur(image, (0, 0), GRAIN_SIGMA_PX)
    return np.asarray(fine - surroundings(image, sigma_px), dtype=np.float32)


def surroundings(image: Image, sigma_px: float) -> Image:
    """Gaussian mean about every place; where it is wide, found on a reduced image."""
    size = int(sigma_px / REDUCED_SIGMA_PX)
    rows, columns = image.shape
    if size < 2 or min(rows, columns) < 8 * size:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32)
    shape = (-(-columns // size), -(-rows // size))
    # Less one of its values, so that rounding leaves a flat image flat.
    level = image[0, 0]
    small = cv2.resize(image - level, shape, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / size)
    whole = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole + level, dtype=np.float32)


def doubled_angle_field(image: Image) -> Field:
    """Gradient direction doubled, weighted from 0 (flat) to 1: z = g^2 / (|g|^2 + tau^2).

    Returns:
        Real and imaginary part of z; tau is the 60th percentile of |g|.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), GRADIENT_SIGMA_PX)
    right = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    across, along = right * right, down * down
    squared = across + along
    tau_squared = float(np.percentile(squared[::3, ::3], 60)) + FLAT
    squared += np.float32(tau_squared)
    across -= along
    across /= squared
    right *= down
    right *= np.float32(2)
    right /= squared
    return np.asarray(cv2.merge([across, right]), dtype=np.float32)


def oriented_channels(image: Image) -> Description:
    """Nine absolute directional derivatives, smoothed in place and direction, of equal length.

    Returns:
        The channels in groups of three, less their mean: channels are never negative, so that they
        tell directions rather than contrast; then the squared length of each pixel's.
    """
    channels = smoothed_derivatives(image)
    mean, energy = np.zeros_like(image), np.zeros_like(image)
    for channel in channels:
        cv2.accumulate(channel, mean)
        cv2.accumulateSquare(channel, energy)
    mean /= np.float32(CHANNELS)
    length = np.sqrt(energy)
    length += np.float32(1e-2) * length.mean() + np.float32(1e-6)
    energy[:] = 0
    for channel in channels:
        channel -= mean
        channel /= length
        cv2.accumulateSquare(channel, energy)
    groups = [cv2.merge(channels[i : i + 3]) for i in range(0, CHANNELS, 3)]
    return *(np.asarray(group, np.float32) for group in groups), energy


def smoothed_derivatives(image: Image) -> list[Image]:
    """Nine absolute directional derivatives, smoothed in place and over neighbouring directions."""
    smooth = cv2.GaussianBlur(image, (0, 0), CFOG_SIGMA_PX)
    right = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    sharp: list[np.ndarray] = []
    for angle in np.arange(CHANNELS) * (np.pi / CHANNELS):
        along = cv2.addWeighted(right, np.cos(angle), down, np.sin(angle), 0)
        sharp.append(cv2.GaussianBlur(np.abs(along), (0, 0), CFOG_SIGMA_PX))
    # Directions go round: the last is a neighbour of the first.
    around = [sharp[-1], *sharp, sharp[0]]
    return [
        np.asarray(cv2.scaleAdd(around[i + 1], 2.0, around[i] + around[i + 2]), np.float32)
        for i in range(CHANNELS)
    ]


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


def road_surface(around: Description, patch: Description, energy: float) -> ScoreMap:
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


OPERATORS = (
    "ncc", "ncc-high-pass", "gradient", "cfog", "roads", "fused", "sift", "orb", "akaze",
)  # fmt: skip
"""Every operator that needs nothing but its name; `learned` needs a network."""
GREY = ("ncc", "ncc-high-pass")
"""Operators that compare grey values: crowns and shadows move all of them together."""


def operator_named(name: str, template_half_px: int, network: Path | None = None) -> Operator:
    """The operator of a name, for a size of template.

    Args:
        name: What `block.toml` calls it.
        template_half_px: Half the template, pixels.
        network: Weights of `learned`; the other operators need none.

    Raises:
        KeyError: There is no such operator.
    """
    if name == LEARNED and network is not None:
        return LearnedOperator(network)
    made: dict[str, Operator] = {
        "ncc": NccOperator(),
        "ncc-high-pass": HighPassOperator(template_half_px / 3),
        "gradient": GradientOperator(),
        "cfog": CfogOperator(),
        "roads": RoadOperator(),
        "fused": FusedOperator(),
        "sift": SiftOperator(),
        "orb": OrbOperator(template_half_px),
        "akaze": AkazeOperator(template_half_px),
    }
    return made[name]
