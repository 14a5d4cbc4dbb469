"""Interior orientation of one scan from its file, with all doubts about it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from core.arrays import locked
from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.drawn_mask import DrawnMask
from core.geometry.interior import InteriorOrientation, nominal_interior
from core.raster.scan_file import ScanFile, UsableArea, check_fits_camera, open_scan, photo_id_of
from core.raster.stand_in import is_stand_in
from core.said import say
from core.scans.certified import measure_certified
from core.scans.fiducials import (
    fiducials_by_hand,
    measure_unknown_fiducials,
    renamed,
)
from core.scans.film_area import (
    FilmArea,
    Side,
    area_from_interior,
    check_not_blank,
    detect_film_area,
    find_data_strip,
    refine_film_area,
)
from core.scans.judging import (
    FiducialMeasurement,
    FiducialSet,
    doubts_of_fit,
    interior_of,
    names_guessed,
    places_of,
)
from core.scans.naming import UPRIGHT, Way, ways_of_strip
from core.scans.photo_mask import find_usable_area, with_drawn
from core.scans.repeated import firm_marks, with_repeated
from core.scans.scan_pairs import Look, look_of
from core.scans.without_picture import interior_without_picture, nothing_usable

Marks = Mapping[str, tuple[float, float]]
"""Column and row by the name of a mark."""
CELL_MM, MOST_PIXELS = 0.25, 8  # design: a pen stroke; memory at one end, aliasing at the other
"""Cells of the mask that says what of a scan is photograph are no larger."""

EXPECTED, UNEXPECTED = 0.3, 0.8  # design: what the operator knows, and what is to be looked at
"""Gravity of an orientation without fiducials."""


def _unseen() -> Look:
    return np.zeros((0, 0), dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class ScanOrientation:
    """A scan that can be used, and how its pixels lie on the film."""

    photo_id: str
    """The scan's file name without folder and extension."""
    scan: ScanFile
    """The file."""
    interior: InteriorOrientation
    """Pixel <-> film."""
    fiducials: tuple[FiducialMeasurement, ...]
    """Fiducials that were measured, left out ones included."""
    area: FilmArea
    """The exposed picture."""
    doubts: tuple[Doubt, ...]
    """What the operator should look at."""
    way: Way = UPRIGHT
    """How the film lies in the scan: quarter turns counter-clockwise, mirrored or not."""
    rivals: tuple[Way, ...] = ()
    """Other ways that the marks cannot tell from it."""
    strip: Side | None = None
    """Side of the picture, as it lies in the scan, with the data strip."""
    look: Look = field(default_factory=_unseen)
    """A small picture of the frame and its margin, as it lies in the scan."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "look", locked(self.look, np.uint8))

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.scan.size_px

    def usable(self, reduction: int = MOST_PIXELS) -> UsableArea:
        """What of the scan is photograph, in cells of so many pixels a side."""
        if is_stand_in(self.scan.path):
            return nothing_usable(self.scan)
        marks = [mark.place for mark in self.fiducials]
        pixel_mm = self.interior.pixel_size_mm
        return find_usable_area(self.scan, self.area, pixel_mm, marks, reduction)

    def masked(self) -> "ScanOrientation":
        """The same with its scan knowing which part of it is photograph."""
        reduction = int(np.clip(CELL_MM // self.interior.pixel_size_mm, 1, MOST_PIXELS))
        return replace(self, scan=replace(self.scan, usable=self.usable(reduction)))

    def with_drawn(self, drawn: DrawnMask) -> "ScanOrientation":
        """The same with its scan knowing what a hand drew on it."""
        area = with_drawn(self.scan.usable, drawn, self.size_px, self.area.corners)
        return replace(self, scan=replace(self.scan, usable=area))


def orient_scan(
    path: Path,
    camera: Camera,
    scan_pixel_um: float,
    by_hand: Marks | None = None,
) -> ScanOrientation:
    """Open a scan, find its picture area and fiducials, and fit its interior orientation.

    Args:
        path: The scan file.
        camera: Camera; its `fiducials_mm` may be empty: marks are then looked for where cameras
            have them, and their places follow from all photos together (`camera_group`).
        scan_pixel_um: Nominal size of a scan pixel, micrometres.
        by_hand: Fiducials that somebody measured (column, row); nothing is looked for then.

    Raises:
        ScanError: The file cannot be used, is blank, or does not fit the camera; it is a stand-in
            without picture, and its fiducials are not known.
    """
    scan = open_scan(path)
    pixel_mm = scan_pixel_um / 1000
    if is_stand_in(path):
        return _without_picture(scan, camera, pixel_mm, by_hand or {})
    if camera.digital:
        return _digital(scan, camera, pixel_mm)
    check_fits_camera(scan, camera, pixel_mm, page=True)
    area = detect_film_area(scan, camera, pixel_mm)
    if len(area.seen) < 4:
        check_fits_camera(scan, camera, pixel_mm)
    check_not_blank(scan, area)
    if camera.fiducials_mm:
        return _by_certificate(scan, camera, pixel_mm, area, by_hand or {})
    photo_id = photo_id_of(path)
    measured, area = _unknown(scan, camera, pixel_mm, area)
    strip = find_data_strip(scan, pixel_mm, area) if area.trusted else None
    interior = _nominal(scan, camera, pixel_mm, area)
    doubt = _nominal_doubt(photo_id, area, "The camera has no fiducials_mm.", EXPECTED)
    return ScanOrientation(
        photo_id, scan, interior, measured.marks, _area(area, interior, camera),
        (*measured.doubts, doubt), strip=strip, look=look_of(scan, area),
    )  # fmt: skip


def _without_picture(
    scan: ScanFile, camera: Camera, pixel_mm: float, by_hand: Marks
) -> ScanOrientation:
    """A scan whose picture nobody has, on the fiducials that were measured in it."""
    check_fits_camera(scan, camera, pixel_mm)
    interior, measured = interior_without_picture(scan, camera, pixel_mm, by_hand)
    return ScanOrientation(
        photo_id_of(scan.path), scan, interior, measured.marks,
        area_from_interior(interior, camera), measured.doubts, measured.way,
    )  # fmt: skip


def _digital(scan: ScanFile, camera: Camera, pixel_mm: float) -> ScanOrientation:
    """A frame that was never film: its pixels are the sensor's, and nothing is looked for."""
    check_fits_camera(scan, camera, pixel_mm)
    interior = nominal_interior(scan.size_px, camera, pixel_mm)
    area = area_from_interior(interior, camera)
    check_not_blank(scan, area)
    return ScanOrientation(
        photo_id_of(scan.path), scan, interior, (), area, (), look=look_of(scan, area)
    )


def pooled_factor(interiors: Sequence[InteriorOrientation]) -> float | None:
    """Variance factor of all photos of a camera: two redundant equations alone say little.

    None where fewer than two photos have any.
    """
    fitted = [interior for interior in interiors if interior.redundancy]
    if len(fitted) < 2:
        return None
    equations = sum(interior.redundancy for interior in fitted)
    return sum(one.variance_factor * one.redundancy for one in fitted) / equations


def _unknown(
    scan: ScanFile,
    camera: Camera,
    pixel_mm: float,
    area: FilmArea,
) -> tuple[FiducialSet, FilmArea]:
    """Marks nobody certified, and the picture area that goes with them."""
    measured = measure_unknown_fiducials(scan, camera, pixel_mm, area)
    measured = with_repeated(scan, camera, pixel_mm, area, measured)
    if len(measured.marks) < 3:
        return measured, area
    refined = refine_film_area(scan, camera, pixel_mm, area, measured.middle)
    if len(refined.seen) < len(area.seen):
        # Old pictures are not always as the frame is, and then their middle is not the marks'.
        refined = area
    if refined is area or not measured.doubts:
        return measured, refined
    # Windows about the right places may show what windows about the wrong ones did not.
    again = measure_unknown_fiducials(scan, camera, pixel_mm, refined)
    return (again if len(again.marks) > len(measured.marks) else measured), refined


def _by_certificate(
    scan: ScanFile,
    camera: Camera,
    pixel_mm: float,
    area: FilmArea,
    by_hand: Marks,
) -> ScanOrientation:
    """The scan of a camera whose marks are certified."""
    photo_id = photo_id_of(scan.path)
    measured, others = fiducials_by_hand(photo_id, camera, by_hand), FiducialSet((), ())
    if not measured.marks:
        measured, others = measure_certified(scan, camera, pixel_mm, area)
    fitted = interior_of(measured.marks, camera.fiducials_mm, measured.way[1])
    if isinstance(fitted, InteriorOrientation):
        column, row = fitted.pixel_from_film(np.zeros((1, 2)))[0].tolist()
        area = refine_film_area(scan, camera, pixel_mm, area, (column, row))
    strip = find_data_strip(scan, pixel_mm, area) if area.trusted else None
    preferred = ways_of_strip(camera.data_strip, strip)
    if measured.rivals and preferred:
        measured = renamed(measured, camera, preferred, area)
        fitted = interior_of(measured.marks, camera.fiducials_mm, measured.way[1])
    marks, doubts = measured.marks, measured.doubts
    if measured.guessed:
        doubts += (names_guessed(photo_id, measured.way),)
    if isinstance(fitted, Failure):
        interior = _nominal(scan, camera, pixel_mm, area)
        doubts += (_nominal_doubt(photo_id, area, fitted.reason, UNEXPECTED),)
        doubts += _of_another_camera(photo_id, camera, pixel_mm, firm_marks(others))
    else:
        interior = fitted
        doubts += doubts_of_fit(photo_id, interior, marks, pixel_mm)
    return ScanOrientation(
        photo_id, scan, interior, marks, _area(area, interior, camera), doubts,
        measured.way, measured.rivals, strip, look_of(scan, area),
    )  # fmt: skip


def _of_another_camera(
    photo_id: str, camera: Camera, pixel_mm: float, others: Sequence[FiducialMeasurement]
) -> tuple[Doubt, ...]:
    """A word about marks that are there, but not where this camera has them."""
    if len(others) < 3:
        return ()
    middle = places_of(others).mean(axis=0)
    places = {
        mark.name: (
            round(float(mark.column - middle[0]) * pixel_mm, 2),
            round(float(middle[1] - mark.row) * pixel_mm, 2),
        )
        for mark in others
    }
    told = ", ".join(f"{name} ({x:+.1f}, {y:+.1f})" for name, (x, y) in places.items())
    return (
        Doubt(
            "fiducials-of-another-camera",
            photo_id,
            say(
                "There are marks, but not those of camera '{name}': {told} mm from their "
                "middle. Give this scan its own camera in [[scans.override]], or correct "
                "fiducials_mm.",
                name=camera.name,
                told=told,
            ),
            evidence={"places_mm": places, "kind": others[0].kind},
        ),
    )


def _nominal(
    scan: ScanFile, camera: Camera, pixel_mm: float, area: FilmArea
) -> InteriorOrientation:
    """Interior orientation from the frame's border, or from the scan alone."""
    return nominal_interior(scan.size_px, camera, pixel_mm, area.corners if area.trusted else None)


def _area(area: FilmArea, interior: InteriorOrientation, camera: Camera) -> FilmArea:
    """The picture area as seen, or the camera's frame where its border was not."""
    return area if area.trusted else area_from_interior(interior, camera)


def _nominal_doubt(photo_id: str, area: FilmArea, reason: str, gravity: float) -> Doubt:
    """The doubt of a scan whose interior orientation rests on no fiducial."""
    rests_on = "the border of the picture" if area.trusted else "the middle of the scan"
    return Doubt(
        "interior-nominal",
        photo_id,
        say(
            "{reason} The interior orientation rests on {rests_on} and the nominal scan "
            "pixel size, good to some tenths of a millimetre. Give fiducials_mm of the "
            "camera, or measure the fiducials by hand.",
            reason=reason,
            rests_on=rests_on,
        ),
        gravity,
        {"rests_on": rests_on, "sides_seen": list(area.seen)},
    )
