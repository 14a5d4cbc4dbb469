"""Symmetric positive definite systems with a band and a dense border, and parts of their inverse.

The band holds the photos (six unknowns each, ordered so that neighbours are near), the border the
few unknowns that all photos share.

3 x 3 blocks of points are factored apart, and photos ordered so that their band is narrow.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded, solve_triangular
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from core.arrays import Indices, Matrix

# source: three coordinates, three angles.
SIZE = 6
"""Unknowns of one photo."""

Band = Float64[np.ndarray, "diagonals unknowns"]
"""Lower band: row d holds the entries d below the diagonal."""
Border = Float64[np.ndarray, "unknowns shared"]
"""Coefficients between the band's unknowns and those of the border."""
Corner = Float64[np.ndarray, "shared shared"]
"""Coefficients between the border's unknowns."""
Tiles = Float64[np.ndarray, "tiles size size"]
"""Square parts of a large matrix."""
# design: every three degrees of half a turn.
DIRECTIONS = 60
"""Directions in plan, over half a turn, in which the block is swept."""
# design: about ten milliseconds: while SciPy solves a band, no other thread runs.
HELD_OPERATIONS = 25_000_000
"""Floating-point operations of one call."""

Ends = Int[np.ndarray, "pairs"]
"""One photo of each pair that shares points."""


@dataclass(frozen=True, slots=True, eq=False)
class BorderedFactor:
    """Cholesky factors of [[band, border], [border^T, corner]]."""

    lower: Band
    """Cholesky factor of the band."""
    carried: Border
    """Inverse of the band times the border."""
    corner: Corner
    """Lower Cholesky factor of the corner with the band eliminated."""

    @property
    def condition(self) -> float:
        """How near the photos' unknowns are to depending on each other, free of units; 1 is best.

        The largest ratio of a diagonal element to its pivot: by so much the other photos' unknowns
        increase the variance of one.
        """
        squares = self.lower**2
        diagonal = squares[0].copy()
        for below in range(1, len(squares)):
            diagonal[below:] += squares[below, : len(diagonal) - below]
        return float(np.max(diagonal / squares[0]))


def factor_bordered(band: Band, border: Border, corner: Corner) -> BorderedFactor:
    """Factor the system; raises `numpy.linalg.LinAlgError` where it is not positive definite."""
    lower = cholesky_banded(band, lower=True, check_finite=False)
    carried = cho_solve_banded((lower, True), border, check_finite=False)
    reduced, _ = cho_factor(corner - border.T @ carried, lower=True, check_finite=False)
    return BorderedFactor(lower, carried, reduced)


def solve_bordered(
    factor: BorderedFactor,
    band_side: Float64[np.ndarray, "unknowns"],
    corner_side: Float64[np.ndarray, "shared"],
) -> tuple[Float64[np.ndarray, "unknowns"], Float64[np.ndarray, "shared"]]:
    """Solve for one right-hand side: unknowns of the band, unknowns of the border."""
    band, shared = solve_bordered_many(factor, band_side[:, None], corner_side[:, None])
    return band[:, 0], shared[:, 0]


def solve_bordered_many(
    factor: BorderedFactor,
    band_side: Float64[np.ndarray, "unknowns sides"],
    corner_side: Float64[np.ndarray, "shared sides"],
) -> tuple[Float64[np.ndarray, "unknowns sides"], Float64[np.ndarray, "shared sides"]]:
    """Solve for many right-hand sides."""
    rest = corner_side - factor.carried.T @ band_side
    shared = cho_solve((factor.corner, True), rest, check_finite=False)
    return _solved(factor.lower, band_side) - factor.carried @ shared, shared


def _solved(
    lower: Band, sides: Float64[np.ndarray, "unknowns sides"]
) -> Float64[np.ndarray, "unknowns sides"]:
    """The band alone solved for some right-hand sides at a time."""
    count = max(1, HELD_OPERATIONS // (4 * lower.size))
    found = np.empty_like(sides)
    for first in range(0, sides.shape[1], count):
        some = slice(first, first + count)
        found[:, some] = cho_solve_banded((lower, True), sides[:, some], check_finite=False)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class BorderedInverse:
    """The inverse of a bordered system, as far as photos that share points need it."""

    tiles: Tiles
    """Square parts of the band's own inverse: those on the diagonal, then those left of them."""
    tile_photos: int
    """Photos of one tile."""
    carried: Border
    """Inverse of the band times the border."""
    corner: Corner
    """Covariance of the border's unknowns."""

    def pairs(self, first: Indices, second: Indices) -> Float64[np.ndarray, "n 6 6"]:
        """Cofactors of photos at two places of the band, no further apart than its width."""
        high, low = np.maximum(first, second), np.minimum(first, second)
        high_tile, low_tile = high // self.tile_photos, low // self.tile_photos
        count = (len(self.tiles) + 1) // 2
        tile = np.where(high_tile == low_tile, high_tile, count + low_tile)
        six = np.arange(SIZE)
        rows = (high - high_tile * self.tile_photos)[:, None] * SIZE + six
        columns = (low - low_tile * self.tile_photos)[:, None] * SIZE + six
        blocks = self.tiles[tile[:, None, None], rows[:, :, None], columns[:, None, :]]
        blocks = np.where((first >= second)[:, None, None], blocks, np.swapaxes(blocks, 1, 2))
        carried = self._carried_by_photo()
        return blocks + carried[first] @ self.corner @ np.swapaxes(carried[second], 1, 2)

    def with_border(self, photo: Indices) -> Float64[np.ndarray, "n 6 shared"]:
        """Cofactors between photos at places of the band and the border's unknowns."""
        return -self._carried_by_photo()[photo] @ self.corner

    def _carried_by_photo(self) -> Float64[np.ndarray, "photos 6 shared"]:
        unknowns, shared = self.carried.shape
        return self.carried.reshape(unknowns // SIZE, SIZE, shared)


@dataclass(frozen=True, slots=True, eq=False)
class DenseInverse:
    """A whole matrix of cofactors, asked like a `BorderedInverse`: photos stand in their order."""

    cofactors: Matrix
    """Of all photos' unknowns, then those of the border."""
    photos: int
    """Number of photos."""

    @property
    def corner(self) -> Corner:
        """Covariance of the border's unknowns."""
        return self.cofactors[SIZE * self.photos :, SIZE * self.photos :]

    def pairs(self, first: Indices, second: Indices) -> Float64[np.ndarray, "n 6 6"]:
        """Cofactors of any two photos."""
        band = self.cofactors[: SIZE * self.photos, : SIZE * self.photos]
        blocks = band.reshape(self.photos, SIZE, self.photos, SIZE)
        return np.ascontiguousarray(blocks[first, :, second, :])

    def with_border(self, photo: Indices) -> Float64[np.ndarray, "n 6 shared"]:
        """Cofactors between photos and the border's unknowns."""
        mixed = self.cofactors[: SIZE * self.photos, SIZE * self.photos :]
        return mixed.reshape(self.photos, SIZE, -1)[photo]


def invert_bordered(factor: BorderedFactor, reach: int) -> BorderedInverse:
    """The parts of the inverse within `reach` photos of the diagonal.

    Backward recursion on a block bidiagonal factor (Takahashi): with L_k the diagonal and M_k the
    part below it, Z_k = L_k^-T (I + M_k^T Z_k+1 M_k) L_k^-1 and Z_k+1,k = -Z_k+1 M_k L_k^-1.
    """
    unknowns = factor.lower.shape[1]
    tile_photos = min(max(reach, 1), unknowns // SIZE)
    size = tile_photos * SIZE
    starts = list(range(0, unknowns, size))
    tiles = np.zeros((2 * len(starts) - 1, size, size))
    below = np.zeros((0, 0))
    for index in reversed(range(len(starts))):
        start, stop = starts[index], min(starts[index] + size, unknowns)
        inverse = solve_triangular(
            _tile(factor.lower, start, stop, start), np.eye(stop - start), lower=True
        )
        middle = np.eye(stop - start)
        if len(below):
            link = _tile(factor.lower, stop, stop + len(below), start, stop)
            left = below @ link
            middle += link.T @ left
            tiles[len(starts) + index, : len(below), : stop - start] = -left @ inverse
        below = inverse.T @ middle @ inverse
        tiles[index, : stop - start, : stop - start] = below
    corner = cho_solve((factor.corner, True), np.eye(len(factor.corner)))
    return BorderedInverse(tiles, tile_photos, factor.carried, corner)


def _tile(lower: Band, first: int, last: int, left: int, right: int | None = None) -> Matrix:
    """Rows first..last and columns left..right of a banded factor as a dense matrix."""
    rows = np.arange(first, last)[:, None]
    columns = np.arange(left, last if right is None else right)[None, :]
    below = rows - columns
    inside = (below >= 0) & (below < len(lower))
    return np.where(
        inside, lower[np.where(inside, below, 0), np.broadcast_to(columns, below.shape)], 0.0
    )


def band_places(
    rows: Indices, columns: Indices, unknowns: int
) -> tuple[Int[np.ndarray, "n 6 6"], Float64[np.ndarray, "n 6 6"]]:
    """Where 6 x 6 blocks (place of their row and column photo, row >= column) go in a raveled band.

    Returns the flat index of every entry and a factor that is 0 for entries above the diagonal.
    """
    six = np.arange(SIZE)
    row = rows[:, None, None] * SIZE + six[None, :, None]
    column = columns[:, None, None] * SIZE + six[None, None, :]
    below = row - column
    return np.where(below >= 0, below, 0) * unknowns + column, (below >= 0).astype(np.float64)


def narrow_places(
    low: Ends, high: Ends, centres: Float64[np.ndarray, "photos 3"]
) -> Int[np.ndarray, "photos"]:
    """Where each photo stands, so that the farthest two that share points are near.

    Reverse Cuthill and McKee's order begins at a corner of the block and runs across it; photos one
    strip after the other, or swept in the best of some directions, often reach half as far.

    Args:
        low: One photo of each pair that shares points.
        high: The other.
        centres: Perspective centres, metres.

    Returns:
        Place of each photo.
    """
    photos = len(centres)
    ones = np.ones(len(low), dtype=np.int8)
    graph = csr_array((ones, (low, high)), shape=(photos, photos))
    best = np.arange(photos)
    farthest = _reach(best, low, high)
    angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    plan = centres[:, :2] - centres[:, :2].mean(axis=0)
    swept = plan @ np.stack([np.cos(angles), np.sin(angles)])
    sequences = [reverse_cuthill_mckee(csr_array(graph + graph.T), symmetric_mode=True)]
    sequences.extend(np.argsort(swept, axis=0, kind="stable").T)
    for sequence in sequences:
        place = np.empty(photos, dtype=np.int64)
        place[sequence] = np.arange(photos)
        reach = _reach(place, low, high)
        if reach < farthest:
            best, farthest = place, reach
    return best


def _reach(place: Int[np.ndarray, "photos"], low: Ends, high: Ends) -> int:
    return int(np.abs(place[low] - place[high]).max(initial=0))


def cholesky3(own: Float64[np.ndarray, "6 points"]) -> Float64[np.ndarray, "6 points"]:
    """Cholesky roots of many 3 x 3 matrices; a point nothing is known of gets infinite roots.

    An infinite root makes everything that is divided by it nought: such a point stays where it is.
    """
    a, b, c, d, e, f = own
    r00 = np.sqrt(np.where(a > 0, a, np.inf))
    r10, r20 = b / r00, d / r00
    rest = c - r10 * r10
    r11 = np.sqrt(np.where(rest > 0, rest, np.inf))
    r21 = (e - r20 * r10) / r11
    rest = f - r20 * r20 - r21 * r21
    r22 = np.sqrt(np.where(rest > 0, rest, np.inf))
    return np.stack([r00, r10, r11, r20, r21, r22])


def forward3(
    root: Float64[np.ndarray, "6 n"], side: Float64[np.ndarray, "3 n"]
) -> Float64[np.ndarray, "3 n"]:
    """L^-1 times a vector, for many at once."""
    x = side[0] / root[0]
    y = (side[1] - root[1] * x) / root[2]
    z = (side[2] - root[3] * x - root[4] * y) / root[5]
    return np.stack([x, y, z])


def backward3(
    root: Float64[np.ndarray, "6 n"], side: Float64[np.ndarray, "3 n"]
) -> Float64[np.ndarray, "3 n"]:
    """L^-T times a vector, for many at once."""
    z = side[2] / root[5]
    y = (side[1] - root[4] * z) / root[2]
    x = (side[0] - root[1] * y - root[3] * z) / root[0]
    return np.stack([x, y, z])
