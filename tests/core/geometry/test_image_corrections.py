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
    VACUUM,
    Atmosphere,
    atmosphere_of,
    film_from_object,
    object_from_film,
    refraction_constant,
)
from core.geometry.exterior import (
    ExteriorOrientation,
    angles_from_rotation,
    rotation_from_angles,
)
from core.geometry.image_corrections import (
    curvature_um,
    ground_displacement_m,
    image_motion_mm,
    isocentre_on_film,
    nadir_on_film,
    photo_scale,
    radial_from_table_um,
    refraction_um,
    relief_displacement_mm,
    shifts_at,
    shrinkage_factor,
    special_points,
    tangential_mm,
    tilt_displacement_mm,
)
from core.geometry.interior import InteriorOrientation, fit_interior, nominal_interior
from core.geometry.resection import PhotoModel

RADIUS_MM, GROUND_M = 130.0, 500.0
R_MM = np.array([129.0])
"""The tables do not name their radius; all their rows fit one between 129.0 and 129.6 mm."""
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


@pytest.mark.parametrize(("scale", "height_km", "principal_mm", "told_um"), TABLE_4_1)
def test_every_row_of_table_4_1_within_2_um__paper(scale, height_km, principal_mm, told_um):
    height = 1000.0 * height_km
    ground = max(0.0, height - scale * principal_mm / 1000)
    k = refraction_constant(height, ground)
    assert refraction_um(R_MM, float(principal_mm), k)[0] == pytest.approx(told_um, abs=2.0)


@pytest.mark.parametrize(("principal_mm", "height_km", "told_um"), TABLE_4_2)
def test_every_row_of_table_4_2_within_2_um__paper(principal_mm, height_km, told_um):
    found = curvature_um(R_MM, float(principal_mm), 1000 * height_km)[0]
    assert found == pytest.approx(told_um, abs=2.0)


def test_image_motion_of_the_example__paper():
    """180 km/h, 1/200 s, 1:10 000: 25 micrometres."""
    assert 1000 * image_motion_mm(180.0, 1 / 200, 150.0, 1500.0) == pytest.approx(25.0, abs=0.01)


def test_scale_is_that_of_similar_triangles__paper():
    assert photo_scale(150.0, 1800.0, 300.0) == pytest.approx(1e-4)


def test_relief_displacement_is_what_collinearity_gives__law():
    camera = Camera("wide", 152.0, (230.0, 230.0))
    exterior = ExteriorOrientation(np.array([0.0, 0.0, 3000.0]), 0.0, 0.0, 0.4)
    foot, top = np.array([[1500.0, 800.0, 0.0]]), np.array([[1500.0, 800.0, 50.0]])
    r_foot, r_top = (
        np.linalg.norm(film_from_object(p, exterior, camera), axis=1) for p in (foot, top)
    )
    leaning = relief_displacement_mm(r_top, np.array([50.0]), 3000.0)
    assert r_top - r_foot == pytest.approx(leaning, rel=1e-9)


@pytest.mark.parametrize("direction", [0.0, 1.1, 4.0])
@pytest.mark.parametrize("tilt_deg", [0.5, 12.0, 50.0])
def test_tilt_displacement_is_what_collinearity_gives__truth(tilt_deg, direction):
    """Rays of a tilted photo, seen by a vertical one from the same place, about the isocentre."""
    tilt, c = float(np.radians(tilt_deg)), 152.0
    turn = rotation_from_angles(0.0, 0.0, direction)
    leaning = turn @ rotation_from_angles(0.0, -tilt, 0.0) @ turn.T
    centre = np.array([0.0, 0.0, 1500.0])
    tilted = ExteriorOrientation(centre, *angles_from_rotation(leaning))
    vertical = ExteriorOrientation(centre, 0.0, 0.0, 0.0)
    camera = Camera("lesson", c, (230.0, 230.0))
    film = np.array([[60.0, 40.0], [-90.0, 10.0], [5.0, -80.0]])
    iso, nadir = isocentre_on_film(tilted, c), nadir_on_film(tilted, c)[0]
    ground = object_from_film(np.vstack([film, iso]), np.zeros(4), tilted, camera)
    straight = film_from_object(ground, vertical, camera)
    away, plain = film - iso, straight[:3] - straight[3]
    azimuth = np.arctan2(away[:, 1], away[:, 0]) - np.arctan2(-nadir[1], -nadir[0])
    radius = np.hypot(*away.T)
    seen = radius * np.sin(tilt) * np.cos(azimuth) < c
    told = tilt_displacement_mm(radius, azimuth, tilt, c)
    assert told[seen] == pytest.approx((radius - np.hypot(*plain.T))[seen], abs=1e-9)


def test_a_dem_that_is_too_high_moves_a_point_towards_the_nadir__truth():
    """The ray of a point meets the false ground above it, nearer to the plumb line."""
    camera = Camera("wide", 152.0, (230.0, 230.0))
    centre, point = np.array([0.0, 0.0, 3000.0]), np.array([1500.0, 800.0, 0.0])
    exterior = ExteriorOrientation(centre, 0.0, 0.0, 0.0)
    radius = float(np.linalg.norm(film_from_object(point[None], exterior, camera)))
    met = centre + (centre[2] - 8.0) / centre[2] * (point - centre)
    moved = ground_displacement_m(radius, 8.0, camera.principal_distance_mm)
    assert moved == pytest.approx(float(np.linalg.norm((point - met)[:2])), rel=1e-9)


def test_vertical_edges_meet_in_the_nadir__law():
    camera = Camera("wide", 152.0, (230.0, 230.0))
    exterior = ExteriorOrientation(np.array([10.0, -5.0, 2000.0]), 0.04, -0.03, 1.1)
    nadir = nadir_on_film(exterior, 152.0)
    below = film_from_object(np.array([[10.0, -5.0, 0.0]]), exterior, camera)
    assert nadir == pytest.approx(below, abs=1e-9)
    middle = isocentre_on_film(exterior, 152.0)
    assert np.linalg.norm(middle) == pytest.approx(np.linalg.norm(nadir) / 2, rel=2e-3)
    assert isocentre_on_film(
        ExteriorOrientation(np.zeros(3), 0.0, 0.0, 1.0), 152.0
    ) == pytest.approx(0.0, abs=1e-12)


def test_shrinkage_factor_undoes_shrinkage__law():
    certified = np.array([[-106.0, 106.0], [106.0, 106.0], [106.0, -106.0], [-106.0, -106.0]])
    assert shrinkage_factor(certified, certified * 0.9993 + 3.0) == pytest.approx(1 / 0.9993)


def test_tangential_distortion_has_the_symmetry_of_its_formula__law():
    points = np.array([[50.0, 20.0], [-50.0, -20.0]])
    moved = tangential_mm(points, 1e-7, -2e-7)
    assert moved[0] == pytest.approx(moved[1])
    assert moved[0, 0] == pytest.approx(1e-7 * (2900 + 5000) - 4e-7 * 1000)


def test_a_certificates_table_becomes_a_polynomial__truth():
    radii = np.arange(10.0, 151.0, 10.0)
    k = (-3e-8, 2e-12, 0.0)
    shifts = 1000 * radii * (k[0] * radii**2 + k[1] * radii**4)
    table = list(zip(radii.tolist(), shifts.tolist(), strict=True))
    fitted = polynomial_from_table([(0.0, 0.0), *table], terms=2)
    assert not isinstance(fitted, Failure)
    assert fitted[0] == pytest.approx(1.0)
    assert fitted[1] == pytest.approx(k, rel=1e-6, abs=1e-20)
    assert fitted[2] < 1e-6
    assert radial_from_table_um(np.array([15.0]), table)[0] == pytest.approx(shifts[:2].mean())
    assert isinstance(polynomial_from_table(table[:2]), Failure)


MARKS = {"1": (-106.0, 106.0), "2": (106.0, 106.0), "3": (106.0, -106.0), "4": (-106.0, -106.0)}


def model_of(principal_mm: float, air: Atmosphere = VACUUM, **camera) -> PhotoModel:
    wide = Camera("wide", principal_mm, (260.0, 260.0), **camera)
    return PhotoModel(nominal_interior((13000, 13000), wide, 0.02), wide, air)


@pytest.mark.parametrize("tilt_deg", [0.5, 3.0, 20.0])
def test_nadir_and_isocentre_of_a_tilted_photo_lie_where_the_tilt_puts_them__truth(tilt_deg):
    """Put in: a tilt about the y axis. Off the principal point, which is off the marks' middle."""
    tilt = np.radians(tilt_deg)
    exterior = ExteriorOrientation(np.array([0.0, 0.0, 2000.0]), 0.0, tilt, 0.0)
    camera = {"principal_point_mm": (0.4, -0.3), "fiducials_mm": MARKS}
    points = special_points(model_of(152.0, **camera), exterior)
    assert points["principal"][0] == pytest.approx([0.4, -0.3], abs=1e-12)
    assert points["fiducial_centre"][0] == pytest.approx([0.0, 0.0], abs=1e-12)
    away = {name: place[0] - points["principal"][0] for name, place in points.items()}
    assert np.abs(away["nadir"]) == pytest.approx([152 * np.tan(tilt), 0.0], abs=1e-9)
    assert np.abs(away["isocentre"]) == pytest.approx([152 * np.tan(tilt / 2), 0.0], abs=1e-9)
    assert away["nadir"][0] * away["isocentre"][0] > 0


def test_a_camera_without_marks_has_no_fiducial_centre__law():
    exterior = ExteriorOrientation(np.array([0.0, 0.0, 2000.0]), 0.0, 0.0, 0.0)
    assert set(special_points(model_of(152.0), exterior)) == {"principal", "isocentre", "nadir"}


def test_the_nadir_in_the_scan_is_what_lies_below_the_camera__law():
    """Through lens and air as well."""
    air = Atmosphere(5e-5, 1 / (2 * EARTH_RADIUS_M))
    model = model_of(152.0, air, radial_distortion=(2e-7, 0.0, 0.0))
    exterior = ExteriorOrientation(np.array([10.0, -5.0, 2000.0]), 0.2, -0.1, 1.1)
    below = model.pixels(np.array([[10.0, -5.0, 0.0]]), exterior)
    nadir = model.interior.pixel_from_film(special_points(model, exterior)["nadir"])
    assert nadir == pytest.approx(below, abs=1e-6)


def shift_at(radius_mm: float, model: PhotoModel, above_m: float, ground_m: float, effect: str):
    """What an effect does to a place at a radius, outwards; um, pixels and metres."""
    exterior = ExteriorOrientation(np.array([0.0, 0.0, ground_m + above_m]), 0.0, 0.0, 0.3)
    film = radius_mm * np.array([[0.6, -0.8]])
    pixel = model.interior.pixel_from_film(film)
    found = shifts_at(pixel, np.array([ground_m]), model, exterior)[effect]
    film_mm, pixels, metres = (
        float(np.linalg.norm(part)) for part in (found.film_mm, found.pixel_px, found.ground_m)
    )
    return 1000 * found.sign(film) * film_mm, pixels, metres


@pytest.mark.parametrize(("scale", "height_km", "principal_mm", "told_um"), TABLE_4_1[:-1])
def test_refraction_at_a_place_is_that_of_table_4_1__paper(scale, height_km, principal_mm, told_um):
    height = 1000.0 * height_km
    ground = max(0.0, height - scale * principal_mm / 1000)
    model = model_of(float(principal_mm), Atmosphere(refraction_constant(height, ground)))
    moved, pixels, metres = shift_at(R_MM[0], model, height - ground, ground, "refraction")
    assert moved == pytest.approx(told_um, abs=2.0)
    assert pixels == pytest.approx(moved / 20, rel=1e-9)
    # On a vertical photo a length of film times the scale is one of ground.
    assert metres == pytest.approx(moved / 1e6 * (height - ground) / principal_mm * 1000, rel=1e-3)


@pytest.mark.parametrize(("principal_mm", "height_km", "told_um"), TABLE_4_2)
def test_curvature_at_a_place_is_that_of_table_4_2__paper(principal_mm, height_km, told_um):
    model = model_of(float(principal_mm), Atmosphere(0.0, 1 / (2 * EARTH_RADIUS_M)))
    moved, pixels, metres = shift_at(R_MM[0], model, 1000 * height_km, 0.0, "curvature")
    assert moved == pytest.approx(-told_um, abs=2.0)
    assert pixels == pytest.approx(-moved / 20, rel=1e-9)
    assert metres == pytest.approx(-moved / 1e3 * height_km / principal_mm * 1000, rel=3e-3)


def test_distortion_at_a_place_is_that_of_the_certificate__truth():
    model = model_of(152.0, radial_distortion=(1e-8, 0.0, 0.0))
    moved, *_ = shift_at(100.0, model, 2000.0, 0.0, "distortion")
    assert moved == pytest.approx(10.0, abs=0.01)
    none = shift_at(100.0, model_of(152.0), 2000.0, 0.0, "distortion")
    assert none == pytest.approx((0, 0, 0), abs=1e-9)


def test_film_deformation_at_a_place_is_what_was_put_into_the_film__truth():
    """Shrunk by 0.8 per mille more along x than along y: half of it either way of a similarity."""
    certified = np.array(list(MARKS.values()))
    shrunk = certified * [1 - 0.0012, 1 - 0.0004]
    pixels = np.column_stack([shrunk[:, 0] + 130, 130 - shrunk[:, 1]]) / 0.02
    interior = fit_interior(tuple(MARKS), pixels, certified, "affine")
    assert isinstance(interior, InteriorOrientation)
    camera = Camera("wide", 152.0, (260.0, 260.0), fiducials_mm=MARKS)
    model = PhotoModel(interior, camera, VACUUM)
    exterior = ExteriorOrientation(np.array([0.0, 0.0, 1520.0]), 0.0, 0.0, 0.0)
    pixel = np.array([[130 + 100 * (1 - 0.0012), 130 + 50 * (1 - 0.0004)]]) / 0.02
    found = shifts_at(pixel, np.zeros(1), model, exterior)["film"]
    assert 1000 * found.film_mm[0] == pytest.approx([-40.0, -20.0], abs=0.1)
    assert found.pixel_px[0] == pytest.approx([-2.0, 1.0], abs=0.01)
    assert found.ground_m[0] == pytest.approx([-0.4, -0.2, 0.0], abs=0.001)
    assert "film" not in shifts_at(pixel, np.zeros(1), model_of(152.0), exterior)
