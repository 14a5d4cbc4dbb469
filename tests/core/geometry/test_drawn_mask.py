"""Outlines, brushes and erasers laid one over the other on a scan."""

import numpy as np
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from core.geometry.drawn_mask import GRID_PX, DrawnMask, Stroke, drawn_mask, outlines
from core.geometry.transforms import PlanePoints
from core.raster.scan_file import UsableArea
from core.scans.photo_mask import with_drawn

SQUARE = Stroke(((10.0, 10.0), (50.0, 10.0), (50.0, 50.0), (10.0, 50.0)), 0.0, True)
ERASER = Stroke(((0.0, 30.0), (60.0, 30.0)), 8.0, False)
# Millionths of a pixel: GEOS divides by what is far less.
coordinate = st.floats(-20, 80).map(lambda value: round(value, 6))
place = st.tuples(coordinate, coordinate)
strokes = st.tuples(
    st.lists(place, min_size=1, max_size=5).map(tuple),
    st.sampled_from([0.0, 6.0]),
    st.booleans(),
)


def on_scan(*drawn: Stroke) -> DrawnMask:
    return drawn_mask([(one, False) for one in drawn], lambda film: film)


def test_what_was_drawn_last_counts__law() -> None:
    mask = on_scan(SQUARE, ERASER)
    places = np.array([[30.0, 20.0], [30.0, 30.0], [5.0, 30.0], [70.0, 70.0]])
    assert mask.hides(places).tolist() == [True, False, False, False]
    assert len(outlines(mask.hidden)) == 2
    assert on_scan(SQUARE, ERASER, SQUARE).hides(places).tolist() == [True, True, False, False]
    assert not on_scan()


@given(st.lists(strokes, max_size=5))
@example(
    [
        (((0.0, 0.0), (0.0, 1.0), (1.0, 0.0)), 0.0, True),
        (((0.0, 0.0), (0.0, 5e-118), (1.0, 1.0)), 0.0, True),  # a sliver, of which a line is left
    ]
)
def test_nothing_is_both_hidden_and_given_back__law(
    drawn: list[tuple[tuple[tuple[float, float], ...], float, bool]],
) -> None:
    mask = on_scan(*(Stroke(*one) for one in drawn))
    both = shapely.intersection(mask.hidden, mask.freed, grid_size=GRID_PX)
    # Where sides cross, corners were moved onto the grid.
    assert both.area <= GRID_PX * (mask.hidden.length + mask.freed.length)
    for area in (mask.hidden, mask.freed):
        assert area.is_valid
        assert isinstance(area, shapely.Polygon | shapely.MultiPolygon)


def test_a_mask_of_a_camera_lies_on_the_same_place_of_every_film__law() -> None:
    outline = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))
    for turn in (0.0, 0.7, 2.1):
        rotation = 40 * np.array([[np.cos(turn), np.sin(turn)], [np.sin(turn), -np.cos(turn)]])

        def pixel(film: PlanePoints, rotation: np.ndarray = rotation) -> PlanePoints:
            return film @ rotation.T + 1000.0

        mask = drawn_mask([(Stroke(outline, 0.0, True), True)], pixel)
        inner, outer = np.array([[4.9, -4.9], [0.0, 0.0]]), np.array([[5.1, 0.0], [-5.2, -5.2]])
        assert mask.hides(pixel(inner)).all()
        assert not mask.hides(pixel(outer)).any()


def test_every_cell_that_a_mask_touches_is_left_out__law() -> None:
    size, whole = (200, 120), np.ones((30, 50), dtype=bool)
    area = with_drawn(UsableArea.of(whole, size), on_scan(SQUARE, ERASER), size)
    across, down = np.meshgrid(np.arange(200) + 0.5, np.arange(120) + 0.5)
    pixels = np.column_stack([across.ravel(), down.ravel()])
    hidden = on_scan(SQUARE, ERASER).hides(pixels)
    assert not area.at(pixels[hidden]).any()
    # A cell is four pixels wide: what lies farther away stays.
    near = on_scan(Stroke(SQUARE.outline, 0.0, True)).hidden.buffer(6)
    far = ~DrawnMask(near).hides(pixels)
    assert area.at(pixels[far]).all()


def test_the_eraser_gives_back_what_the_program_left_out_but_no_margin__law() -> None:
    size = (200, 120)
    found = UsableArea.of(np.zeros((30, 50), dtype=bool), size)
    picture = np.array([[20.0, 0.0], [200.0, 0.0], [200.0, 120.0], [20.0, 120.0]])
    freed = Stroke(((0.0, 60.0), (200.0, 60.0)), 20.0, False)
    area = with_drawn(found, on_scan(freed), size, picture)
    places = np.array([[100.0, 60.0], [10.0, 60.0], [100.0, 90.0]])
    assert area.at(places).tolist() == [True, False, False]
