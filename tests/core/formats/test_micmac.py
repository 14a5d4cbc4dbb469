"""MicMac's folder, against what MicMac itself wrote, and there and back."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings

from core.formats.exchange import FLIP, pixels_of
from core.formats.micmac import read_micmac, write_micmac
from core.formats.micmac_orientation import read_calibration, read_orientation
from core.frames import HALF_PIXEL
from tests.core.formats.random_blocks import (
    SEEDS,
    assert_same_geometry,
    assert_same_points,
    block_of,
)

DIGITAL = "exchange-samples/micmac-v1-and-mmvii"
FILM = "exchange-samples/micmac-scanned-film/CompensOnLine"


def published_pairs(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Places in the calibration's unit and object points, as MicMac wrote them for checking."""
    pairs = ElementTree.parse(path).getroot().findall(".//Appuis")
    places, points = (
        np.array([[float(word) for word in (pair.findtext(tag) or "").split()] for pair in pairs])
        for tag in ("Im", "Ter")
    )
    return places, points


@pytest.mark.parametrize(
    ("folder", "frames", "within"),
    # Ori-MMV1 has b1 and b2; its pairs lie hundreds of focal lengths of rounding away from others.
    [(f"{DIGITAL}/Ori-Ground_mm3d", 4, 1e-10), (f"{DIGITAL}/Ori-MMV1", 7, 1e-10),
     (f"{FILM}/Ori-Rel", 4, 1e-12)],
)  # fmt: skip
def test_the_lens_gives_the_pairs_that_micmac_published__real(
    shared_data: Path, folder: str, frames: int, within: float
) -> None:
    found = 0
    for path in (shared_data / folder).glob("Orientation-*.xml"):
        image = read_orientation(path)
        lens = read_calibration(image.calibration, path).lens
        if lens is None:  # the fish-eye
            continue
        places, points = published_pairs(path)
        assert len(places) >= 10
        space = (points - image.exterior.centre) @ image.exterior.object_from_image @ FLIP
        assert np.abs(lens.measured(space[:, :2] / space[:, 2:]) - places).max() < within
        found += 1
    assert found == frames


@pytest.mark.parametrize(
    ("folder", "within"),
    # b1 and b2 of Ori-MMV1 cannot be held as they are; the note says how far the fit is off.
    [(f"{DIGITAL}/Ori-Ground_mm3d", 1e-10), (f"{FILM}/Ori-Rel", 1e-10),
     (f"{DIGITAL}/Ori-MMV1", 0.0066)],
)  # fmt: skip
def test_a_block_sees_the_published_points_at_their_pixels__real(
    shared_data: Path, folder: str, within: float
) -> None:
    block = read_micmac(shared_data / folder)
    for path in (shared_data / folder).glob("Orientation-*.xml"):
        image = read_orientation(path)
        if "imx477" in str(image.calibration):  # the fish-eye
            continue
        places, points = published_pairs(path)
        wanted = places @ image.pixel_from_file[:, :2].T + image.pixel_from_file[:, 2]
        photo = next(photo for photo in block.photos.values() if photo.file == image.file)
        seen = pixels_of(points, photo, block.camera_of(photo.photo_id))
        assert np.abs(seen - HALF_PIXEL - wanted).max() < within
    assert bool(block.notes) == (within > 1e-3)


def test_a_film_project_comes_with_all_it_holds__real(shared_data: Path) -> None:
    block = read_micmac(shared_data / FILM / "Ori-Rel")
    camera = block.cameras["AutoCal500"]
    assert camera.principal_distance_mm == pytest.approx(62.633973, abs=1e-6)
    assert camera.fiducials_mm["P2"] == (18.0, -12.0)
    assert camera.principal_point_mm == pytest.approx((15.17367993 - 18, 12 - 12.56396647))
    assert block.photos["Abbey-IMG_0204"].fiducials_px["P2"] == (1407.5, 938.5)
    assert len(block.measurements) == 4
    assert block.points["P_1_A"].sigma_m is None
    assert block.points["P_1_A"].position[2] == -14.8456226060478045


@pytest.mark.parametrize("folder", [f"{DIGITAL}/Ori-Ground_mm3d", f"{FILM}/Ori-Rel"])
def test_what_micmac_wrote_is_the_same_when_written_again__real(
    shared_data: Path, tmp_path: Path, folder: str
) -> None:
    block = read_micmac(shared_data / folder)
    assert write_micmac(tmp_path, block) == ()
    again = read_micmac(tmp_path)
    assert_same_geometry(block, again, 1e-9)
    assert_same_points(block, again)
    for path in (tmp_path / "Ori-Gruber").glob("Orientation-*.xml"):
        ours, theirs = read_orientation(path), read_orientation(shared_data / folder / path.name)
        assert np.abs(ours.pixel_from_file - theirs.pixel_from_file).max() < 1e-11
        mine = read_calibration(ours.calibration, path).lens
        other = read_calibration(theirs.calibration, path).lens
        assert mine is not None
        assert other is not None
        assert mine.focal == pytest.approx(other.focal, rel=1e-14)
        assert mine.principal_point == pytest.approx(other.principal_point, rel=1e-14)
        assert mine.radial == pytest.approx(other.radial, rel=1e-13)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_a_film_block_comes_back__law(seed: int) -> None:
    block = block_of(seed, film=True)
    with TemporaryDirectory() as folder:
        assert write_micmac(Path(folder), block) == ()
        again = read_micmac(Path(folder))
    assert_same_geometry(block, again)
    assert_same_points(block, again)
    ours, theirs = block.cameras["RC10 1938"], again.cameras["RC10_1938"]
    assert theirs.principal_distance_mm == pytest.approx(ours.principal_distance_mm, rel=1e-12)
    shifts = [np.subtract(theirs.fiducials_mm[n], ours.fiducials_mm[n]) for n in ours.fiducials_mm]
    assert np.ptp(shifts, axis=0).max() < 1e-9
    moved = np.subtract(theirs.principal_point_mm, ours.principal_point_mm)
    assert np.abs(moved - shifts[0]).max() < 1e-9
    for name, photo in block.photos.items():
        assert again.photos[name].sigma_centre_m == photo.sigma_centre_m
        for mark, place in photo.fiducials_px.items():
            assert again.photos[name].fiducials_px[mark] == pytest.approx(place, abs=1e-9)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_a_digital_block_comes_back_in_pixels__law(seed: int) -> None:
    block = block_of(seed, film=False)
    with TemporaryDirectory() as folder:
        assert write_micmac(Path(folder), block) == ()
        text = next(Path(folder).glob("Ori-Gruber/AutoCal*.xml")).read_text()
        again = read_micmac(Path(folder))
    assert "Scanned" not in text
    assert "<SzIm>9000 8000</SzIm>" in text
    assert_same_geometry(block, again)
    assert_same_points(block, again)
