"""What all tests share: real data beside the checkout, one BLAS thread, one tiny block."""

import os
import shutil
from pathlib import Path

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from app.cli import main
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from tests.tiny import Tiny, open_tiny, with_check_points

REPOSITORY = Path(__file__).resolve().parents[1]
LONG = ("real", "journeys")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files of minutes first, so that no worker waits at the end for the other's last one."""
    items.sort(key=lambda item: item.path.parent.name not in LONG)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real blocks; skipped plainly where it is not there."""
    folder = Path(os.environ.get("GRUBER_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real data not found at {folder}; set GRUBER_DATA")
    return folder


@pytest.fixture(scope="session")
def tiny_block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic block of six small scans, never written to."""
    folder = tmp_path_factory.mktemp("tiny") / "block"
    make_block(folder, SyntheticOptions("tiny"))
    return folder


@pytest.fixture(scope="session")
def tiny(tiny_block: Path) -> Tiny:
    """The tiny block at its true orientations."""
    return open_tiny(tiny_block)


@pytest.fixture(scope="session")
def tiny_run(tiny_block: Path, tmp_path_factory: pytest.TempPathFactory) -> Tiny:
    """A copy of the tiny block with check points, run once; whoever changes it puts it back."""
    folder = tmp_path_factory.mktemp("run") / "block"
    shutil.copytree(tiny_block, folder)
    copy = open_tiny(folder)
    with_check_points(copy)
    assert main(["run", str(folder)]) == 0
    return copy
