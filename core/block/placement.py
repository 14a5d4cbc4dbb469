"""Coarse placement: a photo of doubtful position, rotation and scale found on the reference.

The scan is laid on the ground with the orientation it came with, then turned, scaled and shifted
over the reference as a whole; doubled gradient angles are compared by FFT (METHODS 3). Several
hypotheses come out: which of them is right, or none, only the resection after it can tell.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np
from jaxtyping import Complex64, Float32
from scipy import fft

from core.arrays import Mask, Matrix, PixelPoints, Position
from core.block.block import Photo
from core.block.patches import OpenPhoto, filled
from core.block.similarity import Image, Surface, doubled_angle_field
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles
from core.geometry.grid import Grid
from core.geometry.resection import PhotoModel
from core.progress import Progress, Silent
from core.reference.reference import Reference
from core.scan.raster import read_window

Spectrum = Complex64[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True)
class PlacementOptions:
    """How far and how finely to look."""

    coarse_px: int = 140
    """Width of the photo in pixels in the first search over all turns and scales."""
    fine_px: int = 420
    """Width of the photo in pixels in the second search about the best of the first."""
    search_sigmas: float = 2.5
    """Half-width of every search in standard deviations of the prior."""
    most_turn: float = np.pi
    """Largest turn that is tried, radians."""
    most_scale: float = 0.3
    """Largest change of scale that is tried, 1 = 100 %."""
    hypotheses: int = 3
    """Placements that are handed on."""


NARROW = PlacementOptions(coarse_px=300, most_turn=float(np.radians(2.0)), most_scale=0.03)
"""Finer, for photos that came with nearly the right turn and scale."""


@dataclass(frozen=True, slots=True)
class Turn:
    """One hypothesis: turn about the nadir, scale, then shift, on the ground."""

    kappa: float
    """Turn, radians, counter-clockwise."""
    scale: float
    """Scale of the ground distances."""
    east_m: float = 0.0
    """Shift to the east, metres."""
    north_m: float = 0.0
    """Shift to the north, metres."""
    score: float = 0.0
    """Similarity, up to 1."""
    z: float = 0.0
    """Height of the similarity above that of other places in robust standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A placed photo, and how far it can be trusted."""

    exterior: ExteriorOrientation
    """Exterior orientation after the placement."""
    covariance: Matrix
    """6 x 6 of X, Y, Z (m), omega, phi, kappa (rad)."""
    turn: Turn
    """What was done to the orientation the photo came with."""


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """A photo laid on a ground grid about its nadir."""

    grid: Grid
    image: Image
    mask: Mask


def place_photo(
    opened: OpenPhoto,
    reference: Reference,
    options: PlacementOptions,
    progress: Progress | None = None,
) -> tuple[Placement, ...]:
    """The most likely placements of a photo on the reference, best first.

    Args:
        opened: The photo; its `approximate` orientation and `prior` bound the search.
        reference: Ortho and heights.
        options: Limits.
        progress: Told after every turn.
    """
    watch = progress or Silent()
    photo, width = opened.photo, opened.width_m
    start = Turn(0.0, 1.0)
    level = Level(opened, reference, width / options.coarse_px, start, options)
    trials = list(trial_turns(photo, options))
    turns: list[Turn] = []
    for done, (kappa, scale) in enumerate(trials):
        watch.report(done, len(trials), photo.photo_id)
        turns.extend(level.peaks(kappa, scale, count=2))
    best = distinct(turns, options.hypotheses, width)
    refined = [refined_turn(opened, reference, turn, options) for turn in best]
    refined.sort(key=lambda turn: -turn.score)
    sigma = 2 * width / options.fine_px
    return tuple(placed(opened, turn, sigma) for turn in refined)


def refined_turn(
    opened: OpenPhoto, reference: Reference, turn: Turn, options: PlacementOptions
) -> Turn:
    """The same placement sought again at a finer scale close to a first one."""
    step = 1.5 / options.coarse_px
    level = Level(opened, reference, opened.width_m / options.fine_px, turn, options)
    trials = product((-step, 0.0, step), (-step, 0.0, step))
    found = [
        peak
        for kappa, scale in trials
        for peak in level.peaks(turn.kappa + kappa, turn.scale * (1 + scale), count=1)
    ]
    return max(found, key=lambda peak: peak.score, default=turn)


def trial_turns(photo: Photo, options: PlacementOptions) -> Iterator[tuple[float, float]]:
    """Turns and scales to try: steps that move the photo's corner by about 1.5 coarse pixels."""
    step = 3.0 / options.coarse_px
    kappa = min(options.search_sigmas * float(photo.prior.sigma_angles[2]), options.most_turn)
    above = float(photo.approximate.centre[2]) - photo.ground_height_m
    scale = min(
        options.search_sigmas * float(photo.prior.sigma_centre_m[2]) / above, options.most_scale
    )
    turns = np.arange(-np.floor(kappa / step), np.floor(kappa / step) + 1) * step
    scales = np.arange(-np.floor(scale / step), np.floor(scale / step) + 1) * step
    return product((float(turn) for turn in turns), (float(1 + change) for change in scales))


class Level:
    """One pair of images at one ground sample distance, ready for many trials."""

    def __init__(
        self,
        opened: OpenPhoto,
        reference: Reference,
        gsd_m: float,
        start: Turn,
        options: PlacementOptions,
    ) -> None:
        self.gsd_m, self.start = gsd_m, start
        self.laid = laid_on_ground(opened, reference, gsd_m)
        fine = start.score > 0
        radius = 12 * gsd_m if fine else search_radius_m(opened.photo, options)
        grid = shifted_grid(self.laid.grid, start, radius)
        patch = reference.ortho.read(grid)
        field = complex_field(filled(patch.values, patch.mask)) * eroded(patch.mask)
        self.radius_px = round(radius / gsd_m)
        self.shape = tuple(fft.next_fast_len(side) for side in field.shape)
        self.field = forward(field, self.shape)
        self.energy = forward(np.abs(field) ** 2, self.shape)
        self.energies: dict[int, np.ndarray] = {}

    def peaks(self, kappa: float, scale: float, count: int) -> list[Turn]:
        """Best shifts of one turn and scale."""
        image, mask = turned(self.laid, kappa, scale)
        if mask.mean() < 0.05:
            return []
        template = complex_field(filled(image, mask)) * mask
        if not template.any():  # a blank photo is like nothing
            return []
        surface = self.similarity(template, mask)
        middle = float(np.median(surface))
        spread = 1.4826 * float(np.median(np.abs(surface - middle))) + 1e-9
        found: list[Turn] = []
        for _ in range(count):
            row, column = np.unravel_index(int(np.argmax(surface)), surface.shape)
            value = float(surface[row, column])
            found.append(
                Turn(
                    kappa,
                    scale,
                    self.start.east_m + (int(column) - self.radius_px) * self.gsd_m,
                    self.start.north_m - (int(row) - self.radius_px) * self.gsd_m,
                    value,
                    (value - middle) / spread,
                )
            )
            low = max(int(row) - 4, 0), max(int(column) - 4, 0)
            surface[low[0] : int(row) + 5, low[1] : int(column) + 5] = middle
        return found

    def similarity(self, template: Spectrum, mask: Mask) -> Surface:
        """Normalised correlation of doubled angles at every shift within the radius."""
        reach = 2 * self.radius_px + 1
        common = inverse(self.field * np.conj(forward(template, self.shape)))
        own = float(np.sum(np.abs(template) ** 2))
        under = self.energy_under(mask)[:reach, :reach]
        return np.asarray(common[:reach, :reach] / np.sqrt(own * under), np.float32)

    def energy_under(self, mask: Mask) -> Surface:
        """Energy of the reference under the photo at every shift, never far below the most.

        Of masks of about one size the first serves for all: turning hardly changes their shape.
        """
        key = round(10 * float(np.log(mask.sum())))
        if key not in self.energies:
            spectrum = np.conj(forward(mask.astype(np.float32), self.shape))
            energy = inverse(self.energy * spectrum)
            self.energies[key] = np.maximum(energy, 0.3 * float(np.max(energy)) + 1e-6)
        return self.energies[key]


def search_radius_m(photo: Photo, options: PlacementOptions) -> float:
    """How far the photo may have to be shifted: position, and the tilt that shifts its picture."""
    above = float(photo.approximate.centre[2]) - photo.ground_height_m
    tilt = above * float(np.max(photo.prior.sigma_angles[:2]))
    return options.search_sigmas * float(np.hypot(np.max(photo.prior.sigma_centre_m[:2]), tilt))


def laid_on_ground(opened: OpenPhoto, reference: Reference, gsd_m: float) -> Laid:
    """The scan rectified on a square ground grid about the photo's nadir."""
    photo, camera = opened.photo, opened.camera
    centre, above = photo.exterior.centre, float(photo.exterior.centre[2]) - photo.ground_height_m
    half = 0.55 * float(np.hypot(*camera.frame_mm)) / camera.principal_distance_mm * above
    side = 2 * int(np.ceil(half / gsd_m)) + 1
    west, north = float(centre[0]) - side * gsd_m / 2, float(centre[1]) + side * gsd_m / 2
    grid = Grid(west, north, gsd_m, side, side)
    east, northing = np.meshgrid(*grid.centres())
    heights = reference.dem.on(grid).astype(np.float64).ravel()
    heights = np.where(np.isnan(heights), photo.ground_height_m, heights)
    ground = np.column_stack([east.ravel(), northing.ravel(), heights])
    pixels = photo.pixel_from_object(ground, camera)
    reduction = max(1, int(gsd_m / opened.ground_pixel_m))
    columns, rows = photo.size_px[0] // reduction, photo.size_px[1] // reduction
    grey = read_window(opened.scan, 0, 0, columns * reduction, rows * reduction, reduction)
    place = (pixels / reduction - 0.5).astype(np.float32).reshape(side, side, 2)
    across, down = place[:, :, 0], place[:, :, 1]
    image = cv2.remap(np.asarray(grey, np.float32), across, down, cv2.INTER_LINEAR)
    inside = inside_frame(photo, camera, pixels).reshape(side, side)
    return Laid(grid, np.asarray(image, np.float32), inside)


def inside_frame(photo: Photo, camera: Camera, pixels: PixelPoints) -> np.ndarray:
    """True for scan pixels well inside the picture area (4 % of the frame stay away)."""
    film = photo.interior.film_from_pixel(np.nan_to_num(pixels, nan=-1e9))
    return np.all(np.abs(film) < 0.46 * np.array(camera.frame_mm), axis=1)


def shifted_grid(grid: Grid, start: Turn, radius_m: float) -> Grid:
    """The laid photo's grid, moved by a shift and larger by a whole number of pixels."""
    gsd = grid.ground_sample_distance_m
    rim = round(radius_m / gsd)
    return Grid(
        grid.west + start.east_m - rim * gsd,
        grid.north + start.north_m + rim * gsd,
        gsd,
        grid.columns + 2 * rim,
        grid.rows + 2 * rim,
    )


def turned(laid: Laid, kappa: float, scale: float) -> tuple[Image, Mask]:
    """The laid photo turned counter-clockwise and scaled about the middle of its grid."""
    side = laid.image.shape[0]
    middle = (side - 1) / 2
    matrix = cv2.getRotationMatrix2D((middle, middle), float(np.degrees(kappa)), scale)
    image = cv2.warpAffine(laid.image, matrix, (side, side), flags=cv2.INTER_LINEAR)
    mask = cv2.warpAffine(laid.mask.astype(np.float32), matrix, (side, side))
    return np.asarray(image, np.float32), np.asarray(eroded(mask > 0.99))


def forward(values: np.ndarray, shape: Any) -> Any:
    """Fourier transform, padded with noughts to a shape."""
    return fft.fft2(values, shape)


def inverse(spectrum: Any) -> Float32[np.ndarray, "rows columns"]:
    """Real part of the inverse Fourier transform."""
    return np.real(np.asarray(fft.ifft2(spectrum)))


def complex_field(image: Image) -> Spectrum:
    """Doubled-angle field of an image as complex numbers."""
    field = doubled_angle_field(image)
    return np.asarray(field[:, :, 0] + 1j * field[:, :, 1], dtype=np.complex64)


def eroded(mask: Mask) -> Mask:
    """A mask without the rim where gradients feel its edge."""
    return cv2.erode(mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0


def distinct(turns: list[Turn], count: int, width_m: float) -> list[Turn]:
    """The best turns that differ in turn or shift."""
    kept: list[Turn] = []
    for turn in sorted(turns, key=lambda turn: -turn.z):
        if all(
            np.hypot(turn.east_m - other.east_m, turn.north_m - other.north_m) > 0.05 * width_m
            or abs(np.angle(np.exp(1j * (turn.kappa - other.kappa)))) > 0.1
            for other in kept
        ):
            kept.append(turn)
        if len(kept) == count:
            break
    return kept


def placed(opened: OpenPhoto, turn: Turn, sigma_m: float) -> Placement:
    """Exterior orientation and covariance of a photo after a turn."""
    photo = opened.photo
    was = photo.exterior
    above = (float(was.centre[2]) - photo.ground_height_m) * turn.scale
    centre: Position = np.array(
        [was.centre[0] + turn.east_m, was.centre[1] + turn.north_m, photo.ground_height_m + above]
    )
    about = rotation_from_angles(0.0, 0.0, turn.kappa) @ was.object_from_image
    exterior = ExteriorOrientation(centre, *angles_from_rotation(about))
    return Placement(exterior, placement_covariance(opened.at(exterior), sigma_m), turn)


def placement_covariance(opened: OpenPhoto, sigma_m: float) -> Matrix:
    """Covariance of a placed photo: its middle is known to sigma, its corners to two sigma.

    The corners know less because the placement takes the photo as truly vertical.
    """
    photo, camera = opened.photo, opened.camera
    half = np.array(camera.frame_mm) / 2
    film = np.array([[0.0, 0.0], [-0.6, -0.6], [0.6, -0.6], [0.6, 0.6], [-0.6, 0.6]]) * half
    pixels = photo.interior.pixel_from_film(film)
    ground = photo.object_from_pixel(pixels, np.full(5, photo.ground_height_m), camera)
    model = PhotoModel(photo.interior, camera, photo.atmosphere)
    derivatives = model.linearised(ground, photo.exterior)[1]
    sigma_px = sigma_m / opened.ground_pixel_m * np.array([1.0, 2.0, 2.0, 2.0, 2.0])
    weight = 1 / sigma_px**2
    information = np.einsum("nai,n,naj->ij", derivatives, weight, derivatives)
    return np.linalg.inv(information + np.linalg.inv(prior_covariance(photo)))


def prior_covariance(photo: Photo) -> Matrix:
    """6 x 6 covariance of the orientation the photo came with."""
    return np.diag(np.concatenate([photo.prior.sigma_centre_m, photo.prior.sigma_angles]) ** 2)
