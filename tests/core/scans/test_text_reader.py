"""Print drawn by OpenCV is read, however the picture is turned."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from core.doubts import Failure
from core.errors import ProjectError
from core.scans import text_reader
from core.scans.text_reader import TextReader, characters_of, installed_reader


def reader() -> TextReader:
    found = installed_reader()
    assert isinstance(found, TextReader)
    return found


def strip(*texts: str) -> np.ndarray:
    """White print on black film, one text after the other."""
    picture = np.full((80, 260 * len(texts)), 20, np.uint8)
    for k, text in enumerate(texts):
        cv2.putText(
            picture, text, (20 + 260 * k, 50), cv2.FONT_HERSHEY_SIMPLEX, 0.9, 230, 2, cv2.LINE_AA
        )
    return picture.astype(np.float32)


@pytest.mark.parametrize("half_turns", [0, 1])
def test_print_is_read_where_it_stands__truth(half_turns: int) -> None:
    picture = np.ascontiguousarray(np.rot90(strip("RUN 12", "24.2.1972"), 2 * half_turns))
    lines = {line.text.replace(" ", ""): line for line in reader().lines(picture)}
    assert set(lines) == {"RUN12", "24.2.1972"}
    for text, line in lines.items():
        assert line.probability > 0.8
        column, row = np.mean(line.corners, axis=0)
        first = (text == "RUN12") != bool(half_turns)
        assert (column < picture.shape[1] / 2) == first
        assert abs(row - picture.shape[0] / 2) < 10
        # Clockwise from where the text begins.
        assert (line.corners[1][0] > line.corners[0][0]) != bool(half_turns)


def test_film_without_print_says_nothing__truth() -> None:
    grain = np.random.default_rng(5).normal(40, 6, (96, 512)).astype(np.float32)
    assert reader().lines(grain) == []


def test_what_the_recogniser_knows_stands_in_its_file__law() -> None:
    known = characters_of(reader().recogniser)
    assert known[0] == ""
    assert known[-1] == " "
    assert set("0123456789ABCxyz.,:'/-") <= set(known)


def test_a_file_without_characters_is_named__law(tmp_path: Path) -> None:
    (tmp_path / "empty.onnx").write_bytes(b"")
    with pytest.raises(ProjectError, match=r"empty\.onnx"):
        characters_of(tmp_path / "empty.onnx")


def test_a_missing_package_is_told__law(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_reader, "PACKAGE", "no_such_package")
    assert isinstance(installed_reader(), Failure)
