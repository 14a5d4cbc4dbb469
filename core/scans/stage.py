"""Stage scans: picture area, fiducials and interior orientation of every scan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from core.doubts import Doubt
from core.errors import PhotogrammetryError
from core.geometry.camera import Camera
from core.progress import Work
from core.scans.camera_group import settle_family
from core.scans.copies import mark_shown_at, measure_like
from core.scans.interior_orientation import ScanOrientation, orient_scan
from core.scans.judging import FiducialSet
from core.scans.scan_pairs import same_photo


@dataclass(frozen=True, slots=True)
class ScanInput:
    """One scan and how it was taken."""

    path: Path
    """The file."""
    camera: str
    """Name of its camera."""
    scan_pixel_um: float
    """Nominal size of a scan pixel on the film, micrometres."""
    marks: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """Fiducials measured by hand (column, row), which go before found ones."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanSet:
    """All scans with their interior orientation, and those that were set aside."""

    oriented: Mapping[str, ScanOrientation]
    """By photo."""
    set_aside: Mapping[str, str]
    """Reason by photo."""
    doubts: tuple[Doubt, ...]
    """What is doubtful about them."""
    cameras: Mapping[str, Camera] = field(default_factory=dict[str, Camera])
    """Cameras by name, with marks where only the photos tell them; empty: as they were given."""


def orient_scans(
    scans: Sequence[ScanInput], given_cameras: Mapping[str, Camera], work: Work
) -> ScanSet:
    """Interior orientation of all scans of a block.

    A scan that cannot be used is set aside with its reason; the rest goes on.

    Raises:
        PhotogrammetryError: No scan can be used.
    """

    def orient(scan: ScanInput) -> ScanOrientation | PhotogrammetryError:
        try:
            return orient_scan(
                scan.path, given_cameras[scan.camera], scan.scan_pixel_um, by_hand=scan.marks
            )
        except PhotogrammetryError as error:
            return error

    oriented: dict[str, ScanOrientation] = {}
    failed: dict[str, PhotogrammetryError] = {}
    results = zip(scans, work.mapper(orient, scans), strict=True)
    for done, (scan, result) in enumerate(results):
        work.progress.report(done + 1, len(scans), scan.path.name)
        if isinstance(result, PhotogrammetryError):
            failed[scan.path.stem] = result
        else:
            oriented[result.photo_id] = result
    if not oriented:
        raise next(iter(failed.values()))
    oriented, cameras, doubts = _settle_cameras(scans, given_cameras, oriented)
    masked = work.mapper(ScanOrientation.masked, oriented.values())
    oriented = dict(zip(oriented, masked, strict=True))
    doubts += [doubt for result in oriented.values() for doubt in result.doubts]
    doubts += same_photo({name: scan.look for name, scan in oriented.items() if scan.look.size})
    doubts += [Doubt("scan-set-aside", name, error.told) for name, error in failed.items()]
    reasons = {name: error.told for name, error in failed.items()}
    return ScanSet(dict(sorted(oriented.items())), reasons, tuple(doubts), cameras)


def _settle_cameras(
    scans: Sequence[ScanInput],
    given_cameras: Mapping[str, Camera],
    oriented: Mapping[str, ScanOrientation],
) -> tuple[dict[str, ScanOrientation], dict[str, Camera], list[Doubt]]:
    """The scans of each camera settled together; cameras as their photos show them; doubts."""
    settled: dict[str, ScanOrientation] = {}
    cameras: dict[str, Camera] = dict(given_cameras)
    doubts: list[Doubt] = []
    by_name = {scan.path.stem: scan for scan in scans}
    for name, camera in given_cameras.items():
        own = {photo: one for photo, one in oriented.items() if by_name[photo].camera == name}
        pixels_mm = {photo: by_name[photo].scan_pixel_um / 1000 for photo in own}
        group = settle_family(own, camera, pixels_mm)
        settled |= group.oriented
        cameras[name] = group.camera
        doubts += group.doubts
    return settled, cameras, doubts


def find_like(
    films: Mapping[str, ScanOrientation],
    camera: Camera,
    pixels_mm: Mapping[str, float],
    photo_id: str,
    place: tuple[float, float],
    work: Work,
) -> dict[str, FiducialSet]:
    """The copies of one mark in all scans of a camera.

    Args:
        films: Scans of the camera by photo.
        camera: The camera.
        pixels_mm: Nominal size of a scan pixel by photo, millimetres.
        photo_id: The photo that shows the mark.
        place: Column and row of its middle there.
        work: How far it has come, whether to go on, and what it is done with.

    Raises:
        ScanError: A scan cannot be read.
    """
    own = films[photo_id]
    mark = mark_shown_at(own.scan, own.area, place, pixels_mm[photo_id])
    names = sorted(films)

    def copies(name: str) -> FiducialSet:
        film = films[name]
        return measure_like(film.scan, camera, pixels_mm[name], film.area, mark)

    found: dict[str, FiducialSet] = {}
    for name, result in zip(names, work.mapper(copies, names), strict=True):
        found[name] = result
        work.progress.report(len(found), len(names), name)
    return found
