"""A patch of one photo, or of an ortho, used as template in another photo.

Both orientations and a plane through the ground give the rotation, scale and shear between two
scans, so a place measured in one photo is a template for all others. Least squares matching then
finds what the plane did not model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from core.arrays import Mask, PixelPoints, Position
from core.frames import HALF_PIXEL
from core.geometry.resection import PhotoModel
from core.matching.local_search import LEAST_USABLE, RIM_PX, SEPARATION_PX
from core.matching.operators import FusedOperator, HighPassOperator, Operator
from core.matching.patches import OpenPhoto, ScanPart, Window, filled, read_scan
from core.matching.peaks import Image, ScoreMap, level_and_spread
from core.matching.precision import paired_covariance
from core.raster.grid import Grid
from core.raster.ortho import Ortho
from core.ties.refinement import SHEAR, PatchSize, laid_upon, patch_centres, refine_rays

OPERATORS: tuple[Operator, ...] = (HighPassOperator(), FusedOperator())
"""Grey values, as of photos of one day, and directions of edges, which outlast contrast and years.
"""
# design: windows of 51 px are safe after warping, as those of control (METHODS 4.2).
HALF_PX = 35
"""Templates are 2 n + 1 pixels wide."""
# design: detail of a few pixels at one end, pictures of which compression left little at the other.
SIZES = tuple(PatchSize(*size) for size in ((48, 6.4), (48, 3.2), (24, 3.2), (24, 1.6)))
"""Patches of least squares matching, the smoothest first."""
# design: 25 pixels hold texture enough.
LEAST_RADIUS_PX = 12
"""Patches at the edge of the photograph are no smaller."""
MOST_SHIFT_PX = float(SEPARATION_PX)
"""So far a place may move from the peak of likeness by least squares, scan pixels: what lies
further off is another peak."""

Affinity = Float64[np.ndarray, "2 3"]
Plane = Float64[np.ndarray, "2 2"]
Wider = Float32[np.ndarray, "wide_rows wide_columns"]
Surfaces = tuple[ScoreMap, ...]


@runtime_checkable
class Source(Protocol):
    """A picture that shows a place."""

    @property
    def pixel(self) -> PixelPoints:
        """Where it shows it, pixels of the picture, (1, 2)."""
        ...

    @property
    def by_plane(self) -> Plane:
        """Pixels (column, row) for a metre of the ground plane east and north."""
        ...

    @property
    def name(self) -> str:
        """Of the picture."""
        ...

    def read(self, window: Window) -> ScanPart:
        """A window of the picture."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ShownInOrtho:
    """A place of the ground in an ortho, which counts its pixels from that place."""

    ortho: Ortho
    """The ortho."""
    plane: Float64[np.ndarray, "2"]
    """Easting and northing, metres."""
    name: str = "ortho"
    """As of any source."""

    @property
    def pixel(self) -> PixelPoints:
        """The origin."""
        return np.zeros((1, 2))

    @property
    def by_plane(self) -> Plane:
        """North is up."""
        return np.diag([1.0, -1.0]) / self.ortho.ground_sample_distance_m

    def read(self, window: Window) -> ScanPart:
        """A window of the ortho; beyond it nothing is usable."""
        gsd = self.ortho.ground_sample_distance_m
        east, north = (float(value) for value in self.plane)
        grid = Grid(
            east + window.column * gsd, north - window.row * gsd,
            gsd * window.reduction, window.columns, window.rows,
        )  # fmt: skip
        patch = self.ortho.read(grid)
        return ScanPart(window, filled(patch.values, patch.mask), patch.mask)


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """A place of the ground in a photo."""

    opened: OpenPhoto
    """The photo."""
    pixel: PixelPoints
    """Where it is measured or expected, scan pixels, (1, 2)."""
    by_plane: Plane
    """Scan pixels (column, row) for a metre of its ground plane east and north."""

    @staticmethod
    def of(opened: OpenPhoto, position: Position, slope: Float64[np.ndarray, "2"]) -> "Shown":
        """As the orientation has it.

        Args:
            opened: The photo.
            position: The place, metres.
            slope: Rise of the ground there for a metre east and north.
        """
        photo = opened.photo
        model = PhotoModel(photo.interior, opened.camera, photo.atmosphere)
        pixels, derivatives = model.linearised(position[None], photo.exterior)
        # A point that moves is a centre that moves the other way.
        by_object = -derivatives[0, :, :3]
        return Shown(opened, pixels, by_object[:, :2] + np.outer(by_object[:, 2], slope))

    @property
    def name(self) -> str:
        """Of the photo."""
        return self.opened.photo.photo_id

    def read(self, window: Window) -> ScanPart:
        """A window of the scan; beyond it nothing is usable."""
        part = read_scan(self.opened, window)
        across, down = (
            start + window.reduction * np.arange(count)
            for start, count in ((window.column, window.columns), (window.row, window.rows))
        )
        columns, rows = self.opened.photo.size_px
        inside = ((down >= 0) & (down < rows))[:, None] & (across >= 0) & (across < columns)
        return replace(part, usable=part.usable & inside)

    def at(self, pixel: PixelPoints) -> "Shown":
        """The same place elsewhere in the scan."""
        return replace(self, pixel=pixel)


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """What a photo shows about a place, turned as another photo lies."""

    grey: Image
    """Grey values, the place in the very middle of the middle pixel."""
    usable: Mask
    """Where the scan is photograph."""

    def within(self, half: int) -> bool:
        """Whether enough of its middle is photograph."""
        side = self.usable.shape[0] // 2
        return bool(self.usable[side - half : side + half + 1].mean() >= LEAST_USABLE)


def template_of(source: Source, target: Shown, half: int, reduction: int) -> Template:
    """A window of the source's scan as the target's would show it.

    Args:
        source: Where the place is measured.
        target: The photo whose geometry is wanted.
        half: The template has 2 n + 1 pixels a side.
        reduction: Pixels of the target's scan to one of the template.
    """
    linear = source.by_plane @ np.linalg.inv(target.by_plane)
    steps = np.arange(-half, half + 1, dtype=np.float64) * reduction
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    pixels = source.pixel + offsets @ linear.T
    # As fine as the template or finer: reading coarser pixels keeps the grain out.
    size = max(1, int(float(np.sqrt(abs(np.linalg.det(linear)))) * reduction))
    low = np.floor(pixels.min(axis=0)).astype(np.int64) - 2 * size
    columns, rows = (np.ceil((pixels.max(axis=0) - low) / size).astype(np.int64) + 3).tolist()
    part = source.read(Window(int(low[0]), int(low[1]), columns, rows, size))
    side = len(steps)
    places = (part.window.window_from_pixel(pixels) - HALF_PIXEL).astype(np.float32)
    right, down = places[:, 0].reshape(side, side), places[:, 1].reshape(side, side)
    grey = cv2.remap(part.grey, right, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    usable = cv2.remap(part.usable.astype(np.uint8), right, down, cv2.INTER_NEAREST)
    return Template(np.asarray(grey, np.float32), usable > 0)


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """How alike a place of some photos and every place of a window of another are."""

    surface: ScoreMap
    """Mean over photos and operators, each in its own robust deviations."""
    chance: Surfaces
    """The same of the templates mirrored: nothing there is right, unless the template is the same
    in a mirror."""
    centre: PixelPoints
    """Scan pixel of the middle value, (1, 2)."""
    reduction: int
    """Scan pixels from one value to the next."""

    def pixel_of(self, column: float, row: float) -> PixelPoints:
        """Scan pixel (1, 2) of a place of the surface."""
        half = np.array(self.surface.shape[::-1]) // 2
        return self.centre + (np.array([[column, row]]) - half) * self.reduction


def looked(
    sources: Sequence[Source], target: Shown, search: tuple[int, int], reduction: int
) -> Looked | None:
    """Compare what some photos show of a place with a window of another.

    Args:
        sources: Where the place is measured.
        target: Where it is expected.
        search: Half width and height of the window of places, pixels of the pass.
        reduction: Scan pixels to a pixel of the pass.

    Returns:
        The surface; None where too little of either is photograph.
    """
    margin = max(HALF_PX // 2, RIM_PX)
    reach = HALF_PX + margin
    templates = [template_of(source, target, reach, reduction) for source in sources]
    templates = [template for template in templates if template.within(HALF_PX)]
    corner = np.floor(target.pixel[0] / reduction).astype(np.int64) - reach - np.array(search)
    size = 2 * (np.array(search) + reach) + 1
    low = corner * reduction
    window = Window(int(low[0]), int(low[1]), int(size[0]), int(size[1]), reduction)
    part = target.read(window)
    middle = np.array(part.usable.shape) // 2
    first, last = middle - HALF_PX, middle + HALF_PX + 1
    inside = part.usable[first[0] : last[0], first[1] : last[1]]
    if not templates or inside.mean() < LEAST_USABLE:
        return None
    inner = slice(margin, -margin)
    scans = [
        tuple(layer[inner, inner] for layer in operator.of_scan(part.grey, HALF_PX))
        for operator in OPERATORS
    ]
    flips = (np.s_[:, :], np.s_[:, ::-1], np.s_[::-1, :])
    surfaces = [
        _mean_surface([template.grey[flip] for template in templates], scans, inner)
        for flip in flips
    ]
    centre = window.pixel_from_window(np.array([middle[::-1]]) + HALF_PIXEL)
    return Looked(surfaces[0], tuple(surfaces[1:]), centre, reduction)


def _mean_surface(
    templates: Sequence[Image], scans: Sequence[tuple[np.ndarray, ...]], inner: slice
) -> ScoreMap:
    """Mean over templates and operators, each in its own robust deviations."""
    half = templates[0].shape[0] // 2 - int(inner.start)
    total: list[ScoreMap] = []
    for template in templates:
        nothing = np.zeros_like(template)
        for operator, scan in zip(OPERATORS, scans, strict=True):
            described = operator.of_reference(np.ascontiguousarray(template), nothing, half)
            patch = tuple(np.ascontiguousarray(layer[inner, inner]) for layer in described)
            around = tuple(np.ascontiguousarray(layer) for layer in scan)
            scores = operator.scores(around, patch)
            level, spread = level_and_spread(scores)
            total.append((scores - level) / np.float32(spread))
    return np.asarray(np.mean(total, axis=0), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class FinePlace:
    """A place by least squares matching."""

    pixel: PixelPoints
    """Scan pixel, (1, 2)."""
    sigma_px: float
    """Standard deviation per axis, from what the template leaves unexplained there."""
    correlation: float
    """How alike both patches are in the end."""


def finely(source: Source, target: Shown) -> FinePlace | None:
    """Lay what one photo shows of a place onto another by least squares.

    Done with patches of several sizes, smooth and wide ones first and finer ones from where these
    lie. All of them tell the place, each by how well it knows it; where they differ by more than
    they say, the place is known so much worse.

    Args:
        source: Where the place is measured.
        target: Where it lies to a pixel or two.
    """
    places: list[FinePlace] = []
    start, templates = target, _templates(source, target)
    for size in SIZES:
        found = _refined(templates, start, size)
        if found is None or np.hypot(*(found.pixel - target.pixel)[0]) > MOST_SHIFT_PX:
            continue
        if all(found.sigma_px < other.sigma_px for other in places):
            start = target.at(found.pixel)
        places.append(found)
    return agreed(places) if places else None


def agreed(places: Sequence[FinePlace]) -> FinePlace:
    """The place that is known best, as well as all others let it be known (Birge's ratio)."""
    best = min(places, key=lambda place: place.sigma_px)
    if len(places) < 2:
        return best
    pixels = np.concatenate([place.pixel for place in places])
    weights = np.array([place.sigma_px for place in places]) ** -2.0
    mean = weights @ pixels / weights.sum()
    ratio = weights @ np.sum((pixels - mean) ** 2, axis=1) / (2 * (len(places) - 1))
    return replace(best, sigma_px=best.sigma_px * float(np.sqrt(max(1.0, ratio))))


def peak_sigma_px(source: Source, target: Shown) -> float:
    """Standard deviation per axis of a place that only the peak of likeness tells, scan pixels.

    Args:
        source: Where the place is measured.
        target: Where its peak lies.
    """
    sigmas, templates = [np.inf], _templates(source, target)
    for size in SIZES:
        pair = _patches(templates, target, size)
        if pair is not None:
            start = np.column_stack([np.eye(2), (target.pixel - pair.middle)[0]])
            sigmas.append(_sigma_px(pair, start))
    return float(min(sigmas))


@dataclass(frozen=True, slots=True, eq=False)
class _Patches:
    """What two pictures show of a place."""

    fixed: Image
    """The source, as the target lies."""
    searched: Wider
    """A wider window of the target."""
    middle: PixelPoints
    """Scan pixel of its middle, (1, 2)."""
    size: PatchSize
    """So much of both is photograph."""


def _templates(source: Source, target: Shown) -> Mapping[int, Template]:
    """By radius; they are the same wherever in the target the place is sought."""
    return {
        radius: template_of(source, target, radius, 1)
        for radius in {size.radius_px for size in SIZES}
    }


def _patches(templates: Mapping[int, Template], target: Shown, size: PatchSize) -> _Patches | None:
    """Patches of a size, or of what of it is photograph; None where that is too little."""
    fixed = templates[size.radius_px]
    wide = size.searched_radius_px
    left, top = (np.floor(target.pixel[0]).astype(np.int64) - wide).tolist()
    part = target.read(Window(left, top, 2 * wide + 1, 2 * wide + 1, 1))
    radius = min(_whole(fixed.usable), _whole(part.usable) - int(np.ceil(MOST_SHIFT_PX)))
    if radius < LEAST_RADIUS_PX:
        return None
    fitting = PatchSize(min(radius, size.radius_px), size.smooth_px)
    inner = _middle_of(size.radius_px, fitting.radius_px)
    outer = _middle_of(wide, min(wide, fitting.searched_radius_px))
    return _Patches(fixed.grey[inner], part.grey[outer], patch_centres(target.pixel), fitting)


def _middle_of(half: int, less: int) -> tuple[slice, slice]:
    """The middle of a square picture."""
    line = slice(half - less, half + less + 1)
    return line, line


def _whole(usable: Mask) -> int:
    """How far about its middle a square picture is all photograph, pixels; -1 for not even that."""
    half = usable.shape[0] // 2
    line = np.abs(np.arange(usable.shape[0]) - half)
    away = np.maximum(line[:, None], line)[~usable]
    return int(away.min()) - 1 if len(away) else half


def _refined(templates: Mapping[int, Template], target: Shown, size: PatchSize) -> FinePlace | None:
    """With patches of one size; None where they do not agree."""
    pair = _patches(templates, target, size)
    if pair is None:
        return None
    start = np.column_stack([np.eye(2), (target.pixel - pair.middle)[0]])
    rays = (pair.fixed[None], pair.searched[None], start[None])
    found = refine_rays(*rays, max_shift_px=MOST_SHIFT_PX, size=pair.size, bend_sigma=SHEAR)
    if not found.good[0]:
        return None
    sigma = _sigma_px(pair, np.column_stack([found.linear[0], found.pixels[0]]))
    return FinePlace(pair.middle + found.pixels, sigma, float(found.correlation[0]))


def _sigma_px(pair: _Patches, bent: Affinity) -> float:
    """Standard deviation per axis of a match, from what both patches share and what they do not."""
    own, other = laid_upon(pair.fixed, pair.searched, bent, pair.size)
    covariance = paired_covariance(own, other, pair.size.smooth_px, SHEAR)
    return float(np.sqrt(max(np.trace(covariance), 0.0) / 2))
