"""Point lists and files of other programs at the desk: previewed before they are imported."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast, get_args, get_type_hints

from app.bring_measurements import measured_part
from app.bring_points import POINT_TABLE, points_of, surroundings
from app.brought_lists import Brought, TakenOver
from app.desk.messages import Measured
from app.exchange import format_names, usable_part
from app.project import read_project
from core.block import UNKNOWN_M, Block, footprint
from core.errors import PhotogrammetryError
from core.formats.exchange_formats import FORMATS
from core.formats.listed_point import QUANTITIES, PointList, PointListReading
from core.formats.measurement_list import MEASUREMENTS
from core.formats.point_axes import AXES, Ground
from core.formats.point_list import read_point_list
from sessions.decisions import BringPoints
from sessions.session import Session
from ui.review.state import Notice

CHOICES = {
    name: get_args(get_type_hints(PointListReading)[name])
    for name in ("role", "duplicates", "outside", "heights", "height_system", "refused")
}
"""Words that some fields of a reading take."""
# design: what one looks at before a list comes in.
SHOWN_ROWS = 8
# design: what file systems take, in letters of four bytes.
LONGEST_FILE = 60
# design: a screen of them.
SHOWN_REFUSED = 50
BY_ENDING = {
    ".points": "qgis",
    ".geojson": "geojson",
    ".xml": "micmac",
    ".prj": "inpho",
    ".out": "bundler",
    ".json": "opensfm",
}
"""The likeliest format of files, by the end of their names."""
DOCUMENT = b"<document"
"""With this the XML of Metashape begins."""


class DeskPoints:
    """Reads lists against the block as it stands now, and hands what they bring to the loop."""

    def __init__(
        self,
        block: Block,
        folder: Path,
        hand_in: Callable[[Measured], None],
        ground: Ground,
    ) -> None:
        """The door.

        Args:
            block: As the engine left it.
            folder: The block's folder.
            hand_in: Takes what is to be recorded.
            ground: Heights of the block.
        """
        self._block, self._folder, self._hand_in = block, folder, hand_in
        self._ground = ground

    def read(self, name: str, data: bytes, reading: Mapping[str, Any]) -> dict[str, Any]:
        """A list as it would come in, for the page.

        Raises:
            PhotogrammetryError: It is no table of text, or its CRS is unknown.
        """
        if form := _format_of(name, data, reading):
            with _laid_out(name, data, reading) as path:
                return self._told(form, self._usable(form, path).brought)
        block = self._now()
        found = _read(name, data, reading, block, self._ground)
        return {"format": "", **_page_of(found, block)}

    def bring(
        self, seat_id: str, name: str, data: bytes, reading: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Hand in the decision that brings a list; as `read` where something is left to ask.

        Raises:
            PhotogrammetryError: As for `read`.
        """
        if form := _format_of(name, data, reading):
            return self._bring_foreign(seat_id, form, name, data, reading)
        block = self._now()
        found = _read(name, data, reading, block, self._ground)
        if found.questions or not found.points:
            return _page_of(found, block)
        notice = Notice("notice.brought", {"count": f"{len(found.points)}"})
        self._hand_in(Measured(seat_id, BringPoints(found.points, name), notice))
        return {"brought": len(found.points)}

    def _bring_foreign(
        self, seat_id: str, form: str, name: str, data: bytes, reading: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Hand in what another program's file brings; orientations count from the next run on."""
        with _laid_out(name, data, reading) as path:
            taken = self._usable(form, path)
            taken.write()
        count = sum(taken.brought.counts.values())
        notice = Notice("notice.brought.foreign", {"name": _plain(name), "count": f"{count}"})
        self._hand_in(Measured(seat_id, None, notice, more=taken.decisions))
        return {"brought": count}

    def _usable(self, form: str, path: Path) -> TakenOver:
        """What of another program's file the block can use."""
        project = read_project(self._folder)
        with Session.open(self._folder, "") as session:
            block = session.replayed(self._block)
            points = points_of(project, session, block)
        if form == MEASUREMENTS.name:
            return measured_part(project, path, points)
        return usable_part(project, form, path, block, points)

    @staticmethod
    def _told(form: str, brought: Brought) -> dict[str, Any]:
        """All that the page shows of another program's file."""
        return {"format": form, "counts": dict(brought.counts), "notes": list(brought.notes)}

    def known(self, name: str) -> dict[str, Any]:
        """A surveyed point of the user's own; empty where there is none."""
        point = self._now().surveyed.get(name.strip())
        if point is None or point.source != "surveyed":
            return {}
        plan, height = float(point.sigma_m[0]), float(point.sigma_m[2])
        role = "height" if plan >= UNKNOWN_M else "plan" if height >= UNKNOWN_M else point.role
        return {
            "position": point.position.tolist(),
            "role": role,
            "description": point.description,
            "sketch": point.sketch,
            "sigma": [None if sigma >= UNKNOWN_M else sigma for sigma in (plan, height)],
        }

    def _now(self) -> Block:
        """The block with all decisions; the loop's own session is not to be used from here."""
        with Session.open(self._folder, "") as session:
            return session.replayed(self._block)


def guess_format(names: Sequence[str], data: bytes) -> str:
    """The likeliest format of files by their names; empty where they may be a table of points."""
    plain = [name.lower() for name in names]
    if "gcp_list.txt" in plain:
        return "odm"
    if plain[0].endswith(".xml") and DOCUMENT in data:
        return "metashape"
    endings = {Path(name).suffix for name in plain}
    return next((form for ending, form in BY_ENDING.items() if ending in endings), "")


def reading_of(given: Mapping[str, Any]) -> PointListReading:
    """What a page chose; what no page can choose is passed over."""
    chosen = {name: value for name, value in given.items() if _is_choice(name, value)}
    if "columns" in chosen:
        listed = cast("list[Any]", chosen["columns"])
        chosen["columns"] = tuple(one if one in QUANTITIES else "" for one in listed)
    return replace(PointListReading(), **chosen)


def _is_choice(name: str, value: Any) -> bool:
    """True for a field of the reading with a value that it takes."""
    match name:
        case "columns":
            return isinstance(value, list)
        case "header":
            return isinstance(value, bool)
        case "sigma_plan_m" | "sigma_height_m":
            return isinstance(value, int | float) and 0 < value < UNKNOWN_M
        case "axes":
            return value in AXES
        case "delimiter":
            return isinstance(value, str) and len(value) == 1
        case "encoding" | "decimal" | "crs":
            return isinstance(value, str)
        case _:
            return value in CHOICES.get(name, ())


FOLDERS = ("micmac", "mmvii", "qgis")
"""Formats that are read from a folder, of one file too."""


def import_titles() -> dict[str, str]:
    """Formats of other programs that can be read, with what a user calls them."""
    return {name: FORMATS[name].title for name in format_names(reads=True) if name != POINT_TABLE}


def _format_of(name: str, data: bytes, reading: Mapping[str, Any]) -> str:
    """The format of other programs that was chosen or is likeliest; empty for a table."""
    chosen = reading.get("format")
    if chosen is None:
        return guess_format([one for one, _ in _files(name, data, reading)], data)
    return str(chosen) if chosen in import_titles() else ""


def _plain(name: str) -> str:
    """A file's own name, no path in it."""
    return Path(name.replace("\\", "/")).name or "points"


def _files(name: str, data: bytes, reading: Mapping[str, Any]) -> list[tuple[str, bytes]]:
    """Files that came one behind the other, by the names and sizes that the page tells."""
    listed = cast("list[Any]", reading.get("files") or [[name, len(data)]])
    found: list[tuple[str, bytes]] = []
    start = 0
    for one, size in listed:
        found.append((_plain(str(one)), data[start : start + int(size)]))
        start += int(size)
    return found


@contextmanager
def _laid_out(name: str, data: bytes, reading: Mapping[str, Any]) -> Generator[Path]:
    """The files in a folder of their own: the single one, or the folder."""
    files = _files(name, data, reading)
    with TemporaryDirectory() as folder:
        for one, part in files:
            (Path(folder) / one).write_bytes(part)
        whole = len(files) > 1 or _format_of(name, data, reading) in FOLDERS
        yield Path(folder) if whole else Path(folder) / files[0][0]


def _read(
    name: str, data: bytes, reading: Mapping[str, Any], block: Block, ground: Ground
) -> PointList:
    """A list that came over the wire, under its own name."""
    plain = _plain(name)
    around = surroundings(block.crs, block, ground)
    with TemporaryDirectory() as folder:
        path = Path(folder) / (plain.replace("/", "-").strip(".")[:LONGEST_FILE] or "points")
        path.write_bytes(data)
        try:
            return read_point_list(path, around, reading_of(reading))
        except PhotogrammetryError as error:
            raise type(error)(plain, error.cause, error.remedy) from error


def _page_of(found: PointList, block: Block) -> dict[str, Any]:
    """All that the page shows of a list."""
    reading, table = found.reading, found.table
    width = max((len(row.cells) for row in table.rows), default=0)
    areas = [footprint(photo, block.camera_of(name)) for name, photo in block.photos.items()]
    return {
        "reading": {
            "encoding": reading.encoding, "delimiter": reading.delimiter,
            "decimal": reading.decimal, "header": reading.header, "axes": reading.axes or "",
            "columns": list(reading.columns or ()), "crs": reading.crs, "role": reading.role,
            "sigma_plan_m": reading.sigma_plan_m, "sigma_height_m": reading.sigma_height_m,
        },
        "header": list(table.header),
        "width": max(width, len(table.header)),
        "rows": [[row.number, *row.cells] for row in table.rows[:SHOWN_ROWS]],
        "evidence": list(found.evidence),
        "points": [[p.point_id, p.easting, p.northing, p.role] for p in found.points],
        "replaced": sum(point.point_id in block.surveyed for point in found.points),
        "refused": [
            {"number": row.number, "text": row.text, "cause": row.cause, "remedy": row.remedy}
            for row in found.refused[:SHOWN_REFUSED]
        ],
        "refused_count": len(found.refused),
        "questions": [
            {"about": asked.about, "words": asked.words,
             "choices": [{"value": one.value, "words": one.words} for one in asked.choices]}
            for asked in found.questions
        ],
        "footprints": [[list(place) for place in area.exterior.coords] for area in areas],
    }  # fmt: skip
