"""Plane transforms between point fields: similarity, affine and projectivity, fitted and judged."""

from dataclasses import dataclass
from typing import Literal, cast

import cv2
import numpy as np
from jaxtyping import Float64

from core.arrays import Affine2, Matrix, Rotation, Scalars, locked
from core.doubts import Failure
from core.said import say

PlanePoints = Float64[np.ndarray, "n 2"]
"""Points of any plane frame."""
Place = Float64[np.ndarray, "2"]
"""One point of any plane frame."""
TransformModel = Literal["similarity", "affine"]
# source: definition of the models.
PARAMETERS: dict[str, int] = {"similarity": 4, "affine": 6, "projective": 8, "bilinear": 8}
# design: far above rounding, far below any set of points that is used.
MIN_SPREAD = 1e-6
"""Smallest singular value of a design relative to its largest before it counts as degenerate."""
Projectivity = Float64[np.ndarray, "3 3"]
"""Homogeneous matrix, target from source."""


@dataclass(frozen=True, slots=True, eq=False)
class PlaneTransform:
    """A plane transform fitted by least squares, with every figure that judges it."""

    model: TransformModel
    """Four or six parameters."""
    matrix: Affine2
    """target = matrix[:, :2] @ source + matrix[:, 2]."""
    residuals: PlanePoints
    """Computed minus given, one row per point, units of the target."""
    sigma: float
    """A-posteriori standard deviation of one target coordinate; NaN without redundancy."""

    def __post_init__(self) -> None:
        for name in ("matrix", "residuals"):
            object.__setattr__(self, name, locked(getattr(self, name)))

    @property
    def rms(self) -> float:
        """Root mean square residual per coordinate, units of the target."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def scale(self) -> float:
        """Mean scale: square root of the absolute determinant."""
        return float(np.sqrt(abs(np.linalg.det(self.matrix[:, :2]))))


def fit_similarity(
    source: PlanePoints, target: PlanePoints, mirrored: bool = False
) -> PlaneTransform | Failure:
    """Fit X = a x - b y + X0, Y = b x + a y + Y0 by least squares (METHODS 1.6).

    Args:
        source: Points of the source frame.
        target: The same points in the target frame.
        mirrored: True when one of the two frames counts its second axis downwards (pixel to film
            or to object): X = a x + b y + X0, Y = b x - a y + Y0.

    Returns:
        The transform, or a failure with fewer than two distinct points.
    """
    return _fit(source, target, "similarity", mirrored)


def fit_affine(source: PlanePoints, target: PlanePoints) -> PlaneTransform | Failure:
    """Fit X = a x + b y + X0, Y = d x + e y + Y0 by least squares; three points not in a line."""
    return _fit(source, target, "affine", mirrored=False)


def apply_affine(matrix: Affine2, points: PlanePoints) -> PlanePoints:
    """Transform points by a 2 x 3 matrix."""
    return points @ matrix[:, :2].T + matrix[:, 2]


def invert_affine(matrix: Affine2) -> Affine2:
    """The transform that leads back."""
    inverse = np.linalg.inv(matrix[:, :2])
    return np.column_stack([inverse, -inverse @ matrix[:, 2]])


def compose_affine(outer: Affine2, inner: Affine2) -> Affine2:
    """The transform that applies `inner` first and `outer` on its result."""
    return np.column_stack([outer[:, :2] @ inner[:, :2], outer[:, :2] @ inner[:, 2] + outer[:, 2]])


def rotation_and_scale(matrix: Affine2, mirrored: bool = False) -> tuple[float, float]:
    """Rotation (radians, counter-clockwise) and scale of a transform's similarity part.

    The similarity nearest in least squares; the angle by the two-argument arctangent.
    """
    (a, b), (d, e) = matrix[:, :2] * np.array([1.0, -1.0 if mirrored else 1.0])
    cosine, sine = (a + e) / 2, (d - b) / 2
    return float(np.arctan2(sine, cosine)), float(np.hypot(cosine, sine))


def _fit(
    source: PlanePoints, target: PlanePoints, model: TransformModel, mirrored: bool
) -> PlaneTransform | Failure:
    """Least squares by singular values on centred, scaled points, brought back afterwards."""
    unknowns = PARAMETERS[model]
    if 2 * len(source) < unknowns:
        return Failure(
            say(
                "{count} points are too few for a {model} transform.",
                count=len(source),
                model=model,
            ),
            {"points": len(source)},
        )
    shift, spread = _normalisation(source)
    centred = (source - shift) / spread
    design = _design(centred, model, mirrored)
    left, singular, right = np.linalg.svd(design, full_matrices=False)
    if singular[-1] < MIN_SPREAD * singular[0]:
        return Failure(
            say(
                "The {count} points coincide or lie in one line: no {model} transform.",
                count=len(source),
                model=model,
            ),
            {"singular_values": singular.tolist()},
        )
    aim = target.mean(axis=0)
    parameters = right.T @ ((left.T @ (target - aim).ravel()) / singular)
    back = _matrix_from_parameters(model, mirrored, shift, spread)
    matrix = (back @ parameters).reshape(2, 3)
    matrix[:, 2] += aim
    residuals = (design @ parameters).reshape(-1, 2) - (target - aim)
    redundancy = 2 * len(source) - unknowns
    variance = float(np.sum(residuals**2)) / redundancy if redundancy else np.nan
    return PlaneTransform(model, matrix, residuals, float(np.sqrt(variance)))


def _normalisation(points: PlanePoints) -> tuple[Place, float]:
    """Mean of the points and their root mean square distance from it (1 if they coincide)."""
    shift = points.mean(axis=0)
    spread = float(np.sqrt(np.mean((points - shift) ** 2)))
    return shift, spread if spread > 0 else 1.0


def _design(points: PlanePoints, model: TransformModel, mirrored: bool) -> Matrix:
    """Design matrix, two rows per point; parameters as in `_matrix_from_parameters`."""
    x, y = points.T
    one, nought = np.ones_like(x), np.zeros_like(x)
    if model == "affine":
        rows = ([x, y, one, nought, nought, nought], [nought, nought, nought, x, y, one])
    else:
        sign = -1.0 if mirrored else 1.0
        rows = ([x, -sign * y, one, nought], [sign * y, x, nought, one])
    return np.stack(rows).transpose(2, 0, 1).reshape(2 * len(x), -1)


def _matrix_from_parameters(
    model: TransformModel, mirrored: bool, shift: Place, spread: float
) -> Matrix:
    """6 x parameters: the 2 x 3 matrix, row by row, of parameters for normalised points."""
    if model == "affine":
        linear = np.eye(6)
    else:
        sign = -1.0 if mirrored else 1.0
        linear = np.zeros((6, 4))
        linear[0, 0] = linear[2, 2] = linear[3, 1] = linear[5, 3] = 1.0
        linear[1, 1], linear[4, 0] = -sign, sign
    undo = np.eye(6)
    for row in (0, 3):
        undo[row, row] = undo[row + 1, row + 1] = 1 / spread
        undo[row + 2, row : row + 2] = -shift / spread
    return undo @ linear


def fit_projectivity(source: PlanePoints, target: PlanePoints) -> Projectivity:
    """Projectivity with the least median of squares; a median shift where none can be found."""
    if 2 * len(source) >= PARAMETERS["projective"]:
        found = cast(Rotation | None, cv2.findHomography(source, target, cv2.LMEDS)[0])
        if found is not None and np.shape(found) == (3, 3):
            return np.asarray(found, dtype=np.float64)
    shift = np.eye(3)
    if len(source):
        shift[:2, 2] = np.median(target - source, axis=0)
    return shift


def apply_projectivity(matrix: Projectivity, points: PlanePoints) -> PlanePoints:
    """Where a projectivity puts points."""
    return (points @ matrix[:2, :2].T + matrix[:2, 2]) / _depth(matrix, points)[:, None]


def jacobians(matrix: Projectivity, points: PlanePoints) -> Float64[np.ndarray, "n 2 2"]:
    """Derivatives of a projectivity at points."""
    moved = apply_projectivity(matrix, points)
    rows = matrix[None, :2, :2] - moved[:, :, None] * matrix[None, 2:, :2]
    return rows / _depth(matrix, points)[:, None, None]


def _depth(matrix: Projectivity, points: PlanePoints) -> Scalars:
    """The third homogeneous coordinate."""
    return points @ matrix[2, :2] + matrix[2, 2]
