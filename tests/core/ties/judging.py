"""Tie points judged by true orientations: intersected, and compared with their rays."""

import numpy as np

from core.block import Block, TiePoints
from core.progress import Silent
from core.ties.matches import rays_of
from core.ties.stage import TieOptions, detect_block_features, match_block_features


def match_ties(block: Block, rng, options=None, usable=None):
    """Tie points of all photos of a block where they lie, reports of its pairs, and doubts.

    `usable` says by photo where features may lie; else the camera's picture area.
    """
    options = options or TieOptions()
    features = detect_block_features(block, options, Silent(), usable or {})
    return match_block_features(block, features, options, Silent(), rng)


def intersected(block: Block, ties: TiePoints) -> tuple[np.ndarray, np.ndarray]:
    """Ground of every tie point and the residual (measured minus computed) of every ray, pixels."""
    normal, right = np.zeros((ties.count, 3, 3)), np.zeros((ties.count, 3))
    for number, name in enumerate(ties.photo_ids):
        mine = ties.photo == number
        photo = block.photos[name]
        rays = rays_of(photo, block.camera_of(name), ties.pixels[mine])
        rays = rays @ photo.exterior.object_from_image.T
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        np.add.at(normal, ties.point[mine], across)
        np.add.at(right, ties.point[mine], across @ photo.exterior.centre)
    ground = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    weight = 1 / ties.sigma_px**2
    for _ in range(4):
        computed = projected(block, ties, ground)
        steps = [projected(block, ties, ground + 0.01 * np.eye(3)[axis]) for axis in range(3)]
        slope = np.stack([(step - computed) / 0.01 for step in steps], axis=2)
        residual = ties.pixels - computed
        normal, right = np.zeros((ties.count, 3, 3)), np.zeros((ties.count, 3))
        np.add.at(normal, ties.point, np.einsum("nij,nik,n->njk", slope, slope, weight))
        np.add.at(right, ties.point, np.einsum("nij,ni,n->nj", slope, residual, weight))
        ground += np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    return ground, ties.pixels - projected(block, ties, ground)


def projected(block: Block, ties: TiePoints, ground: np.ndarray) -> np.ndarray:
    """Pixels of ground points along every ray."""
    pixels = np.empty((len(ties.point), 2))
    for number, name in enumerate(ties.photo_ids):
        mine = ties.photo == number
        photo, camera = block.photos[name], block.camera_of(name)
        pixels[mine] = photo.pixel_from_object(ground[ties.point[mine]], camera)
    return pixels


def sigma_nought(ties: TiePoints, residual: np.ndarray) -> float:
    """Standard deviation of unit weight of the intersections."""
    freedom = 2 * len(ties.point) - 3 * ties.count
    return float(np.sqrt(np.sum((residual / ties.sigma_px[:, None]) ** 2) / freedom))
