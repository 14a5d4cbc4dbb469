"""SIFT, ORB and AKAZE as operators: described at every place, compared by distance.

This is variant VD of the thesis's Table 2: no detection; a junction's patch is described at its
middle, and every place of the search window likewise. They are here to be measured beside the
others: blind to what changed. AKAZE, place by place in OpenCV, is slow as well.
"""

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from jaxtyping import UInt8

from core.matching.dense_orb import orb_surface, smoothed_for_orb
from core.matching.dense_sift import sift_surface, smoothed_gradients
from core.matching.peaks import ScoreMap
from core.matching.template_search import Description, Image, Template

Gray8 = UInt8[np.ndarray, "rows columns"]
"""What OpenCV describes."""
AKAZE_SIDE_PX, AKAZE_SIZE = 40, 2.67
"""Template and window are brought to a scale at which AKAZE spans so many pixels, its pattern
reaching ten steps of 0.75 sizes to either side."""
FAR = 1e6


@dataclass(frozen=True, slots=True)
class SiftOperator:
    """Distance of SIFT descriptors, upright, over the whole template."""

    name: str = "sift"

    def of_scan(self, scan: Image) -> Description:
        """Gradients of smoothed grey values."""
        return (smoothed_gradients(scan),)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """The same of the ortho."""
        return (smoothed_gradients(reference),)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Less the distance of descriptors of unit length, so that the highest is the nearest."""
        return sift_surface(around[0], patch[0])


@dataclass(frozen=True, slots=True)
class OrbOperator:
    """Hamming distance of ORB descriptors, upright, at the scale that fills the template."""

    template_half_px: int
    """Half the template, pixels."""
    name: str = "orb"

    def of_scan(self, scan: Image) -> Description:
        """Grey values, smoothed to the scale of the pattern."""
        return (smoothed_for_orb(scan, self.template_half_px),)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """The same of the ortho."""
        return (smoothed_for_orb(reference, self.template_half_px),)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Less the share of differing bits."""
        return orb_surface(around[0], patch[0])


@dataclass(frozen=True, slots=True)
class AkazeOperator:
    """Hamming distance of AKAZE descriptors, upright, over the whole template."""

    template_half_px: int
    """Half the template, pixels."""
    name: str = "akaze"

    def of_scan(self, scan: Image) -> Description:
        """Grey values."""
        return (scan,)

    def of_reference(self, reference: Image, roads: Image) -> Description:
        """Grey values."""
        return (reference,)

    def surface(self, around: Description, patch: Description) -> ScoreMap:
        """Less the share of differing bits; OpenCV 5 keeps AKAZE elsewhere: see `has_akaze`."""
        library = cast("Any", cv2)
        akaze = library.AKAZE_create(descriptor_type=library.AKAZE_DESCRIPTOR_MLDB_UPRIGHT)
        scale = max((2 * self.template_half_px + 1) / AKAZE_SIDE_PX, 1.0)
        found = described_surface(akaze, around[0], patch[0], AKAZE_SIZE, scale)
        return found / np.float32(486.0)


def has_akaze() -> bool:
    """Whether this OpenCV has AKAZE: version 5 has dropped it."""
    return hasattr(cv2, "AKAZE_create")


def described_surface(
    extractor: Any, around: Image, patch: Template, size: float, scale: float
) -> ScoreMap:
    """Less the distance between the patch's middle and every place of the window."""
    rows = around.shape[0] - patch.shape[0] + 1
    columns = around.shape[1] - patch.shape[1] + 1
    inner = patch.shape[0] // 2
    places = [
        (float(inner + column), float(inner + row))
        for row in range(rows)
        for column in range(columns)
    ]
    wanted = described(extractor, patch, [(float(inner), float(inner))], size, scale)
    offered = described(extractor, around, places, size, scale)
    surface = np.full(rows * columns, FAR, np.float32)
    if wanted and offered:
        template = next(iter(wanted.values()))
        order = list(offered)
        values = np.stack([offered[index] for index in order])
        differing = np.bitwise_xor(values.astype(np.uint8), template[None])
        surface[order] = np.unpackbits(np.asarray(differing, np.uint8), axis=1).sum(axis=1)
    told = surface < FAR
    surface[~told] = surface[told].max() if told.any() else 0.0
    return -surface.reshape(rows, columns)


def described(
    extractor: Any, image: Image, places: list[tuple[float, float]], size: float, scale: float
) -> dict[int, np.ndarray]:
    """Descriptors by index of the place; places that could not be described are missing."""
    gray = eight_bit(image)
    if scale > 1.0:
        # Averaging before a fixed pattern of points is laid over the whole template.
        smooth = cv2.GaussianBlur(gray, (0, 0), 0.5 * scale)
        shape = (round(gray.shape[1] / scale), round(gray.shape[0] / scale))
        gray = cv2.resize(smooth, shape, interpolation=cv2.INTER_AREA)
    keypoints = [
        cv2.KeyPoint(x / scale, y / scale, size, 0.0, float(index), 0, 0)
        for index, (x, y) in enumerate(places)
    ]
    kept, values = extractor.compute(gray, keypoints)
    if values is None:
        return {}
    return {round(point.response): value for point, value in zip(kept, values, strict=True)}


def eight_bit(image: Image) -> Gray8:
    """Grey values stretched over eight bits."""
    low, high = (float(v) for v in np.percentile(image[::2, ::2], (0.5, 99.5)))
    stretched = (image - low) * (255.0 / max(high - low, 1e-3))
    return np.clip(np.rint(stretched), 0, 255).astype(np.uint8)
