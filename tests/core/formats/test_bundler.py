"""Bundler's files: OpenCV sees in them what we see, and a block comes back."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings

from core.errors import PhotogrammetryError
from core.formats.bundler import read_bundler, write_bundler
from core.formats.exchange import ExchangeBlock, pixels_of
from tests.exchanged import RECIPES, Recipe, assert_same_geometry, assert_same_ties, block_of

FULL: Recipe = (77, 4, 3, True)


@given(RECIPES)
@settings(max_examples=25)
def test_a_block_comes_back__law(tmp_path_factory: pytest.TempPathFactory, recipe: Recipe) -> None:
    seed, photos, radial, _ = recipe
    block = block_of((seed, photos, min(radial, 2), False), "upright")
    folder = tmp_path_factory.mktemp("bundler")
    write_bundler(folder, block)
    again = read_bundler(folder)
    assert again.crs == block.crs
    assert_same_geometry(block, again)
    assert_same_ties(block, again)


@pytest.mark.parametrize("recipe", [(3, 3, 2, False), FULL])
def test_opencv_sees_in_the_file_what_we_see__oracle(tmp_path: Path, recipe: Recipe) -> None:
    """Residuals of every ray by OpenCV from the file's numbers alone; y and z turned about."""
    block = block_of(recipe, "upright")
    write_bundler(tmp_path, block)
    words = [float(w) for line in (tmp_path / "bundle.out").read_text().splitlines()[1:]
             for w in line.split()]  # fmt: skip
    cameras, points = int(words[0]), int(words[1])
    lenses = np.array(words[2 : 2 + 15 * cameras]).reshape(cameras, 15)
    rest = words[2 + 15 * cameras :]
    flip, off = np.diag([1.0, -1.0, -1.0]), []
    for _ in range(points):
        place, views = np.array(rest[:3]), int(rest[6])
        for view in np.array(rest[7 : 7 + 4 * views]).reshape(-1, 4):
            f, k1, k2, *rest_of = lenses[int(view[0])]
            turn, shift = np.array(rest_of[:9]).reshape(3, 3), np.array(rest_of[9:])
            shown, _ = cv2.projectPoints(
                place[None], cv2.Rodrigues(flip @ turn)[0], flip @ shift,
                np.diag([f, f, 1.0]), np.array([k1, k2, 0.0, 0.0]),
            )  # fmt: skip
            off.append(shown.ravel() * [1, -1] - view[2:])
        rest = rest[7 + 4 * views :]
    assert not rest
    ties, ours = block.ties, []
    assert ties.positions is not None
    for point, photo, pixel in zip(ties.point, ties.photo, ties.pixels, strict=True):
        name = ties.photo_ids[int(photo)]
        shown = pixels_of(ties.positions[[point]], block.photos[name], block.camera_of(name))[0]
        ours.append((shown - pixel) * [1, -1])
    # A residual of a pixel is stretched by what the lens was freed of: at most some thousandths.
    assert np.abs(np.array(off) - np.array(ours)).max() < 0.02


def test_what_the_lens_was_freed_of_is_said__truth(tmp_path: Path) -> None:
    assert any("k1 and k2" in note for note in write_bundler(tmp_path, block_of(FULL, "upright")))


def test_without_the_note_pixels_count_from_the_middle__truth(tmp_path: Path) -> None:
    write_bundler(tmp_path, block_of((4, 2, 2, False), "upright"))
    (tmp_path / "gruber.json").unlink()
    block = read_bundler(tmp_path)
    assert block.from_middle
    assert all(photo.interior[:, 2].tolist() == [0.0, 0.0] for photo in block.photos.values())
    assert all(photo.exterior is not None for photo in block.photos.values())


SPOILED = {
    "empty": lambda text: "",
    "other version": lambda text: text.replace("v0.3", "v0.2"),
    "cut": lambda text: text[: len(text) // 3],
    "cut late": lambda text: text[:-40],
    "words": lambda text: text.replace("128", "grey", 1),
    "too many cameras": lambda text: text.replace("\n4 ", "\n9 ", 1),
    "counts beyond": lambda text: text.replace("\n4 ", "\n4 99", 1),
    "nan": lambda text: text.replace("128", "nan", 1),
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_broken_file_is_refused__truth(tmp_path: Path, name: str) -> None:
    write_bundler(tmp_path, block_of(FULL, "upright"))
    path = tmp_path / "bundle.out"
    path.write_text(SPOILED[name](path.read_text()))
    with pytest.raises(PhotogrammetryError):
        read_bundler(tmp_path)


def test_missing_names_and_a_block_without_orientation_are_refused__truth(tmp_path: Path) -> None:
    with pytest.raises(PhotogrammetryError):
        write_bundler(tmp_path, ExchangeBlock())
    write_bundler(tmp_path, block_of(FULL, "upright"))
    (tmp_path / "list.txt").unlink()
    with pytest.raises(PhotogrammetryError):
        read_bundler(tmp_path)
