"""Four real frames without roads: is there enough right control on Sentinel-2 alone?

The published orientations say where on the ground each measurement truly lies. Sentinel-2 itself
lies a few metres beside them everywhere; that common shift is taken off, and a measurement is right
when it then lies within one pixel of Sentinel-2, 10 m. Ends with 1 when a frame has fewer than 15.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from app.settings import Settings
from core.matching.patches import object_on_ground
from core.raster.dem import open_dem
from sessions.session import Session
from tests.benchmarks.control_blocks import quietly
from tests.core.ties.ngi import ngi_block as published_block
from tests.real.blocks import ngi_block

NEAR_M, LEAST = 10.0, 15


def main() -> int:
    """Run the block up to its control, and judge every measurement in use."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with ngi-baviaanskloof")
    parser.add_argument("--seed", type=int, default=1, help="of the blurred positions")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = ngi_block(given.data, Path(made) / "ngi", given.seed)
        workers = str(Settings().workers)
        assert quietly("run", str(folder), "--until", "control", "--workers", workers) == 0
        with Session.open(folder, "prover") as session:
            block = session.products.latest_value("control").report.block
        published = published_block(given.data / "ngi-baviaanskloof")[1]
        dem = open_dem([folder / "dem.tif"], published.crs)
        camera = next(iter(published.cameras.values()))
        used = [value for value in block.measurements.values() if value.used]
        off = np.array(
            [
                object_on_ground(published.photos[value.photo_id], camera, value.pixel, dem)[0, :2]
                - block.surveyed[value.point_id].position[:2]
                for value in used
            ]
        ).reshape(-1, 2)
    common = np.nanmedian(off, axis=0) if len(off) else np.zeros(2)
    away = np.hypot(*(off - common).T)
    enough = True
    for photo_id in sorted(block.photos):
        own = np.array([value.photo_id == photo_id for value in used], dtype=bool)
        right = int(np.count_nonzero(away[own] <= NEAR_M))
        enough &= right >= LEAST
        sys.stdout.write(f"{photo_id}: {right} right of {int(own.sum())} in use\n")
    sys.stdout.write(
        f"common shift {common.round(1).tolist()} m, "
        f"median distance after it {float(np.median(away)) if len(away) else np.nan:.1f} m\n"
    )
    return 0 if enough else 1


if __name__ == "__main__":
    sys.exit(main())
