"""The grid of a north-up raster product: where its pixels lie on the ground."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True, slots=True)
class Grid:
    """A north-up raster: row 0 at the top, square pixels."""

    west: float
    """Easting of the outer left edge, metres."""
    north: float
    """Northing of the outer top edge, metres."""
    ground_sample_distance_m: float
    """Size of a pixel on the ground, metres."""
    columns: int
    """Number of columns."""
    rows: int
    """Number of rows."""

    @staticmethod
    def over(bounds: tuple[float, float, float, float], ground_sample_distance_m: float) -> "Grid":
        """Smallest grid on multiples of the pixel size that covers west, south, east, north."""
        gsd = ground_sample_distance_m
        west, south = np.floor(bounds[0] / gsd + 1e-9), np.floor(bounds[1] / gsd + 1e-9)
        east, north = np.ceil(bounds[2] / gsd - 1e-9), np.ceil(bounds[3] / gsd - 1e-9)
        return Grid(
            float(west * gsd), float(north * gsd), gsd, int(east - west), int(north - south)
        )

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north, metres."""
        gsd = self.ground_sample_distance_m
        east, south = self.west + self.columns * gsd, self.north - self.rows * gsd
        return self.west, south, east, self.north

    @property
    def geotransform(self) -> tuple[float, float, float, float, float, float]:
        """GDAL geotransform: outer corner of the first pixel, x size, 0, north, 0, -y size."""
        gsd = self.ground_sample_distance_m
        return self.west, gsd, 0.0, self.north, 0.0, -gsd

    def window(self, column: int, row: int, columns: int, rows: int) -> "Grid":
        """A part of this grid."""
        gsd = self.ground_sample_distance_m
        return Grid(self.west + column * gsd, self.north - row * gsd, gsd, columns, rows)

    def object_from_grid(self, points: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """Easting and northing of grid points (column, row; the outer corner is (0, 0))."""
        gsd = self.ground_sample_distance_m
        return np.array([self.west, self.north]) + points * np.array([gsd, -gsd])

    def grid_from_object(self, points: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """Grid points (column, row) of easting and northing."""
        gsd = self.ground_sample_distance_m
        return (points - np.array([self.west, self.north])) / np.array([gsd, -gsd])

    def centres(self) -> tuple[Float64[np.ndarray, "columns"], Float64[np.ndarray, "rows"]]:
        """Eastings of the column centres and northings of the row centres, metres."""
        gsd = self.ground_sample_distance_m
        return (
            self.west + (np.arange(self.columns) + 0.5) * gsd,
            self.north - (np.arange(self.rows) + 0.5) * gsd,
        )
