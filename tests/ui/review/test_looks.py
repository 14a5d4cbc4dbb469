"""Looks: states differ in colour and shape, figures are numbers that JSON knows."""

import re
from pathlib import Path

import numpy as np

from ui.review.looks import LIGHT, LOOKS, page_palette, rgb, round_all, short

PAGE = Path(__file__).parents[3] / "ui" / "web" / "pages" / "desk.css"


def luminance(colour):
    """Relative luminance of WCAG 2.2."""
    parts = np.array(rgb(colour)) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ (
        0.2126,
        0.7152,
        0.0722,
    )


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


def test_what_stands_against_the_ground_is_seen_in_both_themes__law():
    dark, light = re.findall(r"--scene: (#\w{6})", PAGE.read_text(encoding="utf-8"))
    pairs = [*((shown, light) for shown in LIGHT.values()), *((shown, dark) for shown in LIGHT)]
    for shown, ground in pairs:
        low, high = sorted((luminance(shown), luminance(ground)))
        assert (high + 0.05) / (low + 0.05) >= 3  # WCAG 2.2, 1.4.11


def test_what_is_no_number_is_none__law():
    assert [short(value, 1) for value in (None, float("nan"), float("inf"))] == [None] * 3
    assert short(1.26, 1) == 1.3
    assert round_all(None, 1) is None
    assert round_all(np.array([1.26, np.nan]), 1) == [1.3, None]
