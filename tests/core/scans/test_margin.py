"""What is printed beside a picture is found on every side, and what it tells is proposed."""

from pathlib import Path

import numpy as np
import pytest
import rasterio

from core.raster.scan_file import open_scan
from core.scans.margin import MarginText, fields_of, read_margin
from core.scans.text_reader import TextLine
from tests.core.scans.test_text_reader import reader, strip

TEXT_AT = 84
"""Column of the middle of the text in a strip."""


def told(*texts: str) -> dict[str, list[str]]:
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    lines = tuple(TextLine(text, 0.9, corners) for text in texts)
    found: dict[str, list[str]] = {}
    for field in fields_of([MarginText("left", lines)]):
        found.setdefault(field.name, []).append(field.value)
    return found


@pytest.mark.parametrize(
    ("text", "day"),
    [
        ("24.2.1972", "1972-02-24"), ("1/3/85", "1985-03-01"), ("E.S.T.16-4-93", "1993-04-16"),
        ("15 . 5 . 1961.", "1961-05-15"), ("16 MAY 1938", "1938-05-16"),
        ("FEBRUARY 1985", "1985-02"),
    ],
)  # fmt: skip
def test_days_are_read_as_they_are_written__truth(text: str, day: str) -> None:
    assert told(text) == {"date": [day]}


@pytest.mark.parametrize("text", ["31.2.1972", "1.13.85", "092-103", "KODAK SAFETY FILM", ""])
def test_what_is_no_day_is_none__law(text: str) -> None:
    assert "date" not in told(text)


def test_a_month_gives_way_to_a_day_in_it__law() -> None:
    assert told("10.2.85", "FEBRUARY 1985")["date"] == ["1985-02-10"]
    assert told("10.2.85", "MARCH 1985")["date"] == ["1985-02-10", "1985-03"]


@pytest.mark.parametrize(
    ("text", "metres"),
    [("7,000 ft.", "2134"), ("14,000'", "4267"), ("7300' AMSL", "2225"), ("2225m ASL", "2225")],
)
def test_heights_become_metres__truth(text: str, metres: str) -> None:
    # 1 foot is 0.3048 m.
    assert told(text) == {"altitude": [metres]}


@pytest.mark.parametrize(
    ("text", "distance"),
    [("114.58", "114.58"), ("UAg1003152.44", "152.44"), ("f=211,59", "211.59")],
)
def test_principal_distances_stand_behind_the_number_of_the_lens__truth(
    text: str, distance: str
) -> None:
    assert told(text)["distance"] == [distance]


def test_runs_scales_and_times__truth() -> None:
    assert told("RUN 72C1") == {"run": ["72C1"]}
    assert told("1:10,000") == {"scale": ["10000"]}
    assert told("10:42") == {"time": ["10:42"]}


def test_a_number_lies_in_the_range_of_its_run__law() -> None:
    assert told("030", "3292", "001-056")["number"] == ["030"]
    assert told("8617")["number"] == ["8617"]


def test_what_is_hardly_readable_tells_nothing__law() -> None:
    line = TextLine("24.2.1972", 0.3, ((0.0, 0.0),) * 4)
    assert fields_of([MarginText("left", (line,))]) == ()


def scan_with_print(path: Path, side: str) -> np.ndarray:
    """A scan with a day on one side; column and row of its middle."""
    size, print_ = 900, strip("24.2.1972")[10:70]
    picture = np.random.default_rng(3).normal(120, 15, (size, size)).clip(0, 255)
    picture[-80:] = picture[:, -80:] = 15
    if side == "bottom":
        picture[-70:-10, 300 : 300 + print_.shape[1]] = print_
        place = np.array([300 + TEXT_AT, size - 40])
    else:
        picture[300 : 300 + print_.shape[1], -70:-10] = np.rot90(print_)
        place = np.array([size - 40, 300 + print_.shape[1] - TEXT_AT])
    with rasterio.open(
        path, "w", driver="GTiff", width=size, height=size, count=1, dtype="uint8"
    ) as file:
        file.write(picture.astype(np.uint8), 1)
    return place


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize("side", ["right", "bottom"])
def test_print_is_found_on_its_side__truth(tmp_path: Path, side: str) -> None:
    place = scan_with_print(tmp_path / "0001.tif", side)
    margin = read_margin(open_scan(tmp_path / "0001.tif"), reader())
    fields = fields_of(margin)
    assert [(field.name, field.value) for field in fields] == [("date", "1972-02-24")]
    assert np.hypot(*(np.mean(fields[0].line.corners, axis=0) - place)) < 6
    assert {text.side for text in margin if fields[0].line in text.lines} == {side}
