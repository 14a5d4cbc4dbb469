"""Drawings of the accuracy report as SVG, from its figures alone; and the figures of its map."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, hypot, log10, sqrt
from typing import Any

import numpy as np
from markupsafe import Markup
from shapely.geometry import Polygon

from core.adjustment.adjusted import AdjustmentReport
from ui.review.scene import short_names
from ui.words.catalogue import Teller

Figures = dict[str, Any]
WIDTH = 1000.0
"""Width of the block figure in its own units."""
MARGIN = 46.0
TALLEST = 1100.0
MAP, MOSAIC, PICTURE = "blockmap", "mosaicmap", "mosaicpicture"
"""Names of both drawings in the page."""
PROBABLE = 0.9
"""Misfit vectors of this probability are drawn strongly."""
HOLE = 9.0
"""Smallest ring about a hole of the mosaic."""
VECTOR_SHARE = 0.045
"""A large residual vector is drawn this long, as a share of the width."""
SHOWN_TIES = 4000
"""Tie points drawn in the block figure at most."""


@dataclass(frozen=True, slots=True)
class _Sheet:
    """Paper coordinates of easting and northing: x right, y down."""

    west: float
    north: float
    per_metre: float
    height: float

    def at(self, position: Sequence[float]) -> tuple[float, float]:
        return (
            MARGIN + (position[0] - self.west) * self.per_metre,
            MARGIN + (self.north - position[1]) * self.per_metre,
        )


def map_figures(report: AdjustmentReport, footprints: Mapping[str, Polygon]) -> dict[str, Any]:
    """What the block figure draws, in the block's CRS."""
    block = report.block
    ties = report.tie_positions[np.isfinite(report.tie_positions).all(axis=1), :2]
    ties = ties[:: max(1, -(-len(ties) // SHOWN_TIES))]
    control = [
        {
            "point_id": name,
            "position": block.surveyed[name].position[:2].tolist(),
            "vector_m": (position - block.surveyed[name].position)[:2].tolist(),
        }
        for name, position in report.surveyed_positions.items()
        if block.surveyed[name].role == "control"
    ]
    left_out = {key[0] for key in block.measurements} - set(report.surveyed_positions)
    return {
        "footprints": {
            name: [[round(x, 2), round(y, 2)] for x, y, *_ in polygon.exterior.coords]
            for name, polygon in footprints.items()
        },
        "centres": {
            name: {"position": photo.exterior.centre[:2].tolist(), "oriented": photo.oriented}
            for name, photo in block.photos.items()
        },
        "ties": np.round(ties, 1).tolist(),
        "control": control,
        "checks": [
            {
                "point_id": check.point_id,
                "position": block.surveyed[check.point_id].position[:2].tolist(),
                "vector_m": check.difference_m[:2].tolist(),
            }
            for check in report.checks
        ],
        "left_out": [
            block.surveyed[name].position[:2].tolist()
            for name in sorted(left_out)
            if block.surveyed[name].role == "control"
        ],
    }


def draw_map(figures: Figures, tell: Teller) -> tuple[Markup, float | None]:
    """The block figure, and how many times its vectors are enlarged (None without vectors)."""
    sheet = _sheet(figures)
    enlarged = _enlargement(figures, sheet)
    parts = [_frame(sheet, tell)]
    parts += [_ring(sheet, ring, "footprint") for ring in figures["footprints"].values()]
    parts += [_dot(sheet.at(place), "tie", 1.4) for place in figures["ties"]]
    parts += [_cross(sheet.at(place)) for place in figures["left_out"]]
    parts += [part for p in figures["control"] for part in _point(sheet, p, "control", enlarged)]
    parts += [part for p in figures["checks"] for part in _point(sheet, p, "check", enlarged)]
    names = short_names(list(figures["centres"]))
    for name, centre in figures["centres"].items():
        parts += _centre(sheet, centre, names[name])
    parts.append(_scale_bar(sheet, tell))
    if enlarged is not None:
        parts.append(_vector_bar(sheet, enlarged, tell))
    box = f"0 0 {WIDTH:.0f} {sheet.height:.0f}"
    scale = None if enlarged is None else enlarged / sheet.per_metre
    drawn = tag("g", Markup("").join(parts), id=MAP)
    return _picture(drawn, box, tell("report.chapter.block")), scale


def draw_misfit(figures: Figures, misfit: Figures, tell: Teller) -> tuple[Markup, float | None]:
    """Misfit vectors over the footprints, worst places ringed; and how often they are enlarged."""
    shown = {**figures, "control": misfit["vectors"], "checks": []}
    sheet = _sheet(shown)
    enlarged = _enlargement(shown, sheet)
    parts = [_frame(sheet, tell)]
    parts += [_ring(sheet, ring, "footprint") for ring in figures["footprints"].values()]
    for vector in misfit["vectors"]:
        kind = "control" if vector["probability"] >= PROBABLE else "tie"
        parts += _point(sheet, {**vector, "point_id": ""}, kind, enlarged)
    for number, place in enumerate(misfit["places"], 1):
        at = sheet.at(place["position"])
        if place["significant"]:
            parts.append(_dot(at, "hole", HOLE))
        parts.append(_text((at[0], at[1] - 5), str(number), "seamname"))
    parts.append(_scale_bar(sheet, tell))
    if enlarged is not None:
        parts.append(_vector_bar(sheet, enlarged, tell))
    box = f"0 0 {WIDTH:.0f} {sheet.height:.0f}"
    scale = None if enlarged is None else enlarged / sheet.per_metre
    return _picture(Markup("").join(parts), box, tell("report.chapter.misfit")), scale


def draw_map_again(figures: Figures, tell: Teller) -> Markup:
    """The block figure once more, of any size: it refers to the one that was drawn."""
    box = f"0 0 {WIDTH:.0f} {_sheet(figures).height:.0f}"
    return _picture(tag("use", href=f"#{MAP}"), box, tell("report.chapter.block"))


def draw_symbols(tell: Teller) -> dict[str, Markup]:
    """What the block figure draws at a place, each by itself for the legend."""
    middle = (9.0, 9.0)
    drawn = {
        tell("report.symbol.centre"): _triangle(middle, "centre"),
        tell("report.symbol.control"): _dot(middle, "control", 3.4),
        tell("report.symbol.check"): _dot(middle, "check", 3.4),
        tell("report.symbol.left-out"): _cross(middle),
        tell("report.symbol.tie"): _dot(middle, "tie", 1.4),
    }
    return {
        name: tag("svg", part, viewBox="0 0 18 18", class_="symbol") for name, part in drawn.items()
    }


def draw_mosaic(mosaic: Figures, picture: str, tell: Teller) -> Markup:
    """The picture of the mosaic with seams and holes over it.

    Args:
        mosaic: Figures of the mosaic.
        picture: The picture as a data URI.
        tell: Puts its name into words.
    """
    west, south, east, north = mosaic["bounds"]
    names = short_names([seam["scan"] for seam in mosaic["seams"]])
    wide, per_metre = WIDTH, WIDTH / (east - west)
    tall = per_metre * (north - south)

    def at(x: float, y: float) -> tuple[float, float]:
        return per_metre * (x - west), per_metre * (north - y)

    parts = [tag("image", href=picture, width=wide, height=tall, id=PICTURE)]
    for seam in mosaic["seams"]:
        for ring in seam["rings"]:
            places = [at(x, y) for x, y in ring]
            parts.append(tag("polygon", points=_points(places), class_="seam"))
        inside = Polygon(max(seam["rings"], key=len)).representative_point()
        parts.append(_text(at(inside.x, inside.y), names[seam["scan"]], "seamname"))
    for hole in mosaic["holes"]:
        radius = max(per_metre * sqrt(hole["area_m2"]), HOLE)
        parts.append(_dot(at(hole["east"], hole["north"]), "hole", radius))
    drawn = tag("g", Markup("").join(parts), id=MOSAIC)
    return _picture(drawn, f"0 0 {wide:.0f} {tall:.0f}", tell("report.chapter.mosaic"))


def draw_mosaic_again(mosaic: Figures, tell: Teller, part: str = MOSAIC) -> Markup:
    """The mosaic once more, of any size: it refers to the one that was drawn, or its picture."""
    west, south, east, north = mosaic["bounds"]
    box = f"0 0 {WIDTH:.0f} {WIDTH * (north - south) / (east - west):.0f}"
    return _picture(tag("use", href=f"#{part}"), box, tell("report.chapter.mosaic"))


def _picture(drawn: Markup, box: str, name: str) -> Markup:
    """A drawing as wide as its room, with a name for those who do not see it."""
    return tag("svg", drawn, viewBox=box, class_="map", role="img", **{"aria-label": name})


def draw_coverage(photo: Figures) -> Markup:
    """Nine cells of a photo: how much control, and a bar for its ties."""
    side = 34.0
    most = max(max(row) for row in photo["ties"]) or 1
    parts: list[Markup] = []
    for row in range(3):
        for column in range(3):
            count, ties = photo["control"][row][column], photo["ties"][row][column]
            x, y = column * side, row * side
            style = "cell full" if count else "cell empty"
            parts.append(_rect((x + 1, y + 1), side - 2, side - 2, style))
            parts.append(_text((x + side / 2, y + side / 2 + 2), str(count), "cellcount"))
            width = (side - 8) * ties / most
            parts.append(_rect((x + 4, y + side - 7), width, 3, "celltie"))
    return tag("svg", Markup("").join(parts), viewBox="0 0 102 102", class_="nine")


def _sheet(figures: Figures) -> _Sheet:
    places = [place for ring in figures["footprints"].values() for place in ring]
    places += [point["position"] for key in ("control", "checks") for point in figures[key]]
    places += [centre["position"] for centre in figures["centres"].values()]
    places = places or [[0.0, 0.0]]
    west, east = min(p[0] for p in places), max(p[0] for p in places)
    south, north = min(p[1] for p in places), max(p[1] for p in places)
    wide, tall = max(east - west, 1.0), max(north - south, 1.0)
    per_metre = min((WIDTH - 2 * MARGIN) / wide, (TALLEST - 2 * MARGIN) / tall)
    # A tall block is drawn in the middle of the width.
    west -= ((WIDTH - 2 * MARGIN) / per_metre - wide) / 2
    return _Sheet(west, north, per_metre, tall * per_metre + 2 * MARGIN + 34)


def _enlargement(figures: Figures, sheet: _Sheet) -> float | None:
    """Paper units per metre of residual, a round number of times the map's."""
    lengths = sorted(
        hypot(*point["vector_m"])
        for key in ("control", "checks")
        for point in figures[key]
        if None not in point["vector_m"]
    )
    if not lengths or lengths[-1] <= 0:
        return None
    large = lengths[int(0.9 * (len(lengths) - 1))] or lengths[-1]
    return _round_down(VECTOR_SHARE * WIDTH / large / sheet.per_metre) * sheet.per_metre


def _frame(sheet: _Sheet, tell: Teller) -> Markup:
    """Neat line with coordinates at round distances, and grid north."""
    right, bottom = WIDTH - MARGIN, sheet.height - MARGIN - 34 + 0.0
    parts = [_rect((MARGIN - 14, MARGIN - 14), right - MARGIN + 28, bottom - MARGIN + 28, "neat")]
    step = _round_down((right - MARGIN) / sheet.per_metre / 4)
    easting = ceil(sheet.west / step) * step
    while MARGIN + (easting - sheet.west) * sheet.per_metre <= right:
        x = MARGIN + (easting - sheet.west) * sheet.per_metre
        parts.append(_line((x, MARGIN - 14), (x, MARGIN - 20), "axis"))
        parts.append(_text((x, MARGIN - 25), tell.number(easting, ",.0f"), "coordinate"))
        easting += step
    northing = floor(sheet.north / step) * step
    while MARGIN + (sheet.north - northing) * sheet.per_metre <= bottom:
        y = MARGIN + (sheet.north - northing) * sheet.per_metre
        parts.append(_line((MARGIN - 14, y), (MARGIN - 20, y), "axis"))
        parts.append(
            _text(
                (MARGIN - 25, y),
                tell.number(northing, ",.0f"),
                "coordinate",
                transform=f"rotate(-90 {MARGIN - 25:.1f} {y:.1f})",
            )
        )
        northing -= step
    x = right - 6
    parts.append(tag("path", d=f"M{x} {MARGIN - 4} l6 20 l-6 -5 l-6 5 z", class_="north"))
    parts.append(_text((x, MARGIN + 30), tell("report.map.north"), "northname"))
    return Markup("").join(parts)


def _centre(sheet: _Sheet, centre: Figures, name: str) -> list[Markup]:
    x, y = sheet.at(centre["position"])
    style = "centre" if centre["oriented"] else "centre loose"
    return [_triangle((x, y), style), _text((x + 9, y + 5), name, "name")]


def _triangle(at: tuple[float, float], style: str) -> Markup:
    return tag("path", d=f"M{at[0]:.1f} {at[1] - 6:.1f} l5.5 10 h-11 z", class_=style)


def _point(sheet: _Sheet, point: Figures, style: str, enlarged: float | None) -> list[Markup]:
    parts = [_dot(sheet.at(point["position"]), style, 3.4, title=point["point_id"])]
    if enlarged is not None and None not in point["vector_m"]:
        x, y = sheet.at(point["position"])
        east, north = point["vector_m"]
        end = (x + east * enlarged, y - north * enlarged)
        parts.insert(0, _line((x, y), end, f"vector {style}line"))
    return parts


def _dot(at: tuple[float, float], style: str, radius: float, title: str = "") -> Markup:
    inner = tag("title", title) if title else Markup("")
    return tag("circle", inner, cx=at[0], cy=at[1], r=radius, class_=style)


def _line(start: tuple[float, float], end: tuple[float, float], style: str) -> Markup:
    (x1, y1), (x2, y2) = start, end
    return tag("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=style)


def _rect(corner: tuple[float, float], width: float, height: float, style: str) -> Markup:
    return tag("rect", x=corner[0], y=corner[1], width=width, height=height, class_=style)


def _text(at: tuple[float, float], words: str, style: str, **more: str) -> Markup:
    return tag("text", words, x=at[0], y=at[1], class_=style, **more)


def _cross(at: tuple[float, float]) -> Markup:
    x, y = at
    return tag("path", d=f"M{x - 3:.1f} {y - 3:.1f} l6 6 m0 -6 l-6 6", class_="leftout")


def _ring(sheet: _Sheet, ring: Sequence[Sequence[float]], style: str) -> Markup:
    return tag("polygon", points=_points([sheet.at(place) for place in ring]), class_=style)


def _scale_bar(sheet: _Sheet, tell: Teller) -> Markup:
    metres = _round_down(WIDTH / 5 / sheet.per_metre)
    x, y = MARGIN, sheet.height - 22
    far = metres >= 1000
    name = tell("report.map.km" if far else "report.map.m", value=metres / (1000 if far else 1))
    return Markup("").join(
        [
            tag("path", d=f"M{x} {y - 5} v5 h{metres * sheet.per_metre:.1f} v-5", class_="scale"),
            _text((x, y - 9), name, "scalename"),
        ]
    )


def _vector_bar(sheet: _Sheet, enlarged: float, tell: Teller) -> Markup:
    metres = _round_down(VECTOR_SHARE * 1.6 * WIDTH / enlarged)
    x, y = WIDTH - MARGIN - metres * enlarged, sheet.height - 22
    return Markup("").join(
        [
            tag(
                "path",
                d=f"M{x:.1f} {y - 5} v5 h{metres * enlarged:.1f} v-5",
                class_="scale vectorscale",
            ),
            _text(
                (WIDTH - MARGIN, y - 9),
                tell("report.map.residual", value=metres),
                "scalename right",
            ),
        ]
    )


def _round_down(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten below a value."""
    power = 10.0 ** floor(log10(max(value, 1e-12)))
    return power * max(m for m in (1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-9))


def _points(places: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def tag(name: str, inner: str | Markup = "", **attributes: str | float) -> Markup:
    """One element; text and attributes are escaped unless they are markup already."""
    told = Markup("").join(
        Markup(' {}="{}"').format(
            key.rstrip("_"), f"{value:.1f}" if isinstance(value, float) else value
        )
        for key, value in attributes.items()
    )
    return Markup("<{0}{1}>{2}</{0}>").format(Markup(name), told, inner)
