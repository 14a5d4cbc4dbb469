"""Interior orientation: pixel <-> film of one scan, with the residual of every fiducial."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.arrays import Affine2, FilmPoints, PixelPoints, Scalars, locked

InteriorModel = Literal["similarity", "affine", "nominal"]


@dataclass(frozen=True, slots=True, eq=False)
class InteriorOrientation:
    """The transform of one scan; nothing is resampled or cropped, measurements stay in pixels."""

    model: InteriorModel
    """`nominal` where no fiducials are known: scan middle and scan pixel size."""
    film_from_pixel_matrix: Affine2
    """2 x 3: film mm from pixel (column, row)."""
    names: tuple[str, ...]
    """Names of the fiducials that were used, in the order of the arrays below."""
    pixels: PixelPoints
    """Where the fiducials were measured, pixels."""
    residuals_um: FilmPoints
    """Residual of each fiducial on the film (x, y), computed minus certified, micrometres."""
    sigma_um: float
    """A-posteriori sigma of one film coordinate, micrometres; NaN without redundancy."""

    def __post_init__(self) -> None:
        for name in ("film_from_pixel_matrix", "pixels", "residuals_um"):
            object.__setattr__(self, name, locked(getattr(self, name)))

    def film_from_pixel(self, pixels: PixelPoints) -> FilmPoints:
        """Film points in millimetres of scan pixels."""
        matrix = self.film_from_pixel_matrix
        return pixels @ matrix[:, :2].T + matrix[:, 2]

    def pixel_from_film(self, film: FilmPoints) -> PixelPoints:
        """Scan pixels of film points in millimetres."""
        matrix = self.film_from_pixel_matrix
        return np.linalg.solve(matrix[:, :2], (film - matrix[:, 2]).T).T

    @property
    def pixel_size_mm(self) -> float:
        """Mean size of a scan pixel on the film, millimetres."""
        return float(np.sqrt(abs(np.linalg.det(self.film_from_pixel_matrix[:, :2]))))

    @property
    def rms_um(self) -> float:
        """Root mean square of the fiducial residuals per coordinate, micrometres (0 if none)."""
        return float(np.sqrt(np.mean(self.residuals_um**2))) if len(self.names) else 0.0

    def residual_lengths_um(self) -> Scalars:
        """Length of each fiducial's residual, micrometres."""
        return np.linalg.norm(self.residuals_um, axis=1)
