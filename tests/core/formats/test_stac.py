"""STAC items: the structure that the specification asks for, a published item, round trips."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings

from core.doubts import Failure
from core.errors import CrsError, ProjectError
from core.formats.exchange import ExchangeBlock, pixels_of
from core.formats.stac import EXTENSIONS, read_stac, time_span, write_stac
from tests.exchanged import RECIPES, Recipe, assert_same_geometry, block_of


def items_of(folder: Path) -> list[dict[str, Any]]:
    every = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
    return [one for one in every if one["type"] == "Feature"]


@settings(max_examples=10)
@given(RECIPES)
def test_photos_come_back_whole__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block = block_of(recipe)
    folder = tmp_path_factory.mktemp("stac")
    write_stac(folder, block)
    again = read_stac(folder)
    assert again.crs == block.crs
    assert_same_geometry(block, again)
    for name, photo in block.photos.items():
        other = again.photos[name]
        assert (other.file, other.sigma_centre_m) == (photo.file, photo.sigma_centre_m)
        assert other.sigma_angles == photo.sigma_angles
    for name, camera in again.cameras.items():
        assert camera.principal_point_mm == block.cameras[name].principal_point_mm


@settings(max_examples=10)
@given(RECIPES)
def test_the_plain_fields_alone_show_the_same__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    """Who knows no field of ours has an upright camera turned into the orientation."""
    seed, photos, _, _ = recipe
    block = block_of((seed, photos, 0, False), "upright")
    folder = tmp_path_factory.mktemp("stac")
    write_stac(folder, block)
    for path in folder.glob("1938*.json"):
        item = json.loads(path.read_text())
        fields = item["properties"]
        item["properties"] = {k: v for k, v in fields.items() if not k.startswith("gruber:")}
        path.write_text(json.dumps(item))
    again = read_stac(folder)
    assert_same_geometry(block, again)


@pytest.mark.parametrize(
    ("taken", "first", "last"),
    [("1938-05-16", "1938-05-16", "1938-05-16"), ("1936-02", "1936-02-01", "1936-02-29"),
     ("1938", "1938-01-01", "1938-12-31"), ("", "1858-01-01", "2015-12-31")],
)  # fmt: skip
def test_an_item_spans_the_time_in_which_its_photo_was_taken__truth(
    tmp_path: Path, taken: str, first: str, last: str
) -> None:
    block = block_of((4, 3, 2, True))
    photos = {name: replace(photo, taken=taken) for name, photo in block.photos.items()}
    notes = write_stac(tmp_path, replace(block, photos=photos))
    assert any("span the time of film" in note for note in notes) == (not taken)
    for item in items_of(tmp_path):
        fields = item["properties"]
        assert fields["start_datetime"] == f"{first}T00:00:00Z"
        assert fields["end_datetime"] == f"{last}T23:59:59Z"
    assert {photo.taken for photo in read_stac(tmp_path).photos.values()} == {taken}


@pytest.mark.parametrize("taken", ["1938-13", "16.5.1938", "3000", "1938-05-16-01", "x"])
def test_what_is_no_day_of_film_is_refused__law(taken: str) -> None:
    assert isinstance(time_span(taken), Failure)


def test_items_are_built_as_the_specification_asks__paper(tmp_path: Path) -> None:
    # STAC 1.1.0, item specification: required fields; datetime may be null with a span beside it.
    write_stac(tmp_path, block_of((4, 3, 2, True)))
    items = items_of(tmp_path)
    assert len(items) == 3
    for item in items:
        assert {"type", "stac_version", "id", "geometry", "bbox", "properties", "links",
                "assets"} <= set(item)  # fmt: skip
        fields = item["properties"]
        assert fields["datetime"] is None
        assert fields["start_datetime"] < fields["end_datetime"]
        prefixes = {key.split(":")[0] for key in fields if ":" in key} - {"gruber"}
        assert {EXTENSIONS[prefix] for prefix in prefixes} == set(item["stac_extensions"])
        outline = shapely.Polygon(item["geometry"]["coordinates"][0])
        assert outline.is_valid
        assert outline.exterior.is_ccw
        np.testing.assert_allclose(outline.bounds, item["bbox"])
        west, south, east, north = item["bbox"]
        assert 14 < west < east < 15
        assert 49.9 < south < north < 50.5
        assert 0 <= fields["view:off_nadir"] < 20
        assert len(fields["pers:rotation_matrix"]) == 9
        assert item["assets"]["scan"]["href"].endswith(".tif")
    catalog = json.loads((tmp_path / "catalog.json").read_text())
    assert {"type", "stac_version", "id", "description", "links"} <= set(catalog)
    hrefs = {link["href"] for link in catalog["links"] if link["rel"] == "item"}
    assert hrefs == {f"./{item['id']}.json" for item in items}


DANISH: dict[str, Any] = {
    "type": "Feature", "stac_version": "1.0.0", "id": "2019_83_36_5_0028_00000842",
    "assets": {"data": {"href": "https://example.com/2019_83_36_5_0028_00000842.tif"}},
    "properties": {
        "pers:omega": 1.08745, "pers:phi": 44.6841, "pers:kappa": 89.2089,
        "pers:perspective_center": [593092.69, 6140947.58, 1510.24], "pers:crs": 25832,
        "pers:rotation_matrix": [
            0.00981716190118791, 0.999908851350567, 0.00926889006272609, -0.710926523207453,
            0.000460826228438361, 0.703266141826372, 0.703197768719703, -0.0134935773602192,
            0.710866247220709,
        ],
        "pers:interior_orientation": {
            "camera_id": "PhaseOne-IXU-RS-1000_RS011019", "focal_length": 108.3599,
            "pixel_spacing": [0.0046, 0.0046], "principal_point_offset": [0.0, 0.0],
            "sensor_array_dimensions": [11478.0, 8578.0],
        },
    },
}  # fmt: skip
"""An item of the Danish oblique photos (SDFI), as published."""


def test_a_published_item_turns_as_its_matrix_does__real(tmp_path: Path) -> None:
    path = tmp_path / "item.json"
    path.write_text(json.dumps(DANISH))
    block = read_stac(path)
    assert block.crs == "EPSG:25832"
    photo = block.photos["2019_83_36_5_0028_00000842"]
    matrix = np.array(DANISH["properties"]["pers:rotation_matrix"]).reshape(3, 3)
    # Angles are given to 1e-5 degrees and more.
    np.testing.assert_allclose(photo.orientation.object_from_image.T, matrix, atol=2e-6)
    assert photo.interior[0, 2] == 11478 / 2
    # The camera looks west: the middle of the picture lies west of where it was taken.
    below = photo.orientation.centre + photo.orientation.object_from_image @ [0, 0, -2000.0]
    assert below[0] < photo.orientation.centre[0] - 1000
    pixel = pixels_of(below[None], photo, block.camera_of(photo.photo_id))[0]
    np.testing.assert_allclose(pixel, [5739, 4289], atol=1e-6)


def test_the_size_of_a_scan_that_is_there_is_told__truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    block = block_of((4, 1, 0, False))
    (tmp_path / "1938_000.tif").write_bytes(b"1234567")
    write_stac(tmp_path / "out", block)
    (item,) = items_of(tmp_path / "out")
    assert item["assets"]["scan"]["file:size"] == 7
    assert EXTENSIONS["file"] in item["stac_extensions"]


def test_a_photo_that_is_not_oriented_lies_nowhere__truth(tmp_path: Path) -> None:
    block = block_of((4, 1, 0, False))
    name, photo = next(iter(block.photos.items()))
    write_stac(tmp_path, replace(block, photos={name: replace(photo, exterior=None)}))
    (item,) = items_of(tmp_path)
    assert item["geometry"] is None
    assert "bbox" not in item
    assert read_stac(tmp_path).photos[name].exterior is None


def changed(**fields: Any) -> str:
    return json.dumps({**DANISH, "properties": {**DANISH["properties"], **fields}})


@pytest.mark.parametrize(
    ("text", "words"),
    [("{", "is no JSON"), ("[]", "is no STAC item"), ('{"type": "Feature"}', "is no STAC item"),
     ('{"type": "Catalog"}', "holds no STAC item"),
     (changed(**{"pers:omega": None}), "pers:omega is 'None', not 1 number"),
     (changed(**{"pers:perspective_center": [1, 2]}), "not 3 numbers"),
     (changed(**{"pers:kappa": float("nan")}), "pers:kappa is 'nan', not 1"),
     (changed(**{"pers:interior_orientation": {"camera_id": "a"}}), "focal_length is 'None'"),
     (json.dumps({"type": "FeatureCollection", "features": [DANISH, DANISH]}), "stands twice"),
     (json.dumps({"type": "FeatureCollection", "features": [
         DANISH, {**json.loads(changed(**{"pers:crs": 5514})), "id": "b"}]}),
      "EPSG:5514, other items are in EPSG:25832")],
)  # fmt: skip
def test_broken_items_are_named__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "item.json"
    path.write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_stac(path)


def test_files_beside_items_are_passed_over__truth(tmp_path: Path) -> None:
    for name, text in (("a", "{"), ("b", '{"type": "FeatureCollection", "features": [{}]}')):
        (tmp_path / f"{name}.json").write_text(text)
    with pytest.raises(ProjectError, match="holds no STAC item") as told:
        read_stac(tmp_path)
    assert told.value.file == str(tmp_path)
    plain = {**DANISH, "properties": {"datetime": None}}
    (tmp_path / "c.json").write_text(json.dumps(plain))
    with pytest.raises(ProjectError, match="of a photo with its orientation"):
        read_stac(tmp_path)
    (tmp_path / "c.json").write_text(json.dumps(DANISH))
    assert len(read_stac(tmp_path).photos) == 1
    (tmp_path / "d.json").write_text(json.dumps(DANISH)[:-9])
    with pytest.raises(ProjectError, match="is no JSON") as told:
        read_stac(tmp_path)
    assert told.value.file.endswith("d.json")


def test_a_block_without_crs_is_nowhere__truth(tmp_path: Path) -> None:
    with pytest.raises(CrsError, match="no CRS"):
        write_stac(tmp_path, ExchangeBlock())
