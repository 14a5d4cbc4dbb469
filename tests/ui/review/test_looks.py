"""Looks: states differ in colour and shape, figures are numbers that JSON knows."""

import numpy as np

from ui.review.looks import LOOKS, page_palette, rgb, round_all, short


def test_states_differ_in_shape_as_well_as_colour__law():
    assert len({look.glyph for look in LOOKS.values()}) == len(LOOKS)
    assert len({look.cloud_shape for look in LOOKS.values()}) >= 4
    assert len({rgb(look.colour) for look in LOOKS.values()}) == len(LOOKS)


def test_colours_are_their_channels__truth():
    assert rgb("#56b4e9") == (0x56, 0xB4, 0xE9)


def test_the_pages_know_every_state__law():
    states = page_palette()["states"]
    assert {name: look["colour"] for name, look in states.items()} == {
        name: look.colour for name, look in LOOKS.items()
    }


def test_what_is_no_number_is_none__law():
    assert [short(value, 1) for value in (None, float("nan"), float("inf"))] == [None] * 3
    assert short(1.26, 1) == 1.3
    assert round_all(None, 1) is None
    assert round_all(np.array([1.26, np.nan]), 1) == [1.3, None]
