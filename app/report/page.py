"""The accuracy report: a page that opens without a network, and every figure of it as JSON."""

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from PIL import Image
from rasterio.enums import Resampling

from app.report.drawing import (
    draw_bars,
    draw_coverage,
    draw_map,
    draw_reliability,
    draw_seams,
)
from app.report.model import ReportContent, gather
from app.report.wording import findings, tell
from sessions.atomic_write import whole_file

THUMBNAIL_PX = 1400
LONGEST_TABLE = 300
"""Rows of a table on the page; the rest is in the JSON, and the page says so."""


def write_report(folder: Path, content: ReportContent) -> tuple[Path, Path]:
    """Write `report.html` and `report.json` into a folder, each whole or not at all.

    Args:
        folder: The results folder of the block.
        content: What is told.

    Returns:
        The page and the JSON; the page shows nothing that is not in the JSON but the mosaic.
    """
    text = json.dumps(gather(content), indent=1, ensure_ascii=False, allow_nan=False)
    json_path, html_path = folder / "report.json", folder / "report.html"
    with whole_file(json_path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    picture = "" if content.mosaic is None else thumbnail(content.mosaic)
    page = render(json.loads(text), picture)
    with whole_file(html_path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return html_path, json_path


def render(figures: dict[str, Any], mosaic_jpeg: str = "") -> str:
    """The page for the figures of `report.json`.

    Args:
        figures: What `gather` made.
        mosaic_jpeg: The mosaic as a data URI, empty without one.

    Returns:
        One HTML document with everything inline.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["figure"] = _figure
    environment.filters["signed"] = _signed
    block_map, enlarged = draw_map(figures["map"])
    caption = tell("map_caption_plain") if enlarged is None else tell("map_caption", scale=enlarged)
    mosaic = figures["mosaic"]
    return environment.get_template("page.html").render(
        f=figures,
        found=findings(figures),
        tell=tell,
        block_map=block_map,
        map_caption=caption,
        rays=draw_bars(figures["ties"]["points_by_rays"], "rays"),
        reliability=draw_reliability(figures["reliability"]["bins"]),
        draw_coverage=draw_coverage,
        seams=draw_seams(mosaic) if mosaic and mosaic["seams"] else "",
        mosaic_jpeg=mosaic_jpeg,
        longest=LONGEST_TABLE,
    )


def thumbnail(path: Path) -> str:
    """A raster as a small JPEG in a data URI; white where it shows nothing."""
    with rasterio.open(path) as file:
        scale = min(1.0, THUMBNAIL_PX / max(file.width, file.height))
        shape = (max(1, round(file.height * scale)), max(1, round(file.width * scale)))
        values = file.read(1, out_shape=shape, resampling=Resampling.average)
        seen = file.dataset_mask(out_shape=shape) > 0
    levels = np.percentile(values[seen], (0.5, 99.5)) if seen.any() else np.array([0.0, 1.0])
    stretched = (values - levels[0]) / max(float(levels[1] - levels[0]), 1.0) * 255
    gray = np.where(seen, np.clip(stretched, 0, 255), 255).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(gray).save(stream, "JPEG", quality=82)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def _figure(value: float | None, places: int = 2) -> str:
    """A number with fixed places; a dash where there is none."""
    return "–" if value is None else f"{value:,.{places}f}".replace(",", "\u202f").replace("-", "−")


def _signed(value: float | None, places: int = 2) -> str:
    return "–" if value is None else f"{value:+.{places}f}".replace("-", "−")
