"""Thinning: few tie points, well spread over every photo, with many rays and small deviations."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from core.arrays import Flags, Indices, PixelPoints
from core.block import Block, TiePoints
from core.ties.chains import common_rays, rays_per_point

GRUBER_SIDE = 3  # source: von Gruber's six places of a model, nine in a photo that two models share
"""Gruber areas along each side of the frame."""
CELLS = 8  # design: several cells to a Gruber area, several points to a cell
"""Cells along each side of the frame among which the rest is shared out."""


@dataclass(frozen=True, slots=True)
class ThinningOptions:
    """How many tie points a photo keeps, and where."""

    per_gruber_area: int = 3  # design: one may be wrong, and the other two show it
    """Points kept in each of the 3 x 3 areas of a photo, where there are as many."""
    per_pair: int = 15  # design: three to each of the five unknowns of a relative orientation
    """Points kept between two photos, where there are as many."""
    # design: time; deviations of the block shrink little beyond, the film's own errors not at all
    wanted: int = 250
    """A photo with this many points gets no more of its own."""
    most: int = 400  # design: time; a photo gets points that its neighbours want, up to this
    """No photo gets more, unless one of the guarantees above asks for it."""

    def times(self, factor: float) -> "ThinningOptions":
        """The same with more (or fewer) points."""
        counts = ("per_gruber_area", "per_pair", "wanted", "most")
        more = {name: int(np.ceil(getattr(self, name) * factor)) for name in counts}
        return replace(self, **more)


def thin_ties(
    block: Block,
    ties: TiePoints,
    options: ThinningOptions | None = None,
    reserve: Flags | None = None,
) -> Flags:
    """Which tie points stay (one flag per point).

    First the 3 x 3 Gruber areas of every photo are served, then every pair of photos, then cells
    of an 8 x 8 grid in rounds, one point per cell and round, until each photo has enough. Within
    each of these, points with more rays come first, then those measured best.
    """
    options = options or ThinningOptions()
    if ties.count == 0:
        return np.zeros(0, dtype=np.bool_)
    state = _State.of(block, ties, reserve)
    areas = frame_cells(block, ties, GRUBER_SIDE) + ties.photo * GRUBER_SIDE**2
    for area in _grouped(areas, ties.point):
        state.serve(area, options.per_gruber_area)
    for pair in _pairs_of(ties):
        state.serve(pair, options.per_pair)
    state.fill(options)
    return state.kept


def frame_cells(block: Block, ties: TiePoints, cells: int) -> Indices:
    """Cell of each ray in a grid over the camera's picture area, row by row from the top left."""
    found = np.zeros(len(ties.point), dtype=np.int64)
    for number, name in enumerate(ties.photo_ids):
        rays = np.flatnonzero(ties.photo == number)
        if len(rays):
            found[rays] = _cells_of(block, name, ties.pixels[rays], cells)
    return found


def _cells_of(block: Block, name: str, pixels: PixelPoints, cells: int) -> Indices:
    """Cells of pixels of one photo."""
    film = block.photos[name].interior.film_from_pixel(pixels)
    frame = np.array(block.camera_of(name).frame_mm)
    share = film / frame * np.array([1.0, -1.0]) + 0.5
    cell = np.clip(np.floor(share * cells).astype(np.int64), 0, cells - 1)
    return cell[:, 1] * cells + cell[:, 0]


@dataclass(slots=True)
class _State:
    """What has been kept while points are chosen; rays are padded with a place nobody counts."""

    order: Indices
    """Points in the order of merit."""
    rank: Indices
    """Place of each point in that order."""
    photos: np.ndarray
    """(points, rays) photos of each point."""
    cells: np.ndarray
    """(points, rays) cells of each point, numbered through all photos."""
    kept: Flags
    in_photo: np.ndarray
    in_cell: np.ndarray

    @staticmethod
    def of(block: Block, ties: TiePoints, reserve: Flags | None) -> "_State":
        """Nothing kept yet."""
        rays = rays_per_point(ties)
        worst = np.zeros(ties.count)
        np.maximum.at(worst, ties.point, ties.sigma_px)
        last = np.zeros(ties.count, dtype=np.bool_) if reserve is None else reserve
        order = np.lexsort((worst, -rays, last))
        rank = np.empty(ties.count, dtype=np.int64)
        rank[order] = np.arange(ties.count)
        per_photo, size = CELLS**2, len(ties.photo_ids)
        cell = frame_cells(block, ties, CELLS) + ties.photo * per_photo
        return _State(
            order,
            rank,
            _padded(ties.point, ties.photo, rays, size),
            _padded(ties.point, cell, rays, size * per_photo),
            np.zeros(ties.count, dtype=np.bool_),
            np.zeros(size + 1, dtype=np.int64),
            np.zeros(size * per_photo + 1, dtype=np.int64),
        )

    def serve(self, members: Indices, wanted: int) -> None:
        """Keep the best of a group until it has as many as wanted, from empty cells first."""
        missing = wanted - int(self.kept[members].sum())
        left = members[~self.kept[members]]
        left = left[np.argsort(self.rank[left])]
        for _ in range(min(missing, len(left))):
            best = int(np.argmin(self.in_cell[self.cells[left]].max(axis=1)))
            point = left[best]
            self.kept[point] = True
            np.add.at(self.in_photo, self.photos[point], 1)
            np.add.at(self.in_cell, self.cells[point], 1)
            self.in_photo[-1] = self.in_cell[-1] = 0
            left = np.delete(left, best)

    def fill(self, options: ThinningOptions) -> None:
        """Rounds over all points: one more per cell each time, until every photo has enough."""
        in_photo, in_cell = self.in_photo.tolist(), self.in_cell.tolist()
        nobody, nowhere = len(in_photo) - 1, len(in_cell) - 1
        left = [
            (point, _without(self.photos[point], nobody), _without(self.cells[point], nowhere))
            for point in self.order[~self.kept[self.order]].tolist()
        ]
        for quota in range(1, options.wanted + 1):
            waiting: list[tuple[int, list[int], list[int]]] = []
            for entry in left:
                point, photos, cells = entry
                if max(in_photo[photo] for photo in photos) >= options.most:
                    continue
                wanting = [
                    cell
                    for photo, cell in zip(photos, cells, strict=True)
                    if in_photo[photo] < options.wanted
                ]
                if not wanting:
                    continue
                if min(in_cell[cell] for cell in wanting) >= quota:
                    waiting.append(entry)
                    continue
                self.kept[point] = True
                for photo, cell in zip(photos, cells, strict=True):
                    in_photo[photo] += 1
                    in_cell[cell] += 1
            left = waiting


def _without(values: Indices, padding: int) -> list[int]:
    """Values without the padding."""
    return [value for value in values.tolist() if value != padding]


def _padded(point: Indices, values: Indices, rays: np.ndarray, padding: int) -> np.ndarray:
    """(points, most rays) values of each point's rays."""
    order = np.argsort(point, kind="stable")
    starts = np.cumsum(rays) - rays
    table = np.full((len(rays), int(rays.max())), padding, dtype=np.int64)
    table[point[order], np.arange(len(point)) - starts[point[order]]] = values[order]
    return table


def _grouped(groups: Indices, points: Indices) -> list[np.ndarray]:
    """Points of each group, in the order of the groups."""
    order = np.lexsort((points, groups))
    _, starts = np.unique(groups[order], return_index=True)
    return np.split(points[order], starts[1:])


def _pairs_of(ties: TiePoints) -> list[np.ndarray]:
    """Points of each pair of photos, in the order of the pairs."""
    shown = [common_rays(ties, *pair)[0] for pair in combinations(range(len(ties.photo_ids)), 2)]
    return [ties.point[rays] for rays in shown if len(rays)]
