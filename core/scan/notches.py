"""The tip of a notch by least squares, the picture beside it taken up as it is.

A notch is where film meets picture, and nobody can draw the picture. So both sides of the notch's
outline are smooth surfaces of unknown gray (penalised splines), and the shift of the outline is
solved for together with them: a slope of gray along the outline then moves nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from core.doubts import Failure
from core.scan.centring import (
    EDGE_PX,
    SOFT_PX,
    SOFT_TAPS,
    Centre,
    Gray,
    Left,
    Weights,
    correlation,
    sample_about,
    softened,
)

BAND_PX = 9.0
"""How far from the outline pixels are used."""
TIP_PX = 8.0
"""Pixels this near to the tip are not used: no tip is quite sharp, and near that of a narrow notch
both edges run into each other."""
KNOTS_PX = 6.0
"""Distance of the splines' knots, pixels."""
CALM_KNOTS_PX = 60.0
"""The same on a side that is even."""
CALM = 0.5
"""How much less than the other side's gray that of an even side spreads."""
SMOOTH = 0.01
"""Weight of a bend between knots against the gray of one pixel: of what lies between pixels, film
grain is more than picture."""
BLUR_PX = 0.6
"""Blur of lens, film and scanner that is begun with, pixels; it is solved for."""
MOST_BLUR_PX = 3.0
ROUNDS = 8
CONVERGED_PX = 2e-3
FAR = 3.0
"""Residual, in spreads, at which half of a pixel's influence is gone."""
MIN_PIXELS = 150
Surfaces = Float64[np.ndarray, "pixels _"]
Square = Float64[np.ndarray, "_ _"]
Values = Float64[np.ndarray, "pixels"]
Used = Bool[np.ndarray, "side side"]


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """The splines of one side of the outline."""

    gray: Surfaces
    """What each adds to the gray of each pixel."""
    slope_c: Surfaces
    """How that changes along the columns."""
    slope_r: Surfaces
    """How that changes along the rows."""

    def beside(
        self, share: Values, rise: Float64[np.ndarray, "pixels _"], variance: float
    ) -> Surfaces:
        """What each adds where a blur mixes both sides.

        Blur draws a gray that rises towards the outline across it: by Gauss's kernel, the blurred
        product of a linear gray and a step is their product plus variance times both slopes.

        Args:
            share: Share of this side in each pixel, blurred.
            rise: How that share changes along columns and rows.
            variance: Of the blur, square pixels.
        """
        drawn = self.slope_c * rise[:, :1] + self.slope_r * rise[:, 1:2]
        return self.gray * share[:, None] + variance * drawn


def centre_by_sides(
    window: Gray, template: Weights, weights: Weights, start: tuple[float, float], limit_px: float
) -> Centre | Failure:
    """The place at which the drawn outline parts two smooth surfaces of gray.

    Args:
        window: Part of the scan, without NaN.
        template: The drawn notch, 1 on one side, 0 on the other; its tip is the middle of its
            middle pixel.
        weights: Weight of each template pixel.
        start: Approximate tip (column, row) in the window, pixels.
        limit_px: How far from the start the tip may be.
    """
    used = _band(template, weights)
    if used.sum() < MIN_PIXELS:
        return Failure("The mark has too little outline in the window.")
    place, blur = np.array(start, dtype=np.float64), BLUR_PX**2
    left: Left | None = None
    share, _ = _outlines(template, blur, used)
    gray = sample_about(window, place, template.shape[0])[used]
    sides, prior = _surfaces(used, _knots(gray, share))
    first, weight = sides[0].gray.shape[1], np.ones(len(share))
    for _ in range(ROUNDS):
        gray = sample_about(window, place, template.shape[0])[used]
        gray -= np.median(gray)
        share, slopes = _outlines(template, blur, used)
        surfaces = np.hstack([
            sides[0].beside(share, -slopes, blur + SOFT_PX**2),
            sides[1].beside(1 - share, slopes, blur + SOFT_PX**2),
        ])  # fmt: skip
        found = _normal(surfaces, weight, prior) @ (surfaces * weight[:, None]).T @ gray
        apart = sides[0].gray @ found[:first] - sides[1].gray @ found[first:]
        design = np.hstack([surfaces, slopes * apart[:, None]])
        step, weight, left = _solved(design, gray, prior, used)
        if not np.isfinite(step).all():
            return Failure("The mark's outline is not there.")
        place = place + np.clip(step[:2], -1.0, 1.0)
        blur = float(np.clip(blur + np.clip(step[2], -0.5, 0.5), 0.01, MOST_BLUR_PX**2))
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("The outline lies elsewhere.")
        if np.abs(step[:2]).max() < CONVERGED_PX:
            break
    sigma = left.sigma_px if left else float("nan")
    return Centre(float(place[0]), float(place[1]), sigma, _likeness(gray, share))


def _likeness(gray: Values, share: Values) -> float:
    """Correlation with the drawn notch, the picture's ups and downs cut off at its usual gray."""
    usual = [float(np.median(gray[(share > 0.5) == side])) for side in (False, True)]
    clipped = np.clip(gray, min(usual), max(usual))
    return correlation(clipped, share, np.ones_like(share))


def _band(template: Weights, weights: Weights) -> Used:
    """Pixels near the outline, but not at the tip."""
    inside = (template > 0.5).astype(np.uint8)
    near = np.zeros(template.shape)
    for part in (inside, 1 - inside):
        depth = cv2.distanceTransform(np.pad(part, 1, mode="edge"), cv2.DIST_L2, 5)[1:-1, 1:-1]
        near += depth
    axis = np.arange(template.shape[0]) - template.shape[0] // 2
    away = np.hypot(*np.meshgrid(axis, axis))
    return np.asarray((near < BAND_PX) & (away > TIP_PX) & (weights > 0.5))


def _outlines(
    template: Weights, blur: float, used: Used
) -> tuple[Values, Float64[np.ndarray, "pixels 3"]]:
    """The drawn notch under a blur (variance), and how it changes with column, row and blur."""
    width = (2 * SOFT_TAPS + 1,) * 2
    edge = cv2.BORDER_REPLICATE
    soft = softened(cv2.GaussianBlur(template, width, float(np.sqrt(blur)), borderType=edge))
    right, down = np.gradient(soft, axis=1), np.gradient(soft, axis=0)
    curved = np.gradient(right, axis=1) + np.gradient(down, axis=0)
    return soft[used], np.column_stack([-right[used], -down[used], 0.5 * curved[used]])


def _knots(gray: Values, share: Values) -> tuple[float, float]:
    """Distance of knots on both sides: a frame is even where the picture is not."""
    spreads = [float(gray[side].std()) for side in (share > 0.98, share < 0.02)]
    first, second = (
        CALM_KNOTS_PX if spread < CALM * max(spreads) else KNOTS_PX for spread in spreads
    )
    return first, second


def _surfaces(used: Used, knots_px: Sequence[float]) -> tuple[list[Side], Square]:
    """Splines of both sides, and the normal equations of the wish that they be smooth."""
    sides, priors = zip(*(_splines(used, distance) for distance in knots_px), strict=True)
    sizes = [len(prior) for prior in priors]
    prior = np.zeros((sum(sizes), sum(sizes)))
    prior[: sizes[0], : sizes[0]] = priors[0]
    prior[sizes[0] :, sizes[0] :] = priors[1]
    return list(sides), prior


def _splines(used: Used, knots_px: float) -> tuple[Side, Square]:
    """Cubic splines over the used pixels, and the penalty of second differences between knots.

    Knots that hardly any pixel reaches are left out.
    """
    rows, columns = np.nonzero(used)
    knots = np.arange(-1, int(used.shape[0] / knots_px) + 3)
    across, down = (_hats(at / knots_px, knots) for at in (columns, rows))
    basis = _products(across, down)
    kept = basis.sum(axis=0) > 0.5
    at = np.full(kept.size, -1)
    at[kept] = np.arange(int(kept.sum()))
    grid = at.reshape(len(knots), len(knots))
    penalty = 1e-3 * np.eye(int(kept.sum()))
    for lines in (grid, grid.T):
        triples = np.stack([lines[:-2], lines[1:-1], lines[2:]], axis=-1).reshape(-1, 3)
        triples = triples[(triples >= 0).all(axis=1)]
        bends = np.zeros((len(triples), len(penalty)))
        for column, value in zip(triples.T, (1.0, -2.0, 1.0), strict=True):
            bends[np.arange(len(triples)), column] = value
        penalty += SMOOTH * bends.T @ bends
    across_slope, down_slope = (_slopes(at / knots_px, knots) / knots_px for at in (columns, rows))
    slope_c, slope_r = _products(across_slope, down), _products(across, down_slope)
    return Side(basis[:, kept], slope_c[:, kept], slope_r[:, kept]), penalty


def _products(across: Surfaces, down: Surfaces) -> Surfaces:
    """Every function of the columns times every function of the rows."""
    return (across[:, :, None] * down[:, None, :]).reshape(len(across), -1)


def _hats(at: Values, knots: np.ndarray) -> Surfaces:
    """Cubic B-splines about whole knots."""
    apart = np.abs(at[:, None] - knots[None, :])
    inner = 2 / 3 - apart**2 + apart**3 / 2
    return np.where(apart < 1, inner, np.clip(2 - apart, 0, None) ** 3 / 6)


def _slopes(at: Values, knots: np.ndarray) -> Surfaces:
    """First derivatives of `_hats`."""
    along = at[:, None] - knots[None, :]
    apart = np.abs(along)
    steep = np.where(apart < 1, 1.5 * apart**2 - 2 * apart, -0.5 * np.clip(2 - apart, 0, None) ** 2)
    return np.sign(along) * steep


def _normal(design: Surfaces, weight: Values, prior: Square) -> Square:
    """Inverse of the weighted normal equations, the prior on the first unknowns included."""
    normal = (design * weight[:, None]).T @ design
    normal[: len(prior), : len(prior)] += prior
    return np.linalg.inv(normal)


def _solved(
    design: Surfaces, gray: Values, prior: Square, used: Used
) -> tuple[Float64[np.ndarray, "3"], Values, Left]:
    """Shift and blur, weights, and what is left; what fits no surface counts less."""
    weight = np.ones(len(gray))
    inverse = _normal(design, weight, prior)
    heavy = design
    solution = inverse @ heavy.T @ gray
    # Half a pixel's share at the outline is no dirt; without it only pixels beside it would count.
    edge = EDGE_PX * np.hypot(design[:, -3], design[:, -2])
    for _ in range(3):
        residual = gray - design @ solution
        spread = np.hypot(1.4826 * float(np.median(np.abs(residual))) + 1e-3, edge)
        weight = 1 / (1 + (residual / (FAR * spread)) ** 2) ** 2
        inverse, heavy = _normal(design, weight, prior), design * weight[:, None]
        solution = inverse @ heavy.T @ gray
    residual = (gray - design @ solution) * np.sqrt(weight)
    unknowns = float(np.vdot(inverse, design.T @ heavy))
    freedom = max(float(weight.sum()) - unknowns, 10.0)
    fields = np.zeros((3, *used.shape))
    fields[:, used] = np.vstack([(inverse @ heavy.T)[-3:-1], residual])
    return solution[-3:], weight, Left(fields[:2], fields[2], freedom)
