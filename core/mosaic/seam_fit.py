"""How well two photos fit where the mosaic passes from one to the other: in tone and in place.

Both are read from the orthos along each seam: a step in tone shows as an edge, a shift as a road
that breaks off. Nothing found here steers the mosaic.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import cv2
import numpy as np
import rasterio
import shapely
from jaxtyping import Float32, Float64
from shapely.geometry.base import BaseGeometry

from core.matching.peaks import correlation_scores, detect_peaks
from core.matching.precision import Covariance
from core.mosaic.composition import MosaicProduct
from core.mosaic.layers import Layers, OrthoFiles
from core.mosaic.misfit_places import TWO_SIGMAS
from core.mosaic.seams import Seam
from core.orthos.rectification import OrthoProduct
from core.progress import Work, tracked
from core.raster.grid import Grid

Values = Float64[np.ndarray, "n"]
Matches = Float64[np.ndarray, "_ 4"]
Pair = tuple[int, int]
Gray = Float32[np.ndarray, "_ _"]
# design: several fields and ways, little relief: what is compared should lie on the ground.
PATCH_HALF_PX = 24
"""Half-width of the patches that are compared, pixels."""
# design: what is further apart no eye takes for the same thing.
REACH_PX = 12
"""The second photo is searched so far along either axis, pixels."""
# design: neighbouring patches have half in common.
SPACING_PX = PATCH_HALF_PX
"""Places along a seam lie so far apart, pixels."""
# design: time; some seconds of one processor.
MOST_PLACES = 4000
"""No more places are compared in a whole mosaic."""
# design: half of what the patches show is shared then.
LEAST_CORRELATION = 0.7
"""A shift counts where the patches are so much alike."""
# design: film grain and resampling make pixels alike over two in every direction.
GRAIN_PX2 = 16.0
"""So many neighbouring pixels are as good as one."""
# design: a quarter of a pixel is finer than what chance leaves of a sharp peak.
FINER = 4
"""Scores are looked at in steps of so many parts of a pixel."""
# design: all but what houses and moved things bring.
LARGE_PERCENT = 95
# design: the only peak that is asked for is the highest.
SEPARATION_PX = 2


@dataclass(frozen=True, slots=True, eq=False)
class SeamFit:
    """Two photos along all seams between them."""

    photo_ids: tuple[str, str]
    """The photos, by name."""
    length_m: float
    """Length of their seams, metres."""
    places: int
    """Places along them that both photos show."""
    step: float
    """Median of second minus first, balanced gray values, before the mosaic draws them together;
    NaN without a place."""
    step_95: float
    """95th percentile of its absolute values."""
    matched: int
    """Places at which the second photo shows what the first does."""
    shift_m: tuple[float, float]
    """Median of second minus first (east, north), metres; NaN without a match."""
    shift_95_m: float
    """95th percentile of the lengths of the shifts, metres."""
    matches: Matches = field(default_factory=lambda: np.zeros((0, 4)))
    """Every match along the seam: easting, northing, shift east and north, metres."""
    spreads: Float64[np.ndarray, "_ 2 2"] = field(default_factory=lambda: np.zeros((0, 2, 2)))
    """Covariances of the shifts, square metres: along an edge that is alone in a patch a shift is
    hardly known."""


def fit_seams(
    mosaic: MosaicProduct, orthos: Sequence[OrthoProduct], work: Work | None = None
) -> tuple[SeamFit, ...]:
    """Compare neighbours of a mosaic along their seams.

    Args:
        mosaic: The mosaic.
        orthos: What it was composed of; others of them are passed over.
        work: Compares pairs side by side and is told of each; may raise `Cancelled`.

    Returns:
        One fit for each pair that has a seam, the largest shift first.
    """
    work = work or Work()
    index = {ortho.photo_id: number for number, ortho in enumerate(orthos)}
    borders = borders_of(mosaic.seams, index)
    if not borders:
        return ()
    length_m = sum(line.length for line in borders.values())
    spacing_m = max(SPACING_PX * mosaic.grid.ground_sample_distance_m, length_m / MOST_PLACES)
    with rasterio.open(mosaic.path) as file:
        dtype = np.dtype(file.dtypes[0])
    files = OrthoFiles(orthos, mosaic.balances, dtype)
    try:
        fit = partial(_fit_pair, mosaic.grid, files, spacing_m)
        compared = work.mapper(fit, borders.items())
        fits = list(tracked(compared, len(borders), work.progress, "seams"))
    finally:
        files.close()
    return tuple(sorted(fits, key=lambda fit: -np.nan_to_num(np.hypot(*fit.shift_m), nan=-1)))


def borders_of(seams: Sequence[Seam], index: dict[str, int]) -> dict[Pair, BaseGeometry]:
    """Where one photo gives way to another, by the numbers of the two."""
    seams = [seam for seam in seams if seam.photo_id in index]
    areas = [seam.area for seam in seams]
    found: dict[Pair, list[BaseGeometry]] = defaultdict(list)
    for one, other in shapely.STRtree(areas).query(areas, predicate="intersects").T.tolist():
        first, second = index[seams[one].photo_id], index[seams[other].photo_id]
        if first < second:
            found[first, second].append(areas[one].intersection(areas[other]))
    lines = {pair: shapely.union_all(parts) for pair, parts in sorted(found.items())}
    return {pair: line for pair, line in lines.items() if line.length > 0}


def places_along(line: BaseGeometry, spacing_m: float) -> Float64[np.ndarray, "n 2"]:
    """Places on lines, the first half a spacing from the beginning of each."""
    places = [
        shapely.get_coordinates(
            shapely.line_interpolate_point(part, np.arange(spacing_m / 2, part.length, spacing_m))
        )
        for part in shapely.get_parts(shapely.line_merge(line))
        if part.length > 0
    ]
    return np.concatenate(places) if places else np.zeros((0, 2))


def _fit_pair(
    grid: Grid, files: OrthoFiles, spacing_m: float, border: tuple[Pair, BaseGeometry]
) -> SeamFit:
    pair, line = border
    names = (files.orthos[pair[0]].photo_id, files.orthos[pair[1]].photo_id)
    steps: list[float] = []
    shifts: list[tuple[float, float]] = []
    spreads: list[Covariance] = []
    matched: list[tuple[int, int]] = []
    reach = PATCH_HALF_PX + REACH_PX
    inner = slice(REACH_PX, -REACH_PX)
    cells = np.floor(grid.grid_from_object(places_along(line, spacing_m))).astype(int)
    for column, row in cells.tolist():
        part = grid.window(column - reach, row - reach, 2 * reach + 1, 2 * reach + 1)
        layers = Layers(files, part)
        if not all(layers.pixels(index).all() for index in pair):
            continue
        one, other = (layers.toned(index) for index in pair)
        steps.append(float(np.mean((other - one)[inner, inner])))
        found = _shift_px(np.ascontiguousarray(one[inner, inner]), other)
        if found is not None:
            shifts.append(found[0])
            spreads.append(found[1])
            matched.append((column, row))
    pixel_m = grid.ground_sample_distance_m
    shifts_m = np.array(shifts).reshape(-1, 2) * pixel_m
    east, north = (_median(axis) for axis in shifts_m.T)
    return SeamFit(
        names,
        float(line.length),
        len(steps),
        _median(np.array(steps)),
        _large(np.array(steps)),
        len(shifts),
        (east, north),
        _large(np.hypot(*shifts_m.T)),
        np.hstack([grid.object_from_grid(np.array(matched).reshape(-1, 2) + 0.5), shifts_m]),
        np.array(spreads).reshape(-1, 2, 2) * pixel_m**2,
    )


def _shift_px(patch: Gray, around: Gray) -> tuple[tuple[float, float], Covariance] | None:
    """How far east and north a patch lies in its surroundings, and how well that is known.

    None where it is not recognised. Known is it as far as other places are less alike by more than
    chance: along an edge that is alone in the patch none is.
    """
    scores = correlation_scores(around, patch)
    peaks = detect_peaks(scores, 1, SEPARATION_PX)
    if not peaks or peaks[0].value < LEAST_CORRELATION:
        return None
    peak = peaks[0]
    chance = np.sqrt(2 * GRAIN_PX2 / patch.size) * (1 - min(peak.value, 1.0) ** 2)
    fine = cv2.resize(scores, None, fx=FINER, fy=FINER, interpolation=cv2.INTER_CUBIC)
    rows, columns = np.nonzero(np.asarray(fine) >= peak.value - TWO_SIGMAS * chance)
    places = (np.column_stack([columns, rows]) + 0.5) / FINER - 0.5 - (peak.column, peak.row)
    # Rows run south.
    away = places * (1.0, -1.0)
    spread = away.T @ away / max(len(away), 1)
    return (peak.column - REACH_PX, REACH_PX - peak.row), spread


def _median(values: Values) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _large(values: Values) -> float:
    return float(np.percentile(np.abs(values), LARGE_PERCENT)) if len(values) else float("nan")
