"""What all tests share: real data beside the checkout, one BLAS thread, one tiny block and its run."""

import os
from dataclasses import dataclass
from pathlib import Path

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from app.cli import main
from tests.tiny import Tiny, make_tiny, open_tiny

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real blocks; skipped plainly where it is not there."""
    folder = Path(os.environ.get("GRUBER_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real data not found at {folder}; set GRUBER_DATA")
    return folder


@pytest.fixture(scope="session")
def tiny_block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic block of six small scans, not yet run: only to be read."""
    folder = tmp_path_factory.mktemp("tiny") / "block"
    make_tiny(folder)
    return folder


@pytest.fixture(scope="session")
def tiny(tiny_block: Path) -> Tiny:
    """The tiny block at its true orientations."""
    return open_tiny(tiny_block)


@dataclass(frozen=True)
class TinyRun:
    """The tiny block after `gruber run`."""

    tiny: Tiny
    said: str

    @property
    def folder(self) -> Path:
        return self.tiny.folder

    @property
    def results(self) -> Path:
        return self.tiny.folder / "results"


@pytest.fixture(scope="session")
def tiny_run(tiny: Tiny, tmp_path_factory: pytest.TempPathFactory) -> TinyRun:
    """The tiny block run once; whoever changes it puts it back as it was."""
    log = tmp_path_factory.mktemp("log") / "run.txt"
    assert main(["run", str(tiny.folder), "--workers", "2"]) == 0
    return TinyRun(tiny, str(log))
