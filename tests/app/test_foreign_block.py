"""A foreign project becomes a block that projects as the project did."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from app import exchange
from app.foreign_block import new_from
from app.project import described, read_project
from app.run import Run, RunOptions
from app.terminal import JsonLines
from core.errors import ProjectError
from core.formats.bundler import write_bundler
from core.formats.colmap import write_colmap
from core.formats.eo_list import read_eo_list
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
    pixels_of,
)
from core.geometry.collinearity import CORRECTIONS, VACUUM, film_from_object
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation, nominal_interior
from core.pipeline import made as made_by
from core.scans.fiducials import fiducials_by_hand
from core.scans.judging import interior_of
from core.ties.stage import ties_of_list
from sessions.decisions import BringPoints, Place
from sessions.session import Session

HOW = Conventions("", "")
SIZE = (900, 700)
HERE = "+proj=tmerc +lat_0=49 +lon_0=15 +datum=WGS84 +type=crs"
GROUND = np.array([[e, n, 300.0] for e in (1000.0, 1500, 2000) for n in (4000.0, 4600, 5000)])
GRAIN = np.random.default_rng(5).integers(0, 255, SIZE[::-1], dtype=np.uint8)
SQUARE = np.array([[4000.0, 0.0, 455.0], [0.0, -4000.0, 340.0]])
SKEWED = np.array([[3990.0, 12.0, 455.0], [-5.0, -4010.0, 340.0]])


def project_in(folder: Path, matrix: np.ndarray, **camera: Any) -> ExchangeBlock:
    """Two photos with their scans, a point and a measurement of it."""
    photos: dict[str, ExchangePhoto] = {}
    for number in (1, 2):
        centre = np.array([1300.0 + 300 * number, 4500.0, 2300.0])
        Image.fromarray(GRAIN).save(folder / f"p{number}.png")
        exterior = ExteriorOrientation(centre, 0.01, -0.02, 0.5)
        photos[f"p{number}"] = ExchangePhoto(f"p{number}", f"p{number}.png", "c", matrix, exterior)
    lens = ExchangeCamera("c", (-0.03, 0.01), (0.001, -0.0005), SIZE, **camera)
    point = ExchangePoint("A", (1500.0, 4600.0, 300.0), (0.1, 0.1, 0.2))
    measured = (ExchangeMeasurement("A", "p1", 450.0, 350.0, 0.4),)
    return ExchangeBlock("EPSG:5514", {"c": lens}, photos, {"A": point}, measured)


def test_a_flat_earth_without_air_stays_one__truth(tmp_path: Path) -> None:
    """Ties of a COLMAP model are projected by our block where the model puts them."""
    block = replace(project_in(tmp_path, SQUARE), crs=HERE, measurements=(), points={})
    photos = tuple(block.photos)
    ground = GROUND + np.array([0.0, 0.0, 1.0]) * np.arange(9)[:, None] * 40
    pixels = [pixels_of(ground, block.photos[n], block.cameras["c"]) for n in photos]
    ties = ExchangeTies(
        photos,
        np.repeat(np.arange(9), 2),
        np.tile([0, 1], 9),
        np.stack(pixels, axis=1).reshape(-1, 2),
        positions=ground,
    )
    write_colmap(tmp_path / "sparse", replace(block, ties=ties))
    file = new_from(tmp_path, "colmap", tmp_path / "sparse", "", "anna").file
    project = read_project(file)
    assert project.block.corrections == ()
    with Session.open(tmp_path, "anna") as session:
        walk = Run(project, session, JsonLines(), RunOptions(last="georeference"))
        walk.walk()
        standing = made_by(walk.results.georeference).block
    read = ties_of_list(walk.given.ties, standing)
    assert read is not None
    assert read.count == 9
    for number, name in enumerate(read.photo_ids):
        rays = read.photo == number
        seen = standing.photos[name].pixel_from_object(
            ground[read.point[rays]], standing.camera_of(name)
        )
        assert np.abs(seen - read.pixels[rays]).max() < 0.001
        corrected = replace(standing.photos[name], corrections=CORRECTIONS)
        bent = corrected.pixel_from_object(ground[read.point[rays]], standing.camera_of(name))
        assert np.abs(bent - read.pixels[rays]).max() > 0.01


def test_bundler_counts_from_the_middle_of_the_scan__truth(tmp_path: Path) -> None:
    block = project_in(tmp_path, np.array([[4000.0, 0.0, 450.0], [0.0, -4000.0, 350.0]]))
    pixels = pixels_of(GROUND, block.photos["p1"], ExchangeCamera("c", (-0.03, 0.01)))
    ties = ExchangeTies(
        ("p1",), np.arange(9), np.zeros(9, dtype=int), pixels, positions=GROUND.copy()
    )
    plain = {"c": replace(block.cameras["c"], tangential=(0.0, 0.0))}
    write_bundler(tmp_path / "bundle", replace(block, cameras=plain, ties=ties))
    (tmp_path / "bundle" / "gruber.json").unlink()
    project = read_project(new_from(tmp_path, "bundler", tmp_path / "bundle", HERE, "a").file)
    camera = project.cameras[project.scans.listed[0].camera]
    assert camera.principal_point_mm == pytest.approx((0.0, 0.0), abs=1e-9)
    assert project.scans.ties is not None
    rows = project.scans.ties.read_text().splitlines()[1:]
    listed = np.array([[float(cell) for cell in row.split(",")[2:4]] for row in rows])
    np.testing.assert_allclose(listed, pixels, atol=1e-6)


def made(
    folder: Path, foreign: ExchangeBlock, monkeypatch: pytest.MonkeyPatch, crs: str = ""
) -> Path:
    form = ExchangeFormat("any", "", HOW, "film", read=lambda path: foreign)
    monkeypatch.setattr(exchange, "FORMATS", {"any": form})
    return new_from(folder, "any", None, crs, "anna").file


@pytest.mark.parametrize("matrix", [SQUARE, SKEWED], ids=["square", "skewed"])
@pytest.mark.parametrize("distance", [None, 153.2], ids=["pixels", "mm"])
def test_the_block_projects_as_the_project_did__truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, matrix: np.ndarray, distance: float | None
) -> None:
    foreign = project_in(tmp_path, matrix, principal_distance_mm=distance)
    project = read_project(made(tmp_path, foreign, monkeypatch))
    given = described(project)
    assert project.scans.exterior is not None
    listed = read_eo_list(project.scans.exterior)
    for scan in given.scans:
        camera = given.cameras[scan.camera]
        interior = nominal_interior(SIZE, camera, scan.scan_pixel_um / 1000)
        if scan.marks:
            marks = fiducials_by_hand(scan.path.stem, camera, scan.marks).marks
            interior = interior_of(marks, camera.fiducials_mm, back=False)
            assert isinstance(interior, InteriorOrientation)
        record = listed[scan.path.stem]
        assert record.angles is not None
        exterior = ExteriorOrientation(np.array(record.centre), *record.angles)
        film = film_from_object(GROUND.copy(), exterior, camera, VACUUM)
        photo = foreign.photos[scan.path.stem]
        there = pixels_of(GROUND, photo, foreign.camera_of(photo.photo_id))
        assert np.allclose(interior.pixel_from_film(film), there, atol=1e-5)


def test_points_and_measurements_are_decisions__law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(tmp_path, project_in(tmp_path, SQUARE), monkeypatch)
    with Session.open(tmp_path, "anna") as session:
        decided = [one.decision for one in session.decisions()]
    assert isinstance(decided[0], BringPoints)
    assert decided[1] == Place("A", "p1", 450.0, 350.0, 0.4)


def test_points_on_film_make_no_block_and_no_measurement__law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreign = replace(project_in(tmp_path, SQUARE), on_film=True)
    with pytest.raises(ProjectError, match="no pixels of scans"):
        made(tmp_path, foreign, monkeypatch)
    assert not (tmp_path / "block.toml").exists()
    decided = exchange.decisions_of(foreign, {"p1": "p1"}, "patb")
    assert [type(one) for one in decided] == [BringPoints]


def test_what_cannot_become_a_block_leaves_nothing__law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreign = project_in(tmp_path, SQUARE)
    with pytest.raises(ProjectError, match="names no CRS"):
        made(tmp_path, replace(foreign, crs=""), monkeypatch)
    with pytest.raises(ProjectError, match="Name the CRS it is in"):
        made(tmp_path, replace(foreign, crs=""), monkeypatch, "EPSG:2193")
    elsewhere = tmp_path / "empty"
    elsewhere.mkdir()
    with pytest.raises(ProjectError, match="holds no scan of the project, such as p1"):
        made(elsewhere, foreign, monkeypatch)
    assert not list(elsewhere.iterdir())
    assert not (tmp_path / "block.toml").exists()
    assert not (tmp_path / "session.gpkg").exists()
    file = made(tmp_path, foreign, monkeypatch)
    before = file.read_text()
    with pytest.raises(ProjectError, match="is there already"):
        made(tmp_path, foreign, monkeypatch)
    assert file.read_text() == before
