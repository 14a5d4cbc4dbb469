"""The index of map sheets: names and areas from any vector file, and what cannot be used."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyogrio.raw
import pytest
import shapely
from shapely.geometry import LineString, box

from core.errors import CrsError, ReferenceDataError
from core.geometry.crs import operation_between
from core.sheets.map_sheets import read_sheet_index

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
    with pytest.raises(
        ReferenceDataError, match=r"1 name stands for more than one.*HUST25, hust25"
    ):
        read_sheet_index(path, "EPSG:5514")


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
