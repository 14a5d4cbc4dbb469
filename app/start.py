"""The start page: from any folder to a block that can be run, and to the run itself."""

import os
import secrets
import threading
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from app.batch import batch_told
from app.block_form import BlockForm
from app.block_list import MOST_LISTED, block_told, blocks_in, was_made
from app.block_toml import FILE, RASTERS
from app.folder_scan import DEPTH, VECTORS, Findings, find, folders_of_scans, is_plain, with_named
from app.margin import read_scan
from app.neighbours import Archive
from app.new_block import Recognition, recognise_files
from app.placing import drawn_raw
from app.project import Project, read_project
from app.running import Running
from app.start_checks import (
    Check,
    Outline,
    are_sizes,
    checks_of,
    form_checks,
    outlines_of,
    stages_ahead,
)
from core.doubts import Failure
from core.errors import PhotogrammetryError, ProjectError, ScanError, StorageError
from core.raster.scan_file import ScanFile, ScanFiles, open_scan
from core.said import say
from core.scans.text_reader import installed_reader
from sessions.atomic_write import clean_leftovers, whole_file
from sessions.disk import explain_disk_errors
from sessions.session import HIDDEN, Session
from ui.review.looks import page_palette
from ui.web.access import Access, Door, lasting_token
from ui.web.front import Front, FrontInputs, Opened
from ui.web.start import Fields, start_routes
from ui.web.tiles import ScanTiles

ANSWERED_S = 0.2
"""Time for the last answer of the page, seconds."""
MOST_OUTLINES = 400
"""Outlines that the map is given."""
OWN_NAMES = frozenset({"results", "session.gpkg"})
"""What Gruber writes itself and nobody uploads."""


class Start(Opened):
    """An open start page."""

    def __init__(self, front: Front, starting: "Starting") -> None:
        super().__init__(front)
        self._starting = starting

    def wait(self) -> Path:
        """The folder whose desk is to be opened, once there is one; Ctrl-C passes through."""
        starting = self._starting
        while not starting.over.wait(timeout=0.3):
            if starting.running.gone_through.is_set():
                return starting.folder
        # The answer to who chose it is still on its way.
        time.sleep(ANSWERED_S)
        return starting.chosen

    def close(self) -> None:
        """Close the port and stop the run."""
        self._starting.running.close()
        super().close()
        self._starting.tiles.close()


def open_start(
    folder: Path,
    door: Door,
    language: str = "",
    token: str = "",
    left: Mapping[str, str] | None = None,
    home: Path | None = None,
) -> Start:
    """Open the start page of a folder.

    `left` says who closed another page for it, `home` is the folder of blocks it was chosen in.

    Raises:
        PhotogrammetryError: The port cannot be had.
    """
    starting = Starting(folder, home)
    access = Access(door, token or token_of(starting.folder))
    said = {
        "name": starting.folder.name,
        "edition": secrets.token_urlsafe(6),
        "palette": page_palette(),
        "photos": [],
        "left": left,
    }
    served = FrontInputs(
        access, None, starting.tiles, None, said, page="start.html", language=language,
        routes=start_routes(starting),
    )  # fmt: skip
    opened = Start(Front(served), starting)
    opened.listen()
    return opened


def wants_start(folder: Path) -> bool:
    """True for a folder in which there is nothing to review or to place yet."""
    if not folder.is_dir():
        return False
    try:
        read_project(folder)
    except PhotogrammetryError:
        return True
    return not was_made(folder, "scans")


def token_of(folder: Path) -> str:
    """A secret that lasts where the folder may become a block, else one for this time."""
    if not blocks_in(folder):
        with suppress(OSError):
            (folder / HIDDEN).mkdir(exist_ok=True)
            return lasting_token(folder / HIDDEN)
    return secrets.token_urlsafe(24)


class Starting:
    """What the start page asks for and sets off; satisfies `ui.web.start.Starter`."""

    def __init__(self, folder: Path, home: Path | None = None) -> None:
        self.folder = folder.resolve()
        self._home = "" if home in (None, self.folder) else str(home)
        self.chosen = self.folder
        self.over = threading.Event()
        self.running = Running(self.folder)
        self.tiles = ScanTiles(ScanFiles())
        self.form = BlockForm(self.folder / FILE)
        self.status = self.running.status
        self.cancel_run = self.running.cancel
        self._looked: dict[tuple[Path, int, int], ScanFile | str] = {}
        self._lock, self._comparing = threading.Lock(), threading.Lock()
        self._archive = Archive(self.folder)
        self._added: set[Path] = set()
        with suppress(OSError):
            clean_leftovers(self.folder)

    def start_run(self) -> None:
        """Begin to run the block."""
        self.running.start()

    def found(self) -> dict[str, Any]:
        """What the folder holds and lacks, the form, scans, outlines, and blocks in it."""
        with self._lock:
            found = find(self.folder)
            recognition = recognise_files(self.folder, found)
            form = self.form.read(recognition)
            every = with_named(found, form.files)
            scans = [self._scan(path) for path in self._scan_paths(every, form.scans)]
            scans.sort(key=lambda scan: not scan["why"])  # those that cannot be read first
            outlines, crs = outlines_of(every, form.crs, MOST_OUTLINES)
            given = form.written
            return {
                "folder": str(self.folder),
                "home": self._home,
                "written": self.form.file.is_file(),
                "found": [list(line) for line in recognition.found],
                "gaps": [[gap.name, gap.out, list(gap.keys)] for gap in recognition.gaps
                         if not any(key in given for key in gap.keys)],
                "notes": [[note.name, dict(note.values)] for note in recognition.notes
                          if note.name != "unused"
                          or self.folder / note.values["file"] not in form.files],
                "scans": scans,
                "crs": crs,
                "outlines": [outline.part() for outline in outlines],
                "form": form.part(),
                **self._blocks(),
                **self.batch(),
                "links": self._links(),
                "added": sorted({self._top(path) for path in self._added}),
                **self._judged(form.project, scans, outlines),
            }  # fmt: skip

    def neighbours(self) -> dict[str, Any]:
        """What the blocks of this folder share."""
        with self._comparing:
            return dict(self._archive.figures())

    def batch(self) -> dict[str, Any]:
        """How far the blocks of this folder are that were run together."""
        return {"batch": batch_told(self.folder)}

    def judge(self, values: Mapping[str, Any], written: Fields = None) -> dict[str, Any]:
        """What is wrong and what is doubtful of the form as it stands, and what it makes again.

        Nothing is written. `written` are the fields that a hand has changed, with what the file
        had of them; by default all.
        """
        judged = self.form.judged(values, self._recognition(), written)
        with self._lock:
            ahead, shut = self._ahead(judged.project)
            return {**judged.part(), "ahead": ahead, "checks": [*form_checks(values), *shut]}

    def save(self, values: Mapping[str, Any], written: Fields = None) -> dict[str, Any]:
        """Write `block.toml` unless something filled in cannot be used; `written` as for `judge`.

        Raises:
            PhotogrammetryError: The disk is full, the file is written in a way of its own, or one
                of the fields was saved by somebody else since.
        """
        recognition = self._recognition()
        with self._lock:
            judged = self.form.save(values, recognition, written)
        return {**judged.part(), "saved": not judged.errors}

    def receive(self, name: str, size: int) -> AbstractContextManager[Path]:
        """Where an uploaded file is written; it takes its place when it is whole.

        Raises:
            StorageError: The name leads elsewhere, is taken, or the disk has no room.
        """
        path = self.place_of(name)
        if path.exists() or path.is_symlink():
            raise StorageError(path, "is there already.", "Rename one of the two files.")
        free = free_bytes(self.folder)
        if size > free:
            raise StorageError(
                path,
                say(
                    "needs {size:.0f} MB, and the disk has {free:.0f} MB left.",
                    size=size / 1e6,
                    free=free / 1e6,
                ),
                "Free some space, or link the folder instead of copying it.",
            )
        return self._noted(path)

    @contextmanager
    def _noted(self, path: Path) -> Generator[Path]:
        """An upload, remembered once it is there: it may be taken out again."""
        with whole_file(path) as temporary:
            yield temporary
        self._added.add(path)

    def place_of(self, name: str) -> Path:
        """The place of an uploaded file inside the folder.

        Raises:
            StorageError: The name is none of a plain file below the folder.
        """
        parts = name.split("/")
        plain = all(is_plain(part) for part in parts) and len(parts) <= DEPTH + 1
        path = self.folder.joinpath(*parts) if plain else self.folder
        within = plain and path.parent.resolve() == path.parent
        if not within or parts[0] in OWN_NAMES:
            raise StorageError(
                self.folder,
                say("{name!r} cannot be the name of a file here.", name=name),
                "Give it a plain name, without dots at its beginning.",
            )
        return path

    def folders(self, path: str) -> dict[str, Any]:
        """The folders in a folder of this computer, and how many rasters and layers lie in it.

        Raises:
            StorageError: It may not be read.
        """
        place = Path(path).expanduser().resolve() if path else self.folder.parent
        try:
            inside = sorted(os.scandir(place), key=lambda entry: entry.name.lower())
        except OSError as error:
            raise StorageError(
                place,
                say("cannot be read ({error}).", error=error.strerror),
                "Choose another folder.",
            ) from error
        shown = [entry for entry in inside if not entry.name.startswith(".")]
        folders = [entry.name for entry in shown if _is_open_folder(entry)]
        files = [entry.name for entry in shown if Path(entry.name).suffix.lower() in KNOWN]
        return {
            "path": str(place), "parent": str(place.parent), "folders": folders[:MOST_LISTED],
            "files": len(files), "block": (place / FILE).is_file(),
        }  # fmt: skip

    def link(self, path: str) -> dict[str, Any]:
        """Let the folder show another one's files without copying them.

        Raises:
            StorageError: It is this folder, holds it, or its name is taken.
        """
        target = Path(path).resolve()
        place = self.folder / target.name
        if not target.is_dir() or not os.access(target, os.R_OK | os.X_OK):
            raise StorageError(target, "is no folder that can be read.", "Choose another one.")
        if target in (self.folder, *self.folder.parents) or self.folder in target.parents:
            cause = "is the folder of this block, or holds it."
            raise StorageError(target, cause, "Choose the folder of the data alone.")
        if place.exists() or place.is_symlink():
            cause = say("has a file or folder called {name} already.", name=target.name)
            raise StorageError(self.folder, cause, "Rename one of the two.")
        try:
            place.symlink_to(target, target_is_directory=True)
        except OSError as error:
            cause = say("cannot be made ({error}).", error=error.strerror)
            raise StorageError(place, cause, WRITABLE) from error
        return {"linked": target.name}

    def unlink(self, name: str) -> dict[str, Any]:
        """Take away a link, whose files stay, or what was uploaded under a name.

        Raises:
            StorageError: It may not be removed.
        """
        added = [path for path in self._added if self._top(path) == name]
        linked = [self.folder / name] if name in self._links() else []
        for path in (*added, *linked):
            with explain_disk_errors(path):
                path.unlink(missing_ok=True)
            self._added.discard(path)
            for parent in path.relative_to(self.folder).parents[:-1]:
                with suppress(OSError):  # other files are in it
                    (self.folder / parent).rmdir()
        return {"links": self._links()}

    def _top(self, path: Path) -> str:
        """The file or folder of this folder that an uploaded file is, or lies in."""
        return path.relative_to(self.folder).parts[0]

    def _blocks(self) -> dict[str, Any]:
        """Blocks in this folder, and folders of scans beside them that may become one.

        Of very many blocks the first; how good each is takes its session.
        """
        paths = blocks_in(self.folder)
        taken = {place for path in paths for place in (Path(path), *Path(path).parents)}
        scans = folders_of_scans(self.folder) if paths else []
        new = [name for name in scans if Path(name) not in taken]
        listed = [(path, True) for path in paths[:MOST_LISTED]] + [(name, False) for name in new]
        blocks = [
            {
                "path": path,
                "run": written and was_made(self.folder / path, "control"),
                "written": written,
                **block_told(self.folder / path),
            }
            for path, written in listed
        ]
        return {"blocks": blocks, "unlisted": len(paths[MOST_LISTED:])}

    def open(self, path: str) -> dict[str, Any]:
        """Go on with this folder's desk, or with another folder.

        Raises:
            ProjectError: It is no folder.
        """
        chosen = (self.folder / path).resolve()
        if not chosen.is_dir() or not os.access(chosen, os.R_OK | os.X_OK):
            raise ProjectError(chosen, "is no folder that can be read.", "Choose another one.")
        self.chosen = chosen
        self.over.set()
        return {"opening": str(chosen)}

    def margin(self, photo: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """What is written beside the picture of a scan.

        Raises:
            ProjectError: There is no such scan.
            ScanError: The scan cannot be read.
        """
        paths = {path.stem: path for path, _, _ in self._looked}
        if photo not in paths:
            raise ProjectError(
                self.folder, say("has no scan called {name}.", name=photo), LOOK_AGAIN
            )
        reader = installed_reader()
        if isinstance(reader, Failure):
            return {"photo": photo, "fields": None}
        frames = [value for key, value in values.items() if key.endswith(".frame_mm")]
        frame_mm = frames[0] if frames and are_sizes(frames[0], 2) else None
        pixel_um = values.get("scans.scan_pixel_um")
        known_um = pixel_um if are_sizes([pixel_um], 1) else None
        read = read_scan(paths[photo], reader, frame_mm, known_um)
        return {"photo": photo, "fields": read.part()}

    def _recognition(self) -> Recognition:
        return recognise_files(self.folder, find(self.folder))

    def _scan_paths(self, found: Findings, named: Sequence[Path]) -> list[Path]:
        """The scans that `block.toml` names, else what looks like scans."""
        if named:
            return list(named)
        broken = [path for path in found.unreadable if path.suffix.lower() in RASTERS]
        seen = [raster.path for raster in found.rasters if raster.kind == "scan"]
        return sorted([*seen, *broken])

    def _scan(self, path: Path) -> dict[str, Any]:
        """Size and state of a scan; its tiles can be asked for where it can be read."""
        try:
            stat = path.stat()
        except OSError:
            return {"photo": path.stem, "file": path.name, "why": say("The file is missing.")}
        key = (path, stat.st_size, stat.st_mtime_ns)
        if key not in self._looked:
            try:
                self._looked[key] = open_scan(path)
            except ScanError as error:
                self._looked[key] = say("{cause} {remedy}", cause=error.cause, remedy=error.remedy)
        seen = self._looked[key]
        told = {"photo": path.stem, "file": path.name, "bytes": stat.st_size}
        if isinstance(seen, str):
            return {**told, "why": seen}
        self.tiles.publish({path.stem: drawn_raw(path, seen.size_px)})
        return {**told, "size": list(seen.size_px), "bands": seen.bands, "why": ""}

    def _links(self) -> list[str]:
        with suppress(OSError):
            return sorted(entry.name for entry in self.folder.iterdir() if entry.is_symlink())
        return []

    def _judged(
        self, project: Project | None, scans: list[dict[str, Any]], outlines: Sequence[Outline]
    ) -> dict[str, Any]:
        """What is checked before minutes are spent, and what a run would make again."""
        if project is None:
            return {"checks": [], "ahead": [], "made": False, "placeable": False}
        made, placeable = (was_made(self.folder, stage) for stage in ("control", "scans"))
        checks = checks_of(project, {scan["file"]: scan["why"] for scan in scans}, outlines)
        ahead, shut = self._ahead(project)
        checks += [check for check in shut if check not in checks]
        return {"checks": checks, "ahead": ahead, "made": made, "placeable": placeable}

    def _ahead(self, project: Project | None) -> tuple[list[str], list[Check]]:
        """What a run would make again of what was made, and what cannot be opened for it."""
        if project is None or not was_made(self.folder, "scans") or self.running.under_way:
            return [], []
        try:
            with Session.open(self.folder, "gruber") as session:
                return list(stages_ahead(project, session)), []
        except PhotogrammetryError as error:
            return [], [[True, "error", {"text": error.told}]]


KNOWN = RASTERS | VECTORS
LOOK_AGAIN = "Load the page again."
WRITABLE = "Give yourself the right to write there."


def free_bytes(folder: Path) -> int:
    """Free space of a folder's disk."""
    stat = os.statvfs(folder)
    return stat.f_bavail * stat.f_frsize


def _is_open_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir() and os.access(entry.path, os.R_OK | os.X_OK)
    except OSError:
        return False
