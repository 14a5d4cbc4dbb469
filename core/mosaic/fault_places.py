"""Places at which a mosaic is likely to be wrong, whatever tells it, in one order.

Five things tell: the reference (`core/mosaic/misfit_places.py`), photos that do not fit along a
seam, houses that a seam cuts, cells that stand out of the heights, and neighbouring ties whose
residuals agree. Each states by how much the ground is off there or would be, so that all of them
can be ranked. One of the first three kinds may be that of a fault with another cause: the list
leads to places, people judge them. Nothing found here steers the block.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
import shapely
from jaxtyping import Float64
from scipy.spatial import KDTree
from shapely.geometry.base import BaseGeometry

from core.arrays import ObjectPoints, PixelPoints, Scalars
from core.block import Photo
from core.geometry.crs import Bounds
from core.geometry.robust import robust_sigma
from core.mosaic.misfit import BlockErrors, Spreads, Vectors, photos_shown, predicted_misfit
from core.mosaic.misfit_places import (
    LEAST_SCATTER_M,
    SURE,
    TWO_SIGMAS,
    MisfitPlace,
    surely_there_m,
)
from core.mosaic.seam_fit import Matches, SeamFit, borders_of
from core.mosaic.seams import Seam
from core.quality.rules import DOUBTFUL, Finding
from core.raster.dem import Dem
from core.raster.grid import Grid

Kind = Literal["reference", "seam", "house", "ground", "ties"]
Compared = tuple[tuple[str, str], Matches, Float64[np.ndarray, "_ 2 2"]]
"""Two photos, their matches, and how well each is known."""
# design: the fewest of which one that is wrong does not decide.
SEAM_HOOD = 3
"""So many neighbouring matches along a seam have to agree."""
# design: as many ties as lie about one detail of the ground.
TIE_HOOD = 6
"""So many ties of two photos next to each other have to agree."""
# design: two floors and a roof; where houses are lower a cut is seen less.
HOUSE_M = 6.0
"""Height by which photos lean a house apart."""
# design: less of a house beside the seam is its eaves.
LEAST_CUT_PX = 2.0
"""A seam runs so far through a house that it cuts, pixels of the mosaic."""
# design: memory; sixteen megabytes a copy. Cells are coarser in large blocks.
MOST_CELLS = 4_000_000
# design: blunders of heights are a few cells wide, whatever the cell is.
REDUCTIONS = (1, 2, 4)
"""Heights are looked at in cells so many times as wide as those of the DEM."""
# design: the most that OpenCV takes of floats; a spike of up to three cells a side is the minority.
MEDIAN_CELLS = 5
"""What a cell stands out of: the median of so many cells a side."""
# design: each step leaves the slope's share of the tangent of the view, less than a fifth.
RAY_STEPS = 4
"""So often a ray is laid on the heights again."""
# design: as for misfit; more would not be looked at.
MOST = 40
"""Places kept at most."""


@dataclass(frozen=True, slots=True, eq=False)
class FaultPlace:
    """One place, and what tells that it is wrong."""

    kind: Kind
    """What tells it."""
    east: float
    """Easting, metres."""
    north: float
    """Northing, metres."""
    photo_ids: tuple[str, ...]
    """The photo that is off; of two, the likelier one first."""
    shift_m: tuple[float, float]
    """By how much (east, north), metres: of the mosaic against the reference, of the second photo
    against the first, of the ground by the heights, of what ties say."""
    sigma_m: float
    """Standard deviation per axis of the shift as measured, metres."""
    predicted_m: tuple[float, float]
    """Standard deviations (east, north) that are expected of it, metres."""
    significant: bool
    """Whether it is off by more than expected."""
    height_m: float = 0.0
    """By how much the heights stand out, metres; 0 for other kinds."""
    probability: float = float("nan")
    """Probability that it is off by more than expected; NaN: kept by an earlier version."""

    @property
    def length_m(self) -> float:
        """Length of the shift, metres."""
        return float(np.hypot(*self.shift_m))

    @property
    def least_m(self) -> float:
        """So much of it is surely there, metres: what ranks places."""
        return surely_there_m(self.shift_m, self.sigma_m)


def worst_places(
    misfit: Sequence[MisfitPlace],
    fits: Sequence[SeamFit],
    seams: Sequence[Seam],
    buildings: Sequence[BaseGeometry],
    *,
    errors: BlockErrors,
    grid: Grid,
    dem: Dem | None,
) -> tuple[FaultPlace, ...]:
    """All places at which a mosaic is likely to be wrong, worst first.

    Args:
        misfit: Where it is off the reference.
        fits: How its photos fit along the seams.
        seams: Which photo it shows where.
        buildings: Outlines of houses.
        errors: What the block predicts.
        grid: Of the mosaic.
        dem: Heights the orthos stand on; None where there is no DEM.
    """
    found = [
        FaultPlace(
            "reference", one.east, one.north, (one.photo_id,), one.shift_m, one.sigma_m,
            one.predicted_m, one.significant, probability=one.probability,
        )
        for one in misfit
    ]  # fmt: skip
    found += seam_places(fits, errors)
    found += cut_houses(seams, buildings, errors, LEAST_CUT_PX * grid.ground_sample_distance_m)
    found += [] if dem is None else ground_places(dem, grid.bounds, seams, errors)
    tied = tied_pairs(errors)
    found += tie_places(tied, errors)
    worst = sorted(found, key=lambda place: -place.least_m)[:MOST]
    return tuple(_suspect_first(place, worst, tied) for place in worst)


def misfit_findings(places: Sequence[FaultPlace]) -> tuple[Finding, ...]:
    """What the judgement of a block says of places off the reference; nothing without any.

    Args:
        places: All likely faults, worst first.
    """
    off = [one for one in places if one.significant and one.kind == "reference"]
    if not off:
        return ()
    told = {
        "count": str(len(off)),
        "metres": f"{off[0].length_m:.1f}",
        "east": f"{off[0].east:.0f}",
        "north": f"{off[0].north:.0f}",
    }
    return (Finding("misfit-places", DOUBTFUL, told),)


def _suspect_first(
    place: FaultPlace, places: Sequence[FaultPlace], tied: Sequence[Compared]
) -> FaultPlace:
    """A place of two photos with the one first that other photos say is off.

    Two rays do not say which of them is wrong: ties with third photos near by do, or else how many
    places each photo has.
    """
    if place.kind not in ("seam", "ties"):
        return place
    first, second = (_off_with_others(place, name, tied) for name in place.photo_ids)
    if first == second:
        first, second = (
            sum(name in one.photo_ids for one in places if one.significant)
            for name in place.photo_ids
        )
    if second <= first:
        return place
    turned, (east, north) = place.photo_ids[::-1], place.shift_m
    return replace(place, photo_ids=turned, shift_m=(-east, -north))


def _off_with_others(place: FaultPlace, photo_id: str, tied: Sequence[Compared]) -> bool:
    """Whether a photo of a place is off about as far by its ties with third photos near by."""
    (other,) = set(place.photo_ids) - {photo_id}
    rows = [ties for pair, ties, _ in tied if photo_id in pair and other not in pair]
    ties = np.concatenate([np.zeros((0, 4)), *rows])
    away = np.hypot(ties[:, 0] - place.east, ties[:, 1] - place.north)
    near = ties[np.argsort(away)[:TIE_HOOD], 2:]
    return len(near) == TIE_HOOD and bool(
        np.median(np.linalg.norm(near, axis=1)) > place.length_m / 2
    )


def seam_places(fits: Sequence[SeamFit], errors: BlockErrors) -> list[FaultPlace]:
    """Where several neighbouring matches of two photos agree that they do not fit."""
    pairs = [(fit.photo_ids, fit.matches, fit.spreads) for fit in fits]
    return _agreed("seam", pairs, SEAM_HOOD, errors)


def cut_houses(
    seams: Sequence[Seam],
    buildings: Sequence[BaseGeometry],
    errors: BlockErrors,
    least_m: float,
) -> list[FaultPlace]:
    """Houses that lie in two photos' parts, with how far these lean them apart."""
    index = {name: number for number, name in enumerate(dict.fromkeys(s.photo_id for s in seams))}
    names, tree = list(index), shapely.STRtree(list(buildings))
    found: list[FaultPlace] = []
    for (one, other), line in borders_of(seams, index).items():
        pair, cuts = (names[one], names[other]), list[BaseGeometry]()
        for row in sorted(tree.query(line, predicate="intersects").tolist()):
            within = line.intersection(buildings[row])
            if within.length >= least_m:
                cuts.append(within.centroid)
        if not cuts or not all(name in errors.report.block.photos for name in pair):
            continue
        places = shapely.get_coordinates(cuts)
        first, second = (_relief(places, name, errors) for name in pair)
        lean = HOUSE_M * (second - first)
        spread = _pair_errors(places, pair, errors)
        found += [
            _place("house", pair, (place, shift, own), 0.0, len(buildings))
            for place, shift, own in zip(places, lean, spread, strict=True)
            if np.isfinite(own).all()
        ]
    return [place for place in found if place.significant]


def ground_places(
    dem: Dem, bounds: Bounds, seams: Sequence[Seam], errors: BlockErrors
) -> list[FaultPlace]:
    """Cells that stand out of the heights about them, with how far that displaces the ground."""
    found: dict[tuple[float, float], FaultPlace] = {}
    for reduction in REDUCTIONS:
        places, heights, scatter, count = _standing_out(dem, bounds, reduction)
        shown = photos_shown(places, seams)
        spreads = predicted_misfit(places, shown, errors)[0]
        for row in np.flatnonzero(np.isfinite(spreads).all(axis=(1, 2))).tolist():
            place, height = places[row], float(heights[row])
            relief = _relief(place[None], shown[row], errors)[0]
            own = spreads[row] + scatter**2 * np.outer(relief, relief)
            # A ray meets ground that is taken to be too high before its place.
            one = _place("ground", (shown[row],), (place, -height * relief, own), 0.0, count)
            one = replace(one, height_m=height)
            near = [key for key in found if np.hypot(*(place - key)) <= _reach_m(dem, reduction)]
            worse = all(one.length_m > found[key].length_m for key in near)
            if worse:
                found = {key: kept for key, kept in found.items() if key not in near}
                found[float(place[0]), float(place[1])] = one
    return [place for place in found.values() if place.significant]


def tie_places(tied: Sequence[Compared], errors: BlockErrors) -> list[FaultPlace]:
    """Where neighbouring ties of two photos agree that they do not fit, in use or left out."""
    return _agreed("ties", tied, TIE_HOOD, errors)


def _agreed(
    kind: Kind, pairs: Sequence[Compared], size: int, errors: BlockErrors
) -> list[FaultPlace]:
    """Places where so many neighbouring matches of two photos agree on a shift."""
    steps, hoods = [np.zeros((0, 2))], dict[tuple[str, str], np.ndarray]()
    for pair, matches, _ in pairs:
        if len(matches) >= size:
            _, near = KDTree(matches[:, :2]).query(matches[:, :2], k=size)
            hoods[pair] = np.asarray(near)
            steps.append((matches[hoods[pair][:, 1:], 2:] - matches[:, None, 2:]).reshape(-1, 2))
    scatter = _scatter(np.concatenate(steps)) / float(np.sqrt(2))
    count, found = sum(map(len, hoods.values())), list[FaultPlace]()
    for pair, matches, spreads in pairs:
        if pair not in hoods:
            continue
        places, shifts = matches[:, :2], matches[hoods[pair], 2:]
        agreed = np.median(shifts, axis=1)
        away = np.linalg.norm(shifts - agreed[:, None], axis=2).max(axis=1)
        fit = away <= np.maximum(np.linalg.norm(agreed, axis=1) / 2, TWO_SIGMAS * scatter)
        # One edge may run through all of them: they do not make each other surer.
        own = _pair_errors(places[fit], pair, errors) + spreads[hoods[pair][fit]].mean(axis=1)
        found += _grouped(kind, pair, (places[fit], agreed[fit], own), scatter, count)
    return found


def _grouped(
    kind: Kind,
    photo_ids: tuple[str, ...],
    rows: tuple[Vectors, Vectors, Spreads],
    scatter: float,
    count: int,
) -> list[FaultPlace]:
    """Neighbourhoods that are off the same way as one place, told by the worst of them."""
    found: list[FaultPlace] = []
    made = [
        _place(kind, photo_ids, (place, shift, own + scatter**2 * np.eye(2)), scatter, count)
        for place, shift, own in zip(*rows, strict=True)
        if np.isfinite(own).all()
    ]
    for one in sorted(made, key=lambda place: -place.least_m):
        reach = max(one.length_m / 2, TWO_SIGMAS * scatter)
        alike = any(np.hypot(*np.subtract(one.shift_m, kept.shift_m)) <= reach for kept in found)
        if one.significant and not alike:
            found.append(one)
    return found


def _place(
    kind: Kind,
    photo_ids: tuple[str, ...],
    row: tuple[np.ndarray, np.ndarray, np.ndarray],
    sigma_m: float,
    count: int,
) -> FaultPlace:
    """A place judged by what is expected of it; the worst of `count` may lie so far off by luck."""
    (east, north), shift, spread = row
    squared = float(shift @ np.linalg.solve(spread, shift))
    chance = min(1.0, float(np.exp(-squared / 2)) * count)
    expected = np.sqrt(np.diag(spread))
    return FaultPlace(
        kind, float(east), float(north), photo_ids, (float(shift[0]), float(shift[1])), sigma_m,
        (float(expected[0]), float(expected[1])), chance < 1 - SURE, probability=1 - chance,
    )  # fmt: skip


def _pair_errors(places: Vectors, pair: tuple[str, str], errors: BlockErrors) -> Spreads:
    """Covariances expected of the shift between two photos; what they share makes it smaller."""
    alone = replace(errors, ortho_sigma_m=0.0)
    one, other = (predicted_misfit(places, [name] * len(places), alone)[0] for name in pair)
    return one + other


def _scatter(values: Float64[np.ndarray, "n 2"]) -> float:
    return max(robust_sigma(values), LEAST_SCATTER_M) if len(values) else LEAST_SCATTER_M


def _relief(places: Vectors, photo_id: str, errors: BlockErrors) -> Vectors:
    """By how much what stands a metre above the ground is displaced in the ortho of a photo."""
    photo = errors.report.block.photos[photo_id]
    centre = photo.exterior.centre
    return (places - centre[:2]) / (centre[2] - _on_ground(places, photo, errors)[:, 2:])


def _on_ground(places: Vectors, photo: Photo, errors: BlockErrors) -> ObjectPoints:
    heights = errors.heights.heights(places)
    heights = np.where(np.isfinite(heights), heights, photo.ground_height_m)
    return np.column_stack([places, heights])


def _reach_m(dem: Dem, reduction: int) -> float:
    """What stands out together at one reduction is one thing."""
    return MEDIAN_CELLS * reduction * dem.ground_sample_distance_m


def _standing_out(dem: Dem, bounds: Bounds, reduction: int) -> tuple[Vectors, Scalars, float, int]:
    """Cells that stand out most, by how much, the usual scatter, and how many were looked at."""
    west, south, east, north = bounds
    least_m = float(np.sqrt((east - west) * (north - south) / MOST_CELLS))
    grid = Grid.over(bounds, max(reduction * dem.ground_sample_distance_m, least_m))
    heights = dem.on(grid)
    known = np.isfinite(heights)
    if not known.any():
        return np.zeros((0, 2)), np.zeros(0), 0.0, 0
    filled = np.where(known, heights, np.median(heights[known])).astype(np.float32)
    above = filled - cv2.medianBlur(filled, MEDIAN_CELLS)
    whole = cv2.erode(known.astype(np.uint8), np.ones((MEDIAN_CELLS,) * 2, np.uint8)) > 0
    scatter = _scatter(np.repeat(above[whole][:, None].astype(np.float64), 2, axis=1))
    worst = np.argsort(-np.abs(np.where(whole, above, 0.0)), axis=None)[:MOST]
    rows, columns = np.unravel_index(worst, above.shape)
    middles = np.column_stack([columns, rows]) + 0.5
    return (
        grid.object_from_grid(middles),
        above[rows, columns].astype(np.float64),
        scatter,
        int(whole.sum()),
    )


def tied_pairs(errors: BlockErrors) -> list[Compared]:
    """Ties of every two photos, those left out as gross errors too: place, second minus first.

    Ties lie on details that are distinct either way: their scatter tells how well. Roofs and crowns
    are compared at their own heights, or they would all disagree.
    """
    block, objects = errors.report.block, _object_heights(errors)
    ties, ground = block.ties, np.full((len(block.ties.point), 2), np.nan)
    for number, name in enumerate(ties.photo_ids):
        rays = np.flatnonzero(ties.photo == number)
        if name in errors.covariances and len(rays):
            photo, pixels = block.photos[name], ties.pixels[rays]
            ground[rays] = _shown_ground(photo, pixels, errors, objects[ties.point[rays]])
    rays = np.flatnonzero(np.isfinite(ground).all(axis=1))
    rays = rays[np.lexsort((ties.photo[rays], ties.point[rays]))]
    found: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
    for apart in range(1, len(ties.photo_ids)):
        first, second = rays[:-apart], rays[apart:]
        same = ties.point[first] == ties.point[second]
        if not same.any():
            break
        rows = np.hstack([ground[first], ground[second] - ground[first]])
        for at in np.flatnonzero(same).tolist():
            pair = (ties.photo_ids[ties.photo[first[at]]], ties.photo_ids[ties.photo[second[at]]])
            found[pair].append(rows[at])
    return [
        (pair, np.array(own), np.zeros((len(own), 2, 2))) for pair, own in sorted(found.items())
    ]


def _object_heights(errors: BlockErrors) -> Scalars:
    """Adjusted heights of ties that may be those of houses and trees; NaN for any other.

    They are as high above the ground as one tie in twenty of the block, or lower: two rays that are
    wrong alike meet at a height, too, and where little stands above the ground it gives them away.
    """
    positions = errors.report.tie_positions
    above = positions[:, 2] - errors.heights.heights(positions[:, :2])
    known = above[np.isfinite(above)]
    highest = float(np.quantile(known, SURE)) if len(known) else 0.0
    unsure = TWO_SIGMAS * errors.dem_sigma_m
    likely = (above >= -unsure) & (above <= max(highest, 0.0) + unsure)
    return np.where(likely, positions[:, 2], np.nan)


def _shown_ground(
    photo: Photo, pixels: PixelPoints, errors: BlockErrors, known: Scalars
) -> Vectors:
    """Easting and northing at which rays meet known heights, or else the ground."""
    camera = errors.report.block.camera_of(photo.photo_id)
    heights = np.full(len(pixels), photo.ground_height_m)
    for _ in range(RAY_STEPS):
        places = photo.object_from_pixel(pixels, heights, camera)[:, :2]
        heights = np.where(np.isfinite(known), known, _on_ground(places, photo, errors)[:, 2])
    return photo.object_from_pixel(pixels, heights, camera)[:, :2]
