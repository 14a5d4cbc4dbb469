"""COLMAP's models: what COLMAP wrote is read, and pycolmap sees in ours what we see."""

import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings

from core.errors import PhotogrammetryError
from core.formats.colmap import read_colmap, write_colmap
from core.formats.exchange import ExchangeBlock, pixels_of
from core.formats.frame_interiors import FrameInterior, frame_photos
from tests.exchanged import (
    CRS,
    RECIPES,
    Recipe,
    assert_same_geometry,
    assert_same_ties,
    block_of,
)

FULL: Recipe = (77, 4, 3, True)
SAMPLE = "exchange-samples/colmap"


def only_text(folder: Path) -> Path:
    for path in folder.glob("*.bin"):
        path.unlink()
    return folder


def reprojected(model: pycolmap.Reconstruction) -> np.ndarray:
    """Pixels of every ray as pycolmap projects its point, minus those in the image."""
    off = []
    for point in model.points3D.values():
        for ray in point.track.elements:
            image = model.images[ray.image_id]
            shown = image.project_point(point.xyz)
            off.append(shown - image.points2D[ray.point2D_idx].xy)
    return np.array(off)


@given(RECIPES)
@settings(max_examples=40)
def test_a_block_comes_back__law(tmp_path_factory: pytest.TempPathFactory, recipe: Recipe) -> None:
    block, folder = block_of(recipe, "upright"), tmp_path_factory.mktemp("colmap")
    write_colmap(folder, block)
    for again in (read_colmap(folder), read_colmap(only_text(folder))):
        assert again.crs == CRS
        assert again.cameras.keys() == {photo.camera for photo in block.photos.values()}
        assert_same_geometry(block, again)
        assert_same_ties(block, again)
        assert set(again.ties.names) <= set(block.ties.names)


@given(RECIPES)
@settings(max_examples=20)
def test_pycolmap_projects_ties_where_we_do__oracle(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block, folder = block_of(recipe, "upright"), tmp_path_factory.mktemp("colmap")
    write_colmap(folder, block)
    binary = pycolmap.Reconstruction(folder)
    text = pycolmap.Reconstruction(only_text(folder))
    ties = block.ties
    for model in (binary, text):
        assert model.num_images() == len(block.photos)
        assert model.num_points3D() == len(np.unique(ties.point))
        if not len(ties.point):
            continue
        assert ties.positions is not None
        before = np.array(sorted(ours_off(block).items()), dtype=object)
        after = np.array(sorted(zip(columns(model), reprojected(model), strict=True)), dtype=object)
        assert np.abs(np.stack(before[:, 1]) - np.stack(after[:, 1])).max() < 0.01


def ours_off(block: ExchangeBlock) -> dict[float, np.ndarray]:
    """Computed minus measured of all rays, by their column."""
    ties, found = block.ties, {}
    assert ties.positions is not None
    for point, photo, pixel in zip(ties.point, ties.photo, ties.pixels, strict=True):
        name = ties.photo_ids[photo]
        shown = pixels_of(ties.positions[[point]], block.photos[name], block.camera_of(name))[0]
        found[float(pixel[0])] = shown - pixel
    return found


def columns(model: pycolmap.Reconstruction) -> list[float]:
    return [
        float(model.images[ray.image_id].points2D[ray.point2D_idx].xy[0])
        for point in model.points3D.values()
        for ray in point.track.elements
    ]


def test_each_lens_takes_the_smallest_model__oracle(tmp_path: Path) -> None:
    wanted = {
        (0, False): "SIMPLE_PINHOLE", (1, False): "SIMPLE_RADIAL", (2, False): "RADIAL",
        (3, False): "FULL_OPENCV", (0, True): "OPENCV", (2, True): "OPENCV",
        (3, True): "FULL_OPENCV",
    }  # fmt: skip
    for (radial, tangential), model in wanted.items():
        write_colmap(tmp_path, block_of((2, 2, radial, tangential), "upright"))
        cameras = pycolmap.Reconstruction(tmp_path).cameras.values()
        assert {camera.model.name for camera in cameras} == {model}


def test_a_model_of_colmap_reprojects_as_it_says__real(shared_data: Path) -> None:
    folder = shared_data / SAMPLE
    block = read_colmap(folder)
    ties, off = block.ties, []
    assert ties.positions is not None
    for number, name in enumerate(ties.photo_ids):
        rays = ties.photo == number
        shown = pixels_of(
            ties.positions[ties.point[rays]], block.photos[name], block.camera_of(name)
        )
        off.append(np.linalg.norm(shown - ties.pixels[rays], axis=1))
    # COLMAP's own mean error of each point stands in points3D.txt; six digits are written.
    said = [float(line.split()[7]) for line in (folder / "points3D.txt").read_text().splitlines()
            if not line.startswith("#")]  # fmt: skip
    mine = np.bincount(
        np.concatenate([ties.point[ties.photo == n] for n in range(11)]), np.concatenate(off)
    ) / np.bincount(ties.point)
    assert len(ties.point) == 37123
    assert np.abs(mine - said).max() < 0.02
    assert np.median(np.abs(mine - said)) < 0.002


def test_a_model_of_colmap_is_the_same_again__real(shared_data: Path, tmp_path: Path) -> None:
    block = read_colmap(shared_data / SAMPLE)
    write_colmap(tmp_path, block)
    ours, theirs = pycolmap.Reconstruction(tmp_path), pycolmap.Reconstruction(shared_data / SAMPLE)
    named = {image.name: image for image in theirs.images.values()}
    for image in ours.images.values():
        other = named[image.name].cam_from_world().matrix()
        assert np.allclose(image.cam_from_world().matrix(), other, atol=1e-12)
    assert ours.num_points3D() == theirs.num_points3D()
    assert np.isclose(
        np.linalg.norm(reprojected(ours), axis=1).mean(),
        np.linalg.norm(reprojected(theirs), axis=1).mean(),
        atol=1e-6,
    )
    camera, other = ours.cameras[1], theirs.cameras[1]
    assert (camera.model, camera.width, camera.height) == (other.model, other.width, other.height)
    assert np.array_equal(camera.params, other.params)


def test_models_of_todays_colmap_with_rigs_and_frames_are_read__oracle(tmp_path: Path) -> None:
    block = block_of(FULL, "upright")
    write_colmap(tmp_path / "a", block)
    for write in ("write_binary", "write_text"):
        folder = tmp_path / write
        folder.mkdir()
        getattr(pycolmap.Reconstruction(tmp_path / "a"), write)(folder)
        assert list(folder.glob("rigs.*"))
        assert list(folder.glob("frames.*"))
        shutil.copy(tmp_path / "a" / "gruber.json", folder)
        assert_same_geometry(block, read_colmap(folder))
        assert_same_ties(block, read_colmap(folder))


def test_without_the_note_of_the_origin_coordinates_are_local__truth(tmp_path: Path) -> None:
    block = block_of(FULL, "upright")
    write_colmap(tmp_path, block)
    origin = np.array(json.loads((tmp_path / "gruber.json").read_text())["origin"])
    assert np.array_equal(origin % 1000, np.zeros(3))
    (tmp_path / "gruber.json").unlink()
    local = read_colmap(tmp_path)
    assert local.crs == ""
    assert local.notes
    for name, photo in local.photos.items():
        here, there = photo.exterior, block.photos[name].exterior
        assert here is not None
        assert there is not None
        assert np.allclose(here.centre, there.centre - origin, atol=1e-6)


def test_what_is_left_out_is_said__truth(tmp_path: Path) -> None:
    notes = write_colmap(tmp_path, block_of(FULL, "frame"))
    assert any("skew" in note for note in notes)
    assert any("surveyed points" in note for note in notes)


def test_skew_is_known_by_its_size_alone__truth() -> None:
    photos = frame_photos(block_of(FULL, "upright"))
    assert all(one.skew_px == one.affinity_px == 0.0 for one in photos.interiors.values())
    assert len(photos.interiors) == 2
    assert all(isinstance(one, FrameInterior) for one in photos.interiors.values())


def cut(name: str, keep: float) -> object:
    def spoil(folder: Path) -> None:
        path = folder / name
        path.write_bytes(path.read_bytes()[: int(path.stat().st_size * keep)])

    return spoil


def exchange(name: str, old: str, new: str) -> object:
    def spoil(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return spoil


def bomb(folder: Path) -> None:
    (folder / "images.bin").write_bytes(struct.pack("<Q", 2**62))


def lost_number(folder: Path) -> None:
    data = bytearray((folder / "points3D.bin").read_bytes())
    data[16:24] = struct.pack("<d", float("nan"))
    (folder / "points3D.bin").write_bytes(data)


def gone(name: str) -> object:
    return lambda folder: (folder / name).unlink()


BINARY = {
    "cameras cut": cut("cameras.bin", 0.7), "images cut": cut("images.bin", 0.9),
    "points cut": cut("points3D.bin", 0.5), "no images": gone("images.bin"),
    "no points": gone("points3D.bin"), "a count beyond the file": bomb, "nan": lost_number,
    "note without origin": exchange("gruber.json", "origin", "orogin"),
    "note cut": cut("gruber.json", 0.3),
}  # fmt: skip
TEXT = {
    "image without its rays": cut("images.txt", 0.6),
    "no images": gone("images.txt"),
    "fisheye": exchange("cameras.txt", "FULL_OPENCV", "THIN_PRISM_FISHEYE"),
    "unknown model": exchange("cameras.txt", "FULL_OPENCV", "PANORAMA"),
    "no number": exchange("cameras.txt", " 9000 ", " wide "),
    "nan": exchange("points3D.txt", "1 ", "1 nan "),
    "unknown camera": exchange("images.txt", " 1 1938_000", " 7 1938_000"),
    "one scan twice": exchange("images.txt", "1938_001.tif", "1938_000.tif"),
    "nothing at all": lambda folder: [path.unlink() for path in folder.glob("*.txt")],
}


@pytest.mark.parametrize("name", BINARY)
def test_a_broken_binary_model_is_refused__truth(tmp_path: Path, name: str) -> None:
    write_colmap(tmp_path, block_of(FULL, "upright"))
    BINARY[name](tmp_path)
    with pytest.raises(PhotogrammetryError):
        read_colmap(tmp_path)


@pytest.mark.parametrize("name", TEXT)
def test_a_broken_text_model_is_refused__truth(tmp_path: Path, name: str) -> None:
    write_colmap(tmp_path, block_of(FULL, "upright"))
    TEXT[name](only_text(tmp_path))
    with pytest.raises(PhotogrammetryError):
        read_colmap(tmp_path)


def test_a_block_without_orientation_is_refused__truth(tmp_path: Path) -> None:
    with pytest.raises(PhotogrammetryError):
        write_colmap(tmp_path, ExchangeBlock())
