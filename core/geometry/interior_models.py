"""Models of the film's shape in a scan, from four to eight parameters, fitted with weights.

All are an affine transform of the pixel to (x, y) in film millimetres, followed by a warp of two
parameters for the two largest: bilinear x + w x y (each axis its own w), projective
(x, y) / (1 + w1 x + w2 y).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float64

from core.arrays import Affine2, FilmPoints, Matrix, PixelPoints, Scalars, locked
from core.doubts import Failure
from core.geometry.transforms import PARAMETERS, PlaneTransform, fit_affine, fit_similarity
from core.said import say

FilmModel = Literal["similarity", "affine", "projective", "bilinear"]
Warp = Float64[np.ndarray, "2"]
"""The two parameters beyond the affine part, per millimetre."""
Parameters = Float64[np.ndarray, "parameters"]
Equations = Float64[np.ndarray, "equations"]
# design: linear models take one, warps of film three.
STEPS = 8


@dataclass(frozen=True, slots=True, eq=False)
class FilmFit:
    """A fitted model with every figure that judges it."""

    model: FilmModel
    """Which."""
    matrix: Affine2
    """Affine part: film mm from pixel."""
    warp: Warp
    """The two parameters of the warp; nought for similarity and affine."""
    residuals: FilmPoints
    """Computed minus certified, millimetres."""
    weighted_square_sum: float
    """Sum of squared residuals over their a-priori standard deviations."""
    redundancy: int
    """Equations minus parameters."""
    cofactor: Matrix
    """8 x 8 a-priori covariance of matrix (row by row) and warp."""

    def __post_init__(self) -> None:
        for name in ("matrix", "warp", "residuals", "cofactor"):
            object.__setattr__(self, name, locked(getattr(self, name)))

    @property
    def rms(self) -> float:
        """Root mean square residual per coordinate, millimetres."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def sigma(self) -> float:
        """A-posteriori standard deviation of one coordinate (mm); NaN without redundancy."""
        if not self.redundancy:
            return float("nan")
        return float(np.sqrt(np.sum(self.residuals**2) / self.redundancy))


def fit_film(
    model: FilmModel,
    pixels: PixelPoints,
    film: FilmPoints,
    sigmas_mm: Scalars,
    *,
    mirrored: bool = False,
) -> FilmFit | Failure:
    """Fit one model by weighted least squares.

    Args:
        model: Which; it needs two, three, four and four marks.
        pixels: Where the marks were measured.
        film: Where the certificate puts them.
        sigmas_mm: A-priori standard deviation of a mark per axis, on the film.
        mirrored: True when the film was scanned from its back.
    """
    if 2 * len(pixels) < PARAMETERS[model]:
        return Failure(
            say("{count} marks are too few for a {model} model.", count=len(pixels), model=model)
        )
    start = fit_similarity(pixels, film, mirrored=not mirrored)
    if model != "similarity" and isinstance(start, PlaneTransform):
        start = fit_affine(pixels, film)
    if isinstance(start, Failure):
        return start
    free = _free_directions(model, mirrored)
    values = np.concatenate([start.matrix.ravel(), np.zeros(2)])
    weights = np.repeat(1 / sigmas_mm, 2)
    # Centred and scaled unknowns: a pixel is far from the origin, a warp is far below one.
    shift, spread = pixels.mean(axis=0), float(np.ptp(pixels, axis=0).max()) or 1.0
    scaled = free * _units(free, spread, film)
    cofactor = np.zeros((8, 8))
    for _ in range(STEPS):
        residual, slopes = _linearise(values, pixels, film, shift, model=model)
        design = (slopes @ scaled) * weights[:, None]
        left, singular, right = np.linalg.svd(design, full_matrices=False)
        # design: far above rounding.
        if singular[-1] < 1e-9 * singular[0]:
            return Failure(
                say("The marks lie too much in one line for a {model} model.", model=model)
            )
        step = -(right.T / singular) @ (left.T @ (residual * weights))
        values = _undo_centring(scaled @ step, shift) + values
        back = np.column_stack([_undo_centring(column, shift) for column in scaled.T])
        cofactor = back @ ((right.T / singular**2) @ right) @ back.T
        # design: a femtometre.
        if np.abs(step).max() < 1e-12:
            break
    residual, _ = _linearise(values, pixels, film, shift, model=model)
    return FilmFit(
        model, values[:6].reshape(2, 3), values[6:], residual.reshape(-1, 2),
        float(np.sum((residual * weights) ** 2)), 2 * len(pixels) - PARAMETERS[model], cofactor,
    )  # fmt: skip


def warp_film(flat: FilmPoints, warp: Warp, model: str) -> FilmPoints:
    """Film points of points that went through the affine part."""
    if model == "bilinear":
        return flat + flat[:, :1] * flat[:, 1:] * warp
    if model == "projective":
        return flat / (1 + flat @ warp)[:, None]
    return flat


def unwarp_film(film: FilmPoints, warp: Warp, model: str) -> FilmPoints:
    """The way back; for film warps (below 1e-5 per mm) the iteration ends at once."""
    if model == "projective":
        return film / (1 - film @ warp)[:, None]
    flat = film
    if model == "bilinear":
        for _ in range(8):
            flat = film - flat[:, :1] * flat[:, 1:] * warp
    return flat


def film_slopes(pixels: PixelPoints, matrix: Affine2, warp: Warp, model: str) -> Matrix:
    """(2 n, 8) derivatives of film x and y by the matrix (row by row) and the warp."""
    flat = pixels @ matrix[:, :2].T + matrix[:, 2]
    x, y = flat.T
    by_flat = np.tile(np.eye(2), (len(pixels), 1, 1))
    by_warp = np.zeros((len(pixels), 2, 2))
    if model == "bilinear":
        by_flat[:, 0] += np.column_stack([y * warp[0], x * warp[0]])
        by_flat[:, 1] += np.column_stack([y * warp[1], x * warp[1]])
        by_warp[:, 0, 0] = by_warp[:, 1, 1] = x * y
    elif model == "projective":
        below = 1 + flat @ warp
        moved = flat / below[:, None]
        by_flat = (by_flat - moved[:, :, None] * warp[None, None, :]) / below[:, None, None]
        by_warp = -moved[:, :, None] * flat[:, None, :] / below[:, None, None]
    ones = np.column_stack([pixels, np.ones(len(pixels))])
    by_matrix = np.einsum("nij,nk->nijk", by_flat, ones).reshape(len(pixels), 2, 6)
    return np.concatenate([by_matrix, by_warp], axis=2).reshape(-1, 8)


def _linearise(
    values: Parameters, pixels: PixelPoints, film: FilmPoints, shift: Warp, *, model: str
) -> tuple[Equations, Matrix]:
    """Residuals, and slopes by the matrix of centred pixels and the warp."""
    matrix, warp = values[:6].reshape(2, 3), values[6:]
    flat = pixels @ matrix[:, :2].T + matrix[:, 2]
    residual = (warp_film(flat, warp, model) - film).ravel()
    centred = matrix.copy()
    centred[:, 2] += matrix[:, :2] @ shift
    return residual, film_slopes(pixels - shift, centred, warp, model)


def _undo_centring(change: Parameters, shift: Warp) -> Parameters:
    """A change of the matrix for centred pixels as one for pixels."""
    result = change.copy()
    for row in (0, 3):
        result[row + 2] -= change[row : row + 2] @ shift
    return result


def _free_directions(model: FilmModel, mirrored: bool) -> Matrix:
    """8 x parameters: which changes of matrix and warp a model allows."""
    if model == "similarity":
        free = np.zeros((8, 4))
        sign = 1.0 if mirrored else -1.0
        free[0, 0], free[4, 0] = 1.0, sign
        free[1, 1], free[3, 1] = 1.0, -sign
        free[2, 2] = free[5, 3] = 1.0
        return free
    return np.eye(8)[:, : PARAMETERS[model]]


def _units(free: Matrix, spread: float, film: FilmPoints) -> Parameters:
    """Size of each free parameter that moves a film point by about a millimetre."""
    reach = float(np.abs(film).max()) or 1.0
    rows = np.array([1 / spread, 1 / spread, 1.0, 1 / spread, 1 / spread, 1.0, 1.0, 1.0])
    rows[6:] = 1 / reach**2
    return np.array([rows[np.flatnonzero(column)[0]] for column in free.T])
