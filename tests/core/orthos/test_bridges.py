"""Decks of bridges over the ground of an ortho."""

import numpy as np
import pyogrio.raw
import pytest
import shapely
from shapely.geometry import Polygon, box

from core.errors import ReferenceDataError
from core.orthos.bridges import BridgedHeights, Deck, with_bridges
from core.orthos.rectification import OrthoOptions, rectify_photo
from core.raster.dem import level_ground
from core.raster.grid import Grid
from tests.core.orthos.test_rectification import CRS, read

GROUND_M, DECK_M = 200.0, 230.0
GROUND = level_ground(GROUND_M, CRS)
EAST, NORTH = 500_000.0, 4_100_000.0
SOUTH_WEST = np.array([EAST, NORTH])


def deck(west, south, east, north, *heights):
    """A rectangle with the heights of its corners, from the south-east counter-clockwise."""
    outline = box(west, south, east, north)
    corners = np.array(outline.exterior.coords)
    heights = np.resize(heights, len(corners) - 1)
    return Polygon(np.column_stack([corners, [*heights, heights[0]]]))


def write(path, *polygons, crs=CRS):
    pyogrio.raw.write(
        path,
        geometry=np.array([shapely.to_wkb(one) for one in polygons], dtype=object),
        field_data=[],
        fields=np.array([], dtype=object),
        geometry_type="Polygon Z" if shapely.has_z(polygons[0]) else "Polygon",
        crs=crs,
    )
    return path


def bridged(path, *polygons):
    file = write(path / "bridges.gpkg", *polygons)
    return with_bridges(GROUND, file, CRS, (-1e6, -1e6, 1e7, 1e7))


def test_heights_are_linear_along_a_deck_and_the_ground_beside_it__truth(tmp_path):
    east, north = EAST, NORTH
    found = bridged(tmp_path, deck(east, north, east + 100, north + 10, 240, 240, 230, 230))
    places = np.array([[0, 5], [25, 5], [100, 5], [50, 10], [50, 10.1], [-1, 5]])
    assert found.heights(places + SOUTH_WEST) == pytest.approx([230, 232.5, 240, 235, 200, 200])


def test_of_decks_over_each_other_the_highest_is_seen__truth(tmp_path):
    east, north = EAST, NORTH
    low = deck(east, north, east + 100, north + 10, 210)
    high = deck(east + 40, north - 40, east + 50, north + 50, 225)
    found = bridged(tmp_path, high, low)
    places = np.array([[45.0, 5.0], [20.0, 5.0], [45.0, 30.0], [20.0, 30.0]]) + SOUTH_WEST
    assert found.heights(places).tolist() == [225, 210, 225, 200]
    grid = Grid(east + 44, north + 6, 2, 1, 1)
    assert found.on(grid).tolist() == [[225]]


def test_a_bridge_is_shown_as_on_level_ground_of_its_height__law(scene, middle, tmp_path):
    east, north = middle.exterior.centre[:2] + 60.0
    outline = deck(east, north, east + 30, north + 12, DECK_M)
    grid = Grid(east - 40, north + 60, 0.6, 200, 160)
    options = OrthoOptions(tile_px=64)

    def shown(heights, name):
        path = tmp_path / f"{name}.tif"
        rectify_photo(middle, scene.camera, heights, grid, path, CRS, options=options)
        return read(path)

    over = shown(bridged(tmp_path, outline), "bridge")
    high, low = shown(level_ground(DECK_M, CRS), "high"), shown(GROUND, "low")
    columns, rows = np.meshgrid(*grid.centres())
    on = shapely.intersects_xy(outline, columns, rows)
    assert 900 < on.sum() < 1100
    assert np.abs(over[on].astype(int) - high[on]).max() <= 1
    assert np.abs(over[~on].astype(int) - low[~on]).max() <= 1
    assert np.abs(high[on].astype(int) - low[on]).mean() > 5


def test_polygons_without_heights_replace_nothing__law(tmp_path):
    assert bridged(tmp_path, box(EAST, NORTH, EAST + 100, NORTH + 10)) is GROUND


def test_only_parts_near_a_bridge_ask_for_it__law():
    one = box(0, 0, 10, 10)
    found = BridgedHeights(GROUND, (Deck(one, np.array([[0, 0, 1], [9, 0, 1], [0, 9, 1.0]])),))
    assert found.around((20, 20, 30, 30)) is GROUND
    assert isinstance(found.around((5, 5, 30, 30)), BridgedHeights)


@pytest.mark.parametrize(
    ("height", "above"), [(0.0, "−200"), (755.0, "555"), ((230, 230, 90000, 230), "89800")]
)
def test_heights_of_another_system_are_told__truth(tmp_path, height, above):
    heights = np.atleast_1d(height)
    with pytest.raises(ReferenceDataError, match=rf"bridges\.gpkg.*lies {above} m above"):
        bridged(tmp_path, deck(EAST, NORTH, EAST + 100, NORTH + 10, *heights))


def test_a_sliver_that_an_overlay_left_is_no_bridge__law(tmp_path):
    assert bridged(tmp_path, deck(EAST, NORTH, EAST + 60, NORTH + 1e-9, 230)) is GROUND


def test_places_of_a_layer_in_another_crs_keep_their_heights__oracle(tmp_path):
    file = write(tmp_path / "wgs.gpkg", deck(15.0, 49.0, 15.001, 49.001, 231.0), crs="EPSG:4326")
    found = with_bridges(GROUND, file, CRS, (499000, 5427000, 501000, 5430000))
    assert found.heights(np.array([[500030.0, 5427500.0], [499990.0, 5427500.0]])).tolist() == [
        231,
        200,
    ]
