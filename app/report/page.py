"""Write the accuracy report: a page that opens without a network, and the same figures as JSON.

The first page tells every requirement with its value, limit and result.

Nothing is judged here: value, limit and result are those of the findings of `core.quality.rules`.
"""

import base64
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, cast

import numpy as np
import rasterio
from jaxtyping import UInt8
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup
from PIL import Image
from rasterio.enums import Resampling

from app.report.against import against_told
from app.report.checked import readings_told
from app.report.decisions import decisions_told
from app.report.drawing import (
    PICTURE,
    draw_coverage,
    draw_map,
    draw_map_again,
    draw_mosaic,
    draw_mosaic_again,
    draw_symbols,
)
from app.report.model import ReportContent, gather
from app.report.mosaic import misfit_shown
from app.report.plots import (
    PALETTE,
    draw_bars,
    draw_film,
    draw_histogram,
    draw_reliability,
    draw_trend,
    longest_mean,
)
from app.report.wording import (
    WORST,
    beyond_told,
    certificate,
    checks_told,
    comparison_told,
    film_places,
    findings,
    fine,
    parameter_told,
    refused_told,
    status_counts,
)
from core.mosaic.misfit_places import SURE
from core.raster.grid import Grid
from core.raster.ortho import Ortho
from core.said import Said
from sessions.atomic_write import whole_file
from ui import web
from ui.review.rule_rows import JOB, LIMIT_TEXTS, VALUE_TEXTS
from ui.review.scene import short_names
from ui.words.catalogue import Teller

THUMBNAIL_PX = 1400
LONGEST_TABLE = 300
"""Rows of a table on the page; the rest is in the JSON, and the page says so."""
CHAPTERS = (
    "verdict", "against", "doubts", "block", "accuracy", "readings", "samples", "residuals",
    "control", "distribution", "ties", "exterior", "georeference", "interior", "cameras", "mosaic",
    "misfit", "scans", "decisions", "provenance",
)  # fmt: skip
"""In the order of the page; that of an earlier state, of readings, of sheets and of the mosaic
where there are any."""

Figures = dict[str, Any]


def write_report(folder: Path, content: ReportContent) -> tuple[Path, Path]:
    """Write `report.html` and `report.json` into a folder, each whole or not at all.

    Args:
        folder: The results folder of the block.
        content: What is told.

    Returns:
        The page and the JSON; the page shows nothing that is not in the JSON but the mosaic
        and the reference ortho.
    """
    figures = gather(content)
    text = json.dumps(figures, indent=1, ensure_ascii=False, allow_nan=False)
    json_path, html_path = folder / "report.json", folder / "report.html"
    with whole_file(json_path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    picture = "" if content.mosaic is None else thumbnail(content.mosaic)
    beneath = under(content.mosaic, content.ortho) if content.mosaic and content.ortho else ""
    known = {str(one): one for one in said_in(figures)}
    page = render(json.loads(text), picture, Teller(content.language), known, beneath)
    with whole_file(html_path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return html_path, json_path


def said_in(value: Any) -> Iterator[Said]:
    """Every sentence of the engine in nested figures."""
    match value:
        case Said():
            yield value
        case Mapping():
            for key, inside in cast("Mapping[Any, Any]", value).items():
                yield from said_in(key)
                yield from said_in(inside)
        case list() | tuple():
            for inside in cast("Sequence[Any]", value):
                yield from said_in(inside)
        case _:
            return


def render(
    figures: dict[str, Any],
    mosaic_jpeg: str = "",
    tell: Teller | None = None,
    said: Mapping[str, Said] | None = None,
    ortho_jpeg: str = "",
) -> str:
    """The page for the figures of `report.json`.

    Args:
        figures: What `gather` made.
        mosaic_jpeg: The mosaic as a data URI, empty without one.
        tell: The language; English when left out.
        said: What the engine said, by the English sentence that stands in the figures.
        ortho_jpeg: The reference ortho over the same ground, as a data URI, empty without one.

    Returns:
        One HTML document with everything inline.
    """
    tell, known = tell or Teller(), said or {}

    def again(text: str) -> str:
        return tell.again(known.get(text, text))

    mosaic, short = figures["mosaic"], short_names([row["scan"] for row in figures["exterior"]])
    return _page(tell).render(
        f=figures,
        found=findings(figures, tell),
        certificate=certificate(figures, tell),
        tell=tell,
        again=again,
        requirements=requirements(figures, tell),
        chapters=_chapters(figures),
        **readings_told(figures["checked"], tell, short),
        **misfit_shown(figures, tell),
        short=short,
        **_plots(figures, tell),
        **_map_drawn(figures["map"], tell),
        symbols=draw_symbols(tell),
        statuses=status_counts(figures["control"]["by_status"], tell),
        checks_told=checks_told,
        comparison_told=comparison_told,
        refused_told=refused_told,
        against=_against(figures["against"], tell),
        decisions=decisions_told(figures["decisions"]["log"], tell),
        decided_kind=lambda kind: tell(f"report.decided.{kind.replace(' ', '-')}"),
        stage_name=lambda name: tell(f"stage.{name}"),
        parameter=lambda name: parameter_told(name, tell),
        beyond_told=lambda bars, unit="px": beyond_told(bars, tell, unit),
        film_places=film_places(figures["interior"]),
        worst=WORST,
        sure_share=SURE,
        draw_coverage=draw_coverage,
        ortho=ortho_jpeg,
        **(_mosaic_drawn(mosaic, mosaic_jpeg, tell) if mosaic else {}),
        longest=LONGEST_TABLE,
        least=figures["checks"]["least"],
    )


def _against(found: Figures | None, tell: Teller) -> Figures | None:
    """What differs from an earlier state, with its sentence and its decisions in words."""
    if found is None:
        return None
    told = decisions_told(found["decisions"], tell)
    return {**found, "title": against_told(found, tell), "decisions": told}


def _plots(figures: Figures, tell: Teller) -> dict[str, Any]:
    """What is plotted, in the language, and what plots the rest."""
    longest_um = longest_mean(figures["residuals"]["films"])
    return {
        "palette": PALETTE,
        "longest_um": longest_um,
        "draw_film": lambda film: draw_film(film, longest_um, tell),
        "draw_histogram": lambda bars: draw_histogram(bars, tell),
        "draw_trend": lambda trend, unit: draw_trend(trend, unit, tell),
        "rays": draw_bars(figures["ties"]["points_by_rays"], tell),
        "reliability": draw_reliability(figures["reliability"]["bins"], tell),
    }


def _map_drawn(drawn: Figures, tell: Teller) -> dict[str, Any]:
    """The map large with its caption, and as large as its room."""
    block_map, enlarged = draw_map(drawn, tell)
    caption = "report.map.caption.plain" if enlarged is None else "report.map.caption"
    return {
        "block_map": block_map,
        "map_caption": tell(caption, scale=enlarged),
        "small_map": draw_map_again(drawn, tell),
    }


def _mosaic_drawn(mosaic: Figures, picture: str, tell: Teller) -> dict[str, Markup]:
    """The mosaic large, as large as its room, and without seams."""
    return {
        "mosaic": draw_mosaic(mosaic, picture, tell),
        "small_mosaic": draw_mosaic_again(mosaic, tell),
        "plain_mosaic": draw_mosaic_again(mosaic, tell, PICTURE),
    }


def _chapters(figures: Figures) -> list[str]:
    """Those there is anything to tell in."""
    shown = {"mosaic": bool(figures["mosaic"])}
    shown["misfit"] = bool(figures["misfit"] or figures["likely_faults"])
    shown["against"] = bool(figures["against"])
    shown["readings"] = bool(figures["checked"]["plans"])
    shown["samples"] = bool(figures["checked"]["sheets"])
    return [name for name in CHAPTERS if shown.get(name, True)]


@cache
def type_family() -> Markup:
    """The desk's type family with its files inline: a report opens alike on every computer."""

    def inline(url: re.Match[str]) -> str:
        font = base64.b64encode((files(web) / "pages" / url[1]).read_bytes()).decode("ascii")
        return f'url("data:font/woff2;base64,{font}")'

    faces = (files(web) / "pages" / "inter.css").read_text(encoding="utf-8")
    return Markup(re.sub(r'url\("/pages/([a-z-]+\.woff2)"\)', inline, faces))


def thumbnail(path: Path) -> str:
    """A raster as a small JPEG in a data URI; white where it shows nothing."""
    with rasterio.open(path) as file:
        scale = min(1.0, THUMBNAIL_PX / max(file.width, file.height))
        shape = (max(1, round(file.height * scale)), max(1, round(file.width * scale)))
        wanted = [1, 2, 3] if file.count > 2 else [1]
        bands = file.read(wanted, out_shape=(len(wanted), *shape), resampling=Resampling.average)
        values = bands[0] if len(wanted) == 1 else np.moveaxis(bands, 0, -1)
        seen = file.dataset_mask(out_shape=shape) > 0
    levels = np.percentile(values[seen], (0.5, 99.5)) if seen.any() else np.array([0.0, 1.0])
    stretched = (values - levels[0]) / max(float(levels[1] - levels[0]), 1.0) * 255
    stretched[~seen] = 255
    return jpeg_of(np.clip(stretched, 0, 255).astype(np.uint8))


def under(mosaic: Path, ortho: Ortho) -> str:
    """The reference ortho over the ground of the mosaic, as `thumbnail` shows that."""
    with rasterio.open(mosaic) as file:
        west, south, east, north = file.bounds
    gsd = max(east - west, north - south) / THUMBNAIL_PX
    columns, rows = max(1, round((east - west) / gsd)), max(1, round((north - south) / gsd))
    return jpeg_of(ortho.read_colour(Grid(west, north, gsd, columns, rows)))


def jpeg_of(picture: UInt8[np.ndarray, "rows columns *bands"]) -> str:
    """A picture, gray or in colours, as a JPEG in a data URI."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=82)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def _page(tell: Teller) -> Template:
    """The page's template; a figure that is not there is an error."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= _filters(tell)
    environment.globals["type_family"] = type_family
    return environment.get_template("page.html")


def _filters(tell: Teller) -> dict[str, Callable[..., str]]:
    """How the page writes numbers; a dash where there is none."""
    return {
        "figure": lambda value, places=2: tell.number(value, f",.{places}f"),
        "signed": lambda value, places=2: tell.number(value, f"+.{places}f"),
        "scientific": lambda value: tell.number(value, ".3e"),
        "moment": tell.moment,
        "css_text": css_text,
        "fine": lambda value, places: fine(value, tell, places),
        "fine_signed": lambda value, places: fine(value, tell, places, sign="+"),
    }


def css_text(text: str) -> Markup:
    """A text as a string of CSS: nothing in it ends the string or the style."""
    signs = (one if one.isalnum() else f"\\{ord(one):x} " for one in text)
    return Markup('"' + "".join(signs) + '"')


def requirements(figures: Figures, tell: Teller) -> list[Figures]:
    """Rows of the table of rules: what is asked, value, limit, who asks it, and the result.

    Args:
        figures: Those of the report, with what was `checked`.
        tell: The language.
    """
    rows: list[Figures] = []
    short = short_names([row["scan"] for row in figures["exterior"]])
    for one in figures["checked"]["rules"]:
        worst = one["values"].get("worst", "")
        value = tell(
            VALUE_TEXTS[one["kind"]], **{**one["values"], "worst": short.get(worst, worst)}
        )
        if one["more"]:
            value = tell("rules.value.more", value=value, more=one["more"])
        rows.append(
            {
                "name": tell(f"rule.{one['rule']}"),
                "value": value,
                "limit": tell(LIMIT_TEXTS[one["rule"]], **one["values"]),
                "source": tell(f"rules.source.{one['source']}"),
                "by_job": one["source"] == JOB,
                "grave": one["grave"],
                "result": tell(f"report.result.{one['grave']}"),
            }
        )
    return rows
