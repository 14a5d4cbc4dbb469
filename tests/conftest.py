"""What all tests share: the real data beside the checkout, and one BLAS thread."""

import os
from pathlib import Path

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real blocks; skipped plainly where it is not there."""
    folder = Path(os.environ.get("GRUBER_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real data not found at {folder}; set GRUBER_DATA")
    return folder
