"""Where a camera's marks lie when no certificate says so: from all its photos together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.arrays import FilmPoints, PixelPoints
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.scans.layouts import CORNERS, SIDES

ROUNDS = 20
BAD_MM = 0.15
"""A mark of one photo that lies so far from its place in the others is left out, millimetres."""
LONE_SIGMA_MM = 0.05
"""How symmetric cameras are built, and so how well one photo alone tells where its marks are."""
FEW = 3
"""With fewer photos the marks are taken to lie symmetrically."""
Places = Mapping[str, tuple[float, float]]
Stack = Float64[np.ndarray, "photos marks 2"]


@dataclass(frozen=True, slots=True)
class EstimatedMarks:
    """The marks of a camera as its photos show them."""

    places_mm: Places
    """Film frame: origin where lines between opposite marks meet, millimetres."""
    sigma_mm: float
    """Standard deviation of a place per axis, millimetres."""
    principal_point_sigma_mm: float
    """How well that origin stands for the principal point, millimetres (METHODS 2)."""
    photos: int
    """Photos they rest on."""
    left_out: tuple[tuple[str, str], ...]
    """(photo, mark) of marks that lie elsewhere than in the other photos."""


def estimate_marks(measured: Mapping[str, Places]) -> EstimatedMarks | None:
    """Generalised Procrustes over all photos, the mean scale kept (METHODS 2).

    Args:
        measured: By photo, the marks in millimetres by the nominal scan pixel (x right, y up, any
            origin and small rotation), film upright; names are those of `layouts`.

    Returns:
        The marks; None where no photo has three of them.
    """
    names = tuple(name for name in (*CORNERS, *SIDES) if any(name in m for m in measured.values()))
    photos = [photo for photo, marks in measured.items() if len(marks) >= 3]
    if not photos or len(names) < 3:
        return None
    stack = np.full((len(photos), len(names), 2), np.nan)
    for i, photo in enumerate(photos):
        for j, name in enumerate(names):
            if name in measured[photo]:
                stack[i, j] = measured[photo][name]
    mean, moved = _procrustes(stack)
    bad = np.linalg.norm(moved - mean, axis=2) > BAD_MM
    left_out: list[tuple[str, str]] = []
    if len(photos) >= FEW and bad.any():
        left_out = [(photos[i], names[j]) for i, j in np.argwhere(bad).tolist()]
        stack[bad] = np.nan
        mean, moved = _procrustes(stack)
    known = np.isfinite(mean).all(axis=1)
    names, mean, moved = tuple(np.array(names)[known].tolist()), mean[known], moved[:, known]
    mean = _squared(names, mean)
    sigma = LONE_SIGMA_MM
    if len(photos) >= FEW:
        sigma = _spread(moved) / np.sqrt(len(photos))
    else:
        mean = _symmetric(names, mean)
    places = {name: (float(x), float(y)) for name, (x, y) in zip(names, mean, strict=True)}
    return EstimatedMarks(places, sigma, 0.15, len(photos), tuple(left_out))


def _procrustes(stack: Stack) -> tuple[FilmPoints, Stack]:
    """Mean shape of all photos at their mean scale, and every photo moved onto it."""
    centred = stack - np.nanmean(stack, axis=1, keepdims=True)
    first = int(np.isfinite(stack[:, :, 0]).sum(axis=1).argmax())
    mean: FilmPoints = centred[first]
    moved, scales = centred, [1.0]
    for _ in range(ROUNDS):
        moved = np.full_like(stack, np.nan)
        scales = []
        for i, photo in enumerate(centred):
            both = np.isfinite(photo[:, 0]) & np.isfinite(mean[:, 0])
            fit = fit_similarity(photo[both], mean[both])
            if isinstance(fit, PlaneTransform):
                moved[i] = apply_affine(fit.matrix, photo)
                scales.append(fit.scale)
        counts = np.isfinite(moved[:, :, 0]).any(axis=0)
        mean = np.full(mean.shape, np.nan)
        # Nobody's scale is better than another's: their mean is the camera's.
        mean[counts] = np.nanmean(moved[:, counts], axis=0) / float(np.mean(scales))
    return mean, moved / float(np.mean(scales))


def _spread(moved: Stack) -> float:
    """Standard deviation of a mark in one photo about its mean, all marks seen twice together."""
    counts = np.isfinite(moved).sum(axis=0)
    freedom = int(np.clip(counts - 1, 0, None).sum())
    if not freedom:
        return LONE_SIGMA_MM
    apart = moved - np.nansum(moved, axis=0) / np.maximum(counts, 1)
    return float(np.sqrt(np.nansum(apart**2) / freedom))


def _squared(names: Sequence[str], mean: FilmPoints) -> FilmPoints:
    """Turned so that the marks stand straight, moved so that opposite ones meet in the origin."""
    ideal = np.array([{**CORNERS, **SIDES}[name] for name in names])
    fit = fit_similarity(mean, ideal * float(np.abs(mean).max()))
    if isinstance(fit, PlaneTransform):
        a, b = fit.matrix[0, 0], fit.matrix[1, 0]
        mean = mean @ (np.array([[a, -b], [b, a]]) / np.hypot(a, b)).T
    middles = [
        _crossing(mean[[names.index(n) for n in four]])
        for four in (("UL", "LR", "UR", "LL"), ("L", "R", "T", "B"))
        if all(n in names for n in four)
    ]
    middle = np.mean(middles, axis=0) if middles else (mean.min(axis=0) + mean.max(axis=0)) / 2
    return mean - middle


def _crossing(ends: PixelPoints) -> np.ndarray:
    """Where the line of the first two points meets that of the last two."""
    first, second = ends[1] - ends[0], ends[3] - ends[2]
    share = np.linalg.solve(np.column_stack([first, -second]), ends[2] - ends[0])
    return ends[0] + share[0] * first


def _symmetric(names: Sequence[str], mean: FilmPoints) -> FilmPoints:
    """Corner marks as a rectangle, marks of the sides opposite each other."""
    signs = np.array([{**CORNERS, **SIDES}[name] for name in names])
    result = np.zeros_like(mean)
    for group in (CORNERS, SIDES):
        inside = np.array([name in group for name in names])
        for axis in (0, 1):
            on = inside & (signs[:, axis] != 0)
            if on.any():
                half = float(np.mean(mean[on, axis] * signs[on, axis]))
                result[on, axis] = half * signs[on, axis]
    return result
