"""IGN's OPK: the files of Borea against its expected pixels, round trips, broken files."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pyproj import Transformer
from scipy.optimize import minimize_scalar

from core.errors import ProjectError
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    pixels_of,
)
from core.formats.ign_opk import read_opk, write_opk
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation

BOREA = "exchange-samples/ign-opk-borea/dataset"
FILES = ("23FD1305_alt_test.OPK", "Camera1.txt", "GCP_test.app", "liaisons_test.mes",
         "terrain_test.mes")  # fmt: skip


@pytest.fixture
def borea(shared_data: Path, tmp_path: Path) -> Path:
    """IGN's small block, without the second camera and the list of noughts."""
    folder = tmp_path / "borea"
    folder.mkdir()
    for name in FILES:
        shutil.copyfile(shared_data / BOREA / name, folder / name)
    listed = folder / FILES[0]
    listed.write_text("UNITE ANGLE : degre\n" + listed.read_text())
    return folder


def in_space(points: np.ndarray, crs: str) -> np.ndarray:
    """Map coordinates and heights as points on the ellipsoid's Earth, metres."""
    to_degrees = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    to_space = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    east, north = to_degrees.transform(points[:, 0], points[:, 1])
    return np.column_stack(to_space.transform(east, north, points[:, 2]))


def on_the_round_earth(
    photo: ExchangePhoto, points: np.ndarray, crs: str, ground: float
) -> tuple[ExchangePhoto, np.ndarray]:
    """A photo and points in a frame that is straight, its origin at the photo's foot.

    The map's heights bear its scale ("linear alteration"), its axes turn with the convergence.
    """
    centre = photo.orientation.centre
    foot = np.array([[*centre[:2], 0.0]])
    steps = in_space(foot + np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), crs)
    axes = (steps[1:] - steps[0]).T
    scale = 1 / np.linalg.norm(axes[:, 0])
    east, up = axes[:, 0] / np.linalg.norm(axes[:, 0]), axes[:, 2]
    turned = np.column_stack([east, np.cross(up, east), up])
    height = (centre[2] + (scale - 1) * ground) / scale
    place = (in_space(np.array([[*centre[:2], height]]), crs)[0] - steps[0]) @ turned
    flat = ExteriorOrientation(place, *angles_from_rotation(photo.orientation.object_from_image))
    straight = (in_space(points, crs) - steps[0]) @ turned
    return ExchangePhoto(
        photo.photo_id, photo.file, photo.camera, photo.pixel_from_image, flat
    ), straight


def residuals(block: ExchangeBlock, undulation: float) -> np.ndarray:
    """Pixels of the measured control less where it was measured, the photos lifted above it."""
    off = []
    for one in block.measurements:
        place = np.array([block.points[one.point_id].position]) - [0, 0, undulation]
        photo, straight = on_the_round_earth(
            block.photos[one.photo_id], place, "EPSG:2154", float(place[0, 2])
        )
        pixel = pixels_of(straight, photo, block.camera_of(one.photo_id))[0]
        off.append(pixel - [one.column, one.row])
    return np.array(off)


def test_pixels_are_those_that_ign_expects__real(borea: Path) -> None:
    block = read_opk(borea)
    assert len(block.photos) == 7
    assert set(block.points) == {"1003", "1005", "1006"}
    assert len(block.measurements) == 7
    assert len(block.ties.names) == 7
    assert len(block.ties.point) == 17
    assert block.points["1005"].role == "check"
    photo = block.photos["23FD1305x00026_01306"]
    np.testing.assert_array_equal(photo.orientation.centre, [814975.925, 6283986.148, 1771.280])
    angles = [photo.orientation.omega, photo.orientation.phi, photo.orientation.kappa]
    expected = np.radians([-0.245070686036, -0.069409621323, 0.836320989726])
    np.testing.assert_allclose(angles, expected)
    # The control is ellipsoidal, the photos are not, and the geoid's grid is not at hand: about
    # 50 m here. Each point tells its own; two or three photos have to agree on it.
    assert np.abs(residuals(block, 0.0)).max() > 300
    for name in block.points:
        seen = tuple(one for one in block.measurements if one.point_id == name)
        own = replace(block, measurements=seen)
        found = minimize_scalar(lambda n, own=own: np.sum(residuals(own, n) ** 2), (45.0, 55.0))
        assert 48 < found.x < 52
        # Borea's own tests ask for one pixel.
        assert np.abs(residuals(own, found.x)).max() < 1


def test_measured_control_tells_the_unit_where_it_can__truth(tmp_path: Path) -> None:
    affine = np.array([[9000.0, 0.0, 4500.0], [0.0, -9000.0, 4400.0]])
    exterior = ExteriorOrientation(np.array([100.0, 200.0, 3000.0]), 0.02, -0.03, 1.2)
    camera = ExchangeCamera("c", size_px=(9000, 8800))
    photo = ExchangePhoto("a", "a.tif", "c", affine, exterior)
    points = {n: ExchangePoint(n, (e, 300.0, 10.0)) for n, e in (("1", -500.0), ("2", 700.0))}
    seen = pixels_of(np.array([p.position for p in points.values()]), photo, camera).tolist()
    measured = tuple(
        ExchangeMeasurement(n, "a", *pixel) for n, pixel in zip(points, seen, strict=True)
    )
    write_opk(tmp_path, ExchangeBlock("", {"c": camera}, {"a": photo}, points, measured))
    listed = tmp_path / "block.OPK"
    listed.write_text(listed.read_text().replace("UNITE ANGLE  : degre\n", ""))
    block = read_opk(tmp_path)
    assert block.notes == ("Angles are in deg: the measured control says so.",)
    assert block.photos["a"].orientation.kappa == pytest.approx(1.2)


def test_small_angles_tell_no_unit_and_are_asked_about__real(borea: Path) -> None:
    listed = borea / FILES[0]
    listed.write_text(listed.read_text().partition("\n")[2])
    with pytest.raises(ProjectError, match="does not say the unit") as told:
        read_opk(borea)
    assert "UNITE ANGLE" in told.value.remedy


def test_a_list_alone_in_any_order_of_columns__real(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "exchange-samples/ign-opk-borea"
    given = (folder / "test/data/dataset1/23FD1305_alt_NCPOKXYZ.OPK").read_text()
    path = tmp_path / "list.OPK"
    path.write_text("UNITE ANGLE : degré\n" + given)
    other = tmp_path / "other.OPK"
    other.write_text("UNITE ANGLE : degre\n" + (folder / "dataset" / FILES[0]).read_text())
    one, two = read_opk(path), read_opk(other)
    for name, photo in one.photos.items():
        same = two.photos[name].orientation
        np.testing.assert_array_equal(photo.orientation.centre, same.centre)
        np.testing.assert_array_equal(photo.orientation.object_from_image, same.object_from_image)


def test_a_whole_flight_says_map_and_unit__real(shared_data: Path) -> None:
    block = read_opk(shared_data / "exchange-samples/opk-alex/20FUALPMAR_alt.OPK")
    assert block.crs == "EPSG:2154"
    assert len(block.photos) == 2369
    photo = block.photos["20FUALPMAR10x00035_02420"]
    assert np.degrees(photo.orientation.kappa) == pytest.approx(-78.219312931636)


def test_written_and_read_again_the_same__real(borea: Path, tmp_path: Path) -> None:
    block = read_opk(borea)
    notes = write_opk(tmp_path / "out", block)
    assert not notes
    again = read_opk(tmp_path / "out")
    assert list(again.photos) == list(block.photos)
    for name, photo in block.photos.items():
        other = again.photos[name]
        np.testing.assert_array_equal(other.orientation.centre, photo.orientation.centre)
        np.testing.assert_array_equal(other.pixel_from_image, photo.pixel_from_image)
        turned = other.orientation.object_from_image - photo.orientation.object_from_image
        assert np.abs(turned).max() < 1e-12
    assert again.points == block.points
    assert set(again.measurements) == set(block.measurements)
    np.testing.assert_array_equal(again.ties.pixels, block.ties.pixels)
    assert again.ties.names == block.ties.names
    assert again.cameras == block.cameras


HEAD = "UNITE ANGLE : degre\nNOM X Y Z O P K CAMERA\n"
ROW = "a 1 2 3 0 0 0 cam\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [("a 1 2 3 0 0 0 cam\n", "column NOM is missing"),
     (HEAD.replace("K ", ""), "column K is missing"), (HEAD, "holds no rows"),
     (HEAD.replace("degre", "mil") + ROW, "'mil' is unknown"),
     (HEAD + ROW + ROW, "Line 4: a stands twice"),
     (HEAD + "a 1 2 nan 0 0 0 cam\n", "Line 3: 'nan' is not a number"),
     (HEAD + "a 1 2 3 0\n", "Line 3 ends after 5 entries"),
     (HEAD.partition("\n")[2] + ROW, "does not say the unit")],
)  # fmt: skip
def test_broken_lists_are_named__truth(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "a.OPK").write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_opk(tmp_path)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [("c.txt", "Name = other\nPPAx = 1\nPPAy = 2\nfocal = 3\n", "camera 'cam' is unknown"),
     ("c.txt", "Name = cam\nPPAx = 1\nPPAy = 2\n", "'' is not a number"),
     ("p.app", '"1" 13 1 2\n', "ends after 4 entries"),
     ("p.app", '"1" 13 1 2 3\n"1" 3 1 2 3\n', "1 stands twice"),
     ("m.mes", "p a 1 2\np a 1 2\n", "measured twice in photo a"),
     ("m.mes", "p a 1 2 3\n", "more than point, photo"), ("b.OPK", "", "several files")],
)  # fmt: skip
def test_broken_neighbours_are_named__truth(
    tmp_path: Path, name: str, text: str, words: str
) -> None:
    (tmp_path / "a.OPK").write_text(HEAD + ROW)
    (tmp_path / name).write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_opk(tmp_path)


def test_measures_of_other_photos_are_told__truth(tmp_path: Path) -> None:
    (tmp_path / "a.OPK").write_text(HEAD + ROW)
    (tmp_path / "m.mes").write_text("p b 1 2\np a 1 2\n")
    block = read_opk(tmp_path)
    assert "1 photo is measured that the list does not hold" in block.notes[0]
    assert block.ties.names == ("p",)


ALEX = "exchange-samples/opk-alex"
# Frames of an UltraCam Eagle M3, 26460 x 17004 px at 30975 px, reduced twentyfold.
FOCAL, MIDDLE = 30975 / 20, np.array([26460 / 40, 17004 / 40])


def same_places(one: np.ndarray | None, other: np.ndarray | None) -> np.ndarray:
    """Places (n, 4) that SIFT finds in both pictures, pixels from the outer corner."""
    sift = cv2.SIFT.create(3000)
    assert one is not None
    assert other is not None
    (keys, words), (others, theirs) = (sift.detectAndCompute(p, None) for p in (one, other))
    pairs = cv2.BFMatcher().knnMatch(words, theirs, k=2)
    good = [first for first, second in pairs if first.distance < 0.75 * second.distance]
    rows = [(*keys[m.queryIdx].pt, *others[m.trainIdx].pt) for m in good]
    return np.unique(np.array(rows), axis=0) + 0.5


def off_the_epipolar_line(places: np.ndarray, one: ExchangePhoto, other: ExchangePhoto):
    """Pixels between a place in the second photo and the plane of base and first ray."""
    rays = []
    for seen, photo in ((places[:, :2], one), (places[:, 2:], other)):
        x, y = ((seen - MIDDLE) / FOCAL).T
        image = np.column_stack([x, -y, -np.ones(len(x))])
        rays.append(image @ photo.orientation.object_from_image.T)
    base = other.orientation.centre - one.orientation.centre
    plane = np.cross(base, rays[0])
    plane = plane / np.linalg.norm(plane, axis=1)[:, None]
    across = np.sum(plane * rays[1], axis=1) / np.linalg.norm(rays[1], axis=1)
    return FOCAL * np.abs(across)


def test_details_of_three_frames_lie_on_their_epipolar_lines__real(shared_data: Path) -> None:
    block = read_opk(shared_data / ALEX / "20FUALPMAR_alt.OPK")
    pictures = [cv2.imread(str(shared_data / ALEX / f"{n}.jpg"), 0) for n in (1, 2, 3)]
    frames = [block.photos[f"20FUALPMAR10x00001_0000{n}"] for n in (1, 2, 3)]
    for one, other in ((0, 1), (1, 2)):
        places = same_places(pictures[one], pictures[other])
        off = off_the_epipolar_line(places, frames[one], frames[other])
        assert len(off) > 500
        assert np.median(off) < 0.2
        # Read as gon the same list misses by tens of pixels.
        turned = [
            replace(
                photo,
                exterior=ExteriorOrientation(
                    photo.orientation.centre,
                    *(0.9 * np.array([photo.orientation.omega, photo.orientation.phi,
                                      photo.orientation.kappa])),
                ),
            )
            for photo in (frames[one], frames[other])
        ]  # fmt: skip
        assert np.median(off_the_epipolar_line(places, *turned)) > 5
