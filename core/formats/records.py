"""Text files of other programs, line by line: numbers that are none are told with their line."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.rotations import Triple
from core.said import say


@dataclass(frozen=True, slots=True)
class Record:
    """One line, taken apart."""

    path: Path
    """The file."""
    number: int
    """Of the line, from 1."""
    cells: tuple[str, ...]
    """What stands between blanks, or between the delimiters that were asked for."""

    def text(self, index: int) -> str:
        """A cell.

        Raises:
            ProjectError: The line ends before it.
        """
        if index >= len(self.cells):
            raise ProjectError(
                self.path,
                say(
                    "Line {number} ends after {count:# entry|# entries}; at least {needed} are "
                    "needed.",
                    number=self.number,
                    count=len(self.cells),
                    needed=index + 1,
                ),
                "The file was cut off, or is of another format.",
            )
        return self.cells[index]

    def value(self, index: int) -> float:
        """A cell as a finite number.

        Raises:
            ProjectError: It is none.
        """
        cell = self.text(index)
        try:
            value = float(cell)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise ProjectError(
                self.path,
                say("Line {number}: '{cell}' is not a number.", number=self.number, cell=cell),
                "Numbers have a decimal point and no unit.",
            )
        return value

    def triple(self, first: int) -> Triple:
        """Three numbers that follow one another."""
        return self.value(first), self.value(first + 1), self.value(first + 2)

    def refused(self, cause: str, remedy: str) -> ProjectError:
        """An error about this line."""
        return ProjectError(self.path, cause, remedy)


def read_records(
    path: Path, parted: Callable[[str], Sequence[str]] = str.split, comment: str = "#"
) -> list[Record]:
    """Lines of a file that hold something.

    Args:
        path: Text in UTF-8 or, failing that, Latin-1.
        parted: What takes a line apart.
        comment: Sign that begins lines to be left out; empty where there is none.

    Raises:
        ProjectError: It cannot be read, or is no text.
    """
    text = read_text(path)
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [
        Record(path, number, tuple(cell.strip() for cell in parted(line)))
        for number, line in lines
        if line and not (comment and line.startswith(comment))
    ]


def read_text(path: Path) -> str:
    """A text file in UTF-8 or, failing that, Latin-1.

    Raises:
        ProjectError: It cannot be read, or holds bytes that no text has.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ProjectError(
            path,
            say("cannot be read ({error}).", error=error.strerror or error),
            "Check the path, and that you may read it.",
        ) from error
    if b"\0" in data:
        raise ProjectError(path, "is no text file.", "Give the file that the program wrote.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def only_file(folder: Path, *patterns: str) -> Path | None:
    """The one file of a folder that matches, in whatever case; None where there is none.

    Raises:
        ProjectError: There are several.
    """
    try:
        found = sorted(
            one
            for one in folder.iterdir()
            if any(fnmatch(one.name.lower(), pattern.lower()) for pattern in patterns)
        )
    except OSError as error:
        raise ProjectError(
            folder,
            say("cannot be read ({error}).", error=error.strerror or error),
            "Check the path, and that you may read it.",
        ) from error
    if len(found) > 1:
        raise ProjectError(
            folder,
            say("holds several files of one kind: {names}.", names=[one.name for one in found]),
            "Leave the one that belongs to this block.",
        )
    return found[0] if found else None
