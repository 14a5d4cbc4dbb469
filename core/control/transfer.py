"""A point measured in some photos, proposed in all others that show it: place to place.

Its rays, and the height of the ground where one ray alone is known, say where every other photo
should show it, and how surely. What the measured photos show there is sought about that place
(`core/control/photo_templates.py`), all of them voting, and laid onto it by least squares. How
probable a proposal is, the search itself tells, as that of control does
(`core/matching/probability.py`): peaks too far from the prediction, and those of mirrored
templates, say what chance brings about in these very windows. Nothing is learned beforehand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from core.block import UNKNOWN_M, Measurement, Peak, SurveyedPoint
from core.control.located import (
    ABOVE_GROUND_M,
    Located,
    Plane,
    Surroundings,
    expected_spread,
    locate_point,
    pointing_px,
    slope_at,
    usable,
)
from core.control.photo_templates import (
    FinePlace,
    Looked,
    Shown,
    ShownInOrtho,
    Source,
    finely,
    looked,
    peak_sigma_px,
)
from core.control.search import decoys_outside
from core.doubts import Failure
from core.matching.local_search import SEPARATION_PX
from core.matching.peaks import ScorePeak, detect_peaks, level_and_spread
from core.matching.precision import FREEDOM
from core.matching.probability import GATE, Searches, probabilities
from core.raster.ortho import Ortho
from core.said import say

# design: chance needs room to show itself: some sixty peaks of two surfaces and more.
LEAST_SEARCH_PX = 28
"""Least half-width of a search, pixels of the pass."""
# design: time; a wider search begins on a reduced scan.
MOST_SEARCH_PX = 60
"""Greatest half-width of a search, pixels of the pass."""
# design: more than one in eight is right nowhere that anything is found at all.
CANDIDATES = 8
"""So many peaks near a prediction are weighed against each other."""
# design: what a peak of a pass is off by, before it is refined.
PEAK_PX = 1.0
"""Standard deviation per axis of a peak's place, pixels of the pass."""
# design: film, lens and interior orientation bend by a pixel or two what no adjustment tells.
UNTOLD_PX = 2.0
"""Standard deviation per axis of a prediction beyond what all orientations together tell, scan
pixels. Where each photo is judged by itself, what they share counts twice and makes up for it."""
# design: 5 mm of a frame of 230 mm at 15 micrometres are 300 px; less is still photograph.
EDGE_PX = 8.0
"""Nearer than this to the edge of a scan nothing is proposed, pixels."""
# design: what an operator sees at once; decisions hold on to a place that near as well.
RIGHT_PX = 2.0
"""A proposal is right when it lies no further than this from the place, scan pixels."""
# design: with ten pixels a proposal is right one time in fifty at best.
MOST_SIGMA_PX = 10.0
"""A place known no better than this is none, scan pixels."""
OPERATOR = "photo"
"""What the peaks of a proposal say they were found by."""


@dataclass(frozen=True, slots=True, eq=False)
class Transferred:
    """Where other photos show a point, and why some do not."""

    point_id: str
    """The point."""
    proposals: tuple[Measurement, ...]
    """One of each photo in which something was found, most probable first: `dubious` until somebody
    accepts it, `score` the probability that it is right, every candidate among its peaks."""
    failures: Mapping[str, Failure]
    """Why nothing is proposed, by photo; of photos that cannot show it at all there is no word."""

    def probability(self, photo_id: str) -> float:
        """Probability that the proposal in a photo is right; nought without one."""
        return next((item.score for item in self.proposals if item.photo_id == photo_id), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A point searched in one photo."""

    photo_id: str
    target: Shown
    covariance: Plane
    looked: Looked
    peaks: tuple[ScorePeak, ...]
    heights: tuple[float, ...]
    sigmas: tuple[float, ...]
    decoys: tuple[float, ...]
    decoy_area_px2: float


def transfer_point(
    around: Surroundings, point_id: str, measured: Sequence[Measurement]
) -> Transferred | Failure:
    """Propose a point in all photos that show it and in which it is not measured yet.

    Args:
        around: The block and its scans.
        point_id: The point; need not be among the surveyed ones.
        measured: Where it is measured, one or more photos; all of them vote.

    Returns:
        The proposals, or why the point cannot be looked for at all.
    """
    sources = [item for item in measured if usable(around, item.photo_id)]
    if not sources:
        return Failure("the point is measured in no oriented photo")
    where = locate_point(around, sources, around.block.surveyed.get(point_id))
    if isinstance(where, Failure):
        return where
    votes = [shown(around, where, item) for item in sources]
    done = {item.photo_id for item in measured}
    return proposed(around, point_id, where, votes, done, pointing_px(sources))


def propose_by_ortho(
    around: Surroundings, point: SurveyedPoint, ortho: Ortho, ortho_sigma_m: float
) -> Transferred | Failure:
    """Propose a point that no photo has been measured in, by what an ortho shows at its place.

    How far the ortho itself may be off there counts with the prediction and with each place.

    Args:
        around: The block and its scans.
        point: The point, with coordinates.
        ortho: The ortho.
        ortho_sigma_m: Its standard deviation per axis, metres.
    """
    if point.sigma_m[0] >= UNKNOWN_M:
        return Failure("its place in the ortho is not known")
    position, sigma_m = point.position.copy(), point.sigma_m.copy()
    if sigma_m[2] >= UNKNOWN_M:
        known = np.nan if around.heights is None else around.heights.heights(position[None, :2])[0]
        if not np.isfinite(known):
            return Failure("its height is not known")
        position[2], sigma_m[2] = known, ABOVE_GROUND_M
    off = float(np.hypot(ortho_sigma_m, sigma_m[:2].max()))
    covariance = np.diag([off**2, off**2, sigma_m[2] ** 2])
    where = Located(position, covariance, slope_at(around, position))
    block = around.block
    pixels_m = [p.ground_pixel_m(block.camera_of(name)) for name, p in block.photos.items()]
    pointing = off / float(np.median(pixels_m))
    return proposed(
        around, point.point_id, where, [ShownInOrtho(ortho, position[:2])], set(), pointing
    )


def refine_place(
    around: Surroundings, place: Measurement, measured: Sequence[Measurement]
) -> Measurement | Failure:
    """A place in a photo laid by least squares onto what other photos show of its point.

    Args:
        around: The block and its scans.
        place: Where the point is pointed at, a pixel or two beside it.
        measured: Where it is measured; the photo itself does not count.
    """
    sources = [m for m in measured if m.photo_id != place.photo_id and usable(around, m.photo_id)]
    if not sources or not usable(around, place.photo_id):
        return Failure("the point is measured in no other oriented photo")
    where = locate_point(around, sources, around.block.surveyed.get(place.point_id))
    if isinstance(where, Failure):
        return where
    target = Shown.of(around.opened(place.photo_id), where.position, where.slope).at(place.pixel)
    fine = [finely(shown(around, where, source), target) for source in sources]
    places = [one for one in fine if one is not None]
    if not places:
        return Failure("nothing there looks like the place that was measured")
    pixel, sigma = _mean(places)
    column, row = (float(value) for value in pixel[0])
    sigma = float(np.hypot(sigma, pointing_px(sources)))
    return replace(place, column=column, row=row, sigma_px=sigma)


def shown(around: Surroundings, where: Located, item: Measurement) -> Shown:
    """The place of a measurement, as its photo lies over the ground there."""
    place = Shown.of(around.opened(item.photo_id), where.position, where.slope)
    return place.at(item.pixel)


def proposed(
    around: Surroundings,
    point_id: str,
    where: Located,
    sources: Sequence[Source],
    done: set[str],
    pointing: float,
) -> Transferred:
    """Search all photos that should show the place, and judge what is found together."""
    failures: dict[str, Failure] = {}
    searches: list[_Search] = []
    for photo_id in around.block.photos:
        if photo_id in done or not usable(around, photo_id):
            continue
        target = Shown.of(around.opened(photo_id), where.position, where.slope)
        if not _inside(target):
            continue
        spread = expected_spread(around, where, target.opened.photo)
        untold = UNTOLD_PX if where.joint is not None else 0.0
        covariance = spread + np.eye(2) * untold**2
        found = _searched(photo_id, sources, target, covariance)
        if isinstance(found, Failure):
            failures[photo_id] = found
        else:
            searches.append(found)
    proposals: list[Measurement] = []
    for search, right in zip(searches, _judged(searches), strict=True):
        made = _measurement(point_id, search, right, sources, pointing)
        if isinstance(made, Failure):
            failures[search.photo_id] = made
        else:
            proposals.append(made)
    proposals.sort(key=lambda item: -item.score)
    return Transferred(point_id, tuple(proposals), failures)


def _inside(target: Shown) -> bool:
    """Whether the place is on the photograph, away from the edge of the scan."""
    pixel, photo = target.pixel, target.opened.photo
    size = np.array(photo.size_px)
    if not (np.isfinite(pixel).all() and ((pixel > EDGE_PX) & (pixel < size - EDGE_PX)).all()):
        return False
    off = np.abs(photo.interior.film_from_pixel(pixel)[0])
    usable = target.opened.scan.usable
    on_film = bool((off < np.array(target.opened.camera.frame_mm) / 2).all())
    return on_film and (usable is None or bool(usable.at(pixel)[0]))


def _searched(
    photo_id: str, sources: Sequence[Source], target: Shown, covariance: Plane
) -> _Search | Failure:
    """Look for the place in one photo, no further away than it can be."""
    reach = GATE * np.sqrt(np.diag(covariance))
    reduction = max(1, int(np.ceil(float(reach.max()) / MOST_SEARCH_PX)))
    covariance = covariance + np.eye(2) * (PEAK_PX * reduction) ** 2
    half = np.maximum(np.ceil(reach / reduction) + 2 * SEPARATION_PX, LEAST_SEARCH_PX)
    found = looked(sources, target, (int(half[0]), int(half[1])), reduction)
    if found is None:
        return Failure("too little of its surroundings is photograph here")
    distance = _distances(found, target, covariance)
    level, spread = level_and_spread(found.surface)
    peaks = tuple(
        peak
        for peak in detect_peaks(found.surface, 4 * CANDIDATES, SEPARATION_PX)
        if distance[round(peak.row), round(peak.column)] <= GATE
    )[:CANDIDATES]
    if not peaks:
        return Failure("nothing like it is seen where it should be")
    decoys, area = _chance(found, distance > GATE, peaks[0])
    return _Search(
        photo_id,
        target,
        covariance,
        found,
        peaks,
        tuple((peak.value - level) / spread for peak in peaks),
        tuple(float(distance[round(peak.row), round(peak.column)]) for peak in peaks),
        decoys,
        area * reduction**2,
    )


def _distances(
    found: Looked, target: Shown, covariance: Plane
) -> Float64[np.ndarray, "rows columns"]:
    """How far every place of a surface is from the prediction, in standard deviations."""
    rows, columns = np.indices(found.surface.shape)
    places = found.pixel_of(0.0, 0.0) - target.pixel
    across = places[0, 0] + columns * found.reduction
    down = places[0, 1] + rows * found.reduction
    inverse = np.linalg.inv(covariance)
    squared = inverse[0, 0] * across**2 + inverse[1, 1] * down**2
    return np.sqrt(squared + 2 * inverse[0, 1] * across * down)


def _chance(found: Looked, outside: np.ndarray, best: ScorePeak) -> tuple[tuple[float, ...], float]:
    """Heights of peaks that are certainly wrong, and the area they were found on, pixels.

    The place itself may look alike in a mirror: there mirrored templates say nothing.
    """
    rows, columns = np.indices(found.surface.shape)
    away = np.hypot(rows - best.row, columns - best.column) > 2 * SEPARATION_PX
    heights, area = list[float](), 0.0
    for surface, wrong in ((found.surface, outside), *((other, away) for other in found.chance)):
        if wrong.sum() > SEPARATION_PX**2:
            heights += decoys_outside(surface, wrong, SEPARATION_PX)[0]
            area += float(wrong.sum())
    return tuple(heights), area


def _judged(searches: Sequence[_Search]) -> list[np.ndarray]:
    """Probability of each candidate of each search, by what all searches of the point say."""
    if not searches:
        return []
    counts = [len(search.peaks) for search in searches]
    scale = np.concatenate(
        [np.full(len(s.peaks), np.linalg.det(s.covariance) ** 0.25) for s in searches]
    )
    distance = np.concatenate([np.array(search.sigmas) for search in searches])
    together = Searches(
        np.repeat(np.arange(len(searches)), counts),
        np.array([height for search in searches for height in search.heights]),
        distance * scale,
        scale,
        len(searches),
        np.array([height for search in searches for height in search.decoys]),
        float(sum(search.decoy_area_px2 for search in searches)),
    )
    right, _ = probabilities(together)
    return np.split(right, np.cumsum(counts)[:-1])


def _measurement(
    point_id: str, search: _Search, right: np.ndarray, sources: Sequence[Source], pointing: float
) -> Measurement | Failure:
    """The most probable candidate, finely measured."""
    best = int(np.argmax(right))
    pixel, sigma = _refined(search, search.peaks[best], sources)
    place, sigma = (float(pixel[0, 0]), float(pixel[0, 1])), float(np.hypot(sigma, pointing))
    first = Peak(*place, sigma, search.heights[best], OPERATOR)
    others = [_peak(search, number) for number in range(len(search.peaks)) if number != best]
    if not sigma < MOST_SIGMA_PX:
        return Failure("nothing there looks like the place that was measured")
    # source: Student's law in the plane, of an error whose deviation is estimated.
    near = 1.0 - (1.0 + (RIGHT_PX / sigma) ** 2 / FREEDOM) ** (-FREEDOM / 2)
    probability = float(right[best] * near)
    names = ", ".join(sorted(source.name for source in sources))
    reason = say(
        "proposed from {photos}, right with probability {probability:.2f}",
        photos=names,
        probability=probability,
    )
    return Measurement(
        point_id, search.photo_id, *place, sigma, probability, "dubious", reason,
        (first, *others),
    )  # fmt: skip


def _peak(search: _Search, number: int) -> Peak:
    """A candidate as it was found."""
    found, reduction = search.peaks[number], search.looked.reduction
    column, row = search.looked.pixel_of(found.column, found.row)[0].tolist()
    return Peak(column, row, PEAK_PX * reduction, search.heights[number], OPERATOR)


def _refined(
    search: _Search, peak: ScorePeak, sources: Sequence[Source]
) -> tuple[np.ndarray, float]:
    """The place of a candidate to a part of a pixel, (1, 2), and its standard deviation."""
    reduction = search.looked.reduction
    pixel = search.looked.pixel_of(peak.column, peak.row)
    while reduction > 1:
        finer = max(1, reduction // 3)
        half = 2 * reduction // finer + SEPARATION_PX + 1
        again = looked(sources, search.target.at(pixel), (half, half), finer)
        peaks = () if again is None else detect_peaks(again.surface, 1, SEPARATION_PX)
        if again is None or not peaks:
            return pixel, PEAK_PX * reduction
        pixel, reduction = again.pixel_of(peaks[0].column, peaks[0].row), finer
    fine = [finely(source, search.target.at(pixel)) for source in sources]
    places = [place for place in fine if place is not None]
    if places:
        return _mean(places)
    there = search.target.at(pixel)
    return pixel, min(max(peak_sigma_px(source, there), PEAK_PX) for source in sources)


def _mean(places: Sequence[FinePlace]) -> tuple[np.ndarray, float]:
    """Weighted mean of what several photos say; where they differ by more, that is its sigma."""
    pixels = np.concatenate([place.pixel for place in places])
    weights = np.array([place.sigma_px**-2 for place in places])
    mean = weights @ pixels / weights.sum()
    if len(places) < 2:
        return mean[None], places[0].sigma_px
    # design: half of each variance is noise of the photo itself, which no further source averages.
    formal = min(((len(places) + 1) / 2 / weights.sum()) ** 0.5, min(p.sigma_px for p in places))
    spread = weights @ np.sum((pixels - mean) ** 2, axis=1) / weights.sum() / 2
    return mean[None], float(max(formal, np.sqrt(spread / (len(places) - 1))))
