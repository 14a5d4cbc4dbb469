"""Image corrections against the tables of the notes on image coordinates, and plain effects.

Tables 4.1 and 4.2 (after Pavelka 1988) do not say the radius on the film nor the height of the
ground; with r = 130 mm and ground at 500 m the standard formulas give every row (METHODS 7.2).
"""

import numpy as np
import pytest

from core.doubts import Failure
from core.geometry.camera import Camera, polynomial_from_table
from core.geometry.collinearity import (
    EARTH_RADIUS_M,
    Atmosphere,
    atmosphere_of,
    film_from_object,
    refraction_constant,
)
from core.geometry.exterior import ExteriorOrientation

RADIUS_MM, GROUND_M = 130.0, 500.0
TABLE_4_1 = [
    (5_000, 2.0, 300, 3), (5_000, 1.3, 150, 3), (5_000, 0.9, 85, 3),
    (10_000, 3.5, 300, 5), (10_000, 2.0, 150, 4), (10_000, 1.3, 85, 5),
    (20_000, 6.5, 300, 9), (20_000, 3.5, 150, 8), (20_000, 2.2, 85, 9),
    (100_000, 9.0, 85, 34), (800_000, 800.0, 1000, 2),
]  # fmt: skip
"""Scale, flying height (km above the sea), principal distance (mm), refraction (um). The last row
is a satellite: the formula of the standard atmosphere ends far below."""
TABLE_4_2 = [
    (85, 0.4, 10), (150, 0.8, 6), (300, 1.5, 3), (85, 0.8, 17), (150, 1.5, 11), (300, 3.0, 6),
    (85, 1.7, 40), (150, 3.0, 23), (300, 6.0, 11), (85, 2.5, 60), (150, 4.5, 34), (300, 9.0, 17),
]  # fmt: skip
"""Principal distance (mm), height over ground (km), curvature (um, towards the middle)."""


def shift_um(principal_mm: float, above_m: float, ground_m: float, air: Atmosphere) -> float:
    """How far an image point at the radius is moved outwards by what the light goes through."""
    camera = Camera("wide", principal_mm, (260.0, 260.0))
    exterior = ExteriorOrientation(np.array([0.0, 0.0, ground_m + above_m]), 0.0, 0.0, 0.3)
    away = RADIUS_MM / principal_mm * above_m
    point = np.array([[0.6 * away, 0.8 * away, ground_m]])
    plain = np.linalg.norm(film_from_object(point, exterior, camera))
    return 1000 * float(np.linalg.norm(film_from_object(point, exterior, camera, air)) - plain)


@pytest.mark.parametrize(
    ("height_km", "principal_mm", "told_um"), [row[1:] for row in TABLE_4_1[:-1]]
)
def test_refraction_is_that_of_table_4_1__paper(height_km, principal_mm, told_um):
    height = 1000 * height_km
    air = Atmosphere(refraction=refraction_constant(height, GROUND_M))
    outwards = shift_um(principal_mm, height - GROUND_M, GROUND_M, air)
    # The table has whole micrometres.
    assert outwards == pytest.approx(told_um, abs=0.55)


@pytest.mark.parametrize(("principal_mm", "height_km", "told_um"), TABLE_4_2)
def test_curvature_is_that_of_table_4_2__paper(principal_mm, height_km, told_um):
    above = 1000 * height_km
    air = Atmosphere(curvature_per_m=1 / (2 * EARTH_RADIUS_M))
    inwards = -shift_um(principal_mm, above, GROUND_M, air)
    # The table's heights are rounded to 0.1 km and its scale is not quite c / h: 2.1 um at most.
    assert inwards == pytest.approx(told_um, abs=2.1)


def test_a_photo_of_1984_has_the_corrections_of_its_notes__paper():
    """METHODS 7.2: in the corner of a 23 cm frame 52 um of curvature and 13 um of refraction."""
    height = 152.0 * 30.0  # 1 : 30 000
    air = atmosphere_of(height + 200.0, 200.0)
    corner = 115 * np.sqrt(2)
    bend = 1000 * air.refraction * (corner + corner**3 / 152.0**2)
    drop = 1000 * height * corner**3 * air.curvature_per_m / 152.0**2
    assert bend == pytest.approx(19.0, abs=7.0)
    assert drop == pytest.approx(60.0, abs=10.0)


def test_on_the_ground_light_is_not_bent__law():
    assert refraction_constant(0.0, 0.0) == 0.0
    assert refraction_constant(400.0, 400.0) == pytest.approx(0.0, abs=1e-12)


def test_a_certificates_table_becomes_a_polynomial__truth():
    radii = np.arange(10.0, 151.0, 10.0)
    k = (-3e-8, 2e-12, 0.0)
    shifts = 1000 * radii * (k[0] * radii**2 + k[1] * radii**4)
    table = list(zip(radii.tolist(), shifts.tolist(), strict=True))
    fitted = polynomial_from_table([(0.0, 0.0), *table], terms=2)
    assert not isinstance(fitted, Failure)
    assert fitted[0] == pytest.approx(k, rel=1e-6, abs=1e-20)
    assert fitted[1] < 1e-6
    assert isinstance(polynomial_from_table(table[:2]), Failure)
