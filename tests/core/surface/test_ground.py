"""Which ground is chosen where it has changed, and where only houses and woods stand on it."""

import numpy as np
import pytest
import rasterio

from core.raster.grid import Grid, tiled_profile
from core.surface.ground import Ground, choose_ground, read_ground

CELL_M = 1.0
GRID = Grid(1000.0, 5000.0, CELL_M, 400, 300)
SIGMA_M = 0.4


class Level:
    """A DEM at one height."""

    ground_sample_distance_m = 2.0

    def heights(self, points):
        return np.full(len(points), 250.0)

    def on(self, grid):
        return np.full((grid.rows, grid.columns), 250.0)


def written(path, values):
    profile = tiled_profile(GRID, "EPSG:5514", "float32") | {"nodata": -9999.0}
    with rasterio.open(path, "w", **profile) as file:
        file.write(np.nan_to_num(values, nan=-9999.0).astype(np.float32), 1)
    return path


def choice_in(folder, values, kind):
    """What is chosen for differences to the DEM, with its files in a folder."""
    return choose_ground(
        written(folder / "difference.tif", values),
        written(folder / "sigma.tif", np.full_like(values, SIGMA_M)),
        kind,
        0.3,
        classes=folder / "ground.tif",
        corrections=folder / "corrections.tif",
    )


def trapeze(rows, columns, height):
    """An embankment or pit with slopes of 1 : 2."""
    row, column = np.mgrid[: GRID.rows, : GRID.columns]
    away = np.maximum.reduce(
        [rows[0] - row, row - rows[1], columns[0] - column, column - columns[1]]
    )
    return np.sign(height) * np.clip(-away / 2.0, 0, abs(height))


@pytest.fixture(scope="module")
def differences():
    rng = np.random.default_rng(3)
    change = trapeze((40, 110), (40, 160), 8.0) + trapeze((180, 260), (60, 150), -8.0)
    noise = rng.normal(0, SIGMA_M, change.shape)
    standing = np.zeros_like(change)
    standing[60:70, 90:102] = 6.0  # a house on the embankment
    standing[60:72, 300:312] = 7.0  # a house beside it
    standing[150:280, 250:360] = 14.0 + rng.normal(0, 2.0, (130, 110))  # a wood
    standing[50:100, 150:200] = 14.0 + rng.normal(0, 2.0, (50, 50))  # a wood against its slope
    values = change + standing + noise
    values[10:20, 200:230] = np.nan
    return change, standing, values


@pytest.fixture(scope="module")
def chosen(differences, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ground")
    made = choice_in(folder, differences[2], "auto")
    with rasterio.open(made.classes) as file:
        return made, file.read(1), read_ground(made.corrections, Level())


def test_changed_ground_stands_on_its_own_surface__truth(differences, chosen):
    change, _, _ = differences
    made, classes, ground = chosen
    true, own = np.abs(change) > 1.5, classes == Ground.SURFACE
    assert (true & own).sum() / (true | own).sum() > 0.7
    assert made.changed_m2 == own.sum() * CELL_M**2
    error = ground.on(GRID) - 250.0 - change
    true[:, 140:210] = False  # where a wood hides its slope
    before, after = np.sqrt(np.mean(change[true] ** 2)), np.sqrt(np.mean(error[true] ** 2))
    assert before > 5.0
    assert after < 1.0


def test_houses_and_woods_do_not_lift_the_ground__truth(differences, chosen):
    _, standing, _ = differences
    _, classes, ground = chosen
    on_level = np.zeros_like(standing, dtype=bool)
    on_level[:, 240:] = True
    assert np.abs(ground.on(GRID)[on_level] - 250.0).max() < 1e-6
    wood = np.s_[170:260, 270:340]
    assert (classes[wood] == Ground.DEM_UNDER_SURFACE).mean() > 0.95
    beside = np.s_[58:92, 168:192]
    assert (classes[beside] == Ground.DEM_UNDER_SURFACE).all()
    assert np.abs(ground.on(GRID)[beside] - 250.0).max() < 1e-6
    house = np.s_[61:69, 91:101]
    assert np.abs(ground.on(GRID)[house] - 258.0).max() < 1.5


def test_what_was_cut_away_beside_two_fills_is_ground__truth(tmp_path):
    """Where slopes of both meet it is twice as steep as earth stands, and still no wall."""
    change = trapeze((90, 160), (100, 300), 8.0)
    for rows in ((60, 94), (156, 190)):
        change = change + trapeze(rows, (100, 300), -8.0)
    values = change + np.random.default_rng(5).normal(0, SIGMA_M, change.shape)
    made = choice_in(tmp_path, values, "auto")
    error = read_ground(made.corrections, Level()).on(GRID) - 250.0 - change
    assert np.sqrt(np.mean(error[108:142, 112:288] ** 2)) < 1.0


def test_where_there_is_no_surface_the_dem_stands_alone__truth(chosen):
    _, classes, ground = chosen
    assert (classes[11:19, 201:229] == Ground.DEM_ALONE).all()
    assert (classes[130:150, 180:240] == Ground.DEM).mean() > 0.98
    beyond = ground.heights(np.array([[0.0, 0.0], [1200.0, 9000.0]]))
    np.testing.assert_allclose(beyond, 250.0)


def test_surface_takes_all_that_is_known__truth(differences, tmp_path):
    _, _, values = differences
    made = choice_in(tmp_path, values, "surface")
    with rasterio.open(made.classes) as file:
        classes = file.read(1)
    np.testing.assert_array_equal(classes == Ground.SURFACE, np.isfinite(values))
    wood = read_ground(made.corrections, Level()).on(GRID)[170:260, 270:340]
    assert abs(np.mean(wood) - 264.0) < 0.5
