"""Search of a picture, projected to the ground, on the reference over all rotations and scales.

Doubled gradient angles are compared by FFT (METHODS 3): they do not depend on which of two
neighbours is brighter, which changes with the season and the film.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Complex64, Float32
from scipy import fft

from core.arrays import Mask, PlanPosition
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles
from core.matching.operators import doubled_angle_field
from core.matching.patches import filled
from core.matching.peaks import Image, ScoreMap, highest_places, level_and_spread
from core.raster.grid import Grid
from core.raster.ortho import Ortho

AngleField = Complex64[np.ndarray, "rows columns"]
"""Doubled gradient angles as complex numbers, 0 where nothing is known."""
# design: a photo covers two fifths of a grid that holds it however it is turned; an eighth of that
# is no picture.
LEAST_COVER = 0.05
"""A trial whose picture fills less of its grid than this says nothing."""
# design: far below the likeness by chance, above rounding.
NOTHING = 1e-6
"""Likeness no better than this is that of blank ground."""
# design: half the width of a peak at this coarseness, whose edges span two or three pixels.
APART_PX = 4
"""Two shifts of one turn and scale are further apart than this in one direction."""


@dataclass(frozen=True, slots=True)
class Turn:
    """One hypothesis: turn about the middle, scale, then shift, on the ground."""

    kappa: float
    """Turn, radians, counter-clockwise."""
    scale: float
    """Scale of the ground distances."""
    east_m: float = 0.0
    """Shift to the east, metres."""
    north_m: float = 0.0
    """Shift to the north, metres."""
    score: float = 0.0
    """Similarity, up to 1."""
    z: float = 0.0
    """Height of the similarity above that of other places in robust standard deviations."""

    def near(self, other: "Turn", width_m: float) -> bool:
        """Whether two put a picture of a width to about the same place, whatever their scale."""
        shift = np.hypot(self.east_m - other.east_m, self.north_m - other.north_m)
        turned = abs(np.angle(np.exp(1j * (self.kappa - other.kappa))))
        # design: nearer ones lead the coarse pass, which searches up to 120 of 1,400 px, to one
        # place; a tenth of a radian moves the rim by a twentieth of the width.
        return bool(shift <= 0.05 * width_m and turned <= 0.1)

    def moved(
        self, exterior: ExteriorOrientation, about: PlanPosition, ground_height_m: float
    ) -> ExteriorOrientation:
        """A camera carried along: turned and scaled about a place on the ground, then shifted."""
        turn = rotation_from_angles(0.0, 0.0, self.kappa)
        arm = exterior.centre - np.array([*about, ground_height_m])
        shift = np.array([self.east_m, self.north_m, 0.0])
        centre = np.array([*about, ground_height_m]) + self.scale * (turn @ arm) + shift
        return ExteriorOrientation(
            np.asarray(centre), *angles_from_rotation(turn @ exterior.object_from_image)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """A picture on a square ground grid about its middle."""

    grid: Grid
    """Where its pixels lie."""
    field: AngleField
    """Doubled gradient angles."""
    mask: Mask
    """Where it shows ground."""

    @property
    def half_m(self) -> float:
        """Half its longer side, metres."""
        return max(self.grid.columns, self.grid.rows) * self.grid.ground_sample_distance_m / 2


def square_about(about: PlanPosition, reach_m: float, gsd_m: float) -> Grid:
    """The square about a place, to so many metres on every side; the place is a pixel's centre."""
    side = 2 * int(np.ceil(reach_m / gsd_m)) + 1
    west, north = float(about[0]) - side * gsd_m / 2, float(about[1]) + side * gsd_m / 2
    return Grid(west, north, gsd_m, side, side)


@dataclass(frozen=True, slots=True, eq=False)
class Backdrop:
    """The reference about a picture, read once for all searches."""

    grid: Grid
    """Where its pixels lie."""
    values: Image
    """Grey values."""
    mask: Mask
    """Where the reference shows ground."""

    @staticmethod
    def read(ortho: Ortho, about: PlanPosition, reach_m: float, gsd_m: float) -> "Backdrop":
        """The square about a place, to so many metres on every side."""
        grid = square_about(about, reach_m, gsd_m)
        patch = ortho.read(grid)
        return Backdrop(grid, patch.values, patch.mask)

    def coarser(self, factor: int) -> "Backdrop":
        """Means of so many pixels a side; known where most of them are."""
        gsd, side = self.grid.ground_sample_distance_m * factor, self.grid.columns // factor
        whole = slice(0, side * factor)
        size = (side, side)
        inside = self.mask[whole, whole].astype(np.float32)
        share = cv2.resize(inside, size, interpolation=cv2.INTER_AREA)
        known = np.where(inside > 0, self.values[whole, whole], 0).astype(np.float32)
        # design: keeps the division finite where nothing is known.
        mean = cv2.resize(known, size, interpolation=cv2.INTER_AREA) / np.maximum(share, 1e-6)
        grid = Grid(self.grid.west, self.grid.north, gsd, side, side)
        return Backdrop(grid, np.asarray(mean, np.float32), np.asarray(share) > 0.5)

    def cut(self, grid: Grid) -> "Backdrop":
        """The part nearest to a grid of the same pixel size; nothing is known beyond the rim."""
        gsd = grid.ground_sample_distance_m
        left = round((grid.west - self.grid.west) / gsd)
        top = round((self.grid.north - grid.north) / gsd)
        values = np.zeros((grid.rows, grid.columns), np.float32)
        mask = np.zeros((grid.rows, grid.columns), bool)
        down = slice(max(top, 0), min(top + grid.rows, self.grid.rows))
        along = slice(max(left, 0), min(left + grid.columns, self.grid.columns))
        if down.stop > down.start and along.stop > along.start:
            into = (
                slice(down.start - top, down.stop - top),
                slice(along.start - left, along.stop - left),
            )
            values[into], mask[into] = self.values[down, along], self.mask[down, along]
        west, north = self.grid.west + left * gsd, self.grid.north - top * gsd
        return Backdrop(Grid(west, north, gsd, grid.columns, grid.rows), values, mask)


class Level:
    """A laid picture and the reference about it at one ground sample distance."""

    def __init__(self, laid: Laid, backdrop: Backdrop, start: Turn, radius_m: float) -> None:
        """Cut the reference.

        Args:
            laid: The picture.
            backdrop: The reference, of the same pixel size.
            start: Where the shifts are counted from.
            radius_m: Largest shift that is tried.
        """
        self.laid = laid
        self.gsd_m = laid.grid.ground_sample_distance_m
        self.radius_px = round(radius_m / self.gsd_m)
        wanted = shifted_grid(laid.grid, start, self.radius_px)
        patch = backdrop.cut(wanted)
        self.east_m = start.east_m + patch.grid.west - wanted.west
        self.north_m = start.north_m + patch.grid.north - wanted.north
        field = angle_field(filled(patch.values, patch.mask), patch.mask)
        fast: Any = [fft.next_fast_len(side, real=True) for side in field.shape]
        self.shape: tuple[int, int] = (fast[0], fast[1])
        self.field = [spectrum(part(field), self.shape) for part in (np.real, np.imag)]
        self.energy = spectrum(np.abs(field) ** 2, self.shape)

    def peaks(self, kappa: float, scale: float, count: int) -> list[Turn]:
        """The best shifts of one turn and scale, none where the picture or the ground is blank."""
        template, mask = turned(self.laid, kappa, scale)
        if mask.mean() < LEAST_COVER or not template.any():
            return []
        surface = self.similarity(template, mask)
        if float(np.max(surface)) <= NOTHING:
            return []
        middle, spread = level_and_spread(surface)
        found: list[Turn] = []
        for row, column in highest_places(surface, count, APART_PX):
            value = float(surface[row, column])
            east = self.east_m + (column - self.radius_px) * self.gsd_m
            north = self.north_m - (row - self.radius_px) * self.gsd_m
            found.append(Turn(kappa, scale, east, north, value, (value - middle) / spread))
        return found

    def similarity(self, template: AngleField, mask: Mask) -> ScoreMap:
        """Normalised correlation of doubled angles at every shift within the radius."""
        reach = 2 * self.radius_px + 1
        product = self.field[0] * np.conj(spectrum(np.real(template), self.shape))
        product += self.field[1] * np.conj(spectrum(np.imag(template), self.shape))
        common = corner(product, self.shape, reach)
        covered = np.conj(spectrum(mask.astype(np.float32), self.shape))
        under = corner(self.energy * covered, self.shape, reach)
        own = float(np.sum(np.abs(template) ** 2))
        # design: three tenths of the greatest energy; without a floor blank ground and the rim
        # would look alike to anything.
        under = np.maximum(under, 0.3 * float(np.max(under)) + 1e-6)
        return np.asarray(common / np.sqrt(own * under), np.float32)

    def search(
        self,
        trials: Sequence[tuple[float, float]],
        count: int = 1,
        mapper: Callable[..., Iterable[list[Turn]]] = map,
    ) -> list[Turn]:
        """The best shifts of each of many turns and scales, in their order."""
        found = mapper(lambda trial: self.peaks(trial[0], trial[1], count), trials)
        return [turn for turns in found for turn in turns]


def turned(laid: Laid, kappa: float, scale: float) -> tuple[AngleField, Mask]:
    """A picture's angles turned counter-clockwise and scaled about the middle of its grid.

    Doubled angles count clockwise, for rows go down: they turn by minus twice kappa.
    """
    rows, columns = laid.field.shape
    middle = ((columns - 1) / 2, (rows - 1) / 2)
    matrix = cv2.getRotationMatrix2D(middle, float(np.degrees(kappa)), scale)
    angles = np.ascontiguousarray(laid.field).view(np.float32).reshape(rows, columns, 2)
    angles = np.asarray(cv2.warpAffine(angles, matrix, (columns, rows)), np.float32)
    share = cv2.warpAffine(laid.mask.astype(np.float32), matrix, (columns, rows))
    # design: rounding of the resampling; less is a pixel that the rim has touched.
    mask = np.asarray(share) > 0.99
    field = angles.view(np.complex64)[:, :, 0] * (np.complex64(np.exp(-2j * kappa)) * mask)
    return np.asarray(field, np.complex64), mask


def spectrum(values: Image, shape: tuple[int, int]) -> Complex64[np.ndarray, "_ _"]:
    """Fourier transform of real values, half of it, padded with noughts to a shape."""
    rows, columns = shape
    # Row by row first: those of the padding need no transform.
    along: Any = fft.rfft(values, columns, axis=1)
    return np.asarray(fft.fft(along, rows, axis=0), np.complex64)


def corner(half: Complex64[np.ndarray, "_ _"], shape: tuple[int, int], reach: int) -> ScoreMap:
    """The first rows and columns, so many of each, of what has this half of a transform."""
    rows: Any = fft.ifft(half, axis=0)
    values: Any = fft.irfft(rows[:reach], shape[1], axis=1)
    return np.asarray(values[:, :reach], np.float32)


def angle_field(image: Image, mask: Mask) -> AngleField:
    """Doubled gradient angles of an image, without the rim where they feel the mask's edge."""
    field = doubled_angle_field(image)
    inner = cv2.erode(mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    return np.asarray((field[:, :, 0] + 1j * field[:, :, 1]) * inner, dtype=np.complex64)


def shifted_grid(grid: Grid, start: Turn, rim_px: int) -> Grid:
    """A grid moved by a shift and larger by a rim all round."""
    gsd = grid.ground_sample_distance_m
    return Grid(
        grid.west + start.east_m - rim_px * gsd,
        grid.north + start.north_m + rim_px * gsd,
        gsd,
        grid.columns + 2 * rim_px,
        grid.rows + 2 * rim_px,
    )


def distinct(
    turns: Iterable[Turn], count: int, width_m: float, beside: Sequence[Turn] = ()
) -> list[Turn]:
    """The best turns that lie apart, by their height above other places; as `apart`."""
    return apart(sorted(turns, key=lambda turn: -turn.z), count, width_m, beside)


def apart(
    turns: Iterable[Turn], count: int, width_m: float, beside: Sequence[Turn] = ()
) -> list[Turn]:
    """The first turns that differ from those before them in turn or shift.

    Args:
        turns: Any number, the best one first.
        count: How many at most.
        width_m: Width of the picture on the ground, metres.
        beside: Turns from which they must differ as well.
    """
    kept: list[Turn] = []
    for turn in turns:
        if len(kept) == count:
            break
        if not any(turn.near(other, width_m) for other in (*beside, *kept)):
            kept.append(turn)
    return kept


def steps_of(extent: float, step: float) -> Float32[np.ndarray, "steps"]:
    """Multiples of a step from -extent to +extent, nought among them."""
    most = np.floor(extent / step)
    return np.asarray(np.arange(-most, most + 1) * step, np.float32)
