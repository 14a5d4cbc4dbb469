"""Where fiducial marks lie on real film, read by eye and written down before any detection.

Read from crops enlarged 5 to 14 times, stretched in contrast, under a ruler in pixels of the
picture. A ring lies midway between its four sides as read, a cross midway between the ends of its
arms or where they meet, a check midway between its squares; the tip of a notch lies where its two
straight edges meet when a ruler is laid along them. A second look with the reading drawn in put
right what was off. Nothing was matched, fitted or centred by a program. Places are in the pixel
frame: (0, 0) is the outer corner of the first pixel. The pictures are those of
`act-canberra-film`, `camera-families` and `fiducial-crops`; none of them may be handed on.

In every inset of `camera-families` its maker drew a grey dot 12 px wide, often upon the mark and
always at the same place of the inset. Read were the edges and arms beside it; a search judged by
these readings must not see it.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_suffix(".json")


@dataclass(frozen=True)
class SeenMark:
    """A mark, its place (px) and how far off the reading may be (px)."""

    name: str
    column: float
    row: float
    kind: str
    sure_px: float
    box: tuple[int, int, int, int] | None = None
    """Of the inset it lies in: first column, first row, end column, end row."""


@dataclass(frozen=True)
class SeenPicture:
    """A picture of `size` (columns, rows), its marks, and by name why others could not be read."""

    size: tuple[int, int]
    marks: tuple[SeenMark, ...]
    not_read: dict[str, str]


def read_seen() -> dict[str, dict[str, SeenPicture]]:
    """Pictures by name, in three sets: `frames`, `families` and `crops`."""
    sets: dict[str, dict[str, dict[str, Any]]] = json.loads(FILE.read_text(encoding="utf-8"))
    return {
        kind: {name: _picture(given) for name, given in pictures.items()}
        for kind, pictures in sets.items()
    }


def _picture(given: dict[str, Any]) -> SeenPicture:
    columns, rows = given["size"]
    marks = (SeenMark(**mark) for mark in given["marks"])
    return SeenPicture((columns, rows), tuple(marks), given["not_read"])
