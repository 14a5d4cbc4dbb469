"""MicMac's surveyed points, their measurements (S2D), and fiducials (FORMATS 4.1 to 4.3).

Pixels count from the centre of the first pixel there, from its outer corner here. `1 1 1` as
standard deviations is what MicMac writes where nobody said any, and is read as none.

Both hold one or more MesureAppuiFlottant1Im, bare or wrapped in SetOfMesureAppuisFlottants. Pixels
count from the centre of the first pixel there, from its outer corner here. The camera's file should
count millimetres from the upper left with y downwards; files that count from the middle with y
upwards, as certificates do, are met too and told apart by their signs.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Literal

import numpy as np

from core.errors import ExchangeError
from core.formats.exchange import ExchangeMeasurement, ExchangePoint, Pair, Triple
from core.formats.records import read_text
from core.formats.xml_files import (
    AGAIN,
    add,
    digits,
    number_of,
    numbers_in,
    numbers_of,
    read_xml,
    text_of,
    trimmed,
    write_xml,
)
from core.frames import HALF_PIXEL

POINTS, MEASURES, IMAGE = (
    "DicoAppuisFlottant",
    "SetOfMesureAppuisFlottants",
    "MesureAppuiFlottant1Im",
)
# source: what MicMac's own files hold.
UNSAID: Triple = (1.0, 1.0, 1.0)
"""What MicMac writes where nobody said a standard deviation."""
HEAD = "#F="
"""How the first line of a text of points begins."""
PLACE, SPREAD = ("X", "Y", "Z"), ("Ix", "Iy", "Iz")

Places = Mapping[str, Pair]
PREFIX, SUFFIX = "MeasuresIm-", ".xml"


def read_points_xml(path: Path) -> dict[str, ExchangePoint]:
    """Surveyed points of a DicoAppuisFlottant; those of a file named `...check...` are check.

    Raises:
        ExchangeError: Damaged, a point without name or place, or two of one name.
    """
    found: list[ExchangePoint] = []
    for one in read_xml(path, POINTS, "Global").iter("OneAppuisDAF"):
        sigma = None
        if one.find("Incertitude") is not None:
            sigma = sigma_or_none(numbers_of(one, "Incertitude", 3, path))
        x, y, z = numbers_of(one, "Pt", 3, path)
        found.append(ExchangePoint(text_of(one, "NamePt", path), (x, y, z), sigma, _role(path)))
    return by_name(path, found)


def read_points_text(path: Path) -> dict[str, ExchangePoint]:
    """Surveyed points of a text whose first line is such as `#F= N X Y Z Ix Iy Iz`.

    Raises:
        ExchangeError: No such first line, a row that does not fit it, or two points of one name.
    """
    lines = read_text(path).splitlines()
    head = lines[0].strip() if lines else ""
    columns = head.replace(HEAD, "").split()
    if not head.startswith(HEAD) or not {"N", *PLACE} <= set(columns):
        raise ExchangeError(
            path,
            "Its first line does not say what its columns are.",
            "Begin it with a line such as #F= N X Y Z.",
        )
    return by_name(path, _rows(path, lines[1:], columns))


def _rows(path: Path, lines: list[str], columns: list[str]) -> Iterator[ExchangePoint]:
    """A point for each row."""
    for number, line in enumerate(lines, start=2):
        row = line.split()
        if not row or row[0].startswith("#"):
            continue
        if len(row) < len(columns):
            raise ExchangeError(
                path,
                "Line {number} has {found} of {wanted} columns.",
                "Give every point all columns of the first line.",
                number=number,
                found=len(row),
                wanted=len(columns),
            )
        cells = dict(zip(columns, row, strict=False))
        where = f"{path}:{number}"
        x, y, z = numbers_in(" ".join(cells[n] for n in PLACE), 3, "X Y Z", Path(where))
        sigma = None
        if set(SPREAD) <= set(cells):
            written = " ".join(cells[name] for name in SPREAD)
            sigma = sigma_or_none(numbers_in(written, 3, "Ix Iy Iz", Path(where)))
        yield ExchangePoint(cells["N"], (x, y, z), sigma, _role(path))


def _role(path: Path) -> Literal["control", "check"]:
    """MicMac has no roles; a file of its own keeps check points apart."""
    return "check" if "check" in path.stem.lower() else "control"


def sigma_or_none(values: tuple[float, ...]) -> Triple | None:
    """Three standard deviations; None where they are MicMac's stopgap."""
    x, y, z = values
    return None if (x, y, z) == UNSAID else (x, y, z)


def one_set(folder: Path, sets: Sequence[Path]) -> Path | None:
    """The only one of several sets of one kind; None where there is none.

    Raises:
        ExchangeError: There are several.
    """
    if len(sets) > 1:
        raise ExchangeError(
            folder,
            "It holds several sets of one kind: {names}.",
            "Give the folder of the one you want, or move the others away.",
            names=[one.name for one in sets],
        )
    return sets[0] if sets else None


def refuse_again(path: Path, seen: Container[object], name: str, file: str) -> None:
    """Refuse a point that was measured in a scan before.

    Raises:
        ExchangeError: It was.
    """
    if (file, name) in seen:
        raise ExchangeError(
            path,
            "{name} is measured twice in {scan}.",
            "Take one of the two away.",
            name=name,
            scan=file,
        )


def by_name(path: Path, points: Iterable[ExchangePoint]) -> dict[str, ExchangePoint]:
    """Points by name.

    Raises:
        ExchangeError: Two of one name lie in different places.
    """
    found: dict[str, ExchangePoint] = {}
    for point in points:
        if found.setdefault(point.point_id, point).position != point.position:
            raise ExchangeError(
                path,
                "The point {name} has two places.",
                "Rename one of the two, or take it away.",
                name=point.point_id,
            )
    return found


def write_points(folder: Path, points: Mapping[str, ExchangePoint]) -> None:
    """GCPs.xml and GCPs.txt, and GCPs-check.xml for those that only judge."""
    for name, role in (("GCPs", "control"), ("GCPs-check", "check")):
        chosen = [point for point in points.values() if point.role == role]
        if not chosen:
            continue
        root = ElementTree.Element(POINTS)
        lines = [f"{HEAD} N X Y Z Ix Iy Iz"]
        for point in chosen:
            place, sigma = digits(point.position), digits(point.sigma_m or UNSAID)
            one = add(root, "OneAppuisDAF")
            add(one, "Pt", place)
            add(one, "NamePt", point.point_id)
            add(one, "Incertitude", sigma)
            lines.append(f"{point.point_id} {place} {sigma}")
        write_xml(folder / f"{name}.xml", root)
        # A blank parts columns there: such names stand in the XML alone.
        if not any(len(point.point_id.split()) > 1 for point in chosen):
            text = "\n".join(lines) + "\n"
            (folder / f"{name}.txt").write_text(text, encoding="utf-8")


def read_measures(path: Path) -> list[tuple[str, ExchangeMeasurement]]:
    """Measurements of an S2D file, each with the file name of its scan.

    Raises:
        ExchangeError: Damaged, without names or pixels, or a point measured twice in a scan.
    """
    found: list[tuple[str, ExchangeMeasurement]] = []
    seen: set[tuple[str, str]] = set()
    for image in read_xml(path, MEASURES, IMAGE).iter(IMAGE):
        file = text_of(image, "NameIm", path)
        common = _sigma(image, "PrecPointeByIm", path)
        for one in image.findall("OneMesureAF1I"):
            name = text_of(one, "NamePt", path)
            column, row = numbers_of(one, "PtIm", 2, path)
            sigma = _sigma(one, "PrecPointe", path) or common
            place = (column + HALF_PIXEL, row + HALF_PIXEL)
            refuse_again(path, seen, name, file)
            seen.add((file, name))
            found.append((file, ExchangeMeasurement(name, PurePath(file).stem, *place, sigma)))
    return found


def _sigma(element: ElementTree.Element, tag: str, path: Path) -> float | None:
    """A standard deviation where there is one."""
    if element.find(tag) is None:
        return None
    value = number_of(element, tag, path)
    if value <= 0:
        raise ExchangeError(path, "{tag} is not above nought.", AGAIN, tag=tag)
    return value


def write_measures(
    path: Path, measurements: Iterable[ExchangeMeasurement], files: Mapping[str, str]
) -> None:
    """Write an S2D file.

    Args:
        path: The file, `...-S2D.xml` by custom.
        measurements: Any number, in any order.
        files: File names of the scans by photo.
    """
    root = ElementTree.Element(MEASURES)
    images: dict[str, ElementTree.Element] = {}
    for one in measurements:
        if one.photo_id not in images:
            images[one.photo_id] = add(root, IMAGE)
            add(images[one.photo_id], "NameIm", files[one.photo_id])
        mark = add(images[one.photo_id], "OneMesureAF1I")
        add(mark, "NamePt", one.point_id)
        add(mark, "PtIm", digits((one.column - HALF_PIXEL, one.row - HALF_PIXEL)))
        if one.sigma_px is not None:
            add(mark, "PrecPointe", digits((one.sigma_px,)))
    write_xml(path, root)


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
