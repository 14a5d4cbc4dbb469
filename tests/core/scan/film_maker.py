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
    housing_mm: float = 2.0
    missing: tuple[str, ...] = ()


def inside(kind: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which places (mm from the middle) belong to the mark."""
    r = np.hypot(x, y)
    arms = (np.abs(x) < 0.075) | (np.abs(y) < 0.075)
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
    raise AssertionError(kind)


def film_from_pixel(film: Film, size: int) -> np.ndarray:
    """2 x 3: film mm from pixel (corner origin), shrinkage, turn and quarter turns included."""
    turn = np.radians(film.turn_deg + 90 * film.quarter)
    up = film.pixel_mm * np.array([[1.0, 0.0], [0.0, -1.0]])
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    linear = np.diag(1 / np.array(film.shrinkage)) @ rotation @ up
    middle = np.array([size / 2 + 11.3, size / 2 - 7.6])
    return np.column_stack([linear, -linear @ middle])


def make_film(path: Path, film: Film, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Write the scan; returns where the marks really are, pixels."""
    size = round((2 * film.half_mm + 5.0) / film.pixel_mm)
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
            _expose_mark(gray, film, matrix, np.array(place), at)
    gray = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), 0.6)
    gray += film.noise * rng.standard_normal(gray.shape, dtype=np.float32)
    write_gray(path, np.clip(gray, 0, 255).astype(np.uint8))
    return truth


def _texture(rng: np.random.Generator, size: int, coarse: int) -> np.ndarray:
    """Smooth noise of one coarseness, pixels."""
    count = size // coarse + 2
    noise = rng.normal(0, 1, (count, count)).astype(np.float32)
    return cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC)


def _expose_mark(
    gray: np.ndarray, film: Film, matrix: np.ndarray, place: np.ndarray, at: np.ndarray
) -> None:
    """One mark in its dark (or light) housing, eight samples a pixel each way."""
    half = int(np.ceil((film.housing_mm + 0.3) / film.pixel_mm))
    left, top = int(at[0]) - half, int(at[1]) - half
    fine = (np.arange((2 * half + 1) * 8) + 0.5) / 8
    column, row = np.meshgrid(fine + left, fine + top)
    x = matrix[0, 0] * column + matrix[0, 1] * row + matrix[0, 2] - place[0]
    y = matrix[1, 0] * column + matrix[1, 1] * row + matrix[1, 2] - place[1]
    mark, ground = (230.0, film.margin) if film.bright else (20.0, 225.0)
    side = 2 * half + 1
    view = gray[top : top + side, left : left + side]
    scene = np.kron(view, np.ones((8, 8)))
    values = np.where(np.hypot(x, y) < film.housing_mm, ground, scene)
    values = np.where(inside(film.kind, x, y), mark, values)
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
