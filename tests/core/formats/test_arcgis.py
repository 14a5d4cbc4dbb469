"""ArcGIS frames and cameras tables: round trips, what a frame says before its camera, errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from core.errors import ProjectError
from core.formats.arcgis import read_arcgis, write_arcgis
from core.formats.exchange import ExchangeBlock
from tests.core.formats.film_block import PRINCIPAL_MM, read_film_block
from tests.exchanged import RECIPES, Recipe, assert_same_geometry, block_of


@settings(max_examples=12)
@given(RECIPES)
def test_frames_come_back__law(tmp_path_factory: pytest.TempPathFactory, recipe: Recipe) -> None:
    seed, photos, radial, _ = recipe
    bent = block_of((seed, photos, radial, False))
    straight = {name: replace(camera, radial=()) for name, camera in bent.cameras.items()}
    block = replace(bent, cameras=straight)
    folder = tmp_path_factory.mktemp("arcgis")
    notes = write_arcgis(folder, bent)
    assert "no points and no measurements" in notes[-2]
    assert ("lens distortion" in notes[0]) == (radial > 0)
    assert_same_geometry(block, read_arcgis(folder))
    assert read_arcgis(folder).crs == block.crs


def test_film_of_a_published_block_lies_where_its_fiducials_do__real(
    shared_data: Path, tmp_path: Path
) -> None:
    block = read_film_block(shared_data)
    write_arcgis(tmp_path, block)
    head, first = (
        line.split(",") for line in (tmp_path / "frames.csv").read_text().split("\n")[:2]
    )
    values = np.array([float(first[head.index(k)]) for k in ("A0", "A1", "A2", "B0", "B1", "B2")])
    film = values.reshape(2, 3) @ np.array([1, *block.photos["4092"].fiducials_px["1"]])
    # 8 micrometres is what the eight fiducials leave.
    np.testing.assert_allclose(film / 1000, block.cameras["RMK Top15"].fiducials_mm["1"], atol=0.02)
    again = read_arcgis(tmp_path)
    assert again.cameras["RMK Top15"].principal_point_mm == pytest.approx(PRINCIPAL_MM)


FRAMES = """ObjectID,Raster,CameraID,PerspectiveX,PerspectiveY,PerspectiveZ,Omega,Phi,Kappa
1,c:\\scans\\a.tif,cam,1,2,3000,0.5,-0.5,90
"""
CAMERAS = """CameraID,FocalLength,A0,A1,A2,B0,B1,B2
cam,153000,-100,25,0,100,0,-25
"""


def test_the_affine_of_the_camera_serves_where_a_frame_has_none__truth(tmp_path: Path) -> None:
    (tmp_path / "frames.csv").write_text(FRAMES)
    (tmp_path / "cameras.csv").write_text(CAMERAS)
    photo = read_arcgis(tmp_path).photos["a"]
    np.testing.assert_allclose(photo.interior, [[6120, 0, 4], [0, -6120, 4]])
    assert photo.orientation.kappa == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("frames", "cameras", "words"),
    [(FRAMES.replace("PerspectiveZ", "Height"), CAMERAS, "column PerspectiveZ is missing"),
     (FRAMES.split("\n")[0], CAMERAS, "holds no rows"),
     (FRAMES + FRAMES.split("\n")[1], CAMERAS, "a stands twice"),
     (FRAMES.replace(",cam,", ",other,"), CAMERAS, "camera 'other' is unknown"),
     (FRAMES.replace("90", "nan"), CAMERAS, "'nan' is not a number"),
     (FRAMES.replace("90", "390"), CAMERAS, "390(.0)? degrees is more than a whole turn"),
     (FRAMES.replace(",90", ""), CAMERAS, "column Kappa is empty"),
     (FRAMES, CAMERAS.replace("153000", ""), "column FocalLength is empty"),
     (FRAMES, CAMERAS.replace("B2\n", "B2,AffineDirection\n").replace("-25\n", "-25,-1\n"),
      "from film to image")],
)  # fmt: skip
def test_broken_tables_are_named__truth(
    tmp_path: Path, frames: str, cameras: str, words: str
) -> None:
    (tmp_path / "frames.csv").write_text(frames)
    (tmp_path / "cameras.csv").write_text(cameras)
    with pytest.raises(ProjectError, match=words):
        read_arcgis(tmp_path)


def test_photos_without_orientation_are_told__truth(tmp_path: Path) -> None:
    block = block_of((3, 2, 0, False))
    plain = ExchangeBlock(block.crs, {}, block.photos)
    assert "2 photos have no orientation" in write_arcgis(tmp_path, plain)[0]
