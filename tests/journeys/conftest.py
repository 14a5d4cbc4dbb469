"""One tiny synthetic block for all journeys; each test works on a copy of it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from core.progress import Silent
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from tests.journeys.copies import BlockCopy, copied


@pytest.fixture(scope="session")
def tiny_block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic block of six small scans, never written to."""
    folder = tmp_path_factory.mktemp("tiny") / "block"
    make_block(folder, SyntheticOptions("tiny"), Silent())
    return folder


@pytest.fixture
def copy_of(tiny_block: Path, tmp_path: Path) -> Callable[..., BlockCopy]:
    """Makes a copy with so many of the scans."""

    def make(scans: int = 6, name: str = "block") -> BlockCopy:
        return copied(tiny_block, tmp_path / name, scans)

    return make
