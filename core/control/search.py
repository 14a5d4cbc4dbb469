"""Search of reference points around their predicted places.

The first search looks much further than the block can be off: peaks out there, and those of a
mirrored template, are certainly wrong and show how high chance peaks are in these photos. Once that
is known, later rounds look no further than a right candidate can lie; and where the block has
hardly moved, earlier peaks are only measured from the new prediction.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.arrays import Flags, Mask, PixelPoints, Scalars
from core.block import Peak
from core.localisation.photo_orientation import (
    OrientationOptions,
    finest_reduction,
    ground_sigma_px,
)
from core.matching.local_search import (
    DULL,
    MATCH_FLOOR_PX,
    SEPARATION_PX,
    MatchingOptions,
    PointView,
    Prediction,
    looked_at,
    predict_pixels,
)
from core.matching.operators import has_roads
from core.matching.patches import OpenPhoto
from core.matching.peaks import ScoreMap, detect_peaks, level_and_spread, local_maxima
from core.matching.reference import Reference
from core.progress import Progress
from core.raster.scan_file import ScanFile
from core.reference.stage import ReferencePoints

Keep = Callable[[str, str, ScoreMap], None]
"""Is told the surface of a point in a photo, by their names."""
# design: what a block that hangs together by ties is still off at an edge without control.
SEARCH_M = 6.0
"""A candidate lies no further from the block's prediction along either axis, metres."""
# design: time; fifteen times as much ground is certainly wrong as may be right.
DECOYS_M = 24.0
"""Half-width of the first search; what lies beyond `SEARCH_M` is wrong, metres."""
# design: a pixel of the pass or two; the block's own sigma is known only after control.
PREDICTION_SIGMA_M = 0.5
"""Standard deviation per axis of the block's prediction, metres."""
# measured: prove_peak_sigma; error without any noise, which is that of the paraboloid.
PEAK_FLOOR_PX = 0.025
"""No peak is found better than this, pixels of the pass."""
# design: more than one in eight is right nowhere that control is found at all.
CANDIDATES = 8
"""So many peaks near a prediction are weighed against each other."""
# design: time; decoys of all other points are at hand as well.
MIRRORED_EVERY = 4
"""The template of every fourth point is searched mirrored too."""
# design: time; a map drawn a pixel aside has the same peaks.
STILL_PX = 1.0
"""Predictions that moved no more than this, in pixels of the pass, need no new search: a peak stays
where it is in the scan."""


@dataclass(frozen=True, slots=True)
class Chance:
    """What one search says of chance."""

    heights: tuple[float, ...]
    """Heights of all peaks that are certainly wrong."""
    area_m2: float
    """Area they were found on."""
    middle: float
    """Median of the surface where nothing can be right."""
    spread: float
    """Robust standard deviation of the surface there."""
    inner_m2: float = (2 * SEARCH_M) ** 2
    """Area of the middle, where candidates are looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """One reference point searched in one photo."""

    point_id: str
    """The point."""
    photo_id: str
    """The photo."""
    roads: bool
    """Whether the roads drawn in its template say where it is."""
    predicted: tuple[float, float]
    """Middle of its score map, the centre of a pixel: where it was expected, scan pixels."""
    peaks: tuple[Peak, ...]
    """Candidates near the prediction, best first, scan pixels."""
    distance_m: Scalars
    """Distance of each from the prediction on the ground, metres."""
    sigma_m: Scalars
    """Standard deviation per axis of that distance, were the candidate right, metres."""
    chance: Chance
    """What is certainly wrong about it."""
    pixel_m: float
    """Size of a scan pixel on the ground, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """How the points of one photo are searched."""

    matching: MatchingOptions
    """Sizes of the pass and the operator."""
    pixel_m: float
    """Size of a pixel of the pass on the ground, metres."""
    wide: int
    """Half-width of a first search, pixels of the pass."""
    inner: int
    """Half-width of the part where a peak may be right."""
    point_sigma_m: Scalars
    """Standard deviation per axis of each point's distance from its prediction, metres."""

    @property
    def narrow(self) -> int:
        """Half-width of a later search."""
        return min(self.inner + SEPARATION_PX, self.wide)


def search_points(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    orientation: OrientationOptions,
    progress: Progress | None = None,
    before: Sequence[Search] = (),
    keep: Keep | None = None,
) -> tuple[Search, ...]:
    """Search all reference points in one photo of an oriented block.

    Args:
        opened: The photo with the block's orientation.
        reference: Ortho, heights and roads.
        points: Junctions and salient points.
        orientation: Sizes, and the operator: the first named.
        progress: Told as the work goes on.
        before: What was found in this photo before the block moved last.
        keep: Told every surface; whatever is searched then is searched far around.
    """
    plan = plan_search(opened, reference, points, orientation)
    prediction = predict_pixels(opened, np.zeros((6, 6)), points.positions, points.sigma_m)
    known = {search.point_id: search for search in before}
    away_px = farthest(points, prediction.pixels, known) / plan.matching.reduction
    if known and away_px <= STILL_PX:
        found = [
            seen_from(known[name], prediction.pixels[point], plan, opened, point)
            for point, name in enumerate(points.ids)
            if name in known and prediction.inside[point]
        ]
    else:
        known = {} if away_px * plan.pixel_m > SEARCH_M else known
        found = searched(opened, reference, points, plan, prediction, known, progress, keep)
    return tuple(sorted(found, key=lambda search: search.point_id))


def plan_search(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    orientation: OrientationOptions,
) -> Plan:
    """Sizes for one photo."""
    reduction = finest_reduction(opened, reference, orientation)
    pixel_m = opened.ground_pixel_m * reduction
    # design: room for decoys about the middle also where pixels are coarse.
    wide = max(int(np.ceil(DECOYS_M / pixel_m)), 5 * SEPARATION_PX)
    matching = MatchingOptions(
        reduction=reduction,
        template_half_px=orientation.template_half_px,
        operators=orientation.operators[:1],
        min_search_px=wide,
        max_search_px=wide,
    )
    inner = max(int(np.ceil(SEARCH_M / pixel_m)), 2 * SEPARATION_PX)
    sigma_m = ground_sigma_px(opened, points.sigma_m) * opened.ground_pixel_m
    return Plan(matching, pixel_m, wide, inner, np.hypot(sigma_m, PREDICTION_SIGMA_M))


def farthest(points: ReferencePoints, pixels: PixelPoints, known: Mapping[str, Search]) -> float:
    """How far predictions moved at most since they were searched, scan pixels."""
    rows = [row for row, name in enumerate(points.ids) if name in known]
    before = np.array([known[points.ids[row]].predicted for row in rows]).reshape(-1, 2)
    return float(np.hypot(*(pixels[rows] - before).T).max(initial=0.0))


def searched(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    plan: Plan,
    prediction: Prediction,
    known: Mapping[str, Search],
    progress: Progress | None,
    keep: Keep | None = None,
) -> list[Search]:
    """Search every point: far around, or as far as needed where chance is known already."""
    matching = plan.matching
    near = set(known) if keep is None else set[str]()
    halves = np.array([plan.narrow if name in near else plan.wide for name in points.ids])
    found: list[Search] = []
    for view, point in looked_at(opened, reference, prediction, halves, matching, progress):
        name = points.ids[point]
        before = known.get(name)
        mirror = before is None and point % MIRRORED_EVERY == 0
        surface, mirrored, roads = surfaces_about(view, matching, mirror)
        if keep is not None:
            keep(name, opened.photo.photo_id, surface)
        chance = chance_of(surface, mirrored, plan) if before is None else before.chance
        peaks = candidates_near(surface, plan, chance)
        sigma_px = matching.reduction * best_sigma_px(view, surface, peaks, plan, chance)
        place = float(view.centre[0, 0]), float(view.centre[0, 1])
        empty = np.zeros(0)
        one = Search(
            name,
            opened.photo.photo_id,
            roads if before is None else before.roads,
            place,
            tuple(
                replace(
                    peak,
                    column=peak.column + place[0],
                    row=peak.row + place[1],
                    sigma_px=sigma_px,
                )
                for peak in peaks
            ),
            empty,
            empty,
            chance,
            opened.ground_pixel_m,
        )
        found.append(seen_from(one, prediction.pixels[point], plan, opened, point))
    return found


def seen_from(
    search: Search, pixel: np.ndarray, plan: Plan, opened: OpenPhoto, point: int
) -> Search:
    """A search with its candidates measured from where the point is expected now."""
    places = np.array([[peak.column, peak.row] for peak in search.peaks]).reshape(-1, 2)
    return replace(
        search,
        distance_m=np.hypot(*(places - pixel).T) * opened.ground_pixel_m,
        sigma_m=sigma_on_ground_m(
            search.peaks,
            plan.matching.reduction,
            opened.ground_pixel_m,
            float(plan.point_sigma_m[point]),
        ),
    )


def on_photograph(searches: Sequence[Search], scans: Mapping[str, ScanFile]) -> tuple[Search, ...]:
    """Searches without candidates that lie where their scan is no photograph.

    A point is searched where it is expected on photograph; a note or a housing beside it may look
    more like the template than the ground does.
    """
    usable: dict[str, Flags] = {}
    for name in {search.photo_id for search in searches}:
        area = scans[name].usable
        own = [(p.column, p.row) for one in searches if one.photo_id == name for p in one.peaks]
        if area is not None:
            usable[name] = area.at(np.array(own, dtype=np.float64).reshape(-1, 2))
    left: list[Search] = []
    for search in searches:
        if search.photo_id not in usable:
            left.append(search)
            continue
        count = len(search.peaks)
        may, usable[search.photo_id] = np.split(usable[search.photo_id], [count])
        peaks = tuple(peak for peak, kept in zip(search.peaks, may, strict=True) if kept)
        fewer = replace(
            search, peaks=peaks, distance_m=search.distance_m[may], sigma_m=search.sigma_m[may]
        )
        left.append(search if may.all() else fewer)
    return tuple(left)


def sigma_on_ground_m(
    peaks: Sequence[Peak], reduction: int, pixel_m: float, point_sigma_m: float
) -> Scalars:
    """Standard deviation per axis of the distance of candidates from the prediction, metres."""
    floor_px = MATCH_FLOOR_PX * reduction
    match_px = np.clip([peak.sigma_px for peak in peaks], floor_px, DULL * floor_px)
    return np.hypot(match_px * pixel_m, point_sigma_m)


def surfaces_about(
    view: PointView, matching: MatchingOptions, mirror: bool
) -> tuple[ScoreMap, ScoreMap | None, bool]:
    """The surface of a point, that of its mirrored template, and whether roads place it."""
    name = matching.operators[0].name
    mirrored = view.mirrored_scores(name) if mirror else None
    return view.scores(name), mirrored, has_roads(view.described(name))


def best_sigma_px(
    view: PointView,
    surface: ScoreMap,
    peaks: Sequence[Peak],
    plan: Plan,
    chance: Chance,
) -> float:
    """How well the highest candidate's place is known, were it right, pixels of the pass.

    Where chance rises as high there is nothing to be asked: then it is as dull as a match may be.
    """
    if not peaks or peaks[0].score <= max(chance.heights, default=0.0):
        return DULL * MATCH_FLOOR_PX
    half, reduction = surface.shape[0] // 2, plan.matching.reduction
    place = round(half + peaks[0].row / reduction), round(half + peaks[0].column / reduction)
    known = view.place_sigma_px(plan.matching.operators[0].name, place)
    return float(np.clip(known, PEAK_FLOOR_PX, DULL * MATCH_FLOOR_PX))


def chance_of(surface: ScoreMap, mirrored: ScoreMap | None, plan: Plan) -> Chance:
    """Decoys of a point's surface, and of that of its mirrored template where it was searched."""
    decoys, middle, spread = decoys_of(surface, plan.inner)
    area = float(surface.size - (2 * plan.inner + 1) ** 2)
    if mirrored is not None:
        decoys, area = decoys + decoys_of(mirrored, -1)[0], area + mirrored.size
    inner = float((2 * plan.inner + 1) ** 2)
    return Chance(decoys, area * plan.pixel_m**2, middle, spread, inner * plan.pixel_m**2)


def decoys_of(surface: ScoreMap, inner: int) -> tuple[tuple[float, ...], float, float]:
    """Heights of all maxima outside the middle of a surface, and its middle and spread there.

    Args:
        surface: Likeness by place.
        inner: Half-width of the middle; -1 leaves nothing out.
    """
    rows, columns = surface.shape
    outside = np.ones(surface.shape, bool)
    row, column = rows // 2, columns // 2
    outside[row - inner : row + inner + 1, column - inner : column + inner + 1] = False
    return decoys_outside(surface, outside, SEPARATION_PX)


def decoys_outside(
    surface: ScoreMap, outside: Mask, separation_px: int
) -> tuple[tuple[float, ...], float, float]:
    """Heights of all maxima where nothing can be right, and the middle and spread there.

    Args:
        surface: Likeness by place.
        outside: Where nothing can be right.
        separation_px: A maximum is the highest within so many pixels.
    """
    values = surface[outside]
    middle, spread = level_and_spread(values)
    maxima = local_maxima(surface, separation_px) & outside & (surface > middle)
    heights = (surface[maxima] - middle) / spread
    return tuple(float(height) for height in heights), middle, spread


def candidates_near(surface: ScoreMap, plan: Plan, chance: Chance) -> tuple[Peak, ...]:
    """Peaks near the prediction as offsets in scan pixels, heights in deviations of the decoys."""
    half, rim, reduction = surface.shape[0] // 2, plan.narrow, plan.matching.reduction
    near = np.ascontiguousarray(surface[half - rim : half + rim + 1, half - rim : half + rim + 1])
    return tuple(
        Peak(
            (peak.column - rim) * reduction,
            (peak.row - rim) * reduction,
            peak.sigma_px * reduction,
            (peak.value - chance.middle) / chance.spread,
            plan.matching.operators[0].name,
        )
        for peak in detect_peaks(near, CANDIDATES, SEPARATION_PX)
    )
