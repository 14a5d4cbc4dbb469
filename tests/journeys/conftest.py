"""Copies of the tiny block for journeys that spoil, kill or change it."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from app.cli import main
from tests.conftest import made_once
from tests.journeys.copies import BlockCopy, copied

SCANS_PRODUCT = Path(".gruber", "products", "scans")


@pytest.fixture
def copy_of(
    tiny_block: Path, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., BlockCopy]:
    """Makes a copy with so many of the scans, measured but no more: a spoilt one is made again."""

    def make(scans: int) -> BlockCopy:
        def measure(folder: Path) -> None:
            copied(tiny_block, folder, scans)
            assert main(["run", str(folder), "--until", "scans"]) == 0

        copy = copied(tiny_block, tmp_path / "block", scans)
        measured = made_once(tmp_path_factory, f"tiny-scans-{scans}", measure)
        shutil.copytree(measured / SCANS_PRODUCT, copy.folder / SCANS_PRODUCT)
        return copy

    return make
