"""Decks of bridges: polygons with heights, which replace the DEM under them.

A DEM shows the ground below a bridge. Rectified on it the bridge lies aside of its place, by its
height times the distance from the nadir over the flying height.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float64
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from shapely.geometry import Polygon, box

from core.arrays import Matrix, ObjectPoints, Scalars
from core.errors import ReferenceDataError
from core.formats.vectors import read_layers
from core.geometry.crs import Bounds, read_crs
from core.orthos.scan_places import Heights
from core.raster.grid import Grid

# design: above it are a handful of bridges of the world, in the middle of their decks; feet taken
# for metres are told from 175 m on. Decks at a dam or quay lie a little below a coarse DEM.
LOWEST_M, HIGHEST_M = -10.0, 400.0
"""Every corner of a deck lies so far above the DEM."""
# design: no bridge is smaller; what overlays of layers leave is.
LEAST_AREA_M2 = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Deck:
    """One deck."""

    outline: Polygon
    """In plan."""
    vertices: ObjectPoints
    """Its corners with their heights, metres."""

    def heights(self, plan: Float64[np.ndarray, "n 2"]) -> Scalars:
        """Heights of places on it: linear between its corners."""
        corners, heights = self.vertices[:, :2], self.vertices[:, 2]
        between: Scalars = LinearNDInterpolator(corners, heights)(plan)
        # A place on the outline may be outside by rounding.
        return np.where(
            np.isfinite(between), between, NearestNDInterpolator(corners, heights)(plan)
        )


@dataclass(frozen=True, slots=True, eq=False)
class BridgedHeights:
    """Ground with decks over it: what is seen from above."""

    ground: Heights
    """The DEM, corrected or not."""
    decks: tuple[Deck, ...]
    """Bridges; where several lie over each other the highest is seen."""

    @property
    def ground_sample_distance_m(self) -> float:
        """Nought: decks have sharp edges, so that no place may be interpolated from others."""
        return 0.0

    def around(self, bounds: Bounds) -> Heights:
        """The same for a part; the ground alone where no bridge is near."""
        near = box(*bounds)
        decks = tuple(deck for deck in self.decks if deck.outline.intersects(near))
        return BridgedHeights(self.ground, decks) if decks else self.ground

    def heights(self, points: Float64[np.ndarray, "n 2"]) -> Scalars:
        """Heights at easting and northing, metres; NaN where the DEM has none and no deck is."""
        return self._with_decks(points, self.ground.heights(points))

    def on(self, grid: Grid) -> Matrix:
        """Heights at the pixel centres of a grid, metres; NaN likewise."""
        east, north = np.meshgrid(*grid.centres())
        points = np.column_stack([east.ravel(), north.ravel()])
        heights = self._with_decks(points, self.ground.on(grid).ravel())
        return heights.reshape(grid.rows, grid.columns)

    def _with_decks(self, points: Float64[np.ndarray, "n 2"], ground: Scalars) -> Scalars:
        top = np.full(len(points), np.nan)
        for deck in self.decks:
            on = np.flatnonzero(shapely.intersects_xy(deck.outline, points[:, 0], points[:, 1]))
            top[on] = np.fmax(top[on], deck.heights(points[on]))
        return np.where(np.isfinite(top), top, ground)


def with_bridges(ground: Heights, file: Path, crs: str, bounds: Bounds) -> Heights:
    """Heights with the bridges of a file over them; polygons without heights replace nothing.

    Args:
        ground: The DEM, corrected or not.
        file: Polygons of any vector format, with heights in the block's height system.
        crs: The block's CRS.
        bounds: The block's ground, metres.

    Raises:
        ReferenceDataError: The file cannot be read, or its heights do not fit the DEM.
    """
    decks = tuple(_read_decks(file, crs, bounds))
    _check(decks, ground, file)
    return BridgedHeights(ground, decks) if decks else ground


def _read_decks(file: Path, crs: str, bounds: Bounds) -> list[Deck]:
    found: list[Deck] = []
    for layer in read_layers(
        file, read_crs(crs, "block.toml"), bounds, attributes=False, heights=True
    ):
        for part in shapely.get_parts(layer.geometries):
            vertices = shapely.get_coordinates(part, include_z=True)
            solid = isinstance(part, Polygon) and part.area >= LEAST_AREA_M2
            if solid and np.isfinite(vertices).all():
                outline = shapely.make_valid(shapely.force_2d(part))
                found += [
                    Deck(piece, vertices)
                    for piece in shapely.get_parts(outline)
                    if isinstance(piece, Polygon) and piece.area >= LEAST_AREA_M2
                ]
    return found


def _check(decks: Sequence[Deck], ground: Heights, file: Path) -> None:
    """Refuse heights of another system or unit."""
    for deck in decks:
        above = deck.vertices[:, 2] - ground.heights(deck.vertices[:, :2])
        wrong = np.flatnonzero((above < LOWEST_M) | (above > HIGHEST_M))
        if len(wrong):
            east, north = deck.vertices[wrong[0], :2].tolist()
            raise ReferenceDataError(
                file,
                "a corner of a bridge, at E {east:.0f} N {north:.0f}, lies {above:.0f} m above "
                "the DEM.",
                "Give its corners heights in the block's height system, in metres, or leave the "
                "heights out.",
                east=east,
                north=north,
                above=float(above[wrong[0]]),
            )
