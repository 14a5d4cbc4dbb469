"""What is doubtful about a fitted interior orientation, in words (METHODS 2)."""

from collections.abc import Iterator, Sequence

import numpy as np

from core.doubts import Doubt
from core.geometry.interior import InteriorOrientation, limit_um
from core.scans.duplicate_scans import turned_words
from core.scans.layouts import UPRIGHT, Way
from core.scans.measured_marks import FiducialMeasurement

AFFINITY = 2e-4
"""Difference of the film's scales in x and y that is worth a word."""
SCALE_OFF = 3e-3
"""Difference of the film's scale from the nominal that film alone does not explain."""


def doubts_of_fit(
    photo_id: str,
    interior: InteriorOrientation,
    marks: Sequence[FiducialMeasurement],
    pixel_mm: float,
) -> tuple[Doubt, ...]:
    """Marks left out, large residuals, no redundancy, odd scale, irregular film, the wrong side.

    Args:
        photo_id: The photo.
        interior: Its interior orientation.
        marks: All marks that were measured.
        pixel_mm: Nominal size of a scan pixel, millimetres.
    """
    return (
        *_of_marks(photo_id, interior, marks),
        *_of_film(photo_id, interior, pixel_mm),
    )


def names_guessed(photo_id: str, way: Way) -> Doubt:
    """The doubt of a scan whose marks fit their certificate in several ways to lie.

    Args:
        photo_id: The photo.
        way: The way that was taken.
    """
    words = "upright" if way == UPRIGHT else turned_words(way)
    return Doubt(
        "fiducial-names",
        photo_id,
        "The certificate hardly tells which fiducial is which: the marks fit it in several ways, "
        f"and the scan was taken to be {words}. Compare it with its neighbours, or give the "
        "camera's data_strip.",
        evidence={"quarter_turns": way[0], "mirrored": way[1]},
    )


def _of_marks(
    photo_id: str, interior: InteriorOrientation, marks: Sequence[FiducialMeasurement]
) -> Iterator[Doubt]:
    """Whether the marks carry the fit."""
    left_out = [mark.name for mark in marks if mark.name not in interior.names]
    if left_out:
        yield Doubt(
            "fiducial-left-out",
            photo_id,
            f"Fiducial {', '.join(left_out)} does not lie where the others put it and was left "
            "out. Look whether it is the mark, and whether its certified place is right.",
            evidence={"fiducials": left_out},
        )
    if len(interior.names) < 3:
        yield Doubt(
            "fiducials-few",
            photo_id,
            "Only two fiducials were measured: nothing checks them. Measure a third by hand.",
            evidence={"fiducials": list(interior.names)},
        )
    if interior.rms_um > limit_um(interior.pixel_size_mm) / 2:
        yield Doubt(
            "fiducial-residual",
            photo_id,
            f"The fiducials fit their certificate with {interior.rms_um:.0f} um RMS, more than "
            "their measurement explains.",
            evidence={"rms_um": interior.rms_um, "chance": interior.chance},
        )


def _of_film(photo_id: str, interior: InteriorOrientation, pixel_mm: float) -> Iterator[Doubt]:
    """Whether the film looks like one of this camera."""
    if interior.mirrored:
        yield Doubt(
            "scan-mirrored",
            photo_id,
            "The film was scanned from its back: its marks lie as in a mirror. The interior "
            "orientation takes that up, but matching wants it the right way round: mirror the "
            "scan, or scan the film again.",
            evidence={"model": interior.model},
        )
    scale = interior.pixel_size_mm / pixel_mm - 1
    if abs(scale) > SCALE_OFF:
        yield Doubt(
            "fiducials-scale",
            photo_id,
            f"The fiducials lie {abs(100 * scale):.2f} % too "
            f"{'close' if scale > 0 else 'far apart'} for scan_pixel_um: a print, a wrong "
            "scan_pixel_um, or another camera.",
            evidence={"scale": scale},
        )
    affinity = _affinity(interior)
    if interior.model != "similarity" and affinity > AFFINITY:
        yield Doubt(
            "film-shrinkage",
            photo_id,
            f"The film or the scanner is not true to shape: scales differ by {affinity:.1e}. "
            "The affine interior orientation takes this up.",
            evidence={"affinity": affinity},
        )


def _affinity(interior: InteriorOrientation) -> float:
    """Largest over smallest scale of the transform, minus one."""
    singular = np.linalg.svd(interior.film_from_pixel_matrix[:, :2], compute_uv=False)
    return float(singular[0] / singular[1] - 1)
