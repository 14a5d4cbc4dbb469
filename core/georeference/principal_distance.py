"""Propose a principal distance that no certificate states; the photos decide later.

Proposals come from the type of the camera, else from the usual lenses; flying height and photo
scale, where the archive gives both, determine it for this very camera.

`camera_types.csv` beside this file is written by `tests/camera_types.py`.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from core.doubts import Failure
from core.errors import PhotogrammetryError
from core.geometry.camera import Camera
from core.georeference.approximation import LISTED
from core.georeference.archive import Archive, georeference_photo, mean_height_under
from core.raster.dem import Dem
from core.scans.interior_orientation import ScanOrientation

FILE = Path(__file__).with_name("camera_types.csv")
HEAD = (
    "make", "model", "lens", "first_year", "last_year", "certificates",
    "distance_mm", "distance_spread_mm", "marks_apart_mm", "marks_spread_mm",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class CameraType:
    """One kind of lens of a camera type."""

    make: str
    """Who made it; `any` for all cameras together."""
    model: str
    """Name of the type."""
    certificates: int
    """How many certificates there are of it."""
    distance_mm: float
    """Median of their principal distances, millimetres."""
    spread_mm: float
    """Standard deviation of one camera's about it, millimetres."""
    marks_apart_mm: float
    """Median distance of opposite marks, millimetres; NaN where nobody measured it."""


ANY = "any"
"""Make of what the table tells of all cameras together."""
# measured: tests/camera_types.py; the median spread of all types. Certificates of a type may be of
# a few cameras only, and then differ by less than cameras do.
LEAST_SPREAD_MM = 0.5
"""No type tells a principal distance better than this, millimetres."""
# design: the usual distances lie 1.4 times apart; so every distance between is within two of it.
USUAL_SHARE = 0.15
"""Standard deviation of a distance that is only usual, as a share of it."""
# source: the certificates of the table are of frames of 230 mm.
TABLE_FRAME_MM = 230.0
# design: lenses for frames down to 18 cm are the same; smaller frames have lenses of their own.
LIKE_TABLE_MM = 170.0
"""Larger frames have the usual distances; those of smaller ones are in proportion."""
# design: what a pilot's altimeter and the weather leave open.
ALTIMETER_M = 50.0
"""Standard deviation of a flying height that was written down, metres."""


def types_named(make: str, model: str) -> tuple[CameraType, ...]:
    """Lenses of the type that a make and a model name; none where the table does not know it."""
    wanted = _plain(f"{make} {model}")
    return tuple(
        kind
        for kind in camera_types()
        if kind.make != ANY and wanted in (_plain(f"{kind.make} {kind.model}"), _plain(kind.model))
    )


def _plain(text: str) -> str:
    """Letters and digits alone: `RMK A 15/23` as `rmka1523`."""
    return "".join(sign for sign in text.lower() if sign.isalnum())


def proposed_distances(
    make: str, model: str, frame_mm: tuple[float, float]
) -> tuple[tuple[float, float], ...]:
    """Principal distances a camera may have, with standard deviations, likeliest first, mm.

    Args:
        make: Who made it; empty when nobody said.
        model: Its type; empty when nobody said.
        frame_mm: Width and height of its picture, millimetres.
    """
    named = types_named(make, model)
    if named:
        return tuple((kind.distance_mm, max(kind.spread_mm, LEAST_SPREAD_MM)) for kind in named)
    longer = max(frame_mm)
    size = 1.0 if longer >= LIKE_TABLE_MM else longer / TABLE_FRAME_MM
    usual = [
        size * kind.distance_mm
        for kind in camera_types()
        if kind.make == ANY and kind.marks_apart_mm > LIKE_TABLE_MM
    ]
    return tuple((round(value, 2), round(USUAL_SHARE * value, 2)) for value in usual)


def by_flying_heights(
    cameras: Mapping[str, Camera],
    scan_cameras: Mapping[str, str],
    scans: Mapping[str, ScanOrientation],
    archive: Archive,
    dem: Dem,
) -> dict[str, Camera]:
    """The cameras, an unknown principal distance by flying height and scale where both are known.

    Args:
        cameras: Cameras by name.
        scan_cameras: Name of the camera by photo.
        scans: Scans of the block.
        archive: What says where they lie, and from which height they were taken.
        dem: Terrain.
    """
    told: dict[str, list[tuple[float, float]]] = {}
    for name, scan in scans.items():
        camera = cameras[scan_cameras[name]]
        found = _by_height(scan, camera, archive, dem) if camera.distances_mm else None
        if found is not None:
            told.setdefault(camera.name, []).append(found)
    return {
        name: camera if name not in told else _at_heights(camera, np.array(told[name]))
        for name, camera in cameras.items()
    }


def _by_height(
    scan: ScanOrientation, camera: Camera, archive: Archive, dem: Dem
) -> tuple[float, float] | None:
    """Principal distance of one photo and its standard deviation, millimetres."""
    record = archive.exterior.get(scan.photo_id)
    if record is not None:
        height, sigma = record.centre[2], (record.sigma_centre_m or LISTED[:1] * 3)[2]
    elif archive.georeference.flying_height_m is not None:
        height, sigma = archive.georeference.flying_height_m, ALTIMETER_M
    else:
        return None
    try:
        placed = georeference_photo(scan, camera, replace(archive, exterior={}), dem)
    except PhotogrammetryError:
        # Whatever is wrong with this source is told where the photo is placed by it.
        return None
    if isinstance(placed, Failure):
        return None
    east, north, presumed = (float(value) for value in placed.exterior.centre)
    ground = mean_height_under(dem, east, north)
    above = height - ground
    share = float(np.hypot(placed.prior.sigma_centre_m[2] / (presumed - ground), sigma / above))
    distance = camera.principal_distance_mm * above / (presumed - ground)
    return (distance, share * distance) if above > 0 and np.isfinite(distance) else None


def _at_heights(camera: Camera, told: Float64[np.ndarray, "photos 2"]) -> Camera:
    """A camera by what its photos tell: sources of one archive err alike, so many are as one.

    Of the lenses of a known type the nearest is meant.
    """
    distance, sigma = (float(value) for value in np.median(told, axis=0))
    lenses = sorted(camera.distances_mm, key=lambda lens: abs(np.log(lens[0] / distance)))
    best = lenses[0] if lenses[0][1] < sigma else (distance, sigma)
    return replace(camera.at_distance(*best), distances_mm=(best,))


@cache
def camera_types() -> tuple[CameraType, ...]:
    """All lenses of all types, of each type the most frequent first."""
    with FILE.open(encoding="utf-8", newline="") as rows:
        return tuple(
            CameraType(
                row["make"],
                row["model"],
                int(row["certificates"]),
                float(row["distance_mm"]),
                float(row["distance_spread_mm"]),
                float(row["marks_apart_mm"] or "nan"),
            )
            for row in csv.DictReader(rows)
        )
