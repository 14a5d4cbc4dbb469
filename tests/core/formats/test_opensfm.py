"""OpenSfM's projects: a block comes back, and what OpenSfM wrote lies where its GPS says."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from pyproj import Transformer

from core.errors import PhotogrammetryError
from core.formats.exchange import ExchangeBlock, pixels_of
from core.formats.opensfm import read_odm, read_opensfm, write_odm, write_opensfm
from tests.exchanged import (
    RECIPES,
    Recipe,
    assert_same_geometry,
    assert_same_measurements,
    assert_same_points,
    assert_same_ties,
    block_of,
)

FULL: Recipe = (77, 4, 3, True)
SAMPLES = "exchange-samples/opensfm"


@given(RECIPES)
@settings(max_examples=25)
def test_a_block_comes_back__law(tmp_path_factory: pytest.TempPathFactory, recipe: Recipe) -> None:
    block, folder = block_of(recipe, "upright"), tmp_path_factory.mktemp("opensfm")
    write_opensfm(folder, block)
    again = read_opensfm(folder)
    assert again.crs == block.crs
    assert_same_geometry(block, again)
    assert_same_points(block, again)
    assert_same_measurements(block, again)
    assert_same_ties(block, again)
    if block.ties.positions is not None:
        order = [block.ties.names.index(name) for name in again.ties.names]
        assert again.ties.positions is not None
        assert np.allclose(again.ties.positions, block.ties.positions[order], rtol=0, atol=1e-6)


def test_opencv_sees_the_same_places__oracle(tmp_path: Path) -> None:
    """Points in east, north, up, turned and projected by OpenCV with the file's own numbers."""
    block = block_of(FULL, "upright")
    write_opensfm(tmp_path, block)
    whole = json.loads((tmp_path / "reconstruction.json").read_text())[0]
    ties = block.ties
    assert ties.positions is not None
    for name, photo in block.photos.items():
        shot = whole["shots"][photo.file]
        camera = whole["cameras"][shot["camera"]]
        points = np.array([whole["points"][one]["coordinates"] for one in ties.names])
        lens = np.array([camera[key] for key in ("k1", "k2", "p1", "p2", "k3")])
        inner = np.array([
            [camera["focal_x"], 0, camera["c_x"]], [0, camera["focal_y"], camera["c_y"]], [0, 0, 1]
        ])  # fmt: skip
        shown, _ = cv2.projectPoints(
            points, np.array(shot["rotation"]), np.array(shot["translation"]), inner, lens
        )
        pixels = shown.reshape(-1, 2) * 9000 + [4500, 4400]
        ours = pixels_of(ties.positions, photo, block.camera_of(name))
        # The Earth is curved and the map's scale 0.9999; nothing else may differ.
        assert np.abs(pixels - ours).max() < 3.0
        # Straight below nothing of that shows: there only the frames themselves count.
        nadir = np.argmin(np.linalg.norm(ours - np.array([4500, 4400]), axis=1))
        assert np.abs(pixels - ours)[nadir].max() < 0.6


def test_places_lie_where_gps_says__real(shared_data: Path) -> None:
    """Metres of a receiver against centres, both in what OpenSfM wrote; ours is by PROJ."""
    path = shared_data / SAMPLES / "orthority_odm.json"
    block = read_opensfm(path)
    assert block.crs == "EPSG:32651"
    whole = json.loads(path.read_text())[0]
    place = whole["reference_lla"]
    to_map = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
        f"+lon_0={place['longitude']} +lat_0={place['latitude']} +h_0={place['altitude']} "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=utm +zone=51 +ellps=WGS84"
    )
    for name, photo in block.photos.items():
        shot = whole["shots"][name]
        rotation = cv2.Rodrigues(np.array(shot["rotation"]))[0]
        centre = -rotation.T @ np.array(shot["translation"])
        assert photo.exterior is not None
        assert np.allclose(photo.exterior.centre, to_map.transform(*centre), rtol=0, atol=1e-4)
        # Photos of a drone that look down at 60 degrees; the adjustment moved them by 2.2 m at
        # most, and turned or mirrored they would be 100 m off.
        assert np.linalg.norm(centre - shot["gps_position"]) < 5.0
        assert photo.exterior.object_from_image[2, 2] > 0.8


@pytest.mark.parametrize("name", ["berlin", "sbcv", "orthority_odm"])
def test_a_reconstruction_is_the_same_again__real(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    path = shared_data / SAMPLES / f"{name}.json"
    if name == "sbcv":  # without a place on the Earth it is a model of its own
        block = read_opensfm(path)
        assert block.crs == ""
        assert block.notes
        with pytest.raises(PhotogrammetryError):
            write_opensfm(tmp_path, block)
        return
    before = json.loads(path.read_text())[0]
    shutil.copy(path, tmp_path / "reconstruction.json")
    block = read_opensfm(tmp_path)
    write_opensfm(tmp_path / "again", block)
    after = json.loads((tmp_path / "again" / "reconstruction.json").read_text())[0]
    again = read_opensfm(tmp_path / "again")
    assert before["shots"].keys() == after["shots"].keys()
    for shot, photo in block.photos.items():
        del shot
        here, there = photo.exterior, again.photos[photo.photo_id].exterior
        assert here is not None
        assert there is not None
        assert np.allclose(here.centre, there.centre, rtol=0, atol=1e-6)
        assert np.allclose(here.object_from_image, there.object_from_image, rtol=0, atol=1e-9)
    for key, camera in before["cameras"].items():
        for tag in ("k1", "k2"):
            assert np.isclose(after["cameras"][key][tag], camera[tag], rtol=1e-12)


def change(file: str, spoil: Callable[[Any], object]) -> Callable[[Path], object]:
    def spoiled(folder: Path) -> None:
        value = json.loads((folder / file).read_text())
        spoil(value)
        (folder / file).write_text(json.dumps(value))

    return spoiled


def test_points_without_height_are_told__law(tmp_path: Path) -> None:
    write_opensfm(tmp_path, block_of((7, 3, 1, False), "upright"))
    change(G, lambda all_: all_["points"][0]["position"].pop("altitude"))(tmp_path)
    again = read_opensfm(tmp_path)
    assert "P0" not in again.points
    assert any("P0: without a place" in note for note in again.notes)
    assert "P0" in {one.point_id for one in again.measurements}


R, G = "reconstruction.json", "ground_control_points.json"
SHOT = "1938_000.tif"
SPOILED: dict[str, Callable[[Path], object]] = {
    "gone": lambda folder: (folder / R).unlink(),
    "cut": lambda folder: (folder / R).write_text((folder / R).read_text()[:900]),
    "empty list": lambda folder: (folder / R).write_text("[]"),
    "no list": lambda folder: (folder / R).write_text("7"),
    "deep": lambda folder: (folder / R).write_text("[" * 100000),
    "no cameras": change(R, lambda all_: all_[0].pop("cameras")),
    "no shots": change(R, lambda all_: all_[0].pop("shots")),
    "unknown camera": change(R, lambda all_: all_[0]["shots"][SHOT].update(camera="other")),
    "nan": change(R, lambda all_: all_[0]["shots"][SHOT].update(rotation=[float("nan"), 0, 0])),
    "two numbers": change(R, lambda all_: all_[0]["shots"][SHOT].update(translation=[1, 2])),
    "words": change(R, lambda all_: all_[0]["shots"][SHOT].update(translation=["a", "b", "c"])),
    "fisheye": change(R, lambda all_: all_[0]["cameras"]["wide"].update(projection_type="fisheye")),
    "no size": change(R, lambda all_: all_[0]["cameras"]["wide"].update(width=0)),
    "no latitude": change(R, lambda all_: all_[0]["reference_lla"].pop("latitude")),
    "unknown shot": change(
        G, lambda all_: all_["points"][0]["observations"][0].update(shot_id="other.tif")
    ),
    "points cut": lambda folder: (folder / G).write_text('{"points": ['),
    "tracks of words": lambda folder: (folder / "tracks.csv").write_text(
        f"{SHOT}\t1\t0\tleft\tright\t1\t0\t0\t0\n"
    ),
    "bad crs": change("gruber.json", lambda all_: all_.update(crs="EPSG:4326")),
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_broken_project_is_refused__truth(tmp_path: Path, name: str) -> None:
    write_opensfm(tmp_path, block_of(FULL, "upright"))
    SPOILED[name](tmp_path)
    with pytest.raises(PhotogrammetryError):
        read_opensfm(tmp_path)


@given(RECIPES)
@settings(max_examples=25)
def test_points_and_measurements_come_back__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block, path = block_of(recipe, "upright"), tmp_path_factory.mktemp("odm") / "gcp_list.txt"
    write_odm(path, block)
    again = read_odm(path)
    assert again.crs == block.crs
    assert {name: photo.file for name, photo in again.photos.items()} == {
        name: photo.file for name, photo in block.photos.items()
    }
    assert_same_points(block, again)
    assert_same_measurements(block, again)


def test_a_list_for_odm_is_read_and_the_same_again__real(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "exchange-samples/odm/tmizu_gcp_list.txt"
    block = read_odm(path)
    assert block.crs == "EPSG:32654"
    assert (len(block.points), len(block.measurements)) == (4, 149)
    first = block.measurements[0]
    assert (first.photo_id, first.column, first.row) == ("IMG_6785", 333.5, 1590.5)
    assert block.points[first.point_id].position == (494399.2, 4232697.1, 5.0)
    write_odm(tmp_path / "gcp_list.txt", block)
    before = [line.split() for line in path.read_text().splitlines()[1:] if line]
    after = [line.split() for line in (tmp_path / "gcp_list.txt").read_text().splitlines()[1:]]
    assert [[*map(float, line[:5]), line[5]] for line in after] == [
        [*map(float, line[:5]), line[5]] for line in before
    ]


HEAD = "EPSG:32633\n"
ROW = "544256.7 5320919.9 5 3044 2622 IMG_0525.jpg gcp01\n"


@pytest.mark.parametrize(
    "head", ["EPSG:32633", "WGS84 UTM 33N", "+proj=utm +zone=33 +datum=WGS84 +units=m +no_defs"]
)
def test_the_first_line_names_the_crs_in_three_ways__truth(tmp_path: Path, head: str) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text(f"\ufeff{head}\n# comment\n{ROW}", encoding="utf-8")
    block = read_odm(path)
    assert "EPSG:32633" in block.crs or "zone 33N" in block.crs or "Transverse" in block.crs
    assert block.points["gcp01"].position == (544256.7, 5320919.9, 5.0)
    assert (block.measurements[0].column, block.measurements[0].row) == (3044.5, 2622.5)


SPOILED_OF_ODM = {
    "empty": "", "no points": HEAD, "no crs": ROW, "unknown crs": "EPSG:1\n" + ROW,
    "degrees": "EPSG:4326\n" + ROW, "short row": HEAD + "544256.7 5320919.9 5 3044 2622\n",
    "nan": HEAD + ROW.replace(" 5 ", " NaN "), "word": HEAD + ROW.replace("3044", "left"),
    "two places": HEAD + ROW + ROW.replace("544256.7", "544257.7"),
    "two scans": HEAD + ROW + ROW.replace(".jpg", ".tif"), "binary": HEAD + ROW + "\0",
    "infinite": HEAD + ROW.replace("2622", "inf"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILED_OF_ODM)
def test_a_broken_list_is_refused__truth(tmp_path: Path, name: str) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text(SPOILED_OF_ODM[name], encoding="utf-8")
    with pytest.raises(PhotogrammetryError):
        read_odm(path)


def test_without_crs_or_measurements_nothing_is_written__truth(tmp_path: Path) -> None:
    for block in (ExchangeBlock(), ExchangeBlock("EPSG:5514")):
        with pytest.raises(PhotogrammetryError):
            write_odm(tmp_path / "gcp_list.txt", block)
        assert not (tmp_path / "gcp_list.txt").exists()
