"""Control measurements of an adjusted block as one system, to be weighted anew in closed form."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from core.arrays import Indices
from core.block.block import Measurement


@dataclass(frozen=True, slots=True, eq=False)
class ControlSystem:
    """Control measurements as observations of photos and cameras, points eliminated.

    Two rows a measurement. Their hat matrix is A Q A^T and, within a point, W W^T besides.
    """

    measurements: list[Measurement]
    """Those that take part."""
    point: Int[np.ndarray, "rays"]
    """Point of each, by number."""
    rows: Float64[np.ndarray, "rows unknowns"]
    """A."""
    columns: Float64[np.ndarray, "unknowns rows"]
    """Q A^T."""
    whitened: Float64[np.ndarray, "rows 3"]
    """W."""
    residuals: Float64[np.ndarray, "rays 2"]
    """Computed minus measured, in standard deviations."""

    def hat(self, chosen: Indices) -> Float64[np.ndarray, "two_n rows"]:
        """Rows of the hat matrix of some measurements."""
        at = (2 * chosen[:, None] + np.arange(2)).ravel()
        same = np.repeat(self.point[chosen], 2)[:, None] == np.repeat(self.point, 2)
        shared = self.whitened[at] @ self.whitened.T
        return self.rows[at] @ self.columns + np.where(same, shared, 0.0)

    def own(self) -> Float64[np.ndarray, "rays 2 2"]:
        """The block of every measurement on the hat matrix's diagonal."""
        count = len(self.measurements)
        pairs = self.rows.reshape(count, 2, -1)
        by_ray = self.columns.T.reshape(count, 2, -1)
        shared = self.whitened.reshape(count, 2, 3)
        return pairs @ np.swapaxes(by_ray, 1, 2) + shared @ np.swapaxes(shared, 1, 2)
