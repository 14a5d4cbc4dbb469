"""Accuracy of an ortho or mosaic against another of nearly the same content.

At places spread over the common area a patch of the truth is found in the product; what lies
between is the error of the product, product minus truth, as METHODS 9.1 counts it. Normalised
correlation finds the whole pixel, least-squares matching (shift, gain and offset) the fraction:
unlike a parabola through the peak it does not lean towards whole pixels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import rasterio
from jaxtyping import Float32, Float64
from scipy import ndimage
from scipy.spatial import KDTree

from core.arrays import Flags, Mask, Scalars, locked
from core.errors import CrsError, ReferenceDataError
from core.geometry.crs import shared_bounds
from core.geometry.robust import nmad, robust_sigma
from core.matching.peaks import correlation_scores, highest_places
from core.progress import SILENT, Progress
from core.quality.readings import circular_error_90, rms_interval
from core.raster.grid import Grid
from core.raster.ortho import Ortho, OrthoPatch, open_ortho
from core.said import say

Shifts = Float64[np.ndarray, "n 2"]
Patch = Float32[np.ndarray, "_ _"]
# design: a sixth of a patch; broader shading is exposure, season and print, not place
HIGH_PASS_PX = 8.0
"""What is broader than this is taken away before patches are compared, pixels."""
# design: leaves 4 % of what alternates from pixel to pixel, which no interpolation can move
SMOOTHING_PX = 0.8
"""Both patches are smoothed a little before the fraction is measured: grain aliases."""
# design: a limit of time; a place that needs more is not found
MOST_STEPS = 12
# design: those round a place in a square, as in the median test of Westerweel and Scarano 2005
NEIGHBOURS = 8
# design: a normal error passes it once in a million; changed ground lies far outside.
MISMATCH_SIGMAS = 5
OUTLIER_RULE = (
    "A place counts when its correlation peak is high enough and alone, lies inside the search, "
    "and is found again when product and truth change roles. Of these, a place is left out as a "
    "mismatch when it departs from the median of its eight nearest neighbours by more than five "
    "normalised median deviations and more than two pixels; m_p with them is given beside."
)
# design: a quarter of the variance in common, which chance does not reach over so many pixels
LEAST_PEAK = 0.5
"""Smallest correlation that counts."""
# design: twice the noise of a correlation over some five hundred independent pixels
LEAST_LEAD = 0.1
"""By how much the peak must stand above the next one."""
# design: there and back err independently; more than a fifth of a pixel each is no fix
RETURN_PX = 0.3
"""Largest disagreement between there and back, pixels."""


@dataclass(frozen=True, slots=True)
class ComparisonOptions:
    """Where and how patches are compared."""

    # design: the 95 % interval of m_p is then 7 % to either side, by chi-square of 400
    places: int = 200
    """Number of cells the common area is divided into; one place is tried in each."""
    # design: two thousand pixels against chance, yet a corner of a field and not the field
    patch_px: int = 48
    """Side of a patch, pixels of the common grid."""
    # design: half a patch; a product further off than that shows it in the places at the edge
    search_px: int = 24
    """How far a patch is looked for in every direction, pixels of the common grid."""


@dataclass(frozen=True, slots=True)
class Shift:
    """Where the content of one patch lies in another."""

    column: float
    """Pixels to the right."""
    row: float
    """Pixels down."""
    peak: float
    """Height of the correlation peak, -1 to 1."""
    second: float
    """Height of the next one outside the neighbourhood of the first."""
    at_edge: bool
    """True when the peak lies at the edge of the search: the shift may be larger."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedPlaces:
    """Every place that was tried, as parallel arrays."""

    positions: Shifts
    """Easting, northing in the truth, metres."""
    shifts_m: Shifts
    """Product minus truth (easting, northing), metres; NaN where none was found."""
    peaks: Scalars
    """Height of the correlation peak."""
    verdicts: tuple[str, ...]
    """`used`, or why not: `flat`, `edge`, `low`, `ambiguous`, `unsteady`, `return`, `mismatch`."""

    def __post_init__(self) -> None:
        for name in ("positions", "shifts_m", "peaks"):
            object.__setattr__(self, name, locked(getattr(self, name)))

    @property
    def used(self) -> Flags:
        """True for the places that count."""
        return np.array([verdict == "used" for verdict in self.verdicts], dtype=bool)


@dataclass(frozen=True, slots=True, eq=False)
class MosaicAccuracy:
    """Accuracy of a product against a truth, from the places that count."""

    n: int
    """Places that count."""
    m_x: float
    """Root mean square error in easting, metres."""
    m_y: float
    """Root mean square error in northing, metres."""
    m_p: float
    """Root of m_x squared plus m_y squared, metres."""
    m_p_interval: tuple[float, float]
    """95 % interval of m_p by chi-square, metres."""
    mean_shift: tuple[float, float]
    """c_X, c_Y: mean error in easting and northing, metres."""
    deviation: tuple[float, float]
    """s_X, s_Y: standard deviations about the mean, metres."""
    median_shift: tuple[float, float]
    """Median error in easting and northing, metres."""
    nmad: tuple[float, float]
    """Normalised median absolute deviations in easting and northing, metres."""
    largest: float
    """Longest error, metres."""
    m_p_with_mismatches: float
    """m_p when the mismatches count as well, metres."""
    refused: Mapping[str, int]
    """How many places did not count, by reason."""
    ground_sample_distance_m: float
    """Pixel size at which the two were compared, metres."""
    places: ComparedPlaces
    """The table."""
    truth_sigma_m: float | None = None
    """Standard deviation of a coordinate of the truth, metres; None where nobody states it."""
    rule: str = OUTLIER_RULE
    """Which places count."""

    @property
    def circular_error_90(self) -> float:
        """Radius of the circle that holds 90 % of the errors, metres."""
        return circular_error_90(self.m_p)


def compare_orthos(
    product_path: Path,
    truth: Path | Sequence[Path],
    options: ComparisonOptions | None = None,
    progress: Progress = SILENT,
) -> MosaicAccuracy:
    """Measure where a product shows the details of a truth.

    Args:
        product_path: Ortho or mosaic that is judged.
        truth: Ortho of nearly the same content, or its sheets; any GSD, bands, CRS.
        options: Where and how patches are compared.
        progress: Told after every place.

    Returns:
        The accuracy; mismatches are treated as `OUTLIER_RULE` says.

    Raises:
        ReferenceDataError: The two have nothing in common that could be compared.
    """
    options = options or ComparisonOptions()
    sheets = [truth] if isinstance(truth, Path) else list(truth)
    for path in (product_path, *sheets):
        with rasterio.open(path) as file:
            if file.crs is None:
                raise CrsError(path, "It has no CRS.", "Write one with gdal_edit.py -a_srs.")
    with rasterio.open(product_path) as file:
        crs = str(file.crs.to_wkt())
    view = open_both(product_path, sheets, crs)
    margin = options.patch_px // 2 + options.search_px + 2
    centres = choose_places(view, options.places, options.patch_px, margin)
    found: list[tuple[Shift | None, str]] = []
    for done, (column, row) in enumerate(centres.tolist()):
        found.append(_measure(view, column, row, options))
        progress.report(float(done + 1), float(len(centres)), "comparison")
    places = _table(view.grid, centres, found)
    if not places.used.any():
        raise ReferenceDataError(
            product_path,
            say("No place could be recognised in {truth_path}.", truth_path=sheets[0]),
            "Check that both show the same ground, or enlarge search_px.",
        )
    return accuracy_of(places, view.grid.ground_sample_distance_m)


@dataclass(frozen=True, slots=True, eq=False)
class CommonView:
    """A product and a truth on one grid, on the pixels of the coarser of the two."""

    product: Ortho
    truth: Ortho
    grid: Grid

    def read(self, grid: Grid) -> tuple[OrthoPatch, OrthoPatch]:
        """Both on a grid."""
        return self.product.read(grid), self.truth.read(grid)


def open_both(
    product_path: Path, truth_paths: Sequence[Path], crs: str, least_gsd_m: float = 0.0
) -> CommonView:
    """Both on one grid; the coarser one is not interpolated at all.

    Args:
        product_path: Ortho or mosaic that is judged.
        truth_paths: Sheets of the ortho it is compared with.
        crs: CRS of the grid, that of the product.
        least_gsd_m: Finer detail is not compared, metres.

    Raises:
        ReferenceDataError: A file is damaged, or they have nothing in common.
    """
    product, truth = open_ortho([product_path], crs), open_ortho(truth_paths, crs)
    own = max(
        (product.sheets.grid, truth.sheets.grid), key=lambda grid: grid.ground_sample_distance_m
    )
    west, south, east, north = shared_bounds(product.bounds, truth.bounds)
    gsd = max(own.ground_sample_distance_m, least_gsd_m)
    if west + gsd >= east or south + gsd >= north:
        raise ReferenceDataError(
            product_path,
            say("It has no area in common with {truth_path}.", truth_path=truth_paths[0]),
            "Check the CRS of both.",
        )
    common = (west, south, east, north)
    coarser = gsd > own.ground_sample_distance_m
    grid = Grid.over(common, gsd) if coarser else own.covering(common)
    return CommonView(product, truth, grid)


def choose_places(view: CommonView, places: int, patch_px: int, margin_px: int) -> np.ndarray:
    """Column and row of the place with most texture in every cell of the common area, (n, 2).

    Args:
        view: Product and truth.
        places: Number of cells the common area is divided into.
        patch_px: Side of the patches whose texture counts, pixels of the common grid.
        margin_px: So far around a place both are seen, pixels of the common grid.
    """
    grid = view.grid
    # design: texture is judged on some two million pixels, a few megabytes
    reduction = max(1, round(max(grid.columns, grid.rows) / 1500))
    step = grid.ground_sample_distance_m * reduction
    small = Grid(grid.west, grid.north, step, grid.columns // reduction, grid.rows // reduction)
    product, truth = view.read(small)
    half = int(np.ceil(margin_px / reduction))
    inside = _inside(product.mask & truth.mask, half)
    area = int(np.count_nonzero(inside))
    side = max(1, int(np.sqrt(area / places)))
    block = max(3, patch_px // reduction)
    texture = np.asarray(cv2.cornerMinEigenVal(truth.values, block, ksize=3))
    texture = np.where(inside, texture, -1.0)
    centres: list[tuple[int, int]] = []
    for row in range(0, texture.shape[0], side):
        for column in range(0, texture.shape[1], side):
            cell = texture[row : row + side, column : column + side]
            best = np.unravel_index(int(np.argmax(cell)), cell.shape)
            if cell[best] > 0:
                centres.append((column + int(best[1]), row + int(best[0])))
    return np.array(centres, dtype=np.int64).reshape(-1, 2) * reduction + reduction // 2


def _inside(seen: Mask, half: int) -> Mask:
    framed = np.pad(seen.astype(np.uint8), 1)
    distance = cv2.distanceTransform(framed, cv2.DIST_C, 3)
    return np.asarray(distance)[1:-1, 1:-1] > half


def _measure(
    view: CommonView, column: int, row: int, options: ComparisonOptions
) -> tuple[Shift | None, str]:
    """Find the truth's patch in the product and back; the shift and a verdict."""
    half, search = options.patch_px // 2, options.search_px
    reach = half + search
    start = (max(column - reach, 0), max(row - reach, 0))
    product, truth = view.read(view.grid.window(*start, 2 * reach, 2 * reach))
    if not (product.mask.all() and truth.mask.all()):
        return None, "edge"
    here, there = _high_pass(truth), _high_pass(product)
    there_shift = find_shift(here[search:-search, search:-search], there, search)
    if there_shift is None:
        return None, "flat"
    back = find_shift(there[search:-search, search:-search], here, search)
    return there_shift, _verdict(there_shift, back)


def _high_pass(patch: OrthoPatch) -> np.ndarray:
    return patch.values - ndimage.gaussian_filter(patch.values, HIGH_PASS_PX)


def find_shift(
    template: Patch, image: Patch, search_px: int, neighbourhood_px: int = 4
) -> Shift | None:
    """Find a template in an image that is `search_px` larger on every side.

    Args:
        template: Patch that is looked for.
        image: Where it is looked for.
        search_px: How far it may be shifted, pixels.
        neighbourhood_px: Around the peak no second one is looked for, pixels.

    Returns:
        The shift, NaN where the fraction does not converge; None where a patch has no contrast.
    """
    # design: gray values; rounding of a flat patch
    if min(float(np.std(template)), float(np.std(image))) < 1e-3:
        return None
    scores = correlation_scores(image, template)
    place, *others = highest_places(scores, 2, neighbourhood_px)
    at_edge = min(place) == 0 or max(place) == 2 * search_px
    fraction = _fraction(template, image, place)
    return Shift(
        column=place[1] - search_px + fraction[0],
        row=place[0] - search_px + fraction[1],
        peak=float(scores[place]),
        second=float(scores[others[0]]) if others else -1.0,
        at_edge=at_edge,
    )


def _fraction(template: Patch, image: Patch, place: tuple[int, int]) -> Float64[np.ndarray, "2"]:
    """Column and row to add to a whole-pixel place, by least-squares matching; NaN if it fails."""
    wanted = ndimage.gaussian_filter(template.astype(np.float64), SMOOTHING_PX)[2:-2, 2:-2]
    smooth = ndimage.gaussian_filter(image.astype(np.float64), SMOOTHING_PX)
    spline = ndimage.spline_filter(smooth, order=3, mode="mirror")
    rows, columns = np.mgrid[0 : wanted.shape[0], 0 : wanted.shape[1]].astype(np.float64)
    rows, columns = rows + place[0] + 2, columns + place[1] + 2
    shift = np.zeros(2)
    for _ in range(MOST_STEPS):
        found = ndimage.map_coordinates(
            spline, [rows + shift[1], columns + shift[0]], order=3, prefilter=False, mode="mirror"
        )
        down, right = np.gradient(found)
        design = np.stack([right, down, found, np.ones_like(found)], axis=-1)[1:-1, 1:-1]
        design = design.reshape(-1, 4)
        try:
            solution = np.linalg.solve(design.T @ design, design.T @ wanted[1:-1, 1:-1].ravel())
        except np.linalg.LinAlgError:
            break
        # design: contrast lost or turned round: there is nothing to divide by
        if not solution[2] > 1e-3:
            break
        step = solution[:2] / solution[2]
        shift += np.clip(step, -1, 1)
        if np.abs(shift).max() > 2:
            break
        # design: pixels; a hundredth of what is told
        if np.abs(step).max() < 1e-4:
            return shift
    return np.full(2, np.nan)


def _verdict(there: Shift, back: Shift | None) -> str:
    if there.at_edge:
        return "edge"
    if there.peak < LEAST_PEAK:
        return "low"
    if there.peak - there.second < LEAST_LEAD:
        return "ambiguous"
    if back is None or not np.isfinite([there.column, back.column]).all():
        return "unsteady"
    miss = np.hypot(there.column + back.column, there.row + back.row)
    return "used" if miss <= RETURN_PX else "return"


def _table(
    grid: Grid, centres: np.ndarray, found: list[tuple[Shift | None, str]]
) -> ComparedPlaces:
    gsd = grid.ground_sample_distance_m
    nothing = (np.nan, np.nan)
    shifts = [nothing if s is None else (s.column * gsd, -s.row * gsd) for s, _ in found]
    return ComparedPlaces(
        positions=grid.object_from_grid(centres.astype(np.float64)),
        shifts_m=np.array(shifts, dtype=np.float64).reshape(-1, 2),
        peaks=np.array([np.nan if s is None else s.peak for s, _ in found], dtype=np.float64),
        verdicts=tuple(verdict for _, verdict in found),
    )


def _without_mismatches(places: ComparedPlaces, gsd_m: float) -> ComparedPlaces:
    """Mark places that depart from their neighbours, as OUTLIER_RULE says."""
    used = np.flatnonzero(places.used)
    if len(used) < 10:
        return places
    shifts, positions = places.shifts_m[used], places.positions[used]
    _, neighbours = KDTree(positions).query(positions, k=NEIGHBOURS + 1)
    expected = np.median(shifts[np.asarray(neighbours)[:, 1:]], axis=1)
    away = np.linalg.norm(shifts - expected, axis=1)
    limit = max(MISMATCH_SIGMAS * robust_sigma(away), 2 * gsd_m)
    verdicts = list(places.verdicts)
    for index in used[away > limit]:
        verdicts[index] = "mismatch"
    return ComparedPlaces(places.positions, places.shifts_m, places.peaks, tuple(verdicts))


def accuracy_of(places: ComparedPlaces, gsd_m: float, rule: str = OUTLIER_RULE) -> MosaicAccuracy:
    """What the places tell that count; those that depart from their neighbours do not.

    Args:
        places: All that were tried; some are `used`.
        gsd_m: Pixel size at which they were compared, metres.
        rule: Which of them count.
    """
    places = _without_mismatches(places, gsd_m)
    errors = places.shifts_m[places.used]
    counted = [verdict in ("used", "mismatch") for verdict in places.verdicts]
    with_mismatches = places.shifts_m[counted]
    n = len(errors)
    m_x, m_y = (float(value) for value in np.sqrt(np.mean(errors**2, axis=0)))
    m_p = float(np.hypot(m_x, m_y))
    refused = [verdict for verdict in places.verdicts if verdict != "used"]
    return MosaicAccuracy(
        n=n,
        m_x=m_x,
        m_y=m_y,
        m_p=m_p,
        m_p_interval=rms_interval(m_p, 2 * n),
        mean_shift=_pair(errors.mean(axis=0)),
        deviation=_pair(errors.std(axis=0, ddof=1) if n > 1 else np.full(2, np.nan)),
        median_shift=_pair(np.median(errors, axis=0)),
        nmad=_pair(np.array([nmad(axis) for axis in errors.T])),
        largest=float(np.linalg.norm(errors, axis=1).max()),
        m_p_with_mismatches=float(np.sqrt(np.mean(np.sum(with_mismatches**2, axis=1)))),
        refused={reason: refused.count(reason) for reason in sorted(set(refused))},
        ground_sample_distance_m=gsd_m,
        places=places,
        rule=rule,
    )


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])
