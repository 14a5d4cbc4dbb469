"""Blocks begun anew: first looks that differ little lead to one and the same start."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.approximation import Approximation
from core.block.block import ExteriorPrior
from core.block.fresh_start import StartOptions, started_anew
from core.geometry.exterior import ExteriorOrientation
from tests.flights import FlightPlan, fly

OPTIONS = StartOptions()
MEASURED = ExteriorPrior(np.full(3, 5.0), np.radians([0.5, 0.5, 0.5]))


def level(bounds):
    """Ground of one height everywhere."""
    return 300.0


@pytest.fixture(scope="module")
def standing():
    """A flight with its true orientations, as a first look may find it, and what was told of it."""
    flight = fly(FlightPlan(ties=40, control=6, check=2), np.random.default_rng(3))
    prior = ExteriorPrior(np.full(3, 100.0), np.radians([3.0, 3.0, 5.0]))
    photos, known = {}, {}
    for name, photo in flight.block.photos.items():
        told = replace(photo, prior=prior, oriented=True)
        photos[name] = told.with_exterior(flight.truth.photos[name].exterior, oriented=True)
        known[name] = Approximation(told.approximate, prior, "world-file", (told.approximate,))
    return flight.block.with_photos(photos), known


def moved(block, metres, turn, scale):
    """The block as another first look may find it."""
    photos = {}
    for name, photo in block.photos.items():
        centre = photo.exterior.centre + metres
        centre[2] = photo.ground_height_m + (centre[2] - photo.ground_height_m) * scale
        exterior = replace(photo.exterior, centre=centre, kappa=photo.exterior.kappa + turn)
        photos[name] = photo.with_exterior(exterior, oriented=True)
    return block.with_photos(photos)


def test_first_looks_that_differ_little_begin_alike_to_the_last_digit__law(standing):
    block, known = standing
    begun, _ = started_anew(block, known, level)
    alike = 0
    rng = np.random.default_rng(1)
    for _ in range(20):
        other = moved(block, rng.normal(0, 0.3, 3), rng.normal(0, 1e-4), 1 + rng.normal(0, 3e-4))
        again, _ = started_anew(other, known, level)
        alike += all(
            np.array_equal(begun[name].exterior.centre, again[name].exterior.centre)
            and begun[name].exterior.kappa == again[name].exterior.kappa
            for name in begun
        )
    assert alike >= 18


@pytest.mark.parametrize(
    "flown_m", [1000, 1200, 1500, 1530, 1800, 2000, 2100, 2500, 3000, 3060, 4200, 5000]
)
def test_usual_heights_do_not_lie_on_the_border_of_two_steps__law(standing, flown_m):
    block, known = standing
    usual = np.median(
        [photo.exterior.centre[2] - photo.ground_height_m for photo in block.photos.values()]
    )
    begun = []
    for off in (0.993, 1.007):
        looked = moved(block, 0.0, 0.0, off * flown_m / usual)
        photos, _ = started_anew(looked, known, level)
        begun.append([photo.exterior.centre[2] for photo in photos.values()])
    assert begun[0] == begun[1]


def test_no_photo_begins_further_off_than_half_a_step__law(standing):
    block, known = standing
    begun, found = started_anew(block, known, level)
    for name, photo in begun.items():
        stood, camera = block.photos[name], block.camera_of(name)
        middle = stood.object_from_pixel(
            stood.interior.pixel_from_film(np.array([camera.principal_point_mm])),
            np.array([stood.ground_height_m]),
            camera,
        )[0, :2]
        width = stood.width_m(camera)
        assert np.abs(photo.exterior.centre[:2] - middle).max() <= 0.15 * width
        assert abs(photo.exterior.kappa - stood.exterior.kappa) <= OPTIONS.kappa / 2 + 1e-9
        above = photo.exterior.centre[2] - photo.ground_height_m
        assert above == pytest.approx(
            stood.exterior.centre[2] - stood.ground_height_m, rel=1.01 * OPTIONS.height
        )
        assert not photo.oriented
        assert photo.approximate is photo.exterior
        assert found[name].hypotheses == (photo.exterior,)
        assert found[name].source == "world-file"


def test_half_a_turn_is_one_direction_whichever_its_sign__law(standing):
    block, known = standing
    kappas = []
    for kappa in (np.pi - 0.01, -np.pi + 0.01):
        photos = {
            name: photo.with_exterior(replace(photo.exterior, kappa=kappa), oriented=True)
            for name, photo in block.photos.items()
        }
        begun, _ = started_anew(block.with_photos(photos), known, level)
        kappas.append({photo.exterior.kappa for photo in begun.values()})
    assert kappas == [{np.pi}, {np.pi}]


def test_what_is_known_better_or_does_not_stand_stays__law(standing):
    block, known = standing
    first, second, third = sorted(block.photos)[:3]
    known = {**known, third: replace(known[third], source="points")}
    photos = {
        **block.photos,
        first: replace(block.photos[first], prior=MEASURED),
        second: replace(block.photos[second], oriented=False),
    }
    begun, found = started_anew(block.with_photos(photos), known, level)
    for name in (first, second, third):
        assert begun[name].exterior is block.photos[name].approximate
        assert begun[name].prior is photos[name].prior
        assert found[name] is known[name]
    assert isinstance(begun[first].exterior, ExteriorOrientation)
