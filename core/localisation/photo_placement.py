"""Coarse placement: a photo of doubtful position, rotation and scale found on the reference.

The scan is laid on the ground with the orientation it came with, then turned, scaled and shifted
over the reference as a whole; doubled gradient angles are compared by FFT (METHODS 3). Several
hypotheses come out: which of them is right, or none, only the resection after it can tell.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np

from core.arrays import Matrix, PixelPoints
from core.block import Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import PhotoModel
from core.matching.global_search import (
    Backdrop,
    Laid,
    Level,
    Turn,
    angle_field,
    distinct,
    steps_of,
)
from core.matching.patches import OpenPhoto, filled
from core.matching.reference import Reference
from core.raster.grid import Grid
from core.raster.scan_file import read_window


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


NARROW = PlacementOptions(
    coarse_px=300, fine_px=600, most_turn=float(np.radians(3.0)), most_scale=0.03
)
"""Finer, for photos that came with nearly the right turn and scale."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A placed photo, and how far it can be trusted."""

    exterior: ExteriorOrientation
    """Exterior orientation after the placement."""
    covariance: Matrix
    """6 x 6 of X, Y, Z (m), omega, phi, kappa (rad)."""
    turn: Turn
    """What was done to the orientation the photo came with."""


def place_photo(
    opened: OpenPhoto,
    reference: Reference,
    options: PlacementOptions,
    mapper: Callable[..., Iterable[Any]] = map,
) -> tuple[Placement, ...]:
    """The most likely placements of a photo on the reference, best first.

    Args:
        opened: The photo; its `approximate` orientation and `prior` bound the search.
        reference: Ortho and heights.
        options: Limits.
        mapper: Runs a function over trials, such as the `map` of a thread pool.
    """
    photo, width = opened.photo, opened.width_m
    finer = max(1, round(options.fine_px / options.coarse_px))
    gsd = width / options.coarse_px
    laid = laid_on_ground(opened, reference, photo_grid(opened, gsd))
    radius = search_radius_m(photo, options)
    reach = laid.half_m + radius
    backdrop = Backdrop.read(reference.ortho, photo.exterior.centre[:2], reach, gsd / finer)
    level = Level(laid, backdrop.coarser(finer), Turn(0.0, 1.0), radius)
    turns = level.search(trial_turns(photo, options), 2, mapper)
    best = distinct(turns, options.hypotheses, width)
    fine = laid_on_ground(opened, reference, photo_grid(opened, gsd / finer))
    step = 1.5 / options.coarse_px
    refined = [refined_turn(fine, backdrop, turn, step) for turn in best]
    refined.sort(key=lambda turn: -turn.score)
    return tuple(placed(opened, turn, 2 * gsd / finer) for turn in refined)


def refined_turn(laid: Laid, backdrop: Backdrop, turn: Turn, step: float) -> Turn:
    """The same placement sought again at a finer scale, uphill from a first one."""
    level = Level(laid, backdrop, turn, 12 * laid.grid.ground_sample_distance_m)
    best: Turn | None = None
    for width in (step, step, step / 2):
        begin = best or turn
        around = product((-width, 0.0, width), (-width, 0.0, width))
        trials = [(begin.kappa + kappa, begin.scale * (1 + scale)) for kappa, scale in around]
        found = level.search(trials)
        best = max([*found, *([best] if best else [])], key=lambda peak: peak.score, default=None)
    return best or turn


def trial_turns(photo: Photo, options: PlacementOptions) -> list[tuple[float, float]]:
    """Turns and scales to try: steps that move the photo's corner by about 1.5 coarse pixels."""
    step = 3.0 / options.coarse_px
    kappa = min(options.search_sigmas * float(photo.prior.sigma_angles[2]), options.most_turn)
    above = float(photo.approximate.centre[2]) - photo.ground_height_m
    scale = min(
        options.search_sigmas * float(photo.prior.sigma_centre_m[2]) / above, options.most_scale
    )
    trials = product(steps_of(kappa, step), steps_of(scale, step))
    return [(float(turn), float(1 + change)) for turn, change in trials]


def search_radius_m(photo: Photo, options: PlacementOptions) -> float:
    """How far the photo may have to be shifted: position, and the tilt that shifts its picture."""
    above = float(photo.approximate.centre[2]) - photo.ground_height_m
    tilt = above * float(np.max(photo.prior.sigma_angles[:2]))
    return options.search_sigmas * float(np.hypot(np.max(photo.prior.sigma_centre_m[:2]), tilt))


def photo_grid(opened: OpenPhoto, gsd_m: float) -> Grid:
    """A square ground grid about the photo's nadir that holds the photo however it is turned."""
    photo, frame = opened.photo, opened.camera.frame_mm
    above = float(photo.exterior.centre[2]) - photo.ground_height_m
    half = 0.55 * float(np.hypot(*frame)) / opened.camera.principal_distance_mm * above
    side = 2 * int(np.ceil(half / gsd_m)) + 1
    east, north = (float(value) for value in photo.exterior.centre[:2])
    return Grid(east - side * gsd_m / 2, north + side * gsd_m / 2, gsd_m, side, side)


def laid_on_ground(opened: OpenPhoto, reference: Reference, grid: Grid) -> Laid:
    """The scan's doubled angles, rectified on a ground grid with the orientation it has."""
    photo, camera = opened.photo, opened.camera
    east, northing = np.meshgrid(*grid.centres())
    heights = reference.dem.on(grid).astype(np.float64).ravel()
    heights = np.where(np.isnan(heights), photo.ground_height_m, heights)
    ground = np.column_stack([east.ravel(), northing.ravel(), heights])
    pixels = photo.pixel_from_object(ground, camera)
    reduction = max(1, int(grid.ground_sample_distance_m / opened.ground_pixel_m))
    columns, rows = photo.size_px[0] // reduction, photo.size_px[1] // reduction
    grey = read_window(opened.scan, 0, 0, columns * reduction, rows * reduction, reduction)
    place = (pixels / reduction - 0.5).astype(np.float32).reshape(*east.shape, 2)
    across, down = place[:, :, 0], place[:, :, 1]
    image = cv2.remap(np.asarray(grey, np.float32), across, down, cv2.INTER_LINEAR)
    inside = inside_frame(photo, camera, pixels)
    if opened.scan.usable is not None:
        inside &= opened.scan.usable.at(pixels)
    mask = inside.reshape(east.shape)
    return Laid(grid, angle_field(filled(np.asarray(image, np.float32), mask), mask), mask)


def inside_frame(photo: Photo, camera: Camera, pixels: PixelPoints) -> np.ndarray:
    """True for scan pixels well inside the picture area (4 % of the frame stay away)."""
    film = photo.interior.film_from_pixel(np.nan_to_num(pixels, nan=-1e9))
    return np.all(np.abs(film) < 0.46 * np.array(camera.frame_mm), axis=1)


def placed(opened: OpenPhoto, turn: Turn, sigma_m: float) -> Placement:
    """Exterior orientation and covariance of a photo after a turn."""
    photo = opened.photo
    exterior = turn.moved(photo.exterior, photo.exterior.centre[:2], photo.ground_height_m)
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
