"""Two RC30 film photos: each resected by itself against its published resection."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.adjusted import AdjustmentOptions
from core.block.adjustment import adjust_block
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
