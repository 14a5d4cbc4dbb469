"""What photos see above the heights of their orthos."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import shapely
from scipy import ndimage
from shapely.geometry import MultiPoint, box

from core.mosaic.composition import MosaicOptions, compose_mosaic
from core.orthos import visibility
from core.orthos.rectification import OrthoOptions, rectify_photo
from core.orthos.visibility import hidden_places, look_down
from core.raster.grid import Grid, tiles_of
from tests.core.orthos.test_bridges import bridged, deck
from tests.core.orthos.test_rectification import CRS, read

EAST, NORTH = 500_000.0, 4_100_000.0
AROUND = np.ones((3, 3), np.uint8)


@dataclass
class Posts:
    """Heights in the middles of cells, linear between them."""

    values: np.ndarray
    grid: Grid

    @property
    def ground_sample_distance_m(self):
        return self.grid.ground_sample_distance_m

    def heights(self, points):
        place = self.grid.grid_from_object(points) - 0.5
        return ndimage.map_coordinates(self.values, place.T[::-1], order=1, mode="nearest")

    def on(self, grid):
        east, north = np.meshgrid(*grid.centres())
        points = np.column_stack([east.ravel(), north.ravel()])
        return self.heights(points).reshape(grid.rows, grid.columns)


def hidden(centre, heights, grid):
    sight = look_down(np.array(centre), heights, grid, box(*grid.bounds))
    return ~sight.seen((0, 0, grid.columns, grid.rows))


@pytest.fixture(autouse=True)
def bare(monkeypatch):
    """What is hidden without the pixels beside it."""
    monkeypatch.setattr(visibility, "RIM_PX", 0)


HOUSE_M, FLIGHT_M = 30.0, 500.0
HOUSE = box(EAST - 6, NORTH - 10, EAST + 6, NORTH + 10)


def house_on(grid):
    """Level ground at nought with a box."""
    east, north = np.meshgrid(*grid.centres())
    return Posts(np.where(shapely.intersects_xy(HOUSE, east, north), HOUSE_M, 0.0), grid)


@pytest.mark.parametrize(
    "aside", [(0, 0), (300, 0), (-300, 40), (20, -250), (180, 180), (-250, 260)]
)
def test_a_house_hides_its_shadow_from_the_perspective_centre__law(aside):
    grid = Grid(EAST - 60, NORTH + 60, 0.5, 240, 240)
    nadir = np.array([EAST, NORTH]) + aside
    roof = np.array(HOUSE.exterior.coords)
    foot = nadir + (roof - nadir) * FLIGHT_M / (FLIGHT_M - HOUSE_M)
    thrown = MultiPoint(np.vstack([roof, foot])).convex_hull.difference(HOUSE)
    east, north = np.meshgrid(*grid.centres())
    truth = shapely.intersects_xy(thrown, east, north)
    found = hidden((*nadir, FLIGHT_M), house_on(grid), grid)
    wrong = found != truth
    off = shapely.distance(thrown.boundary, shapely.points(east[wrong], north[wrong]))
    # The walls slope over a pixel, between one post and the next.
    assert (off < 0.5 * np.sqrt(2) + 1e-6).all()
    assert found.sum() == pytest.approx(truth.sum(), abs=110)


def test_sight_does_not_hang_on_tiles_nor_on_where_blocks_end__law(monkeypatch):
    grid = Grid(EAST - 60, NORTH + 60, 0.5, 240, 240)
    centre, heights = np.array([EAST - 250, NORTH + 230, FLIGHT_M]), house_on(grid)
    whole = hidden(centre, heights, grid)
    monkeypatch.setattr(visibility, "BLOCK_PX", 64)
    sight = look_down(centre, heights, grid, box(*grid.bounds))
    other = np.zeros((240, 240), dtype=bool)
    for column, row, columns, rows in tiles_of(grid, 50):
        part = ~sight.seen((column, row, columns, rows))
        other[row : row + rows, column : column + columns] = part
    assert np.array_equal(other, ~sight.seen((0, 0, 240, 240)))
    border = cv2.morphologyEx(whole.astype(np.uint8), cv2.MORPH_GRADIENT, AROUND) > 0
    assert not ((whole != other) & ~border).any()
    assert (whole != other).sum() < 0.02 * whole.sum()
    monkeypatch.setattr(visibility, "RIM_PX", 1)
    rimmed = hidden(centre, heights, grid)
    beside = cv2.dilate(other.astype(np.uint8), AROUND) > 0
    assert (rimmed != beside).sum() < 0.02 * whole.sum()


def test_smooth_hills_hide_nothing__law(scene, middle):
    """Waves of 40 m fall by 0.3 at most, rays from 50 degrees off the plumb line by 0.8."""
    grid = Grid(EAST - 600, NORTH + 600, 1.0, 1200, 1200)
    wall = box(EAST + 500, NORTH - 560, EAST + 504, NORTH - 540)

    @dataclass
    class WithWall:
        ground_sample_distance_m: float = 1.0

        def heights(self, points):
            raise AssertionError

        def on(self, part):
            east, north = np.meshgrid(*part.centres())
            return scene.dem.on(part) + 20 * shapely.intersects_xy(wall, east, north)

    centre = (EAST + 100, NORTH, 1000.0)
    assert not hidden(centre, scene.dem, grid).any()
    # Nor where one wall has all rays swept.
    rows, columns = np.nonzero(hidden(centre, WithWall(), grid))
    assert len(rows) > 50
    assert (np.abs(columns - 1110) < 20).all()
    assert (np.abs(rows - 1155) < 25).all()


@pytest.mark.parametrize("centre", [(90.3, 70.6, 100.0), (380.0, 310.0, 600.0)])
def test_rough_ground_hides_what_rays_step_by_step_say__oracle(centre):
    """Samples every tenth of a cell along each ray, of the same heights."""
    rng = np.random.default_rng(9220)
    grid = Grid(EAST, NORTH + 160, 1.0, 200, 160)
    wide = Grid(grid.west - 40, grid.north + 40, 1.0, 280, 240)
    rough = ndimage.gaussian_filter(rng.normal(size=(wide.rows, wide.columns)), 6)
    heights = Posts(12 * rough / rough.std(), wide)
    centre = np.array([EAST, NORTH, 0]) + centre
    found = hidden(centre, heights, grid)
    truth = stepped(centre, heights, grid)
    assert 0.03 < truth.mean() < 0.6
    border = cv2.morphologyEx(truth.astype(np.uint8), cv2.MORPH_GRADIENT, AROUND) > 0
    assert np.mean(found == truth) > 0.99
    # Where a ray passes by two centimetres, either is right.
    sure = [stepped(centre, heights, grid, room) for room in (-0.02, 0.02)]
    assert not ((found != truth) & ~border & (sure[0] == sure[1])).any()
    some = rng.integers(0, (grid.columns, grid.rows), (60, 2))
    alone = hidden_places(centre, heights, grid.object_from_grid(some + 0.5), 0.2)
    assert np.array_equal(alone, truth[some[:, 1], some[:, 0]])


def stepped(centre, heights, grid, room=0.0, step=0.2):
    east, north = np.meshgrid(*grid.centres())
    places = np.column_stack([east.ravel(), north.ravel()])
    ground, top = heights.heights(places), heights.values.max()
    run = np.hypot(*(places - centre[:2]).T)
    found, left = np.zeros(len(places), dtype=bool), np.arange(len(places))
    number = 0
    while len(left):
        number += 1
        share = number * step / run[left]
        ray = ground[left] + (centre[2] - ground[left]) * share
        left = left[(share < 1) & (ray < top)]
        share = (number * step / run[left])[:, None]
        ray = ground[left] + (centre[2] - ground[left]) * share[:, 0]
        along = places[left] + (centre[:2] - places[left]) * share
        above = heights.heights(along) > ray + room + 1e-6
        found[left[above]] = True
        left = left[~above]
    return found.reshape(grid.rows, grid.columns)


def test_a_bridge_is_not_doubled_on_the_ground_beside_it__law(scene, middle, tmp_path):
    east, north = middle.exterior.centre[:2] + 150.0
    heights = bridged(tmp_path, deck(east, north, east + 60, north + 12, 230))
    grid = Grid(east - 40, north + 80, 0.6, 250, 220)

    def shown(seen, tile_px):
        path = tmp_path / "o.tif"
        options = OrthoOptions(tile_px=tile_px, visibility=seen)
        rectify_photo(middle, scene.camera, heights, grid, path, CRS, options=options)
        return read(path)

    usual, true = shown(False, 1024), shown(True, 1024)
    left = true == 0
    assert usual.all()
    assert np.array_equal(true[~left], usual[~left])
    # Twelve metres wide, 30 m above ground, seen from 1100 m above it and 212 m aside.
    assert left.sum() * 0.36 == pytest.approx(60 * 12 * 1.03**2 - 55 * 7, rel=0.25)
    assert np.array_equal(shown(True, 100) == 0, left)


def test_a_mosaic_shows_what_is_hidden_from_a_photo_that_sees_it__truth(scene, tmp_path):
    """A house of 40 m between two photos: each sees what the other does not."""
    grid = Grid.over((EAST - 100, NORTH - 100, EAST + 100, NORTH + 100), 0.5)
    heights = house_on(grid)
    heights = Posts(300 + heights.values * 4 / 3, grid)
    options, orthos = OrthoOptions(visibility=True), []
    for name, east in (("west", -130.0), ("east", 130.0)):
        photo, path = scene.photo(name, east), tmp_path / f"{name}.tif"
        orthos.append(rectify_photo(photo, scene.camera, heights, grid, path, CRS, options=options))
    mosaic = compose_mosaic(
        orthos, grid, tmp_path / "m.tif", None, options=MosaicOptions(balance=False)
    )
    west, east, shown = (read(path) for path in (*(one.path for one in orthos), mosaic.path))
    assert ((west == 0).sum(), (east == 0).sum()) == pytest.approx((390, 390), rel=0.25)
    assert not ((west == 0) & (east == 0)).any()
    assert shown.all()
    for one, other in ((west, east), (east, west)):
        assert np.array_equal(shown[one == 0], other[one == 0])
