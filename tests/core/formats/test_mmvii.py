"""MMVII's folder, against MicMac's own files of the same photos, and there and back."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings

from core.errors import ExchangeError
from core.formats.exchange import image_from_ideal
from core.formats.micmac import read_micmac
from core.formats.mmvii import read_mmvii, write_mmvii
from core.frames import HALF_PIXEL
from core.geometry.exterior import rotation_from_angles
from tests.core.formats.random_blocks import (
    SEEDS,
    assert_same_geometry,
    assert_same_points,
    block_of,
)


def near(one: object, other: object) -> bool:
    """Whether both are none, or the same to twelve digits."""
    return one is other if one is None or other is None else one == pytest.approx(other, rel=1e-12)


SET = "exchange-samples/micmac-v1-and-mmvii"


def test_both_micmacs_give_one_block_of_the_same_photos__real(shared_data: Path) -> None:
    old = read_micmac(shared_data / SET / "Ori-Ground_mm3d")
    new = read_mmvii(shared_data / SET)
    assert set(old.photos) == set(new.photos)
    for name, photo in old.photos.items():
        again = new.photos[name]
        assert photo.exterior is not None
        assert again.exterior is not None
        # Fifteen decimals stand in MMVII's files.
        turned = photo.exterior.object_from_image - again.exterior.object_from_image
        assert np.abs(turned).max() < 1e-14
        assert np.abs(photo.exterior.centre - again.exterior.centre).max() < 2e-15
    assert {(m.point_id, m.photo_id): (m.column, m.row) for m in old.measurements} == {
        (m.point_id, m.photo_id): pytest.approx((m.column, m.row), abs=1e-12)
        for m in new.measurements
    }
    assert dict(old.points).keys() == dict(new.points).keys()
    for name, point in old.points.items():
        assert new.points[name].position == pytest.approx(point.position, abs=1e-14)
        assert new.points[name].sigma_m is None


def test_mmvii_fitted_the_lens_that_micmac_has__real(shared_data: Path) -> None:
    """Four radial terms became three, b1, b2 and another F: MMVII's own conversion lost that."""
    blocks = (read_micmac(shared_data / SET / "Ori-Ground_mm3d"), read_mmvii(shared_data / SET))
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.27, 0.27, 7)), axis=-1)
    seen = []
    for block in blocks:
        photo = block.photos["IMGP4168"]
        assert photo.pixel_from_image is not None
        image = image_from_ideal(grid.reshape(-1, 2), block.camera_of("IMGP4168"))
        seen.append(image @ photo.pixel_from_image[:, :2].T + photo.pixel_from_image[:, 2])
    assert np.hypot(*(seen[0] - seen[1]).T).max() < 0.05


def test_angles_told_by_mmvii_are_omega_phi_kappa__real(shared_data: Path) -> None:
    block = read_mmvii(shared_data / SET)
    exterior = block.photos["IMGP4168"].exterior
    assert exterior is not None
    # The WPK of the file, which is told for information.
    told = np.radians([-147.044265252458558, -78.430678169693721, -144.664806564715178])
    # They turn the axes y down and z forwards.
    wanted = rotation_from_angles(*told) @ np.diag([1.0, -1.0, -1.0])
    assert np.allclose(exterior.object_from_image, wanted, atol=1e-12)


def test_what_mmvii_wrote_is_the_same_when_written_again__real(
    shared_data: Path, tmp_path: Path
) -> None:
    block = read_mmvii(shared_data / SET)
    notes = write_mmvii(tmp_path, block)
    assert len(notes) <= 1
    again = read_mmvii(tmp_path)
    assert_same_geometry(block, again, 1e-6)
    assert_same_points(block, again)


@given(SEEDS)
@settings(max_examples=25)
def test_an_upright_block_comes_back__law(seed: int) -> None:
    block = block_of(seed, film=False)
    with TemporaryDirectory() as folder:
        assert write_mmvii(Path(folder), block) == ()
        again = read_mmvii(Path(folder))
    assert_same_geometry(block, again)
    for name, point in again.points.items():
        assert near(point.sigma_m, block.points[name].sigma_m)
    exact = {name: replace(p, sigma_m=None) for name, p in block.points.items()}
    assert {name: replace(p, sigma_m=None) for name, p in again.points.items()} == exact
    for ours, theirs in zip(
        block.measurements,
        sorted(again.measurements, key=lambda m: (m.point_id, m.photo_id)),
        strict=True,
    ):
        assert (ours.point_id, ours.photo_id) == (theirs.point_id, theirs.photo_id)
        assert (ours.column, ours.row) == pytest.approx((theirs.column, theirs.row), abs=1e-9)
        assert near(theirs.sigma_px, ours.sigma_px)


def test_a_turned_and_sheared_scan_goes_out_with_its_own_lens__truth(tmp_path: Path) -> None:
    block = block_of(7, film=True)
    notes = write_mmvii(tmp_path, block)
    assert all("fitted by the terms that MMVII holds" in note for note in notes)
    # Whoever reads shears the ideal place; a hundredth of shear in a bent lens costs this much.
    seen = read_mmvii(tmp_path)
    for name, photo in block.photos.items():
        again = seen.photos[name]
        assert photo.exterior is not None
        assert again.exterior is not None
        assert np.allclose(photo.exterior.centre, again.exterior.centre)
    assert len(list(tmp_path.rglob("Calib-*.xml"))) == len(block.photos)


GOOD = {
    "Ori/A/Ori-PerspCentral-s.tif.xml": '<Root><Data><CameraPose><NameImage>"s.tif"</NameImage>'
    '<NameInternalCalib>"Calib-PerspCentral-c"</NameInternalCalib><Center>0 0 9</Center>'
    "<RotMatrix><AxeI>1 0 0</AxeI><AxeJ>0 -1 0</AxeJ><AxeK>0 0 -1</AxeK></RotMatrix>"
    "</CameraPose></Data></Root>",
    "Ori/A/Calib-PerspCentral-c.xml": "<Root><Data><InternalCalibration><PixelFrame>"
    '<NbPix>100 80</NbPix></PixelFrame><Projection>"Stenope"</Projection><PerfectProj>'
    "<F>100</F><PP>50 40</PP></PerfectProj><Distorsion><Radial><K1>0.1</K1></Radial>"
    "</Distorsion></InternalCalibration></Data></Root>",
    "PointsMeasure/A/MesIm-s.tif.xml": '<Root><Data><SetMesIm><NameIm>"s.tif"</NameIm><Measures>'
    '<el><Name>"a"</Name><Pt>1 2</Pt><Sigma2>0.25 0 0.25</Sigma2></el></Measures></SetMesIm>'
    "</Data></Root>",
}
POSE, CALIBRATION, MARKS = GOOD
BROKEN = [
    (POSE, "</Root>", "", "no whole XML"),
    (POSE, "<Root>", '<!DOCTYPE a [<!ENTITY b "c">]><Root>', "declares entities"),
    (POSE, "<AxeK>0 0 -1<", "<AxeK>0 0 1<", "are no rotation"),
    (POSE, "<Center>0 0 9</Center>", "", "Center is missing"),
    (POSE, "Central-c", "Central-d", "Calib-PerspCentral-d is not there"),
    (CALIBRATION, "<F>100", "<F>-1", "must be above nought"),
    (CALIBRATION, "<K1>0.1", "<K1>zero", "where 1 number must stand"),
    (MARKS, "<Pt>1 2<", "<Pt>1<", "where 2 numbers must stand"),
    (MARKS, "</el>", '</el><el><Name>"a"</Name><Pt>1 3</Pt></el>', "measured twice"),
    (MARKS, "SetMesIm><NameIm>", "SetMesIm><Name>", "no whole XML"),
]


@pytest.mark.parametrize(("name", "part", "instead", "told"), BROKEN)
def test_broken_projects_are_told_with_file_and_fault__truth(
    tmp_path: Path, name: str, part: str, instead: str, told: str
) -> None:
    assert part in GOOD[name]
    for file, text in GOOD.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text)
    block = read_mmvii(tmp_path)
    assert [m.sigma_px for m in block.measurements] == [0.5]
    assert block.measurements[0].column == 1 + HALF_PIXEL
    (tmp_path / name).write_text(GOOD[name].replace(part, instead, 1))
    with pytest.raises(ExchangeError, match=told) as error:
        read_mmvii(tmp_path)
    assert str(tmp_path) in error.value.file


def test_a_fish_eye_comes_without_interior_and_is_told__truth(tmp_path: Path) -> None:
    for file, text in GOOD.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text.replace("Stenope", "eProjFE_EquiDist"))
    block = read_mmvii(tmp_path)
    assert block.photos["s"].pixel_from_image is None
    assert block.photos["s"].exterior is not None
    assert "eProjFE_EquiDist" in block.notes[0]
