"""What margins tell goes into block.toml where it is accepted, and only there."""

from pathlib import Path

import pytest

from app import margin
from app.margin import ReadScan, accepted_values, margin_reader
from app.new_block import recognise, toml_of
from core.doubts import Failure
from core.errors import ProjectError
from core.scans.margin import FieldName, MarginField
from core.scans.text_reader import TextLine

CORNERS = ((1.0, 2.0), (3.0, 2.0), (3.0, 4.0), (1.0, 4.0))


def read(name: str, **values: str) -> ReadScan:
    kinds: dict[str, FieldName] = {
        "date": "date", "altitude": "altitude", "distance": "distance", "run": "run"
    }  # fmt: skip
    fields = [
        MarginField(kinds[kind], value, TextLine(value, 0.9, CORNERS))
        for kind, value in values.items()
    ]
    return ReadScan(Path(f"{name}.tif"), tuple(fields))


def test_what_all_scans_say_is_accepted__law() -> None:
    scans = [read(name, date="1985-02-10", altitude="2225", distance="152.75") for name in "ab"]
    assert accepted_values(scans) == {
        "camera.principal_distance_mm": 152.75,
        "scans.flying_height_m": 2225.0,
        "scans.taken": "1985-02-10",
    }


def test_what_scans_differ_on_is_not__law() -> None:
    scans = [
        read("a", date="1985-02-10", altitude="2225", distance="152.75"),
        read("b", date="1985-03-01", altitude="4267", distance="182.75"),
    ]
    assert accepted_values(scans) == {
        "scans.override": {"a.tif": "1985-02-10", "b.tif": "1985-03-01"}
    }


def test_one_misread_distance_does_not_count__law() -> None:
    scans = [
        read(name, distance=mm)
        for name, mm in zip("abc", ("152.75", "182.75", "152.75"), strict=True)
    ]
    assert accepted_values(scans) == {"camera.principal_distance_mm": 152.75}


def test_accepted_values_are_written_and_others_are_left_to_fill_in__truth(tmp_path: Path) -> None:
    found = recognise(tmp_path)
    assert "# principal_distance_mm" in toml_of(found)
    text = toml_of(
        found,
        {"camera.principal_distance_mm": 152.75, "scans.override": {"a.tif": "1985-02-10"}},
    )
    assert "\nprincipal_distance_mm = 152.75\n" in text
    assert text.endswith('[[scans.override]]\nfile = "a.tif"\ntaken = "1985-02-10"\n')


def test_fields_name_the_key_they_would_fill_in__law() -> None:
    parts = read("a", date="1985-02-10", run="7").part()
    assert [(part["name"], part["key"]) for part in parts] == [("date", "scans.taken"), ("run", "")]
    assert parts[0]["corners"] == [list(corner) for corner in CORNERS]


def test_without_the_networks_the_remedy_is_told__law(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(margin, "installed_reader", lambda: Failure("Not there."))
    with pytest.raises(ProjectError, match="pip install --no-deps"):
        margin_reader()
