"""MicMac's folder, against what MicMac itself wrote, and there and back."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings

from core.errors import ExchangeError
from core.formats.exchange import FLIP, pixels_of
from core.formats.micmac import camera_of, read_micmac, write_micmac
from core.formats.micmac_orientation import SAME, read_calibration, read_orientation
from core.frames import HALF_PIXEL
from tests.core.formats.random_blocks import (
    SEEDS,
    assert_same_geometry,
    assert_same_points,
    block_of,
    tie_set,
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
@settings(max_examples=25)
def test_a_film_block_comes_back__law(seed: int) -> None:
    block = block_of(seed, film=True)
    with TemporaryDirectory() as folder:
        assert write_micmac(Path(folder), block) == ()
        again = read_micmac(Path(folder))
    assert_same_geometry(block, again)
    assert_same_points(block, again)
    assert tie_set(again) == tie_set(block)
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
@settings(max_examples=25)
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


GOOD = {
    "GCPs.xml": "<DicoAppuisFlottant><OneAppuisDAF><Pt>1 2 3</Pt><NamePt>a</NamePt>"
    "<Incertitude>0.1 0.1 0.2</Incertitude></OneAppuisDAF></DicoAppuisFlottant>",
    "GCPs.txt": "#F= N X Y Z Ix Iy Iz\na 1 2 3 0.1 0.1 0.2\n",
    "S2D.xml": "<SetOfMesureAppuisFlottants><MesureAppuiFlottant1Im><NameIm>s.tif</NameIm>"
    "<OneMesureAF1I><NamePt>a</NamePt><PtIm>10 20</PtIm></OneMesureAF1I>"
    "</MesureAppuiFlottant1Im></SetOfMesureAppuisFlottants>",
    "Ori-A/Orientation-s.tif.xml": "<ExportAPERO><OrientationConique><OrIntImaM2C><I00>0 0</I00>"
    "<V10>1 0</V10><V01>0 1</V01></OrIntImaM2C><FileInterne>Ori-A/AutoCal.xml</FileInterne>"
    "<Externe><KnownConv>eConvApero_DistM2C</KnownConv><Centre>0 0 9</Centre><ParamRotation>"
    "<CodageMatr><L1>1 0 0</L1><L2>0 -1 0</L2><L3>0 0 -1</L3></CodageMatr></ParamRotation>"
    "</Externe></OrientationConique></ExportAPERO>",
    "Ori-A/AutoCal.xml": "<ExportAPERO><CalibrationInternConique><PP>50 40</PP><F>100</F>"
    "<SzIm>100 80</SzIm><CalibDistortion><ModRad><CDist>50 40</CDist><CoeffDist>1e-9</CoeffDist>"
    "</ModRad></CalibDistortion></CalibrationInternConique></ExportAPERO>",
    "Homol/Pastiss.tif/t.tif.txt": "1 2 3 4\n5 6 7 8 1\n",
}
ENTITIES = '<!DOCTYPE a [<!ENTITY b "c"><!ENTITY d "&b;&b;&b;">]>'
OUTSIDE = '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]>'


def project_of(folder: Path, **changed: str) -> Path:
    for name, text in (GOOD | changed).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def test_the_project_that_is_broken_below_is_whole__truth(tmp_path: Path) -> None:
    block = read_micmac(project_of(tmp_path))
    assert set(block.photos) == {"s", "t"}
    assert block.points["a"].sigma_m == (0.1, 0.1, 0.2)
    assert block.ties.pixels.tolist() == [[1.5, 2.5], [3.5, 4.5], [5.5, 6.5], [7.5, 8.5]]
    assert block.photos["s"].pixel_from_image is not None
    assert block.photos["s"].pixel_from_image.tolist() == [[100, 0, 50.5], [0, -100, 40.5]]


ORIENTATION, CALIBRATION = "Ori-A/Orientation-s.tif.xml", "Ori-A/AutoCal.xml"
TIES = "Homol/Pastiss.tif/t.tif.txt"
BROKEN = [
    ("GCPs.xml", "</DicoAppuisFlottant>", "", "no whole XML"),
    ("GCPs.xml", "<Dico", ENTITIES + "<Dico", "declares entities"),
    ("GCPs.xml", "<Dico", OUTSIDE + "<Dico", "declares entities"),
    ("GCPs.xml", "1 2 3<", "1 2<", "where 3 numbers must stand"),
    ("GCPs.xml", "1 2 3<", "1 2 nan<", "where 3 numbers must stand"),
    ("GCPs.xml", "<NamePt>a</NamePt>", "", "NamePt is missing"),
    ("GCPs.xml", "<NamePt>a<", "<NamePt> <", "NamePt is empty"),
    ("GCPs.txt", "a 1 2 3", "a 1 2 4", "a has two places"),
    ("GCPs.txt", "N X Y Z", "N X Y", "does not say what its columns are"),
    ("GCPs.txt", "a 1 2 3 0.1 0.1 0.2", "a 1 2", "Line 2 has 3 of 7 columns"),
    ("GCPs.txt", "a 1 2", "a one 2", "where 3 numbers must stand"),
    ("S2D.xml", "10 20", "10,20", "where 2 numbers must stand"),
    ("S2D.xml", "</OneMesureAF1I>", "</OneMesureAF1I><OneMesureAF1I><NamePt>a</NamePt>"
     "<PtIm>11 20</PtIm></OneMesureAF1I>", "measured twice"),
    ("S2D.xml", "</PtIm>", "</PtIm><PrecPointe>-1</PrecPointe>", "not above nought"),
    ("S2D.xml", "s.tif", "s.jpg", "would be one photo"),
    (ORIENTATION, "<L2>0 -1 0</L2>", "<L2>0 1 0</L2>", "are no rotation"),
    (ORIENTATION, "<Centre>0 0 9</Centre>", "", "Centre is missing"),
    (ORIENTATION, "eConvApero_DistM2C", "eConvAngSurvey", "eConvAngSurvey, which is not known"),
    (ORIENTATION, "AutoCal.xml", "Other.xml", "Other.xml is not there"),
    (ORIENTATION, "<V10>1 0", "<V10>0 1", "its pixel has no area"),
    (CALIBRATION, "<F>100", "<F>0", "must be above nought"),
    (CALIBRATION, "<SzIm>100 80</SzIm>", "", "SzIm is missing"),
    (CALIBRATION, "1e-9", "1e-9x", "where 1 number must stand"),
    (TIES, "5 6 7 8 1", "5 6 7", "Line 2 is not of four numbers"),
    (TIES, "5 6 7", "5 inf 7", "not finite"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "part", "instead", "told"), BROKEN)
def test_broken_projects_are_told_with_file_and_fault__truth(
    tmp_path: Path, name: str, part: str, instead: str, told: str
) -> None:
    assert part in GOOD[name]
    folder = project_of(tmp_path, **{name: GOOD[name].replace(part, instead, 1)})
    with pytest.raises(ExchangeError, match=told) as error:
        read_micmac(folder)
    assert str(tmp_path) in error.value.file
    assert error.value.remedy


def test_folders_without_or_with_too_much_are_told__truth(
    tmp_path: Path, shared_data: Path
) -> None:
    with pytest.raises(ExchangeError, match="holds no orientations"):
        read_micmac(tmp_path)
    with pytest.raises(ExchangeError, match="not a folder"):
        read_micmac(tmp_path / "nothing")
    with pytest.raises(ExchangeError, match="Ori-BigPerturb, Ori-Rel, Ori-SmallPerturb"):
        read_micmac(shared_data / FILM)


@pytest.mark.parametrize("unit", ["Erdas", "Erdas_Grade", "PhotoMDegre", "PhotoMGrade"])
def test_angles_are_omega_phi_kappa__truth(tmp_path: Path, unit: str) -> None:
    angles = "<CodageAngulaire>9 18 27</CodageAngulaire>"
    text = GOOD[ORIENTATION].replace("eConvApero_DistM2C", f"eConvAng{unit}")
    text = text[: text.index("<CodageMatr>")] + angles + text[text.index("</ParamRotation>") :]
    block = read_micmac(project_of(tmp_path, **{ORIENTATION: text}))
    exterior = block.photos["s"].exterior
    assert exterior is not None
    turn = np.pi / (200 if "Grade" in unit or "MGrade" in unit else 180)
    found = (exterior.omega, exterior.phi, exterior.kappa)
    assert found == pytest.approx((9 * turn, 18 * turn, 27 * turn))


def test_a_lens_that_no_block_holds_is_told_and_not_taken__real(shared_data: Path) -> None:
    lens = read_calibration(
        shared_data / DIGITAL / "Ori-MMV1/AutoCal_Foc-11500_Cam-imx477imx477-1.xml", Path("f")
    )
    camera, affine, note = camera_of(lens, SAME, ((0.0, 0.0), (1.0, -1.0)))
    assert (camera.radial, affine) == ((), None)
    assert note is not None
    assert "eModele_FishEye_10_5_5" in note


def test_millimetres_and_pixels_of_one_calibration_are_one_lens__real(shared_data: Path) -> None:
    folder = shared_data / "exchange-samples/micmac-scanned-film/FilesSamples"
    found = [
        camera_of(read_calibration(path, path), SAME, ((0.0, 0.0), (1.0, -1.0)))
        for path in (folder / "NewCalibD3X-mm.xml", folder / "NewCalibD3X-pix.xml")
    ]
    (millimetres, film, _), (pixels, scan, _) = found
    assert film is not None
    assert scan is not None
    # The millimetres point upwards there: its rays are those of the pixels turned over.
    assert np.allclose(film, scan * [[1, -1, 1]], rtol=2e-6)
    assert np.allclose(millimetres.radial, pixels.radial, rtol=1e-5)
    assert np.allclose(millimetres.tangential, np.multiply(pixels.tangential, (1, -1)), rtol=1e-4)
