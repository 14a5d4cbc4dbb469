"""Surveyed points of a list, what its columns mean, and what has to be asked, as values."""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np

from core.formats.delimited_table import DelimitedTable, TableRow, number_of
from core.formats.records import LONGEST_HEAD

Triple = tuple[float, float, float]
ListedRole = Literal["control", "plan", "height", "check"]
"""plan: control in X and Y alone; height: control in Z alone."""
ROLES: tuple[ListedRole, ...] = get_args(ListedRole)
# source: docs/formats.md: what Gruber's own list has where it says nothing.
USUAL_SIGMA_M = 0.1
Quantity = Literal[
    "",
    "id",
    "X",
    "Y",
    "Z",
    "sigma_X",
    "sigma_Y",
    "sigma_Z",
    "sigma_xy",
    "role",
    "description",
    "sketch",
]
"""What a column holds; nothing where it is not read. X and Y are the list's own two columns of
plane coordinates, whichever way they point."""
Axes = Literal["E N", "N E", "-E -N", "-N -E"]
"""What the columns X and Y hold: easting and northing, swapped, with their signs turned, or both
(Czech lists: X = -northing, Y = -easting)."""


@dataclass(frozen=True, slots=True)
class ListedPoint:
    """One surveyed point of a list, in the block's CRS."""

    point_id: str
    """Name, without blanks around it."""
    easting: float
    """Metres."""
    northing: float
    """Metres."""
    height: float
    """Metres."""
    sigma_m: Triple
    """Standard deviations of easting, northing and height, metres."""
    role: ListedRole = "control"
    """What it is for."""
    description: str = ""
    """What it is, in the surveyor's words."""
    sketch: str = ""
    """Name of the file with its sketch or photograph."""


@dataclass(frozen=True, slots=True)
class PointListReading:
    """How a list is to be read: what is left at its default is recognised, or asked."""

    encoding: str = ""
    """As Python calls it."""
    delimiter: str = ""
    """Comma, semicolon, tab, or a blank for any run of blanks."""
    decimal: str = ""
    """Point or comma."""
    header: bool | None = None
    """Whether the first line names the columns."""
    columns: tuple[Quantity, ...] | None = None
    """What each column holds, from the first on."""
    axes: Axes | None = None
    """What the columns X and Y hold."""
    crs: str = ""
    """CRS of the list; the block's where empty."""
    role: ListedRole = "control"
    """Of points whose row says none."""
    sigma_plan_m: float = USUAL_SIGMA_M
    """Of points whose row says none: of easting and northing each, metres."""
    sigma_height_m: float = USUAL_SIGMA_M
    """Of points whose row says none, metres."""
    duplicates: Literal["", "first", "last"] = ""
    """Which row holds where two of one name differ; asked where empty."""
    outside: Literal["", "leave out", "keep"] = ""
    """What becomes of points that no photo can see; asked where empty."""
    heights: Literal["", "leave out", "keep"] = ""
    """What becomes of points whose height no ground there can have; asked where empty."""
    height_system: Literal["", "keep"] = ""
    """Whether heights that may be of another system come in as they are; asked where empty."""
    refused: Literal["", "leave out"] = ""
    """Whether the others come in although rows are refused; asked where empty."""


@dataclass(frozen=True, slots=True)
class RefusedRow:
    """A row that brings no point."""

    number: int
    """Line of the file."""
    text: str
    """The row as it stands."""
    cause: str
    """What is wrong with it."""
    remedy: str
    """What to do about it."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One answer to a question."""

    value: str
    """What the reading's field is set to."""
    words: str
    """What that means."""


@dataclass(frozen=True, slots=True)
class Question:
    """What the list does not say and the block does not tell."""

    about: str
    """Field of `PointListReading` that answers it."""
    words: str
    """The question with its evidence."""
    choices: tuple[Choice, ...] = ()
    """Answers; without any, the columns have to be named."""


@dataclass(frozen=True, slots=True)
class PointList:
    """A list as it was read."""

    reading: PointListReading
    """How it was read: everything recognised is filled in."""
    table: DelimitedTable
    """Its cells."""
    evidence: tuple[str, ...] = ()
    """What was recognised, and by what."""
    points: tuple[ListedPoint, ...] = ()
    """Points that may come in once no question is left."""
    refused: tuple[RefusedRow, ...] = ()
    """Rows that bring none."""
    questions: tuple[Question, ...] = ()
    """What has to be answered before anything comes in."""


@dataclass(frozen=True, slots=True)
class ReadRow:
    """A row that could be read."""

    source: TableRow
    """The row."""
    point: ListedPoint
    """Its point; easting and northing may still be the list's own X and Y."""


QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
COORDINATES: tuple[Quantity, ...] = ("X", "Y", "Z")
SIGMAS: tuple[Quantity, ...] = ("sigma_X", "sigma_Y", "sigma_Z", "sigma_xy")
WORDS: dict[Quantity, str] = {
    "id": "id name point pointid pointname pointno pointnumber pt ptid ptname no nr num number "
    "label title station gcp gcpname gcplabel gcpid marker namept bod bodu cislo cislobodu cb "
    "cbodu nazev nazevbodu jmeno oznaceni nom numero punkt punktnr punktnummer pktnr pkt "
    "punktname nazwa numer",
    "X": "x xm xcoord coordx xeasting e em east easting eastings ost rechts rechtswert vychod est "
    "mapx geox xsjtsk xjtsk souradnicex lon long longitude delka xutm utme",
    "Y": "y ym ycoord coordy ynorthing north northing northings nord hoch hochwert sever "
    "mapy geoy ysjtsk yjtsk souradnicey lat latitude sirka yutm utmn",
    "Z": "z zm h hm height alt altitude elev elevation zaltitude zcoord coordz hohe vyska vyskam "
    "nadmorskavyska hbpv zbpv vyskabpv bpv souradnicez quota cota hauteur wysokosc geoz mapz",
    "sigma_X": "sigmax sigmae sx se mx stdx sdx accuracyx accx xaccuracy lonacc sigmaeast stdex",
    "sigma_Y": "sigmay sigman sy sn my stdy sdy accuracyy accy yaccuracy latacc sigmanorth stdey",
    "sigma_Z": "sigmaz sigmah sz sh mz mh stdz sdz accuracyz accz zaccuracy elevacc sigmaheight "
    "verticalaccuracy va stdez",
    "sigma_xy": "sigmaxy sxy mxy stdxy sdxy mp accuracyxy accxy sigmaplan horizontalaccuracy ha",
    "role": "role usage use kind class uloha ucel trida funkce rolle verwendung",
    "description": "description desc descr popis note notes poznamka remark remarks comment "
    "comments bemerkung beschreibung code kod stabilizace opis",
    "sketch": "sketch photo image picture foto fotografie nacrt nakres mistopis skizze obrazek "
    "bild sketchfile photofile imagefile imagefilename soubor",
}
"""Names of columns as lists have them: small letters without accents, units and signs."""
KNOWN: dict[str, Quantity] = {
    word: quantity for quantity, words in WORDS.items() for word in words.split()
}
GEOGRAPHIC = {"lon", "long", "longitude", "lat", "latitude", "delka", "sirka"}
"""Names of columns that hold degrees."""
ABOVE_ELLIPSOID = {
    *("hellipsoidal", "hellipsoid", "hellips", "hell", "hae", "heightellipsoidal", "ellh"),
    *("ellipsoidalheight", "ellipsoidheight", "ellheight", "ellipsoidalh", "heightaboveellipsoid"),
    *("zellipsoidal", "elipsoidickavyska", "vyskaelipsoidicka", "helips", "helipsoidicka"),
    *("ellipsoidischehohe", "ellipsoidhohe"),
}
"""Names of columns that hold heights above the ellipsoid."""
EAST_NORTH = {
    "e",
    "em",
    "east",
    "easting",
    "eastings",
    "xeasting",
    "n",
    "north",
    "northing",
    "northings",
    "ynorthing",
}
"""Names that leave no doubt which of the two is easting."""
ROLE_WORDS = {
    "control": "control vlicovaci vlic gcp gcpcontrol passpunkt full xyz 3d",
    "check": "check checkpoint cp gcpcheck icp kontrolni kontrolnibod kontrollpunkt",
    "plan": "plan horizontal xy polohovy 2d gcphorizontal lage",
    "height": "height vertical z vyskovy 1d gcpvertical hohe",
}
"""Words for a role as lists have them; kontrolní is a check point, vlícovací is control."""
# source: definition of the units.
SCALES = {"mm": 0.001, "cm": 0.01, "m": 1.0}
"""Units that standard deviations may have, in metres."""
PICTURES = re.compile(r".+\.(?:jpe?g|png|tiff?|gif|pdf|bmp|webp|svg|dgn|dxf)", re.IGNORECASE)
# source: the shore of the Dead Sea and Mount Everest, with some room, metres.
LOWEST_M, HIGHEST_M = -500.0, 9000.0
# design: plane coordinates of a map are further from its origin than this, numbers of points not.
SMALL_M = 1000.0
# design: a surveyed point is known to better than this, a coordinate is no such number.
LARGEST_SIGMA_M = 100.0


def plain_word(text: str) -> str:
    """A name of a column in small letters, without accents, unit in brackets and signs."""
    bare = re.sub(r"[\[(].*?[\])]", "", text[:LONGEST_HEAD].casefold())
    flat = unicodedata.normalize("NFKD", bare.replace("\u03c3", "sigma"))
    return "".join(sign for sign in flat if sign.isalnum())


def known_words(cells: Sequence[str]) -> int:
    """How many cells name a column."""
    return sum(plain_word(cell) in {*KNOWN, *ABOVE_ELLIPSOID, "n"} for cell in cells)


def unit_of(name: str) -> str:
    """The unit in a column's name; empty where it says none."""
    found = re.search(
        r"[\[(]\s*([^\])]+?)\s*[\])]|_(mm|cm|m|ft|km)$", name.strip()[:LONGEST_HEAD].casefold()
    )
    return (found[1] or found[2]) if found else ""


def named_columns(header: Sequence[str]) -> tuple[Quantity, ...]:
    """What each column holds by its name; a second name for points describes them."""
    words = [plain_word(name) for name in header]
    geographic = sum(word in GEOGRAPHIC for word in words) > 1
    # Beside heights of another name those above the ellipsoid are not wanted.
    ellipsoidal = "" if any(KNOWN.get(word) == "Z" for word in words) else "Z"
    found: list[Quantity] = []
    for word in words:
        quantity = ellipsoidal if word in ABOVE_ELLIPSOID else KNOWN.get(word, "")
        if word == "n":  # northing beside an E, the name in MicMac's `N X Y Z`
            quantity = "id" if "x" in words and "y" in words else "Y"
        if geographic and word in ("x", "y"):  # pixels, where degrees stand beside them
            quantity = ""
        if quantity == "id" and "id" in found:
            quantity = "description"
        if quantity in found and quantity not in COORDINATES:
            quantity = ""
        found.append(quantity)
    return tuple(found)


def guessed_columns(rows: Sequence[Sequence[str]], decimal: str) -> tuple[Quantity, ...]:
    """What each column of a table without names holds, by its values.

    The coordinates are three neighbours of which the third can be a height and the first two are
    large; what stands before them names the point.
    """
    width = max(map(len, rows), default=0)
    columns = [[row[n] if n < len(row) else "" for row in rows] for n in range(width)]
    numbers = [_numbers(column, decimal) for column in columns]
    start = _first_coordinate(numbers)
    found: list[Quantity] = [""] * width
    if start is None:
        return tuple(found)
    found[start : start + 3] = COORDINATES
    if start:
        found[next((n for n in range(start) if numbers[n] is None), 0)] = "id"
    later = [n for n in range(start + 3, width) if _are_sigmas(numbers[n])]
    names = {2: ("sigma_xy", "sigma_Z"), 3: ("sigma_X", "sigma_Y", "sigma_Z")}.get(len(later), ())
    for n, name in zip(later, names, strict=False):
        found[n] = cast("Quantity", name)
    for n in range(start + 3, width):
        words: Quantity = _words_of(columns[n])
        if numbers[n] is None and words not in found:
            found[n] = words
    return tuple(found)


def role_of(cell: str) -> str:
    """The role a word means; empty where it means none."""
    word = plain_word(cell)
    return next((role for role, words in ROLE_WORDS.items() if word in words.split()), "")


def _numbers(column: Sequence[str], decimal: str) -> np.ndarray | None:
    """A column as numbers; None where fewer than nine in ten cells are."""
    values = [number_of(cell, decimal) for cell in column if cell]
    known = [value for value in values if value is not None]
    # design: a slip or two in a long list must not hide what the column holds.
    return np.array(known) if known and len(known) >= 0.9 * len(values) else None


def _first_coordinate(numbers: Sequence[np.ndarray | None]) -> int | None:
    """Where the three columns of coordinates begin."""
    ranked: list[tuple[int, int]] = []
    for n in range(len(numbers) - 2):
        east, north, height = numbers[n : n + 3]
        if east is None or north is None or height is None:
            continue
        high = LOWEST_M < float(np.median(height)) < HIGHEST_M
        large = min(float(np.median(np.abs(axis))) for axis in (east, north)) > SMALL_M
        ranked.append((-(2 * high + large), n))
    return min(ranked)[1] if ranked else None


def _are_sigmas(values: np.ndarray | None) -> bool:
    return values is not None and bool(np.all((values > 0) & (values < LARGEST_SIGMA_M)))


def _words_of(column: Sequence[str]) -> Quantity:
    """What a column of words holds."""
    filled = [cell for cell in column if cell]
    if filled and all(role_of(cell) for cell in filled):
        return "role"
    if filled and all(PICTURES.fullmatch(cell) for cell in filled):
        return "sketch"
    return "description"
