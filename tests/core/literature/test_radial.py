"""Radial triangulation: exact where the books say so, and wrong as the formula says."""

from dataclasses import replace

import numpy as np
import pytest

from app.lessons.flight import Flight, Plan, fly
from app.lessons.photo import camera_with, tilted_at
from app.lessons.triangulation import CONTROL
from core.arrays import Matrix
from core.doubts import Failure
from core.geometry.collinearity import film_from_object
from core.geometry.image_corrections import isocentre_on_film, nadir_on_film
from core.literature.radial import RadialPoint, RadialResult, direction_error, triangulate_radially


def flight_of(relief_m: float, tilt: float) -> Flight:
    return fly(Plan(2, 3, 140, 0.0, 3, relief_m, tilt), CONTROL, 0.0)


def errors(flight: Flight, which: RadialPoint) -> tuple[RadialResult, Matrix]:
    found = triangulate_radially(flight.block, which)
    assert isinstance(found, RadialResult)
    return found, found.places - flight.ties[found.numbers, :2]


@pytest.mark.parametrize(
    ("relief_m", "tilt", "which"),
    [(0.0, 0.0, "principal"), (0.0, 0.03, "isocentre"), (100.0, 0.0, "nadir")],
)
def test_without_noise_it_is_exact_on_flat_ground__truth(
    relief_m: float, tilt: float, which: RadialPoint
) -> None:
    """About the isocentre whatever the tilt; of vertical photos whatever the relief."""
    found, off = errors(flight_of(relief_m, tilt), which)
    assert len(off) > 60
    assert np.abs(off).max() < 1e-4
    assert found.rms_mm < 1e-6


def test_relief_turns_directions_as_the_formula_says__truth() -> None:
    """Against collinearity, about principal point and isocentre of a tilted photo."""
    above, height, tilt = 2000.0, 8.0, np.radians(2.0)
    exterior, camera = tilted_at(above, float(tilt), 0.7), camera_with(152.0)
    line = np.linspace(-1200, 1200, 7)
    plan = np.stack(np.meshgrid(line, line), axis=2).reshape(-1, 2)
    flat, lifted = (
        film_from_object(np.column_stack([plan, np.full(len(plan), h)]), exterior, camera)
        for h in (0.0, height)
    )
    nadir, iso = nadir_on_film(exterior, 152.0)[0], isocentre_on_film(exterior, 152.0)[0]
    for centre in (np.zeros(2), iso):
        away = np.hypot(*(flat - centre).T) > 20
        low, high = (np.arctan2(*(film[away] - centre).T[::-1]) for film in (flat, lifted))
        said = direction_error(
            np.full(away.sum(), height), above, nadir - centre, flat[away] - centre
        )
        # Scale changes by c tan t r / c^2 over the photo, 3 % here; the rest is of second order.
        assert (high - low) == pytest.approx(said, rel=0.05, abs=0.02 * np.abs(said).max())


def test_errors_grow_with_relief_and_vanish_about_no_other_point__law() -> None:
    flat, low, high = (
        np.sqrt(np.mean(errors(flight_of(relief, 0.03), "isocentre")[1] ** 2))
        for relief in (0.0, 20.0, 40.0)
    )
    assert flat < 1e-4
    # To first order in relief; four per cent of tilt and relief are left.
    assert high / low == pytest.approx(2.0, rel=0.1)
    _, nadir = errors(flight_of(40.0, 0.03), "nadir")
    _, principal = errors(flight_of(40.0, 0.03), "principal")
    assert 0.01 < np.sqrt(np.mean(nadir**2)) < np.sqrt(np.mean(principal**2))


def test_two_known_points_are_enough_and_one_is_not__law() -> None:
    flight = flight_of(0.0, 0.0)
    two, one = (
        {name: point for name, point in flight.block.surveyed.items() if int(name) < count}
        for count in (2, 1)
    )
    kept = [
        replace(
            flight.block,
            surveyed=known,
            measurements={k: m for k, m in flight.block.measurements.items() if k[0] in known},
        )
        for known in (two, one)
    ]
    found = triangulate_radially(kept[0])
    assert isinstance(found, RadialResult)
    assert np.abs(found.places - flight.ties[found.numbers, :2]).max() < 1e-3
    assert isinstance(triangulate_radially(kept[1]), Failure)
