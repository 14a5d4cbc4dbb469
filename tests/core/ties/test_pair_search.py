"""Pairs from footprints."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.block import Block, ExteriorPrior, Photo, footprint, ground_of
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.ties.pair_search import find_pairs, within

NONE = np.zeros((0, 2))
MATRIX = np.array([[0.1, 0.0, -100.0], [0.0, -0.1, 100.0]])
INTERIOR = InteriorOrientation("affine", MATRIX, (), NONE, NONE, 0.0)
CAMERA = Camera("c", 100.0, (200.0, 200.0))


def block(positions: dict[str, tuple[float, float]], sigma_m: float) -> Block:
    """Photos with footprints of 2000 m a side."""
    prior = ExteriorPrior(np.full(3, sigma_m), np.zeros(3))
    photos = {}
    for name, (east, north) in positions.items():
        start = ExteriorOrientation(np.array([east, north, 1000.0]), 0.0, 0.0, 0.0)
        photos[name] = Photo(name, Path(), (2000, 2000), "c", INTERIOR, start, start, prior, 0.0)
    return Block("EPSG:5514", {"c": CAMERA}, photos)


def test_overlap_is_the_common_share__truth():
    pairs = find_pairs(block({"a": (0, 0), "b": (1200, 0), "c": (1200, 1500)}, 0.0))
    found = {(pair.first, pair.second): pair.overlap for pair in pairs}
    expected = {("a", "b"): 0.4, ("a", "c"): 0.4 * 0.25, ("b", "c"): 0.25}
    assert found == pytest.approx(expected, abs=2e-3)


def test_doubtful_positions_bring_more_pairs__law():
    positions = {"a": (0.0, 0.0), "b": (2300.0, 0.0)}
    assert find_pairs(block(positions, 10.0)) == ()
    (pair,) = find_pairs(block(positions, 300.0))
    assert pair.overlap == 0.0
    assert pair.first_region is not None
    assert pair.first_region.area > 2000.0**2


def test_where_nothing_is_known_every_pair_is_tried_and_no_overlap_promised__law():
    pairs = find_pairs(block({"a": (0.0, 0.0), "b": (9000.0, 0.0), "c": (0.0, 0.0)}, 1500.0))
    assert [(pair.first, pair.second) for pair in pairs] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert {(pair.overlap, pair.first_region, pair.second_region) for pair in pairs} == {
        (0.0, None, None)
    }


def test_regions_hold_what_the_other_photo_may_show__law():
    given = block({"a": (0.0, 0.0), "b": (1200.0, 300.0)}, 30.0)
    (pair,) = find_pairs(given)
    rng = np.random.default_rng(1)
    pixels = rng.uniform(0, 2000, (500, 2))
    ground = ground_of(given.photos["a"], CAMERA, pixels)
    other = given.photos["b"].pixel_from_object(ground, CAMERA)
    shown = np.all((other > 0) & (other < 2000), axis=1)
    inside = within(pair.first_region, ground)
    assert inside[shown].all()
    assert 0 < inside.sum() < len(inside)


def test_footprint_turns_with_the_photo__truth():
    photo = block({"a": (100.0, 200.0)}, 0.0).photos["a"]
    turned = replace(photo, exterior=replace(photo.exterior, kappa=np.pi / 4))
    assert footprint(turned, CAMERA).bounds == pytest.approx(
        (100 - 1414.2, 200 - 1414.2, 100 + 1414.2, 200 + 1414.2), abs=2.0
    )
