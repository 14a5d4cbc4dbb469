"""The mark insets of `camera-families`, without what their maker drew into them.

Its grey dot lies in the middle of every inset, often upon the mark: a disc about it is filled from
its rim (`cv2.inpaint`, Telea), so that no search can see it. The letters P1 to P8 stay outside the
disc that is taken of an inset.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np

from core.scans.judging import FiducialMeasurement
from tests.benchmarks.marks_by_eye import SeenMark
from tests.core.scans.film_maker import Film, film_from_pixel

PIXEL_MM = 0.025
"""Assumed pixel of the insets: the archive scanned at 25 um."""
DOT_MIDDLE_PX, DOT_RADIUS_PX, RIM_PX = 270.4, 8.5, 4
PLACES = {"P3": "UL", "P2": "UR", "P4": "LR", "P1": "LL", "P7": "T", "P6": "R", "P8": "B",
          "P5": "L"}  # fmt: skip
"""Where the insets stand, by the names of marks that nobody certified."""
GROUPS = {"corners": ("UL", "UR", "LR", "LL"), "sides": ("T", "R", "B", "L")}
"""Places in clockwise order: each is a quarter turn from the one before."""
CORNER_MM, FEATHER_PX = 26.0, 15.0
BESIDE_MM = 8.0
"""Film beside the picture in a made scan: no mark that stands there is cut off by its edge."""
AXES = {
    "UL": (-1, 1), "UR": (1, 1), "LR": (1, -1), "LL": (-1, -1),
    "T": (0, 1), "R": (1, 0), "B": (0, -1), "L": (-1, 0),
}  # fmt: skip
EDGE_PX = 120
"""How far from a mark of a side, along and across the border, the border is looked for."""
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


def border_mm(insets: dict[str, Inset]) -> float | None:
    """How far outward of marks of sides the picture's border runs; None where none is seen."""
    found: list[float] = []
    for place, inset in insets.items():
        reach = int(min(EDGE_PX, reach_px(inset)))
        x, y = AXES[place]
        column, row = (round(value) for value in inset.middle)
        part = inset.gray[row - reach : row + reach + 1, column - reach : column + reach + 1]
        lies = part if y else part.T
        inward_first = lies[::-1] if (y > 0 or x < 0) else lies
        outer = np.concatenate([inward_first[:, : reach // 3], inward_first[:, -reach // 3 :]], 1)
        profile = np.median(outer.astype(np.float64), axis=1)
        level = (profile[:20].mean() + profile[-20:].mean()) / 2
        if profile[:20].mean() - profile[-20:].mean() > 30:
            found.append((int(np.argmax(profile < level)) - reach) * PIXEL_MM)
    return float(np.median(found)) if len(found) >= 2 else None


def paste(
    gray: np.ndarray, film: Film, inset: Inset, place: str, middle_mm: np.ndarray, gain: float
) -> tuple[float, float]:
    """Lay a disc of an inset upon a scan; returns where its mark is, pixels."""
    matrix = film_from_pixel(film, gray.shape[0])
    at = np.linalg.solve(matrix[:, :2], middle_mm - matrix[:, 2])
    reach = reach_px(inset)
    half = int(reach * PIXEL_MM / film.pixel_mm) + 3
    left, top = int(at[0]) - half, int(at[1]) - half
    column, row = np.meshgrid(*(np.arange(2 * half + 1) + 0.5 for _ in range(2)))
    pixels = np.stack([column + left - at[0], row + top - at[1]], axis=-1)
    shown = pixels @ matrix[:, :2].T / PIXEL_MM * np.array([1.0, -1.0])
    own = GROUPS["corners"] if place in GROUPS["corners"] else GROUPS["sides"]
    back = (-1j) ** (own.index(place) - own.index(inset.place))
    turned = (shown[..., 0] + 1j * shown[..., 1]) * back
    ratio = film.pixel_mm / PIXEL_MM
    source = inset.gray.astype(np.float32)
    if ratio > 1:
        source = cv2.GaussianBlur(source, (0, 0), float(np.sqrt(ratio**2 - 1) / np.sqrt(12)))
    values = cv2.remap(
        source,
        (turned.real + inset.middle[0] - 0.5).astype(np.float32),
        (turned.imag + inset.middle[1] - 0.5).astype(np.float32),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    alpha = np.clip((reach - np.abs(turned)) / FEATHER_PX, 0.0, 1.0)
    shade = film.margin + gain * (values - film.margin)
    up, before = max(0, -top), max(0, -left)
    view = gray[top + up : top + 2 * half + 1, left + before : left + 2 * half + 1]
    part = (slice(up, up + view.shape[0]), slice(before, before + view.shape[1]))
    view += alpha[part] * (shade[part] - view)
    return float(at[0]), float(at[1])


def paste_group(
    gray: np.ndarray,
    film: Film,
    own: dict[str, Inset],
    used: dict[str, Inset],
    rng: np.random.Generator,
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    """Lay four insets upon a scan, as far from the border as their own film has them.

    Args:
        gray: The scan without marks, changed in place.
        film: How it was made.
        own: The four insets of the family at these places.
        used: Those that are laid there.
        rng: Dims them, and puts them a little beside a square.

    Returns:
        Where their marks are on the film, millimetres, and in the scan, pixels.
    """
    reach_mm = CORNER_MM
    if set(own) == set(GROUPS["sides"]):
        beside = border_mm(own)
        reach_mm = CORNER_MM if beside is None else film.half_mm - beside
    elif any("corner of the picture" in inset.mark.kind for inset in own.values()):
        reach_mm = film.half_mm
    gain = float(rng.uniform(0.5, 1.0))
    film_mm: dict[str, tuple[float, float]] = {}
    truth: dict[str, tuple[float, float]] = {}
    for place, inset in used.items():
        x, y = (np.array(AXES[place]) * reach_mm + rng.normal(0, 0.05, 2)).round(3).tolist()
        film_mm[place] = (x, y)
        truth[place] = paste(gray, film, inset, place, np.array([x, y]), gain)
    return film_mm, truth


def common_offset_off(offsets: dict[str, np.ndarray], group: str) -> dict[str, float]:
    """How far marks lie from where one offset, alike at all of them, puts them.

    Which point of a figure nobody listed is the mark is free; it must be the same everywhere. The
    offset goes along with each mark as it lies, turned or mirrored against the first, or is the
    same in all: whichever leaves least.
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
    lies = (np.array((False, *flips)) for flips in product((False, True), repeat=len(named) - 1))
    tried = [np.where(flips, _mirrored(turned, axis), turned) for flips in lies]
    left = [np.abs(one - _median(one)) for one in (*tried, off)]
    best = min(left, key=lambda one: float(np.mean(one)))
    return dict(zip(named, best.tolist(), strict=True))


def _mirrored(values: np.ndarray, axis: complex) -> np.ndarray:
    return np.conj(values / axis) * axis


def _median(values: np.ndarray) -> complex:
    return complex(float(np.median(values.real)), float(np.median(values.imag)))


def offset_of(mark: FiducialMeasurement, place: tuple[float, float]) -> np.ndarray:
    """A measured mark less the truth, pixels (right, down)."""
    return np.array([mark.column - place[0], mark.row - place[1]])
