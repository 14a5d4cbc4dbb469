"""All operators by name; those that are here only for comparison are defined in this room.

All implement the interface of `core/matching/operators.py`, and may be named in `block.toml`.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from core.literature.dense_descriptors import AkazeOperator, OrbOperator, SiftOperator
from core.matching.learned import LEARNED, LearnedOperator
from core.matching.operators import (
    FusedOperator,
    HighPassOperator,
    Operator,
    doubled_angle_field,
    drawn_field,
    road_content,
    road_scores,
    smoothed_gradient,
    squared_length,
    without_means,
)
from core.matching.peaks import (
    Description,
    Image,
    ScoreMap,
    channel_scores,
    correlation_scores,
    cosine_scores,
)

# source: CFOG of Ye et al. 2019: nine orientations, smoothed by 0.8 px.
CHANNELS = 9
"""Orientations of CFOG."""
# source: the same.
CFOG_SIGMA_PX = 0.8


@dataclass(frozen=True, slots=True)
class NccOperator:
    """Normalised cross-correlation of grey values (thesis 3.3)."""

    name: str = "ncc"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Grey values."""
        return (scan,)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """Grey values."""
        return (reference,)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Pearson's correlation."""
        return correlation_scores(around[0], patch[0])

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """Grey values less their means."""
        return without_means(shown, patch)


@dataclass(frozen=True, slots=True)
class GradientOperator:
    """Correlation of doubled gradient angles."""

    name: str = "gradient"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Field of doubled angles."""
        return (doubled_angle_field(scan),)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """Field of doubled angles."""
        return (doubled_angle_field(reference),)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Re sum(conj(z_T) z_S) / sqrt(sum |z_T|^2 sum |z_S|^2)."""
        return cosine_scores(around[0], patch[0])

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """Both fields."""
        return shown[:1], patch[:1]


@dataclass(frozen=True, slots=True)
class RoadOperator:
    """Doubled gradient angles of the drawn roads, compared on and beside them alone."""

    name: str = "roads"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Field of doubled angles, and its squared length."""
        field = doubled_angle_field(scan)
        return field, squared_length(field)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """Field of the drawn roads where it is compared, and the weight of each pixel."""
        return drawn_field(roads)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """The weighted likeness; nought where no road is drawn."""
        return road_scores(around, patch, road_content(patch)[0])

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """The scan's field, and that of the drawn roads times its weight."""
        return shown[:1], patch[:1]


@dataclass(frozen=True, slots=True)
class CfogOperator:
    """Channel features of oriented gradients (Ye et al. 2019, doi:10.1109/TGRS.2019.2924684)."""

    name: str = "cfog"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Channels in groups of three, and the squared length of each pixel's."""
        return oriented_channels(scan)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """The same of the ortho."""
        return oriented_channels(reference)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Correlation of all channels; as they have equal length, it ranks as squares would."""
        return channel_scores(around, patch)

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """All channels."""
        return shown[:-1], patch[:-1]


OPERATORS: dict[str, Operator] = {
    operator.name: operator
    for operator in (
        NccOperator(), HighPassOperator(), GradientOperator(), CfogOperator(), RoadOperator(),
        FusedOperator(), SiftOperator(), OrbOperator(), AkazeOperator(),
    )
}  # fmt: skip
"""Every operator that needs nothing but its name; `learned` needs a network."""


def operator_named(name: str, network: Path | None = None) -> Operator:
    """The operator of a name.

    Args:
        name: What `block.toml` calls it.
        network: Weights of `learned`; the other operators need none.

    Raises:
        KeyError: There is no such operator.
    """
    return LearnedOperator(network) if name == LEARNED and network else OPERATORS[name]


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
    # design: where edges are a hundredth of the usual length or less, directions are noise and
    # should not count as much as those of edges.
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
    right, down = smoothed_gradient(image, CFOG_SIGMA_PX)
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
