"""Precision of a template match, from the template and from the window it was found in.

What the template does not explain of the window moves the peak: noise, grain, and whatever looks
different today. With g the gradients of the template, c the autocorrelation of the rest and a the
gain, the shift has the covariance

    H^-1 (sum over u of c(u) (g * g)(u)) H^-1 / a^2,   H = sum of g g^T,

least squares of a shift with correlated errors (METHODS 3.4). It holds for any correlated layers,
so that each operator's peaks are judged by the layers it compares.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from core.matching.peaks import Description, Image, ScoreMap

Layers = Float32[np.ndarray, "layers rows columns"]
Covariance = Float64[np.ndarray, "2 2"]

# design: time; grain and blur are alike over a pixel or two, and errors of ten pixels' reach
# would move the whole template, which its gradients cannot tell.
REACH_PX = 3
"""What is left is taken for unlike at greater distances, pixels."""
# design: numerical safety; a hundred-thousandth of what a usual template has.
LEAST_DETERMINANT = 1e-10
"""A template is an edge that slides along itself where the determinant of H is less, of its trace
squared."""

# source: ITU-T T.81 compresses 8 x 8 pixels together; 49 pixels are five cells of nine.
CELLS = 5
"""Cells a side by which two pictures say how much their errors are alike."""
# design: by definition; shift, affinity, brightness and contrast are estimated from the cells.
FREEDOM = CELLS**2 - 8
"""Degrees of freedom of a deviation that the cells tell."""


@dataclass(frozen=True, slots=True, eq=False)
class Sharpness:
    """A template, with what its gradients say of a shift."""

    template: Layers
    """What is correlated."""
    inverse: Covariance
    """H^-1."""
    spread: Float32[np.ndarray, "axes layers axes layers lags lags"]
    """(g * g)(u) of both axes and all layers."""


def sharpness_of(template: Description) -> Sharpness | None:
    """What the gradients of a template say; None where they do not fix a place.

    Args:
        template: Layers that are correlated.
    """
    layers = _layers(template)
    across, down = np.gradient(layers, axis=2), np.gradient(layers, axis=1)
    gradients = np.stack([np.asarray(across), np.asarray(down)])
    flat = gradients.reshape(2, -1)
    normal = (flat @ flat.T).astype(np.float64)
    if np.linalg.det(normal) <= LEAST_DETERMINANT * np.trace(normal) ** 2:
        return None
    lags = _lags(gradients.reshape(-1, *layers.shape[1:]))
    each = (2, len(layers), 2, len(layers), *lags.shape[2:])
    return Sharpness(layers, np.linalg.inv(normal), lags.reshape(each))


def place_covariance(sharpness: Sharpness, window: Description) -> Covariance:
    """Covariance (column, row) of the place of a template, square pixels.

    Args:
        sharpness: The template.
        window: The same layers of the picture where the template was found, of its size.

    Returns:
        The covariance; infinite where the picture has nothing of the template.
    """
    template, shown = sharpness.template, _layers(window)
    gain = float(np.sum(template * shown) / np.sum(template**2))
    if gain <= 0:
        return np.full((2, 2), np.inf)
    left = _lags(shown - gain * template)
    pixels = template.shape[1] * template.shape[2]
    noise = np.einsum("akbluv,kluv->ab", sharpness.spread, left) / pixels
    return sharpness.inverse @ noise.astype(np.float64) @ sharpness.inverse / gain**2


def likely_covariance(scores: ScoreMap, peak: tuple[float, float]) -> Covariance:
    """Covariance (column, row) about one peak of where a template lies, by all scores near it.

    A template that lies in noise correlates to a surface whose likelihood is exp(a h): h the scores
    in standard deviations of what chance brings, a that of the template in its right place
    (Woodward 1953). Along an edge that slides along itself the scores hardly fall: a place on it is
    known across it alone. Unlike `place_covariance` it tells how far a place may slide, and counts
    other peaks.

    Args:
        scores: By displacement, in standard deviations of chance, all that may be right.
        peak: Column and row of the peak that is taken for the right one.

    Returns:
        The covariance, square pixels.
    """
    rows, columns = (np.arange(count) for count in scores.shape)
    column, row = (
        int(np.clip(round(at), 0, count - 1))
        for at, count in zip(peak, scores.shape[::-1], strict=True)
    )
    height = float(scores[row, column])
    # What is higher is as likely: this peak is taken for the right one.
    likely = np.exp(max(height, 0.0) * np.minimum(scores - height, 0.0)).astype(np.float64)
    across, down = np.meshgrid(columns - peak[0], rows - peak[1])
    away = np.stack([across, down])
    return np.einsum("arc,brc,rc->ab", away, away, likely) / likely.sum()


def paired_covariance(
    first: Image, second: Image, smooth_px: float, bend_sigma: float
) -> Covariance:
    """Covariance (column, row) of the place of one noisy picture on another, square pixels.

    Scans of film carry grain, and compressed ones blocks: both have gradients. Only what the
    pictures share says how sharp the place is, so H is the product of the gradients of both: noise
    of one has no part in the other's. How far errors of neighbouring pixels are alike differs from
    film to film, so nothing is presumed of it: each cell of the picture pulls the place by itself,
    and the cells tell by how much they disagree (clustered errors, Liang and Zeger 1986). The
    affinity by which one was bent onto the other is unknown as well, and takes its share.

    Args:
        first: Smoothed grey values, square.
        second: The same of the other, bent onto the first.
        smooth_px: Gaussian radius by which both were smoothed.
        bend_sigma: Standard deviation of the affinity's four linear terms beforehand.

    Returns:
        The covariance, of `FREEDOM` degrees of freedom; infinite where they share nothing that
        fixes a place. A place beside the best one is off by the way to it as well.
    """
    nowhere = np.full((2, 2), np.inf)
    own, other = (grey.astype(np.float64) for grey in (first, second))
    own, other = own - own.mean(), other - other.mean()
    # design: numerical safety; grey values are whole numbers.
    gain = float(np.sum(own * other)) / max(float(np.sum(own**2)), 1e-9)
    if gain <= 0:
        return nowhere
    other = other / gain
    tone = own.ravel() / np.linalg.norm(own)
    left = (other - own).ravel()
    left -= tone * (tone @ left)
    terms, shared = _affine_terms(own, tone), _affine_terms(other, tone)
    normal = terms.T @ shared
    normal = (normal + normal.T) / 2
    # source: the autocorrelation of white noise smoothed by a Gaussian sums to 4 pi sigma squared.
    alike = max(1.0, 4 * np.pi * smooth_px**2)
    prior = np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    prior *= alike * float(np.mean(left**2)) / bend_sigma**2
    if np.linalg.eigvalsh(normal[:2, :2])[0] <= 0 or np.linalg.eigvalsh(normal + prior)[0] <= 0:
        return nowhere
    cells = _by_cell(terms * left[:, None], own.shape[0])
    pull = cells.sum(axis=0)
    cells = cells - pull / len(cells)
    noise = cells.T @ cells * (len(cells) / FREEDOM)
    inverse = np.linalg.inv(normal + prior)
    away = (inverse @ pull)[:2, None]
    spread = (inverse @ (noise + prior**2 * bend_sigma**2) @ inverse)[:2, :2]
    return spread + away @ away.T


def _affine_terms(
    picture: Float64[np.ndarray, "rows columns"], tone: Float64[np.ndarray, "pixels"]
) -> Float64[np.ndarray, "pixels 6"]:
    """Change of grey values with shift (2) and the four terms of an affinity.

    What a change of brightness and contrast explains is taken out.
    """
    down, across = np.gradient(picture)
    rows, columns = (np.arange(side) - (side - 1) / 2 for side in picture.shape)
    x, y = np.meshgrid(columns, rows)
    terms = np.stack([across, down, across * x, across * y, down * x, down * y])
    flat = terms.reshape(6, -1).T
    flat = flat - flat.mean(axis=0)
    return flat - np.outer(tone, tone @ flat)


def _by_cell(
    values: Float64[np.ndarray, "pixels terms"], side: int
) -> Float64[np.ndarray, "cells terms"]:
    """Sums over the cells of a square picture."""
    line = np.arange(side) * CELLS // side
    cell = (line[:, None] * CELLS + line).ravel()
    return np.stack([np.bincount(cell, column) for column in values.T], axis=1)


def _layers(description: Description) -> Layers:
    """All planes of a description, one after another."""
    return np.stack([plane.astype(np.float32) for plane in _planes(description)])


def _planes(description: Description) -> Iterator[np.ndarray]:
    for layer in description:
        yield from (layer,) if layer.ndim == 2 else np.moveaxis(layer, 2, 0)


def _lags(planes: Layers) -> Float32[np.ndarray, "layers layers lags lags"]:
    """Sums of products of all planes at all lags within the reach; nought beyond their edges."""
    count, rows, columns = planes.shape
    wide = np.pad(planes, ((0, 0), (REACH_PX, REACH_PX), (REACH_PX, REACH_PX)))
    side = 2 * REACH_PX + 1
    flat = planes.reshape(count, -1)
    half: list[Float32[np.ndarray, "layers layers"]] = []
    for lag in range(side * side // 2 + 1):
        row, column = divmod(lag, side)
        moved = wide[:, row : row + rows, column : column + columns]
        half.append(moved.reshape(count, -1) @ flat.T)
    # Two planes at one lag are the same two, changed over, at the opposite one.
    every = np.stack([*half, *(one.T for one in half[-2::-1])], axis=-1)
    return every.reshape(count, count, side, side)
