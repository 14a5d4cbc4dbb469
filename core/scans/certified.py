"""Marks where a certificate has them: of a listed kind, else of any kind that lies so."""

from dataclasses import replace

import numpy as np

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.raster.scan_file import ScanFile, photo_id_of
from core.scans.constellation import FIT_MM, LARGEST_SCALE, expected_places
from core.scans.corner_sets import LEAST_MARKS
from core.scans.fiducials import (
    measure_fiducials,
    measure_unknown_fiducials,
    quarters_of,
    renamed,
    renamed_doubt,
)
from core.scans.film_area import FilmArea
from core.scans.judging import FiducialSet, doubtful_mark, places_of
from core.scans.naming import CORNERS, SIDES, lying
from core.scans.repeated import with_repeated


def measure_certified(
    scan: ScanFile, camera: Camera, pixel_mm: float, area: FilmArea
) -> tuple[FiducialSet, FiducialSet]:
    """The certified marks of a scan, and those that were found where no listed kind lies so.

    Certificates say where marks lie, not what they look like.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
    """
    measured = measure_fiducials(scan, camera, pixel_mm, area)
    if len(measured.marks) >= LEAST_MARKS:
        return measured, FiducialSet((), ())
    unnamed = replace(camera, fiducials_mm={})
    others = measure_unknown_fiducials(scan, unnamed, pixel_mm, area)
    others = with_repeated(scan, unnamed, pixel_mm, area, others)
    for places in (CORNERS | SIDES, CORNERS, SIDES):
        marks = tuple(mark for mark in others.marks if mark.name in places)
        named = _as_certified(scan, replace(others, marks=marks), camera, pixel_mm, area)
        if named is not None:
            return named, others
    return measured, others


def _as_certified(
    scan: ScanFile, found: FiducialSet, camera: Camera, pixel_mm: float, area: FilmArea
) -> FiducialSet | None:
    """Marks under the names of the certificate; None where they do not lie as it says."""
    if len(found.marks) < LEAST_MARKS:
        return None
    pixels, names = places_of(found.marks), tuple(camera.fiducials_mm)
    way = (quarters_of(camera, area)[0], False)
    film = lying(np.array(list(camera.fiducials_mm.values()), dtype=np.float64), way)
    expected = expected_places(film, area, pixel_mm)
    nearest = np.linalg.norm(pixels[:, None] - expected[None], axis=2).argmin(axis=1).tolist()
    fit = fit_similarity(film[nearest], pixels, mirrored=True)
    if len(set(nearest)) < len(nearest) or not isinstance(fit, PlaneTransform):
        return None
    put = apply_affine(fit.matrix, film)
    apart_mm = np.linalg.norm(put[nearest] - pixels, axis=1) * pixel_mm
    if abs(fit.scale * pixel_mm - 1) > LARGEST_SCALE or apart_mm.max() > FIT_MM:
        return None
    known = {mark.name: names[k] for mark, k in zip(found.marks, nearest, strict=True)}
    marks = tuple(replace(mark, name=known[mark.name]) for mark in found.marks)
    doubts: list[Doubt] = []
    for doubt in found.doubts:
        name = str(doubt.evidence.get("fiducial"))
        if name in known:
            doubts.append(renamed_doubt(doubt, name, known[name]))
    missing = Failure("No mark was found there.")
    for name, (column, row) in zip(names, put.tolist(), strict=True):
        if name not in known.values():
            doubts.append(doubtful_mark(photo_id_of(scan.path), name, (column, row), missing))
    taken = replace(found, marks=marks, doubts=tuple(doubts), way=way)
    return renamed(taken, camera, area=area)
