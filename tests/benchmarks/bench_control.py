"""Speed of the control search in one large scan, and of robust resection, beside peers.

A level landscape is painted twice, as it was and as it is: parcels are drawn anew, roads change
their tone. 300 junctions are searched in a scan of 12 000 pixels by every correlating operator, in
windows of 160 m at 1 m, all in one pass. Beside it the phase correlation of AROSICS: the package
itself where it is installed, else the transform at its core (`cv2.phaseCorrelate`).

Resection: 8 and 11 right of 90 candidates, one a point, the others anywhere within 29 m; PoseLib's
LO-RANSAC beside it where it is installed. Ends with 1 when a promise is broken.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio

from core.block.block import ExteriorPrior, Photo
from core.block.registration.matching import MatchingOptions, looked_at, parts_about, predict_pixels
from core.block.registration.orientation import OrientationOptions
from core.block.registration.patches import OpenPhoto
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.consensus import Candidates, ConsensusOptions
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.geometry.resection import PhotoModel, moved, resect_photo
from core.reference.dem import open_dem
from core.reference.ortho import open_ortho
from core.reference.reference import Reference
from core.reference.road_lines import RoadLines
from core.scan.raster import open_scan

CRS = "EPSG:5514"
SCAN_PX, PIXEL_MM, FOCAL_MM = 12_000, 0.015, 210.0
HEIGHT_M, ABOVE_M = 200.0, 4900.0
WEST, NORTH, SIDE_M, ORTHO_M = -600_000.0, -1_150_000.0, 5000.0, 0.5
WINDOW_M, TEMPLATE_M, JUNCTIONS = 160.0, 51.0, 300
QUICK = ("ncc", "ncc-high-pass", "gradient", "cfog", "roads", "fused")
"""Every operator that correlates. Descriptors at every place take seconds a junction."""
NEAR_M = 3.0
SIGMA_M, WINDOW_HALF_M = 0.7, 29.0
CAMERA = Camera("c", FOCAL_MM, (180.0, 180.0))


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


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
    maps = [cv2.resize(one, (SCAN_PX, SCAN_PX), interpolation=cv2.INTER_LINEAR)
            for one in (across, down)]  # fmt: skip
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


def searched(
    opened: OpenPhoto, true: Photo, reference: Reference, points: np.ndarray, names: tuple[str, ...]
) -> tuple[dict[str, int], int, float]:
    """Hits by operator, junctions searched, and seconds of the whole stage."""
    reduction = max(1, round(1.0 / opened.ground_pixel_m))
    pixel_m = opened.ground_pixel_m * reduction
    inner = round((TEMPLATE_M / pixel_m - 1) / 2)
    half = round((WINDOW_M - TEMPLATE_M) / 2 / pixel_m)
    matching = MatchingOptions(
        reduction, inner, min_search_px=half, max_search_px=half, operators=names
    )
    exact = true.pixel_from_object(points, CAMERA)
    found = dict.fromkeys(names, 0)
    count = 0
    started = time.perf_counter()
    prediction = predict_pixels(opened, np.zeros((6, 6)), points, np.full(points.shape, 0.3))
    halves = np.full(len(points), half)
    for images, point in looked_at(opened, reference, prediction, halves, matching):
        pixel = prediction.pixels[point]
        parts = parts_about(images, pixel, half, inner)
        assert parts is not None
        count += 1
        for name in names:
            surface = images.surface(name, *parts)
            row, column = np.unravel_index(int(np.argmax(surface)), surface.shape)
            best = pixel + (np.array([column, row]) - half) * reduction
            found[name] += float(np.hypot(*(best - exact[point]))) * opened.ground_pixel_m <= NEAR_M
    return found, count, time.perf_counter() - started


def phase_correlated(
    opened: OpenPhoto, true: Photo, reference: Reference, points: np.ndarray
) -> tuple[int, int, float]:
    """The same with the phase correlation of windows of 256 pixels, the default of AROSICS."""
    reduction = max(1, round(1.0 / opened.ground_pixel_m))
    matching = MatchingOptions(reduction, 128, operators=("ncc",))
    prediction = predict_pixels(opened, np.zeros((6, 6)), points, np.full(points.shape, 0.3))
    exact = true.pixel_from_object(points, CAMERA)
    hits = count = 0
    seconds = 0.0
    measure = shift_of_arosics() if find_spec("arosics") else shift_of_transform
    for images, point in looked_at(
        opened, reference, prediction, np.full(len(points), 1), matching
    ):
        pixel = prediction.pixels[point]
        column, row = (int(v) for v in images.pair.window.window_from_pixel(pixel[None])[0])
        own = np.s_[max(row - 128, 0) : row + 128, max(column - 128, 0) : column + 128]
        started = time.process_time()
        shift = measure(images.pair.reference[own], images.pair.scan[own])
        seconds += time.process_time() - started
        off = pixel + np.array(shift) * reduction - exact[point]
        hits += float(np.hypot(*off)) * opened.ground_pixel_m <= NEAR_M
        count += 1
    return hits, count, seconds


def shift_of_transform(reference: np.ndarray, scan: np.ndarray) -> tuple[float, float]:
    """Columns and rows from a reference window to a scan window."""
    window = cv2.createHanningWindow((reference.shape[1], reference.shape[0]), cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(
        np.ascontiguousarray(reference), np.ascontiguousarray(scan), window
    )
    return float(shift[0]), float(shift[1])


def shift_of_arosics() -> Callable[[np.ndarray, np.ndarray], tuple[float, float]]:
    """The same by AROSICS."""
    coreg: Any = import_module("arosics").COREG
    array: Any = import_module("geoarray").GeoArray

    def measure(reference: np.ndarray, scan: np.ndarray) -> tuple[float, float]:
        place, crs = (0, 1, 0, 0, 0, -1), "EPSG:32633"
        made = coreg(
            array(reference, place, crs), array(scan, place, crs), ws=(256, 256), max_shift=60,
            q=True, ignore_errors=True, calc_corners=False, align_grids=False,
            nodata=(-1, -1),
        )  # fmt: skip
        made.calculate_spatial_shifts()
        if not made.success:
            return 1e6, 1e6
        return -float(made.x_shift_px), -float(made.y_shift_px)

    return measure


def guessed(right: int, rng: np.random.Generator) -> tuple[Photo, Photo, np.ndarray, Candidates]:
    """A photo, where it truly is, ninety points, and their candidates, few of them right."""
    middle = np.array([WEST, NORTH, HEIGHT_M + ABOVE_M])
    photo = photo_at(ExteriorOrientation(middle, 0.0, 0.0, 0.0), Path("none"))
    sigma = np.array([8.0, 8.0, 8.0, 0.003, 0.003, 0.002])
    true = photo.with_exterior(moved(photo.exterior, rng.normal(0, 0.6, 6) * sigma), True)
    places = rng.uniform(-0.46, 0.46, (90, 2)) * SCAN_PX + SCAN_PX / 2
    heights = HEIGHT_M + rng.uniform(-60, 60, 90)
    points = true.object_from_pixel(places, heights, CAMERA)
    pixel_m = PIXEL_MM / FOCAL_MM * ABOVE_M
    predicted = photo.pixel_from_object(points, CAMERA)
    pixels = predicted + rng.uniform(-1, 1, (90, 2)) * WINDOW_HALF_M / pixel_m
    own = rng.permutation(90)[:right]
    pixels[own] = places[own] + rng.normal(0, SIGMA_M / pixel_m, (right, 2))
    every, area = np.ones(90), (2 * WINDOW_HALF_M / pixel_m) ** 2
    known = Candidates(
        np.arange(90), pixels, np.full(90, SIGMA_M / pixel_m), every, every, every / area
    )
    return photo, true, points, known


def frame_error_m(one: Photo, other: Photo) -> float:
    """Root mean square distance on level ground over the frame."""
    line = np.linspace(0.05, 0.95, 7) * SCAN_PX
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    level = np.full(len(places), HEIGHT_M)
    off = one.object_from_pixel(places, level, CAMERA) - other.object_from_pixel(
        places, level, CAMERA
    )
    return float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))))


def resected(
    photo: Photo, points: np.ndarray, known: Candidates, seed: int, options: ConsensusOptions
) -> Photo | None:
    """Our resection; None where it is refused."""
    sigma = np.array([8.0, 8.0, 8.0, 0.003, 0.003, 0.002])
    model = PhotoModel(photo.interior, CAMERA, photo.atmosphere)
    rng = np.random.default_rng(seed)
    found = resect_photo(model, photo.exterior, np.diag(sigma**2), points, known, options, rng)
    return None if isinstance(found, Failure) else photo.with_exterior(found.exterior, True)


def ours(photo: Photo, points: np.ndarray, known: Candidates, seed: int) -> Photo | None:
    """What our resection finds, whether it would be accepted or not, as PoseLib does."""
    return resected(photo, points, known, seed, ConsensusOptions(log10_nfa_limit=np.inf))


def accepted(photo: Photo, points: np.ndarray, known: Candidates, seed: int) -> Photo | None:
    """What it also accepts, as the program does: agreement that chance could bring is refused."""
    return resected(photo, points, known, seed, OrientationOptions().resection)


def theirs(photo: Photo, points: np.ndarray, known: Candidates, seed: int) -> Photo | None:
    """PoseLib's LO-RANSAC with its local optimisation and a threshold of three deviations."""
    library: Any = import_module("poselib")
    focal = FOCAL_MM / PIXEL_MM
    camera = {"model": "PINHOLE", "width": SCAN_PX, "height": SCAN_PX,
              "params": [focal, focal, SCAN_PX / 2, SCAN_PX / 2]}  # fmt: skip
    options = {
        "max_reproj_error": 3 * float(known.sigma_px[0]),
        "seed": seed,
        "max_iterations": 100_000,
        "min_iterations": 1000,
        "success_prob": 0.9999,
    }
    local = points - photo.exterior.centre
    pose, _ = library.estimate_absolute_pose(known.pixels, local, camera, options, {})
    # PoseLib's camera looks along +z with y down: omega, phi, kappa from image = R object.
    turned = np.diag([1.0, -1.0, -1.0]) @ np.asarray(pose.R)
    centre = -np.asarray(pose.R).T @ np.asarray(pose.t)
    object_from_image = turned.T
    phi = float(np.arcsin(np.clip(object_from_image[0, 2], -1, 1)))
    omega = float(np.arctan2(-object_from_image[1, 2], object_from_image[2, 2]))
    kappa = float(np.arctan2(-object_from_image[0, 1], object_from_image[0, 0]))
    return photo.with_exterior(
        ExteriorOrientation(centre + photo.exterior.centre, omega, phi, kappa), True
    )


def resections(cases: int, first_seed: int) -> dict[tuple[str, int], tuple[float, float]]:
    """Share that succeeds, and milliseconds each, by estimator and number of right candidates."""
    ways: dict[str, Callable[..., Photo | None]] = {"gruber": ours, "accepted": accepted}
    if find_spec("poselib"):
        ways["PoseLib"] = theirs
    table: dict[tuple[str, int], tuple[float, float]] = {}
    for right in (8, 11, 15, 20):
        for name, way in ways.items():
            good, seconds = 0, []
            for case in range(cases):
                photo, true, points, known = guessed(
                    right, np.random.default_rng([first_seed, right, case])
                )
                started = time.process_time()
                found = way(photo, points, known, case)
                seconds.append(time.process_time() - started)
                good += found is not None and frame_error_m(found, true) < NEAR_M
            table[name, right] = good / cases, 1000 * float(np.median(seconds))
            say(f"  {name:8s} {right:2d} right of 90: {good / cases:6.1%} within {NEAR_M:.0f} m, "
                f"{table[name, right][1]:6.1f} ms")  # fmt: skip
    return table


def main() -> int:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--cases", type=int, default=200)
    given = parser.parse_args()
    broken: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        opened, true, reference, points = scene(Path(folder), given.seed)
        began = time.process_time()
        found, count, seconds = searched(opened, true, reference, points, QUICK)
        spent = time.process_time() - began
        say(f"{count} junctions, {len(QUICK)} operators: {seconds:.1f} s, {spent:.1f} s of CPU")
        for name, hits in found.items():
            say(f"  {name:14s} {hits / count:6.1%} within {NEAR_M:.0f} m")
        began = time.process_time()
        fused, count, _ = searched(opened, true, reference, points, ("fused",))
        single = time.process_time() - began
        hits, number, peer = phase_correlated(opened, true, reference, points)
        name = "AROSICS" if find_spec("arosics") else "phase correlation alone"
        say(f"fused, the whole stage: {count / single:.0f} points per second of CPU, "
            f"{fused['fused'] / count:.1%} right")  # fmt: skip
        say(f"{name}, without reading and warping: {number / peer:.0f} points per second of CPU, "
            f"{hits / number:.1%} right")  # fmt: skip
    if spent > 40.0:
        broken.append(f"{spent:.1f} s of CPU for the whole stage: more than 20 s on two cores")
    table = resections(given.cases, given.seed)
    for right, least in ((8, 0.95), (11, 0.99)):
        share, each = table["accepted", right]
        if share < least or each > 50:
            broken.append(f"resection at {right} of 90: {share:.1%}, {each:.0f} ms")
    for line in broken:
        say(f"BROKEN {line}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
