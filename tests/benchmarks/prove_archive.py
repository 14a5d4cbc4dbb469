"""What an archive of half a million frames would take: hours of a core, memory and disk.

One synthetic block of six frames goes through the whole of `gruber run` with one worker, in a
process of its own. Its processor time and what it leaves on the disk are multiplied. Time by the
clock is not used: it depends on who else is at work.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import rasterio

from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions

FRAMES = 500_000
CORES = 400
MADE = ("results", ".gruber", "session.gpkg")


def size_of(place: Path) -> int:
    """Bytes of a file, or of all files below a folder."""
    files = place.rglob("*") if place.is_dir() else (place,)
    return sum(path.stat().st_size for path in files if path.is_file())


def main() -> None:
    """Run a block of each size, print a row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", nargs="+", default=["tiny", "small"])
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    sys.stdout.write(
        "| scans | processor s a frame | peak GiB | MB a frame | core hours | "
        f"days on {CORES} cores | TB |\n|---|---|---|---|---|---|---|\n"
    )
    for size in given.sizes:
        with tempfile.TemporaryDirectory(prefix="archive-") as room:
            block = Path(room) / "block"
            make_block(block, SyntheticOptions(size, seed=given.seed))
            scans = sorted((block / "scans").glob("*.tif"))
            words = [sys.executable, "-m", "gruber", "run", str(block), "--workers", "1"]
            child = subprocess.Popen(words, stdout=subprocess.DEVNULL)
            _, status, used = os.wait4(child.pid, 0)
            assert os.waitstatus_to_exitcode(status) == 0, block
            seconds = (used.ru_utime + used.ru_stime) / len(scans)
            hours = seconds * FRAMES / 3600
            megabytes = sum(size_of(block / name) for name in MADE) / 1e6 / len(scans)
            with rasterio.open(scans[0]) as scan:
                side = max(scan.width, scan.height)
            row = (
                f"{side:,} px", f"{seconds:.0f}", f"{used.ru_maxrss / 2**20:.1f}",
                f"{megabytes:.0f}", f"{hours:,.0f}", f"{hours / CORES / 24:.1f}",
                f"{megabytes * FRAMES / 1e6:.0f}",
            )  # fmt: skip
            sys.stdout.write(f"| {' | '.join(row)} |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
