"""The tiny desk, and somebody who has just sat down at it; a module may have another one."""

import pytest

from tests.ui.desk_block import tiny_snapshot
from ui.review.queue import seat_down
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Seat


@pytest.fixture(scope="session")
def desk() -> DeskSnapshot:
    return tiny_snapshot()


@pytest.fixture
def seat(desk: DeskSnapshot) -> Seat:
    return seat_down(Seat("seat-1", "anna"), desk.rows)
