"""The library of fiducial marks, drawn at any scale, for cameras without a description."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64

from core.geometry.robust import TINY
from core.scans.corners import Edges, turned_edges

Coordinates = Float[np.ndarray, "rows columns"]
Inside = Bool[np.ndarray, "rows columns"]
SUPERSAMPLED = 800  # design: memory; edges of large marks are then right to a tenth of a pixel
"""Samples along a side of a drawn template that suffice: small templates get eight a pixel."""
SURROUND = 1.35  # design: a third of the template's width is background
"""Half width of a drawn template relative to the mark's own: contrast needs background."""
SYMMETRIC = ("cross", "saltire", "gapped-cross", "gapped-saltire", "dotted-cross", "dot", "ring",
             "ringed-dot", "ringed-cross", "ringed-saltire", "quadrants")  # fmt: skip

Lie = Literal["turned", "mirrored", "same"]
"""How one mark of a camera lies against another: turned to point outward, in a mirror along that
direction, as opposite sides often do, or as it is."""
LIES: tuple[Lie, ...] = get_args(Lie)
EXAMPLE = "example"
"""Shape of a mark of which there is nothing but its picture."""

# design: the shapes themselves, right angles and halves of them.
NOTCH_NORMALS = {
    "wedge": (np.pi / 4, -np.pi / 4),
    "tip": (3 * np.pi / 4, -3 * np.pi / 4),
    "half-wedge": (-np.pi / 4, np.pi / 2),
    "other-half-wedge": (np.pi / 4, -np.pi / 2),
}
"""Directions of a notch's two edges towards its inside, from its outward direction (column towards
row), radians."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A mark as scans show it, where nobody can draw it."""

    gray: Float64[np.ndarray, "side side"]
    """Odd number of pixels a side; the mark's middle is the middle of the middle pixel."""
    pixel_mm: float
    """Size of its pixels, millimetres."""
    outward: tuple[float, float]
    """Direction from the middle of the photo where it was seen (right, down)."""
    symmetric: bool
    """True when half a turn about its middle changes nothing."""
    edges: Edges | None = None
    """The straight edges that meet in its middle, where there are two."""


@dataclass(frozen=True, slots=True)
class Mark:
    """One kind of mark in one size."""

    shape: str
    """Name of its shape, a key of `SHAPES`, or of `NOTCH_NORMALS`, or `EXAMPLE`."""
    radius_mm: float
    """From the middle to the end of its arms, or radius of its disc or ring, millimetres."""
    stroke_mm: float
    """Width of its lines, millimetres; for a ringed dot also the diameter of the dot."""
    outward: tuple[float, float] = (0.0, 1.0)
    """Direction from the middle of the photo, as it lies in the scan (right, down); for notches."""
    blur_px: float = 0.0
    """Blur of lens, film and scanner: Gaussian sigma, template pixels."""
    picture: Picture | None = None
    """What it looks like, of an `EXAMPLE`; it is turned to point outward as it did there."""
    lies: Lie = "turned"
    """How a picture lies where the mark is."""

    @property
    def symmetric(self) -> bool:
        """True when half a turn about its middle changes nothing."""
        return self.shape in SYMMETRIC if self.picture is None else self.picture.symmetric

    @property
    def turns(self) -> bool:
        """True when it looks otherwise where it points to another side."""
        return self.picture is not None or not self.symmetric

    @property
    def variants(self) -> tuple["Mark", ...]:
        """The mark, and as it may look at another corner or side."""
        return (self,) if self.picture is None else tuple(replace(self, lies=lie) for lie in LIES)

    def edges_in(self, turn: float, outward: tuple[float, float]) -> Edges | None:
        """The edges of a picture as they lie where the mark is, the film turned clockwise."""
        if self.picture is None or self.picture.edges is None:
            return None
        was = self.picture.outward
        here = was if self.lies == "same" else outward
        angles = [float(np.arctan2(one[1], one[0])) for one in (was, here)]
        return turned_edges(
            self.picture.edges, angles[0], angles[1] + turn, mirrored=self.lies == "mirrored"
        )

    @property
    def notch(self) -> bool:
        """True when it is a place where edges of film and picture meet, not a figure of its own."""
        return self.shape in NOTCH_NORMALS

    @property
    def reach_mm(self) -> float:
        """How far it extends from its middle, millimetres."""
        # design: as crops of Wild RC marks show: rays reach half a radius beyond their ring.
        return self.radius_mm * (1.5 if self.shape in ("ringed-cross", "ringed-saltire") else 1.0)


def library() -> tuple[Mark, ...]:
    """Marks worth looking for, from 0.1 to 3 mm; lines no thicker than a third of their length."""
    # design: sizes in steps of about 1.6, strokes of 2: between two steps a mark still correlates.
    cross_radii, strokes = (0.4, 0.65, 1.0, 1.6, 2.5), (0.1, 0.2, 0.4)
    # measured: prove_fiducials; dots in steps of two were missed between them.
    dots = (0.06, 0.12, 0.18, 0.25, 0.35, 0.5, 0.7, 1.0)
    ring_radii, ring_strokes = (0.3, 0.5, 0.8, 1.3), (0.1, 0.25)  # design: as above
    corners = ((0.8, 0.2), (1.6, 0.2), (1.6, 0.4))  # design: as above
    notch = 1.5  # design: enough of both edges for their directions
    marks = [
        Mark(shape, radius, stroke)
        for shape in ("cross", "saltire", "gapped-cross", "gapped-saltire", "dotted-cross")
        for radius in cross_radii
        for stroke in strokes
        if stroke <= radius / 3
    ]
    marks += [Mark("dot", radius, 0.0) for radius in dots]
    marks += [
        Mark(shape, radius, stroke)
        for shape in ("ring", "ringed-dot", "ringed-cross", "ringed-saltire")
        for radius in ring_radii
        for stroke in ring_strokes
        if stroke <= radius / 2
    ]
    marks += [Mark("quadrants", radius, 0.0) for radius in (0.5, 1.0)]
    marks += [
        Mark(shape, radius, stroke)
        for shape in ("corner", "outer-corner")
        for radius, stroke in corners
    ]
    wedges = ("wedge", "tip", "half-wedge", "other-half-wedge")
    return (*marks, *(Mark(shape, notch, 0.0) for shape in wedges))


def resize_mark(mark: Mark, radius_factor: float, stroke_factor: float, blur_px: float) -> Mark:
    """The same kind of mark with other measures and another blur."""
    return replace(
        mark,
        radius_mm=mark.radius_mm * radius_factor,
        stroke_mm=mark.stroke_mm * stroke_factor,
        blur_px=blur_px,
    )


def draw_mark(
    mark: Mark,
    pixel_mm: float,
    turn: float = 0.0,
    surround: float = SURROUND,
    beside: tuple[float, float] = (0.0, 0.0),
) -> Float64[np.ndarray, "side side"]:
    """The mark as a template: 1 on the mark, 0 beside it, the share of the pixel at its edges.

    Args:
        mark: Kind and size.
        pixel_mm: Size of a pixel, millimetres.
        turn: Rotation in the scan, radians, clockwise as seen (column towards row).
        surround: Half width of the template relative to the mark's own.
        beside: Where a notch's tip lies from the middle of the middle pixel (column, row), pixels.

    Returns:
        Odd number of pixels a side; the mark's middle is the middle of the middle pixel.
    """
    half = max(3, int(np.ceil(mark.reach_mm * surround / pixel_mm)))
    if mark.picture is not None:
        drawn = _turned_picture(mark, mark.picture, half, pixel_mm, turn)
    elif mark.notch:
        drawn = _drawn_notch(mark, half, turn, beside)
    else:
        drawn = _drawn_figure(mark, half, pixel_mm, turn)
    if mark.blur_px > 0:
        border = cv2.BORDER_REPLICATE
        drawn = np.asarray(cv2.GaussianBlur(drawn, (0, 0), mark.blur_px, borderType=border))
    return drawn


def _turned_picture(
    mark: Mark, picture: Picture, half: int, pixel_mm: float, turn: float
) -> Float64[np.ndarray, "side side"]:
    """An example at another pixel size, turned to where the mark points."""
    was = np.arctan2(picture.outward[1], picture.outward[0])
    outward = picture.outward if mark.lies == "same" else mark.outward
    points = np.arctan2(outward[1], outward[0]) + turn
    axis = np.arange(-half, half + 1, dtype=np.float64) * (pixel_mm / picture.pixel_mm)
    right, down = np.meshgrid(axis, axis)
    along = right * np.cos(points) + down * np.sin(points)
    across = down * np.cos(points) - right * np.sin(points)
    if mark.lies == "mirrored":
        across = -across
    middle = picture.gray.shape[0] // 2
    columns = (along * np.cos(was) - across * np.sin(was) + middle).astype(np.float32)
    rows = (along * np.sin(was) + across * np.cos(was) + middle).astype(np.float32)
    # source: the variance of an even spread over a pixel is a twelfth of its square
    wider = np.sqrt(max((pixel_mm / picture.pixel_mm) ** 2 - 1, 0.0)) / np.sqrt(12)
    gray = picture.gray
    if wider > 0:
        gray = cv2.GaussianBlur(gray, (0, 0), wider, borderType=cv2.BORDER_REPLICATE)
    return cv2.remap(gray, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def _drawn_figure(
    mark: Mark, half: int, pixel_mm: float, turn: float
) -> Float64[np.ndarray, "side side"]:
    """A figure by samples within every pixel."""
    side = 2 * half + 1
    fine = int(np.clip(SUPERSAMPLED // side, 2, 8))  # design: shares of a 64th of a pixel
    axis = (((np.arange(side * fine) + 0.5) / fine - half - 0.5) * pixel_mm).astype(np.float32)
    across, along = axis * np.float32(np.cos(turn)), axis * np.float32(np.sin(turn))
    inside = SHAPES[mark.shape](mark, across + along[:, None], across[:, None] - along)
    shares = cv2.resize(inside.astype(np.float32), (side, side), interpolation=cv2.INTER_AREA)
    return shares.astype(np.float64)


def _drawn_notch(
    mark: Mark, half: int, turn: float, beside: tuple[float, float]
) -> Float64[np.ndarray, "side side"]:
    """A notch by its two edges, each pixel's share exact: samples would miss half of a step."""
    axis = np.arange(-half, half + 1, dtype=np.float64)
    right, down = np.meshgrid(axis - beside[0], axis - beside[1])
    angle = np.arctan2(mark.outward[1], mark.outward[0]) + turn
    shares = [_half_plane(right, down, angle + normal) for normal in NOTCH_NORMALS[mark.shape]]
    return np.minimum(*shares)


def _half_plane(right: Coordinates, down: Coordinates, angle: float) -> Coordinates:
    """Share of each pixel on the side of a line through the middle that its normal points to."""
    across, along = sorted((abs(np.cos(angle)), abs(np.sin(angle))))
    apart = right * np.cos(angle) + down * np.sin(angle)
    # A square seen along the line is a trapezoid: wide parts of constant depth, two ramps.
    inner, outer = (along - across) / 2, (along + across) / 2
    away = np.abs(apart)
    ramp = np.clip(outer - away, 0, None) ** 2 / (2 * across * along + TINY)
    share = np.where(away <= inner, 0.5 + away / along, 1 - ramp)
    share = np.where(away >= outer, 1.0, share)
    return np.where(apart >= 0, share, 1 - share)


def _cross(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Upright cross."""
    half, arm = mark.stroke_mm / 2, mark.radius_mm
    return ((np.abs(x) < half) & (np.abs(y) < arm)) | ((np.abs(y) < half) & (np.abs(x) < arm))


def _turned(x: Coordinates, y: Coordinates) -> tuple[Coordinates, Coordinates]:
    """Coordinates in axes turned by an eighth of a circle."""
    return (x + y) / np.sqrt(2), (y - x) / np.sqrt(2)


def _saltire(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Diagonal cross."""
    return _cross(mark, *_turned(x, y))


def _gapped_cross(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Upright cross with an open middle."""
    # design: drawn from cameras with open crosses
    return _cross(mark, x, y) & (np.maximum(np.abs(x), np.abs(y)) > 0.3 * mark.radius_mm)


def _gapped_saltire(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Diagonal cross with an open middle."""
    return _gapped_cross(mark, *_turned(x, y))


def _dotted_cross(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Upright cross, its open middle with a dot in it, as in cameras of the thirties."""
    # design: drawn from cameras of the thirties; no dot is thinner than a pixel of the search
    return _gapped_cross(mark, x, y) | (np.hypot(x, y) < max(0.1 * mark.radius_mm, 0.05))


def _quadrants(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Disc of which two opposite quarters are filled."""
    return (np.hypot(x, y) < mark.radius_mm) & (x * y > 0)


def _corner(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Two arms at a right angle that run towards the middle of the photo's sides."""
    right, down = (-1.0 if part < -TINY else 1.0 for part in mark.outward)
    inward, across = -x * right, -y * down
    half, arm = mark.stroke_mm / 2, mark.radius_mm
    level = (np.abs(across) < half) & (inward > -half) & (inward < arm)
    return level | ((np.abs(inward) < half) & (across > -half) & (across < arm))


def _outer_corner(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """The same with arms that run away from the middle."""
    return _corner(mark, -x, -y)


def _dot(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Disc."""
    return np.hypot(x, y) < mark.radius_mm


def _ring(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Circle line."""
    return np.abs(np.hypot(x, y) - mark.radius_mm) < mark.stroke_mm / 2


def _ringed_dot(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Dot in a ring."""
    return _ring(mark, x, y) | (np.hypot(x, y) < mark.stroke_mm / 2)


def _ringed_cross(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Ring with four rays through it, as in Wild cameras."""
    # design: as crops of Wild RC marks show: rays are thinner than the ring and end inside it.
    thinner, inside = 0.6, 0.4
    reach = replace(mark, radius_mm=mark.reach_mm, stroke_mm=mark.stroke_mm * thinner)
    rays = _cross(reach, x, y) & (np.hypot(x, y) > inside * mark.radius_mm)
    return _ring(mark, x, y) | rays


def _ringed_saltire(mark: Mark, x: Coordinates, y: Coordinates) -> Inside:
    """Ring with four diagonal rays from it, as in the corners of Wild cameras."""
    return _ringed_cross(mark, *_turned(x, y))


SHAPES: dict[str, Callable[[Mark, Coordinates, Coordinates], Inside]] = {
    "cross": _cross,
    "saltire": _saltire,
    "gapped-cross": _gapped_cross,
    "gapped-saltire": _gapped_saltire,
    "dotted-cross": _dotted_cross,
    "quadrants": _quadrants,
    "corner": _corner,
    "outer-corner": _outer_corner,
    "dot": _dot,
    "ring": _ring,
    "ringed-dot": _ringed_dot,
    "ringed-cross": _ringed_cross,
    "ringed-saltire": _ringed_saltire,
}
