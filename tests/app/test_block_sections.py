"""Marks and lens tables from files: read into the camera, used by the scans, written back."""

from pathlib import Path

import numpy as np
import pytest

from app.project import described, read_project
from app.report.tables import write_fiducials
from core.errors import PhotogrammetryError
from core.formats.micmac_points import (
    read_camera_measures,
    read_image_measures,
    write_camera_measures,
    write_image_measures,
)
from core.geometry.collinearity import film_from_object
from core.geometry.exterior import ExteriorOrientation
from core.progress import Work
from core.results import BlockInput
from core.scans.stage import ScanSet, orient_scans
from tests.core.scans.film_maker import FIDUCIALS, Film, make_film

TOML = """
[block]
name = "one-film"
crs = "EPSG:5514"

[camera.little]
principal_distance_mm = 60.0
frame_mm = [60.0, 60.0]
{camera}

[scans]
files = "scans/*.tif"
camera = "little"
scan_pixel_um = 40.0
{scans}

[reference]
ortho = "ortho.tif"
dem = "dem.tif"
ortho_sigma_m = 0.25
dem_sigma_m = 0.5
"""
K0, K1, K2 = 2e-4, -3e-7, 4e-11
RADII = [5.0, 10.0, 15.0, 20.0, 25.0, 30.0]
TABLE = [[r, 1000 * (K0 * r + K1 * r**3 + K2 * r**5)] for r in RADII]
"""Micrometres by millimetres; what is linear is scale, a part of the principal distance."""


def read(folder: Path, camera: str, scans: str = "") -> BlockInput:
    for name in ("ortho.tif", "dem.tif"):
        (folder / name).touch()
    (folder / "block.toml").write_text(TOML.format(camera=camera, scans=scans), encoding="utf-8")
    return described(read_project(folder))


def oriented(given: BlockInput) -> ScanSet:
    return orient_scans(given.scans, given.cameras, Work())


@pytest.fixture
def film(tmp_path: Path) -> tuple[Path, dict[str, tuple[float, float]]]:
    (tmp_path / "scans").mkdir()
    return tmp_path, make_film(tmp_path / "scans" / "film.tif", Film(), 3)


def test_marks_of_micmac_s_camera_file_are_found_and_written_back__truth(film) -> None:
    folder, truth = film
    write_camera_measures(folder / "MeasuresCamera.xml", FIDUCIALS)
    given = read(folder, 'fiducials_file = "MeasuresCamera.xml"')
    marks = {name: pytest.approx(place) for name, place in FIDUCIALS.items()}
    assert given.cameras["little"].fiducials_mm == marks
    scans = oriented(given)
    (folder / "results").mkdir()
    write_fiducials(folder / "results", given, scans)
    written = folder / "results" / "Ori-InterneScan"
    pixels = read_image_measures(written / "MeasuresIm-film.tif.xml")["film.tif"]
    for name, place in truth.items():
        assert np.hypot(*(np.array(pixels[name]) - place)) < 0.1
    assert read_camera_measures(written / "MeasuresCamera.xml") == marks


def test_measures_by_hand_go_before_found_marks__truth(film) -> None:
    folder, truth = film
    by_hand = {name: (column + 0.4, row - 0.3) for name, (column, row) in truth.items()}
    write_image_measures(folder / "MeasuresIm-film.tif.xml", "film.tif", by_hand)
    places = ", ".join(f"{name} = {list(place)}" for name, place in FIDUCIALS.items())
    given = read(
        folder, f"fiducials_mm = {{ {places} }}", 'fiducial_measures = ["MeasuresIm-film.tif.xml"]'
    )
    marks = oriented(given).oriented["film"].fiducials
    assert {mark.kind for mark in marks} == {"by hand"}
    for mark in marks:
        assert (mark.column, mark.row) == pytest.approx(by_hand[mark.name], abs=1e-6)


def test_certificate_s_lens_table_becomes_a_polynomial__truth(film) -> None:
    folder, _ = film
    stated = read(folder, "").cameras["little"].principal_distance_mm
    camera = read(folder, f"distortion_table_um = {TABLE}").cameras["little"]
    radii, shifts_um = np.array(TABLE).T
    directions = np.column_stack([radii, 0 * radii, np.full(len(radii), -stated)])
    film = film_from_object(directions, ExteriorOrientation(np.zeros(3), 0, 0, 0), camera)
    # What is linear was left out, which is up to 15 um at the rim of usual certificates.
    shifts_mm = film[:, 0] - camera.principal_point_mm[0] - radii
    np.testing.assert_allclose(1000 * shifts_mm, shifts_um, atol=1e-6)


@pytest.mark.parametrize(
    ("camera", "scans", "word"),
    [
        ("distortion_table_um = [[10.0, 1.0]]", "", "distortion_table_um"),
        ("distortion_table_um = [[10, 1]]\nradial_distortion = [1e-8]", "", "distortion_table_um"),
        ('fiducials_file = "nowhere.xml"', "", "fiducials_file"),
        ('fiducials_file = "dem.tif"', "", "dem.tif"),
        ("", 'fiducial_measures = ["nowhere.xml"]', "fiducial_measures"),
        ("", 'fiducial_measures = ["dem.tif"]', "dem.tif"),
    ],
)
def test_what_cannot_be_used_is_named__truth(film, camera: str, scans: str, word: str) -> None:
    folder, _ = film
    with pytest.raises(PhotogrammetryError, match=word):
        read(folder, camera, scans)
