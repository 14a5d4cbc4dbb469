"""Fiducials and a comparison with the reference for the benchmark's desk: every view has work."""

import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning
from rasterio.transform import from_origin

from app.desk.comparing import Comparing
from app.desk.inputs import DeskInputs
from core.block import Photo
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation, fit_interior
from core.localisation.photo_orientation import OrientationOptions
from core.matching.reference import Reference
from core.progress import Silent
from core.raster.dem import open_dem
from core.raster.grid import Grid
from core.raster.ortho import open_ortho
from core.raster.scan_file import ScanFiles, open_scan
from core.scans.film_area import area_from_interior
from core.scans.interior_orientation import ScanOrientation
from core.scans.judging import FiducialMeasurement
from tests.benchmarks.large_desk import write_scan
from tests.ui.desk_landscape import ArrayDem, ArrayOrtho
from ui.review.state import InitialState

EDGE_MM, ARM_PX, NOISE_PX = 84.0, 5, 0.1
MARKS = {
    f"{1 + n}": (EDGE_MM * x, EDGE_MM * y)
    for n, (x, y) in enumerate(
        [(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0)]
    )
}


def with_film(inputs: DeskInputs, folder: Path) -> DeskInputs:
    """The desk with marks on its scans, measured as an engine would, and patches to compare."""
    rng, block = np.random.default_rng(3), inputs.block
    cameras = {name: replace(one, fiducials_mm=MARKS) for name, one in block.cameras.items()}
    films = {name: _film(rng, photo, cameras[photo.camera]) for name, photo in block.photos.items()}
    photos = {
        name: replace(photo, interior=films[name].interior) for name, photo in block.photos.items()
    }
    marked = replace(block, cameras=cameras, photos=photos)
    pixels_mm = {name: film.interior.pixel_size_mm for name, film in films.items()}
    comparing = Comparing(
        _reference(inputs, folder), OrientationOptions(), ScanFiles(folder).opened
    )
    return replace(
        inputs, block=marked, report=inputs.adjust(marked, Silent()), likeness=comparing,
        initial=InitialState(films, pixels_mm),
    )  # fmt: skip


def _film(rng: np.random.Generator, photo: Photo, camera: Camera) -> ScanOrientation:
    """A scan with its marks drawn into it and found again, one of them somewhat off."""
    places = photo.interior.pixel_from_film(np.array(list(MARKS.values())))
    _draw(photo.scan, places)
    measured = places + rng.normal(0, NOISE_PX, places.shape)
    measured[rng.integers(len(measured))] += rng.normal(0, 4 * NOISE_PX, 2)
    found = tuple(
        FiducialMeasurement(name, *place, NOISE_PX, 0.9, 0.1, "cross")
        for name, place in zip(MARKS, measured.tolist(), strict=True)
    )
    certified = np.array(list(camera.fiducials_mm.values()))
    interior = fit_interior(list(MARKS), measured, certified)
    assert isinstance(interior, InteriorOrientation), "the marks fit"
    area = area_from_interior(interior, camera)
    return ScanOrientation(photo.photo_id, open_scan(photo.scan), interior, found, area, ())


def _draw(path: Path, places: np.ndarray) -> None:
    """White crosses on black, sub-pixel."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path) as file:
            values = file.read(1)
    for column, row in places:
        middle = np.array([column, row]) - 0.5
        low = np.round(middle - 2 * ARM_PX).astype(int)
        side = 4 * ARM_PX + 1
        values[low[1] : low[1] + side, low[0] : low[0] + side] = 20
        for across in (np.array([ARM_PX, 0]), np.array([0, ARM_PX])):
            ends = [
                np.round(256 * end).astype(int).tolist()
                for end in (middle - across, middle + across)
            ]
            cv2.line(values, ends[0], ends[1], 235, 2, cv2.LINE_AA, 8)
    write_scan(path, values)


def _reference(inputs: DeskInputs, folder: Path) -> Reference:
    """Ortho and DEM as files, for what compares reads them piece by piece."""
    ortho, dem = inputs.ortho, inputs.dem
    assert isinstance(ortho, ArrayOrtho)
    assert isinstance(dem, ArrayDem)
    crs = inputs.block.crs
    _write(folder / "ortho.tif", ortho.grid, np.moveaxis(ortho.values, -1, 0), crs)
    _write(folder / "dem.tif", dem.grid, dem.values[None].astype(np.float32), crs)
    opened = open_ortho([folder / "ortho.tif"], crs), open_dem(folder / "dem.tif", crs)
    return Reference(*opened, 0.25, 0.5)


def _write(path: Path, grid: Grid, bands: np.ndarray, crs: str) -> None:
    gsd = grid.ground_sample_distance_m
    profile = {
        "driver": "GTiff", "dtype": bands.dtype.name, "count": len(bands), "width": grid.columns,
        "height": grid.rows, "crs": crs, "transform": from_origin(grid.west, grid.north, gsd, gsd),
    }  # fmt: skip
    with rasterio.open(path, "w", **profile, tiled=True, blockxsize=256, blockysize=256) as file:
        file.write(bands)
