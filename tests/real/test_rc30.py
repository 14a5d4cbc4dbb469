"""Two RC30 film photos: each resected by itself against its published resection."""

import re
from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.geometry.interior import InteriorOrientation, fit_interior
from tests.real.readers import RC30, read_rc30, read_rc30_orientation

PLAIN = AdjustmentOptions(estimate_cameras=False, robust=False)


@pytest.mark.parametrize("name", ["62", "63"])
def test_resections_as_published__real(shared_data, name):
    known = read_rc30_orientation(shared_data / RC30)[name]
    report = adjust_block(read_rc30(shared_data / RC30), PLAIN)
    ours = report.block.photos[name].exterior
    assert report.converged
    # Published to 0.1 mm (62) and 1 mm (63), angles to 1e-4 and 1e-5 degrees.
    assert np.abs(ours.centre - known.centre).max() < 1e-3
    for angle in ("omega", "phi", "kappa"):
        assert abs(np.degrees(getattr(ours, angle) - getattr(known, angle))) < 1e-4


def test_the_poor_pick_is_found__real(shared_data):
    # 20501 on photo 63 lies 35 micrometres off; the others 9 on average.
    block = read_rc30(shared_data / RC30)
    free = {key: replace(m, status="auto") for key, m in block.measurements.items()}
    report = adjust_block(
        replace(block, measurements=free), AdjustmentOptions(estimate_cameras=False)
    )
    assert set(report.rejected) == {("20501", "63")}


@pytest.mark.parametrize("name", ["62", "63"])
def test_interior_residuals_are_those_of_its_program__real(shared_data, name):
    """Eight fiducials, an affine; the program prints residuals (measured - computed) to 0.1 px."""
    folder = shared_data / RC30
    printed = re.findall(
        r"Solution v \(pixel\) =+\n(.*?)=====", (folder / "Result.txt").read_text(), re.DOTALL
    )[["62", "63"].index(name)]
    theirs = np.array(re.findall(r"-?\d+\.\d*", printed), dtype=float).reshape(-1, 2)
    marks = np.loadtxt(folder / f"{name}_affine.csv", delimiter=",", usecols=(1, 2, 3, 4))
    pixels = marks[:, :2] * np.array([1.0, -1.0])
    names = [str(i) for i in range(len(marks))]
    interior = fit_interior(names, pixels, marks[:, 2:], "affine")
    assert isinstance(interior, InteriorOrientation)
    ours = -interior.residuals_um / (1000 * interior.pixel_size_mm)
    assert 1000 * interior.pixel_size_mm * np.abs(ours - theirs).max() < 1.0
