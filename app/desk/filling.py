"""Search all scans of a camera for marks like the one the operator clicked."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from app.settings import Threads
from core.doubts import Failure
from core.geometry.camera import Camera
from core.progress import Progress, Work
from core.scans.corrected_marks import corrected_scan
from core.scans.filled_marks import fill_marks
from core.scans.interior_orientation import ScanOrientation
from core.scans.judging import FiducialSet
from sessions.decisions import FillMarks
from sessions.marks import mark_changes, with_effect
from ui.review.gestures import MarkPlaced
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Notice

FindLike = Callable[
    [Mapping[str, ScanOrientation], Camera, Mapping[str, float], str, tuple[float, float], Work],
    Mapping[str, FiducialSet],
]
"""(scans, camera, pixels in mm, photo, place, work): the marks like the one at a place."""
WORKERS = 2
"""Scans that are searched side by side."""


@dataclass(frozen=True, slots=True)
class Filling:
    """Finds and names the marks like an example, in all scans of its camera."""

    find: FindLike
    """What searches the scans."""

    def __call__(
        self, gesture: MarkPlaced, desk: DeskSnapshot, progress: Progress
    ) -> tuple[FillMarks | None, Notice]:
        """The decision to record, and what to tell the operator.

        Raises:
            ScanError: A scan cannot be read.
            Cancelled: The operator stopped it.
        """
        initial, name = desk.initial, desk.state.block.photos[gesture.photo_id].camera
        films = _standing(desk, name)
        if gesture.photo_id not in films:
            return None, Notice("notice.not-filled", {"why": "the scan is not at hand"})
        camera = initial.cameras.get(name, desk.state.block.cameras[name])
        pixels_mm = {photo: initial.pixel_mm[photo] for photo in films}
        place, threads = (gesture.column, gesture.row), Threads(WORKERS)
        try:
            work = Work(progress, threads.map)
            found = self.find(films, camera, pixels_mm, gesture.photo_id, place, work)
        finally:
            threads.close()
        filled = fill_marks(films, found, camera, pixels_mm)
        if isinstance(filled, Failure):
            return None, Notice("notice.not-filled", {"why": filled.reason})
        values = {
            "marks": str(sum(len(marks) for marks in filled.found.values())),
            "scans": str(len(filled.found)),
            "all": str(len(films)),
        }
        bare = [photo for photo in filled.found if not films[photo].interior.names]
        told = "notice.filled-anew" if bare else "notice.filled"
        decision = FillMarks(
            name, gesture.photo_id, *place, filled.found, filled.places_mm, filled.sigma_mm
        )
        return decision, Notice(told, {**values, "bare": str(len(bare))})


def _standing(desk: DeskSnapshot, camera: str) -> dict[str, ScanOrientation]:
    """The scans of a camera with all that was said about their marks."""
    block, films = desk.state.block, desk.initial.films
    changes = with_effect(mark_changes(desk.recorded))
    standing: dict[str, ScanOrientation] = {}
    for name, photo in block.photos.items():
        film = films.get(name)
        if film is None or photo.camera != camera:
            continue
        if name in changes:
            pixel_mm = desk.initial.pixel_mm[name]
            film = corrected_scan(film, block.cameras[camera], pixel_mm, changes[name])
        used = tuple(mark for mark in film.fiducials if mark.name in film.interior.names)
        standing[name] = replace(film, fiducials=used)
    return standing
