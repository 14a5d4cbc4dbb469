"""The operator `learned`: features of a network whose weights the user gives, correlated.

The network is an ONNX file that takes one grey channel to some feature channels of the same size;
it is never fetched. OpenCV runs it, on scan and ortho alike.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32

from core.errors import ProjectError
from core.formats.records import plain_bytes
from core.matching.peaks import Description, Image, ScoreMap, channel_scores
from core.said import say

Features = Float32[np.ndarray, "channels rows columns"]
LEARNED = "learned"
# design: memory: a tile of 1,600 pixels takes 330 MB at 32 channels.
MOST_CHANNELS = 32
"""More would not fit: a tile of the scan and of the ortho are held for each worker."""
# design: memory: bands keep what a network holds in between to some hundred megabytes.
BAND_PX = 256
"""So many rows at a time, so that what the network holds in between stays small."""
# design: more than the receptive field of the usual networks for dense features at full size.
MARGIN_PX = 64
"""What lies further away has no part in a feature; beyond the rim the picture is mirrored."""
# design: networks that halve their picture five times at most.
STEP_PX = 32
"""Sides of what the network is given are multiples of this: some halve their picture often."""
# design: OpenCV correlates interleaved pictures of a few channels in one go.
GROUP = 3
"""Channels that are correlated in one go."""
# design: keeps the division finite.
SMALL = np.float32(1e-6)
FORM = say(
    "It must take one grey channel (1, 1, rows, columns), from 0 to 1, to at most {most} "
    "channels of the same rows and columns.",
    most=MOST_CHANNELS,
)


@dataclass(frozen=True, slots=True)
class LearnedOperator:
    """Correlation of learned features of unit length."""

    network: Path
    """The weights, an ONNX file."""
    name: str = LEARNED

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Channels in groups of three, and the squared length of each pixel's."""
        return describe_image(self.network, scan)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """The same of the ortho."""
        return describe_image(self.network, reference)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Correlation of all channels."""
        return channel_scores(around, patch)

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """All channels."""
        return shown[:-1], patch[:-1]


def check_network(file: Path) -> None:
    """Make sure that a network can be read and gives features.

    Raises:
        ProjectError: It cannot.
    """
    features_of(read_network(file), np.zeros((STEP_PX, 2 * STEP_PX), np.float32), file)


def describe_image(file: Path, image: Image) -> Description:
    """Features of an image in groups of three channels, and the squared length of each pixel's.

    Raises:
        ProjectError: The network cannot be read, or gives something else.
    """
    network = read_network(file)
    rows, columns = image.shape
    # design: one pixel in a hundred may be brighter or darker than film shows ground: dust and
    # scratches must not compress the rest.
    low, high = (float(v) for v in np.percentile(image[::2, ::2], (0.5, 99.5)))
    # design: keeps the division finite on flat ground.
    grey = np.clip((image - np.float32(low)) / np.float32(max(high - low, 1e-3)), 0, 1)
    more = (-(rows + 2 * MARGIN_PX) % STEP_PX, -(columns + 2 * MARGIN_PX) % STEP_PX)
    padded = cv2.copyMakeBorder(
        grey.astype(np.float32), MARGIN_PX, MARGIN_PX + more[0], MARGIN_PX, MARGIN_PX + more[1],
        cv2.BORDER_REFLECT_101,
    )  # fmt: skip
    groups: list[np.ndarray] = []
    energy = np.empty((rows, columns), np.float32)
    for top in range(0, rows, BAND_PX):
        band = padded[top : top + BAND_PX + 2 * MARGIN_PX]
        found = features_of(network, np.ascontiguousarray(band), file)
        own = np.s_[top : min(top + BAND_PX, rows)]
        kept = found[:, MARGIN_PX:, MARGIN_PX : MARGIN_PX + columns][:, : len(energy[own])]
        if not groups:
            # Filled band by band: all features are never held twice.
            groups = empty_groups(len(kept), rows, columns)
        unit = kept / (np.sqrt(np.einsum("kij,kij->ij", kept, kept)) + SMALL)
        energy[own] = np.einsum("kij,kij->ij", unit, unit)
        for first, group in zip(range(0, len(unit), GROUP), groups, strict=True):
            group[own] = unit[first : first + GROUP].transpose(1, 2, 0)
    return *groups, energy


def empty_groups(channels: int, rows: int, columns: int) -> list[np.ndarray]:
    """Room for all channels, three together."""
    sizes = [min(GROUP, channels - first) for first in range(0, channels, GROUP)]
    return [np.empty((rows, columns, size), np.float32) for size in sizes]


def features_of(network: Any, grey: Image, file: Path) -> Features:
    """What a network makes of grey values.

    Raises:
        ProjectError: It fails, or gives something else than features of the same size.
    """
    network.setInput(grey[None, None])
    try:
        found = np.asarray(network.forward(), np.float32)
    except (cv2.error, ValueError) as error:
        raise ProjectError(
            file,
            say("The network does not run ({error}).", error=_told(error)),
            FORM,
        ) from error
    sides = found.shape[2:]
    if found.ndim != 4 or sides != grey.shape or not 1 <= found.shape[1] <= MOST_CHANNELS:
        given, got = (1, 1, *grey.shape), found.shape
        raise ProjectError(
            file,
            say("The network makes {got} of {given}.", got=got, given=given),
            FORM,
        )
    if not np.isfinite(found).all():
        raise ProjectError(file, "The network gives features that are no numbers.", FORM)
    return found[0]


def read_network(file: Path) -> Any:
    """The network of an ONNX file.

    Raises:
        ProjectError: There is no such file, or it is no network that OpenCV can run.
    """
    try:
        content = np.frombuffer(plain_bytes(file), np.uint8)
    except OSError as error:
        remedy = "Name an ONNX file that is there and may be read, in [control] learned."
        raise ProjectError(
            file,
            say("The network cannot be read ({strerror}).", strerror=error.strerror),
            remedy,
        ) from error
    try:
        return cv2.dnn.readNetFromONNX(content)
    except cv2.error as error:
        cause = say("This is no network that OpenCV can run ({error}).", error=_told(error))
        raise ProjectError(file, cause, "Export the network as ONNX again.") from error


def _told(error: Exception) -> str:
    """The last part of what OpenCV says."""
    return str(getattr(error, "err", "") or error).strip().splitlines()[0]
