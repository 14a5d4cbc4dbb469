"""A block whose scans have no pictures: stand-ins are made, and say so wherever one asks more."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.orthos import pictured
from app.stand_ins import has_pictures, make_stand_ins
from core.block import Block
from core.errors import ProjectError, ScanError
from core.geometry.camera import Camera
from core.raster.files import open_plain
from core.raster.stand_in import is_stand_in
from core.scans.interior_orientation import orient_scan
from tests.flights import FlightPlan, fly

SIZES = "image,width,height,X\na.img,1000,1100,1\nb,1000,1050,2\n"
MARKS_MM = {"1": (-9.0, 9.0), "2": (9.0, 9.0), "3": (9.0, -9.0), "4": (-9.0, -9.0)}
CAMERA = Camera("film", 15.0, (20.0, 20.0), fiducials_mm=MARKS_MM)
PIXEL_UM = 20.0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    table = tmp_path / "sizes.csv"
    table.write_text(SIZES)
    assert make_stand_ins(tmp_path / "block", table) == 2
    return tmp_path / "block"


def pixels_of_marks() -> dict[str, tuple[float, float]]:
    return {n: (500 + x * 50.0, 550 - y * 50.0) for n, (x, y) in MARKS_MM.items()}


def with_scans(block: Block, scans: dict[str, Path]) -> Block:
    photos = {n: replace(p, scan=scans[n], oriented=True) for n, p in block.photos.items()}
    return block.with_photos(photos)


def test_stand_ins_are_small_and_of_the_size_of_their_scans__truth(folder: Path) -> None:
    with open_plain(folder / "a.tif", {}) as dataset:
        assert (dataset.width, dataset.height) == (1000, 1100)
        assert not dataset.read(1).any()
    assert is_stand_in(folder / "a.tif")
    # Some kilobytes instead of a megabyte.
    assert (folder / "a.tif").stat().st_size < 5000


def test_a_block_is_begun_with_them__truth(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    table, folder = tmp_path / "sizes.csv", tmp_path / "block"
    table.write_text(SIZES)
    assert main(["new", str(folder), "--without-pictures", str(table)]) == 0
    assert "2 stand-ins made" in capsys.readouterr().out
    assert 'files = "*.tif"' in (folder / "block.toml").read_text()
    # Nothing is made in a folder that is a block already.
    (folder / "a.tif").unlink()
    assert main(["new", str(folder), "--without-pictures", str(table)]) != 0
    assert not (folder / "a.tif").exists()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("scan,columns,rows\na,1000,0\n", "0 pixels are no side"),
        ("scan,columns,rows\na,1000.5,9\n", "1000.5 pixels are no side"),
        ("scan,columns,rows\na,10,10\na.tif,10,10\n", "a stands twice"),
        ("scan,columns\na,10\n", "rows is missing"),
        ("scan,columns,rows\nb,10,10\nthere,10,10\n", "is there already"),
    ],
)
def test_a_list_that_is_wrong_makes_nothing__law(tmp_path: Path, text: str, told: str) -> None:
    table, folder = tmp_path / "sizes.csv", tmp_path / "block"
    folder.mkdir()
    (folder / "there.tif").write_bytes(b"a scan")
    table.write_text(text)
    with pytest.raises(ProjectError, match=told):
        make_stand_ins(folder, table)
    assert [one.name for one in folder.iterdir()] == ["there.tif"]


def test_fiducials_that_were_brought_orient_a_stand_in__truth(folder: Path) -> None:
    found = orient_scan(folder / "a.tif", CAMERA, PIXEL_UM, pixels_of_marks()).masked()
    pixels = found.interior.pixel_from_film(np.array(list(MARKS_MM.values())))
    assert np.allclose(pixels, list(pixels_of_marks().values()), atol=1e-6)
    assert "no-picture" in [doubt.kind for doubt in found.doubts]
    assert found.scan.usable is not None
    assert not found.scan.usable.at(np.array([[500.0, 550.0]])).any()
    assert found.look.size == 0


def test_a_stand_in_without_fiducials_is_refused__truth(folder: Path) -> None:
    with pytest.raises(ScanError, match=r"Only 0 of 4 fiducials were measured.*--from meas"):
        orient_scan(folder / "a.tif", CAMERA, PIXEL_UM)


def test_a_digital_stand_in_needs_none__truth(folder: Path) -> None:
    digital = Camera("sensor", 15.0, (20.0, 22.0), digital=True)
    assert orient_scan(folder / "a.tif", digital, PIXEL_UM).interior.model == "nominal"


def test_a_black_scan_that_is_no_stand_in_is_still_blank__law(folder: Path) -> None:
    black = folder / "black.tif"
    profile = {"mode": "w", "driver": "GTiff", "width": 1000, "height": 1100, "count": 1}
    with open_plain(black, profile | {"dtype": "uint8"}) as dataset:
        dataset.write(np.zeros((1, 1100, 1000), np.uint8))
    with pytest.raises(ScanError, match="blank"):
        orient_scan(black, CAMERA, PIXEL_UM, pixels_of_marks())


def test_photos_without_pictures_have_no_orthos__truth(folder: Path) -> None:
    block = fly(FlightPlan(), np.random.default_rng(1)).block
    first, *others = block.photos.values()
    scans = {first.photo_id: folder / "a.tif"} | {p.photo_id: folder / "b.tif" for p in others}
    empty = with_scans(block, scans)
    assert not has_pictures(empty)
    with pytest.raises(ScanError, match="is a stand-in without picture"):
        pictured(empty)
    shown = folder / "shown.tif"
    profile = {"mode": "w", "driver": "GTiff", "width": 10, "height": 10, "count": 1}
    with open_plain(shown, profile | {"dtype": "uint8"}):
        pass
    mixed = with_scans(block, {**scans, first.photo_id: shown})
    assert has_pictures(mixed)
    assert [photo.photo_id for photo in pictured(mixed)] == [first.photo_id]
