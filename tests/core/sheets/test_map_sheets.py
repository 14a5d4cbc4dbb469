"""The index of map sheets: names and areas from any vector file, and what cannot be used."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyogrio.raw
import pytest
import shapely
from pyproj import Transformer
from shapely.geometry import LineString, box

from core.errors import CrsError, ReferenceDataError
from core.geometry.crs import operation_between
from core.sheets.map_sheets import (
    SM50_CORNERS,
    file_stem,
    read_sheet_index,
    state_map_bounds,
    state_map_name,
    state_map_sheets,
)

AREAS = [
    box(-582_500, -1_192_000, -580_000, -1_190_000),
    box(-580_000, -1_192_000, -577_500, -1_190_000),
]


def write(
    path: Path,
    areas: Sequence[shapely.Geometry],
    crs: str | None = "EPSG:5514",
    layer: str = "index",
    **fields: Sequence[str | None],
) -> Path:
    pyogrio.raw.write(
        path,
        geometry=np.array(shapely.to_wkb(areas), dtype=object),
        field_data=[np.array(values, dtype=object) for values in fields.values()],
        fields=np.array(list(fields), dtype=object),
        geometry_type=areas[0].geom_type,
        crs=crs,
        layer=layer,
        append=path.exists(),
        promote_to_multi=False,
    )
    return path


def test_an_index_is_read_in_the_order_of_names__truth(tmp_path: Path) -> None:
    path = write(tmp_path / "i.gpkg", AREAS, name=["HUST25", "HUST15"])
    sheets = read_sheet_index(path, "EPSG:5514")
    assert [sheet.name for sheet in sheets] == ["HUST15", "HUST25"]
    assert sheets[1].area.equals(AREAS[0])


def test_an_index_in_another_system_is_transformed__oracle(tmp_path: Path) -> None:
    """PROJ moves it there; it comes back to a millimetre."""
    corners = shapely.get_coordinates(AREAS[0])
    there = operation_between("EPSG:5514", "EPSG:32633", corners, "here")
    moved = [shapely.transform(area, there.forward) for area in AREAS]
    path = write(tmp_path / "i.gpkg", moved, "EPSG:32633", name=["a", "b"])
    sheets = read_sheet_index(path, "EPSG:5514")
    apart = shapely.get_coordinates(sheets[0].area) - shapely.get_coordinates(AREAS[0])
    assert np.abs(apart).max() < 1e-3


def test_an_index_of_another_country_is_refused__truth(tmp_path: Path) -> None:
    path = write(tmp_path / "i.gpkg", [box(575_000, 1_180_000, 577_500, 1_182_000)], name=["a"])
    with pytest.raises(CrsError, match="both coordinates are positive"):
        read_sheet_index(path, "EPSG:5514")


def test_sheets_without_a_name_are_counted__truth(tmp_path: Path) -> None:
    path = write(tmp_path / "i.gpkg", AREAS, name=[None, " "])
    with pytest.raises(ReferenceDataError, match="2 of its 2 sheets have no `name`"):
        read_sheet_index(path, "EPSG:5514")


def test_names_that_stand_twice_are_told__truth(tmp_path: Path) -> None:
    """Upper and lower case are one file on many disks."""
    path = write(tmp_path / "i.gpkg", AREAS, name=["HUST25", "hust25"])
    with pytest.raises(ReferenceDataError, match=r"names are alike: HUST25, hust25"):
        read_sheet_index(path, "EPSG:5514")


def test_names_that_are_one_as_files_are_told_as_they_stand__truth(tmp_path: Path) -> None:
    path = write(tmp_path / "i.gpkg", AREAS, name=["a/b", "a:b"])
    with pytest.raises(ReferenceDataError, match=r"names are alike: a/b, a:b"):
        read_sheet_index(path, "EPSG:5514")


def test_other_scripts_stay_in_names_of_files__truth(tmp_path: Path) -> None:
    path = write(tmp_path / "i.gpkg", AREAS, name=["Вовча", "Новий лист"])
    found = read_sheet_index(path, "EPSG:5514")
    assert [file_stem(sheet.name) for sheet in found] == ["Вовча", "Новий_лист"]
    assert file_stem("Hustopec\u030ce 2-5") == "Hustopece_2-5"


def test_an_index_without_the_attribute_tells_what_it_has__truth(tmp_path: Path) -> None:
    path = write(tmp_path / "i.gpkg", AREAS, nazev=["a", "b"])
    with pytest.raises(ReferenceDataError, match="no attribute `name`, only nazev"):
        read_sheet_index(path, "EPSG:5514")


def test_lines_are_no_sheets__truth(tmp_path: Path) -> None:
    line = LineString([(-582_500, -1_192_000), (-580_000, -1_190_000)])
    path = write(tmp_path / "i.gpkg", [line], name=["a"])
    with pytest.raises(ReferenceDataError, match="no layer of polygons"):
        read_sheet_index(path, "EPSG:5514")


def test_one_of_several_layers_is_chosen_by_its_name__truth(tmp_path: Path) -> None:
    path = write(tmp_path / "i.gpkg", AREAS[:1], layer="sm5", name=["HUST25"])
    write(path, AREAS[1:], layer="other", name=["HUST15"])
    with pytest.raises(ReferenceDataError, match=r"2 of its layers may be the index: .*layername="):
        read_sheet_index(path, "EPSG:5514")
    (one,) = read_sheet_index(Path(f"{path}|layername=sm5"), "EPSG:5514")
    assert one.name == "HUST25"


UHERSKY_BROD = {"UBRO": (-500_000.0, -1_180_000.0)}
HUST25 = (-582_500.0, -1_192_000.0, -580_000.0, -1_190_000.0)


def rows(shared_data: Path) -> list[dict[str, str]]:
    with (shared_data / "sm5/sheets.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_sheets_of_the_agency_are_met_to_the_metre__real(shared_data: Path) -> None:
    given = rows(shared_data)
    assert len(given) == 13
    for row in given:
        west, south, east, north = (float(row[side]) for side in ("west", "south", "east", "north"))
        assert state_map_bounds(row["sheet"], SM50_CORNERS) == (west, south, east, north)
        inside = ((west + east) / 2, (south + north) / 2)
        assert state_map_name(*inside, SM50_CORNERS) == row["sheet"]


@pytest.mark.parametrize(
    ("east", "north", "sheet"),
    [(-575_002.24, -1_199_392.47, "HUST09"), (-519_299.16, -1_187_895.61, "UBRO73")],
)
def test_published_points_lie_in_the_sheets_they_are_named_by__paper(
    east: float, north: float, sheet: str
) -> None:
    """Hustopeče 0-9 and Uherský Brod 7-3: the signalled points of the agency's technical report."""
    corners = {**SM50_CORNERS, **UHERSKY_BROD}
    assert state_map_name(east, north, corners) == sheet
    west, south, end, top = state_map_bounds(sheet, corners)
    assert west <= east <= end
    assert south <= north <= top


def test_a_hundred_sheets_fill_a_sheet_of_the_map_1_50_000__law() -> None:
    whole = box(-600_000, -1_200_000, -575_000, -1_180_000)
    sheets = state_map_sheets(whole, "EPSG:5514", {}, "block.toml")
    assert [sheet.name for sheet in sheets] == [f"HUST{number:02d}" for number in range(100)]
    assert sum(sheet.area.area for sheet in sheets) == whole.area
    assert shapely.unary_union([sheet.area for sheet in sheets]).equals(whole)


def test_only_sheets_that_share_ground_are_named__truth() -> None:
    shown = box(-582_400, -1_191_900, -580_000, -1_190_000)
    (one,) = state_map_sheets(shown, "EPSG:5514", {}, "block.toml")
    assert (one.name, one.area.bounds) == ("HUST25", HUST25)


def test_a_block_of_another_system_gets_the_same_sheets__oracle() -> None:
    """Corners as PROJ moves them."""
    there = Transformer.from_crs(5514, 32633, always_xy=True)
    ring = np.column_stack(there.transform(*np.array(box(*HUST25).exterior.coords).T))
    inner = shapely.Polygon(ring).buffer(-20)
    (one,) = state_map_sheets(inner, "EPSG:32633", {}, "block.toml")
    assert one.name == "HUST25"
    corners = shapely.get_coordinates(one.area)
    # Two operations of PROJ between the systems differ by metres; the rule may take either.
    distances = np.hypot(*(corners[:, None] - ring[None]).T)
    assert distances.min(axis=0).max() < 3


def test_letters_nobody_knows_are_asked_for__truth() -> None:
    shown = box(-519_400, -1_187_900, -519_200, -1_187_800)
    with pytest.raises(ReferenceDataError, match=r"north-east corner at \[-500000, -1180000\]"):
        state_map_sheets(shown, "EPSG:5514", {}, "block.toml")
    (one,) = state_map_sheets(shown, "EPSG:5514", UHERSKY_BROD, "block.toml")
    assert one.name == "UBRO73"


@pytest.mark.parametrize(
    ("letters", "corner", "cause"),
    [
        ("Hust", (-575_000.0, -1_180_000.0), "no code of a sheet"),
        ("HUSTO", (-575_000.0, -1_180_000.0), "no code of a sheet"),
        ("ABCD", (-575_100.0, -1_180_000.0), "cannot have its north-east corner"),
        ("ABCD", (575_000.0, 1_180_000.0), "cannot have its north-east corner"),
    ],
)
def test_corners_that_cannot_be_are_refused__truth(
    letters: str, corner: tuple[float, float], cause: str
) -> None:
    with pytest.raises(ReferenceDataError, match=cause):
        state_map_sheets(box(*HUST25), "EPSG:5514", {letters: corner}, "block.toml")


def test_a_block_elsewhere_on_earth_is_told_so__truth() -> None:
    with pytest.raises(CrsError, match="is one of Czechia and Slovakia"):
        state_map_sheets(box(500_000, 4_000_000, 501_000, 4_001_000), "EPSG:32618", {}, "b.toml")
