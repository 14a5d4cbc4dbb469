"""Metashape's XML: what Metashape wrote is read, and a block comes back as it went."""

import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from pyproj import Transformer
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation as Turn

from core.errors import PhotogrammetryError
from core.formats.exchange import ExchangeBlock, ExchangePoint, pixels_of
from core.formats.metashape import write_metashape
from core.formats.metashape_reading import read_metashape
from core.formats.xml_files import read_xml
from tests.exchanged import (
    RECIPES,
    Recipe,
    assert_same_geometry,
    assert_same_measurements,
    assert_same_points,
    block_of,
)

FULL: Recipe = (77, 4, 3, True)
SAMPLES = "exchange-samples/metashape"


@given(RECIPES)
@settings(max_examples=25)
def test_a_block_comes_back__law(tmp_path_factory: pytest.TempPathFactory, recipe: Recipe) -> None:
    crs = ("EPSG:5514", "EPSG:32633", "")[recipe[0] % 3]
    block, folder = block_of(recipe, "frame", crs), tmp_path_factory.mktemp("metashape")
    write_metashape(folder, block)
    again = read_metashape(folder)
    assert again.crs == crs
    assert_same_geometry(block, again)
    assert_same_points(block, again)
    assert_same_measurements(block, again)
    for name, photo in block.photos.items():
        assert photo.sigma_centre_m is not None
        assert np.allclose(again.photos[name].sigma_centre_m, photo.sigma_centre_m, atol=1e-6)
    for name, point in block.points.items():
        assert again.points[name].sigma_m == point.sigma_m
        assert again.points[name].role == point.role


@given(RECIPES)
@settings(max_examples=10)
def test_opk_list_holds_the_same_orientations__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block, folder = block_of(recipe, "frame"), tmp_path_factory.mktemp("opk")
    write_metashape(folder, block)
    again = read_metashape(folder / "cameras_opk.txt")
    for name, photo in block.photos.items():
        here, there = photo.exterior, again.photos[name].exterior
        assert here is not None
        assert there is not None
        assert np.allclose(here.centre, there.centre, rtol=0, atol=1e-6)
        assert np.allclose(here.object_from_image, there.object_from_image, rtol=0, atol=1e-9)


def test_opencv_and_geocentric_coordinates_see_the_same_pixels__oracle(tmp_path: Path) -> None:
    """Points carried by PROJ into the chunk and projected by OpenCV with the file's own numbers."""
    block = block_of((8, 2, 3, True), "upright")
    write_metashape(tmp_path, block)
    chunk = read_xml(tmp_path / "cameras.xml").find("chunk")
    assert chunk is not None

    def numbers(element: object, tag: str) -> np.ndarray:
        return np.array([float(word) for word in element.findtext(tag).split()])  # type: ignore

    transform = chunk.find("transform")
    rotation = numbers(transform, "rotation").reshape(3, 3)
    points = np.array([point.position for point in block.points.values()])
    degrees = Transformer.from_crs(5514, 4156, always_xy=True).transform(*points[:, :2].T)
    geocentric = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        "+step +proj=cart +ellps=bessel"
    )
    earth = geocentric.transform(*degrees, points[:, 2])
    inside = (np.column_stack(earth) - numbers(transform, "translation")) @ rotation
    for camera, photo in zip(chunk.iterfind("cameras/camera"), block.photos.values(), strict=True):
        sensor = chunk.find(f"sensors/sensor[@id='{camera.get('sensor_id')}']/calibration")
        f, cx, cy, k1, k2, k3, p1, p2 = (
            float(numbers(sensor, tag)[0])
            for tag in ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
        )
        matrix = numbers(camera, "transform").reshape(4, 4)
        # The Earth is curved and the map's scale there 0.9999; nothing else may differ.
        turn = matrix[:3, :3].T
        inner = np.array([[f, 0, 4500 + cx], [0, f, 4400 + cy], [0, 0, 1]])
        shown, _ = cv2.projectPoints(
            inside, cv2.Rodrigues(turn)[0], -turn @ matrix[:3, 3], inner,
            np.array([k1, k2, p2, p1, k3]),
        )  # fmt: skip
        ours = pixels_of(points, photo, block.camera_of(photo.photo_id))
        assert np.abs(shown.reshape(-1, 2) - ours).max() < 3.0
        swapped, _ = cv2.projectPoints(
            inside, cv2.Rodrigues(turn)[0], -turn @ matrix[:3, 3], inner,
            np.array([k1, k2, p1, p2, k3]),
        )  # fmt: skip
        assert np.abs(swapped - shown).max() > 0.01
        assert np.allclose(Turn.from_matrix(turn).as_matrix(), turn, atol=1e-12)


def test_markers_equal_the_list_of_another_program__real(shared_data: Path) -> None:
    block = read_metashape(shared_data / SAMPLES / "tmizu_marker.xml")
    lines = (shared_data / "exchange-samples/odm/tmizu_gcp_list.txt").read_text().splitlines()
    assert block.crs == "EPSG:32654"
    rows = []
    for one in block.measurements:
        point = block.points[one.point_id].position
        photo = block.photos[one.photo_id].file
        rows.append((photo, *point, one.column, one.row))
    listed = [line.split() for line in lines[1:] if line]
    assert len(rows) == len(listed) == 149
    for line in listed:
        values = np.array([float(word) for word in line[:5]])
        # The list rounds to 0.1 m and whole pixels.
        near = [
            row
            for row in rows
            if row[0] == line[5] and np.all(np.abs(np.array(row[1:]) - values) <= NEAR)
        ]
        assert near, line


NEAR = np.array([0.0501, 0.0501, 0.0501, 0.501, 0.501])


def test_projections_of_metashape_meet_in_a_point__real(shared_data: Path) -> None:
    """What is not pinned Metashape projected itself: through our reading the rays meet."""
    path = shared_data / SAMPLES / "uclm_markers.xml"
    block = read_metashape(path)
    assert block.crs == "EPSG:25830"
    assert len(block.photos) == 1050
    pinned = {
        (location.get("camera_id"), location.get("x"))
        for location in read_xml(path).iterfind("chunk/frames/frame/markers/marker/location")
        if location.get("pinned") == "true"
    }
    assert len(pinned) == 41
    known = {float(x) for _, x in pinned if x}
    off: list[float] = []
    for name, point in block.points.items():
        seen = [
            one
            for one in block.measurements
            if one.point_id == name
            and block.photos[one.photo_id].exterior is not None
            and one.column not in known
        ]

        def residuals(place: np.ndarray, seen: list = seen) -> np.ndarray:
            return np.concatenate([
                pixels_of(place[None], block.photos[one.photo_id], block.camera_of(one.photo_id))[0]
                - [one.column, one.row] for one in seen
            ])  # fmt: skip

        found = least_squares(residuals, np.array(point.position), xtol=1e-15)
        # The markers were measured to 5 mm, the block hangs on navigation of a drone.
        assert np.abs(found.x - point.position).max() < 0.5
        off.extend(np.abs(found.fun).tolist())
    assert len(off) == 82
    assert np.median(off) < 0.02
    assert max(off) < 0.2


def test_a_file_of_metashape_is_the_same_again__real(shared_data: Path, tmp_path: Path) -> None:
    block = read_metashape(shared_data / SAMPLES / "uclm_markers.xml")
    write_metashape(tmp_path, block)
    again = read_metashape(tmp_path)
    assert again.crs == block.crs
    assert list(again.photos) == list(block.photos)
    assert_same_points(block, again)
    assert_same_measurements(block, again)
    for name, photo in block.photos.items():
        if photo.exterior is not None:
            other = again.photos[name].exterior
            assert other is not None
            assert np.allclose(other.centre, photo.exterior.centre, rtol=0, atol=1e-6)
            assert np.allclose(
                other.object_from_image, photo.exterior.object_from_image, rtol=0, atol=1e-9
            )


def test_cameras_without_transform_come_without_orientation__real(shared_data: Path) -> None:
    block = read_metashape(shared_data / SAMPLES / "hwiyoung_markers.xml")
    assert block.crs == ""
    assert (len(block.photos), len(block.measurements), len(block.points)) == (120, 416, 0)
    assert all(photo.exterior is None for photo in block.photos.values())
    camera = block.cameras["train_L"]
    assert camera.radial == (-0.177596091505403, 0.156810007534974, -0.080579883779856)
    assert {one.sigma_px for one in block.measurements} == {0.1}


def swap(old: str, new: str) -> Callable[[str], str]:
    def spoil(text: str) -> str:
        made, count = re.subn(old, new, text, count=1, flags=re.S)
        assert count
        return made

    return spoil


BOMB = '<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;&b;">]><document>'
SPOILED = {
    "cut": lambda text: text[: len(text) // 2],
    "entities": swap("<document", BOMB + "<document"),
    "external entity": swap(
        "<document", '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><document'
    ),
    "no chunk": lambda text: '<document version="1.5.0"/>',
    "two chunks": swap("</chunk>", "</chunk><chunk/>"),
    "other root": lambda text: text.replace("document", "project"),
    "fisheye": swap('type="frame"', 'type="fisheye"'),
    "no principal distance": swap("<f>.*?</f>", ""),
    "negative principal distance": swap("<f>", "<f>-"),
    "nan": swap("<transform>[0-9e.-]+ ", "<transform>nan "),
    "short transform": swap("<transform>[0-9e.-]+ ", "<transform>"),
    "no rotation": swap("<transform>[0-9e.-]+ ", "<transform>7.0 "),
    "chunk of no similarity": swap("<rotation>[0-9e.-]+ ", "<rotation>7.0 "),
    "scale of nought": swap("<scale>1.0", "<scale>0.0"),
    "unknown sensor": swap('sensor_id="0"', 'sensor_id="77"'),
    "unknown camera": swap('camera_id="0"', 'camera_id="77"'),
    "unknown marker": swap('marker_id="0"', 'marker_id="77"'),
    "camera twice": swap('camera id="1"', 'camera id="0"'),
    "marker twice": swap('label="P1"', 'label="P0"'),
    "no number": swap(' x="[0-9e.-]+"', ' x="east"'),
    "unknown crs": swap("<reference>PROJCS", "<reference>PLANET"),
    "degrees": swap("<reference>.*?</reference>", "<reference>" + (
        'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
        'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]'
    ) + "</reference>"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILED)
def test_a_broken_file_is_refused__truth(tmp_path: Path, name: str) -> None:
    write_metashape(tmp_path, block_of(FULL, "frame"))
    path = tmp_path / "markers.xml"
    path.write_text(SPOILED[name](path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(PhotogrammetryError) as found:
        read_metashape(path)
    assert found.value.file.startswith(str(path))


def test_an_empty_folder_and_an_opk_list_without_numbers_are_refused__truth(tmp_path: Path) -> None:
    with pytest.raises(PhotogrammetryError):
        read_metashape(tmp_path)
    (tmp_path / "a.txt").write_text("# Cameras (1)\nphoto\t1\t2\t3\t4\tfive\t6\n")
    with pytest.raises(PhotogrammetryError):
        read_metashape(tmp_path / "a.txt")
    (tmp_path / "a.txt").write_text("# Cameras (0)\n")
    with pytest.raises(PhotogrammetryError):
        read_metashape(tmp_path / "a.txt")


def test_a_block_in_degrees_is_refused__truth(tmp_path: Path) -> None:
    block = ExchangeBlock("EPSG:4326", points={"a": ExchangePoint("a", (14.0, 50.0, 0.0))})
    with pytest.raises(PhotogrammetryError):
        write_metashape(tmp_path, block)
