"""The flight of the lesson on the whole chain: scans of painted ground, measured by the engine.

Nothing is stored: a scan is what its film, lens, air and ground make of any pixel that is asked
for. What the engine then finds of it is kept for the state it was found in.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float64
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter, map_coordinates

from app.lessons.flight import C_MM, KEPT, SCALE, Flight, Plan, flown, observed, on_hills
from app.lessons.photo import HALF_MM, PIXEL_MM
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.arrays import Matrix, ObjectPoints, PixelPoints, Scalars
from core.block import Measurement, Photo
from core.control.search import PEAK_FLOOR_PX
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.collinearity import CORRECTIONS
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation, fit_interior
from core.geometry.transforms import apply_affine, invert_affine
from core.literature.baselines import OPERATORS
from core.literature.common_grid import grid_about
from core.matching.local_search import cut
from core.matching.operators import Operator
from core.matching.patches import object_on_ground
from core.matching.peaks import Description, ScoreMap, ScorePeak, detect_peaks
from core.matching.precision import place_covariance, sharpness_of
from core.mosaic.overview import SeamView
from core.mosaic.seam_cut import LabelledGround, label_ground
from core.raster.grid import Grid
from core.scans.centring import match_mark
from core.scans.marks import Mark, draw_mark

FAR = 106.0  # source: corner fiducials of Wild RC cameras of 230 mm
MARKS = {
    "1": (-FAR, FAR), "2": (0.0, FAR), "3": (FAR, FAR), "4": (FAR, 0.0),
    "5": (FAR, -FAR), "6": (0.0, -FAR), "7": (-FAR, -FAR), "8": (-FAR, 0.0),
}  # fmt: skip
"""Eight fiducials: corners and middles of the sides, millimetres."""
CAMERA = Camera(
    "lesson", C_MM, (2 * HALF_MM, 2 * HALF_MM),
    radial_distortion=(4e-8, -2e-12, 0.0), fiducials_mm=MARKS,
)  # fmt: skip
CROSS = Mark("cross", 0.65, 0.1)
"""What a fiducial looks like."""
# design: unlike along and across, so that a similarity would not do; 0.1 mm at the edge of the film
# is seen where it is drawn 1500 times as long.
LEFT_OF_FILM = np.array([1 - 0.0010, 1 - 0.0004])
"""What is left of the film's length along x and y."""
WINDOW_PX = 70
"""Half of a window about a fiducial."""
FIELD_M, ROAD_M = 120.0, 7.0
# design: 6 um on the film, as ties of old film have; about thirty in a photo, a second's work.
NOISE_PX, TIES = 0.4, 110
"""Standard deviation of a tie's coordinate, scan pixels; and how many ties there are."""
# design: somewhat more than a pixel of the scans; orthos state a quarter of a metre and more.
CONTROL_M = 0.3
"""Standard deviation of the ortho of today, and so of what is known of crossroads, per axis."""
# design: a quarter of the search's reach; 0.0015 rad at 2280 m are 3.4 m more.
OFF_M, TURNED = 6.0, 0.0015
"""Standard deviations of the orientations that the search begins with, metres and radians."""
PATCH_M, REACH_M, PEAKS = 25, 25, 4
"""Half of the patch, how far it is sought, at one metre a pixel, and how many peaks are kept."""
# design: less than a road is wide, so that its crossing is one peak; edges are smoothed by 1.2 px.
APART_PX = 5
"""Peaks of one search are farther apart than this."""
CELL_M = 64.0
"""Cells in which seams are sought."""
# design: half a cell on the film: with its middle so far inside, a cell is seen wholly.
HALF_CELL_MM = CELL_M / 2 * 1000 / SCALE
# design: fiducials stand 9 mm inside the edge of the film, and seams should not cross them.
RIM_MM = 12.0
"""Seams keep out of this at the edge of a picture, where they can."""
# design: beyond the outermost crossroads, to the ground that only one photo shows.
BEYOND_M = 1500.0
"""How far the mosaic reaches beyond the crossroads."""
# design: speed; hills and lens are smooth, so that a spline errs by less than a millimetre (test).
NODES = 12
"""Rays a side that are followed to the ground of a window."""
PLAN = Plan(2, 3, TIES, NOISE_PX, 1)
PHOTOS = PLAN.strips * PLAN.photos
MOST_SEARCHES = 9 * 4
"""Of a flight: nine crossroads, each in four photos at most."""
HELD = AdjustmentOptions(estimate_cameras=False)


@dataclass(frozen=True, slots=True)
class HillsDem:
    """The DEM: the true hills, and an error that changes slowly."""

    error_m: float = 0.0
    """Its amplitude."""
    ground_sample_distance_m: float = 10.0
    """Spacing of its posts."""

    def heights(self, points: Matrix) -> Scalars:
        """Heights at easting, northing, metres."""
        east, north = points.T
        wave = np.cos(east / 310) * np.sin(north / 270)
        return on_hills(points)[:, 2] + self.error_m * wave

    def on(self, grid: Grid) -> Float64[np.ndarray, "rows columns"]:
        """Heights at the pixel centres of a grid."""
        return self.heights(plan_of(grid)).reshape(grid.rows, grid.columns)


TRUE_GROUND, DEM = HillsDem(), HillsDem(1.5)


def plan_of(grid: Grid) -> Matrix:
    """Easting and northing of all pixel centres, row by row."""
    east, north = np.meshgrid(*grid.centres())
    return np.column_stack([east.ravel(), north.ravel()])


def pixels_about(middle: PixelPoints, half: float, count: int) -> PixelPoints:
    """A lattice of pixels about one, row by row."""
    axis = (np.arange(count) + 0.5) / count * 2 * half - half
    columns, rows = np.meshgrid(axis, axis)
    return middle + np.column_stack([columns.ravel(), rows.ravel()])


def offsets_from(middle: PixelPoints, pixel: PixelPoints) -> Matrix:
    """A pixel from a middle one, with y up, as drawings have it."""
    return (pixel - middle) * [1.0, -1.0]


def junctions() -> Matrix:
    """Known crossroads of the block; each lies in two photos or more, all but the last in four."""
    length, width = PLAN.extent
    shares = np.array(
        [[0.5, 0.5], [0.38, 0.5], [0.62, 0.5], [0.5, 0.2], [0.5, 0.8], [0.28, 0.3],
         [0.72, 0.3], [0.28, 0.7], [0.72, 0.7]]
    )  # fmt: skip
    return np.round(shares * [length, width] / FIELD_M) * FIELD_M


@lru_cache(maxsize=4)
def _tables(seed: int) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Tones of the fields now and new ones, which change first, and texture or grain."""
    rng = np.random.default_rng(7000 + seed)
    new, other = rng.uniform(60, 190, (2, 64, 64))
    texture = gaussian_filter(rng.normal(0, 1, (512, 512)), 2, mode="wrap")
    return new, other, rng.random((64, 64)), texture / texture.std()


def paint_ground(plan: Matrix, changed: float, seed: int) -> Scalars:
    """Grey values of the ground; of that of today where nothing has changed."""
    now, then, order, texture = _tables(seed)
    column, row = (np.floor(plan / FIELD_M).astype(np.int64) % 64).T
    tone = np.where(order[row, column] < changed, then[row, column], now[row, column])
    fine = map_coordinates(texture, (plan / 0.8).T, order=1, mode="grid-wrap")
    away = np.abs((plan + FIELD_M / 2) % FIELD_M - FIELD_M / 2).min(axis=1)
    # Edges of roads are as soft as lens and film have them.
    road = np.clip((ROAD_M / 2 + 0.5 - away), 0, 1)
    return (1 - road) * (tone + 12 * fine) + road * 215


@dataclass(frozen=True, slots=True)
class Given:
    """What decides the flight."""

    changed: float
    """Share of the fields with another tone than today."""
    seed: int
    """Of ground, film and noise."""


@lru_cache(maxsize=KEPT)
def true_flight(seed: int) -> Flight:
    """The photos as they truly stand, and what is measured of ties."""
    plan = replace(PLAN, seed=seed)
    rng = np.random.default_rng(3000 + seed)
    side = round(2 * (HALF_MM + 4) / PIXEL_MM)
    photos: dict[str, Photo] = {}
    for name, photo in flown(plan).items():
        turn, shear = rng.normal(0, 0.006), rng.normal(0, 0.0002)
        left = LEFT_OF_FILM * (1 + rng.normal(0, 1e-4, 2))
        shrunk = np.diag(left) @ np.array([[1, shear], [0, 1]])
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        pixel = np.diag([1.0, -1.0]) @ turned @ shrunk / PIXEL_MM
        offset = side / 2 + rng.normal(0, 30, 2)
        film = invert_affine(np.column_stack([pixel, offset]))
        certified = np.array(list(MARKS.values()))
        marks = apply_affine(np.column_stack([pixel, offset]), certified)
        none = np.zeros_like(certified)
        interior = InteriorOrientation("affine", film, tuple(MARKS), marks, none, float("nan"))
        photos[name] = replace(
            photo, size_px=(side, side), interior=interior, corrections=CORRECTIONS
        )
    return observed(photos, CAMERA, plan, junctions(), sigmas_m=np.full(3, CONTROL_M))


def scan_values(photo: Photo, pixels: PixelPoints, given: Given) -> Scalars:
    """What the scan of a photo, as it truly stands, shows at any pixels."""
    ground = object_on_ground(photo, CAMERA, pixels, TRUE_GROUND)
    return _developed(photo, pixels, ground[:, :2], given)


def _developed(photo: Photo, pixels: PixelPoints, plan: Matrix, given: Given) -> Scalars:
    """Grey values of pixels that see the ground at these places."""
    seen = paint_ground(plan, given.changed, given.seed)
    grain = _tables(given.seed)[3]
    column, row = (np.floor(pixels).astype(np.int64) % 512).T
    film = photo.interior.film_from_pixel(pixels)
    inside = (np.abs(film) < HALF_MM).all(axis=1)
    return np.where(inside, 0.9 * seen + 3 * grain[column, row], 18.0)


@lru_cache(maxsize=1)
def draw_cross() -> Matrix:
    """A fiducial as the engine draws it to look for it."""
    return draw_mark(CROSS, PIXEL_MM)


def mark_window(photo: Photo, name: str, seed: int) -> tuple[tuple[int, int], Matrix]:
    """Corner (column, row) and grey values of a window about a fiducial on the dark rim."""
    place = photo.interior.pixel_from_film(np.array([MARKS[name]]))[0]
    corner = np.floor(place).astype(np.int64) - WINDOW_PX
    side = 2 * WINDOW_PX + 1
    # A mark is drawn where the film has it, to a part of a pixel.
    fine = draw_cross()
    moved = np.column_stack([np.eye(2), place - corner - fine.shape[0] // 2 - 0.5])
    cover = cv2.warpAffine(fine.astype(np.float32), moved, (side, side))
    rng = np.random.default_rng([seed, int(name)])
    gray = 40 + rng.normal(0, 12, (side, side))
    return (int(corner[0]), int(corner[1])), gray * (1 - cover) + 215 * cover


@lru_cache(maxsize=KEPT * PHOTOS)
def measure_marks(name: str, seed: int) -> PixelPoints:
    """Where the engine finds the fiducials of a photo."""
    photo = true_flight(seed).photos[name]
    found: list[tuple[float, float]] = []
    for mark in MARKS:
        corner, gray = mark_window(photo, mark, seed)
        start = (WINDOW_PX + 2.0, WINDOW_PX - 1.0)
        centre = match_mark(gray.astype(np.float32), start, 15.0, draw_cross(), judged=False)
        assert not isinstance(centre, Failure), centre.reason
        found.append((corner[0] + centre.column, corner[1] + centre.row))
    return np.array(found)


@lru_cache(maxsize=KEPT)
def _rough_exteriors(seed: int) -> dict[str, ExteriorOrientation]:
    """Where the search takes the photos to be."""
    rng = np.random.default_rng(5000 + seed)
    rough: dict[str, ExteriorOrientation] = {}
    for name, photo in true_flight(seed).photos.items():
        true = photo.exterior
        angles = (true.angles + rng.normal(0, TURNED, 3)).tolist()
        rough[name] = ExteriorOrientation(true.centre + rng.normal(0, OFF_M, 3), *angles)
    return rough


@lru_cache(maxsize=KEPT * PHOTOS)
def approximate_photo(name: str, seed: int) -> Photo:
    """A photo as the search begins: its interior from the marks, a rough exterior."""
    photo, rough = true_flight(seed).photos[name], _rough_exteriors(seed)[name]
    certified = np.array(list(MARKS.values()))
    interior = fit_interior(tuple(MARKS), measure_marks(name, seed), certified, "affine")
    assert isinstance(interior, InteriorOrientation), interior.reason
    return replace(photo, interior=interior, exterior=rough, approximate=rough)


@dataclass(frozen=True, slots=True, eq=False)
class ControlSearch:
    """One search for a known point in one photo."""

    template: Matrix
    """The ortho of today about the point, a metre a pixel."""
    scores: ScoreMap
    """How alike the scan is wherever the patch was laid."""
    peaks: tuple[ScorePeak, ...]
    """Highest first."""
    expected: PixelPoints
    """Where the rough orientation expects the point in the scan, (1, 2)."""
    pixel: PixelPoints
    """Where it was found, (1, 2)."""
    sigma_px: float
    """How surely, scan pixels."""


SHOWN = 2
"""Photos in which a point is followed."""


@lru_cache(maxsize=KEPT * MOST_SEARCHES)
def search_point(point: int, name: str, given: Given) -> ControlSearch | None:
    """The present ortho about a point sought in a scan laid on the DEM.

    None where nothing stands out within the window: the photo lies further off than it is wide.
    """
    flight, photo = true_flight(given.seed), approximate_photo(name, given.seed)
    place = flight.block.surveyed[str(point)].position
    operator = OPERATORS["cfog"]
    around = grid_about(place, PATCH_M + REACH_M, 1.0)
    # What is known of a crossroads comes from the ortho: both are off by the same.
    patch_plan = plan_of(grid_about(true_place(point, given)[0], PATCH_M, 1.0))
    side = 2 * PATCH_M + 1
    template = paint_ground(patch_plan, 0.0, given.seed).reshape(side, side).astype(np.float32)
    window = rectify_scan(photo, around, flight.photos[name], given).astype(np.float32)
    shown = operator.of_scan(window, PATCH_M)
    patch = operator.of_reference(template, np.zeros_like(template), PATCH_M)
    scores = operator.scores(shown, patch)
    peaks = detect_peaks(scores, PEAKS, APART_PX)
    if not peaks:
        return None
    best = peaks[0]
    shift = np.array([best.column - REACH_M, REACH_M - best.row])
    plan = place[None, :2] + shift
    ground = np.column_stack([plan, DEM.heights(plan)])
    # At one metre a pixel; the paraboloid errs by the floor even where there is no noise.
    sigma_m = float(np.hypot(place_sigma_px(operator, shown, patch, best), PEAK_FLOOR_PX))
    return ControlSearch(
        template, scores, peaks, photo.pixel_from_object(place[None], CAMERA),
        photo.pixel_from_object(ground, CAMERA), sigma_m / photo.ground_pixel_m(CAMERA),
    )  # fmt: skip


def place_sigma_px(
    operator: Operator, shown: Description, patch: Description, peak: ScorePeak
) -> float:
    """Standard deviation per axis of a peak's place, by what the patch does not explain there."""
    rows, columns = (
        slice(round(first), round(first) + 2 * PATCH_M + 1) for first in (peak.row, peak.column)
    )
    part, template = operator.correlated(cut(shown, (rows, columns)), patch)
    sharpness = sharpness_of(template)
    assert sharpness is not None, "crossroads have edges in both directions"
    return float(np.sqrt(np.trace(place_covariance(sharpness, part)) / 2))


def rectify_scan(photo: Photo, grid: Grid, true: Photo, given: Given) -> Matrix:
    """A scan rectified onto a grid: its values where an orientation sees the pixels of the DEM."""
    plan = plan_of(grid)
    pixels = photo.pixel_from_object(np.column_stack([plan, DEM.heights(plan)]), CAMERA)
    rows, columns = (
        np.linspace(0, side - 1, NODES).astype(np.int64) for side in (grid.rows, grid.columns)
    )
    nodes = pixels.reshape(grid.rows, grid.columns, 2)[np.ix_(rows, columns)].reshape(-1, 2)
    seen = object_on_ground(true, CAMERA, nodes, TRUE_GROUND)[:, :2].reshape(NODES, NODES, 2)
    every = np.arange(grid.rows), np.arange(grid.columns)
    ground = [
        RectBivariateSpline(rows, columns, one)(*every).ravel() for one in np.moveaxis(seen, 2, 0)
    ]
    values = _developed(true, pixels, np.column_stack(ground), given)
    return values.reshape(grid.rows, grid.columns)


@lru_cache(maxsize=KEPT)
def adjust_flight(given: Given) -> AdjustmentReport:
    """The block with its ties and with the control that was found, adjusted."""
    block = true_flight(given.seed).block
    measured: dict[tuple[str, str], Measurement] = {}
    for point, name in block.measurements:
        found = search_point(int(point), name, given)
        if found is None:
            continue
        column, row = found.pixel[0].tolist()
        measured[point, name] = Measurement(point, name, column, row, found.sigma_px)
    photos = {name: approximate_photo(name, given.seed) for name in block.photos}
    block = replace(block, measurements=measured).with_photos(photos)
    return adjust_block(block, HELD)


def names_of_photos(point: int, given: Given) -> list[str]:
    """Photos in which a known point is sought, the one that shows it nearest its middle first."""
    flight = true_flight(given.seed)
    names = [name for known, name in flight.block.measurements if known == str(point)]
    place = flight.block.surveyed[str(point)].position[None]

    def from_middle(name: str) -> float:
        photo = flight.photos[name]
        pixel = photo.pixel_from_object(place, CAMERA)
        return float(np.hypot(*photo.interior.film_from_pixel(pixel)[0]))

    return sorted(names, key=from_middle)


def searches_of(point: int, given: Given) -> dict[str, ControlSearch]:
    """A known point in the two photos that show it nearest their middles, of those with a peak.

    Raises:
        LookupError: It is found in fewer than two photos.
    """
    found: dict[str, ControlSearch] = {}
    for name in names_of_photos(point, given):
        search = search_point(point, name, given)
        if search is not None:
            found[name] = search
        if len(found) == SHOWN:
            return found
    raise LookupError(f"point {point} is found in fewer than two photos")


@lru_cache(maxsize=KEPT)
def seams(given: Given) -> tuple[LabelledGround, tuple[str, ...]]:
    """Which photo shows which cell of the mosaic, as the engine divides the ground."""
    block, truth = adjust_flight(given).block, true_flight(given.seed).photos
    low, high = junctions().min(axis=0) - BEYOND_M, junctions().max(axis=0) + BEYOND_M
    side = 2 * CELL_M * np.ceil((high - low).max() / CELL_M / 2)
    west, south = np.floor(low / CELL_M) * CELL_M
    cells = int(side / CELL_M)
    grid = Grid(float(west), float(south + side), CELL_M, cells, cells)
    plan = plan_of(grid)
    views: list[SeamView] = []
    for name, photo in block.photos.items():
        ground = np.column_stack([plan, DEM.heights(plan)])
        pixels = photo.pixel_from_object(ground, CAMERA)
        reach = np.abs(photo.interior.film_from_pixel(pixels)).max(axis=1)
        gray = np.clip(scan_values(truth[name], pixels, given), 1, 255)
        gray = np.where(reach < HALF_MM, gray, 0).reshape(cells, cells).astype(np.float16)
        full, inner = (
            (reach < HALF_MM - rim).reshape(cells, cells) for rim in (HALF_CELL_MM, RIM_MM)
        )
        nadir = float(photo.exterior.centre[0]), float(photo.exterior.centre[1])
        views.append(SeamView(name, nadir, grid, gray, full, full, inner))
    return label_ground(views), tuple(block.photos)


GROUND_PIXEL_M = PIXEL_MM / 1000 * SCALE
"""Pixel of the scans on level ground."""


def true_place(point: int, given: Given) -> ObjectPoints:
    """A crossroads where it truly lies, (1, 3)."""
    return on_hills(junctions()[point][None])


class FollowedPoint:
    """The point, the photo it is followed in, and what the engine found, as far as it is asked."""

    def __init__(self, number: int, given: Given) -> None:
        self.given = given
        self.number = number
        self.searches = searches_of(number, given)
        self.name = next(iter(self.searches))
        self.true = true_flight(given.seed).photos[self.name]
        self.rough = approximate_photo(self.name, given.seed)
        self.place: ObjectPoints = true_place(number, given)
        self.true_pixel: PixelPoints = self.true.pixel_from_object(self.place, CAMERA)

    @property
    def search(self) -> ControlSearch:
        """The search in its photo."""
        return self.searches[self.name]

    @property
    def report(self) -> AdjustmentReport:
        """The adjusted block."""
        return adjust_flight(self.given)

    @property
    def photo(self) -> Photo:
        """Its photo as it was adjusted."""
        return self.report.block.photos[self.name]

    @property
    def residual_px(self) -> float | None:
        """Length of its residual in the photo; None where the adjustment has none of it."""
        residual = self.report.residuals_px.get((str(self.number), self.name))
        length = np.nan if residual is None else float(np.hypot(*residual))
        return float(length) if np.isfinite(length) else None
