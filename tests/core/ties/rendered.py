"""A small block of photos rendered from a textured hilly ground, with known orientations."""

from pathlib import Path

import cv2
import numpy as np
import rasterio
from scipy.ndimage import map_coordinates

from core.block import Block, ExteriorPrior, Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

SIZE_PX = (900, 900)
CELL_M = 0.5
SIDE_M = 1500.0
CAMERA = Camera("c", 75.0, (80.0, 80.0), (0.02, -0.03), (-2e-8, 0.0, 0.0))
CENTRES = {
    "a1": (480.0, 500.0, 880.0, 0.3),
    "a2": (760.0, 480.0, 900.0, 1.5),
    "a3": (1030.0, 510.0, 890.0, -1.0),
    "b1": (520.0, 980.0, 905.0, 181.0),
    "b2": (790.0, 1010.0, 885.0, 178.5),
}
"""East, north, height in metres and kappa in degrees: two strips in opposite directions."""


def ground_texture(rng: np.random.Generator) -> np.ndarray:
    """Grey values with structure of all sizes."""
    side = int(SIDE_M / CELL_M)
    total = np.zeros((side, side), dtype=np.float32)
    for cell in (2, 4, 8, 16, 32):
        coarse = rng.normal(size=(side // cell, side // cell)).astype(np.float32)
        total += cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC)
    return 120 + 22 * total


def terrain(east: np.ndarray, north: np.ndarray, relief_m: float) -> np.ndarray:
    return 100 + relief_m * np.sin(east / 130) * np.cos(north / 170 + 1.0)


def rendered_block(folder: Path, relief_m: float, noise: float = 10.0, seed: int = 1):
    """The block with approximate orientations, and the same with the true ones."""
    rng = np.random.default_rng(seed)
    texture = ground_texture(rng)
    none = np.zeros((0, 2))
    matrix = np.array([[0.1, 0.0005, -45.3], [0.0004, -0.1, 44.8]])
    interior = InteriorOrientation("affine", matrix, (), none, none, 3.0)
    prior = ExteriorPrior(np.array([20.0, 20.0, 10.0]), np.full(3, 0.02))
    given, true = {}, {}
    for name, (east, north, height, kappa) in CENTRES.items():
        tilts = rng.normal(0, 0.015, 2)
        exact = ExteriorOrientation(
            np.array([east, north, height]), *map(float, tilts), float(np.radians(kappa))
        )
        start = ExteriorOrientation(
            exact.centre + rng.normal(0, 15, 3), 0.0, 0.0, exact.kappa + float(rng.normal(0, 0.01))
        )
        scan = folder / f"{name}.tif"
        photo = Photo(name, scan, SIZE_PX, "c", interior, start, start, prior, 100.0)
        given[name], true[name] = photo, photo.with_exterior(exact, oriented=True)
        write(scan, rendered(true[name], texture, relief_m) + rng.normal(0, noise, SIZE_PX[::-1]))
    cameras = {"c": CAMERA}
    return Block("EPSG:5514", cameras, given), Block("EPSG:5514", cameras, true)


def rendered(photo: Photo, texture: np.ndarray, relief_m: float) -> np.ndarray:
    """Grey values of a photo, each from the ground its middle sees."""
    place = (ground_seen(photo, relief_m) / CELL_M - 0.5).astype(np.float32)
    return cv2.remap(texture, place[..., 0], texture.shape[0] - 1 - place[..., 1], cv2.INTER_CUBIC)


def ground_seen(photo: Photo, relief_m: float, step: int = 6) -> np.ndarray:
    """Where the middle of each pixel sees the ground (rows, columns, 2), from a coarse grid.

    Between its nodes the ground bends by a centimetre.
    """
    nodes = [np.arange(0.0, side + step, step) for side in SIZE_PX]
    grid = np.stack(np.meshgrid(*nodes), axis=-1)
    pixels = grid.reshape(-1, 2)
    low, high = (
        photo.object_from_pixel(pixels, np.full(len(pixels), height), CAMERA)[:, :2]
        for height in (0.0, 200.0)
    )
    heights = np.full(len(pixels), 100.0)
    for _ in range(12):
        ground = low + (high - low) * heights[:, None] / 200.0
        heights = terrain(ground[:, 0], ground[:, 1], relief_m)
    ground = ground.reshape(grid.shape)
    row, column = ((np.arange(side) + 0.5) / step for side in SIZE_PX[::-1])
    where = np.meshgrid(row, column, indexing="ij")
    return np.stack([map_coordinates(ground[..., axis], where, order=1) for axis in (0, 1)], -1)


def write(path: Path, gray: np.ndarray) -> None:
    profile = {"driver": "GTiff", "count": 1, "dtype": "uint8"}
    rows, columns = gray.shape
    with rasterio.open(path, "w", width=columns, height=rows, **profile) as dataset:
        dataset.write(np.clip(np.rint(gray), 0, 255).astype(np.uint8), 1)
