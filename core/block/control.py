"""Control proposals: reference points searched near where the block says they are.

Every search looks much further than the block can be off. What it finds there, and with the
template mirrored, is certainly wrong, and tells what chance brings about in these very photos: from
that comes the probability of each candidate (`core.block.registration.probability`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from core.arrays import Scalars
from core.block.block import Block, Measurement, Peak, Source, SurveyedPoint
from core.block.registration.matching import (
    DULL,
    SEPARATION_PX,
    Images,
    MatchingOptions,
    cut,
    looked_at,
    parts_about,
    predict_pixels,
)
from core.block.registration.operators import has_roads
from core.block.registration.orientation import (
    OrientationOptions,
    ReferencePoints,
    finest_reduction,
    ground_sigma_px,
)
from core.block.registration.patches import OpenPhoto
from core.block.registration.probability import Calibration, Searches, probabilities
from core.block.registration.similarity import FLAT, Surface, detect_peaks
from core.progress import Progress
from core.reference.reference import Reference

Kind = tuple[Source, bool]
"""Where a point comes from, and whether roads say where it is: peaks of one kind look alike."""
MATCH_FLOOR_PX = 0.35
"""No match is better than this, in pixels of the pass."""
CANDIDATES = 8
"""So many peaks near a prediction are weighed against each other."""
EVEN = 0.5
"""Below this probability a candidate is not preferred for being near."""
MIRRORED_EVERY = 4
"""The template of every fourth point is searched mirrored too."""


@dataclass(frozen=True, slots=True)
class ControlOptions:
    """What is searched, and what makes a proposal one that is used."""

    search_m: float = 6.0
    """A candidate lies no further from the block's prediction along either axis, metres."""
    decoys_m: float = 24.0
    """Half-width of the search; what lies beyond `search_m` is wrong, metres."""
    prediction_sigma_m: float = 0.5
    """Standard deviation per axis of the block's prediction, metres."""
    accept: float = 0.95
    """A candidate as probable as this is used."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """One reference point searched in one photo."""

    point_id: str
    """The point."""
    photo_id: str
    """The photo."""
    roads: bool
    """Whether the roads drawn in its template say where it is."""
    peaks: tuple[Peak, ...]
    """Candidates near the prediction, best first, scan pixels."""
    distance_m: Scalars
    """Distance of each from the prediction on the ground, metres."""
    sigma_m: Scalars
    """Standard deviation per axis of that distance, were the candidate right, metres."""
    decoys: tuple[float, ...]
    """Heights of all peaks that are certainly wrong."""
    decoy_area_m2: float
    """Area they were found on."""


def search_points(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    orientation: OrientationOptions,
    options: ControlOptions,
    progress: Progress | None = None,
) -> tuple[Search, ...]:
    """Search all reference points in one photo of an oriented block.

    Args:
        opened: The photo with the block's orientation.
        reference: Ortho, heights and roads.
        points: Junctions and salient points.
        orientation: Sizes, and the operator: the first named.
        options: How far to look.
        progress: Told as the work goes on.
    """
    reduction = finest_reduction(opened, reference, orientation)
    pixel_m = opened.ground_pixel_m * reduction
    half = max(int(np.ceil(options.decoys_m / pixel_m)), 5 * SEPARATION_PX)
    inner = max(int(np.ceil(options.search_m / pixel_m)), 2 * SEPARATION_PX)
    matching = MatchingOptions(
        reduction=reduction,
        template_half_px=orientation.template_half_px,
        operators=orientation.operators[:1],
        min_search_px=half,
        max_search_px=half,
    )
    prediction = predict_pixels(opened, np.zeros((6, 6)), points.positions, points.sigma_m)
    sigma_px = ground_sigma_px(opened, points.sigma_m)
    halves = np.full(len(points.ids), half)
    found: list[Search] = []
    for images, point in looked_at(opened, reference, prediction, halves, matching, progress):
        pixel = prediction.pixels[point]
        seen = surfaces_about(images, pixel, half, matching, point % MIRRORED_EVERY == 0)
        if seen is None:
            continue
        point_sigma_m = float(sigma_px[point]) * opened.ground_pixel_m
        sigma_m = float(np.hypot(point_sigma_m, options.prediction_sigma_m))
        peaks, decoys, area_px2 = weighed(seen[:2], half, inner, matching)
        offset = np.array([[peak.column, peak.row] for peak in peaks]).reshape(-1, 2)
        floor_px = MATCH_FLOOR_PX * reduction
        match_px = np.clip([peak.sigma_px for peak in peaks], floor_px, DULL * floor_px)
        found.append(
            Search(
                points.ids[point],
                opened.photo.photo_id,
                seen[2],
                tuple(moved(peak, pixel) for peak in peaks),
                np.hypot(*offset.T) * opened.ground_pixel_m,
                np.hypot(match_px * opened.ground_pixel_m, sigma_m),
                decoys,
                area_px2 * pixel_m**2,
            )
        )
    return tuple(sorted(found, key=lambda search: search.point_id))


def moved(peak: Peak, pixel: np.ndarray) -> Peak:
    """A peak given as an offset, in scan pixels."""
    return replace(peak, column=peak.column + float(pixel[0]), row=peak.row + float(pixel[1]))


def surfaces_about(
    images: Images,
    pixel: np.ndarray,
    half: int,
    matching: MatchingOptions,
    mirror: bool,
) -> tuple[Surface, Surface | None, bool] | None:
    """The surface of a point, that of its mirrored template, and whether roads place it."""
    parts = parts_about(images, pixel, half, matching.template_half_px)
    if parts is None:
        return None
    name = matching.operators[0]
    surface = images.surface(name, *parts)
    mirrored = images.mirrored_surface(name, *parts) if mirror else None
    return surface, mirrored, has_roads(cut(images.reference[name], parts[1]))


def weighed(
    surfaces: tuple[Surface, Surface | None], half: int, inner: int, matching: MatchingOptions
) -> tuple[tuple[Peak, ...], tuple[float, ...], float]:
    """Peaks near the prediction as offsets in scan pixels; decoys, and the area they come from.

    Args:
        surfaces: That of the point, and that of its mirrored template where it was searched.
        half: Half-width of the search, pixels of the pass.
        inner: Half-width of the part where a peak may be right.
        matching: The pass.
    """
    surface, mirrored = surfaces
    decoys, middle, spread = decoys_of(surface, inner)
    area = float(surface.size - (2 * inner + 1) ** 2)
    if mirrored is not None:
        decoys, area = decoys + decoys_of(mirrored, -1)[0], area + mirrored.size
    return candidates_near(surface, half, inner, middle, spread, matching), decoys, area


def decoys_of(surface: Surface, inner: int) -> tuple[tuple[float, ...], float, float]:
    """Heights of all maxima outside the middle of a surface, and its middle and spread there.

    Args:
        surface: Likeness by place.
        inner: Half-width of the middle; -1 leaves nothing out.
    """
    rows, columns = surface.shape
    outside = np.ones(surface.shape, bool)
    row, column = rows // 2, columns // 2
    outside[row - inner : row + inner + 1, column - inner : column + inner + 1] = False
    values = surface[outside]
    middle = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - middle))) + FLAT
    kernel = np.ones((2 * SEPARATION_PX + 1, 2 * SEPARATION_PX + 1), np.uint8)
    maxima = (surface >= cv2.dilate(surface, kernel)) & outside & (surface > middle)
    heights = (surface[maxima] - middle) / spread
    return tuple(float(height) for height in heights), middle, spread


def candidates_near(
    surface: Surface,
    half: int,
    inner: int,
    middle: float,
    spread: float,
    matching: MatchingOptions,
) -> tuple[Peak, ...]:
    """Peaks near the prediction as offsets in scan pixels, heights in deviations of the decoys."""
    rim = inner + SEPARATION_PX
    near = np.ascontiguousarray(surface[half - rim : half + rim + 1, half - rim : half + rim + 1])
    return tuple(
        Peak(
            (peak.column - rim) * matching.reduction,
            (peak.row - rim) * matching.reduction,
            peak.sigma_px * matching.reduction,
            (peak.value - middle) / spread,
            matching.operators[0],
        )
        for peak in detect_peaks(near, CANDIDATES, SEPARATION_PX)
    )


def judged(
    searches: Sequence[Search], sources: Mapping[str, Source], options: ControlOptions
) -> tuple[tuple[Measurement, ...], Mapping[Kind, Calibration | None]]:
    """One measurement of every search that found anything, with the probability that it is right.

    Args:
        searches: All searches of a block.
        sources: Where the points come from.
        options: What is used.

    Returns:
        The measurements, used or with the reason why not, and what the probabilities of searches
        of each kind rest on.
    """
    kinds: list[Kind] = [
        (sources.get(search.point_id, "surveyed"), search.roads) for search in searches
    ]
    measured: dict[int, Measurement] = {}
    resting: dict[Kind, Calibration | None] = {}
    for kind in sorted(set(kinds)):
        rows = [row for row, other in enumerate(kinds) if other == kind]
        chosen = [searches[row] for row in rows]
        right, resting[kind] = probabilities(pooled(chosen))
        first = np.cumsum([0, *(len(search.peaks) for search in chosen)])
        for row, search, start, end in zip(rows, chosen, first[:-1], first[1:], strict=True):
            if search.peaks:
                measured[row] = measurement_of(search, right[start:end], options)
    return tuple(measured[row] for row in sorted(measured)), resting


def pooled(searches: Sequence[Search]) -> Searches:
    """Searches of one kind as parallel arrays."""
    return Searches(
        np.repeat(np.arange(len(searches)), [len(search.peaks) for search in searches]),
        np.array([peak.score for search in searches for peak in search.peaks], dtype=np.float64),
        np.concatenate([np.zeros(0), *(search.distance_m for search in searches)]),
        np.concatenate([np.zeros(0), *(search.sigma_m for search in searches)]),
        len(searches),
        np.array([height for search in searches for height in search.decoys], dtype=np.float64),
        float(sum(search.decoy_area_m2 for search in searches)),
    )


def measurement_of(search: Search, right: Scalars, options: ControlOptions) -> Measurement:
    """The most probable candidate, used when it is probable enough; if none is, the highest."""
    best = int(np.argmax(right)) if right.max() >= EVEN else 0
    peak, probability = search.peaks[best], float(right[best])
    others = tuple(other for index, other in enumerate(search.peaks) if index != best)
    reason = "" if probability >= options.accept else f"right with probability {probability:.2f}"
    return Measurement(
        search.point_id,
        search.photo_id,
        peak.column,
        peak.row,
        peak.sigma_px,
        probability,
        "unused" if reason else "auto",
        reason,
        (peak, *others),
    )


def surveyed_of(points: ReferencePoints, sources: Mapping[str, Source]) -> dict[str, SurveyedPoint]:
    """Reference points as control points."""
    return {
        point_id: SurveyedPoint(point_id, position, sigma, "control", sources[point_id])
        for point_id, position, sigma in zip(
            points.ids, points.positions, points.sigma_m, strict=True
        )
    }


def with_proposals(
    block: Block,
    points: ReferencePoints,
    sources: Mapping[str, Source],
    measurements: tuple[Measurement, ...],
) -> Block:
    """The block with newly proposed control in place of all that was proposed before.

    Surveyed points of the user stay, and so does whatever was measured of them.
    """
    kept = {name: point for name, point in block.surveyed.items() if point.source == "surveyed"}
    measured = {key: value for key, value in block.measurements.items() if key[0] in kept}
    measured.update({value.key: value for value in measurements})
    named = {key[0] for key in measured}
    surveyed = {
        name: point
        for name, point in {**surveyed_of(points, sources), **kept}.items()
        if name in named or name in kept
    }
    return replace(block, surveyed=surveyed, measurements=dict(sorted(measured.items())))
