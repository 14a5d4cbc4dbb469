"""Gains and offsets that were put in are found again."""

import numpy as np
import pytest

from core.mosaic.overview import read_overview
from core.mosaic.radiometry import balance_orthos
from core.raster.grid import Grid
from tests.core.mosaic.conftest import write_ortho


def test_gains_and_offsets_are_found_again__truth(block):
    found = balance_orthos([read_overview(ortho, 4) for ortho in block])
    put_in = {"a": (1.0, 0), "b": (0.8, 25), "c": (1.1, -20), "d": (0.9, 5)}
    gains = [found[name].gain * gain for name, (gain, _) in put_in.items()]
    offsets = [found[name].gain * off + found[name].offset for name, (_, off) in put_in.items()]
    assert np.ptp(gains) < 0.01
    assert np.ptp(offsets) < 1.0
    assert np.mean([balance.gain for balance in found.values()]) == pytest.approx(1, abs=1e-4)


def test_changed_fields_do_not_bend_the_balance__truth(tmp_path):
    rng = np.random.default_rng(2)
    grid = Grid.over((0.0, 0.0, 640.0, 640.0), 1.0)
    scene = np.kron(rng.uniform(40, 200, (40, 40)), np.ones((16, 16)))
    other = scene * 0.7 + 30
    other[:160] = np.kron(rng.uniform(40, 200, (10, 40)), np.ones((16, 16)))
    views = [
        read_overview(
            write_ortho(tmp_path / f"{k}.tif", k, grid, v.astype(np.uint8), (0.0, 0.0)), 16
        )
        for k, v in (("a", scene), ("b", other))
    ]
    found = balance_orthos(views)
    assert found["b"].gain * 0.7 == pytest.approx(found["a"].gain, rel=0.02)
