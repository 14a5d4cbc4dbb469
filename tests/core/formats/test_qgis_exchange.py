"""QGIS's side files as GDAL reads them, there and back, and a project of layers."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from PIL import Image

from core.errors import ExchangeError, PhotogrammetryError, ProjectError
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    pixels_of,
)
from core.formats.qgis_exchange import read_qgis, write_qgis
from core.geometry.exterior import ExteriorOrientation
from tests.core.formats.random_blocks import SEEDS, assert_same_points, block_of

CENTRE = np.array([-743000.0, -1043000.0, 2250.0])


def level_block(tilt: float) -> ExchangeBlock:
    """One photo 2000 m above four points of level ground."""
    camera = ExchangeCamera("c", size_px=(1000, 800))
    affine = np.array([[900.0, 0.0, 500.0], [0.0, -900.0, 400.0]])
    photo = ExchangePhoto("a", "a.tif", "c", affine, ExteriorOrientation(CENTRE, tilt, 0.0, 0.7))
    points = {
        f"p{n}": ExchangePoint(f"p{n}", (CENTRE[0] + e, CENTRE[1] + h, 250.0))
        for n, (e, h) in enumerate([(-300.0, 100.0), (250.0, 200.0), (40.0, -310.0), (0.0, 20.0)])
    }
    places = np.array([point.position for point in points.values()])
    seen = pixels_of(places, photo, camera)
    measured = [
        ExchangeMeasurement(name, "a", *pixel)
        for name, pixel in zip(points, seen.tolist(), strict=True)
    ]
    return ExchangeBlock("EPSG:5514", {"c": camera}, {"a": photo}, points, tuple(measured))


def scan(path: Path) -> None:
    Image.fromarray(np.zeros((800, 1000), np.uint8)).save(path)


@pytest.mark.parametrize("aside", ["a.tif.aux.xml", "a.tfw"])
def test_gdal_finds_a_vertical_photo_where_it_lies__oracle(tmp_path: Path, aside: str) -> None:
    block = level_block(0.0)
    assert write_qgis(tmp_path, block) == ()
    for name in {"a.tif.aux.xml", "a.tfw"} - {aside}:
        (tmp_path / name).unlink()
    scan(tmp_path / "a.tif")
    before = (tmp_path / "a.tif").read_bytes()
    with rasterio.Env(GDAL_GEOREF_SOURCES="PAM,WORLDFILE"), rasterio.open(tmp_path / "a.tif") as r:
        for one in block.measurements:
            place = block.points[one.point_id].position
            assert r.transform @ (one.column, one.row) == pytest.approx(place[:2], abs=1e-6)
        assert aside == "a.tfw" or r.crs.to_epsg() == 5514
    assert (tmp_path / "a.tif").read_bytes() == before


def test_gdal_reads_the_points_of_a_scan_without_orientation__oracle(tmp_path: Path) -> None:
    block = level_block(0.0)
    lost = replace(block, photos={"a": ExchangePhoto("a", "a.tif", "c")})
    assert "without world file: a." in write_qgis(tmp_path, lost)[0]
    scan(tmp_path / "a.tif")
    with rasterio.open(tmp_path / "a.tif") as raster:
        points, crs = raster.gcps
    assert crs.to_epsg() == 5514
    assert {one.id: (one.col, one.row) for one in points} == {
        one.point_id: (one.column, one.row) for one in block.measurements
    }
    assert {one.id: (one.x, one.y, one.z) for one in points} == {
        name: point.position for name, point in block.points.items()
    }


def test_a_tilted_photo_lies_as_near_as_an_affine_can__truth(tmp_path: Path) -> None:
    block = level_block(0.02)
    write_qgis(tmp_path, block)
    a, d, b, e, c, f = (float(word) for word in (tmp_path / "a.tfw").read_text().split())
    for one in block.measurements:
        column, row = one.column - 0.5, one.row - 0.5
        place = (a * column + b * row + c, d * column + e * row + f)
        # A tilt of 0.02 bends a frame of half a principal distance by about a hundredth of it.
        assert np.hypot(*np.subtract(place, block.points[one.point_id].position[:2])) < 12


@given(SEEDS)
@settings(max_examples=20)
def test_points_and_measurements_come_back__law(seed: int) -> None:
    block = block_of(seed, film=True)
    if not block.points:
        return
    with TemporaryDirectory() as folder:
        write_qgis(Path(folder), block)
        again = read_qgis(Path(folder))
    plain = tuple(
        ExchangeMeasurement(m.point_id, m.photo_id, m.column, m.row) for m in block.measurements
    )
    assert_same_points(ExchangeBlock(points=block.points, measurements=plain), again)
    assert set(again.photos) == set(block.photos)


@pytest.mark.parametrize(
    ("name", "part", "instead", "told"),
    [
        ("points.csv", "p1,", "p0,", "p0 stands twice"),
        ("points.csv", "p1,", ",", "the column id is empty"),
        ("points.csv", "250.0,", "high,", "'high' is not a number"),
        ("a.tif.points", "-743300.0", "-743301.0", "0 points of points.csv lie at"),
    ],
)
def test_broken_lists_are_told__truth(
    tmp_path: Path, name: str, part: str, instead: str, told: str
) -> None:
    write_qgis(tmp_path, level_block(0.0))
    text = (tmp_path / name).read_text()
    assert part in text
    (tmp_path / name).write_text(text.replace(part, instead, 1))
    with pytest.raises(PhotogrammetryError, match=told):
        read_qgis(tmp_path)


def test_files_of_two_crs_and_no_files_are_told__truth(tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match=r"no \.points files"):
        read_qgis(tmp_path)
    write_qgis(tmp_path, level_block(0.0))
    text = (tmp_path / "a.tif.points").read_text()
    (tmp_path / "b.tif.points").write_text(text.replace("5514", "32633"))
    with pytest.raises(ExchangeError, match="not that of the other files"):
        read_qgis(tmp_path)
    (tmp_path / "b.tif.points").unlink()
    (tmp_path / "points.csv").unlink()
    with pytest.raises(ProjectError, match="cannot be read"):
        read_qgis(tmp_path)


def test_what_does_not_lie_on_the_ground_is_told__truth(tmp_path: Path) -> None:
    notes = write_qgis(tmp_path, level_block(1.5))
    assert "without world file: a." in notes[0]
    root = ElementTree.parse(tmp_path / "a.tif.aux.xml").getroot()
    assert root.find("GeoTransform") is None
    assert len(root.findall("GCPList/GCP")) == 4
