"""What `block.toml` says of map sheets."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from app.block_sections import check_attribute, refusing
from app.block_toml import Document, Table
from core.said import say
from core.sheets.cutting import Form
from core.sheets.map_sheets import NAME, Corner, check_corners
from core.sheets.pixels import metric_crs
from core.sheets.stage import LOSSY_PERCENT

PRODUCT = re.compile(r"[A-Z]{4}")


@dataclass(frozen=True, slots=True)
class SheetsSection:
    """`[sheets]`, and the index layer of `[ortho]`."""

    index: Path | None = None
    """Polygons of the map sheets, with the attribute `name`."""
    rule: str = ""
    """Where there is no index: `sm5` for the sheets of the State Map 1:5000."""
    sm50: Mapping[str, Corner] = field(default_factory=dict[str, Corner])
    """North-east corners of sheets 1:50 000 by their letters, EPSG:5514."""
    formats: tuple[Form, ...] = ("geotiff",)
    crs: tuple[str, ...] = ()
    """CRS beside the block's own."""
    overlap_m: float = 0.0
    """Rim of its neighbours that a sheet shows too, metres."""
    border: Path | None = None
    """Polygons beyond which sheets show nothing."""
    border_m: float = 100.0
    """How far beyond the border they still show something, metres."""
    lossy_percent: float = LOSSY_PERCENT
    """Size of lossy files, in hundredths of the uncompressed ones."""
    product: str = ""
    """Four letters that names of files begin with; empty: sheets keep their names."""
    year: int | None = None
    """Year in names; None takes that of the latest photo shown."""

    @property
    def asked(self) -> bool:
        """Whether sheets are wanted."""
        return self.index is not None or bool(self.rule)


def sheets_section(document: Document) -> SheetsSection:
    """What `block.toml` says of map sheets.

    Raises:
        ProjectError: Something in it cannot be used.
    """
    ortho, table = document.table("ortho"), document.table("sheets")
    index = ortho.file("sheets")
    if index is not None:
        check_attribute(ortho, "sheets", index, "sheets", NAME)
    for crs in (systems := table.words("crs")):
        refusing(table, "crs", lambda crs=crs: metric_crs(crs, ""))
    product = table.text("product")
    if product and not PRODUCT.fullmatch(product):
        remedy = 'Write its four capital letters: "ORTO".'
        raise table.error("product", say("{product!r} is no product.", product=product), remedy)
    return SheetsSection(
        index=index,
        rule=table.choice("rule"),
        sm50=_corners(table),
        formats=cast("tuple[Form, ...]", table.words("formats")),
        crs=systems,
        overlap_m=table.number("overlap_m"),
        border=table.file("border"),
        border_m=table.number("border_m"),
        lossy_percent=table.number("lossy_percent"),
        product=product,
        year=int(table.number("year")) if table.has("year") else None,
    )


def _corners(table: Table) -> dict[str, Corner]:
    """Corners of sheets 1:50 000 by their letters."""
    given: object = table.values.get("sm50", {})
    if not isinstance(given, dict):
        remedy = "Write { HUST = [-575000, -1180000] }."
        raise table.error("sm50", "must name each corner.", remedy)
    corners: dict[str, Corner] = {}
    for name, value in cast("dict[str, object]", given).items():
        east, north = table.sequence("sm50", value, 2)
        corners[name] = east, north
    refusing(table, "sm50", lambda: check_corners(corners, ""))
    return corners
