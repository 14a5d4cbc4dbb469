"""Photos that do not belong: they are set aside and said so, and do not disturb the others."""

from pathlib import Path

import numpy as np
import rasterio

from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from tests.journeys.copies import copied, run_alone


def test_photos_from_elsewhere_and_scanned_twice_are_told_and_disturb_nobody__truth(
    tiny_block: Path, tmp_path: Path
) -> None:
    """One frame is of another valley, one the second scan of a neighbour, its place unknown."""
    copy = copied(tiny_block, tmp_path / "block", 4)
    first, twice, foreign, again = copy.scans
    make_block(tmp_path / "other", SyntheticOptions("tiny", seed=77, strips=1, photos_per_strip=1))
    (elsewhere,) = (tmp_path / "other" / "scans").glob("*.tif")
    copy.replace(foreign, elsewhere.read_bytes())
    scan_again(twice, again)
    told = run_alone("run", copy.folder)
    assert told.code == 0, told.err
    assert f"{twice.stem} and {again.stem} are scans of one photo" in told.out
    report = copy.report()
    standing = {row["scan"]: row["oriented"] for row in report["exterior"]}
    assert (standing[first.stem], standing[twice.stem]) == (True, True)
    assert not standing[foreign.stem]
    assert [d for d in report["doubts"] if d["subject"] == foreign.stem and d["gravity"] >= 0.8]
    assert all(row["scan"] != foreign.stem for row in report["control"].get("left_out", []))


def scan_again(first: Path, again: Path) -> None:
    """The same photo turned by a quarter, fainter and with noise of its own."""
    with rasterio.open(first) as scan:
        grey, profile = scan.read(), scan.profile
    noise = np.random.default_rng(1).normal(0, 3, grey.shape)
    faint = np.rot90(np.clip(0.8 * grey + 20 + noise, 0, 255).astype(np.uint8), axes=(1, 2))
    again.unlink()
    with rasterio.open(again, "w", **profile) as scan:
        scan.write(faint)
