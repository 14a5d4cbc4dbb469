"""The part of a scan that is photograph, packed, and what is left unsought outside it."""

from dataclasses import replace

import numpy as np
import pytest

from core.matching.local_search import predict_pixels
from core.matching.patches import Window, object_on_ground, read_pair
from core.raster.usable_area import UsableArea


@pytest.fixture
def mask() -> np.ndarray:
    return np.random.default_rng(4).random((53, 71)) < 0.6


def test_what_is_packed_comes_back__law(mask) -> None:
    area = UsableArea.of(mask, (568, 424))
    np.testing.assert_array_equal(area.mask, mask)
    assert len(area.packed) < mask.size / 4


def test_pixels_are_asked_of_the_cell_they_lie_in__truth(mask) -> None:
    area = UsableArea.of(mask, (568, 424))
    rows, columns = np.indices(mask.shape)
    inside = np.column_stack([columns.ravel(), rows.ravel()]) * 8.0
    for offset in (0.01, 7.99):
        np.testing.assert_array_equal(area.at(inside + offset), mask.ravel())
    outside = np.array([[-0.01, 5], [568.01, 5], [5, -0.01], [5, 424.01], [np.nan, 5]])
    assert not area.at(outside).any()


def test_a_window_is_asked_as_its_pixels_are__truth(mask) -> None:
    area = UsableArea.of(mask, (568, 424))
    columns, rows = np.meshgrid(-9 + (np.arange(200) + 0.5) * 3, 17 + (np.arange(150) + 0.5) * 3)
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    found = area.within(-9, 17, 200, 150, 3)
    np.testing.assert_array_equal(found.ravel(), area.at(pixels))


def test_nothing_is_sought_on_a_data_strip__truth(tiny) -> None:
    """The lower third of a scan is no photograph: no point is expected there, no template laid."""
    opened = tiny.opened(tiny.names[0])
    columns, rows = opened.scan.size_px
    strip = np.ones((rows // 8, columns // 8), bool)
    strip[2 * len(strip) // 3 :] = False
    masked = replace(
        opened, scan=replace(opened.scan, usable=UsableArea.of(strip, opened.scan.size_px))
    )
    share = np.stack(np.meshgrid(*[np.linspace(0.2, 0.8, 5)] * 2), axis=-1).reshape(-1, 2)
    pixels = share * np.array(opened.scan.size_px)
    ground = object_on_ground(opened.photo, opened.camera, pixels, tiny.reference.dem)
    flat = np.full(ground.shape, 0.4)
    whole = predict_pixels(opened, np.zeros((6, 6)), ground, flat)
    found = predict_pixels(masked, np.zeros((6, 6)), ground, flat)
    assert whole.inside.all()
    np.testing.assert_array_equal(found.inside, share[:, 1] < 2 / 3)
    window = Window(columns // 2, 2 * rows // 3 - 40, 80, 80, 1)
    usable = read_pair(masked, tiny.reference, window).usable
    assert usable[:35].all()
    assert not usable[45:].any()
