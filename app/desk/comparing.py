"""What shows at the desk where a point lies: reference beside scan, and scan beside scan."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.desk.measuring import Errors
from core.arrays import ObjectPoints
from core.block import Block, Measurement, Photo
from core.control.likeness import Likeness, likeness_about, search_options
from core.control.located import Surroundings
from core.control.transfer import propose_by_ortho, refine_place, transfer_point
from core.doubts import Failure
from core.geometry.camera import Camera
from core.localisation.photo_orientation import OrientationOptions
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference
from core.raster.scan_file import ScanFile, ScanFiles
from core.scans.photo_mask import with_drawn
from ui.review.state import InitialState

SEARCH_M = 12.0
"""How far about the expected place reference and scan are compared, metres."""


@dataclass(frozen=True, slots=True)
class Comparing:
    """Compares reference and scan about a point, as the engine does when it proposes control."""

    reference: Reference
    """Ortho and heights."""
    orientation: OrientationOptions
    """Sizes of the patches."""
    open_scan: Callable[[Path], ScanFile]
    """Scans by their path."""

    def __call__(self, photo: Photo, camera: Camera, position: ObjectPoints) -> Likeness | Failure:
        """How alike both are about a position (1, 3)."""
        opened = OpenPhoto(photo, camera, masked_scan(photo, self.open_scan))
        options = search_options(opened, self.reference, self.orientation, SEARCH_M)
        pixel = photo.pixel_from_object(position, camera)
        return likeness_about(opened, self.reference, pixel, options)


@dataclass(frozen=True, slots=True)
class Transferring:
    """Finds what photos show of a point in the other photos of a block."""

    reference: Reference
    """The terrain, and the ortho where the block has one."""
    open_scan: Callable[[Path], ScanFile]
    """Scans by their path."""

    def proposals(
        self, block: Block, errors: Errors, point_id: str, measured: Sequence[Measurement]
    ) -> Sequence[Measurement]:
        """Where photos show a point, each with its probability; nothing where none does.

        By those in which it is measured; before there are any, by the ortho.
        """
        around, ortho = self._around(block, errors), self.reference.ortho
        if measured:
            found = transfer_point(around, point_id, measured)
        elif ortho.is_there:
            point = block.surveyed[point_id]
            sigma_m = float(self.reference.sigmas_m(point.position[None, :2])[0, 0])
            found = propose_by_ortho(around, point, ortho, sigma_m)
        else:
            return ()
        return () if isinstance(found, Failure) else found.proposals

    def refined(
        self, block: Block, errors: Errors, place: Measurement, measured: Sequence[Measurement]
    ) -> Measurement | Failure:
        """A place on what other photos show of its point."""
        return refine_place(self._around(block, errors), place, measured)

    def _around(self, block: Block, errors: Errors) -> Surroundings:
        scans = {name: masked_scan(photo, self.open_scan) for name, photo in block.photos.items()}
        return Surroundings(block, scans, errors.sigmas, self.reference.dem, joint=errors.joint)


def photographs(read: ScanFiles, initial: InitialState) -> Callable[[Path], ScanFile]:
    """Scans by their path, with what of each the program took for photograph."""
    usable = {film.scan.path: film.scan.usable for film in initial.films.values()}
    return lambda path: replace(read.opened(path), usable=usable.get(path))


def masked_scan(photo: Photo, open_scan: Callable[[Path], ScanFile]) -> ScanFile:
    """The scan of a photo, which knows what was drawn on it."""
    scan = open_scan(photo.scan)
    if not photo.mask:
        return scan
    return replace(scan, usable=with_drawn(scan.usable, photo.mask, scan.size_px))
