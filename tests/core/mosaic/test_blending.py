"""Tones beside seams, of orthos whose differences are known."""

import numpy as np
import pytest
import rasterio
import shapely

from core.mosaic.blending import CELL_PX, REACH_PX, WINDOWS
from core.mosaic.composition import MosaicOptions, compose_mosaic
from core.mosaic.drawing import FEATHER_PX
from core.mosaic.seams import Seam
from core.raster.grid import Grid
from tests.core.mosaic.conftest import write_ortho

GRID = Grid(1000.0, 5000.0, 1.0, 900, 700)
MIDDLE = 450
"""Column of the seam."""


@pytest.fixture(scope="module", params=["uint8", "uint16"])
def pair(request, tmp_path_factory):
    """Two orthos of the same ground: the second is brighter about the middle of the seam, and shows
    small marks that the first does not."""
    folder = tmp_path_factory.mktemp("pair")
    dtype = np.dtype(request.param)
    unit = 1 if dtype == np.uint8 else 257
    rng = np.random.default_rng(3)
    ground = 100 + 30 * np.kron(rng.uniform(-1, 1, (70, 90)), np.ones((10, 10)))
    rows, columns = np.mgrid[: GRID.rows, : GRID.columns]
    brighter = 10 * np.exp(-((rows - 350) ** 2 + (columns - MIDDLE) ** 2) / (2 * 80**2))
    marks = np.zeros(ground.shape)
    marks[::60, MIDDLE - 24] = 90
    shown = {"a": ground, "b": ground + brighter + marks}
    orthos = []
    for name, gray in shown.items():
        values = np.rint((gray + rng.normal(0, 3, ground.shape)) * unit).astype(dtype)
        nadir = (1200.0 if name == "a" else 1700.0, 4650.0)
        orthos.append(write_ortho(folder / f"{name}.tif", name, GRID, values, nadir))
    return orthos, ground, unit


def mosaic(pair, folder, **options):
    """The mosaic with a straight seam, in gray values of 255."""
    orthos, _, unit = pair
    middle = GRID.west + MIDDLE
    west, south, east, north = GRID.bounds
    seams = [
        Seam("a", "", shapely.box(west, south, middle, north)),
        Seam("b", "", shapely.box(middle, south, east, north)),
    ]
    path = folder / "m.tif"
    compose_mosaic(orthos, GRID, path, None, seams=seams, options=MosaicOptions(**options))
    with rasterio.open(path) as file:
        return file.read(1) / unit


def test_a_step_at_a_seam_is_drawn_out_into_a_slope__truth(pair, tmp_path):
    ground = pair[1]

    def step(values):
        beyond = values - ground
        left, right = (
            beyond[300:400, MIDDLE + side : MIDDLE + side + 16].mean()
            for side in (-FEATHER_PX - 16, FEATHER_PX)
        )
        return abs(left - right)

    before = step(mosaic(pair, tmp_path, feather_only=True))
    after = step(mosaic(pair, tmp_path))
    assert before > 5
    # The share of a photo in two means over the widest window, 16 pixels from the seam: the bump
    # of the second is somewhat narrower than what the window sees.
    half = CELL_PX * WINDOWS[-1]
    assert after == pytest.approx(before * (1 - (1 - 16 / half) ** 2), rel=0.2)


def test_nothing_changes_beyond_the_reach_of_a_seam__law(pair, tmp_path):
    before, after = mosaic(pair, tmp_path, feather_only=True), mosaic(pair, tmp_path)
    far = np.abs(np.arange(GRID.columns) - MIDDLE) > REACH_PX + FEATHER_PX
    assert np.array_equal(before[:, far], after[:, far])
    assert not np.array_equal(before, after)


def test_detail_of_one_photo_does_not_show_in_the_other__truth(pair, tmp_path):
    values, column = mosaic(pair, tmp_path), MIDDLE - 24
    beside = values[::60, [column - 2, column + 2]].mean() - pair[1][::60, column].mean()
    marks = values[::60, column].mean() - pair[1][::60, column].mean()
    # Grain of twelve marks has a mean of less than a gray value.
    assert abs(marks - beside) < 3


def test_untouched_tones_stay_untouched_beside_seams__law(pair, tmp_path):
    values = mosaic(pair, tmp_path, balance=False)
    shown = []
    for ortho in pair[0]:
        with rasterio.open(ortho.path) as file:
            shown.append(file.read(1) / pair[2])
    half = FEATHER_PX // 2
    assert np.array_equal(values[:, : MIDDLE - half], shown[0][:, : MIDDLE - half])
    assert np.array_equal(values[:, MIDDLE + half :], shown[1][:, MIDDLE + half :])
