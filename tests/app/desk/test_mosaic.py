"""The mosaic on disk as the desk shows it: another version is another picture."""

from pathlib import Path

import numpy as np
import pytest

from app.desk.mosaic import MosaicFile, mosaic_on_disk
from core.mosaic.composition import MosaicProduct
from core.raster.grid import Grid
from sessions.session import Session
from tests.core.mosaic.conftest import CRS, write_ortho

GRID = Grid.over((500000.0, 5500000.0, 500200.0, 5500150.0), 1.0)


def write(path: Path, values: np.ndarray) -> None:
    write_ortho(path, "m", GRID, values, (500100.0, 5500100.0))


def test_what_was_made_last_is_shown_while_its_file_is_there__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "anna") as session:
        assert mosaic_on_disk(session) is None
        path = session.results / "mosaic.tif"
        product = MosaicProduct(path, GRID, (), {}, 1.0)
        session.products.save_value("mosaic", session.products.digest_of("m"), product)
        assert mosaic_on_disk(session) is None
        write(path, np.full((150, 200), 90, np.uint8))
        shown = mosaic_on_disk(session)
        assert shown is not None
        assert shown.version == path.stat().st_mtime_ns // 1_000_000


def test_a_newer_version_is_read_from_the_newer_file__law(tmp_path: Path) -> None:
    path = tmp_path / "mosaic.tif"
    mosaic = MosaicFile(path, CRS)
    assert mosaic(1) is None
    write(path, np.full((150, 200), 90, np.uint8))
    first = mosaic(1)
    assert first is not None
    assert np.unique(first.read_colour(GRID)).tolist() == [90]
    path.unlink()
    write(path, np.full((150, 200), 140, np.uint8))
    second = mosaic(2)
    assert second is not None
    assert np.unique(second.read_colour(GRID)).tolist() == [140]
    assert mosaic(2) is second


def test_sixteen_bits_are_brought_to_the_grays_of_a_screen_and_stay_clear__truth(
    tmp_path: Path,
) -> None:
    values = np.linspace(900, 9000, 150 * 200).reshape(150, 200).astype(np.uint16)
    values[:40, :50] = 0
    path = tmp_path / "mosaic.tif"
    write(path, values)
    source = MosaicFile(path, CRS)(1)
    assert source is not None
    assert source.ground_sample_distance_m == 1.0
    assert source.bounds == pytest.approx(GRID.bounds)
    colour = source.read_colour(GRID)
    # Interpolation reaches two pixels over the edge.
    assert not colour[:36, :46].any()
    shown = colour[44:, 54:, 0].astype(float)
    assert shown.min() >= 1
    expected = 255 * (values[44:, 54:] - 900.0) / 8100
    # Half a per cent at either end is cut off.
    assert np.abs(shown - expected).max() < 8
