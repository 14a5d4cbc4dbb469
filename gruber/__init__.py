"""`import gruber`: blocks from a notebook or a script; a thin layer over the other rooms.

Examples are in docs/python/examples.md; the tests run them. A name is imported once it is asked
for: the program `gruber` passes here too, its help waits for no engine, and it says how many
threads linear algebra has before anything loads it.
"""

from pkgutil import resolve_name
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from core.errors import PhotogrammetryError
    from gruber.block import Block, open_block
    from gruber.formats import read, write
    from gruber.lessons import lesson
    from gruber.tables import as_geodataframe

__all__ = [
    "Block",
    "PhotogrammetryError",
    "as_geodataframe",
    "lesson",
    "open_block",
    "read",
    "write",
]
_LATER = {
    "Block": "gruber.block", "open_block": "gruber.block", "as_geodataframe": "gruber.tables",
    "read": "gruber.formats", "write": "gruber.formats", "PhotogrammetryError": "core.errors",
    "lesson": "gruber.lessons",
}  # fmt: skip


def __getattr__(name: str) -> object:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return resolve_name(f"{_LATER[name]}:{name}")


def __dir__() -> list[str]:
    return __all__
