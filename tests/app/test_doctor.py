"""What a machine and a block lack, in plain words."""

import shutil
from types import SimpleNamespace

import pytest

from app.cli import DONE, main
from app.verbs import doctor
from app.verbs.doctor import examine
from core.errors import PhotogrammetryError
from tests.app.test_block_input import own_toml


def test_a_machine_is_examined_without_a_block__truth():
    said = list(examine(None))
    assert said[0].startswith("GDAL ")
    assert any(line.lstrip("! ").startswith("Memory") for line in said)
    assert not any("no driver" in line or "no vector driver" in line for line in said)


def test_a_block_is_examined_too__truth(tiny_block):
    text = "\n".join(examine(tiny_block))
    assert "6 scans, EPSG:5514" in text
    assert "ortho 0.8 m, DEM 5 m" in text
    assert "road" not in text
    assert "fiducials" not in text


def test_left_out_the_block_is_that_of_the_current_folder__truth(
    tiny_block, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["doctor"]) == DONE
    told = capsys.readouterr().out
    assert "Disk: " in told
    assert "Block " not in told
    monkeypatch.chdir(tiny_block)
    assert main(["doctor"]) == DONE
    told = capsys.readouterr().out
    assert "6 scans, EPSG:5514" in told
    assert "Disk: " in told


def test_what_a_block_lacks_is_told__truth(tiny_block, tmp_path):
    folder = own_toml(tiny_block, tmp_path)
    lines = (folder / "block.toml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith(("roads", "fiducials_mm"))]
    (folder / "block.toml").write_text("\n".join(kept))
    said = list(examine(folder))
    assert any("No road layers" in line for line in said)
    assert any(line.startswith("! ") and "fiducials" in line for line in said)


def test_a_full_disk_a_small_memory_and_no_browser_need_attention__truth(tiny_block, monkeypatch):
    usage = type(shutil.disk_usage("/"))(10**9, 10**9, 10**6)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda path: usage)
    monkeypatch.setattr(doctor.shutil, "which", lambda name: None)
    memory = SimpleNamespace(total=2 * 1024**3)
    monkeypatch.setattr(doctor.psutil, "virtual_memory", lambda: memory)
    grave = [line for line in examine(tiny_block) if line.startswith("! ")]
    for word in ("Disk: 0.0 GiB", "Memory: 2 GiB", "No browser"):
        assert any(word in line for line in grave), word


def test_missing_drivers_are_told_with_their_use__truth(monkeypatch):
    class Bare:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def drivers(self):
            return {"GTiff": "GeoTIFF"}

    monkeypatch.setattr(doctor.rasterio, "Env", Bare)
    monkeypatch.setattr(doctor.pyogrio, "list_drivers", lambda: {"GPKG": "rw"})
    text = "\n".join(doctor.drivers())
    assert "JP2OpenJPEG (JPEG 2000)" in text
    assert "ESRI Shapefile" in text
    assert "GTiff" not in text


def test_no_block_is_an_error_that_says_so__truth(tmp_path):
    with pytest.raises(PhotogrammetryError, match=r"block\.toml"):
        list(examine(tmp_path))
