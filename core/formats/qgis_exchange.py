"""A block as QGIS takes it: .points, a world file and an .aux.xml for each scan, and points.csv.

The scans are never touched: what is written lies beside copies of them or is copied there. World
file and .aux.xml hold the affine transform that comes nearest to the photo on level ground at the
mean height of all points; the .aux.xml holds the CRS as well. A scan without such a transform gets
its measured points there instead (GDAL's GCPs; with both, GDAL forgets the CRS of the transform).
"""

import xml.etree.ElementTree as ElementTree
from pathlib import Path, PurePath

import numpy as np
from pyproj import CRS

from core.arrays import Affine2
from core.errors import ExchangeError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    pixels_of,
)
from core.formats.outlines import ground_height, ground_places
from core.formats.point_files import PLAIN_HEAD, point_numbers
from core.formats.qgis_points import QgisPoints, read_qgis_points, write_qgis_points
from core.formats.records import read_rows, write_rows
from core.formats.world_file import write_world_file
from core.formats.xml_files import add
from core.said import Said, say

POINTS = "points.csv"
WORLD = {
    ".tif": ".tfw",
    ".tiff": ".tfw",
    ".jpg": ".jgw",
    ".jpeg": ".jgw",
    ".png": ".pgw",
    ".jp2": ".j2w",
}
"""Ending of a world file by that of the scan; .wld for all others."""
# design: two places less than this apart are one point, whatever was rounded.
SAME_M = 1e-3
"""Metres."""
# design: corners, edges and what lies between.
GRID = 5
"""Rows and columns of the grid over which a photo's affine transform is found."""
# design: half a frame of a normal camera, where nobody said how large a scan is.
FIELD = 0.4
"""Image coordinates (without unit) up to which a photo of unknown size reaches."""


def write_qgis(folder: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write points.csv and, for each scan, .points, a world file and an .aux.xml.

    Returns:
        What was left out, a sentence each.
    """
    folder.mkdir(parents=True, exist_ok=True)
    points = [(p.point_id, *point_numbers(p), p.role) for p in block.points.values()]
    write_rows(folder / POINTS, [PLAIN_HEAD, *points])
    level = ground_height(block)
    missing: list[str] = []
    for photo in block.photos.values():
        own = [one for one in block.measurements if one.photo_id == photo.photo_id]
        pixels = np.array([(one.column, one.row) for one in own]).reshape(-1, 2)
        places = np.array([block.points[one.point_id].position for one in own]).reshape(-1, 3)
        if own:
            path = folder / f"{photo.file}.points"
            on = np.ones(len(own), dtype=np.bool_)
            write_qgis_points(path, QgisPoints(path, block.crs, places[:, :2], pixels, on))
        affine = None
        if photo.exterior is not None and photo.pixel_from_image is not None and level is not None:
            affine = ground_affine(photo, block.camera_of(photo.photo_id), level)
        if affine is None:
            missing.append(photo.photo_id)
        else:
            ending = WORLD.get(PurePath(photo.file).suffix.lower(), ".wld")
            write_world_file(folder / f"{PurePath(photo.file).stem}{ending}", affine)
        names = [one.point_id for one in own]
        _write_aux(folder / f"{photo.file}.aux.xml", block.crs, affine, names, pixels, places)
    return tuple(_left_out(missing))


def _left_out(missing: list[str]) -> list[Said]:
    """A word on photos without world file."""
    if not missing:
        return []
    return [
        say(
            "Not oriented, without points for the height of the ground, or not looking down, and "
            "so without world file: {photos}.",
            photos=", ".join(missing),
        )
    ]


def ground_affine(photo: ExchangePhoto, camera: ExchangeCamera, level: float) -> Affine2 | None:
    """Easting, northing from pixels (outer corner), nearest to a photo on level ground.

    Args:
        photo: An oriented photo.
        camera: Its camera.
        level: Height of the ground, metres.

    Returns:
        The transform; None where a corner does not look down upon the ground.
    """
    assert photo.exterior is not None, "only an oriented photo lies on the ground"
    assert photo.pixel_from_image is not None, "only an oriented photo lies on the ground"
    linear, shift = photo.pixel_from_image[:, :2], photo.pixel_from_image[:, 2]
    if camera.size_px is not None:
        sides = [np.linspace(0.0, side, GRID) for side in camera.size_px]
        pixels = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    else:
        sides = [np.linspace(-side, side, GRID) for side in _reach(camera)]
        pixels = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2) @ linear.T + shift
    places = ground_places(photo, camera, pixels, level)
    if places is None:
        return None
    seen = pixels_of(places, photo, camera)
    middle = seen.mean(axis=0)
    design = np.column_stack([seen - middle, np.ones(len(seen))])
    found = np.linalg.lstsq(design, places[:, :2], rcond=None)[0].T
    return np.column_stack([found[:, :2], found[:, 2] - found[:, :2] @ middle])


def _reach(camera: ExchangeCamera) -> tuple[float, float]:
    """Half the frame in image coordinates."""
    if camera.frame_mm is None or camera.principal_distance_mm is None:
        return FIELD, FIELD
    width, height = camera.frame_mm
    return width / camera.principal_distance_mm / 2, height / camera.principal_distance_mm / 2


def _write_aux(
    path: Path,
    crs: str,
    affine: Affine2 | None,
    names: list[str],
    pixels: np.ndarray,
    places: np.ndarray,
) -> None:
    """GDAL's side file: CRS and transform, or points."""
    wkt = CRS.from_user_input(crs).to_wkt("WKT1_GDAL") if crs else ""
    root = ElementTree.Element("PAMDataset")
    if wkt and affine is not None:
        add(root, "SRS", wkt).set("dataAxisToSRSAxisMapping", "1,2")
    if affine is not None:
        (a, b, c), (d, e, f) = affine.tolist()
        add(root, "GeoTransform", ", ".join(repr(value) for value in (c, a, b, f, d, e)))
    elif names:
        listed = add(root, "GCPList")
        listed.set("Projection", wkt)
        listed.set("dataAxisToSRSAxisMapping", "1,2")
        for name, pixel, place in zip(names, pixels.tolist(), places.tolist(), strict=True):
            one = add(listed, "GCP")
            one.set("Id", name)
            for key, value in zip(("Pixel", "Line", "X", "Y", "Z"), (*pixel, *place), strict=True):
                one.set(key, repr(value))
    ElementTree.indent(root)
    # GDAL reads the root only where it stands first.
    path.write_bytes(ElementTree.tostring(root, encoding="utf-8") + b"\n")


def read_qgis(folder: Path) -> ExchangeBlock:
    """Read the .points files of a folder, whose places points.csv names and gives heights.

    Raises:
        ExchangeError: No such files, no points.csv, or a place that is none of its points.
        ScanError: A damaged .points file.
    """
    files = sorted(folder.glob("*.points")) if folder.is_dir() else []
    if not files:
        raise ExchangeError(
            folder, "It holds no .points files.", "Choose the folder with the .points files."
        )
    points = _read_list(folder / POINTS)
    names = list(points)
    plane = np.array([points[name].position[:2] for name in names]).reshape(-1, 2)
    crs = ""
    photos: dict[str, ExchangePhoto] = {}
    measurements: list[ExchangeMeasurement] = []
    for path in files:
        read = read_qgis_points(path)
        crs = crs or read.crs
        if read.crs and read.crs != crs:
            raise ExchangeError(
                path,
                "Its CRS is not that of the other files.",
                "Save all .points files in one CRS.",
            )
        file = path.name.removesuffix(".points")
        photo = PurePath(file).stem if PurePath(file).suffix else file
        photos[photo] = ExchangePhoto(photo, file)
        for place, pixel in zip(read.plane[read.enabled], read.pixels[read.enabled], strict=True):
            near = np.flatnonzero(np.hypot(*(plane - place).T) < SAME_M)
            if len(near) != 1:
                raise ExchangeError(
                    path,
                    "{count:# point|# points} of points.csv lie at {east:.3f} {north:.3f}, not "
                    "one.",
                    "Give every place of the .points files one row in points.csv.",
                    count=len(near),
                    east=float(place[0]),
                    north=float(place[1]),
                )
            column, row = pixel.tolist()
            measurements.append(ExchangeMeasurement(names[int(near[0])], photo, column, row))
    return ExchangeBlock(crs, {}, photos, points, tuple(measurements))


def _read_list(path: Path) -> dict[str, ExchangePoint]:
    """Points of points.csv by name."""
    found: dict[str, ExchangePoint] = {}
    for row in read_rows(path, PLAIN_HEAD[:4]):
        name = row.filled("id")
        row.refuse_again(name, found)
        spread = PLAIN_HEAD[4:7]
        sigma = row.triple_in(spread) if any(row.cell(key) for key in spread) else None
        role = "check" if row.cell("role") == "check" else "control"
        found[name] = ExchangePoint(name, row.triple_in(("X", "Y", "Z")), sigma, role)
    return found


QGIS = ExchangeFormat(
    name="qgis",
    title="QGIS",
    conventions=Conventions(
        pixels=".points: column right, row negative, outer corner of the first pixel; .aux.xml: "
        "row down; world file: centre of the first pixel",
        object_space="easting, northing of the block's CRS; heights in points.csv and .aux.xml",
        rotation="none: an affine transform of the scan onto level ground at the mean height of "
        "all points",
        sigmas="points, in points.csv",
        lost="orientations and cameras beyond the affine transform, fiducials, deviations of "
        "measurements, tie points; two points of one plan position",
        tested="GDAL reads world files, transform and points; not opened in QGIS",
    ),
    holds="film",
    write=write_qgis,
    read=read_qgis,
    default_name="qgis",
)
"""QGIS's side files."""
