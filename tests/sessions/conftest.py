"""A small block with everything in it, for the memory to remember."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentReport, CheckResult, ExteriorSigmas
from core.block import (
    Block,
    ExteriorPrior,
    Measurement,
    Peak,
    Photo,
    SurveyedPoint,
    TiePoints,
)
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

CAMERA = Camera("wide", 211.59, (180.0, 180.0), fiducials_mm={"1": (-84.5, 0.3), "2": (84.5, -0.2)})


def make_photo(photo_id: str, east: float) -> Photo:
    exterior = ExteriorOrientation(np.array([east, -1_043_000.0, 3000.0]), 0.01, -0.02, 1.5)
    matrix = np.array([[0.015, 0.0, -90.0], [0.0, -0.015, 90.0]])
    pixels = np.array([[366.7, 5980.0], [11633.3, 6013.3]])
    interior = InteriorOrientation(
        "affine", matrix, ("1", "2"), pixels, np.full((2, 2), 3.0), float("nan")
    )
    prior = ExteriorPrior(np.full(3, 50.0), np.full(3, 0.05))
    return Photo(
        photo_id,
        Path(f"scans/{photo_id}.tif"),
        (12000, 12000),
        "wide",
        interior,
        exterior,
        exterior,
        prior,
        250.0,
        oriented=True,
    )


@pytest.fixture
def block() -> Block:
    photos = {name: make_photo(name, -743_000.0 + 900 * n) for n, name in enumerate("AB")}
    surveyed = {
        name: SurveyedPoint(
            name,
            np.array([-743_000.0 + 100 * n, -1_043_050.0 - 70 * n, 250.0]),
            np.array([0.3, 0.3, 0.5]),
            "check" if n == 2 else "control",
            "junction",
        )
        for n, name in enumerate(("P1", "P2", "P3"))
    }
    measurements = {}
    for point_id, point in surveyed.items():
        for photo_id, photo in photos.items():
            column, row = (photo.pixel_from_object(point.position[None], CAMERA)[0] + 0.4).tolist()
            peaks = (
                Peak(column, row, 0.3, 9.0, "ncc"),
                Peak(column + 40, row - 12, 0.6, 7.0, "gradient"),
            )
            measurements[point_id, photo_id] = Measurement(
                point_id, photo_id, column, row, 0.3, 0.8, peaks=peaks
            )
    ties = TiePoints(
        ("A", "B"),
        np.array([0, 0, 1, 1]),
        np.array([0, 1, 0, 1]),
        np.full((4, 2), 100.25),
        np.full(4, 0.2),
    )
    return Block("EPSG:5514", {"wide": CAMERA}, photos, surveyed, measurements, ties)


@pytest.fixture
def report_of() -> Callable[[Block], AdjustmentReport]:
    return make_report


def make_report(block: Block) -> AdjustmentReport:
    used = [point for point in block.surveyed.values() if point.role == "control"]
    checks = [point for point in block.surveyed.values() if point.role == "check"]
    sigmas = ExteriorSigmas(np.full(3, 0.4), np.full(3, 1e-4))
    shift = np.array([0.1, -0.2, 0.3])
    return AdjustmentReport(
        block=block,
        sigma_nought=0.97,
        redundancy=12,
        iterations=5,
        converged=True,
        exterior_sigmas=dict.fromkeys(block.photos, sigmas),
        residuals_px=dict.fromkeys(block.measurements, (3.0, -4.0)),
        surveyed_positions={point.point_id: point.position + shift for point in used},
        surveyed_sigmas_m={point.point_id: np.full(3, 0.2) for point in used},
        redundancy_numbers=dict.fromkeys(block.measurements, 0.6),
        tie_positions=np.array([[1.0, 2.0, 3.0], [np.nan, np.nan, np.nan]]),
        tie_sigmas_m=np.full((2, 3), 0.3),
        tie_residuals_px=np.zeros((2, 2)),
        checks=tuple(CheckResult(p.point_id, p.position, -shift, 2) for p in checks),
        rms_px={"control": 0.5},
        rms_m={"control_X": 0.2},
        rejected={("P2", "B"): "residual of 9 sigma"},
    )
