"""Megapixels per second of an ortho, beside GDAL's warper: `bench_ortho.py [frame px]`.

A synthetic near-vertical frame of 8 bits over hills of 200 m relief, DEM of 2 m in a GeoTIFF,
ortho at 0.5 m. The peers are gdalwarp, or without it GDAL's warper as rasterio carries it, with
the photo's geometry as rational polynomials, the same DEM, cubic, error threshold 0.125 px; and
Orthority, if the variable ORTHORITY names its program `oty`, whose start is in its seconds.
All write deflate at level 1. Every round runs all of them in turn.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import rasterio
from affine import Affine
from pyproj import Transformer
from rasterio.enums import Resampling
from rasterio.rpc import RPC
from rasterio.warp import reproject

from core.block import ExteriorPrior, Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.mosaic.comparison import ComparisonOptions, compare_orthos
from core.orthos.rectification import OrthoOptions, ortho_grid, rectify_photo
from core.raster.dem import Dem, open_dem
from core.raster.grid import Grid

CRS = "EPSG:32633"
EAST, NORTH = 500_000.0, 5_400_000.0
GSD, PIXEL_MM, ROUNDS = 0.5, 0.015, 3
MOST_DETAIL_PX = 6000
"""Larger scans repeat theirs."""


def main() -> None:
    """Time our rectification and the peers, and compare the orthos."""
    side = int(sys.argv[1]) if len(sys.argv) > 1 else 6000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        camera = Camera("wide", side * PIXEL_MM * 1.17, (side * PIXEL_MM, side * PIXEL_MM))
        dem_path = write_dem(folder, side)
        photos = [write_photo(folder, f"p{k}", side, k) for k in range(3)]
        heights = open_dem([dem_path], CRS)
        dem = heights.cropped(heights.bounds)
        grid = ortho_grid(photos[0], camera, dem, GSD)
        megapixels = grid.columns * grid.rows / 1e6
        say(f"frame {side} px, ortho {grid.columns} x {grid.rows} = {megapixels:.1f} MP at {GSD} m")
        rpc = rational_polynomials(photos[0], camera)
        ways = {
            "gruber, 1 thread": partial(ours, folder, photos[0], camera, dem, grid, 1),
            "gruber, 2 threads": partial(ours, folder, photos[0], camera, dem, grid, 2),
        }
        if shutil.which("gdalwarp"):
            with_rpc(photos[0].scan, folder / "rpc.tif", rpc)
            ways["gdalwarp -et 0.125 -multi"] = partial(gdalwarp, folder, grid)
        else:
            ways["GDAL warper in rasterio, threshold 0.125"] = partial(
                warped, folder, photos[0], rpc, dem_path, grid, 0.125
            )
        if program := os.environ.get("ORTHORITY"):
            ways["orthority"] = partial(orthority, program, folder, photos[0], camera, dem_path)
        found = side_by_side(ways)
        for what, seconds in found.items():
            row(what, seconds, megapixels)
        for what, other in found.items():
            for threads in ("1 thread", "2 threads") if not what.startswith("gruber") else ():
                share = [a / b for a, b in zip(found[f"gruber, {threads}"], other, strict=True)]
                say(f"{threads} over {what}: wall {share[0]:.2f}, CPU {share[1]:.2f}")
        warped(folder, photos[0], rpc, dem_path, grid, 0.0)
        agreement(folder)
        say(f"peak memory of it all: {peak_gib():.2f} GiB")


def ours(folder: Path, photo: Photo, camera: Camera, dem: Dem, grid: Grid, threads: int) -> None:
    """One ortho of ours."""
    options = OrthoOptions(threads=threads, edge_mm=0.0)
    rectify_photo(photo, camera, dem, grid, folder / "ours.tif", CRS, options=options)


def warped(
    folder: Path, photo: Photo, rpc: RPC, dem_path: Path, grid: Grid, threshold: float
) -> None:
    """The same ortho by GDAL's warper in this process."""
    profile = {"width": grid.columns, "height": grid.rows, "count": 1, "dtype": "uint8"}
    profile |= {"compress": "deflate", "zlevel": 1, "predictor": 2, "num_threads": 2, "nodata": 0}
    profile |= {"tiled": True, "blockxsize": 512, "blockysize": 512}
    transform = Affine.from_gdal(*grid.geotransform)
    values = np.zeros((grid.rows, grid.columns), dtype=np.uint8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(photo.scan) as scan:
            pixels = scan.read(1)
        reproject(
            pixels,
            values,
            rpcs=rpc,
            src_crs="EPSG:4326",
            dst_transform=transform,
            dst_crs=CRS,
            resampling=Resampling.cubic,
            num_threads=2,
            tolerance=max(threshold, 1e-9),
            RPC_DEM=str(dem_path),
            RPC_DEM_MISSING_VALUE=0,
        )
    path = folder / f"gdal{threshold}.tif"
    with rasterio.open(path, "w", driver="GTiff", crs=CRS, transform=transform, **profile) as out:
        out.write(values, 1)


def gdalwarp(folder: Path, grid: Grid) -> None:
    """The same by the program, from a scan that holds its polynomials."""
    west, south, east, north = grid.bounds
    subprocess.run(
        f"gdalwarp -q -overwrite -rpc -to RPC_DEM={folder}/dem.tif -et 0.125 -multi -r cubic "
        f"-wo NUM_THREADS=2 -t_srs {CRS} -tr {GSD} {GSD} -te {west} {south} {east} {north} "
        f"-co TILED=YES -co COMPRESS=DEFLATE -co ZLEVEL=1 -co PREDICTOR=2 "
        f"{folder}/rpc.tif {folder}/program.tif",
        shell=True,
        check=True,
    )


def with_rpc(scan: Path, path: Path, rpc: RPC) -> None:
    """A copy of a scan that holds its polynomials."""
    shutil.copy(scan, path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path, "r+") as file:
            file.rpcs = rpc


def orthority(program: str, folder: Path, photo: Photo, camera: Camera, dem: Path) -> None:
    """The same by the program `oty`, with the frame's own geometry."""
    exterior, size = photo.exterior, list(photo.size_px)
    inner, outer = folder / "orthority.yaml", folder / "orthority.csv"
    inner.write_text(
        f"made: {{type: pinhole, im_size: {size}, focal_len: {camera.principal_distance_mm}, "
        f"sensor_size: {list(camera.frame_mm)}}}\n",
        encoding="utf-8",
    )
    place = *exterior.centre.tolist(), exterior.omega, exterior.phi, exterior.kappa
    row = ",".join([photo.scan.name, *(f"{one!r}" for one in place), "made"])
    outer.write_text(f"filename,x,y,z,omega,phi,kappa,camera\n{row}\n", encoding="utf-8")
    subprocess.run(
        f"{program} frame --dem {dem} --int-param {inner} --ext-param {outer} --crs {CRS} "
        f"--radians --res {GSD} --aligned-pixels --interp cubic --dem-interp bilinear "
        f"--no-write-mask --no-build-ovw -co TILED=YES -co COMPRESS=DEFLATE -co ZLEVEL=1 "
        f"-co PREDICTOR=2 --overwrite --out-dir {folder} {photo.scan}",
        shell=True,
        check=True,
        capture_output=True,
    )
    (folder / f"{photo.scan.stem}_ORTHO.tif").replace(folder / "orthority.tif")


def agreement(folder: Path) -> None:
    """How far the two orthos lie apart."""
    options = ComparisonOptions(places=300, search_px=8)
    for what, name in (("exact GDAL", "gdal0.0.tif"), ("Orthority", "orthority.tif")):
        if (folder / name).is_file():
            found = compare_orthos(folder / "ours.tif", folder / name, options)
            shift, m_p = np.hypot(*found.mean_shift) / GSD, found.m_p / GSD
            say(f"against {what}: mean shift {shift:.4f} px, m_p {m_p:.4f} px, n {found.n}")


def write_dem(folder: Path, side: int) -> Path:
    """Hills of 200 m relief and small bumps, posts of 2 m."""
    reach = side * 0.35 + 400
    grid = Grid.over((EAST - reach, NORTH - reach, EAST + reach, NORTH + reach), 2.0)
    east, north = np.meshgrid(*grid.centres())
    heights = 300 + 100 * np.sin((east - EAST) / 400) * np.cos((north - NORTH) / 300)
    heights += 3 * np.sin(east / 31) * np.sin(north / 27)
    profile = {"width": grid.columns, "height": grid.rows, "count": 1, "dtype": "float32"}
    transform = Affine.from_gdal(*grid.geotransform)
    path = folder / "dem.tif"
    with rasterio.open(path, "w", driver="GTiff", crs=CRS, transform=transform, **profile) as out:
        out.write(heights.astype(np.float32), 1)
    return path


def write_photo(folder: Path, name: str, side: int, number: int) -> Photo:
    """A frame of smooth random detail; ground pixels of about 0.5 m."""
    rng = np.random.default_rng(number)
    part = min(side, MOST_DETAIL_PX)
    pixels = np.zeros((part, part), dtype=np.float32)
    for size, strength in ((3, 30), (9, 25), (40, 30)):
        small = rng.uniform(-1, 1, (part // size + 2, part // size + 2)).astype(np.float32)
        grown = np.kron(small, np.ones((size, size), dtype=np.float32))
        pixels += strength * grown[:part, :part]
    pixels += rng.normal(0, 4, pixels.shape).astype(np.float32)
    path = folder / f"{name}.tif"
    profile = {"width": side, "height": side, "count": 1, "dtype": "uint8", "tiled": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path, "w", driver="GTiff", compress="deflate", **profile) as out:
            detail = np.clip(128 + pixels, 1, 255).astype(np.uint8)
            times = -(-side // part)
            out.write(np.tile(detail, (times, times))[:side, :side], 1)
    half = side * PIXEL_MM / 2
    matrix = np.array([[PIXEL_MM, 0, -half], [0, -PIXEL_MM, half]])
    none = np.zeros((0, 2))
    interior = InteriorOrientation("affine", matrix, (), none, none, float("nan"))
    height = 300 + side * PIXEL_MM * 1.17 / PIXEL_MM * GSD
    centre = np.array([EAST + (number - 1) * 0.2 * side * GSD * (number > 0), NORTH, height])
    exterior = ExteriorOrientation(centre, 0.01, -0.02, 0.1 * number + 0.05)
    prior = ExteriorPrior(np.full(3, 10.0), np.full(3, 0.01))
    return Photo(name, path, (side, side), "wide", interior, exterior, exterior, prior, 300.0, True)


def rational_polynomials(photo: Photo, camera: Camera) -> RPC:
    """The photo's geometry in the form GDAL knows, fitted to points over its whole range."""
    reach = 0.8 * photo.size_px[0] * GSD
    axis = np.linspace(-reach, reach, 15)
    grid = np.stack(np.meshgrid(axis, axis, np.linspace(150, 450, 7)), axis=-1).reshape(-1, 3)
    points = grid + np.array([photo.exterior.centre[0], photo.exterior.centre[1], 0.0])
    pixels = photo.pixel_from_object(points, camera) - 0.5
    longitude, latitude = Transformer.from_crs(CRS, 4326, always_xy=True).transform(
        points[:, 0], points[:, 1]
    )
    ground = np.column_stack([longitude, latitude, points[:, 2]])
    middle, half = ground.mean(axis=0), np.ptp(ground, axis=0) / 2
    offset, scale = pixels.mean(axis=0), np.ptp(pixels, axis=0) / 2
    terms = cubic_terms((ground - middle) / half)
    parts = [fraction(terms, wanted) for wanted in ((pixels - offset) / scale).T]
    return RPC(
        height_off=middle[2],
        height_scale=half[2],
        lat_off=middle[1],
        lat_scale=half[1],
        long_off=middle[0],
        long_scale=half[0],
        line_off=offset[1],
        line_scale=scale[1],
        samp_off=offset[0],
        samp_scale=scale[0],
        line_num_coeff=parts[1][0],
        line_den_coeff=parts[1][1],
        samp_num_coeff=parts[0][0],
        samp_den_coeff=parts[0][1],
        err_bias=None,
        err_rand=None,
    )


def cubic_terms(ground: np.ndarray) -> np.ndarray:
    """The twenty terms in the order of the RPC00B standard."""
    x, y, h = ground.T
    one = np.ones_like(x)
    terms = [one, x, y, h, x * y, x * h, y * h, x * x, y * y, h * h, x * y * h, x**3]
    terms += [x * y * y, x * h * h, x * x * y, y**3, y * h * h, x * x * h, y * y * h, h**3]
    return np.column_stack(terms)


def fraction(terms: np.ndarray, wanted: np.ndarray) -> tuple[list[float], list[float]]:
    """Numerator and denominator of one coordinate, by linear least squares."""
    design = np.hstack([terms, -wanted[:, None] * terms[:, 1:]])
    solution = np.linalg.lstsq(design, wanted, rcond=1e-12)[0]
    return solution[:20].tolist(), [1.0, *solution[20:].tolist()]


def side_by_side(ways: dict[str, Callable[[], object]]) -> dict[str, tuple[float, float]]:
    """Best wall and best processor seconds of each way; every round takes all in turn."""
    found: dict[str, list[tuple[float, float]]] = {what: [] for what in ways}
    for _ in range(ROUNDS):
        for what, work in ways.items():
            wall, processor = perf_counter(), processor_seconds()
            work()
            found[what].append((perf_counter() - wall, processor_seconds() - processor))
    return {
        what: (min(wall for wall, _ in rounds), min(spent for _, spent in rounds))
        for what, rounds in found.items()
    }


def peak_gib() -> float:
    """Most memory of this program since it began, GiB.

    `getrusage` also counts what the process held that started it.
    """
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) / 2**20


def processor_seconds() -> float:
    """Processor seconds of this process and of programs it waited for."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(used.ru_utime + used.ru_stime for used in both)


def row(what: str, seconds: tuple[float, float], megapixels: float) -> None:
    """One line of the table."""
    wall, processor = seconds
    say(f"{what:46s} {wall:7.2f} s {megapixels / wall:7.1f} MP/s {processor:8.2f} CPU s")


def say(text: str) -> None:
    """Print a line."""
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
