"""Copies of the tiny block for journeys that spoil, kill or change it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.journeys.copies import BlockCopy, copied


@pytest.fixture
def copy_of(tiny_block: Path, tmp_path: Path) -> Callable[..., BlockCopy]:
    """Makes a copy with so many of the scans, not yet run."""

    def make(scans: int = 6, name: str = "block") -> BlockCopy:
        return copied(tiny_block, tmp_path / name, scans)

    return make
