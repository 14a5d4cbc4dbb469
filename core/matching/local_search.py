"""Where reference points may lie in one photo: candidate peaks of several operators."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from core.arrays import Flags, Indices, Matrix, ObjectPoints, PixelPoints, Scalars
from core.block import Peak
from core.frames import HALF_PIXEL
from core.geometry.consensus import Candidates
from core.geometry.resection import PhotoModel
from core.matching.operators import GREY, USUAL, Operator
from core.matching.patches import (
    OpenPhoto,
    ScanPart,
    Templates,
    Window,
    read_scan,
    read_templates,
)
from core.matching.peaks import Description, ScoreMap, ScorePeak, detect_peaks
from core.matching.precision import place_covariance, sharpness_of
from core.matching.reference import Reference
from core.progress import Progress, Silent

Members = Int[np.ndarray, "members"]
"""Indices of some of the points."""
Slices = tuple[slice, slice]
"""Rows and columns of a window."""
# design: memory: fifteen layers, of which the two usual operators' descriptions consist, take 150
# MB.
TILE_PX = 1536
# design: edges are smoothed by 1.2 px, so that two maxima closer than this are one.
SEPARATION_PX = 4
"""No two peaks of a surface, and no peak and its rim, are closer than this (window pixels)."""
# design: less than half a vote, so that grey values alone never outvote the edges.
NCC_TRUST = 0.4
"""Vote of a grey-value peak that the gradients do not share: crowns and shadows move all grey
values of a wood together, so that such peaks agree with each other and are wrong."""
# design: where operators compare edges, their width and not noise sets how near two places agree.
MATCH_FLOOR_PX = 0.35
"""No match says better than this where a photo is, pixels of the pass."""
# design: wider ones are ridges, whose place along them is chance.
DULL = 3.0
"""A dull peak is no wider than this many of the sharpest: it is doubtful rather than imprecise."""
# design: a drawn road fades out over eleven pixels; a wide mean has a third of the template for its
# deviation, so that half a template beyond its edge leaves a fifteenth of it out there.
RIM_PX = 12
"""So much beyond a template, or half of it if that is more, is described with it."""
# design: a hole of a tenth leaves a template most of its edges.
LEAST_KNOWN = 0.9
"""Share of a template on which the reference is known at least."""
# design: more than half of what is compared must be ground.
LEAST_USABLE = 0.6
"""Share of it on which the scan is photograph: a picture may end within a template."""
# design: right peaks scatter by half a pixel (METHODS 4.3); three deviations of the difference of
# two that scatter a little more.
SAME_PLACE_PX = 2.5
"""Peaks of two operators closer than this (window pixels) are one candidate."""


@dataclass(frozen=True, slots=True)
class MatchingOptions:
    """Sizes of one pass, in pixels of the reduced scan."""

    # design: as scanned.
    reduction: int = 1
    """Scan pixels to one pixel of the pass."""
    # design: windows of 51 to 101 px are safe after warping (METHODS 4.2).
    template_half_px: int = 30
    """The template is 2 n + 1 pixels wide."""
    # design: the truth is among the best peaks of several operators far more often than it is the
    # best of one (METHODS 4.3).
    peaks: int = 2
    """Peaks kept of each operator."""
    # design: 99 % of normal errors in the plane.
    search_sigmas: float = 3.0
    """Half-width of the search in standard deviations of the prediction."""
    # design: twice SEPARATION_PX: a peak needs a rim, and chance some room to show itself.
    min_search_px: int = 8
    """Smallest half-width of the search."""
    # design: time grows with the square; beyond, chance finds higher peaks than the truth.
    max_search_px: int = 120
    """Largest half-width of the search."""
    operators: tuple[Operator, ...] = USUAL
    """What is compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Where reference points should appear in a photo, and how sure that is."""

    pixels: PixelPoints
    """Predicted scan pixels; NaN where not in the photo."""
    sigma_px: Scalars
    """Largest standard deviation of the prediction, scan pixels."""
    inside: Flags
    """True where the point may lie within the picture, on what of it is photograph."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Candidates of one reference point in one photo."""

    point: int
    """Index of the reference point."""
    peaks: tuple[Peak, ...]
    """Where it may lie, best first, scan pixels."""
    searched_px2: float
    """Area in which a peak may lie, the window without its rim, square scan pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """A tile of a scan and the templates that are sought in it, described for every operator."""

    part: ScanPart
    """The tile."""
    templates: Templates
    """One cell for each point."""
    template_half_px: int
    """Half the templates that are cut out of the cells, pixels."""
    operators: Mapping[str, Operator]
    """By name."""
    scan: Mapping[str, Description]
    """What each compares of the scan."""
    reference: Mapping[str, Description]
    """What each compares of the reference."""


@dataclass(frozen=True, slots=True, eq=False)
class PointView:
    """One point's template, and the window of the scan that it is sought in."""

    images: Images
    """The tile."""
    around: Slices
    """The window, rows and columns of the tile."""
    patch: Slices
    """The template, rows and columns of the cells."""
    centre: PixelPoints
    """Scan pixel on which the point lies where the template is not displaced, (1, 2)."""

    def described(self, operator: str) -> Description:
        """The template as an operator compares it."""
        return cut(self.images.reference[operator], self.patch)

    def scores(self, operator: str) -> ScoreMap:
        """Likeness of the template at every place within the window."""
        around = cut(self.images.scan[operator], self.around)
        return self.images.operators[operator].scores(around, self.described(operator))

    def mirrored_scores(self, operator: str) -> ScoreMap:
        """The same with the patch mirrored before it is described: whatever it finds is wrong."""
        made, templates = self.images.operators[operator], self.images.templates
        mirrored = made.of_reference(
            np.ascontiguousarray(templates.reference[self.patch][:, ::-1]),
            np.ascontiguousarray(templates.roads[self.patch][:, ::-1]),
            self.images.template_half_px,
        )
        return made.scores(cut(self.images.scan[operator], self.around), mirrored)

    def place_sigma_px(self, operator: str, place: tuple[int, int]) -> float:
        """Standard deviation per axis of the place of the template, were it the right one.

        Args:
            operator: What is compared.
            place: Row and column of the place in the scores.
        """
        rows, columns = (
            slice(part.start + step, part.start + step + own.stop - own.start)
            for part, step, own in zip(self.around, place, self.patch, strict=True)
        )
        shown, template = self.images.operators[operator].correlated(
            cut(self.images.scan[operator], (rows, columns)), self.described(operator)
        )
        sharpness = sharpness_of(template)
        if sharpness is None:
            return float("inf")
        return float(np.sqrt(np.trace(place_covariance(sharpness, shown)) / 2))


def predict_pixels(
    opened: OpenPhoto,
    covariance: Matrix,
    points: ObjectPoints,
    sigma_m: ObjectPoints,
) -> Prediction:
    """Predict where points appear, from the orientation's covariance and their own."""
    photo, camera = opened.photo, opened.camera
    model = PhotoModel(photo.interior, camera, photo.atmosphere)
    pixels, derivatives = model.linearised(points, photo.exterior)
    spread = np.einsum("nai,ij,nbj->nab", derivatives, covariance, derivatives)
    ground = np.einsum("nai,ni,nbi->nab", derivatives[:, :, :3], sigma_m**2, derivatives[:, :, :3])
    both = spread + ground
    both[~np.isfinite(both)] = 0.0
    sigma = np.sqrt(np.linalg.eigvalsh(both)[:, 1])
    film = photo.interior.film_from_pixel(pixels)
    half = np.array(camera.frame_mm) / 2
    inside = np.all(np.abs(film) < half, axis=1) & np.all(np.isfinite(pixels), axis=1)
    if opened.scan.usable is not None:
        inside &= opened.scan.usable.at(pixels)
    return Prediction(pixels, sigma, inside)


def match_points(
    opened: OpenPhoto,
    reference: Reference,
    prediction: Prediction,
    options: MatchingOptions,
    progress: Progress | None = None,
) -> list[Found]:
    """Search every predicted reference point in a scan, tile by tile."""
    half = search_half_px(prediction, options)
    found = [
        match
        for view, point in looked_at(opened, reference, prediction, half, options, progress)
        for match in [match_point(view, point, int(half[point]), options)]
        if match is not None
    ]
    return sorted(found, key=lambda match: match.point)


def looked_at(
    opened: OpenPhoto,
    reference: Reference,
    prediction: Prediction,
    half: Indices,
    options: MatchingOptions,
    progress: Progress | None = None,
) -> Iterator[tuple[PointView, int]]:
    """Every point of which enough is known and may lie in the picture, tile by tile.

    Args:
        opened: The photo.
        reference: Ortho, heights and roads.
        prediction: Where the points should be.
        half: Half-width of each search, reduced pixels.
        options: Sizes and operators.
        progress: Told as the work goes on.
    """
    todo = np.nonzero(prediction.inside & (half > 0))[0]
    watch = progress or Silent()
    done = 0
    for window, members in tiles(prediction.pixels, todo, half, options):
        watch.report(done, len(todo), opened.photo.photo_id)
        pixels = prediction.pixels[members]
        images = prepared(opened, reference, window, pixels, options)
        for number, point in enumerate(members.tolist()):
            view = view_of(images, number, pixels[[number]], int(half[point]))
            if view is not None:
                yield view, point
        done += len(members)


def search_half_px(prediction: Prediction, options: MatchingOptions) -> Indices:
    """Half-width of each search in reduced pixels."""
    wanted = options.search_sigmas * prediction.sigma_px / options.reduction
    wanted = np.ceil(wanted) + SEPARATION_PX
    wanted = np.where(np.isfinite(wanted), wanted, 0)
    return np.clip(wanted, options.min_search_px, options.max_search_px).astype(np.int64)


def tiles(
    pixels: PixelPoints, todo: Members, half: Indices, options: MatchingOptions
) -> Iterator[tuple[Window, Members]]:
    """Group the points by tile of the scan, each window with room for search and template."""
    if not len(todo):
        return
    side = TILE_PX * options.reduction
    cell = np.floor(pixels[todo] / side).astype(np.int64)
    for key in np.unique(cell, axis=0):
        members = todo[np.all(cell == key, axis=1)]
        margin = (int(half[members].max()) + options.template_half_px + 3) * options.reduction
        low = np.floor(pixels[members].min(axis=0)).astype(np.int64) - margin
        high = np.ceil(pixels[members].max(axis=0)).astype(np.int64) + margin
        size = -(-(high - low) // options.reduction)
        yield (
            Window(int(low[0]), int(low[1]), int(size[0]), int(size[1]), options.reduction),
            members,
        )


def prepared(
    opened: OpenPhoto,
    reference: Reference,
    window: Window,
    pixels: PixelPoints,
    options: MatchingOptions,
) -> Images:
    """A tile and the templates of the points expected in it, described for every operator."""
    operators = {operator.name: operator for operator in options.operators}
    half = options.template_half_px
    part = read_scan(opened, window)
    templates = read_templates(
        opened, reference, pixels, half + max(half // 2, RIM_PX), window.reduction
    )
    return Images(
        part,
        templates,
        half,
        operators,
        {name: operator.of_scan(part.grey, half) for name, operator in operators.items()},
        {
            name: operator.of_reference(templates.reference, templates.roads, half)
            for name, operator in operators.items()
        },
    )


def cut(description: Description, part: Slices) -> Description:
    """The same part of every layer."""
    return tuple(np.ascontiguousarray(layer[part]) for layer in description)


def view_of(images: Images, number: int, pixel: PixelPoints, half: int) -> PointView | None:
    """One point of a tile; None where too little of reference or photograph is there.

    Args:
        images: The tile.
        number: Which of its points.
        pixel: Where the point is expected, (1, 2).
        half: How far around it is searched, pixels of the tile.
    """
    window, inner = images.part.window, images.template_half_px
    column, row = (int(place) for place in window.window_from_pixel(pixel)[0])
    template, around = (
        np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
        for reach in (inner, inner + half)
    )
    patch = images.templates.cell(number, inner)
    known = images.templates.known[patch].mean()
    usable = images.part.usable[template].mean()
    if known < LEAST_KNOWN or usable < LEAST_USABLE:
        return None
    centre = window.pixel_from_window(np.array([[column, row]]) + HALF_PIXEL)
    return PointView(images, around, patch, centre)


def match_point(view: PointView, point: int, half: int, options: MatchingOptions) -> Found | None:
    """Peaks of all operators for one point; None where there is none."""
    maps = {name: view.scores(name) for name in view.images.operators}
    peaks = merged(maps, options)
    reduction, (column, row) = options.reduction, view.centre[0].tolist()
    moved = tuple(
        Peak(
            column + (peak.column - half) * reduction,
            row + (peak.row - half) * reduction,
            peak.sigma_px * reduction,
            peak.z,
            operator,
        )
        for operator, peak in peaks
    )
    return Found(point, moved, peak_area_px2(half, reduction)) if moved else None


def peak_area_px2(half: int, reduction: int) -> float:
    """Area of a search in which a peak may lie, square scan pixels: maxima at its rim are none.

    Args:
        half: Half-width of the search, reduced pixels.
        reduction: Scan pixels to a reduced pixel.
    """
    inner = max(half - SEPARATION_PX, 0)
    return float(((2 * inner + 1) * reduction) ** 2)


def merged(
    surfaces: Mapping[str, ScoreMap], options: MatchingOptions
) -> list[tuple[str, ScorePeak]]:
    """Peaks of all operators, best first; two operators at one place make one candidate."""
    every: list[tuple[str, ScorePeak]] = []
    for operator, surface in surfaces.items():
        for peak in detect_peaks(surface, options.peaks, SEPARATION_PX):
            every.append((operator, peak))
    every.sort(key=lambda named: -named[1].z)
    kept: list[tuple[str, ScorePeak]] = []
    for operator, peak in every:
        same = [index for index, (_, other) in enumerate(kept) if close(peak, other)]
        if not same:
            kept.append((operator, peak))
        elif operator not in (names := kept[same[0]][0].split("+")):
            kept[same[0]] = "+".join(sorted([*names, operator])), kept[same[0]][1]
    return kept


def close(one: ScorePeak, other: ScorePeak) -> bool:
    """Whether two peaks are one place."""
    return bool(np.hypot(one.column - other.column, one.row - other.row) <= SAME_PLACE_PX)


def candidates_of(found: list[Found], sigma_ground_px: Scalars, floor_px: float) -> Candidates:
    """The found peaks as candidates for a resection.

    Args:
        found: Peaks by point, sorted by point.
        sigma_ground_px: Standard deviation of each reference point in this photo, scan pixels.
        floor_px: Least standard deviation of a match, scan pixels.
    """
    rows = [(match, peak) for match in found for peak in match.peaks]
    point = np.array([match.point for match, _ in rows], dtype=np.int64)
    trust = np.array([NCC_TRUST if peak.operator in GREY else 1.0 for _, peak in rows])
    sigma = np.clip([peak.sigma_px for _, peak in rows], floor_px, DULL * floor_px)
    return Candidates(
        point=point,
        pixels=np.array([[peak.column, peak.row] for _, peak in rows]).reshape(-1, 2),
        sigma_px=np.hypot(sigma, sigma_ground_px[point]),
        weight=trust * np.array([peak.score**2 for _, peak in rows]),
        trust=trust,
        chance=np.array([1.0 / match.searched_px2 for match, _ in rows]),
    )


def reduction_for(opened: OpenPhoto, gsd_m: float) -> int:
    """Whole reduction of a scan that comes closest to a ground sample distance from below."""
    # design: up to a quarter of a scan pixel coarser than asked for, rather than nearly twice as
    # fine.
    return max(1, int(np.floor(gsd_m / opened.ground_pixel_m + 0.25)))
