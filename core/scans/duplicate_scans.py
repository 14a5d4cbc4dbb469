"""A small picture of each scan in the axes of its frame: who looks like whom, in eight ways."""

from collections.abc import Mapping
from typing import cast

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from core.doubts import Doubt
from core.matching.template_search import correlation_scores
from core.raster.scan_file import ScanFile, read_overview
from core.scans.film_area import FilmArea
from core.scans.layouts import UPRIGHT, WAYS, Way

Look = UInt8[np.ndarray, "side side"]
Heart = Float32[np.ndarray, "heart heart"]
SIDE = 160
"""Cells along a side of the small picture."""
REACH = 1.22
"""Width of what it shows, in frames."""
OVERVIEW_PX = 800
SAME = 0.80
"""Correlation of the pictures' hearts from which two scans show one photo."""
SHIFT_CELLS = 4
"""How far the frames of two scans of one photo may have been found apart, cells."""


def look_of(scan: ScanFile, area: FilmArea) -> Look:
    """The frame and a margin about it as it lies in the scan, grays evened, 8 bit."""
    reduction = max(1, -(-max(scan.size_px) // OVERVIEW_PX))
    gray = np.nan_to_num(read_overview(scan, reduction))
    middle = area.corners.mean(axis=0)
    source = ((area.corners - middle) * REACH + middle) / reduction - 0.5
    target = np.array([[0, SIDE], [SIDE, SIDE], [SIDE, 0], [0, 0]]) - 0.5
    matrix = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    small = cv2.warpPerspective(gray, matrix, (SIDE, SIDE), flags=cv2.INTER_AREA)
    top = max(float(np.percentile(small, 99.5)), 1.0)
    return np.clip(small * (255 / top), 0, 255).astype(np.uint8)


def laid(look: np.ndarray, way: Way) -> np.ndarray:
    """The look of an upright film as it would lie in a scan in another way."""
    quarter, back = way
    return np.rot90(look[:, ::-1] if back else look, quarter)


def same_photo(looks: Mapping[str, Look]) -> tuple[Doubt, ...]:
    """A doubt for every two scans that show one photo, however they lie."""
    hearts = {name: _heart(look) for name, look in looks.items()}
    names = sorted(hearts)
    doubts: list[Doubt] = []
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            best = max(_alike(hearts[first], laid(hearts[second], way)) for way in WAYS)
            if best > SAME:
                doubts.append(_same(first, second, best))
    return tuple(doubts)


def _heart(look: Look) -> Heart:
    """The inner four fifths of the frame, brightness of large parts taken out."""
    inset = round(SIDE * (1 - 0.8 / REACH) / 2)
    inner = look[inset:-inset, inset:-inset].astype(np.float32)
    calm = cast(np.ndarray, cv2.GaussianBlur(inner, (0, 0), 12))
    high = cast(np.ndarray, cv2.GaussianBlur(inner, (0, 0), 0.8)) - calm
    return (high - high.mean()) / (high.std() + 0.5)


def _alike(first: np.ndarray, second: np.ndarray) -> float:
    """Greatest correlation within a few cells of shift."""
    inner = np.ascontiguousarray(second[SHIFT_CELLS:-SHIFT_CELLS, SHIFT_CELLS:-SHIFT_CELLS])
    return float(correlation_scores(np.ascontiguousarray(first), inner).max())


def _same(first: str, second: str, likeness: float) -> Doubt:
    """The doubt about two scans of one photo."""
    return Doubt(
        "same-photo",
        second,
        f"{first} and {second} show the same photo: as two photos of a block they would seem to "
        "confirm each other. Exclude one in [[scans.override]] (exclude = true).",
        evidence={"other": first, "correlation": likeness},
    )


def turned_words(way: Way) -> str:
    """A way to lie in words."""
    if way == UPRIGHT:
        return "upright"
    turns = ("", "turned by 90 degrees counter-clockwise", "turned by 180 degrees",
             "turned by 90 degrees clockwise")  # fmt: skip
    return " and ".join(part for part in ("mirrored" if way[1] else "", turns[way[0]]) if part)
