"""Least squares matching: tie points measured to a fraction of a pixel on the raw scans.

The patch about one ray is fixed; every other ray's patch is bent by an affinity until it looks
like it (gain and offset of the grey values eliminated). All pixels here are scan pixels.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from scipy.spatial import KDTree

from core.arrays import Flags, PixelPoints, Scalars
from core.geometry.transforms import fit_projectivity, jacobians
from core.raster.scan_file import ScanFile, read_window

Patches = Float32[np.ndarray, "n side side"]
"""Square pieces of scans."""
Wider = Float32[np.ndarray, "n wide wide"]
"""Larger square pieces, in which is searched."""
Affinities = Float64[np.ndarray, "n 2 3"]
"""Plane affinities, offset in the last column."""


STEPS = 15  # design: time; a bound for what does not settle
"""Steps of least squares at most."""
MOST_STEP_PX = 3.0  # design: further than the smoothed grey values are straight
"""No step moves a patch further."""
MOVING_PX = 1e-3  # design: a tenth of what the best rays are known to
"""A patch whose last step was shorter is left where it is."""
SETTLED_PX = 0.02  # design: a tenth of what common rays are known to
"""A ray whose last step was longer did not converge."""
MOST_SHIFT = 1.5  # design: a feature is known to a part of a reduced pixel
"""A ray that moves further than this many pixels of the reduced scan is not taken."""
LEAST_CORRELATION = (
    0.6  # design: a third of the variance explained, which patches of elsewhere lack
)
"""A ray whose patch is less alike is not taken."""
MOST_SIGMA_PX = 0.5  # design: a patch of one edge slides along it
"""A ray with a greater formal deviation in any direction is not taken."""
MOST_BEND = 0.5  # design: no slope of the ground shears two photos of one flight so far
"""No term of the affinity may change by more from its start."""
BATCH_PX = 160_000  # design: memory; 8 MB of derivatives, so that they stay in a cache
"""Pixels of patches at work at the same time."""
BAND_ROWS = 512  # design: memory; 8 MB of a scan 16,000 pixels wide
"""Rows of centres that are read in one go."""
NEIGHBOURS = 16  # design: three to each of the affinity's six terms, less two for the shift
"""Matches that tell how the ground about a point is bent."""
REACH_PX = 150.0  # design: the distance of matches among some thousand in a scan
"""Matches this far away count half."""
RELIEF_PX = 4.0  # design: trees and houses among the matches
"""Standard deviation of a match about the plane of its neighbourhood."""
SHEAR = 0.1  # design: slopes of the ground of some ten degrees
"""Standard deviation of a local affinity's terms about those of the whole pair."""
LINEAR = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])  # design: by definition, shift first
"""Which of the six terms bend a patch."""
TINY = 1e-9  # design: numerical safety; grey values are whole numbers
NOWHERE_PX2 = 1e6  # design: a variance that no ray is taken with
"""Variance of a place whose patch left the picture."""


@dataclass(frozen=True, slots=True)
class PatchSize:
    """How large and how smooth the patches are that are laid upon each other."""

    radius_px: int
    """The patch reaches this far about its middle, scan pixels."""
    smooth_px: float
    """Gaussian radius against grain, both patches."""

    @staticmethod
    def at_reduction(reduction: int = 1) -> "PatchSize":
        """The size for features that come from a reduced scan.

        A place is known to a part of a reduced pixel: where that is many scan pixels, as in fine
        scans of film, the patch must be larger, and smoother than the grain.
        """
        # design: film of 230 mm at 30 um is reduced by 3.5, and its grain is as fine as its pixels
        grown = max(1.0, reduction / 3.5)
        # design: 25 x 25 pixels hold texture enough, and still about one slope of the ground
        radius, smooth = 12, 0.8
        return PatchSize(int(min(round(radius * grown), 2 * radius)), smooth * grown)

    @property
    def searched_radius_px(self) -> int:
        """Radius of the patches that are searched: room to turn, to stretch and to move."""
        # design: the diagonal of a patch stretched by a tenth, and the longest usual shift
        return int(np.ceil(1.6 * self.radius_px)) + 6


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
    linear: Float64[np.ndarray, "n 2 2"]
    """How each searched patch lies about its place, against the fixed one."""


def read_patches(
    scan: ScanFile, centres: PixelPoints, radius: int, band_px: int = BAND_ROWS
) -> Patches:
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
) -> Float64[np.ndarray, "places 2 2"]:
    """How the second scan is turned, scaled and sheared against the first about some points.

    Fitted to the matches about each point, drawn to the projectivity of all matches where they
    are few or in a row.

    Args:
        at: Points of the first scan.
        first: Matches in the first scan.
        second: The same in the second scan.
    """
    overall = jacobians(fit_projectivity(first, second), at)
    count = min(NEIGHBOURS, len(first))
    distance, about = KDTree(first).query(at, k=count)
    distance, about = distance.reshape(len(at), count), about.reshape(len(at), count)
    source = first[about] - first[about].mean(axis=1, keepdims=True)
    target = second[about] - second[about].mean(axis=1, keepdims=True)
    left = target - source @ np.swapaxes(overall, 1, 2)
    weight = (1.0 / (1.0 + (distance / REACH_PX) ** 2))[..., None] / RELIEF_PX**2
    normal = np.swapaxes(source, 1, 2) @ (source * weight) + np.eye(2) / SHEAR**2
    right = np.swapaxes(source, 1, 2) @ (left * weight)
    return overall + np.swapaxes(np.linalg.solve(normal, right), 1, 2)


def refine_rays(
    fixed: Patches,
    searched: Wider,
    start: Affinities,
    *,
    max_shift_px: float,
    size: PatchSize,
    bend_sigma: float | None = None,
) -> FineMatches:
    """Bend the searched patches onto the fixed ones by least squares.

    Args:
        fixed: Patches of radius `radius_px`; the point is their very middle.
        searched: Larger patches, odd sides.
        start: Affinity from offsets about the fixed point to offsets about the middle of the
            searched patch, pixels.
        max_shift_px: How far the point may move from its start.
        size: Size of the patches.
        bend_sigma: Standard deviation of the start's four linear terms; None where nothing is known
            of them. Without it a weak texture bends until it fits, and the place goes along.

    Returns:
        Places as offsets (column, row) from the middle of the searched patch.
    """
    batch = max(1, BATCH_PX // fixed[0].size) if len(fixed) else 1
    parts = [
        _refine_batch(fixed[rows], searched[rows], start[rows], max_shift_px, size, bend_sigma)
        for rows in (slice(first, first + batch) for first in range(0, len(fixed), batch))
    ]
    return FineMatches(
        np.vstack([np.zeros((0, 2)), *(part.pixels for part in parts)]),
        np.concatenate([np.zeros(0), *(part.sigma_px for part in parts)]),
        np.concatenate([np.zeros(0), *(part.correlation for part in parts)]),
        np.concatenate([np.zeros(0, dtype=np.bool_), *(part.good for part in parts)]),
        np.concatenate([np.zeros((0, 2, 2)), *(part.linear for part in parts)]),
    )


def laid_upon(
    fixed: Float32[np.ndarray, "side side"],
    searched: Float32[np.ndarray, "wide wide"],
    bent: Float64[np.ndarray, "2 3"],
    size: PatchSize,
) -> tuple[Float32[np.ndarray, "side side"], Float32[np.ndarray, "side side"]]:
    """A fixed patch and what a searched one shows there, both smoothed.

    Args:
        fixed: A patch of radius `radius_px`.
        searched: A larger patch, odd sides.
        bent: Affinity from offsets about the fixed point to offsets about the middle of the
            searched patch, pixels.
        size: Size of the patches.
    """
    own, other = _smoothed(fixed[None], size), _smoothed(searched[None], size)
    shown = _sampled(other, bent[None], _grid(size.radius_px))
    return own[0], shown[0].reshape(fixed.shape)


def _refine_batch(
    fixed: Patches,
    searched: Wider,
    start: Affinities,
    max_shift_px: float,
    size: PatchSize,
    bend_sigma: float | None,
) -> FineMatches:
    """Gauss-Newton on the fixed patch's gradients (inverse compositional), all rays at once."""
    grid = _grid(size.radius_px)
    smooth_fixed, smooth_searched = _smoothed(fixed, size), _smoothed(searched, size)
    template, design, normal = _linearised(smooth_fixed, grid)
    known = np.linalg.inv(start[:, :, :2])
    inverse = np.linalg.inv(normal)
    bent = start.copy()
    step = np.full(len(fixed), np.inf)
    for _ in range(STEPS):
        sample, _ = _normed(_sampled(smooth_searched, bent, grid))
        misclosure = sample - template
        right = np.swapaxes(design, 1, 2) @ misclosure[:, :, None]
        if bend_sigma is not None:
            weight = _noise(misclosure, size) / bend_sigma**2
            inverse = np.linalg.inv(normal + weight[:, None, None] * np.diag(LINEAR))
            right -= weight[:, None, None] * _bend(known @ bent[:, :, :2])
        change = (inverse @ right)[:, :, 0]
        moving = step > MOVING_PX
        shorter = np.minimum(1.0, MOST_STEP_PX / np.maximum(_shift(change), TINY))
        change *= (moving * shorter)[:, None]
        bent = _composed(bent, change)
        step = np.where(moving, _shift(change), step)
        if not (step > MOVING_PX).any():
            break
    sample, _ = _normed(_sampled(smooth_searched, bent, grid))
    correlation = np.sum(template * sample, axis=1)
    residual = np.sum((sample - template) ** 2, axis=1)
    # Six terms of the affinity, gain and offset.
    freedom = template.shape[1] - inverse.shape[1] - 2
    # Covariance on the fixed patch, carried over by the affinity.
    linear = bent[:, :, :2]
    shift = inverse[:, :2, :2] * (residual / freedom)[:, None, None]
    covariance = linear @ shift @ np.swapaxes(linear, 1, 2)
    covariance = np.where(np.isfinite(covariance), covariance, NOWHERE_PX2)
    largest = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0))
    sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2)
    moved = np.linalg.norm(bent[:, :, 2] - start[:, :, 2], axis=1)
    good = np.isfinite(correlation) & (correlation >= LEAST_CORRELATION)
    good &= (moved <= max_shift_px) & (step < SETTLED_PX)
    good &= (largest <= MOST_SIGMA_PX) & (sigma > 0)
    good &= np.abs(linear - start[:, :, :2]).max(axis=(1, 2)) < MOST_BEND
    return FineMatches(bent[:, :, 2], sigma, np.nan_to_num(correlation), good, linear)


def _linearised(
    fixed: Patches, grid: Float64[np.ndarray, "p 2"]
) -> tuple[Float64[np.ndarray, "n p"], Float64[np.ndarray, "n p 6"], Float64[np.ndarray, "n 6 6"]]:
    """The smoothed fixed patches normed, their derivatives by the six terms, the normal matrix."""
    template, scale = _normed(fixed.reshape(len(fixed), -1))
    design = _design(fixed, grid) / scale[:, None, None]
    # Gain and offset are eliminated: what a change of brightness can explain says nothing.
    design -= design.mean(axis=1, keepdims=True)
    design -= template[:, :, None] * (template[:, None, :] @ design)
    normal = np.swapaxes(design, 1, 2) @ design
    # design: numerical safety; a patch without texture is singular, and refused later
    ridge = TINY * np.trace(normal, axis1=1, axis2=2) + 1e-30
    normal += np.eye(6) * ridge[:, None, None]
    return template, design, normal


def _noise(misclosure: Float64[np.ndarray, "n p"], size: PatchSize) -> Scalars:
    """Variance of a pixel that stood alone, of smoothed pixels that err alike."""
    # source: the autocorrelation of white noise smoothed by a Gaussian sums to 4 pi sigma squared.
    alike = max(1.0, 4 * np.pi * size.smooth_px**2)
    return alike * np.mean(misclosure**2, axis=1)


def _bend(linear: Float64[np.ndarray, "n 2 2"]) -> Float64[np.ndarray, "n 6 1"]:
    """How far a patch has been bent from its start, as the six terms count it; shifts are free."""
    bend = np.zeros((len(linear), 6, 1))
    bend[:, 2:, 0] = (np.eye(2) - linear).reshape(-1, 4)
    return bend


def _grid(radius: int) -> Float64[np.ndarray, "p 2"]:
    """Offsets (column, row) of a patch's pixels from its middle."""
    line = np.arange(-radius, radius + 1, dtype=np.float64)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def _smoothed(patches: Patches, size: PatchSize) -> Patches:
    """Patches without the finest grain."""
    return np.stack([cv2.GaussianBlur(patch, (0, 0), size.smooth_px) for patch in patches])


def _normed(
    values: Float32[np.ndarray, "n p"] | Float64[np.ndarray, "n p"],
) -> tuple[Float64[np.ndarray, "n p"], Scalars]:
    """Rows with mean nought and length one, and the lengths they had."""
    centred = values.astype(np.float64) - values.mean(axis=1, keepdims=True, dtype=np.float64)
    length = np.maximum(np.linalg.norm(centred, axis=1), TINY)
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
    # A place that is none counts as the edge.
    np.fmax(place, 1.0, out=place)
    # design: the last place that still has two neighbours on its right, and a little
    np.minimum(place, side - 2.001, out=place)
    whole = place.astype(np.int64)
    part = (place - whole).astype(np.float32)
    across, down = _cubic(part[..., 0]), _cubic(part[..., 1])
    index = np.arange(len(patches))[:, None] * side * side + whole[..., 1] * side + whole[..., 0]
    # The first of sixteen neighbours: the others lie so far behind it, the same for all places.
    index -= side + 1
    flat = patches.reshape(-1)
    total = np.zeros(index.shape, dtype=np.float32)
    line, value = np.empty_like(total), np.empty_like(total)
    for j in range(4):
        line[...] = 0
        for i in range(4):
            np.take(flat[j * side + i :], index, out=value, mode="clip")
            value *= across[i]
            line += value
        line *= down[j]
        total += line
    return total


def _cubic(part: Float32[np.ndarray, "n p"]) -> tuple[np.ndarray, ...]:
    """Weights of four neighbours, Catmull-Rom."""
    square, cube = part * part, part * part * part
    # source: Keys 1981, equation 4 with a = -1/2
    return (
        0.5 * (-part + 2 * square - cube),
        0.5 * (2 - 5 * square + 3 * cube),
        0.5 * (part + 4 * square - 3 * cube),
        0.5 * (cube - square),
    )


def _shift(change: Float64[np.ndarray, "n 6"]) -> Scalars:
    """Length of the shift in a change."""
    return np.linalg.norm(change[:, :2], axis=1)
