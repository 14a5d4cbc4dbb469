"""Least squares matching: tie points measured to a fraction of a pixel on the raw scans.

The patch about one ray is fixed; every other ray's patch is bent by an affinity until it looks
like it (gain and offset of the grey values eliminated). All pixels here are scan pixels.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from scipy.spatial import KDTree

from core.arrays import Flags, PixelPoints, Scalars
from core.geometry.projectivity import fit_projectivity, jacobians
from core.scan.raster import ScanFile, read_window

Patches = Float32[np.ndarray, "n side side"]
"""Square pieces of scans."""
Wider = Float32[np.ndarray, "n wide wide"]
"""Larger square pieces, in which is searched."""
Affinities = Float64[np.ndarray, "n 2 3"]
"""Plane affinities, offset in the last column."""


@dataclass(frozen=True, slots=True)
class RefinementOptions:
    """How tie points are measured finely."""

    radius_px: int = 12
    """The patch reaches this far about its middle, scan pixels."""
    smooth_px: float = 0.8
    """Gaussian radius against grain, both patches."""
    iterations: int = 15
    """Steps at most."""
    max_shift: float = 1.5
    """A ray that moves further than this many pixels of the reduced scan is not taken."""
    min_correlation: float = 0.6
    """A ray whose patch is less alike is not taken."""
    max_sigma_px: float = 0.5
    """A ray with a greater formal deviation in any direction is not taken."""
    batch_px: int = 160_000
    """Pixels of patches at work at the same time."""

    @property
    def searched_radius_px(self) -> int:
        """Radius of the patches that are searched: room to turn, to stretch and to move."""
        return int(np.ceil(1.6 * self.radius_px)) + 6

    def at_reduction(self, reduction: int) -> "RefinementOptions":
        """The same for features that come from a reduced scan.

        A place is known to a part of a reduced pixel: where that is many scan pixels, as in fine
        scans of film, the patch must be larger, and smoother than the grain.
        """
        grown = max(1.0, reduction / 3.5)
        radius = int(min(round(self.radius_px * grown), 2 * self.radius_px))
        return replace(self, radius_px=radius, smooth_px=self.smooth_px * grown)


@dataclass(frozen=True, slots=True, eq=False)
class FineMatches:
    """What least squares matching found for rays against their fixed rays."""

    pixels: PixelPoints
    """Scan pixel of each ray."""
    sigma_px: Scalars
    """Formal standard deviation of the match per axis, pixels."""
    correlation: Scalars
    """How alike the patches are in the end."""
    good: Flags
    """Which of them may be used."""


def read_patches(scan: ScanFile, centres: PixelPoints, radius: int, band_px: int = 512) -> Patches:
    """Pieces of a scan about the pixels that hold the centres, read in bands of rows.

    Args:
        scan: The scan.
        centres: Scan pixels.
        radius: Each piece has 2 radius + 1 pixels a side; its middle is the pixel of the centre.
        band_px: Rows of centres that are read in one go.
    """
    side = 2 * radius + 1
    corner = np.floor(centres).astype(np.int64) - radius
    patches = np.empty((len(centres), side, side), dtype=np.float32)
    for band in np.unique(corner[:, 1] // band_px).tolist():
        members = np.flatnonzero(corner[:, 1] // band_px == band)
        left, top = corner[members].min(axis=0).tolist()
        right, bottom = (corner[members].max(axis=0) + side).tolist()
        gray = read_window(scan, left, top, right - left, bottom - top, outside="edge")
        for member in members.tolist():
            column, row = corner[member, 0] - left, corner[member, 1] - top
            patches[member] = gray[row : row + side, column : column + side]
    return patches


def patch_centres(pixels: PixelPoints) -> PixelPoints:
    """Middle of the pixel that holds each point: where a fixed patch is measured exactly."""
    return np.floor(pixels) + 0.5


def local_affinities(
    at: Float64[np.ndarray, "places 2"],
    first: PixelPoints,
    second: PixelPoints,
    neighbours: int = 16,
) -> Float64[np.ndarray, "places 2 2"]:
    """How the second scan is turned, scaled and sheared against the first about some points.

    Fitted to the matches about each point, drawn to the projectivity of all matches where they
    are few or in a row.

    Args:
        at: Points of the first scan.
        first: Matches in the first scan.
        second: The same in the second scan.
        neighbours: Matches that take part.
    """
    overall = jacobians(fit_projectivity(first, second), at)
    count = min(neighbours, len(first))
    distance, about = KDTree(first).query(at, k=count)
    distance, about = distance.reshape(len(at), count), about.reshape(len(at), count)
    source = first[about] - first[about].mean(axis=1, keepdims=True)
    target = second[about] - second[about].mean(axis=1, keepdims=True)
    left = target - source @ np.swapaxes(overall, 1, 2)
    # Relief scatters the matches by pixels and shears the ground by a few tenths.
    weight = (1.0 / (1.0 + (distance / 150.0) ** 2))[..., None] / 4.0**2
    normal = np.swapaxes(source, 1, 2) @ (source * weight) + np.eye(2) / 0.1**2
    right = np.swapaxes(source, 1, 2) @ (left * weight)
    return overall + np.swapaxes(np.linalg.solve(normal, right), 1, 2)


def refine_rays(
    fixed: Patches,
    searched: Wider,
    start: Affinities,
    max_shift_px: float,
    options: RefinementOptions,
) -> FineMatches:
    """Bend the searched patches onto the fixed ones by least squares.

    Args:
        fixed: Patches of radius `radius_px`; the point is their very middle.
        searched: Larger patches, odd sides.
        start: Affinity from offsets about the fixed point to offsets about the middle of the
            searched patch, pixels.
        max_shift_px: How far the point may move from its start.
        options: How it is done.

    Returns:
        Places as offsets (column, row) from the middle of the searched patch.
    """
    batch = max(1, options.batch_px // fixed[0].size) if len(fixed) else 1
    parts = [
        _refine_batch(fixed[rows], searched[rows], start[rows], max_shift_px, options)
        for rows in (slice(first, first + batch) for first in range(0, len(fixed), batch))
    ]
    return FineMatches(
        np.vstack([np.zeros((0, 2)), *(part.pixels for part in parts)]),
        np.concatenate([np.zeros(0), *(part.sigma_px for part in parts)]),
        np.concatenate([np.zeros(0), *(part.correlation for part in parts)]),
        np.concatenate([np.zeros(0, dtype=np.bool_), *(part.good for part in parts)]),
    )


def _refine_batch(
    fixed: Patches,
    searched: Wider,
    start: Affinities,
    max_shift_px: float,
    options: RefinementOptions,
) -> FineMatches:
    """Gauss-Newton on the fixed patch's gradients (inverse compositional), all rays at once."""
    grid = _grid(options.radius_px)
    smooth_fixed, smooth_searched = _smoothed(fixed, options), _smoothed(searched, options)
    template, scale = _normed(smooth_fixed.reshape(len(fixed), -1))
    design = _design(smooth_fixed, grid) / scale[:, None, None]
    # Gain and offset are eliminated: what a change of brightness can explain says nothing.
    design -= design.mean(axis=1, keepdims=True)
    design -= template[:, :, None] * (template[:, None, :] @ design)
    normal = np.swapaxes(design, 1, 2) @ design
    normal += np.eye(6) * (1e-9 * np.trace(normal, axis1=1, axis2=2) + 1e-30)[:, None, None]
    inverse = np.linalg.inv(normal)
    bent = start.copy()
    step = np.full(len(fixed), np.inf)
    for _ in range(options.iterations):
        sample, _ = _normed(_sampled(smooth_searched, bent, grid))
        misclosure = sample - template
        change = (inverse @ (np.swapaxes(design, 1, 2) @ misclosure[:, :, None]))[:, :, 0]
        moving = step > 1e-3
        change *= (moving * np.minimum(1.0, 3.0 / np.maximum(_shift(change), 1e-9)))[:, None]
        bent = _composed(bent, change)
        step = np.where(moving, _shift(change), step)
        if not (step > 1e-3).any():
            break
    sample, _ = _normed(_sampled(smooth_searched, bent, grid))
    return _assessed(template, sample, inverse, start, bent, step, max_shift_px, options)


def _assessed(
    template: Float64[np.ndarray, "n p"],
    sample: Float64[np.ndarray, "n p"],
    inverse: Float64[np.ndarray, "n 6 6"],
    start: Affinities,
    bent: Affinities,
    step: Scalars,
    max_shift_px: float,
    options: RefinementOptions,
) -> FineMatches:
    """Deviations of the places, and which of them stand."""
    correlation = np.sum(template * sample, axis=1)
    residual = np.sum((sample - template) ** 2, axis=1)
    freedom = template.shape[1] - 8
    # Covariance on the fixed patch, carried over by the affinity.
    linear = bent[:, :, :2]
    shift = inverse[:, :2, :2] * (residual / freedom)[:, None, None]
    covariance = linear @ shift @ np.swapaxes(linear, 1, 2)
    covariance = np.where(np.isfinite(covariance), covariance, 1e6)
    largest = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0))
    sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2)
    good = np.isfinite(correlation) & (correlation >= options.min_correlation)
    good &= (np.linalg.norm(bent[:, :, 2] - start[:, :, 2], axis=1) <= max_shift_px) & (step < 0.02)
    good &= (largest <= options.max_sigma_px) & (sigma > 0)
    good &= np.abs(linear - start[:, :, :2]).max(axis=(1, 2)) < 0.5
    return FineMatches(bent[:, :, 2], sigma, np.nan_to_num(correlation), good)


def _grid(radius: int) -> Float64[np.ndarray, "p 2"]:
    """Offsets (column, row) of a patch's pixels from its middle."""
    line = np.arange(-radius, radius + 1, dtype=np.float64)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def _smoothed(patches: Patches, options: RefinementOptions) -> Patches:
    """Patches without the finest grain."""
    if options.smooth_px <= 0:
        return patches
    return np.stack([cv2.GaussianBlur(patch, (0, 0), options.smooth_px) for patch in patches])


def _normed(
    values: Float32[np.ndarray, "n p"] | Float64[np.ndarray, "n p"],
) -> tuple[Float64[np.ndarray, "n p"], Scalars]:
    """Rows with mean nought and length one, and the lengths they had."""
    centred = values.astype(np.float64) - values.mean(axis=1, keepdims=True, dtype=np.float64)
    length = np.maximum(np.linalg.norm(centred, axis=1), 1e-9)
    return centred / length[:, None], length


def _design(fixed: Patches, grid: Float64[np.ndarray, "p 2"]) -> Float64[np.ndarray, "n p 6"]:
    """Change of grey values with shift (2) and the four terms of the affinity."""
    across = np.gradient(fixed.astype(np.float64), axis=2).reshape(len(fixed), -1)
    down = np.gradient(fixed.astype(np.float64), axis=1).reshape(len(fixed), -1)
    x, y = grid[:, 0], grid[:, 1]
    return np.stack([across, down, across * x, across * y, down * x, down * y], axis=2)


def _composed(bent: Affinities, change: Float64[np.ndarray, "n 6"]) -> Affinities:
    """The affinity after undoing a small one on the fixed patch."""
    small = np.zeros((len(bent), 3, 3))
    small[:, 2, 2] = 1.0
    small[:, 0, 0], small[:, 0, 1] = 1.0 + change[:, 2], change[:, 3]
    small[:, 1, 0], small[:, 1, 1] = change[:, 4], 1.0 + change[:, 5]
    small[:, :2, 2] = change[:, :2]
    whole = np.zeros((len(bent), 3, 3))
    whole[:, :2], whole[:, 2, 2] = bent, 1.0
    return (whole @ np.linalg.inv(small))[:, :2]


def _sampled(
    patches: Wider, bent: Affinities, grid: Float64[np.ndarray, "p 2"]
) -> Float32[np.ndarray, "n p"]:
    """Grey values of patches at bent grids, by cubic convolution; the edge is held outside."""
    side = patches.shape[1]
    place = grid @ np.swapaxes(bent[:, :, :2], 1, 2) + bent[:, None, :, 2] + side // 2
    place = np.clip(np.nan_to_num(place), 1.0, side - 2.001)
    whole = np.floor(place).astype(np.int64)
    part = (place - whole).astype(np.float32)
    across, down = _cubic(part[..., 0]), _cubic(part[..., 1])
    index = np.arange(len(patches))[:, None] * side * side + whole[..., 1] * side + whole[..., 0]
    flat = patches.reshape(-1)
    total = np.zeros(index.shape, dtype=np.float32)
    for j in range(4):
        line = np.zeros(index.shape, dtype=np.float32)
        for i in range(4):
            line += across[i] * flat[np.minimum(index + (j - 1) * side + i - 1, len(flat) - 1)]
        total += down[j] * line
    return total


def _cubic(part: Float32[np.ndarray, "n p"]) -> tuple[np.ndarray, ...]:
    """Weights of four neighbours, Catmull-Rom."""
    square, cube = part * part, part * part * part
    return (
        0.5 * (-part + 2 * square - cube),
        0.5 * (2 - 5 * square + 3 * cube),
        0.5 * (part + 4 * square - 3 * cube),
        0.5 * (cube - square),
    )


def _shift(change: Float64[np.ndarray, "n 6"]) -> Scalars:
    """Length of the shift in a change."""
    return np.linalg.norm(change[:, :2], axis=1)
