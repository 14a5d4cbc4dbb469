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
    draw_map_again,
    draw_mosaic,
    draw_mosaic_again,
    draw_reliability,
    draw_symbols,
    short_names,
)
from app.report.model import ReportContent, gather
from app.report.plots import draw_film, draw_histogram, longest_mean
from app.report.summary import requirements
from app.report.wording import WORST, film_places, findings, fine, tell
from sessions.atomic_write import whole_file

THUMBNAIL_PX = 1400
LONGEST_TABLE = 300
"""Rows of a table on the page; the rest is in the JSON, and the page says so."""
CHAPTERS = (
    "Verdict", "Doubts", "Block", "Accuracy", "Residuals", "Control in use",
    "Distribution of control", "Tie points", "Exterior orientation", "Georeference",
    "Interior orientation", "Cameras", "Mosaic", "Scans", "Decisions", "Provenance",
)  # fmt: skip
"""In the order of the page; that of the mosaic only where there is one."""


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
    environment.filters["fine"] = fine
    environment.filters["fine_signed"] = _fine_signed
    block_map, enlarged = draw_map(figures["map"])
    caption = tell("map_caption_plain") if enlarged is None else tell("map_caption", scale=enlarged)
    mosaic, films = figures["mosaic"], figures["residuals"]["films"]
    return environment.get_template("page.html").render(
        f=figures,
        found=findings(figures),
        tell=tell,
        requirements=requirements(figures),
        chapters=[name for name in CHAPTERS if mosaic or name != "Mosaic"],
        short=short_names([row["scan"] for row in figures["exterior"]]),
        block_map=block_map,
        small_map=draw_map_again(figures["map"]),
        symbols=draw_symbols(),
        draw_histogram=draw_histogram,
        draw_film=draw_film,
        longest_px=longest_mean(films),
        film_places=film_places(figures["interior"]),
        worst=WORST,
        map_caption=caption,
        rays=draw_bars(figures["ties"]["points_by_rays"], "rays"),
        reliability=draw_reliability(figures["reliability"]["bins"]),
        draw_coverage=draw_coverage,
        mosaic=draw_mosaic(mosaic, mosaic_jpeg) if mosaic else "",
        small_mosaic=draw_mosaic_again(mosaic) if mosaic else "",
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


def _fine_signed(value: float | None, places: int = 2) -> str:
    return fine(value, places, sign="+")


def _signed(value: float | None, places: int = 2) -> str:
    return "–" if value is None else f"{value:+.{places}f}".replace("-", "−")
