"""SIFT and ORB of OpenCV, and SURF of mahotas where it is installed: detected and described points.

OpenCV is built without SURF, which was patented. That of mahotas turns every point to a direction
of its own and cannot be told one.
"""

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Protocol, cast, runtime_checkable

import cv2
import numpy as np
from jaxtyping import UInt8

from core.errors import ProjectError
from core.frames import HALF_PIXEL
from core.literature.common_grid import Places
from core.matching.peaks import Image

Grey8 = UInt8[np.ndarray, "rows columns"]
# source: Lowe 2004, section 6.1, as OpenCV has it: four bins a side, each three scales wide, a
# scale being half a keypoint's size.
SIFT_SIDE = 6.0
"""A SIFT descriptor spans so many sizes of its keypoint."""
# source: Bay et al. 2008, section 4.2: a square of twenty scales.
SURF_SCALES = 20.0
"""A SURF descriptor spans so many scales; here the size of its keypoint is what it spans."""
SIDES = {"sift": SIFT_SIDE, "orb": 1.0, "surf": 1.0}
"""Side of a descriptor in sizes of its keypoint; ORB's pattern has one size."""


@runtime_checkable
class Detector(Protocol):
    """What detects and describes points of an image, as OpenCV's operators do."""

    def detect(self, image: Grey8, mask: Any) -> Sequence[Any]:
        """Key points where the mask is not nought; everywhere without one."""
        ...

    def compute(self, image: Grey8, keypoints: Sequence[Any]) -> tuple[Sequence[Any], Any]:
        """Those of the points that can be described, and a row for each."""
        ...


def is_installed(name: str) -> bool:
    """Whether a detector can be had."""
    return name != "surf" or find_spec("mahotas") is not None


def detector_named(name: str) -> Detector:
    """The detector of a name: `sift`, `orb` or `surf`.

    Raises:
        ProjectError: There is no such detector.
    """
    if name not in SIDES:
        raise ProjectError(name, "is no detector.", "Take sift, orb or surf.")
    if name == "surf":
        return SurfDetector()
    library = cast("Any", cv2)
    # design: OpenCV's ORB keeps 500 points unless told otherwise; no limit that would count.
    return library.SIFT_create() if name == "sift" else library.ORB_create(nfeatures=100_000)


class SurfDetector:
    """SURF of mahotas in the form of OpenCV's operators; its points span what their size says."""

    def __init__(self) -> None:
        self._surf: Any = import_module("mahotas.features.surf")

    def detect(self, image: Grey8, mask: Any) -> Sequence[Any]:
        """Blobs by the determinant of the Hessian."""
        found = self._surf.interest_points(image)
        points = [
            cv2.KeyPoint(x, y, SURF_SCALES * scale, 0.0, score)
            for y, x, scale, score, _ in found.tolist()
        ]
        if mask is None:
            return points
        return [one for one in points if mask[round(one.pt[1]), round(one.pt[0])]]

    def compute(self, image: Grey8, keypoints: Sequence[Any]) -> tuple[Sequence[Any], Any]:
        """64 sums of Haar wavelets of each; those too near to the rim are left out."""
        # Row, column, scale, score and sign, as `interest_points` gives them.
        asked = [[one.pt[1], one.pt[0], one.size / SURF_SCALES, 1.0, 1.0] for one in keypoints]
        told: Any = self._surf.descriptors(image, np.array(asked)) if asked else ()
        if not len(told):
            return (), None
        kept = [
            cv2.KeyPoint(x, y, SURF_SCALES * scale, float(np.degrees(angle)))
            for y, x, scale, _, _, angle in told[:, :6].tolist()
        ]
        return kept, told[:, 6:]


def describe_places(
    made: Detector, image: Grey8, places: Places, size: float
) -> tuple[Places, np.ndarray]:
    """Upright descriptors of one size, and the places that have one."""
    points = [cv2.KeyPoint(x, y, size, 0.0) for x, y in (places - HALF_PIXEL).tolist()]
    kept, descriptors = made.compute(image, points)
    return places_of(kept), np.zeros((0, 1)) if descriptors is None else descriptors


def places_of(points: Sequence[Any]) -> Places:
    """Grid points of key points, which OpenCV counts from the middle of the first pixel."""
    return np.array([point.pt for point in points], np.float64).reshape(-1, 2) + HALF_PIXEL


def describe_window(
    made: Detector, image: Grey8, point: Any, middle: Places, half: int
) -> tuple[Places, np.ndarray]:
    """Every place of a window described in the size and direction of a point.

    Args:
        made: The detector.
        image: Where it is searched.
        point: A key point.
        middle: Of the window, (1, 2), as OpenCV counts.
        half: How far the window reaches, pixels.
    """
    steps = np.arange(-half, half + 1, dtype=np.float64)
    offsets = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2)
    # Beyond the window the descriptors of its rim reach, and the blur of their octaves.
    room = half + round(SIFT_SIDE * point.size)
    low = np.maximum(np.floor(middle[0]).astype(int) - room, 0)
    part = image[low[1] : low[1] + 2 * room + 2, low[0] : low[0] + 2 * room + 2]
    every = [
        cv2.KeyPoint(across, down, point.size, point.angle, 0, point.octave)
        for across, down in (middle - low + offsets).tolist()
    ]
    kept, offered = made.compute(np.ascontiguousarray(part), every)
    if offered is None:
        return np.zeros((0, 2)), np.zeros((0, 1))
    return places_of(kept) + low, offered


def distances_to(own: np.ndarray, offered: np.ndarray) -> np.ndarray:
    """Euclidean distances of SIFT and SURF, Hamming distances of ORB."""
    if own.dtype == np.uint8:
        return np.unpackbits(np.bitwise_xor(own, offered).view(np.uint8), axis=1).sum(axis=1)
    return np.linalg.norm(offered - own, axis=1)


def eight_bits(image: Image) -> Grey8:
    """Grey values as these operators take them."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
