"""The Vovcha block for tests: interiors from its truth, exteriors from its world files."""

import json
from pathlib import Path

import numpy as np

from core.block import Block, ExteriorPrior, Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

GROUND_M = 300.0


def vovcha_block(folder: Path) -> Block:
    """Six photos as the stages before the tie points leave them."""
    truth = json.loads((folder / "truth" / "truth.json").read_text())
    camera = Camera(
        "archive",
        151.92,
        (180.0, 180.0),
        fiducials_mm={
            name: (float(place[0]), float(place[1]))
            for name, place in truth["camera"]["fiducials"].items()
        },
    )
    photos = {}
    for name, entry in sorted(truth["eo"].items()):
        interior = interior_from(np.array(entry["film_to_pixel"]))
        world = np.loadtxt(folder / "scans" / f"{name}.tfw")
        exterior = exterior_from_world(world, interior, camera)
        photos[name] = Photo(
            name,
            folder / "scans" / f"{name}.tif",
            (4311, 4311),
            "archive",
            interior,
            exterior,
            exterior,
            ExteriorPrior(np.array([100.0, 100.0, 30.0]), np.full(3, 0.03)),
            GROUND_M,
        )
    return Block("EPSG:26918", {"archive": camera}, photos)


def interior_from(pixel_from_film: np.ndarray, origin_px: float = 0.5) -> InteriorOrientation:
    """The truth's matrix, which counts from the centre of the first pixel.

    Found from rays to points seen in both strips, which were flown in opposite directions: half a
    pixel in both directions brings their residuals from 0.29 px to 0.02 px.
    """
    inverse = np.linalg.inv(pixel_from_film[:, :2])
    offset = -inverse @ (pixel_from_film[:, 2] + origin_px)
    none = np.zeros((0, 2))
    matrix = np.column_stack([inverse, offset])
    return InteriorOrientation("affine", matrix, (), none, none, float("nan"))


def exterior_from_world(world, interior, camera) -> ExteriorOrientation:
    a, d, b, e, x, y = world
    column, row = (
        interior.pixel_from_film(np.zeros((1, 2)))[0] - 0.5
    )  # world files count from the centre
    gsd = np.hypot(a, d)
    height = GROUND_M + camera.principal_distance_mm * gsd / interior.pixel_size_mm
    centre = np.array([x + a * column + b * row, y + d * column + e * row, height])
    return ExteriorOrientation(centre, 0.0, 0.0, float(np.arctan2(d, a)))


def true_block(folder: Path, block: Block) -> Block:
    """The same block with true orientations and camera constants."""
    truth = json.loads((folder / "truth" / "truth.json").read_text())
    constants = truth["camera"]
    camera = block.cameras["archive"].with_constants(
        constants["focal_mm"], tuple(constants["pp"]), (*constants["k"], 0.0)
    )
    photos = {}
    for name, photo in block.photos.items():
        entry = truth["eo"][name]
        angles = np.radians([entry[f"{angle}_deg"] for angle in ("omega", "phi", "kappa")])
        centre = np.array([entry["X"], entry["Y"], entry["Z"]])
        exterior = ExteriorOrientation(centre, *map(float, angles))
        photos[name] = photo.with_exterior(exterior, oriented=True)
    return Block(block.crs, {"archive": camera}, photos, ties=block.ties)
