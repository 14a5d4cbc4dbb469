"""The mark insets of `camera-families`, without what their maker drew into them.

Its grey dot lies in the middle of every inset, often upon the mark: a disc about it is filled from
its rim (`cv2.inpaint`, Telea), so that no search can see it. The letters P1 to P8 stay outside the
disc that is taken of an inset.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from core.geometry.camera import Camera
from core.scans.film_area import SIDES, FilmArea
from core.scans.judging import FiducialMeasurement
from tests.benchmarks.marks_by_eye import SeenMark

PIXEL_MM = 0.025
"""Assumed pixel of the insets: the archive scanned at 25 um."""
DOT_MIDDLE_PX, DOT_RADIUS_PX, RIM_PX = 270.4, 8.5, 4
PLACES = {"P3": "UL", "P2": "UR", "P4": "LR", "P1": "LL", "P7": "T", "P6": "R", "P8": "B",
          "P5": "L"}  # fmt: skip
"""Where the insets stand, by the names of marks that nobody certified."""
GROUPS = {"corners": ("UL", "UR", "LR", "LL"), "sides": ("T", "R", "B", "L")}
"""Places in clockwise order: each is a quarter turn from the one before."""
HALF_PX = 780.0
"""Half the side of the frame that the composed picture is taken for."""
OWN = {
    "diagonal cross": ("saltire", "gapped-saltire"),
    "upright cross": ("cross", "gapped-cross", "dotted-cross"),
    "ring with diagonal": ("ringed-saltire",),
    "ring with upright": ("ringed-cross",),
    "dark diagonal cross": ("saltire", "gapped-saltire", "dot"),
    "fine diagonal": ("saltire", "gapped-saltire"),
    "check": ("quadrants",),
    "tooth": ("half-wedge", "other-half-wedge"),
    "inner corner": ("half-wedge", "other-half-wedge"),
    "triangular tooth": ("wedge", "tip"),
    "dark point": ("wedge", "tip"),
    "pointed corner": ("wedge", "tip", "corner", "outer-corner"),
    "wing": (),
}
"""Drawn kinds of the library that show a mark, by how its description begins."""


@dataclass(frozen=True)
class Inset:
    """One inset and where an eye put its mark."""

    place: str
    mark: SeenMark
    gray: np.ndarray
    middle: tuple[float, float]
    """Column and row of the mark in it."""


def without_dots(gray: np.ndarray, marks: tuple[SeenMark, ...]) -> np.ndarray:
    """A composed picture without the dots of its insets."""
    inside = np.zeros_like(gray)
    for mark in marks:
        assert mark.box is not None
        at = tuple(round((low + DOT_MIDDLE_PX) * 16) - 8 for low in mark.box[:2])
        cv2.circle(inside, at, round(DOT_RADIUS_PX * 16), 255, -1, shift=4)
    return cv2.inpaint(gray, inside, RIM_PX, cv2.INPAINT_TELEA)


def read_picture(folder: Path, name: str, marks: tuple[SeenMark, ...]) -> np.ndarray:
    """The composed picture of a family without dots."""
    gray = cv2.imread(str(folder / f"{name}.jpg"), cv2.IMREAD_GRAYSCALE)
    assert gray is not None, name
    return without_dots(gray, marks)


def insets_of(picture: np.ndarray, marks: tuple[SeenMark, ...]) -> dict[str, Inset]:
    """The insets by the place of their mark."""
    found: dict[str, Inset] = {}
    for mark in marks:
        assert mark.box is not None
        left, top, right, bottom = mark.box
        middle = mark.column - left, mark.row - top
        part = picture[top + 2 : bottom - 2, left + 2 : right - 2]
        found[PLACES[mark.name]] = Inset(
            PLACES[mark.name], mark, part, (middle[0] - 2, middle[1] - 2)
        )
    return found


def reach_px(inset: Inset) -> float:
    """How far about its mark an inset shows neither letters nor its own rim."""
    rows, columns = inset.gray.shape
    column, row = inset.middle
    rim = min(column, row, columns - column, rows - row) - 2
    # The letters stand 165 px and more above the middle of the inset, 45 px to either side.
    letters = float(np.hypot(max(abs(column - 268) - 45, 0.0), row - 105))
    return float(min(rim, letters, 150.0))


def own_shapes(marks: tuple[SeenMark, ...]) -> set[str]:
    """Drawn kinds of the library that show marks of a family."""
    kinds = {mark.kind for mark in marks}
    starts = {kind: [s for s in OWN if kind.startswith(s)] for kind in kinds}
    return {shape for kind in kinds for start in starts[kind] for shape in OWN[start]}


def composed_camera() -> Camera:
    """The frame that the composed picture is taken for; its marks are unknown."""
    side = 2 * HALF_PX * PIXEL_MM
    return Camera("composed", 152.0, (side, side))


def composed_area(picture: np.ndarray) -> FilmArea:
    """Its border."""
    middle = np.array([960.5, 953.5])
    turns = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]], dtype=np.float64)
    return FilmArea(middle + turns * HALF_PX, SIDES, np.ones(4))


def common_offset_off(offsets: dict[str, np.ndarray], group: str) -> dict[str, float]:
    """How far marks lie from where one offset, alike at all of them, puts them.

    Which point of a figure nobody listed is the mark is free; it must be the same everywhere. The
    offset may go along turned, mirrored or as it is: that of the three which leaves least.
    """
    places = GROUPS[group]
    named = [name for name in places if name in offsets]
    if len(named) < 3:
        return {}
    off = np.array([complex(*offsets[name]) for name in named])
    which = np.array([places.index(name) for name in named])
    quarter = 1j**which
    turned = off / quarter
    # Seen along the outward direction, a mirror changes the sign of what lies across it.
    axis = complex(0, -1) if group == "sides" else complex(-1, -1) / np.sqrt(2)
    flipped = np.where(which % 2 == 1, _mirrored(turned, axis), turned)
    left = [np.abs(one - _median(one)) for one in (turned, flipped, off)]
    best = min(left, key=lambda one: float(np.median(one)))
    return dict(zip(named, best.tolist(), strict=True))


def _mirrored(values: np.ndarray, axis: complex) -> np.ndarray:
    return np.conj(values / axis) * axis


def _median(values: np.ndarray) -> complex:
    return complex(float(np.median(values.real)), float(np.median(values.imag)))


def offset_of(mark: FiducialMeasurement, place: tuple[float, float]) -> np.ndarray:
    """A measured mark less the truth, pixels (right, down)."""
    return np.array([mark.column - place[0], mark.row - place[1]])
