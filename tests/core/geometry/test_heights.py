"""Height systems by word and code, and lists that lie off the ground all alike."""

import numpy as np
import pytest
from pyproj import CRS

from core.geometry.heights import ELLIPSOIDAL, height_offset, height_system, vertical_of


@pytest.mark.parametrize(
    ("text", "system"),
    [
        ("Bpv", "EPSG:8357"), ("BALT  po vyrovnání", "EPSG:8357"), ("EPSG:8357", "EPSG:8357"),
        ("EPSG:5514+8357", "EPSG:8357"), ("ellipsoidal", ELLIPSOIDAL), ("EPSG:4979", ELLIPSOIDAL),
        ("", ""), ("above the pub", None), ("EPSG:5514", None),
    ],
)  # fmt: skip
def test_words_and_codes_of_one_system_are_one__law(text, system):
    assert height_system(text) == system


def test_the_height_system_of_a_compound_crs__oracle():
    """PROJ's register: EPSG:5705 is another Baltic, and not that of Czechia."""
    assert vertical_of(CRS("EPSG:5514+5705")) == "EPSG:5705" != height_system("Bpv")
    assert vertical_of(CRS("EPSG:5514")) == ""


@pytest.mark.parametrize("seed", range(5))
def test_an_ellipsoidal_list_is_found_and_its_offset_told__truth(seed):
    rng = np.random.default_rng(seed)
    ground = rng.uniform(200, 600, 30)
    undulation = 44.6 + rng.normal(size=30) * 0.1
    listed = ground + undulation + rng.normal(size=30) * 0.5
    found = height_offset(listed, ground, np.full(30, 0.5))
    assert found is not None
    assert found.offset_m == pytest.approx(44.6, abs=0.5)
    assert found.scatter_m < 1.5
    ground[:5] = np.nan
    assert height_offset(listed, ground, np.full(30, 0.5)).count == 25


def test_heights_that_fit_scatter_or_are_blunders_ask_nothing__truth():
    rng = np.random.default_rng(0)
    ground = rng.uniform(200, 600, 30)
    sigma = np.full(30, 0.5)
    assert height_offset(ground + rng.normal(size=30) * 0.5, ground, sigma) is None
    assert height_offset(ground + rng.normal(size=30) * 40 + 20, ground, sigma) is None
    few = ground + np.where(np.arange(30) < 6, 45.0, 0.0)
    assert height_offset(few, ground, sigma) is None
    assert height_offset(ground + 45, ground, np.full(30, 20.0)) is None
    assert height_offset(ground[:1] + 45, ground[:1], sigma[:1]) is None
