"""Four digital frames of the NGI block for tests, with positions blurred by 200 m."""

import csv
from pathlib import Path

import numpy as np

from core.block import Block, ExteriorPrior, Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

SIZE_PX = (640, 1152)
FRAME_MM = (92.16, 165.888)
GROUND_M = 500.0


def ngi_block(folder: Path, seed: int = 1, blur_m: float = 200.0) -> tuple[Block, Block]:
    """The block as the stages before the tie points leave it, and with published orientations."""
    camera = Camera("dmc", 120.0, FRAME_MM)
    scale = FRAME_MM[0] / SIZE_PX[0]
    matrix = np.array([[scale, 0.0, -FRAME_MM[0] / 2], [0.0, -scale, FRAME_MM[1] / 2]])
    none = np.zeros((0, 2))
    interior = InteriorOrientation("nominal", matrix, (), none, none, float("nan"))
    rng = np.random.default_rng(seed)
    prior = ExteriorPrior(np.array([200.0, 200.0, 100.0]), np.full(3, 0.02))
    given, published = {}, {}
    with (folder / "io" / "ngi_xyz_opk.csv").open() as file:
        for row in csv.DictReader(file):
            name = row["filename"]
            centre = np.array([float(row[axis]) for axis in "xyz"])
            angles = np.radians([float(row[angle]) for angle in ("omega", "phi", "kappa")])
            exact = ExteriorOrientation(centre, *map(float, angles))
            start = ExteriorOrientation(
                centre + rng.normal(0.0, blur_m, 3) * np.array([1, 1, 0.5]),
                0.0,
                0.0,
                float(angles[2]),
            )
            scan = folder / "frames" / f"{name}.tif"
            photo = Photo(name, scan, SIZE_PX, "dmc", interior, start, start, prior, GROUND_M)
            given[name] = photo
            published[name] = photo.with_exterior(exact, oriented=True)
    cameras = {"dmc": camera}
    crs = "+proj=tmerc +lon_0=25 +datum=WGS84"
    return Block(crs, cameras, dict(sorted(given.items()))), Block(
        crs, cameras, dict(sorted(published.items()))
    )
