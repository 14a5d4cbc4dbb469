"""A ground with a known texture, and photos of it computed ray by ray."""

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from affine import Affine

from core.arrays import locked
from core.block import ExteriorPrior, Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.raster.grid import Grid

EAST, NORTH = 500_000.0, 4_100_000.0
CRS = "EPSG:32633"


@dataclass(frozen=True)
class Hills:
    """An analytic DEM: smooth hills, optionally with a hole."""

    relief_m: float = 40.0
    ground_sample_distance_m: float = 5.0
    hole: tuple[float, float, float] | None = None

    def heights(self, points):
        east, north = points[:, 0] - EAST, points[:, 1] - NORTH
        height = 300 + self.relief_m * np.sin(east / 210.0) * np.cos(north / 170.0)
        if self.hole is not None:
            distance = np.hypot(points[:, 0] - self.hole[0], points[:, 1] - self.hole[1])
            height = np.where(distance < self.hole[2], np.nan, height)
        return height

    def on(self, grid: Grid):
        east, north = np.meshgrid(*grid.centres())
        return self.heights(np.column_stack([east.ravel(), north.ravel()])).reshape(east.shape)


def texture(east, north):
    """Gray values of the ground, 20 to 235, with waves of 6 to 60 metres."""
    east, north = east - EAST, north - NORTH
    waves = [(6.1, 0.3), (9.7, 1.9), (14.3, 2.6), (23.0, 0.9), (41.0, 1.4), (60.0, 2.2), (8.3, 3.0)]
    total = sum(
        np.sin(2 * np.pi * (east * np.cos(a) + north * np.sin(a)) / w + 3 * a) for w, a in waves
    )
    return 127.5 + 107.5 * total / len(waves)


def texture_on(grid: Grid):
    return texture(*np.meshgrid(*grid.centres()))


@dataclass
class Scene:
    """Writes photos of the textured hills."""

    folder: Path
    dem: Hills = field(default_factory=Hills)
    camera: Camera = field(
        default_factory=lambda: Camera(
            "wide",
            100.0,
            (60.0, 60.0),
            principal_point_mm=(0.05, -0.03),
            radial_distortion=(-3e-7, 2e-10, 0.0),
        )
    )
    pixel_mm: float = 0.06
    flying_height_m: float = 1000.0

    def photo(self, name, east=0.0, north=0.0, kappa=0.05, gain=1.0, offset=0.0, bits=8) -> Photo:
        """A photo whose nadir lies east, north of the middle; ground pixels of about 0.6 m."""
        side = round(self.camera.frame_mm[0] / self.pixel_mm) + 20
        size, turn = (side, side), 0.01
        pixel_from_film = np.array([[np.cos(turn), np.sin(turn)], [np.sin(turn), -np.cos(turn)]])
        pixel_from_film /= self.pixel_mm
        matrix = np.linalg.inv(pixel_from_film)
        shift = -matrix @ np.array([side / 2 + 1.3, side / 2 - 2.1])
        none = np.zeros((0, 2))
        interior = InteriorOrientation(
            "affine", np.column_stack([matrix, shift]), (), none, none, float("nan")
        )
        centre = np.array([EAST + east, NORTH + north, 300 + self.flying_height_m])
        exterior = ExteriorOrientation(centre, 0.02, -0.03, kappa)
        path = self.folder / f"{name}.tif"
        photo = Photo(
            photo_id=name,
            scan=path,
            size_px=size,
            camera=self.camera.name,
            interior=interior,
            exterior=exterior,
            approximate=exterior,
            prior=ExteriorPrior(locked([20.0] * 3), locked([0.02] * 3)),
            ground_height_m=300.0,
            oriented=True,
        )
        self._write(photo, path, gain, offset, bits)
        return photo

    def _write(self, photo, path, gain, offset, bits):
        columns, rows = photo.size_px
        # Every fourth pixel by rays, the ground between them by interpolation (below 1 mm).
        steps = [4 * np.arange(-1, size // 4 + 1) + 2.0 for size in (columns, rows)]
        pixels = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
        heights = np.full(len(pixels), 300.0)
        whole = Hills(self.dem.relief_m)
        for _ in range(6):
            points = photo.object_from_pixel(pixels, heights, self.camera)
            heights = whole.heights(points[:, :2])
        nodes = (points[:, :2] - [EAST, NORTH]).reshape(rows // 4 + 2, columns // 4 + 2, 2)
        size = (columns + 8, rows + 8)
        points = cv2.resize(nodes, size, interpolation=cv2.INTER_LINEAR)[4:-4, 4:-4]
        values = gain * texture(points[..., 0] + EAST, points[..., 1] + NORTH) + offset
        top = 2**bits - 1
        values = np.rint(np.clip(values * top / 255, 0, top))
        profile = {"width": columns, "height": rows, "count": 1, "dtype": f"uint{bits}"}
        # A transform of its own, or rasterio warns that there is none.
        nominal = Affine(0.5, 0, 7, 0, -0.5, 9)
        with rasterio.open(path, "w", driver="GTiff", transform=nominal, **profile) as file:
            file.write(values.astype(f"uint{bits}"), 1)


@pytest.fixture(scope="session")
def scene(tmp_path_factory) -> Scene:
    return Scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="session")
def middle(scene) -> Photo:
    return scene.photo("middle")


@pytest.fixture(scope="session")
def ground():
    """The functions that know the truth, for tests that cannot import this file."""
    return {"texture_on": texture_on, "Hills": Hills, "Scene": Scene, "origin": (EAST, NORTH)}
