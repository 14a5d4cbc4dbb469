"""Pairs clicked at the desk: a decision handed in, or a world file; nothing beside the scan."""

from pathlib import Path

import numpy as np
import pytest

from app.desk.messages import Measured
from app.desk.placing import DeskClicking
from app.placing import Placeable
from app.running import Running
from core.errors import ScanError
from core.formats.world_file import read_world_file
from core.geometry.interior import InteriorOrientation
from core.georeference.archive import Georeference
from core.matching.reference import Reference, ReferenceFiles
from core.raster.scan_file import ScanFile, ScanFiles
from core.results import BlockInput
from core.scans.film_area import FilmArea
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet
from sessions.decisions import PlacePhoto
from sessions.session import Session
from tests.tiny import Tiny
from ui.web.tiles import ScanTiles

TURN = np.array([[1.2, 0.3, 500_000.0], [0.25, -1.1, 5_000_000.0]])
PIXELS = np.array([[100.0, 100.0], [900.0, 150.0], [850.0, 900.0], [120.0, 880.0]])


@pytest.fixture
def hand(tmp_path: Path, tiny: Tiny) -> tuple[DeskClicking, list[Measured]]:
    matrix = np.array([[0.1, 0.0, -50.0], [0.0, -0.1, 50.0]])
    none = np.zeros((0, 2))
    interior = InteriorOrientation("affine", matrix, (), none, none, float("nan"))
    path = tmp_path / "scans" / "A.tif"
    path.parent.mkdir()
    scan = ScanOrientation(
        "A", ScanFile(path, (1000, 1000), 1, "uint8"), interior, (),
        FilmArea(np.zeros((4, 2)), (), np.zeros(4)), (),
    )  # fmt: skip
    given = BlockInput("b", {}, (), Georeference(), ReferenceFiles("EPSG:5514", (), ()))
    reference: Reference = tiny.reference
    found = Placeable(given, ScanSet({"A": scan}, {}, ()), reference)
    handed: list[Measured] = []
    tiles = ScanTiles(ScanFiles())
    running = Running(tmp_path / "block.toml")
    return DeskClicking(found, tmp_path, running, tiles, handed.append), handed


def pairs(count: int) -> list[tuple[float, float, float, float]]:
    ground = PIXELS @ TURN[:, :2].T + TURN[:, 2]
    rows = np.column_stack([PIXELS, ground])[:count].tolist()
    return [(a, b, c, d) for a, b, c, d in rows]


def test_what_is_saved_is_handed_in_as_a_decision__law(
    hand: tuple[DeskClicking, list[Measured]], tmp_path: Path
) -> None:
    clicking, handed = hand
    clicking.save("A", pairs(3), "seat")
    assert [item.decision for item in handed] == [PlacePhoto("A", tuple(pairs(3)))]
    assert handed[0].seat_id == "seat"
    assert clicking.save("A", [], "seat")["saved"] == ""
    assert not list((tmp_path / "scans").iterdir())
    with pytest.raises(ScanError):
        clicking.save("A", pairs(1), "seat")
    assert len(handed) == 2
    # What stands already is no decision more.
    with Session.open(tmp_path, "anna") as session:
        session.record(PlacePhoto("A", tuple(pairs(3))))
    assert clicking.save("A", pairs(3), "seat")["saved"] == "A"
    assert len(handed) == 2


def test_the_affine_world_file_says_what_was_put_in__truth(
    hand: tuple[DeskClicking, list[Measured]], tmp_path: Path
) -> None:
    clicking, _ = hand
    fit = clicking.fitted("A", pairs(4))
    assert fit["affine"]["rms"] == 0
    assert fit["rms"] > 5
    assert clicking.fitted("A", pairs(3))["affine"]["rms"] is None
    written = clicking.world_file("A", pairs(4), "affine")["written"]
    assert np.allclose(read_world_file(tmp_path / written).object_from_pixel, TURN, atol=1e-5)
    with pytest.raises(ScanError):
        clicking.world_file("A", pairs(2), "affine")
