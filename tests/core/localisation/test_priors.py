"""Photos found on the reference keep nothing of a georeference that was off."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import ExteriorPrior
from core.localisation.priors import HEIGHT_SHARE, TILT, free_from_archive
from tests.flights import FlightPlan, fly

MEASURED = ExteriorPrior(np.full(3, 5.0), np.radians([0.5, 0.5, 0.5]))
NOBODY = frozenset[str]()


def level(bounds):
    """Ground of one height everywhere."""
    return 300.0


@pytest.fixture(scope="module")
def flight():
    return fly(FlightPlan(ties=40, control=6, check=2), np.random.default_rng(3))


@pytest.fixture(scope="module")
def standing(flight):
    """A flight with its true orientations, and a georeference that is off."""
    prior = ExteriorPrior(np.full(3, 100.0), np.radians([3.0, 3.0, 5.0]))
    photos = {
        name: replace(photo, prior=prior).with_exterior(
            flight.truth.photos[name].exterior, oriented=True
        )
        for name, photo in flight.block.photos.items()
    }
    return flight.block.with_photos(photos)


def test_where_a_photo_stands_is_the_mean_of_its_prior__truth(standing):
    freed = free_from_archive(standing, NOBODY, level)
    for name, photo in freed.photos.items():
        stood, camera = standing.photos[name], standing.camera_of(name)
        assert photo.exterior is stood.exterior
        middle_px = stood.interior.pixel_from_film(np.array([camera.principal_point_mm]))
        middle = stood.object_from_pixel(middle_px, np.array([stood.ground_height_m]), camera)
        np.testing.assert_allclose(photo.approximate.centre[:2], middle[0, :2])
        assert (photo.approximate.omega, photo.approximate.phi) == (0.0, 0.0)
        above = photo.exterior.centre[2] - 300.0
        expected = np.array([above * TILT, above * TILT, above * HEIGHT_SHARE])
        np.testing.assert_allclose(photo.prior.sigma_centre_m, expected)
        assert photo.ground_height_m == 300.0


def test_another_georeference_leaves_no_trace_in_the_adjustment__law(standing):
    """A hundred metres in what the archive says do not move the block by a millimetre."""
    moved = standing.with_photos(
        {
            name: replace(
                photo,
                approximate=replace(photo.approximate, centre=photo.approximate.centre + 100.0),
            )
            for name, photo in standing.photos.items()
        }
    )
    one, other = (
        adjust_block(free_from_archive(block, NOBODY, level), AdjustmentOptions()).block
        for block in (standing, moved)
    )
    for name in one.photos:
        apart = one.photos[name].exterior.centre - other.photos[name].exterior.centre
        assert np.abs(apart).max() < 1e-3


def test_what_is_known_better_or_does_not_stand_stays__law(standing):
    first, second, third = sorted(standing.photos)[:3]
    photos = {
        **standing.photos,
        first: replace(standing.photos[first], prior=MEASURED),
        second: replace(standing.photos[second], oriented=False),
    }
    freed = free_from_archive(standing.with_photos(photos), frozenset({third}), level)
    for name in (first, second, third):
        assert freed.photos[name] is photos[name]


def test_where_the_dem_has_no_height_the_known_one_stays__law(standing):
    freed = free_from_archive(standing, NOBODY, lambda bounds: float("nan"))
    for name, photo in freed.photos.items():
        assert photo.ground_height_m == standing.photos[name].ground_height_m
