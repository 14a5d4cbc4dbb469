"""Stand-ins for scans whose picture nobody has: empty files of the scan's size that say so."""

from pathlib import Path
from typing import Any

from core.errors import ScanError
from core.raster.files import open_plain
from core.raster.scan_pixels import open_dataset

TAG = "GRUBER_STAND_IN"
"""Metadata of a file that is a stand-in."""
# design: a few hundred empty tiles, of which the file keeps nothing but two numbers each.
TILE_PX = 512
"""Side of a tile."""
NO_PICTURES = (
    "The scans are stand-ins without pictures, so there are no orthos and no mosaic. The adjusted "
    "block is in the tables of the results, and goes out with gruber export."
)
"""What ends the walk of a block without pictures."""


def write_stand_in(path: Path, size_px: tuple[int, int]) -> None:
    """Write an empty grey TIFF of some kilobytes.

    Args:
        path: The file.
        size_px: Columns and rows.
    """
    columns, rows = size_px
    profile: dict[str, Any] = {
        "driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": "uint8",
        "tiled": True, "blockxsize": TILE_PX, "blockysize": TILE_PX, "compress": "deflate",
        "SPARSE_OK": True,
    }  # fmt: skip
    with open_plain(path, {"mode": "w", **profile}) as dataset:
        dataset.update_tags(**{TAG: "yes"})


def is_stand_in(path: Path) -> bool:
    """Whether a scan has no picture and says so; why one cannot be opened, its reader tells."""
    try:
        with open_dataset(path) as dataset:
            return TAG in dataset.tags()
    except ScanError:
        return False
