"""One scan from file to interior orientation, with everything that is doubtful about it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.arrays import Mask
from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.interior import (
    InteriorOrientation,
    fit_interior,
    limit_um,
    nominal_interior,
)
from core.scan.fiducials import FiducialMeasurement, FiducialOptions, measure_fiducials
from core.scan.film_area import FilmArea, area_from_interior, detect_film_area, usable_mask
from core.scan.layouts import Way
from core.scan.raster import ScanFile, check_fits_camera, open_scan, photo_id_of

AFFINITY = 2e-4
"""Difference of the film's scales in x and y that is worth a word, METHODS 2."""


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

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.scan.size_px

    def usable(self, reduction: int = 8) -> Mask:
        """Which cells of the reduced scan are photograph; see `film_area.usable_mask`."""
        marks = [(mark.column, mark.row) for mark in self.fiducials]
        return usable_mask(self.scan, self.area, self.interior.pixel_size_mm, marks, reduction)


def orient_scan(
    path: Path,
    camera: Camera,
    scan_pixel_um: float,
    options: FiducialOptions | None = None,
) -> ScanOrientation:
    """Open a scan, find its picture area and fiducials, and fit its interior orientation.

    Args:
        path: The scan file.
        camera: Camera; its `fiducials_mm` may be empty.
        scan_pixel_um: Nominal size of a scan pixel, micrometres.
        options: When a fiducial stands.

    Raises:
        ScanError: The file cannot be used, or does not fit the camera.
    """
    scan = open_scan(path)
    pixel_mm = scan_pixel_um / 1000
    check_fits_camera(scan, camera, pixel_mm)
    area = detect_film_area(scan, camera, pixel_mm)
    photo_id = photo_id_of(path)
    if not camera.fiducials_mm:
        interior = _nominal(scan, camera, pixel_mm, area)
        doubts = (_nominal_doubt(photo_id, area, "The camera has no fiducials_mm", 0.3),)
        return ScanOrientation(photo_id, scan, interior, (), _area(area, interior, camera), doubts)
    measured = measure_fiducials(scan, camera, pixel_mm, area, options)
    marks, doubts = measured.marks, measured.doubts
    fitted = _interior_from_marks(marks, camera, measured.way)
    if isinstance(fitted, Failure):
        interior = _nominal(scan, camera, pixel_mm, area)
        doubts += (_nominal_doubt(photo_id, area, fitted.reason.rstrip("."), 0.8),)
    else:
        interior = fitted
        doubts += _doubts_of_fit(photo_id, interior, marks)
    return ScanOrientation(photo_id, scan, interior, marks, _area(area, interior, camera), doubts)


def _interior_from_marks(
    marks: tuple[FiducialMeasurement, ...], camera: Camera, way: Way
) -> InteriorOrientation | Failure:
    """Interior orientation from at least two marks."""
    if len(marks) < 2:
        return Failure(f"Only {len(marks)} of {len(camera.fiducials_mm)} fiducials were measured.")
    names = [mark.name for mark in marks]
    pixels = np.array([(mark.column, mark.row) for mark in marks], dtype=np.float64)
    film = np.array([camera.fiducials_mm[name] for name in names], dtype=np.float64)
    sigmas = np.array([mark.sigma_px for mark in marks])
    return fit_interior(names, pixels, film, "auto", sigmas, mirrored=way[1])


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
        f"{reason}: the interior orientation rests on {rests_on} and the nominal scan pixel size, "
        "good to some tenths of a millimetre. Give fiducials_mm of the camera, or measure the "
        "fiducials by hand.",
        gravity,
        {"rests_on": rests_on, "sides_seen": list(area.seen)},
    )


def _doubts_of_fit(
    photo_id: str, interior: InteriorOrientation, marks: tuple[FiducialMeasurement, ...]
) -> tuple[Doubt, ...]:
    """Marks left out, large residuals, no redundancy, irregular film (METHODS 2)."""
    doubts: list[Doubt] = []
    left_out = [mark.name for mark in marks if mark.name not in interior.names]
    if left_out:
        doubts.append(
            Doubt(
                "fiducial-left-out", photo_id,
                f"Fiducial {', '.join(left_out)} does not lie where the others put it and was left "
                "out. Look whether it is the mark, and whether its certified place is right.",
                0.5, {"fiducials": left_out},
            )
        )  # fmt: skip
    if len(interior.names) < 3:
        doubts.append(
            Doubt(
                "fiducials-few", photo_id,
                "Only two fiducials were measured: nothing checks them. Measure a third by hand.",
                0.6, {"fiducials": list(interior.names)},
            )
        )  # fmt: skip
    if interior.rms_um > limit_um(interior.pixel_size_mm) / 2:
        doubts.append(
            Doubt(
                "fiducial-residual", photo_id,
                f"The fiducials fit their certificate with {interior.rms_um:.0f} um RMS, more than "
                "their measurement explains.",
                0.4, {"rms_um": interior.rms_um},
            )
        )  # fmt: skip
    affinity = _affinity(interior)
    if interior.model == "affine" and affinity > AFFINITY:
        doubts.append(
            Doubt(
                "film-shrinkage", photo_id,
                f"The film or the scanner is not true to shape: scales differ by {affinity:.1e}. "
                "The affine interior orientation takes this up.",
                0.1, {"affinity": affinity},
            )
        )  # fmt: skip
    return tuple(doubts)


def _affinity(interior: InteriorOrientation) -> float:
    """Largest over smallest scale of the transform, minus one."""
    singular = np.linalg.svd(interior.film_from_pixel_matrix[:, :2], compute_uv=False)
    return float(singular[0] / singular[1] - 1)
