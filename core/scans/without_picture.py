"""Interior orientation of a scan without picture: from fiducials that were measured elsewhere."""

from collections.abc import Mapping

import numpy as np

from core.doubts import Doubt, Failure
from core.errors import ScanError
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation, nominal_interior
from core.raster.scan_file import ScanFile, UsableArea, photo_id_of
from core.said import say
from core.scans.fiducials import fiducials_by_hand
from core.scans.judging import FiducialSet, doubts_of_fit, interior_of

NO_PICTURE = say(
    "The scan is a stand-in without picture: nothing is searched or measured in it, and there is "
    "no ortho of it."
)
"""The doubt of every stand-in."""


def interior_without_picture(
    scan: ScanFile, camera: Camera, pixel_mm: float, by_hand: Mapping[str, tuple[float, float]]
) -> tuple[InteriorOrientation, FiducialSet]:
    """The interior orientation of a stand-in, and its fiducials with all doubts.

    Args:
        scan: The stand-in.
        camera: Its camera; a digital one needs no fiducials.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        by_hand: Fiducials that were measured in the picture (column, row).

    Raises:
        ScanError: The fiducials do not give an interior orientation.
    """
    photo_id = photo_id_of(scan.path)
    told = Doubt("no-picture", photo_id, NO_PICTURE)
    if camera.digital:
        return nominal_interior(scan.size_px, camera, pixel_mm), FiducialSet((), (told,))
    measured = fiducials_by_hand(photo_id, camera, by_hand)
    interior = interior_of(measured.marks, camera.fiducials_mm, measured.way[1])
    if isinstance(interior, Failure):
        raise ScanError(
            scan.path,
            say("The scan is a stand-in without picture. {reason}", reason=interior.reason),
            "Certify the fiducials in fiducials_mm of the camera, and bring in where they were "
            "measured: gruber import BLOCK --from measurements FILE.",
        )
    doubts = (*measured.doubts, *doubts_of_fit(photo_id, interior, measured.marks, pixel_mm), told)
    return interior, FiducialSet(measured.marks, doubts, measured.way)


def nothing_usable(scan: ScanFile) -> UsableArea:
    """No part of a stand-in is photograph."""
    return UsableArea.of(np.zeros((1, 1), dtype=bool), scan.size_px)
