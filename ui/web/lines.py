"""The lines of the queue as JSON text, in pieces, so that one decision sends one piece."""

import json
from typing import Any

PIECE = 50
"""Lines of one piece."""


class Lines:
    """Remembers what each piece said; lines that are the same objects are not written again."""

    def __init__(self) -> None:
        self._pieces: list[tuple[list[Any], str]] = []

    def told(self, lines: list[Any]) -> dict[str, str]:
        """Parts `rows/0`, `rows/1` and so on, and how many lines there are."""
        pieces = [lines[first : first + PIECE] for first in range(0, len(lines), PIECE)]
        known = self._pieces + [([], "")] * (len(pieces) - len(self._pieces))
        self._pieces = [
            # Comparing lists asks for identity first: unchanged lines cost next to nothing.
            old if old[0] == piece and piece else (piece, _text(piece))
            for piece, old in zip(pieces, known, strict=False)
        ]
        told = {f"rows/{number}": text for number, (_, text) in enumerate(self._pieces)}
        return {"rows/count": str(len(lines)), **told}


def _text(piece: list[Any]) -> str:
    return json.dumps(piece, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
