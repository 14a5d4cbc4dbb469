"""The same block run twice, and by one worker and two: is every byte of what it makes the same?

Copies of one synthetic block go through the whole of `gruber run`, one after the other in the same
place. Compared are all files under results (tables, protocol, orthos, mosaic, layers), what is kept
of every stage, and the layers of the session file table by table. Times are left out: in the report
(`report.html` is drawn from `report.json`) when it was written, the seconds of the stages and the
digests they bear; `last_change` in the session file; and what is kept of seconds and of rasters,
whose digests hold the time of the raster.
Ends with 1 when anything differs.
"""

import argparse
import hashlib
import json
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions

RUNS = {"one worker": 1, "one worker again": 1, "two workers": 2}
TIMES = ("last_change",)
"""Columns that tell when something was written."""
OF_TIMES = ("timings_s", "written", "provenance")
"""Parts of the report that tell when and how long."""
KEPT_WITH_TIMES = ("times", "walked", "mosaic", "mosaic-tiles")
"""Products that hold seconds, or digests of rasters."""


def digest(data: bytes) -> str:
    """What stands for the bytes."""
    return hashlib.sha256(data).hexdigest()


def layers(path: Path) -> dict[str, str]:
    """Every table of a session file, without times of writing."""
    found: dict[str, str] = {}
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as base:
        names = "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
        for (name,) in base.execute(names).fetchall():
            columns = [row[1] for row in base.execute(f'PRAGMA table_info("{name}")')]
            kept = ", ".join(f'"{column}"' for column in columns if column not in TIMES)
            rows = base.execute(f'SELECT {kept} FROM "{name}"').fetchall() if kept else []
            found[f"{path.name}: {name}"] = digest(repr(rows).encode())
    return found


def report_without_times(path: Path) -> str:
    """The figures of the report less the seconds of the stages."""
    figures = json.loads(path.read_text(encoding="utf-8"))
    kept = {name: value for name, value in figures.items() if name not in OF_TIMES}
    return digest(json.dumps(kept, sort_keys=True).encode())


def everything(folder: Path) -> dict[str, str]:
    """Digest of all that a run made, by name."""
    results, products = folder / "results", folder / ".gruber" / "products"
    files = [path for path in sorted(results.rglob("*")) if path.is_file()]
    found = {
        str(path.relative_to(folder)): digest(path.read_bytes())
        for path in files
        if path.name not in ("report.html", "report.json")
    }
    found["results/report.json"] = report_without_times(results / "report.json")
    kept = (path for path in products.rglob("*.value") if path.parent.name not in KEPT_WITH_TIMES)
    for path in sorted(kept):
        found[str(path.parent.relative_to(folder))] = digest(path.read_bytes())
    return found | layers(folder / "session.gpkg")


def ran(source: Path, folder: Path, workers: int) -> dict[str, str]:
    """A copy of a block taken through the whole run, in a process of its own."""
    shutil.copytree(source, folder)
    words = [sys.executable, "-m", "gruber", "run", str(folder), "--workers", str(workers)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stdout + done.stderr)
    return everything(folder)


def differing(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    """Names of what differs, or is in one alone."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def main() -> int:
    """Run the copies, print what differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="tiny", choices=("tiny", "small"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where the copies are kept")
    given = parser.parse_args()
    root = given.folder or Path(tempfile.mkdtemp(prefix="same-"))
    make_block(root / "made", SyntheticOptions(given.size, seed=given.seed))
    first: dict[str, str] = {}
    broken = 0
    for number, (name, workers) in enumerate(RUNS.items()):
        found = ran(root / "made", root / "block", workers)
        (root / "block").rename(root / f"run{number}")
        first = first or found
        apart = differing(first, found)
        broken += len(apart)
        sys.stdout.write(f"{name}: {len(found)} files and tables, {len(apart)} differ\n")
        for path in apart:
            sys.stdout.write(f"  {path}\n")
        sys.stdout.flush()
    if given.folder is None:
        shutil.rmtree(root)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
