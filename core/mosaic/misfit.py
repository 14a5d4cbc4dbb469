"""Misfit of the mosaic against the reference: one vector in every cell of the block.

Patches of the reference are searched in the mosaic as control is searched in a scan: by the same
operator, peaks, precision and probability, so that what has changed over decades counts little.
Control is not looked at, and nothing found here steers the adjustment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import shapely
from jaxtyping import Float64, Shaped

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Flags, Mask, Scalars, locked
from core.block import Peak
from core.control.prediction import LEAST_UNIT, Covariances, plan_errors
from core.control.search import (
    PREDICTION_SIGMA_M,
    Chance,
    Plan,
    candidates_near,
    decoys_outside,
)
from core.errors import ReferenceDataError
from core.localisation.photo_orientation import OrientationOptions
from core.matching.local_search import (
    DULL,
    MATCH_FLOOR_PX,
    RIM_PX,
    SEPARATION_PX,
    Images,
    MatchingOptions,
    PointView,
)
from core.matching.patches import ScanPart, Templates, Window, filled
from core.matching.precision import Covariance, likely_covariance
from core.matching.probability import GATE, Searches, posterior, probabilities
from core.mosaic.comparison import (
    CommonView,
    ComparedPlaces,
    MosaicAccuracy,
    accuracy_of,
    choose_places,
    open_both,
)
from core.mosaic.seams import Seam
from core.progress import Work, tracked
from core.raster.dem import HeightSource
from core.said import say

Vectors = Float64[np.ndarray, "n 2"]
Spreads = Float64[np.ndarray, "n 2 2"]
Errors = Float64[np.ndarray, "n 2 errors"]
Names = Shaped[np.ndarray, "n"]
Tile = tuple[int, int, int, int]
Searched = tuple[int, tuple[Peak, ...], tuple[Covariance, ...], Chance]
"""A place, its candidates with the covariance of each (column, row), square pixels, and what chance
brings about it."""

# design: a photo that control holds at all is off by less; a wider search finds more by chance.
SEARCH_M = 10.0
"""The mosaic is searched so far about every place along either axis, metres."""
# design: as for control (core/control/search.py): what lies further off is certainly wrong.
DECOYS_M = 24.0
"""Half-width of the whole search, metres."""
# design: time; two minutes of one processor.
MOST_PLACES = 4000
"""The block is divided into no more cells than this."""
# measured: prove_misfit; at half of it, with a quarter of the ground in a patch, fewer displaced
# photos are found (9 of 12 instead of 10), at one and a half times of it as many.
LEAST_PIXEL_M = 1.0
"""Both are compared at pixels no smaller, metres: what is smaller seldom lasts for decades."""
# design: memory; two described tiles of a thousand pixels a side take some hundred megabytes.
TILE_PX = 1024
# design: half as many displacements as a search of a few templates has, to tell a height from.
LEAST_DECOY_SHARE = 0.25
"""A place at the edge is compared while the mosaic fills this share of the search about it."""


CONTROL_RULE = (
    "Gray values recognise few places of it, so places were searched as control is: a place counts "
    "when it is more probably right than wrong. Of these, a place is left out as a mismatch when "
    "it departs from the median of its eight nearest neighbours by more than five normalised "
    "median deviations and more than two pixels; m_p with them is given beside."
)


@dataclass(frozen=True, slots=True, eq=False)
class MisfitVectors:
    """Where the mosaic shows details of the reference, as parallel arrays."""

    positions: Vectors
    """Easting, northing in the reference, metres."""
    shifts_m: Vectors
    """Mosaic minus reference (east, north), metres."""
    covariances: Spreads
    """Of a shift (east, north), were it right, square metres: long where an edge slides along
    itself."""
    probabilities: Scalars
    """Probability that the same detail was found."""
    photo_ids: tuple[str, ...]
    """Photo that the mosaic shows there; empty where that is not known."""
    predicted: Spreads
    """Covariance (east, north) that the adjusted block and the accuracy of the reference predict
    of a shift, square metres; NaN where the photo took no part in the adjustment."""
    photo_errors_m: Errors
    """How it follows independent errors of the photo, each of one standard deviation, metres: what
    is common to neighbours."""
    ground_sample_distance_m: float
    """Pixel size at which both were compared, metres."""
    patch_m: float
    """Side of the patches that were compared, metres."""
    tried: int
    """Places that were tried."""

    def __post_init__(self) -> None:
        own = "positions", "shifts_m", "covariances", "probabilities"
        for name in (*own, "predicted", "photo_errors_m"):
            object.__setattr__(self, name, locked(getattr(self, name)))

    @property
    def found(self) -> Flags:
        """True for the vectors that are more probably right than wrong."""
        return self.probabilities > 0.5

    @property
    def sigmas_m(self) -> Scalars:
        """Standard deviation per axis of a shift, were it right, metres."""
        return _per_axis(self.covariances)

    @property
    def predicted_sigmas_m(self) -> Vectors:
        """Predicted standard deviations east and north, metres."""
        return np.sqrt(self.predicted[:, [0, 1], [0, 1]])


def _per_axis(spreads: Spreads) -> Scalars:
    return np.sqrt(np.trace(spreads, axis1=1, axis2=2) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class BlockErrors:
    """What a block says of how well the mosaic lies."""

    report: AdjustmentReport
    """The adjusted block."""
    covariances: Covariances
    """Of its photos."""
    heights: HeightSource
    """The ground."""
    ortho_sigma_m: float
    """Standard deviation of the reference per axis, metres."""
    dem_sigma_m: float
    """Standard deviation of a height, metres."""


def measure_misfit(
    mosaic: Path,
    reference: Sequence[Path],
    seams: Sequence[Seam],
    errors: BlockErrors,
    orientation: OrientationOptions | None = None,
    work: Work | None = None,
) -> MisfitVectors:
    """Compare a mosaic with the reference all over the block.

    Args:
        mosaic: The mosaic.
        reference: Sheets of the reference ortho.
        seams: Which photo the mosaic shows where.
        errors: What is predicted of the misfit.
        orientation: Operator and sizes with which control is searched.
        work: Runs tiles side by side and is told of each; may raise `Cancelled`.

    Raises:
        PhotogrammetryError: A file is damaged, or they have nothing in common.
    """
    orientation, work = orientation or OrientationOptions(), work or Work()
    least = max(orientation.finest_gsd_m, LEAST_PIXEL_M)
    view = open_both(mosaic, reference, errors.report.block.crs, least)
    plan = _plan(view, orientation)
    half = plan.matching.template_half_px
    side = 2 * half + 1
    # A cell of a patch each: neighbours then have little in common.
    places = min(MOST_PLACES, max(1, view.grid.columns * view.grid.rows // side**2))
    centres = choose_places(view, places, side, half + plan.inner)
    rows: list[tuple[int, Peak, Covariance]] = []
    chances: dict[int, Chance] = {}
    tiles = np.unique(centres // TILE_PX, axis=0)
    parts = work.mapper(partial(_search_tile, view, centres, plan), tiles)
    for part in tracked(parts, len(tiles), work.progress, "misfit"):
        for number, peaks, spreads, chance in part:
            chances[number] = chance
            rows += [(number, *one) for one in zip(peaks, spreads, strict=True)]
    return _vectors(view, centres, plan, rows, chances, (seams, errors))


def accuracy_as_control(
    vectors: MisfitVectors, mosaic: Path, reference: Sequence[Path]
) -> MosaicAccuracy:
    """Accuracy against an ortho that shows the ground, but not as the mosaic shows it.

    What `compare_orthos` recognises by gray values has changed, or is seen in another light.

    Args:
        vectors: What `measure_misfit` finds in both.
        mosaic: The mosaic, for what there is to tell.
        reference: The ortho, likewise.

    Raises:
        ReferenceDataError: Nothing of it was recognised.
    """
    if not vectors.found.any():
        values = {"file": reference[0], "metres": f"{vectors.patch_m:.0f}", "tried": vectors.tried}
        cause = (
            say("None of {tried:# place|# places} of {file} is recognised in it.", **values)
            if vectors.tried
            else say(
                "Too little of {file} lies under it: no place of it lies {metres} m and a search "
                "off every edge.",
                **values,
            )
        )
        raise ReferenceDataError(mosaic, cause, "Check that both show the same ground.")
    places = ComparedPlaces(
        vectors.positions,
        vectors.shifts_m,
        vectors.probabilities,
        tuple("used" if right else "unlikely" for right in vectors.found.tolist()),
    )
    return accuracy_of(places, vectors.ground_sample_distance_m, CONTROL_RULE)


def _plan(view: CommonView, orientation: OrientationOptions) -> Plan:
    gsd = view.grid.ground_sample_distance_m
    # design: room for decoys about the middle also where pixels are coarse.
    inner = max(int(np.ceil(SEARCH_M / gsd)), 2 * SEPARATION_PX)
    wide = max(int(np.ceil(DECOYS_M / gsd)), inner + 2 * SEPARATION_PX)
    matching = MatchingOptions(
        template_half_px=orientation.template_half_px, operators=orientation.operators[:1]
    )
    return Plan(matching, gsd, wide, inner, np.zeros(0))


def _search_tile(
    view: CommonView, centres: np.ndarray, plan: Plan, tile: np.ndarray
) -> list[Searched]:
    """Candidates and decoys of every place of a tile that can be searched."""
    members = np.flatnonzero((centres // TILE_PX == tile).all(axis=1))
    margin = plan.matching.template_half_px + plan.wide + RIM_PX
    low = centres[members].min(axis=0) - margin
    size = centres[members].max(axis=0) + margin + 1 - low
    images, seen = _described(view, (*low.tolist(), *size.tolist()), plan)
    return [
        (number, *found)
        for number in members.tolist()
        if (found := _search_place(images, seen, centres[number] - low, plan)) is not None
    ]


def _described(view: CommonView, tile: Tile, plan: Plan) -> tuple[Images, Mask]:
    """Mosaic and reference of a tile as the operator compares them, and where templates fit in."""
    product, truth = view.read(view.grid.window(*tile))
    half, operator = plan.matching.template_half_px, plan.matching.operators[0]
    grey, ortho = filled(product.values, product.mask), filled(truth.values, truth.mask)
    roads = np.zeros_like(ortho)
    column, row, columns, rows = tile
    images = Images(
        ScanPart(Window(column, row, columns, rows, 1), grey, product.mask),
        Templates(columns, 1, ortho, truth.mask, roads),
        half,
        {operator.name: operator},
        {operator.name: operator.of_scan(grey, half)},
        {operator.name: operator.of_reference(ortho, roads, half)},
    )
    whole = np.ones((2 * half + 1, 2 * half + 1), np.uint8)
    seen = cv2.erode(product.mask.astype(np.uint8), whole, borderValue=0)
    return images, np.asarray(seen, dtype=bool)


def _search_place(
    images: Images, seen: Mask, place: np.ndarray, plan: Plan
) -> tuple[tuple[Peak, ...], tuple[Covariance, ...], Chance] | None:
    """Peaks about one place of a tile, how well each is known, and what chance brings about it.

    None at an edge.
    """
    column, row = (int(value) for value in place)
    half, wide, inner = plan.matching.template_half_px, plan.wide, plan.inner
    patch, around, steps = (
        np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
        for reach in (half, half + wide, wide)
    )
    outside = seen[steps].copy()
    outside[wide - inner : wide + inner + 1, wide - inner : wide + inner + 1] = False
    if outside.mean() < LEAST_DECOY_SHARE or not images.templates.known[patch].all():
        return None
    view = PointView(images, around, patch, np.array([[column, row]]) + 0.5)
    surface = view.scores(plan.matching.operators[0].name)
    heights, middle, spread = decoys_outside(surface, outside, SEPARATION_PX)
    m2 = plan.pixel_m**2
    chance = Chance(heights, float(outside.sum()) * m2, middle, spread, (2 * inner + 1) ** 2 * m2)
    peaks = candidates_near(surface, plan, chance)
    rim = plan.narrow
    near = (surface[wide - rim : wide + rim + 1, wide - rim : wide + rim + 1] - middle) / spread
    places = [(peak.column + rim, peak.row + rim) for peak in peaks]
    floor = MATCH_FLOOR_PX**2 * np.eye(2)
    return peaks, tuple(likely_covariance(near, place) + floor for place in places), chance


def _vectors(
    view: CommonView,
    centres: np.ndarray,
    plan: Plan,
    rows: Sequence[tuple[int, Peak, Covariance]],
    chances: Mapping[int, Chance],
    block: tuple[Sequence[Seam], BlockErrors],
) -> MisfitVectors:
    """The likeliest candidate of every place, with its probability."""
    gsd = plan.pixel_m
    order = {number: index for index, number in enumerate(sorted(chances))}
    numbers = np.array([number for number, _, _ in rows], dtype=np.int64)
    search = np.array([order[number] for number in numbers.tolist()], dtype=np.int64)
    offsets = np.array([[p.column, -p.row] for _, p, _ in rows]).reshape(-1, 2) * gsd
    heights = np.array([peak.score for _, peak, _ in rows], dtype=np.float64)
    # Rows of the grid go south.
    axes = gsd**2 * np.array([[1, -1], [-1, 1]])
    spreads = np.array([spread for _, _, spread in rows]).reshape(-1, 2, 2) * axes
    positions = view.grid.object_from_grid(centres[numbers] + 0.5)
    photos = photos_shown(positions, block[0])
    predicted, errors = predicted_misfit(positions, photos, block[1])
    about = _per_axis(predicted)
    sigmas = np.minimum(_per_axis(spreads), DULL * MATCH_FLOOR_PX * gsd)
    near = np.hypot(sigmas, np.where(np.isfinite(about), about, PREDICTION_SIGMA_M))
    searches = Searches(search, heights, np.hypot(*offsets.T), near, len(chances), np.zeros(0), 0.0)
    right = _probabilities(searches, sum(one.inner_m2 for one in chances.values()))
    best = np.array(
        [
            np.flatnonzero(search == one)[np.argmax(right[search == one])]
            for one in np.unique(search)
        ],
        dtype=np.int64,
    )
    return MisfitVectors(
        positions[best],
        offsets[best],
        spreads[best],
        right[best],
        tuple(photos[index] for index in best.tolist()),
        predicted[best],
        errors[best],
        gsd,
        (2 * plan.matching.template_half_px + 1) * gsd,
        len(centres),
    )


def _probabilities(searches: Searches, searched_m2: float) -> Scalars:
    """Probability of every candidate to be right, wherever in the search it lies.

    What right peaks look like is learnt where the block predicts them, as for control; what chance
    brings, beside that: crowns and shadows are found some metres off, where decoys further out
    would not show them. Then the prediction is given up: whatever is wrong with a photo may
    displace all that it shows. Where much of a block is off, this asks for higher peaks.
    """
    if not len(searches.height):
        return np.zeros(0)
    limit_m = GATE * float(searches.sigma_m.mean())
    beside = searches.distance_m > limit_m
    area = searched_m2 - searches.count * np.pi * limit_m**2
    _, found = probabilities(replace(searches, decoys=searches.height[beside], decoy_area_m2=area))
    if found is None:
        return np.zeros(len(searches.height))
    wide = np.full(len(searches.height), SEARCH_M * np.sqrt(2) / GATE)
    return posterior(replace(searches, sigma_m=wide), replace(found, wider=1.0))


def photos_shown(positions: Vectors, seams: Sequence[Seam]) -> tuple[str, ...]:
    """The photo that a mosaic shows at each place; empty beside all seams."""
    names = [""] * len(positions)
    for seam in seams:
        for index in np.flatnonzero(shapely.contains_xy(seam.area, positions)).tolist():
            names[index] = seam.photo_id
    return tuple(names)


def predicted_misfit(
    positions: Vectors, photos: Sequence[str], errors: BlockErrors
) -> tuple[Spreads, Errors]:
    """What block and reference predict of the misfit at places.

    Returns:
        Covariances, square metres; and how the misfit follows errors of the photo, metres: NaN and
        nought where that took no part in the adjustment.
    """
    block, shown = errors.report.block, np.array(photos)
    unit = max(errors.report.unit, LEAST_UNIT)
    told = max((len(own) for own in errors.covariances.values()), default=0)
    predicted = np.full((len(positions), 2, 2), np.nan)
    common = np.zeros((len(positions), 2, told))
    sigmas = np.array([errors.ortho_sigma_m, errors.ortho_sigma_m, errors.dem_sigma_m])
    for name in sorted(set(photos) & set(errors.covariances) & set(block.photos)):
        photo, members = block.photos[name], np.flatnonzero(shown == name)
        heights = errors.heights.heights(positions[members])
        heights = np.where(np.isfinite(heights), heights, photo.ground_height_m)
        places = np.column_stack([positions[members], heights])
        camera, own = block.camera_of(name), errors.covariances[name]
        by_photo, by_place = plan_errors(photo, camera, places, own, sigmas)
        common[members, :, : len(own)] = unit * by_photo
        both = np.concatenate([unit * by_photo, by_place], axis=2)
        predicted[members] = both @ np.swapaxes(both, 1, 2)
    return predicted, common
