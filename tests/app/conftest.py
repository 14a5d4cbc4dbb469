"""An adjusted block with all that a report tells of."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio
from affine import Affine
from shapely.geometry import box

from app.report.model import ReportContent, Written
from core.adjustment.block_adjustment import adjust_block
from core.doubts import Doubt
from core.geometry.interior import InteriorOrientation
from core.mosaic.seam_fit import SeamFit
from core.mosaic.seams import Seam
from core.raster.holes import Hole
from sessions.decisions import Accept, Recorded, Reject, Withdraw
from tests.flights import FlightPlan, fly

MARKS = ("1", "2", "3", "4")


def with_fiducials(photo, rng):
    pixels = rng.uniform(0, 12000, (4, 2))
    residuals = rng.normal(0, 8, (4, 2))
    matrix = photo.interior.film_from_pixel_matrix
    return replace(
        photo, interior=InteriorOrientation("affine", matrix, MARKS, pixels, residuals, 11.2)
    )


@pytest.fixture(scope="session")
def flown():
    rng = np.random.default_rng(11)
    block = fly(FlightPlan(ties=400, control=36, check=12), rng).block
    photos = {name: with_fiducials(photo, rng) for name, photo in block.photos.items()}
    measurements = dict(block.measurements)
    for number, key in enumerate(list(measurements)[::9]):
        status = ("rejected", "unused", "dubious", "accepted")[number % 4]
        reason = "" if status == "accepted" else f'<b>{status}</b> & by the "test", no. {number}'
        measurements[key] = replace(measurements[key], status=status, reason=reason)
    return replace(block.with_photos(photos), measurements=measurements)


@pytest.fixture(scope="session")
def report(flown):
    return adjust_block(flown)


@pytest.fixture(scope="session")
def mosaic(report, tmp_path_factory):
    path = tmp_path_factory.mktemp("mosaic") / "mosaic.tif"
    centres = np.array([photo.exterior.centre[:2] for photo in report.block.photos.values()])
    (west, south), (east, north) = centres.min(axis=0) - 1200, centres.max(axis=0) + 1200
    rows, columns = int((north - south) / 10), int((east - west) / 10)
    waves = np.add.outer(np.sin(np.arange(rows) / 17), np.cos(np.arange(columns) / 23))
    values = np.clip(120 + 50 * waves, 1, 255).astype(np.uint8)
    values[:40, :60] = 0
    profile = {"width": columns, "height": rows, "count": 1, "dtype": "uint8", "nodata": 0}
    transform = Affine(10, 0, west, 0, -10, north)
    with rasterio.open(
        path, "w", driver="GTiff", crs="EPSG:5514", transform=transform, **profile
    ) as file:
        file.write(values, 1)
    return path


def decided(keys):
    """Two decisions that stand and one that was taken back."""
    made = [Accept(*keys[0]), Reject(*keys[1], "changed"), Accept(*keys[2]), Withdraw(3)]
    return [
        Recorded(number, f"2025-11-20T10:0{number - 1}:00+00:00", "anna", decision)
        for number, decision in enumerate(made, start=1)
    ]


@pytest.fixture(scope="session")
def content(flown, report, mosaic):
    with rasterio.open(mosaic) as file:
        west, south, east, north = file.bounds
    width, height = (east - west) / 3, (north - south) / 2
    names = list(report.block.photos)
    corners = [(west + k % 3 * width, south + k // 3 * height) for k in range(len(names))]
    seams = [
        Seam(name, "1938-07-09", box(x, y, x + width, y + height))
        for name, (x, y) in zip(names, corners, strict=True)
    ]
    return ReportContent(
        name="kobyli-1938 <script>",
        report=report,
        before=flown,
        heights="Bpv",
        doubts=[
            Doubt("fiducial-residual", names[0], "Fiducial 3 lies 41 µm off: a scratch?", 0.4),
            Doubt("control-two-peaks", "junction 118", "Two places in the scan look alike.", 0.9),
            Doubt("dem-gap", "dem.tif", "The DEM has a gap of 2 km² in the north.", 0.2),
        ],
        set_aside={"scan_07": "The file ends after 3 of 9 MB: copy it again."},
        reference_sigma_m=(0.25, 0.5),
        mosaic=mosaic,
        seams=seams,
        seam_fits=(
            SeamFit((names[0], names[1]), 812.0, 31, 2.4, 7.5, 29, (0.41, -0.12), 0.9),
            SeamFit(
                (names[1], names[2]),
                40.0,
                0,
                *[float("nan")] * 2,
                0,
                (float("nan"),) * 2,
                float("nan"),
            ),
        ),
        holes=(Hole(900.0, west + 500.0, south + 700.0), Hole(400.0, west + 900.0, south + 200.0)),
        written=Written("2025-11-21 01:02 UTC", "anna", "0.1.0"),
        decisions=decided(list(report.residuals_px)[:3]),
        timings_s={"scans": 3.2, "ties": 41.75, "adjustment": 0.4, "mosaic": 12.0},
        provenance={"digest of scans": "43fc7983d5516bae"},
    )
