"""One photo laid on the ground as a picture, and how well its orientation is known once placed."""

from dataclasses import dataclass

import cv2
import numpy as np

from core.arrays import Matrix, PixelPoints
from core.block import Photo
from core.frames import opencv_from_pixel
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import PhotoModel
from core.matching.global_search import Laid, Turn, angle_field
from core.matching.patches import OpenPhoto, filled
from core.matching.reference import Reference
from core.raster.grid import Grid
from core.raster.scan_file import read_window


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A placed photo, and how far it can be trusted."""

    exterior: ExteriorOrientation
    """Exterior orientation after the placement."""
    covariance: Matrix
    """6 x 6 of X, Y, Z (m), omega, phi, kappa (rad)."""
    turn: Turn
    """What was done to the orientation the photo came with."""


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
    place = opencv_from_pixel(pixels / reduction).astype(np.float32).reshape(*east.shape, 2)
    across, down = place[:, :, 0], place[:, :, 1]
    image = cv2.remap(np.asarray(grey, np.float32), across, down, cv2.INTER_LINEAR)
    inside = inside_frame(photo, camera, pixels)
    if opened.scan.usable is not None:
        inside &= opened.scan.usable.at(pixels)
    mask = inside.reshape(east.shape)
    return Laid(grid, angle_field(filled(np.asarray(image, np.float32), mask), mask), mask)


def inside_frame(photo: Photo, camera: Camera, pixels: PixelPoints) -> np.ndarray:
    """True for scan pixels well inside the picture area (4 % of the frame stay away)."""
    # design: numerical safety; nowhere on any film.
    film = photo.interior.film_from_pixel(np.nan_to_num(pixels, nan=-1e9))
    # design: a margin that keeps marks and notes out.
    return np.all(np.abs(film) < 0.46 * np.array(camera.frame_mm), axis=1)


def placement_covariance(opened: OpenPhoto, sigma_m: float) -> Matrix:
    """Covariance of a placed photo: its middle is known to sigma, its corners to two sigma.

    The corners know less because the placement takes the photo as truly vertical.
    """
    photo, camera = opened.photo, opened.camera
    half = np.array(camera.frame_mm) / 2
    # design: the middle and the middles of the outer parts.
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
