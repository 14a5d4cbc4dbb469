"""Little scans with marks whose places are known, drawn independently of the code under test."""

import warnings
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning

FIDUCIALS = {"1": (-26.0, 26.0), "2": (26.0, 26.0), "3": (26.0, -26.0), "4": (-26.0, -26.0)}


@dataclass(frozen=True)
class Film:
    """How the little film is exposed and scanned."""

    kind: str = "cross"
    pixel_mm: float = 0.04
    turn_deg: float = 0.7
    quarter: int = 0
    shrinkage: tuple[float, float] = (0.9995, 0.9997)
    noise: float = 4.0
    bright: bool = True
    fiducials: dict = field(default_factory=lambda: dict(FIDUCIALS))
    half_mm: float = 30.0
    margin: float = 8.0
    margin_mm: float = 2.5
    housing_mm: float = 2.0
    missing: tuple[str, ...] = ()
    mirrored: bool = False
    mark_size: float = 1.0
    grain_px: float = 0.0
    covered: tuple[str, ...] = ()
    scratches: int = 0


def outward_inside(kind: str, along: np.ndarray, across: np.ndarray, inward: tuple) -> np.ndarray:
    """Marks that point: along is away from the middle of the photo; inward are both film axes."""
    if kind == "notch":
        return along > np.abs(across)
    if kind == "half-arrow":
        return (along > across) & (across > 0)
    if kind == "corner":
        u, v = inward
        level = (np.abs(v) < 0.12) & (u > -0.12) & (u < 1.3)
        return level | ((np.abs(u) < 0.12) & (v > -0.12) & (v < 1.3))
    raise AssertionError(kind)


POINTING = ("notch", "half-arrow", "corner")


def unlisted(kind: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Marks that no library lists."""
    if kind == "key":
        shaft = (x > 0) & (x < 1.1) & (np.abs(y) < 0.12)
        return (np.hypot(x, y) < 0.35) | shaft | (np.hypot(x - 1, y) < 0.2)
    if kind == "chevrons":
        beside = np.abs(np.abs(x) - 0.4 - np.sign(x) * y / 2)
        return (beside < 0.12) & (np.abs(y) < 0.7)
    if kind == "star":
        return np.hypot(x, y) < 0.35 + 0.5 * np.cos(3 * np.arctan2(y, x)) ** 2
    raise AssertionError(kind)


def inside(kind: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which places (mm from the middle) belong to the mark."""
    r = np.hypot(x, y)
    arms = (np.abs(x) < 0.075) | (np.abs(y) < 0.075)
    if kind == "numbered-cross":
        figure = (np.abs(x - 1.75) < 0.06) & (np.abs(y) < 0.45)
        figure |= (np.abs(x - 2.1) < 0.06) & (np.abs(y) < 0.45)
        return inside("cross", x, y) | figure
    if kind == "dotted-cross":
        return inside("gapped-cross", x, y) | (r < 0.11)
    if kind == "ringed-saltire":
        rays = inside("saltire", x, y) & (r > 0.25)
        return rays | (np.abs(r - 0.75) < 0.1)
    if kind == "cross":
        return arms & (np.maximum(np.abs(x), np.abs(y)) < 1.2)
    if kind == "gapped-cross":
        return arms & (np.maximum(np.abs(x), np.abs(y)) < 1.2) & (r > 0.35)
    if kind == "dot":
        return r < 0.25
    if kind == "ringed-dot":
        return (r < 0.1) | (np.abs(r - 0.6) < 0.07)
    if kind == "ring":
        return np.abs(r - 0.5) < 0.08
    if kind == "saltire":
        u, v = (x + y) / np.sqrt(2), (x - y) / np.sqrt(2)
        return ((np.abs(u) < 0.075) | (np.abs(v) < 0.075)) & (
            np.maximum(np.abs(u), np.abs(v)) < 1.2
        )
    return unlisted(kind, x, y)


def film_from_pixel(film: Film, size: int) -> np.ndarray:
    """2 x 3: film mm from pixel (corner origin), shrinkage, turn and quarter turns included."""
    turn = np.radians(film.turn_deg + 90 * film.quarter)
    up = film.pixel_mm * np.array([[1.0, 0.0], [0.0, -1.0]])
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    back = np.diag([-1.0, 1.0]) if film.mirrored else np.eye(2)
    linear = np.diag(1 / np.array(film.shrinkage)) @ back @ rotation @ up
    middle = np.array([size / 2 + 11.3, size / 2 - 7.6])
    return np.column_stack([linear, -linear @ middle])


def make_film(path: Path, film: Film, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Write the scan; returns where the marks really are, pixels."""
    size = round(2 * (film.half_mm + film.margin_mm) / film.pixel_mm)
    matrix = film_from_pixel(film, size)
    rng = np.random.default_rng(seed)
    axis = np.arange(size, dtype=np.float32) + 0.5
    column, row = np.meshgrid(axis, axis)
    x = matrix[0, 0] * column + matrix[0, 1] * row + matrix[0, 2]
    y = matrix[1, 0] * column + matrix[1, 1] * row + matrix[1, 2]
    scene = 6 * _texture(rng, size, 16) + 0.3 * _texture(rng, size, 3)
    gray = 120 + 40 * scene / scene.std()
    gray = np.where(np.maximum(np.abs(x), np.abs(y)) < film.half_mm, gray, film.margin)
    truth: dict[str, tuple[float, float]] = {}
    for name, place in film.fiducials.items():
        at = np.linalg.solve(matrix[:, :2], np.array(place) - matrix[:, 2])
        truth[name] = (float(at[0]), float(at[1]))
        if name not in film.missing:
            expose_mark(gray, film, matrix, np.array(place), at)
    _damage(gray, film, truth, rng)
    gray = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), 0.6)
    noise = rng.standard_normal(gray.shape, dtype=np.float32)
    if film.grain_px:
        noise = cv2.GaussianBlur(noise, (0, 0), film.grain_px)
        noise /= noise.std()
    gray += film.noise * noise
    write_gray(path, np.clip(gray, 0, 255).astype(np.uint8))
    return truth


def _damage(
    gray: np.ndarray, film: Film, truth: dict[str, tuple[float, float]], rng: np.random.Generator
) -> None:
    """Notes over marks, and scratches anywhere, some of them through a mark."""
    for name in film.covered:
        column, row = (round(value) for value in truth[name])
        reach = round(1.3 / film.pixel_mm)
        shift = int(rng.integers(-reach // 3, reach // 3 + 1))
        corner = (column - reach + shift, row - reach)
        tone = float(rng.choice([film.margin, 200.0]))
        cv2.rectangle(gray, corner, (column + reach + shift, row + reach), tone, -1)
    size = gray.shape[0]
    for _ in range(film.scratches):
        start = rng.uniform(0, size, 2)
        if rng.random() < 0.25:
            near = truth[str(rng.choice(list(truth)))]
            start = np.array(near) + rng.normal(0, 0.5 / film.pixel_mm, 2)
        angle = rng.normal(np.pi / 2, 0.1)
        end = start + rng.uniform(100, 500) * np.array([np.cos(angle), np.sin(angle)])
        tone = float(rng.choice([40.0, 235.0]))
        ends = [tuple(int(v) for v in point) for point in (start, end)]
        cv2.line(gray, ends[0], ends[1], tone, 1)


def _texture(rng: np.random.Generator, size: int, coarse: int) -> np.ndarray:
    """Smooth noise of one coarseness, pixels."""
    count = size // coarse + 2
    noise = rng.normal(0, 1, (count, count)).astype(np.float32)
    return cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC)


def expose_mark(
    gray: np.ndarray, film: Film, matrix: np.ndarray, place: np.ndarray, at: np.ndarray
) -> None:
    """One mark in its dark (or light) housing, eight samples a pixel each way.

    Each sample lies anywhere in its cell: on a regular grid a straight edge would jump by an eighth
    of a pixel.
    """
    half = int(np.ceil((film.housing_mm + 0.3) / film.pixel_mm))
    left, top = int(at[0]) - half, int(at[1]) - half
    fine = np.arange((2 * half + 1) * 8) / 8
    column, row = np.meshgrid(fine + left, fine + top)
    jitter = np.random.default_rng([left, top])
    column += jitter.random(column.shape) / 8
    row += jitter.random(row.shape) / 8
    x = matrix[0, 0] * column + matrix[0, 1] * row + matrix[0, 2] - place[0]
    y = matrix[1, 0] * column + matrix[1, 1] * row + matrix[1, 2] - place[1]
    mark, ground = (230.0, film.margin) if film.bright else (20.0, 225.0)
    side = 2 * half + 1
    view = gray[top : top + side, left : left + side]
    scene = np.kron(view, np.ones((8, 8)))
    values = np.where(np.hypot(x, y) < film.housing_mm, ground, scene)
    x, y = x / film.mark_size, y / film.mark_size
    if film.kind in POINTING:
        direction = np.rint(1.4 * place / np.abs(place).max())
        sides = np.where(direction == 0, 1.0, direction)
        direction = direction / np.hypot(*direction)
        along = x * direction[0] + y * direction[1]
        across = y * direction[0] - x * direction[1]
        inwards = (-x * sides[0], -y * sides[1])
        belongs = outward_inside(film.kind, along, across, inwards)
        if film.kind != "corner":
            mark, values = (film.margin if film.bright else 235.0), scene
    else:
        belongs = inside(film.kind, x, y)
    values = np.where(belongs, mark, values)
    view[:] = values.reshape(side, 8, side, 8).mean(axis=(1, 3))


def write_gray(path: Path, values: np.ndarray, **profile: object) -> None:
    """An 8 or 16 bit scan without georeference."""
    bands = values[None] if values.ndim == 2 else values
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(
            path, "w", height=bands.shape[1], width=bands.shape[2], count=len(bands),
            dtype=bands.dtype, **profile,
        ) as dataset:  # fmt: skip
            dataset.write(bands)
