"""Collars: the constant black or white margin that slanted orthos carry without saying nodata."""

from dataclasses import dataclass

import numpy as np
import rasterio
from jaxtyping import Bool, Num
from scipy import ndimage

from core.arrays import Mask, locked
from core.reference.gaps import labelled

CORNER_PX = 8
"""A corner this large, black or white in every band, makes a collar suspected."""
NOISE = 3
"""Gray values a lossy collar wanders from pure black or white."""
REDUCED_PX = 1024
"""The collar's shape is found on a reduction of the sheet to at most this size."""


@dataclass(frozen=True, slots=True, eq=False)
class Collar:
    """Where the margin may lie, roughly; the pixels themselves decide within."""

    value: float
    """Gray value of the margin."""
    reduced: Mask
    """True where a cell of the reduced sheet may hold collar."""
    columns: int
    """Width of the sheet, pixels."""
    rows: int
    """Height of the sheet, pixels."""

    def within(self, values: Num[np.ndarray, "bands rows columns"], column: int, row: int) -> Mask:
        """Which pixels of a window, that begins at this column and row, belong to the collar."""
        height, width = values.shape[1:]
        down = (np.arange(row, row + height) * self.reduced.shape[0]) // self.rows
        across = (np.arange(column, column + width) * self.reduced.shape[1]) // self.columns
        flat = np.all(np.abs(values.astype(np.int16) - self.value) <= NOISE, axis=0)
        flat &= self.reduced[np.ix_(down, across)]
        # The kernel of a lossy codec smears picture and collar into each other.
        return ndimage.binary_dilation(flat, iterations=2) if flat.any() else flat


def detect_collar(raster: rasterio.DatasetReader, bands: tuple[int, ...]) -> Collar | None:
    """Find a black or white margin that reaches a corner of an 8-bit sheet; None without one."""
    if any(raster.dtypes[band - 1] != "uint8" for band in bands):
        return None
    value = _corner_value(raster, bands)
    if value is None:
        return None
    shape = (min(raster.height, REDUCED_PX), min(raster.width, REDUCED_PX))
    reduced = raster.read(list(bands), out_shape=(len(bands), *shape))
    flat = np.all(np.abs(reduced.astype(np.int16) - value) <= NOISE, axis=0)
    margin = _touching_edge(flat)
    if not margin.any():
        return None
    reach = ndimage.binary_dilation(margin, structure=np.ones((3, 3)), iterations=2)
    return Collar(value, locked(reach, bool), raster.width, raster.height)


def _corner_value(raster: rasterio.DatasetReader, bands: tuple[int, ...]) -> float | None:
    """0 or 255 where a corner of the sheet is nothing but that."""
    width, height = min(CORNER_PX, raster.width), min(CORNER_PX, raster.height)
    for column in (0, raster.width - width):
        for row in (0, raster.height - height):
            window = ((row, row + height), (column, column + width))
            corner = raster.read(list(bands), window=window).astype(np.int16)
            for value in (0.0, 255.0):
                if np.all(np.abs(corner - value) <= NOISE):
                    return value
    return None


def _touching_edge(flat: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows columns"]:
    """The connected parts that reach the sheet's edge over a length no shadow has."""
    labels, count = labelled(flat)
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    lengths = np.bincount(edge, minlength=count + 1)
    wanted = np.flatnonzero(lengths >= max(3, min(flat.shape) // 200))
    return np.isin(labels, wanted[wanted > 0])
