"""MicMac's marks: MeasuresCamera.xml (millimetres) and MeasuresIm-SCAN.xml (pixels) (FORMATS 4.3).

Both hold one or more MesureAppuiFlottant1Im, bare or wrapped in SetOfMesureAppuisFlottants. Pixels
count from the centre of the first pixel there, from its outer corner here. The camera's file should
count millimetres from the upper left with y downwards; files that count from the middle with y
upwards, as certificates do, are met too and told apart by their signs.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from defusedxml.ElementTree import fromstring

from core.errors import ScanError
from core.formats.xml_files import write_xml
from core.frames import HALF_PIXEL
from core.said import say

Pair = tuple[float, float]
Places = Mapping[str, Pair]
PREFIX, SUFFIX = "MeasuresIm-", ".xml"


def read_image_measures(path: Path) -> dict[str, dict[str, tuple[float, float]]]:
    """Marks in pixels (column, row; outer corner of the first pixel), by image and by mark.

    Raises:
        ScanError: Missing, no XML, or without marks.
    """
    return {
        image: {name: (x + HALF_PIXEL, y + HALF_PIXEL) for name, (x, y) in marks.items()}
        for image, marks in _read(path).items()
    }


def read_camera_measures(path: Path) -> dict[str, tuple[float, float]]:
    """The camera's marks in the film frame: millimetres from their middle, x right, y up.

    Raises:
        ScanError: Missing, no XML, or without marks.
    """
    marks = next(iter(_read(path).values()))
    origin, factors = _film_frame(marks)
    places = (np.array(list(marks.values())) - np.array(origin)) * np.array(factors)
    return {name: (float(x), float(y)) for name, (x, y) in zip(marks, places, strict=True)}


def film_from_written(path: Path) -> tuple[Pair, Pair]:
    """Origin of the film frame in a camera's file, and the factors of its axes.

    Raises:
        ScanError: Missing, no XML, or without marks.
    """
    return _film_frame(next(iter(_read(path).values())))


def _film_frame(marks: Places) -> tuple[Pair, Pair]:
    """Origin and factors of the axes, by the signs of the marks."""
    places = np.array(list(marks.values()))
    if (places < 0).any():
        return (0.0, 0.0), (1.0, 1.0)
    # The origin is arbitrary there: the middle of the box of marks stands for the centre.
    x, y = (places.min(axis=0) + places.max(axis=0)) / 2
    return (float(x), float(y)), (1.0, -1.0)


def write_image_measures(path: Path, image: str, marks: Places) -> None:
    """Write the marks of one scan (column, row; outer corner of the first pixel).

    Args:
        path: The file, `MeasuresIm-IMAGE.xml` by custom; see `image_measures_name`.
        image: File name of the scan.
        marks: Column and row by mark.
    """
    shifted = {n: (c - HALF_PIXEL, r - HALF_PIXEL) for n, (c, r) in marks.items()}
    _write(path, image, shifted, wrapped=True)


def write_camera_measures(path: Path, marks: Places) -> None:
    """Write the camera's marks: millimetres from the upper left of their box, y downwards."""
    places = np.array(list(marks.values()), dtype=np.float64)
    moved = (places - np.array(corner_of(marks))) * np.array([1.0, -1.0])
    _write(path, "Glob", dict(zip(marks, map(tuple, moved.tolist()), strict=True)), wrapped=False)


def corner_of(marks: Places) -> Pair:
    """Upper left of the box of certified marks, x right, y up."""
    places = np.array(list(marks.values()), dtype=np.float64)
    return float(places[:, 0].min()), float(places[:, 1].max())


def image_measures_name(image: str) -> str:
    """The name MicMac looks for."""
    return f"{PREFIX}{image}{SUFFIX}"


def _read(path: Path) -> dict[str, dict[str, tuple[float, float]]]:
    """Both numbers of every mark as written, by image and mark."""
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise ScanError(
            path,
            say("The marks cannot be read ({strerror}).", strerror=error.strerror),
            "Check the file.",
        ) from error
    try:
        root: ElementTree.Element = fromstring(text, forbid_dtd=True)
        found = {
            _text(one, "NameIm") or path.stem.removeprefix(PREFIX): {
                _text(mark, "NamePt"): _pair(_text(mark, "PtIm"))
                for mark in one.iter("OneMesureAF1I")
            }
            for one in root.iter("MesureAppuiFlottant1Im")
        }
    except (ElementTree.ParseError, ValueError) as error:
        raise ScanError(
            path,
            say("It holds no marks of MicMac ({error}).", error=error),
            "Export MeasuresIm-*.xml or MeasuresCamera.xml again.",
        ) from error
    found = {image: marks for image, marks in found.items() if marks}
    if not found:
        raise ScanError(path, "It holds no marks.", "Measure some in SaisieAppuisInit first.")
    return found


def _text(element: ElementTree.Element, tag: str) -> str:
    """Text of a child, trimmed: samples carry blanks."""
    return (element.findtext(tag) or "").strip()


def _pair(text: str) -> tuple[float, float]:
    """Two numbers."""
    x, y = (float(word) for word in text.split())
    if not np.isfinite([x, y]).all():
        raise ValueError(f"{text} is no place")
    return x, y


def _write(path: Path, image: str, marks: Places, wrapped: bool) -> None:
    """One image's marks, indented as MicMac does."""
    one = ElementTree.Element("MesureAppuiFlottant1Im")
    ElementTree.SubElement(one, "NameIm").text = image
    for name, (x, y) in marks.items():
        mark = ElementTree.SubElement(one, "OneMesureAF1I")
        ElementTree.SubElement(mark, "NamePt").text = name
        ElementTree.SubElement(mark, "PtIm").text = f"{x!r} {y!r}"
    root = one
    if wrapped:
        root = ElementTree.Element("SetOfMesureAppuisFlottants")
        root.append(one)
    write_xml(path, root)
