"""Marks where a certificate has them: of a listed kind, else of any kind that lies so."""

from dataclasses import dataclass, replace

import numpy as np

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.raster.scan_file import ScanFile, photo_id_of
from core.said import say
from core.scans.chance import BORDER_TURN_DEG
from core.scans.constellation import FIT_MM, LARGEST_SCALE, LIBRARY, expected_places
from core.scans.corner_sets import LEAST_MARKS
from core.scans.fiducials import (
    GUESSED,
    measure_fiducials,
    measure_unknown_fiducials,
    quarters_of,
    renamed,
    renamed_doubt,
)
from core.scans.film_area import FilmArea
from core.scans.judging import (
    SCALE_OFF,
    FiducialSet,
    certified_places,
    doubtful_mark,
    places_of,
)
from core.scans.naming import CORNERS, SIDES, lying, small_turn
from core.scans.repeated import with_repeated

TURNS = 3.0  # design: three sigmas
"""Turn of marks against the picture's border, in what is usual, that it does not explain."""


def measure_certified(
    scan: ScanFile, camera: Camera, pixel_mm: float, area: FilmArea
) -> tuple[FiducialSet, FiducialSet]:
    """The certified marks of a scan, and those that were found where no listed kind lies so.

    Certificates say where marks lie, not what they look like. What stands beside every mark of a
    square of them lies as certified as well, only enlarged and turned. Dots and notches, which much
    of a picture looks like, are taken there only where no marks lie better, and are doubted.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
    """
    measured = measure_fiducials(scan, camera, pixel_mm, area)
    laid = _laid(measured, camera, pixel_mm, area)
    guessed = any(mark.kind in GUESSED for mark in measured.marks)
    if laid is not None and not (guessed and laid.odd):
        return measured, FiducialSet((), ())
    unnamed = replace(camera, fiducials_mm={})
    # What was guessed is not what is looked for now.
    kinds = LIBRARY if laid is None else tuple(k for k in LIBRARY if k.shape not in GUESSED)
    others = measure_unknown_fiducials(scan, unnamed, pixel_mm, area, kinds)
    others = with_repeated(scan, unnamed, pixel_mm, area, others)
    for places in (CORNERS | SIDES, CORNERS, SIDES):
        marks = tuple(mark for mark in others.marks if mark.name in places)
        named = _as_certified(scan, replace(others, marks=marks), camera, pixel_mm, area)
        lies = None if named is None else _laid(named, camera, pixel_mm, area)
        if named is not None and (laid is None or (lies is not None and not lies.odd)):
            return named, others
    return (measured if laid is None else _doubted(scan, measured, laid)), others


@dataclass(frozen=True, slots=True)
class _Laid:
    """How a film would lie by its marks."""

    enlarged: float
    """How much larger it is than nominal, as a share."""
    turned_deg: float
    """Its turn against the picture's border, where that was seen, degrees clockwise."""

    @property
    def odd(self) -> bool:
        """True where neither film nor borders as they are usually found explain it."""
        return abs(self.enlarged) > SCALE_OFF or abs(self.turned_deg) > TURNS * BORDER_TURN_DEG


def _laid(found: FiducialSet, camera: Camera, pixel_mm: float, area: FilmArea) -> _Laid | None:
    """How the film lies by marks under their names; None for too few."""
    if len(found.marks) < LEAST_MARKS:
        return None
    film = lying(certified_places(found.marks, camera.fiducials_mm), found.way)
    put = fit_similarity(film, places_of(found.marks), mirrored=True)
    if not isinstance(put, PlaneTransform):
        return None
    turned = float(np.degrees(small_turn(put) + area.turn)) if area.trusted else 0.0
    return _Laid(put.scale * pixel_mm - 1, turned)


def _doubted(scan: ScanFile, found: FiducialSet, laid: _Laid) -> FiducialSet:
    """The marks, with a doubt about each that has none."""
    told = {str(doubt.evidence["fiducial"]) for doubt in found.doubts}
    doubts = tuple(
        Doubt(
            "fiducial-unsure",
            photo_id_of(scan.path),
            say(
                "Fiducial {name}, at column {column:.1f}, row {row:.1f}, lies as certified only "
                "on a film enlarged by {share:.1f} % and turned by {turned:.1f}° against its "
                "border: what stands beside the marks lies so, too. Look whether this is its "
                "point.",
                name=mark.name,
                column=mark.column,
                row=mark.row,
                share=100 * laid.enlarged,
                turned=laid.turned_deg,
            ),
            evidence={"fiducial": mark.name, "column": mark.column, "row": mark.row},
        )
        for mark in found.marks
        if mark.name not in told
    )
    return replace(found, doubts=(*found.doubts, *doubts))


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
