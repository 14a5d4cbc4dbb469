"""`import gruber`: blocks from a notebook or a script; a thin layer over the other rooms.

Examples are in docs/python/examples.md; the tests run them.
"""

from core.errors import PhotogrammetryError
from gruber.block import Block, open_block
from gruber.formats import read, write
from gruber.tables import as_geodataframe

__all__ = ["Block", "PhotogrammetryError", "as_geodataframe", "open_block", "read", "write"]
