"""PAT-B, BINGO, Inpho: round trips of random blocks and of a published film block, broken files."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from core.errors import ExchangeError, ProjectError
from core.formats.bingo import BINGO_FORMAT, read_bingo
from core.formats.exchange import ExchangeBlock, ExchangeFormat, pixels_of, read_format
from core.formats.film_rays import film_rays, median_misfit, numbered, principal_distance_mm
from core.formats.inpho import INPHO_FORMAT, read_inpho
from core.formats.pat_b import PATB_FORMAT, read_patb
from tests.core.formats.film_block import read_film_block
from tests.exchanged import RECIPES, Recipe, assert_same_points, block_of

FORMATS = (PATB_FORMAT, BINGO_FORMAT, INPHO_FORMAT)
DIGITS = {"patb": 1e-5}
"""Metres of the perspective centre, where the format's digits are fewer."""


def rays_of(block: ExchangeBlock) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Directions in object space of all measurements, by point and photo."""
    rays, _ = film_rays(block)
    made = {}
    for ray in rays:
        turn = block.photos[ray.photo_id].orientation.object_from_image
        distance = principal_distance_mm(block, ray.photo_id)
        made[ray.point_id, ray.photo_id] = turn @ [ray.x_mm / distance, ray.y_mm / distance, -1.0]
    return made


def written(
    one: ExchangeFormat, block: ExchangeBlock, folder: Path
) -> tuple[Path, tuple[str, ...]]:
    path = folder / one.default_name
    assert one.write is not None
    return path, one.write(path, block)


def read_by(one: ExchangeFormat, path: Path) -> ExchangeBlock:
    assert one.read is not None
    return one.read(path)


@settings(max_examples=10)
@given(RECIPES)
@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_every_ray_comes_back__law(
    tmp_path_factory: pytest.TempPathFactory, one: ExchangeFormat, recipe: Recipe
) -> None:
    block = block_of(recipe)
    path, notes = written(one, block, tmp_path_factory.mktemp(one.name))
    assert "no file of the program itself" in notes[-1]
    bent = recipe[2] > 0 or recipe[3]
    assert any("free of lens distortion" in note for note in notes) == bent
    again = read_by(one, path)
    assert set(again.photos) == set(block.photos)
    for name, photo in block.photos.items():
        other = again.photos[name].orientation
        off = np.abs(other.centre - photo.orientation.centre).max()
        assert off < DIGITS.get(one.name, 1e-6)
        turned = other.object_from_image - photo.orientation.object_from_image
        assert np.abs(turned).max() < 1e-9
    assert_same_points(block, again)
    assert {n: p.role for n, p in again.points.items()} == {
        n: p.role for n, p in block.points.items()
    }
    before, after = rays_of(block), rays_of(again)
    assert set(after) == set(before)
    assert max(np.abs(np.subtract(after[key], before[key])).max() for key in before) < 1e-9


@settings(max_examples=10)
@given(RECIPES)
def test_inpho_brings_pixels_back__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    seed, photos, _, _ = recipe
    block = block_of((seed, photos, 0, False))
    path, _ = written(INPHO_FORMAT, block, tmp_path_factory.mktemp("inpho"))
    again = read_inpho(path)
    assert again.crs == block.crs
    before = {(m.point_id, m.photo_id): m for m in block.measurements}
    assert len(again.measurements) == len(before)
    for one in again.measurements:
        same = before[one.point_id, one.photo_id]
        assert math.hypot(one.column - same.column, one.row - same.row) < 1e-6
        assert one.sigma_px == pytest.approx(same.sigma_px)
    for name, point in block.points.items():
        assert again.points[name].sigma_m == pytest.approx(point.sigma_m)


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_a_published_film_block_misses_by_as_much_as_before__real(
    shared_data: Path, tmp_path: Path, one: ExchangeFormat
) -> None:
    block = read_film_block(shared_data)
    path, _ = written(one, block, tmp_path)
    again = read_by(one, path)
    pixel = 1.0 if again.photos["4092"].interior[0, 2] else 1000 * 0.025
    assert median_misfit(again) / pixel == pytest.approx(median_misfit(block), rel=0.01)


def test_patb_turns_matrices_round_where_control_says_so__real(
    shared_data: Path, tmp_path: Path
) -> None:
    block = read_film_block(shared_data)
    path, _ = written(PATB_FORMAT, block, tmp_path)
    listed = (path / "patb_eo.txt").read_text().splitlines()
    for at in range(1, len(listed), 3):
        numbers = [float(cell) for cell in (listed[at] + listed[at + 1]).split()]
        turned = np.array(numbers).reshape(3, 3).T.ravel()
        listed[at] = "".join(f"{value:16.12f}" for value in turned[:5])
        listed[at + 1] = "".join(f"{value:16.12f}" for value in turned[5:])
    (path / "patb_eo.txt").write_text("\n".join(listed))
    again = read_patb(path)
    assert "measured control says so" in again.notes[-1]
    for name, photo in block.photos.items():
        other = again.photos[name].orientation.object_from_image
        assert np.abs(other - photo.orientation.object_from_image).max() < 1e-9


def test_patb_keeps_its_columns__truth(tmp_path: Path) -> None:
    block = block_of((7, 1, 0, False))
    path, _ = written(PATB_FORMAT, block, tmp_path)
    first, second, third = (path / "patb_eo.txt").read_text().splitlines()
    # I16, 16x, 3F16.5; 5F16.12; 4F16.12, as PCI describes them.
    assert first[:16].strip() == "1"
    assert not first[16:32].strip()
    assert len(first) == 80
    assert float(first[32:48]) == pytest.approx(
        block.photos["1938_000"].orientation.centre[0], abs=1e-5
    )
    assert (len(second), len(third)) == (80, 64)


def test_numbers_stay_and_names_get_free_ones__truth() -> None:
    assert numbered(["2", "a", "b", "1"]) == {"2": "2", "a": "3", "b": "4", "1": "1"}
    assert numbered(["1" * 16])["1" * 16] == "1"


EO = f"{'1':>16}{'':16}{0.0:16.5f}{0.0:16.5f}{9.0:16.5f}\n1 0 0 0 1\n0 0 0 1\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("patb_eo.txt", EO + "2 0 0\n", "4 lines, not three for every photo"),
        ("patb_eo.txt", EO + EO, "1 stands twice"),
        ("patb_eo.txt", EO.replace("1 0 0 0 1", "1 0 0 0 2"), "is no rotation"),
        ("patb_eo.txt", EO.replace("9.0", "nan"), "'nan0000' is not a number"),
        ("patb_img.im", "1 153000\n7 1 2\n", "does not end with -99"),
        ("patb_img.im", "2 153000\n7 1 2\n-99\n-99\n", "photo 2, which is unknown"),
        ("patb_img.im", "1 153000\n7 1 2\n7 1 2\n-99\n-99\n", "measured twice"),
        ("patb_img.im", "1 153000\n7 1\n-99\n-99\n", "ends after 2 entries"),
        ("patb_cntl.con", "7 1 2 3\n7 1 2 3\n-99\n", "7 stands twice"),
        ("patb_cntl.con", "7 1 2 3\n", "does not end with -99"),
    ],
)
def test_broken_patb_is_named__truth(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / "patb_eo.txt").write_text(EO)
    (tmp_path / name).write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_patb(tmp_path)


def test_a_folder_without_orientations_is_named__truth(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"holds no patb_eo\.txt"):
        read_patb(tmp_path)
    with pytest.raises(ProjectError, match="cannot be read"):
        read_bingo(tmp_path)


GEO = "ORIA a 0 0 9 0 0 0\nCONT p 1 2 3\n"


@pytest.mark.parametrize(
    ("geo", "image", "words"),
    [
        (GEO + "CONT p 1 2 3\n", "", "p stands twice"),
        ("ORIA a 0 0 9 0 0 401\n", "", "401(.0)? gon is more than a whole turn"),
        ("ORIA a 0 0 9 0 0\n", "", "ends after 7 entries"),
        (GEO, "a cam\np 1 2\n", "does not end with -99"),
        (GEO, "b cam\np 1 2\n-99\n", "photo b, which is unknown"),
        (GEO, "a other\np 1 2\n-99\n", "principal distance of camera 'other'"),
    ],
)
def test_broken_bingo_is_named__truth(tmp_path: Path, geo: str, image: str, words: str) -> None:
    (tmp_path / "geoin.dat").write_text(geo)
    (tmp_path / "image.dat").write_text(image)
    (tmp_path / "cameras.txt").write_text("cam 153\n")
    with pytest.raises(ProjectError, match=words):
        read_bingo(tmp_path)


PHOTO = """$PROJECT 5
$END
$PHOTO
  $PHOTO_NUM : a
  $EXT_ORI : 12:00:00 01/01/2026
    124 380000 5680000 1000
    1 0 0
    0 1 0
    0 0 1
  $PHOTO_POINTS :
    7 1.0 2.0 0.004 1 { * }
  $END_POINTS
$END
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [("$PHOTO\n", "is no project of Inpho"), (PHOTO[: PHOTO.rindex("$END")], "does not end"),
     (PHOTO + PHOTO.partition("$END\n")[2], "a stands twice"),
     (PHOTO.replace("0 1 0", "0 2 0"), "holds no rotation"),
     (PHOTO.replace("    0 0 1\n", ""), "is not a number|no rotation|ends after"),
     (PHOTO.replace("$PHOTO_NUM", "$NUMBER"), "has no .PHOTO_NUM"),
     (PHOTO + "$CAMERA_DEFINITION\n  $ID : x\n$END\n", "has no .FOCAL_LENGTH"),
     (PHOTO + "$CONTROL_POINTS\n  7 1 2 3 3\n  7 1 2 3 3\n$END_POINTS\n", "7 stands twice")],
)  # fmt: skip
def test_broken_inpho_is_named__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.prj"
    path.write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_inpho(path)


def test_inpho_of_a_digital_camera_with_calibration_sets__truth(tmp_path: Path) -> None:
    camera = """$CAMERA_DEFINITION
  $ID : O42
  $CCD_COLUMNS : 100
  $CCD_ROWS : 80
  $PIXEL_REFERENCE : CenterTopLeft
  $CALIBRATION_SET :
    $ID : 1
    $CCD_INTERIOR_ORIENTATION :
      10 0 49.5
      0 -10 39.5
    $FOCAL_LENGTH : 124
    $PRINCIPAL_POINT_PPA : 0 0
    $END
$END
"""
    path = tmp_path / "a.prj"
    photo = PHOTO.replace("  $EXT_ORI", "  $CAMERA_ID : O42\n  $EXT_ORI")
    path.write_text(photo + camera)
    block = read_inpho(path)
    # A hundred columns have their middle at 50 from the outer corner.
    np.testing.assert_allclose(block.photos["a"].interior, [[1240, 0, 50], [0, -1240, 40]])
    below = np.array([[380000.0, 5680000.0, 0.0]])
    pixel = pixels_of(below, block.photos["a"], block.camera_of("a"))[0]
    np.testing.assert_allclose(pixel, [50, 40])
    np.testing.assert_allclose(block.ties.pixels, [[60, 20]])
    path.write_text(photo + camera.replace("10 0 49.5", "1e307 0 49.5"))
    with pytest.raises(ExchangeError, match="damaged"):
        read_format(INPHO_FORMAT, path)
