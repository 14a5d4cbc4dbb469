"""Tie points as a list of measurements, kept with blocks of other programs."""

from collections.abc import Container
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.exchange import ExchangeTies
from core.formats.measurement_list import HEAD, read_measurement_list, tie_rows, ties_of_rows
from core.formats.records import scan_stem, write_rows

REMEDY = "Bring it in with gruber import BLOCK --from measurements FILE."
USUAL_SIGMA_PX = 0.5  # design: what feature matching leaves; variance components tell more.
"""Standard deviation per axis of a ray whose program says none."""


def write_ties(path: Path, ties: ExchangeTies) -> None:
    """Write every ray, numbers with all their digits."""
    write_rows(path, [HEAD, *tie_rows(ties, frozenset())])


def read_ties(path: Path, photos: Container[str]) -> ExchangeTies:
    """Rays in the photos that are there, of points that two of them see.

    Raises:
        ProjectError: It cannot be read, lacks a column, holds fiducials, or a number in it is none.
    """
    found = read_measurement_list(path)
    if found.fiducials:
        raise ProjectError(path, "holds fiducials, and no tie points.", REMEDY)

    def photo_of(scan: str) -> str:
        return scan if scan in photos else scan_stem(scan)

    ties = ties_of_rows([row for row in found.rows if photo_of(row.scan) in photos], photo_of)
    assert ties.sigma_px is not None, "a list gives every ray one, or NaN"
    sigmas = np.where(np.isfinite(ties.sigma_px), ties.sigma_px, USUAL_SIGMA_PX)
    return replace(ties, sigma_px=sigmas)
