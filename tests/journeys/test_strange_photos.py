"""Photos that do not belong: they are set aside and said so, and do not disturb the others."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rasterio

from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from tests.journeys.copies import BlockCopy, run_alone


def test_a_photo_from_elsewhere_is_left_out_and_told__truth(
    copy_of: Callable[..., BlockCopy], tmp_path: Path
) -> None:
    """A frame of another valley under the name of this one's third photo."""
    make_block(tmp_path / "other", SyntheticOptions("tiny", seed=77))
    foreign = sorted((tmp_path / "other" / "scans").glob("*.tif"))[2]
    copy = copy_of(3)
    strange = copy.scans[2]
    copy.replace(strange, foreign.read_bytes())
    shutil.rmtree(tmp_path / "other")
    told = run_alone("run", copy.folder)
    assert told.code == 0, told.err
    report = copy.report()
    standing = {row["scan"]: row["oriented"] for row in report["exterior"]}
    assert standing == {scan.stem: scan != strange for scan in copy.scans}
    assert [d for d in report["doubts"] if d["subject"] == strange.stem and d["gravity"] >= 0.8]
    assert all(row["scan"] != strange.stem for row in report["control"].get("left_out", []))


def test_a_photo_scanned_twice_is_told__truth(
    copy_of: Callable[..., BlockCopy],
) -> None:
    """The second scan turned by a quarter, fainter and with noise of its own, its place unknown."""
    copy = copy_of(3)
    first, again = copy.scans[1:]
    with rasterio.open(first) as scan:
        grey, profile = scan.read(), scan.profile
    noise = np.random.default_rng(1).normal(0, 3, grey.shape)
    faint = np.rot90(np.clip(0.8 * grey + 20 + noise, 0, 255).astype(np.uint8), axes=(1, 2))
    again.unlink()
    with rasterio.open(again, "w", **profile) as scan:
        scan.write(faint)
    told = run_alone("run", copy.folder, "--until", "ties")
    assert told.code == 0, told.err
    assert f"{first.stem} and {again.stem} are scans of one photo" in told.out
