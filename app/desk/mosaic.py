"""The mosaic on disk, as the desk shows it: what was made, and its pictures by version."""

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from core.geometry.crs import Bounds
from core.mosaic.composition import MosaicProduct
from core.raster.grid import Grid
from core.raster.ortho import Ortho, open_ortho
from sessions.session import Session
from ui.review.state import ShownMosaic
from ui.review.tiles import Colour, OrthoSource, Stretch, fit_stretch

SMALL_PX = 512
"""Longer side of the picture from which black and white of a 16-bit mosaic are learnt, pixels."""
WHITE = 255
"""Largest gray value that a screen shows."""


def mosaic_on_disk(session: Session) -> ShownMosaic | None:
    """The mosaic that was made last; None where there is none, or its file was taken away."""
    product = cast("MosaicProduct | None", session.products.latest_value("mosaic"))
    path = session.results / "mosaic.tif"
    if product is None or not path.is_file():
        return None
    return ShownMosaic(product, path.stat().st_mtime_ns // 1_000_000)


class MosaicFile:
    """Opens the mosaic anew whenever another version is asked for; from any thread."""

    def __init__(self, path: Path, crs: str) -> None:
        self._path, self._crs = path, crs
        self._opened: tuple[int, OrthoSource] | None = None

    def __call__(self, version: int) -> OrthoSource | None:
        """Colours of the mosaic on any grid; None without a file.

        Raises:
            ReferenceDataError: The file is damaged.
        """
        opened = self._opened
        if opened is not None and opened[0] == version:
            return opened[1]
        if not self._path.is_file():
            return None
        source = with_screen_grays(open_ortho([self._path], self._crs))
        self._opened = version, source
        return source


def with_screen_grays(mosaic: Ortho) -> OrthoSource:
    """The mosaic itself where its grays are those of a screen, else brought to them."""
    west, south, east, north = mosaic.bounds
    pixel = max((east - west) / SMALL_PX, (north - south) / SMALL_PX)
    small = mosaic.read(Grid.over(mosaic.bounds, max(pixel, mosaic.ground_sample_distance_m)))
    values = small.values[small.mask]
    if not values.size or float(values.max()) <= WHITE:
        return mosaic
    return Stretched(mosaic, fit_stretch(values[None], margin=0))


@dataclass(frozen=True, slots=True, eq=False)
class Stretched:
    """A mosaic of 16 bit in the grays of a screen."""

    mosaic: Ortho
    """The file."""
    stretch: Stretch
    """Grays shown as black and as white."""

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north, metres."""
        return self.mosaic.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        """Finest pixel, metres."""
        return self.mosaic.ground_sample_distance_m

    def read_colour(self, grid: Grid) -> Colour:
        """Grays as colours on a grid, black only where the mosaic shows nothing."""
        patch = self.mosaic.read(grid)
        shown = np.clip(np.rint(self.stretch.applied(patch.values)), 1, WHITE)
        gray = np.where(patch.mask, shown, 0).astype(np.uint8)
        return np.repeat(gray[:, :, None], 3, axis=2)
