"""Four real frames of the NGI: oriented from blurred positions and Sentinel-2 alone."""

import sys
from pathlib import Path

import numpy as np
import pytest

from core.mosaic.comparison import compare_orthos
from tests.real.blocks import ngi_block, ngi_published, run_block


def test_ngi_is_oriented_on_sentinel_without_angles__real(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ngi_block(shared_data, tmp_path / "ngi", seed=1)
    report = run_block(folder)
    photos = report.block.photos
    assert all(photo.oriented for photo in photos.values())
    sheets = sorted((shared_data / "ngi-baviaanskloof/orthos-5m").glob("ngi_rgb_byte_?.tif"))
    shifts = [compare_orthos(folder / "results/mosaic.tif", sheet).median_shift for sheet in sheets]
    reference = [compare_orthos(folder / "ortho.tif", sheet).median_shift for sheet in sheets]
    away = [
        np.linalg.norm(
            photos[row["filename"]].exterior.centre - [float(row[axis]) for axis in "xyz"]
        )
        for row in ngi_published(shared_data)
    ]
    told = (
        f"NGI: mosaic against published orthos, median shifts {np.round(shifts, 1).tolist()} m",
        f"NGI: Sentinel-2 against published orthos {np.round(reference, 1).tolist()} m",
        f"NGI: positions against published ones {np.round(away, 1).tolist()} m",
    )
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(told) + "\n")
    # Sentinel-2 itself lies some (3.5, 4.0) m beside the published orthos; we follow it, and
    # half of one of its 10 m pixels is the bound that was promised.
    assert np.all(np.abs(np.median(shifts, axis=0)) <= 5.0)
    assert np.all(np.abs(np.median(np.subtract(shifts, reference), axis=0)) <= 2.0)
    # 25 m are 4 pixels of these 5.6 m frames: the blur was 200 m a coordinate.
    assert max(away) <= 25.0
