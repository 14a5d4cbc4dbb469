"""Ames Stereo Pipeline: its own test files, round trips on the Earth, broken files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from pyproj import Transformer

from core.errors import CrsError, ProjectError
from core.formats.asp import read_asp, write_asp
from core.formats.exchange import ExchangeBlock
from core.geometry.exterior import ExteriorOrientation
from core.geometry.map_in_space import map_crs, map_in_space, zone_of
from tests.exchanged import (
    RECIPES,
    Recipe,
    assert_same_geometry,
    assert_same_measurements,
    assert_same_points,
    block_of,
)

SHIFT = np.array([1203000.0, 6603000.0, 0.0])
"""From the random blocks in S-JTSK to UTM zone 33."""


def in_utm(block: ExchangeBlock) -> ExchangeBlock:
    """A random block with its coordinates shifted into UTM 33 North, its ties left out."""
    photos = {
        name: replace(
            photo,
            exterior=ExteriorOrientation(
                photo.orientation.centre + SHIFT,
                photo.orientation.omega,
                photo.orientation.phi,
                photo.orientation.kappa,
            ),
        )
        for name, photo in block.photos.items()
    }
    points = {
        name: replace(point, position=tuple((np.array(point.position) + SHIFT).tolist()))
        for name, point in block.points.items()
    }
    return ExchangeBlock("EPSG:32633", block.cameras, photos, points, block.measurements)


@settings(max_examples=12)
@given(RECIPES)
def test_cameras_and_control_come_back_from_the_earth__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block = in_utm(block_of(recipe, "upright"))
    folder = tmp_path_factory.mktemp("asp")
    notes = write_asp(folder, block)
    assert len(notes) == 1
    again = read_asp(folder)
    assert again.crs == "EPSG:32633"
    shifted = {n: replace(p, exterior=_back(p.orientation)) for n, p in again.photos.items()}
    plain = {n: replace(p, exterior=_back(p.orientation)) for n, p in block.photos.items()}
    assert_same_geometry(replace(block, photos=plain), replace(again, photos=shifted))
    assert_same_points(block, again)
    assert_same_measurements(block, again)
    for name, point in block.points.items():
        assert again.points[name].role == point.role
        assert again.points[name].sigma_m == point.sigma_m


def _back(exterior: ExteriorOrientation) -> ExteriorOrientation:
    return ExteriorOrientation(
        exterior.centre - SHIFT, exterior.omega, exterior.phi, exterior.kappa
    )


def test_its_own_control_is_read_and_written_again_the_same__real(
    shared_data: Path, tmp_path: Path
) -> None:
    folder = shared_data / "exchange-samples/asp"
    block = read_asp(folder / "mt_sidley.gcp")
    assert len(block.points) == 12
    assert len(block.measurements) == 24
    assert set(block.photos) == {"mt_sidley_47", "mt_sidley_48"}
    assert block.crs == "EPSG:32709"
    # The point lies where its degrees say, its pixel half a pixel further from our corner.
    to_map = Transformer.from_crs("EPSG:4326", block.crs, always_xy=True)
    east, north = to_map.transform(-126.181, -77.1308)
    np.testing.assert_allclose(block.points["0"].position, [east, north, 2213.74], atol=1e-6)
    assert (block.measurements[0].column, block.measurements[0].row) == (2967.71, 6683.97)
    write_asp(tmp_path, block)
    again = read_asp(tmp_path)
    assert_same_points(block, again)
    assert_same_measurements(block, again)


def test_its_own_camera_stands_in_a_frame_of_its_own__real(shared_data: Path) -> None:
    block = read_asp(shared_data / "exchange-samples/asp/camera_info.tsai")
    photo = block.photos["camera_info"]
    np.testing.assert_allclose(photo.orientation.centre, [266.943, -105.583, -2.14189])
    np.testing.assert_allclose(photo.interior, [[3057.67, 0, 4457.5], [0, -3057.67, 4417.5]])
    # The file's R turns x right, y down, z forwards; ours x right, y up, z backwards.
    turn = photo.orientation.object_from_image @ np.diag([1, -1, -1])
    given = np.array([[0.0825447, 0.996303, -0.0238243], [-0.996008, 0.0832884, 0.0321213],
                      [0.0339869, 0.0210777, 0.9992]])  # fmt: skip
    np.testing.assert_allclose(turn, given, atol=2e-5)
    assert block.crs == ""
    assert "frame of their own" in block.notes[0]


def test_the_axes_of_a_map_turn_by_its_convergence__oracle() -> None:
    # Grid north of UTM turns from true north by (longitude - 15) sin(latitude), to first order.
    earth = map_in_space(map_crs("EPSG:32633", ""))
    place = earth.from_degrees(np.array([[16.0, 50.0, 300.0]]))[0]
    axes = earth.turn_at(place)
    assert np.allclose(axes.T @ axes, np.eye(3))
    lon, lat = np.radians([16.0, 50.0])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    np.testing.assert_allclose(axes[:, 2], up, atol=1e-9)
    turned = np.arcsin(np.cross(east, axes[:, 0]) @ up)
    assert np.degrees(turned) == pytest.approx(-np.sin(lat), abs=1e-3)


def test_zones__truth() -> None:
    assert zone_of(np.array([[14.4, 50.0, 0]])) == "EPSG:32633"
    assert zone_of(np.array([[-70.0, -33.0, 0]])) == "EPSG:32719"
    assert zone_of(np.array([[10.0, -85.0, 0]])) == "EPSG:3031"
    assert zone_of(np.array([[10.0, 85.0, 0]])) == "EPSG:3995"


CAMERA = "fu = 10\nfv = 10\ncu = 5\ncv = 5\nC = 1 2 3\nR = 1 0 0 0 1 0 0 0 1\npitch = 0.01\n"
POINT = "1 50 14 200 1 1 1 a.tif 10 20 1 1\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.tsai", CAMERA.replace("fu = 10\n", ""), "entry 'fu' is missing"),
        ("a.tsai", CAMERA.replace("R = 1", "R = 2"), "R is no rotation"),
        ("a.tsai", CAMERA.replace("C = 1 2 3", "C = 1 2"), "ends after 3 entries"),
        ("a.tsai", CAMERA.replace("cu = 5", "cu = five"), "'five' is not a number"),
        ("a.gcp", POINT + POINT, "Line 2: 1 stands twice"),
        ("a.gcp", "1 480000 5500000 200 1 1 1\n", "480000.* is no latitude"),
        ("a.gcp", POINT.replace(" 1 1\n", " 1\n"), "ends after 11 entries"),
        ("a.gcp", "1 50 14\n", "ends after 3 entries"),
        ("a.gcp", POINT.replace("14", "nan"), "'nan' is not a number"),
        ("a.txt", "", "holds neither cameras"),
    ],
)
def test_broken_files_are_named__truth(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_asp(tmp_path)


def test_pitch_divides__truth(tmp_path: Path) -> None:
    (tmp_path / "a.tsai").write_text(CAMERA)
    affine = read_asp(tmp_path).photos["a"].interior
    np.testing.assert_allclose(affine, [[1000, 0, 500.5], [0, -1000, 500.5]])


def test_a_block_without_crs_has_no_earth__truth(tmp_path: Path) -> None:
    with pytest.raises(CrsError, match="no CRS"):
        write_asp(tmp_path, ExchangeBlock())
