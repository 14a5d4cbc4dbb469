"""The delivery as a whole: what is made, what stays, what is written beside it."""

import json
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from shapely.geometry import box

from core.errors import ProjectError, ReferenceDataError
from core.mosaic.seams import Seam
from core.progress import SILENT
from core.sheets.delivery import Delivery, SheetFile
from core.sheets.map_sheets import MapSheet
from core.sheets.stage import SheetOptions, cut_sheets
from tests.core.sheets.test_cutting import AROUND_A_CORNER, scene

SHEETS = tuple(MapSheet(name, area) for name, area in sorted(AROUND_A_CORNER.items()))
SEAMS = (
    Seam("1938_01", "", box(-582e3, -1_193e3, -580_100, -1_187e3)),
    Seam("1938_02", "", box(-580_100, -1_193e3, -577e3, -1_187e3)),
)
TAKEN = {"1938_01": "1938-05-16", "1938_02": "1938-06"}


class Kept:
    """Files in a folder, entries in memory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.entries: dict[tuple[str, str], SheetFile] = {}

    def kept(self, file: str, made_from: tuple[Any, ...]) -> SheetFile | None:
        return self.entries.get((file, repr(made_from)))

    @contextmanager
    def making(self, file: str) -> Generator[Path]:
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        yield path

    @contextmanager
    def making_folder(self, folder: str) -> Generator[Path]:
        (self.folder / folder).mkdir(parents=True, exist_ok=True)
        yield self.folder / folder

    def keep(self, made_from: tuple[Any, ...], entry: SheetFile) -> SheetFile:
        beside = (self.folder / entry.file).with_suffix(f".{entry.file[-3]}{entry.file[-1]}w")
        world = beside.relative_to(self.folder).as_posix()
        entry = replace(entry, companions=(world,))
        self.entries[entry.file, repr(made_from)] = entry
        return entry


def deliver(
    mosaic: Path, keeper: Kept, sheets: tuple[MapSheet, ...] = SHEETS, **options: Any
) -> Delivery:
    return cut_sheets(
        mosaic, SEAMS, sheets, keeper.folder, options=SheetOptions(taken=TAKEN, **options),
        keeper=keeper, where="index.gpkg", progress=SILENT,
    )  # fmt: skip


@pytest.fixture
def mosaic(tmp_path: Path) -> Path:
    return scene(tmp_path / "m.tif", 2.0, side=600)


def test_only_sheets_whose_pixels_changed_are_made_again__truth(
    mosaic: Path, tmp_path: Path
) -> None:
    keeper = Kept(tmp_path / "sheets")
    first = deliver(mosaic, keeper)
    assert (first.made, first.sheets) == (4, tuple(sorted(AROUND_A_CORNER)))
    assert deliver(mosaic, keeper).made == 0
    with rasterio.open(mosaic, "r+") as file:
        row, column = file.index(-579_500, -1_190_300)
        patch = np.full((1, 3, 3), 7, np.uint8)
        file.write(patch, window=((row, row + 3), (column, column + 3)))
    again = deliver(mosaic, keeper)
    assert again.made == 1
    sums = {one.name: one.sha256 for one in first.files}
    assert [one.name for one in again.files if one.sha256 != sums[one.name]] == ["HUST15"]


def test_names_are_those_of_the_agency__paper(mosaic: Path, tmp_path: Path) -> None:
    """PPPPHH.RRRR.MMMMLL: product, bits of a pixel, year, sheet."""
    delivery = deliver(
        mosaic, Kept(tmp_path / "s"), product="ORTO", formats=("geotiff", "jp2", "cog")
    )
    files = [one.file for one in delivery.files if one.name == "HUST25"]
    name = "ORTO08.1938.HUST25"
    assert files == [f"{name}.tif", f"{name}.jp2", f"cog/{name}.tif"]
    assert all((tmp_path / "s" / file).is_file() for file in files)


def test_a_name_needs_a_year__truth(mosaic: Path, tmp_path: Path) -> None:
    options = SheetOptions(product="ORTO")
    with pytest.raises(ProjectError, match="need a year, and no photo of HUST14"):
        cut_sheets(
            mosaic, SEAMS, SHEETS, tmp_path, options=options, keeper=Kept(tmp_path / "s"),
            where="i", progress=SILENT,
        )  # fmt: skip
    delivery = deliver(mosaic, Kept(tmp_path / "s"), product="ORTO", year=1952)
    assert delivery.files[0].file == "ORTO08.1952.HUST14.tif"


def test_sheets_without_ground_are_left_out__truth(mosaic: Path, tmp_path: Path) -> None:
    far = MapSheet("HUST99", box(-600_000, -1_200_000, -597_500, -1_198_000))
    west, north = -580_000 - 0.55 * 600 * 2, -1_190_000 + 0.45 * 600 * 2
    unseen = MapSheet("unseen", box(west, north - 200, west + 250, north))
    delivery = deliver(mosaic, Kept(tmp_path / "s"), (*SHEETS, far, unseen))
    assert delivery.outside == 2
    assert "unseen" not in delivery.sheets
    with pytest.raises(ReferenceDataError, match="shows none of its 1 sheet"):
        deliver(mosaic, Kept(tmp_path / "t"), (far,))


def test_accents_and_spaces_do_not_come_into_names_of_files__truth(
    mosaic: Path, tmp_path: Path
) -> None:
    sheet = MapSheet("Hustopeče 2-5", AROUND_A_CORNER["HUST25"])
    (one,) = deliver(mosaic, Kept(tmp_path / "s"), (sheet,)).files
    assert (one.file, one.name) == ("Hustopece_2-5.tif", "Hustopeče 2-5")


def test_names_that_are_one_on_disk_are_refused__truth(mosaic: Path, tmp_path: Path) -> None:
    twins = (MapSheet("a/b", SHEETS[0].area), MapSheet("a b", SHEETS[1].area))
    with pytest.raises(ReferenceDataError, match="names are alike: a_b, a_b"):
        deliver(mosaic, Kept(tmp_path / "s"), twins)


def test_index_map_and_check_sums_tell_of_the_files__oracle(mosaic: Path, tmp_path: Path) -> None:
    """GDAL reads the index, coreutils the sums."""
    folder = tmp_path / "s"
    delivery = deliver(mosaic, Kept(folder), crs=("EPSG:5513",))
    info, _, wkb, values = pyogrio.raw.read(folder / "index.gpkg")
    table = dict(zip(info["fields"], values, strict=True))
    assert list(table["file"][:2]) == ["HUST14.tif", "EPSG-5513/HUST14.tif"]
    photos = dict(zip(table["name"], table["photos"], strict=True))
    assert (photos["HUST14"], photos["HUST24"]) == ("1938_02", "1938_01, 1938_02")
    dates = dict(zip(table["name"], table["dates"], strict=True))
    assert (dates["HUST14"], dates["HUST24"]) == ("1938-06", "1938-05-16, 1938-06")
    shown = dict(zip(table["file"], table["covered"], strict=True))
    with rasterio.open(folder / "HUST15.tif") as file:
        assert shown["HUST15.tif"] == np.count_nonzero(file.read(1)) / file.width / file.height
    assert shapely.from_wkb(wkb[0]).equals(AROUND_A_CORNER["HUST14"])
    assert list(table["sha256"]) == [one.sha256 for one in delivery.files]
    checked = subprocess.run(
        ["sha256sum", "-c", "sha256.txt"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
    lines = checked.stdout.splitlines()
    assert len(lines) == 8 * 2 + 1 + 5, "rasters with world files, index, items with catalogue"


def test_items_lead_to_the_files__truth(mosaic: Path, tmp_path: Path) -> None:
    folder = tmp_path / "s"
    delivery = deliver(mosaic, Kept(folder), formats=("geotiff", "jp2"), product="ORTO")
    catalog = json.loads((folder / "stac/catalog.json").read_text())
    links = [link["href"] for link in catalog["links"] if link["rel"] == "item"]
    assert links == [f"./ORTO08.1938.{name}.json" for name in delivery.sheets]
    item = json.loads((folder / "stac" / links[-1]).read_text())
    assert item["properties"]["start_datetime"] == "1938-05-16T00:00:00Z"
    assert item["properties"]["end_datetime"] == "1938-06-30T23:59:59Z"
    west, south, east, north = item["bbox"]
    assert 16 < west < east < 18
    assert 48 < south < north < 50
    for asset in item["assets"].values():
        path = folder / "stac" / asset["href"]
        assert path.stat().st_size == asset["file:size"]
        with rasterio.open(path) as file:
            assert [file.height, file.width] == asset["proj:shape"]
            assert list(file.transform)[:6] == asset["proj:transform"]
            assert f"EPSG:{file.crs.to_epsg()}" == asset["proj:code"]
