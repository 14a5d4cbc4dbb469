"""Demo blocks of several seeds against their truth, each a whole `gruber demo`.

Run: python -m tests.benchmarks.prove_demo SEED...
"""

import contextlib
import io
import re
import sys
import tempfile
from pathlib import Path

from app.cli import main as gruber

FIGURES = (
    r"photos oriented +(.+)",
    r"mosaic m_p +([\d.]+ m)",
    r"control measurements +(\d+) used",
    r"used, ([\d.]+ %) wrong",
    r"(?m)^ *sigma nought +([\d.]+)",
)
"""What the demo prints of each figure."""


def figures(printed: str) -> list[str]:
    """The cells of one demo, from what it printed."""
    found = (re.search(pattern, printed) for pattern in FIGURES)
    return [match[1].strip() if match else "none" for match in found]


def main() -> int:
    """Print a row for each seed; 1 when a demo fails."""
    failed = False
    sys.stdout.write("| seed | oriented | mosaic m_p | control used | wrong | sigma nought |\n")
    sys.stdout.write("|---|---|---|---|---|---|\n")
    for seed in sys.argv[1:] or ["1"]:
        printed = io.StringIO()
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(printed):
            out = str(Path(folder) / "demo")
            code = gruber(["demo", "--headless", "--seed", seed, "--out", out])
        failed |= code != 0
        sys.stdout.write(f"| {seed} | " + " | ".join(figures(printed.getvalue())) + " |\n")
        sys.stdout.flush()
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
