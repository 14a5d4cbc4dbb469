"""One large scan of changed ground, the map of today, and where the photo truly is.

A level landscape is painted twice, as it was and as it is: parcels are drawn anew, roads change
their tone. 300 junctions lie in a scan of 12 000 pixels.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio

from core.block import ExteriorPrior, Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.geometry.resection import moved
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference, RoadLines
from core.raster.dem import open_dem
from core.raster.ortho import open_ortho
from core.raster.scan_file import open_scan

CRS = "EPSG:5514"
SCAN_PX, PIXEL_MM, FOCAL_MM = 12_000, 0.015, 210.0
HEIGHT_M, ABOVE_M = 200.0, 4900.0
WEST, NORTH, SIDE_M, ORTHO_M = -600_000.0, -1_150_000.0, 5000.0, 0.5
JUNCTIONS = 300
CAMERA = Camera("c", FOCAL_MM, (180.0, 180.0))


def nodes_of(rng: np.random.Generator) -> np.ndarray:
    """Junctions of a net of roads (n, n, 2), metres from the north-west corner."""
    count = 22
    step = SIDE_M / count
    grid = (np.stack(np.meshgrid(*[np.arange(count)] * 2), axis=-1) + 0.5) * step
    return grid + rng.uniform(-0.35, 0.35, grid.shape) * step


def painted(nodes: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The ground then and now."""
    side = int(SIDE_M / ORTHO_M)
    then = np.full((side, side), 110, np.uint8)
    now = then.copy()
    for _ in range(9000):
        centre, size = rng.uniform(0, side, 2), rng.uniform(40, 400, 2)
        box = cv2.boxPoints(((centre[0], centre[1]), (size[0], size[1]), rng.uniform(0, 180)))
        tone, other = (float(v) for v in rng.uniform(60, 170, 2))
        kept = rng.random() < 0.5
        cv2.fillConvexPoly(then, box.astype(np.int32), tone)
        if kept or rng.random() < 0.6:
            cv2.fillConvexPoly(now, box.astype(np.int32), tone if kept else other)
    for start, end in links(nodes):
        width = int(rng.integers(8, 17))
        ends = [tuple(np.round(p / ORTHO_M * 16).astype(int).tolist()) for p in (start, end)]
        for image in (then, now):
            tone = 205.0 if rng.random() < 0.6 else 60.0
            cv2.line(image, ends[0], ends[1], tone, width, cv2.LINE_AA, 4)
    for image in (then, now):
        noise = rng.normal(0, 12, (side // 4, side // 4)).astype(np.float32)
        grown = cv2.resize(noise, (side, side), interpolation=cv2.INTER_CUBIC)
        image[:] = np.clip(image + grown, 0, 255).astype(np.uint8)
    return then, now


def links(nodes: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The stretches between neighbouring junctions."""
    rows, columns = nodes.shape[:2]
    across = [(nodes[i, j], nodes[i, j + 1]) for i in range(rows) for j in range(columns - 1)]
    down = [(nodes[i, j], nodes[i + 1, j]) for i in range(rows - 1) for j in range(columns)]
    return [*across, *down]


def written(path: Path, image: np.ndarray, pixel_m: float | None) -> Path:
    """A GeoTIFF, or a plain one."""
    place: dict[str, Any] = {}
    if pixel_m:
        transform = rasterio.Affine(pixel_m, 0, WEST, 0, -pixel_m, NORTH)
        place = {"crs": CRS, "transform": transform}
    rows, columns = image.shape
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, tiled=True,
        dtype=image.dtype, **place,
    ) as raster:  # fmt: skip
        raster.write(image, 1)
    return path


def photo_at(exterior: ExteriorOrientation, scan: Path) -> Photo:
    """A vertical photo of the whole scan."""
    none = np.zeros((0, 2))
    half = SCAN_PX * PIXEL_MM / 2
    matrix = np.array([[PIXEL_MM, 0.0, -half], [0.0, -PIXEL_MM, half]])
    interior = InteriorOrientation("affine", matrix, (), none, none, 3.0)
    prior = ExteriorPrior(np.full(3, 10.0), np.full(3, 0.005))
    size = (SCAN_PX, SCAN_PX)
    return Photo("A", str(scan), size, "c", interior, exterior, exterior, prior, HEIGHT_M, True)


def seen(photo: Photo, then: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The scan of a photo of level ground."""
    step = 100
    line = np.arange(SCAN_PX // step) * step + step / 2
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    ground = photo.object_from_pixel(places, np.full(len(places), HEIGHT_M), CAMERA)
    across = ((ground[:, 0] - WEST) / ORTHO_M - 0.5).reshape(len(line), -1).astype(np.float32)
    down = ((NORTH - ground[:, 1]) / ORTHO_M - 0.5).reshape(len(line), -1).astype(np.float32)
    scan = np.empty((SCAN_PX, SCAN_PX), np.uint8)
    maps = [
        cv2.resize(one, (SCAN_PX, SCAN_PX), interpolation=cv2.INTER_LINEAR)
        for one in (across, down)
    ]
    for row in range(0, SCAN_PX, 2000):
        part = cv2.remap(then, *(m[row : row + 2000] for m in maps), cv2.INTER_LINEAR)
        grain = rng.normal(0, 10, part.shape).astype(np.float32)
        scan[row : row + 2000] = np.clip(30 + 0.8 * part + grain, 0, 255).astype(np.uint8)
    return scan


def scene(folder: Path, seed: int) -> tuple[OpenPhoto, Photo, Reference, np.ndarray]:
    """The photo where it is thought to be and where it is, the reference, and its junctions."""
    rng = np.random.default_rng(seed)
    nodes = nodes_of(rng)
    then, now = painted(nodes, rng)
    middle = np.array([WEST + SIDE_M / 2, NORTH - SIDE_M / 2, HEIGHT_M + ABOVE_M])
    thought = ExteriorOrientation(middle, 0.0, 0.0, 0.0)
    step = np.array([6.0, -9.0, 2.0, 0.0005, -0.0005, 0.001])
    path = folder / "scan.tif"
    photo, true = photo_at(thought, path), photo_at(moved(thought, step), path)
    scan = written(path, seen(true, then, rng), None)
    ortho = open_ortho([written(folder / "ortho.tif", now, ORTHO_M)], CRS)
    level = np.full((500, 500), HEIGHT_M, np.float32)
    dem = open_dem([written(folder / "dem.tif", level, SIDE_M / 500)], CRS)
    lines = [np.stack([placed(a), placed(b)]) for a, b in links(nodes)]
    boxes = np.array([[*line[:, :2].min(axis=0), *line[:, :2].max(axis=0)] for line in lines])
    roads = RoadLines(
        np.concatenate(lines), np.arange(len(lines)) * 2, np.full(len(lines), 6.0), boxes
    )
    inner = np.array([placed(p) for p in nodes[2:-2, 2:-2].reshape(-1, 2)])[:JUNCTIONS]
    opened = OpenPhoto(photo, CAMERA, open_scan(scan))
    return opened, true, Reference(ortho, dem, 0.25, 0.5, roads), inner


def placed(node: np.ndarray) -> np.ndarray:
    """A junction in space."""
    return np.array([WEST + node[0], NORTH - node[1], HEIGHT_M])
