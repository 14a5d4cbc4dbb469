"""Special points of a photo as scene and scan show them, and corrections at a place."""

from dataclasses import replace

import numpy as np
import pytest

from core.geometry.collinearity import film_from_object
from core.geometry.interior import InteriorOrientation, fit_interior
from tests.ui.desk_block import CAMERA, tiny_block
from ui.review.compare import DrawnPhoto, ground_from_pixel
from ui.review.photo_points import (
    corrections_part,
    letters_of,
    special_grounds,
    special_part,
)

DEM = tiny_block().land.dem
PHOTOS = tiny_block().block.photos


def drawn_photo(name: str) -> DrawnPhoto:
    return DrawnPhoto(PHOTOS[name], CAMERA, 1)


@pytest.mark.parametrize("name", PHOTOS)
def test_the_nadir_lies_below_the_perspective_centre__truth(name):
    photo = PHOTOS[name]
    ground = special_grounds(drawn_photo(name), DEM)["N"][0]
    assert ground[:2] == pytest.approx(photo.exterior.centre[:2], abs=0.02)
    assert ground[2] == pytest.approx(DEM.heights(ground[None, :2])[0], abs=0.01)
    places = {letter: two for letter, *two in special_part(drawn_photo(name), DEM)}
    pixel, plane = places["N"]
    below = np.array([[*photo.exterior.centre[:2], ground[2]]])
    assert pixel == pytest.approx(photo.pixel_from_object(below, CAMERA)[0], abs=0.01)
    assert plane == pytest.approx(photo.exterior.centre[:2], abs=0.02)


def test_a_camera_without_marks_has_three_points__law():
    assert letters_of(tiny_block().block) == ["N", "I", "H"]
    names = [letter for letter, *_ in special_part(drawn_photo(next(iter(PHOTOS))), DEM)]
    assert sorted(names) == ["H", "I", "N"]


def test_corrections_are_the_same_asked_for_in_scan_and_on_the_ground__law():
    drawn = drawn_photo(next(iter(PHOTOS)))
    pixel = np.array([[200.0, 300.0]])
    ground = ground_from_pixel(pixel, drawn, DEM, drawn.photo.ground_height_m)
    in_scan = corrections_part(drawn, DEM, "scan", pixel)
    on_ground = corrections_part(drawn, DEM, "ground", ground[:, :2])
    assert [row[0] for row in in_scan] == ["refraction", "curvature", "distortion", "together"]
    for one, other in zip(in_scan, on_ground, strict=True):
        assert one[1:] == pytest.approx(other[1:], abs=0.011)


def test_all_together_is_what_separates_the_photo_from_a_central_projection__law():
    """Refraction out, curvature in: their sum is the whole of a lens without distortion."""
    drawn = drawn_photo(next(iter(PHOTOS)))
    photo, pixel = drawn.photo, np.array([[150.0, 1000.0]])
    ground = ground_from_pixel(pixel, drawn, DEM, photo.ground_height_m)
    central = film_from_object(ground, photo.exterior, CAMERA)
    away = photo.interior.film_from_pixel(pixel)
    rows = {name: numbers for name, *numbers in corrections_part(drawn, DEM, "scan", pixel)}
    assert rows["refraction"][0] > 0 > rows["curvature"][0]
    assert abs(rows["together"][0]) == pytest.approx(
        1000 * np.linalg.norm(away - central), abs=0.02
    )
    assert rows["together"][1] == pytest.approx(
        rows["together"][0] / 1000 / photo.interior.pixel_size_mm, abs=0.001
    )


def test_beside_the_scan_and_where_no_ray_meets_the_ground_nothing_is_told__law():
    drawn = drawn_photo(next(iter(PHOTOS)))
    assert corrections_part(drawn, DEM, "ground", np.array([[np.nan, 0.0]])) == []
    assert corrections_part(drawn, DEM, "scan", np.array([[-1.0, 300.0]])) == []
    assert corrections_part(drawn, DEM, "scan", np.array([[300.0, 1201.0]])) == []


def test_a_camera_with_marks_has_a_fiducial_centre_and_its_film_a_shape__truth():
    """Film longer by a thousandth along x than along y: half of it either way of a similarity."""
    certified = np.array([[-80.0, 80.0], [80.0, 80.0], [80.0, -80.0], [-80.0, -80.0]])
    camera = replace(
        CAMERA, fiducials_mm={str(n): (x, y) for n, (x, y) in enumerate(certified.tolist())}
    )
    pixels = np.column_stack([1.0005 * certified[:, 0], -0.9995 * certified[:, 1]]) / 0.15 + 600
    interior = fit_interior(tuple("0123"), pixels, certified, "affine")
    assert isinstance(interior, InteriorOrientation)
    photo = replace(next(iter(PHOTOS.values())), interior=interior)
    drawn = DrawnPhoto(photo, camera, 1)
    block = replace(tiny_block().block, cameras={CAMERA.name: camera})
    assert letters_of(block) == ["N", "I", "H", "M"]
    letter, pixel, _ = special_part(drawn, DEM)[-1]
    assert (letter, pixel) == ("M", pytest.approx([600.0, 600.0], abs=0.01))
    place = interior.pixel_from_film(np.array([[60.0, 0.0]]))
    rows = {name: numbers for name, *numbers in corrections_part(drawn, DEM, "scan", place)}
    assert rows["film"][0] == pytest.approx(30.0, abs=0.2)
    assert rows["film"][1] == pytest.approx(0.2, abs=0.005)
