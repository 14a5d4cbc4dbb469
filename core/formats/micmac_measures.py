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

from core.errors import ExchangeError
from core.formats.exchange import Pair
from core.formats.xml_files import add, digits, numbers_of, read_xml, text_of, trimmed, write_xml
from core.frames import HALF_PIXEL

Places = Mapping[str, Pair]
PREFIX, SUFFIX = "MeasuresIm-", ".xml"


def read_image_measures(path: Path) -> dict[str, dict[str, Pair]]:
    """Marks in pixels (column, row; outer corner of the first pixel), by image and by mark.

    Raises:
        ExchangeError: Missing, no XML, or without marks.
    """
    return {
        image: {name: (x + HALF_PIXEL, y + HALF_PIXEL) for name, (x, y) in marks.items()}
        for image, marks in _read(path).items()
    }


def read_camera_measures(path: Path) -> dict[str, Pair]:
    """The camera's marks in the film frame: millimetres from their middle, x right, y up.

    Raises:
        ExchangeError: Missing, no XML, or without marks.
    """
    marks = next(iter(_read(path).values()))
    origin, factors = _film_frame(marks)
    places = (np.array(list(marks.values())) - np.array(origin)) * np.array(factors)
    return {name: (float(x), float(y)) for name, (x, y) in zip(marks, places, strict=True)}


def film_from_written(path: Path) -> tuple[Pair, Pair]:
    """Origin of the film frame in a camera's file, and the factors of its axes.

    Raises:
        ExchangeError: Missing, no XML, or without marks.
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


def _read(path: Path) -> dict[str, dict[str, Pair]]:
    """Both numbers of every mark as written, by image and mark."""
    found: dict[str, dict[str, Pair]] = {}
    for one in read_xml(path).iter("MesureAppuiFlottant1Im"):
        image = trimmed(one.find("NameIm")) or path.stem.removeprefix(PREFIX)
        for mark in one.iter("OneMesureAF1I"):
            x, y = numbers_of(mark, "PtIm", 2, path)
            found.setdefault(image, {})[text_of(mark, "NamePt", path)] = (x, y)
    if not found:
        raise ExchangeError(path, "It holds no marks.", "Measure some in SaisieAppuisInit first.")
    return found


def _write(path: Path, image: str, marks: Places, wrapped: bool) -> None:
    """One image's marks, indented as MicMac does."""
    one = ElementTree.Element("MesureAppuiFlottant1Im")
    add(one, "NameIm", image)
    for name, place in marks.items():
        mark = add(one, "OneMesureAF1I")
        add(mark, "NamePt", name)
        add(mark, "PtIm", digits(place))
    root = one
    if wrapped:
        root = ElementTree.Element("SetOfMesureAppuisFlottants")
        root.append(one)
    write_xml(path, root)
