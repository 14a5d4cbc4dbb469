"""World files (.tfw, .jgw, .j2w, .tifw, .wld): six lines A, D, B, E, C, F.

X = A column + B row + C and Y = D column + E row + F with C, F at the CENTRE of the first pixel;
inside the project a pixel is counted from its outer corner, so half a pixel is added here.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from core.arrays import Affine2, locked
from core.errors import ScanError
from core.formats.records import plain_bytes, status_of
from core.frames import HALF_PIXEL
from core.geometry.crs import FARTHEST_M
from core.geometry.transforms import PlaneTransform, fit_affine

NO_AREA = 1e-18  # design: a pixel of a nanometre, which is rounding and no pixel.
"""Square metres (or degrees) below which a pixel has no area."""


@dataclass(frozen=True, slots=True, eq=False)
class WorldFile:
    """Where a scan or raster lies on the ground, as a plane affine transform."""

    path: Path
    """The file it was read from."""
    object_from_pixel: Affine2
    """Easting, northing from (column, row), outer corner of the first pixel (0, 0)."""
    crs: str = ""
    """Their CRS as WKT, which a GeoTIFF may name; empty where it is that of the block."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "object_from_pixel", locked(self.object_from_pixel))

    @property
    def mirrored(self) -> bool:
        """True when the raster is seen from behind: a film scanned emulsion side wrong."""
        return bool(np.linalg.det(self.object_from_pixel[:, :2]) > 0)

    @property
    def ground_sample_distance_m(self) -> float:
        """Mean size of a pixel on the ground, metres."""
        return float(np.sqrt(abs(np.linalg.det(self.object_from_pixel[:, :2]))))


def find_world_file(raster: Path) -> Path | None:
    """The world file beside a raster, whatever its extension's case; None when there is none."""
    wanted = {ending.lower() for ending in _endings(raster.suffix)}
    if not raster.parent.is_dir():
        return None
    beside = sorted(
        other
        for other in raster.parent.iterdir()
        if other.suffix.lower() in wanted and other.stem.lower() == raster.stem.lower()
    )
    whole_name = [
        raster.with_name(raster.name + ending) for ending in (".wld", ".tfw") if raster.suffix
    ]
    return next(iter([*beside, *(path for path in whole_name if path.is_file())]), None)


def read_world_file(path: Path) -> WorldFile:
    """Read the six numbers.

    Raises:
        ScanError: Missing, not six numbers, or numbers that are no transform.
    """
    try:
        words = plain_bytes(path).decode("latin-1").split()
    except OSError as error:
        raise ScanError(
            path,
            "The world file cannot be read ({strerror}).",
            "Put it beside its scan, or choose another georeference in [scans].",
            strerror=error.strerror,
        ) from error
    try:
        a, d, b, e, c, f = (float(word.replace(",", ".")) for word in words)
    except ValueError as error:
        raise ScanError(
            path,
            "A world file holds six numbers, this one holds {count} words: {words}.",
            "Write A, D, B, E, C, F on a line each, or take the file away.",
            count=len(words),
            words=words[:6],
        ) from error
    linear = np.array([[a, b], [d, e]])
    here = all(abs(value) < FARTHEST_M for value in (a, b, c, d, e, f))
    if not here or abs(np.linalg.det(linear)) < NO_AREA:
        raise ScanError(
            path,
            "Its pixel has no area: the lines A, D, B, E are no transform.",
            "Write A, D, B, E, C, F in this order, or take the file away.",
        )
    corner = np.array([c, f]) - linear @ np.array([HALF_PIXEL, HALF_PIXEL])
    return WorldFile(path, np.column_stack([linear, corner]))


def write_world_file(path: Path, object_from_pixel: Affine2) -> None:
    """Write A, D, B, E, C, F; the origin becomes the centre of the first pixel."""
    (a, b, _), (d, e, _) = object_from_pixel
    c, f = object_from_pixel @ np.array([HALF_PIXEL, HALF_PIXEL, 1.0])
    lines = [f"{value:.12g}" for value in (a, d, b, e)] + [f"{c:.6f}", f"{f:.6f}"]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def world_file_suffix(raster: Path) -> str:
    """What a raster's world file ends with: .tif -> .tfw."""
    return _endings(raster.suffix)[0]


def read_georeference(raster: Path) -> WorldFile | None:
    """World file beside a raster, else what a GeoTIFF has inside; None without one.

    Inside is a transform, or three or more points with coordinates, which an affine is fitted to.
    """
    beside = find_world_file(raster)
    if beside is not None:
        return read_world_file(beside)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            status_of(raster)
            with rasterio.open(raster) as dataset:
                transform, crs = dataset.transform, dataset.crs
                points, crs_of_points = dataset.gcps
        except (RasterioError, OSError) as error:
            raise ScanError(
                raster, "It is not an image that can be read.", "Copy the scan again."
            ) from error
    if not transform.is_identity:
        matrix = np.array(
            [[transform.a, transform.b, transform.c], [transform.d, transform.e, transform.f]]
        )
        return WorldFile(raster, matrix, _on_earth(crs))
    pixels = np.array([[point.col, point.row] for point in points]).reshape(-1, 2)
    places = np.array([[point.x, point.y] for point in points]).reshape(-1, 2)
    fit = fit_affine(pixels, places)
    if not isinstance(fit, PlaneTransform):
        return None
    return WorldFile(raster, fit.matrix, _on_earth(crs_of_points))


def _on_earth(crs: Any) -> str:
    """WKT of a CRS of rasterio; empty for none, and for one that says nothing of the Earth."""
    if crs is None or not (crs.is_projected or crs.is_geographic):
        return ""
    return crs.to_wkt(version="WKT2_2019")


def _endings(extension: str) -> list[str]:
    """World file extensions for a raster's extension: .tif -> .tfw, .tifw, .tiffw, .wld."""
    plain = extension.lstrip(".").lower()
    shortened = plain[0] + plain[-1] + "w" if plain else "w"
    extra = {"tif": ["tiffw"], "tiff": ["tfw", "tifw"], "jpeg": ["jgw", "jpgw"], "jp2": ["j2w"]}
    return ["." + ending for ending in [shortened, plain + "w", *extra.get(plain, []), "wld"]]
