"""`gruber new FOLDER --from FORMAT`: make a block from another program's project.

Cameras and scans become a `block.toml`, orientations and fiducials files beside it, points and
measurements decisions of its session. If a camera has no fiducials and its pixels are not square
and upright, four marks at the corners of its frame express its interior orientation exactly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit
from pyproj import CRS

from app.block_toml import FILE
from app.exchange import decisions_of, format_named, write_lists
from core.arrays import Affine2
from core.errors import CrsError, ProjectError
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
    ExchangeTies,
    places_of,
    read_format,
    understood,
)
from core.formats.records import scan_stem
from core.geometry.collinearity import CORRECTIONS
from core.geometry.crs import check_range, parse_crs
from core.raster.files import FILES
from core.said import say
from sessions.atomic_write import whole_file
from sessions.session import Session

SCANS = (".tif", ".tiff", ".jpg", ".jpeg", ".jp2", ".j2k", ".png", ".img", ".vrt")
NOMINAL_FRAME_MM = 100.0
"""Longer side of a frame whose pixels no program knows in millimetres: only ratios matter then."""
SQUARE = 1e-6
"""Pixels that are sheared or turned by less are square and upright: 0.01 px in any scan."""
CORNERS = {"c1": (-1, -1), "c2": (1, -1), "c3": (1, 1), "c4": (-1, 1)}
"""Marks at the corners of the frame, in half sides, x right, y up."""
MOST_RADIAL = 3


@dataclass(frozen=True, slots=True)
class Made:
    """A block that was made."""

    file: Path
    """Its `block.toml`."""
    scans: int
    """How many of its photos have their scan."""
    notes: tuple[str, ...]
    """What was not taken over, a sentence each."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraTable:
    """A camera as `block.toml` has it, and the photos as it sees them."""

    values: Mapping[str, object]
    """Keys of `[camera.NAME]`."""
    pixel_um: float
    """Side of a scan pixel, micrometres."""
    photos: Mapping[str, ExchangePhoto]
    """Its photos, with marks at the corners where its interior asks for them."""


def new_from(folder: Path, name: str, path: Path | None, crs: str, operator: str) -> Made:
    """Make a block of a folder of scans from a foreign project.

    Args:
        folder: Where the scans lie and the block is to be.
        name: The format.
        path: File or folder of the project; None for the folder itself.
        crs: The block's CRS where the project names none; empty when nobody says.
        operator: Who brings the points and measurements.

    Raises:
        PhotogrammetryError: There is a block already, the project cannot be read, has no scan in
            the folder, or nobody says its CRS.
    """
    target, project = folder / FILE, path or folder
    if target.exists():
        raise ProjectError(
            target, "is there already.", "Import into it: gruber import BLOCK --from FORMAT PATH."
        )
    form = format_named(name, reads=True)
    foreign = _about_the_middle(folder, read_format(form, project))
    _refuse_film(project, foreign)
    chosen = crs or foreign.crs
    if not chosen:
        raise ProjectError(
            project, "names no CRS.", "Say in which one its coordinates are: --crs EPSG:5514."
        )
    _refuse_elsewhere(project, foreign, parse_crs(chosen, project))
    scans = scans_of(folder, foreign)
    if not scans:
        raise ProjectError(
            folder,
            "holds no scan of the project, such as {name}.",
            "Put the scans into the folder, under the names the project has.",
            name=_first_file(foreign),
        )
    with understood(project):
        tables, notes = camera_tables(foreign, scans)
    photos = {n: p for table in tables.values() for n, p in table.photos.items()}
    shown = replace(foreign, photos={**foreign.photos, **photos})
    own = {theirs: scan.stem for theirs, scan in scans.items()}
    keys = write_lists(folder, shown, own, project, name, ties=_renamed(foreign.ties, own))
    with whole_file(target) as temporary:
        temporary.write_text(
            toml_of(folder, chosen, scans, tables, keys, foreign, _corrections(form, foreign)),
            encoding="utf-8",
        )
    decisions = decisions_of(foreign, own, project.name)
    if decisions:
        with Session.open(folder, operator) as session:
            session.record_all(decisions)
    missing = [theirs for theirs in foreign.photos if theirs not in scans]
    if missing:
        notes = (
            *notes,
            say("{count:# scan is|# scans are} not in the folder: {names}.",
                count=len(missing), names=missing[:5]),
        )  # fmt: skip
    return Made(target, len(scans), (*foreign.notes, *notes))


def _corrections(form: ExchangeFormat, foreign: ExchangeBlock) -> list[str]:
    """What the program left to be corrected: in coordinates of its own it knew a flat Earth."""
    curved = form.curved and bool(foreign.crs)
    left = {"refraction": form.refracts, "curvature": curved}
    return [name for name in CORRECTIONS if left[name]]


def _renamed(ties: ExchangeTies, own: Mapping[str, str]) -> ExchangeTies:
    """Ties by the names of the block's own photos; those of others keep theirs."""
    return replace(ties, photo_ids=tuple(own.get(name, name) for name in ties.photo_ids))


def _refuse_film(project: Path, foreign: ExchangeBlock) -> None:
    """Refuse a project without pixels: nothing tells how its scans lie."""
    if foreign.on_film:
        raise ProjectError(
            project,
            "knows image points on film, and no pixels of scans.",
            "Make the block with gruber new and its fiducials, then gruber import into it.",
        )


def _refuse_elsewhere(project: Path, foreign: ExchangeBlock, stated: CRS) -> None:
    """Refuse a CRS in which the project cannot lie, such as any where its frame is a local one."""
    if foreign.crs:
        return
    try:
        check_range(stated, places_of(foreign), project)
    except CrsError as error:
        raise ProjectError(
            project,
            error.cause,
            'Name the CRS it is in. For a local frame write one out (--crs "+proj=tmerc +lat_0=… '
            '+lon_0=… +datum=WGS84"), or transform the project to a national CRS first.',
        ) from error


def _about_the_middle(folder: Path, foreign: ExchangeBlock) -> ExchangeBlock:
    """Pixels that a program counts from the middle of its scans, as the scans have them."""
    if not foreign.from_middle:
        return foreign
    middles: dict[str, np.ndarray] = {}
    for name, scan in scans_of(folder, foreign).items():
        with FILES.borrow(scan) as dataset:
            middles[name] = np.array([dataset.width, dataset.height]) / 2
    photos = dict(foreign.photos)
    for name, middle in middles.items():
        matrix = np.array(photos[name].interior)
        matrix[:, 2] += middle
        photos[name] = replace(photos[name], pixel_from_image=matrix)
    ties = foreign.ties
    shifts = np.array([middles.get(name, np.zeros(2)) for name in ties.photo_ids]).reshape(-1, 2)
    moved = ties.pixels + shifts[ties.photo] if len(ties.point) else ties.pixels
    return replace(foreign, photos=photos, ties=replace(ties, pixels=moved))


def scans_of(folder: Path, foreign: ExchangeBlock) -> dict[str, Path]:
    """Scans of the project that are in a folder, by photo."""
    files = sorted(f for f in folder.rglob("*") if f.suffix.lower() in SCANS)
    hidden = [f for f in files if any(p.startswith(".") for p in f.relative_to(folder).parts)]
    by_name = {file.name.lower(): file for file in files if file not in hidden}
    by_stem = {file.stem.lower(): file for file in by_name.values()}
    found: dict[str, Path] = {}
    for name, photo in foreign.photos.items():
        file = Path(photo.file).name.lower()
        scan = by_name.get(file) or by_stem.get(scan_stem(file)) or by_stem.get(name.lower())
        if scan is not None and photo.camera:
            found[name] = scan
    return found


def _first_file(foreign: ExchangeBlock) -> str:
    """A scan's name for a message."""
    return next((photo.file for photo in foreign.photos.values()), "?")


def camera_tables(
    foreign: ExchangeBlock, scans: Mapping[str, Path]
) -> tuple[dict[str, CameraTable], tuple[str, ...]]:
    """Cameras of the photos whose scans are there, and what of them had to be left out."""
    tables: dict[str, CameraTable] = {}
    notes: list[str] = []
    for name, camera in foreign.cameras.items():
        photos = {n: foreign.photos[n] for n in scans if foreign.photos[n].camera == name}
        if not photos:
            continue
        bare = [n for n, photo in photos.items() if photo.pixel_from_image is None]
        if bare and not camera.fiducials_mm:
            raise ProjectError(
                name,
                "nothing says how {names} lie in it.",
                "Give the interior orientations, or the fiducials.",
                names=bare[:3],
            )
        tables[name] = camera_table(camera, photos, scans)
        if len(camera.radial) > MOST_RADIAL and any(camera.radial[MOST_RADIAL:]):
            notes.append(
                say("Camera {name}: radial terms beyond the third were left out.", name=name)
            )
    return tables, tuple(notes)


def camera_table(
    camera: ExchangeCamera, photos: Mapping[str, ExchangePhoto], scans: Mapping[str, Path]
) -> CameraTable:
    """One camera in millimetres."""
    marked = bool(camera.fiducials_mm) and all(p.fiducials_px for p in photos.values())
    first, one = next(iter(photos.items()))
    scale = _pixels_to_unit(one, camera)
    with FILES.borrow(scans[first]) as dataset:
        size = np.array([dataset.width, dataset.height], dtype=float)
    c = camera.principal_distance_mm or scale * NOMINAL_FRAME_MM / float(size.max())
    pixel_mm = c / scale
    width, height = camera.frame_mm or tuple((size * pixel_mm).tolist())
    values: dict[str, object] = {
        "principal_distance_mm": c,
        "frame_mm": [width, height],
        "principal_point_mm": list(camera.principal_point_mm),
    }
    if any(camera.radial):
        terms = camera.radial[:MOST_RADIAL]
        values["radial_distortion"] = [k / c ** (2 * i) for i, k in enumerate(terms, 1)]
    if any(camera.tangential):
        values["decentring"] = [p / c for p in camera.tangential]
    if marked:
        values["fiducials_mm"] = {n: list(place) for n, place in camera.fiducials_mm.items()}
        return CameraTable(values, pixel_mm * 1000, photos)
    plain = [p.pixel_from_image for p in photos.values() if p.pixel_from_image is not None]
    upright = np.array([[scale, 0.0], [0.0, -scale]])
    if all(np.array_equal(matrix, plain[0]) for matrix in plain) and np.allclose(
        plain[0][:, :2], upright, atol=SQUARE * scale
    ):
        x, y = ((plain[0][:, 2] - size / 2) * pixel_mm * (1, -1)).tolist()
        values |= {"principal_point_mm": [x, y], "digital": True}
        return CameraTable(values, pixel_mm * 1000, photos)
    corners = {n: (x * width / 2, y * height / 2) for n, (x, y) in CORNERS.items()}
    values["fiducials_mm"] = {n: list(place) for n, place in corners.items()}
    seen = {n: _with_corners(photo, camera, corners, c) for n, photo in photos.items()}
    return CameraTable(values, pixel_mm * 1000, seen)


def _with_corners(
    photo: ExchangePhoto,
    camera: ExchangeCamera,
    corners: Mapping[str, tuple[float, float]],
    principal_distance_mm: float,
) -> ExchangePhoto:
    """A photo whose marks are the corners of its frame, where its own transform puts them."""
    matrix = photo.pixel_from_image
    assert matrix is not None
    film = np.array(list(corners.values())) - np.array(camera.principal_point_mm)
    pixels = film / principal_distance_mm @ matrix[:, :2].T + matrix[:, 2]
    places = {n: (float(x), float(y)) for n, (x, y) in zip(corners, pixels, strict=True)}
    return replace(photo, fiducials_px=places)


def _pixels_to_unit(photo: ExchangePhoto, camera: ExchangeCamera) -> float:
    """Pixels to a principal distance, from the photo's transform or from its marks."""
    matrix: Affine2 | None = photo.pixel_from_image
    if matrix is not None:
        return float(np.sqrt(abs(np.linalg.det(matrix[:, :2]))))
    names = [name for name in camera.fiducials_mm if name in photo.fiducials_px]
    film = np.array([camera.fiducials_mm[name] for name in names])
    pixels = np.array([photo.fiducials_px[name] for name in names])
    c = camera.principal_distance_mm
    if len(names) < 2 or c is None:
        raise ProjectError(
            photo.file,
            "its fiducials do not say how large its pixels are.",
            "Give two fiducials or more, and the principal distance.",
        )
    return c * float(np.ptp(pixels, axis=0).max() / np.ptp(film, axis=0).max())


def toml_of(
    folder: Path,
    crs: str,
    scans: Mapping[str, Path],
    tables: Mapping[str, CameraTable],
    keys: Mapping[tuple[str, str], object],
    foreign: ExchangeBlock,
    corrections: Sequence[str],
) -> str:
    """The text of the `block.toml`."""
    document = tomlkit.document()
    document["block"] = {
        "name": folder.resolve().name,
        "crs": crs,
        "corrections": list(corrections),
    }
    document["camera"] = {name: dict(table.values) for name, table in tables.items()}
    names = list(tables)
    files: Sequence[str] = [scan.relative_to(folder).as_posix() for scan in scans.values()]
    scan_table: dict[str, object] = {
        "files": files,
        "camera": names[0],
        "scan_pixel_um": tables[names[0]].pixel_um,
        "georeference": "none",
        **{key: value for (table, key), value in keys.items() if table == "scans"},
    }
    other = [
        {
            "file": scan.name,
            "camera": foreign.photos[theirs].camera,
            "scan_pixel_um": tables[foreign.photos[theirs].camera].pixel_um,
        }
        for theirs, scan in scans.items()
        if foreign.photos[theirs].camera != names[0]
    ]
    if other:
        scan_table["override"] = other
    document["scans"] = scan_table
    return tomlkit.dumps(document)
